//! Markers that are fixed to another body than the model says: their place on it, from all of their observations.

use super::misfit::{Misfit, Work};
use super::mistake::Mistake;
use super::variant::Variant;
use crate::diagnose::data::recording::Via;
use crate::diagnose::model::body::Site;
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::problem::{Observation, Problem, Seen};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::FEWEST_OBSERVATIONS;
use nalgebra::{Matrix3, Vector3};

/// A line (or, of a measured point, a point) in a body's frame on which a marker lies.
struct Sight {
    origin: Vector3<f64>,
    /// Projects across the line; the identity of a point.
    across: Matrix3<f64>,
}

/// Every marker on every other body, at the place that fits best.
pub(super) fn elsewhere(
    problem: &Problem,
    misfit: &Misfit<'_>,
    variant: &Variant,
    frames: &[usize],
) -> Vec<Mistake> {
    let mut out = Vec::new();
    if problem.unknown_frame.is_some() {
        return out;
    }
    for marker in 0..problem.marker_sites.len() {
        let own = problem.marker_sites[marker].node;
        let nodes = (0..problem.scene.nodes()).map(Some).chain([None]);
        let moves = |n: usize| problem.scene.relevant[n] || problem.scene.moves(n);
        // Also on a link whose joint, as the model has the markers, moves none of them.
        for node in nodes.filter(|n| *n != own && n.is_none_or(&moves)) {
            let site = Site { node, node_from_site: Pose::identity() };
            let sights = sights(problem, misfit, variant, frames, marker, &site);
            if let Some(place) = closest(&sights, misfit.usual_m) {
                out.push(Mistake::MarkerParent { marker, node, place });
            }
        }
    }
    out
}

fn sights(
    problem: &Problem,
    misfit: &Misfit<'_>,
    variant: &Variant,
    frames: &[usize],
    marker: usize,
    site: &Site,
) -> Vec<Sight> {
    let mut work = Work::new(problem);
    let mut out = Vec::new();
    for &frame in frames {
        let (camera, foot) = misfit.pose(&mut work, variant, frame);
        let node_from_world = work.frame.world_from_site(site).inverse();
        for observation in &problem.frames[frame].others {
            match observation {
                Observation::Pixel { seen: Seen::Marker(m), via, pixel }
                    if variant.labels[frame][*m] == marker =>
                {
                    let Some(camera) = &camera else { continue };
                    let by = foot.filter(|_| *via == Via::Mirror);
                    if *via == Via::Mirror && by.is_none() {
                        continue;
                    }
                    let Some((origin, direction)) = misfit.ray(by.as_ref(), pixel) else { continue };
                    let node_from_camera = node_from_world.then(&camera.inverse());
                    let direction = node_from_camera.r * direction;
                    out.push(Sight {
                        origin: node_from_camera.point(&origin),
                        across: Matrix3::identity() - direction * direction.transpose(),
                    });
                }
                Observation::Point { marker: m, position } if variant.labels[frame][*m] == marker => {
                    let Some(observer) = problem.points_site else { continue };
                    let world = work.frame.world_from_site(&observer).point(position);
                    out.push(Sight { origin: node_from_world.point(&world), across: Matrix3::identity() });
                }
                _ => {}
            }
        }
    }
    out
}

/// The point closest to most of the lines: least squares, reweighted by `1 / (1 + (r/s)²)`.
fn closest(sights: &[Sight], usual_m: f64) -> Option<Vector3<f64>> {
    if sights.len() < FEWEST_OBSERVATIONS {
        return None;
    }
    let mut weights = vec![1.0; sights.len()];
    let mut place = Vector3::zeros();
    for _ in 0..SOLVER.loose_steps {
        let (mut h, mut g) = (Matrix3::zeros(), Vector3::zeros());
        for (s, w) in sights.iter().zip(&weights) {
            h += s.across * *w;
            g += s.across * s.origin * *w;
        }
        place = h.cholesky()?.solve(&g);
        for (s, w) in sights.iter().zip(&mut weights) {
            let r = (s.across * (place - s.origin)).norm();
            *w = 1.0 / (1.0 + (r / usual_m).powi(2));
        }
    }
    place.iter().all(|x| x.is_finite()).then_some(place)
}
