//! Markers that are fixed to another body than the model says: their place on it, from all of their observations.

use super::misfit::{GROSS, Misfit};
use super::mistake::Mistake;
use super::placed::{Placed, PointSeen};
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
    if problem.unknown_frame.is_some() {
        return elsewhere_in_unknown_frame(problem, misfit, variant, frames);
    }
    let mut out = Vec::new();
    for marker in 0..problem.marker_sites.len() {
        for site in other_bodies(problem, marker) {
            let node = site.node;
            let sights = sights(problem, misfit, variant, frames, marker, &site);
            if let Some(place) = closest(&sights, misfit.usual_m) {
                out.push(Mistake::MarkerParent { marker, node, place });
            }
        }
    }
    out
}

/// The bodies that a marker may be fixed to by mistake, also those whose joint, as the model has the markers, moves none of them.
fn other_bodies(problem: &Problem, marker: usize) -> impl Iterator<Item = Site> + '_ {
    let own = problem.marker_sites[marker].node;
    let nodes = (0..problem.scene.nodes()).map(Some).chain([None]);
    let moves = |n: usize| problem.scene.relevant[n] || problem.scene.moves(n);
    nodes
        .filter(move |n| *n != own && n.is_none_or(moves))
        .map(|node| Site { node, node_from_site: Pose::identity() })
}

/// The same where the frame of the measured points is unknown: it is estimated again with each body, on which the marker may be
/// anywhere. Only markers that are far off are looked for.
fn elsewhere_in_unknown_frame(
    problem: &Problem,
    misfit: &Misfit<'_>,
    variant: &Variant,
    frames: &[usize],
) -> Vec<Mistake> {
    let points = misfit.points(variant, frames);
    let placed = misfit.placed_by(&points);
    let is_off = |marker: usize| {
        let own = || points.iter().filter(|p| p.marker == marker);
        let loss: f64 = own().map(|p| misfit.loss(placed.distance(p))).sum();
        loss > GROSS * own().count() as f64 && own().count() >= FEWEST_OBSERVATIONS
    };
    let mut out = Vec::new();
    let mut work = misfit.work();
    for marker in (0..problem.marker_sites.len()).filter(|&m| is_off(m)) {
        let mut known = problem.scene.mount_known.clone();
        known[marker] = false;
        let sites: Vec<Site> = other_bodies(problem, marker).collect();
        let mut on_each: Vec<Vec<PointSeen>> = vec![points.clone(); sites.len()];
        let mut posed = None;
        for (i, point) in points.iter().enumerate().filter(|(_, p)| p.marker == marker) {
            if posed != Some(point.frame) {
                misfit.pose(&mut work, variant, point.frame);
                posed = Some(point.frame);
            }
            let root = work.frame.world_from_site(&problem.scene.body.root).inverse();
            for (points, site) in on_each.iter_mut().zip(&sites) {
                points[i].mount = root.then(&work.frame.world_from_site(site));
                points[i].local = Vector3::zeros();
            }
        }
        for (points, site) in on_each.iter().zip(sites) {
            let place = Placed::by(points, &known, misfit.usual_m).shifts[marker];
            if place.iter().all(|x| x.is_finite()) {
                out.push(Mistake::MarkerParent { marker, node: site.node, place });
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
    let mut work = misfit.work();
    let mut out = Vec::new();
    for &frame in frames {
        let (camera, board) = misfit.pose(&mut work, variant, frame);
        let foot = board.map(|board| board.foot);
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
