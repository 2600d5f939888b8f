//! Every column against central differences of the exact forward model, the mirror's plane free in both.

use super::column_world;
use super::gap_world::{Plan, World, Wrong};
use crate::diagnose::effects::hypothesis::{Catalogue, Term};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::normal_equations::inner;
use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::frame::{FrameWork, PROJECTED, Task, Wanted};
use crate::diagnose::model::free_values::ASTIGMATISM;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::slips::{Slip, Slipped};
use crate::robot::Robot;
use nalgebra::{DMatrix, DVector, Vector2, Vector3};
use std::sync::Arc;

/// A small session with a neck between camera and board, so that body atoms move the board's corners too.
fn problem() -> Problem {
    problem_with(true)
}

/// The same, with a neck between camera and board or with both on one body.
pub(super) fn problem_with(neck: bool) -> Problem {
    problem_of(&World::new(4, neck))
}

/// The same with gears between joints: the neck turns along with a shoulder, an elbow with another one of its own arm.
pub(super) fn problem_with_gears() -> Problem {
    let mut world = World::new(4, true);
    let bone = |name: &str| world.bone(name);
    world.geared = vec![
        (bone("neck_yaw"), bone("l_shoulder_yaw"), 0.7),
        (bone("r_elbow"), bone("r_shoulder_pitch"), -1.3),
        (bone("l_elbow"), bone("r_shoulder_pitch"), 0.4),
    ];
    problem_of(&world)
}

fn problem_of(world: &World) -> Problem {
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let plan = Plan {
        postures: 3,
        noise_px: 0.0,
        wrong: vec![Wrong::Offset(world.bone("r_elbow"), 0.002)],
        ..Plan::default()
    };
    Problem::new(&robot, &world.record(&plan)).unwrap()
}

/// A deformation away from zero in everything, so that no derivative is taken at a point of symmetry.
pub(super) fn somewhere(problem: &Problem) -> Deformation {
    let mut d = problem.nominal();
    for n in 0..problem.scene.nodes() {
        d.tilt[n].x = 0.01;
        d.tilt[n].y = -0.02;
        d.link_shift[n] = Vector3::new(0.001, -0.002, 0.001);
        d.origin_shift[n] = Vector3::new(-0.001, 0.001, 0.002);
        for f in 0..problem.scene.frames {
            d.add_joint_delta(f, n, 0.01 * (n as f64 - 4.0));
            d.add_bend(f, n, Vector3::new(0.002, -0.003, 0.001));
            d.add_rock(f, n, 0, -0.03);
            d.add_rock(f, n, 1, 0.02);
            d.add_sag(f, n, Vector3::new(0.001, 0.002, -0.001));
        }
    }
    d.marker_shift[1] = Vector3::new(0.002, 0.001, -0.001);
    d.marker_image = nalgebra::Matrix2x3::new(0.4, 0.002, -0.001, -0.3, 0.001, -0.003);
    d.camera_mount[1] = 0.004;
    d.camera_mount[3] = 0.002;
    d.board_mount = nalgebra::Vector6::new(0.01, -0.006, 0.004, 0.002, -0.001, 0.003);
    d.focal_scale_error = 0.003;
    d.dk1 = 0.01;
    d.board_scale_error = 0.002;
    d.glass_thickness_m = 0.002;
    d.curvature_per_m = 0.004;
    d.add_camera_sway(1, 2, 0.003);
    d.add_board_slip(0, 1, 0.004);
    d.add_board_slip(3, 4, 0.002);
    d.add_focal_wander(2, 0.002);
    d
}

pub(super) fn atoms(problem: &Problem) -> Vec<Atom> {
    let nodes = problem.scene.nodes();
    let mut out: Vec<Atom> = (0..nodes)
        .flat_map(|n| [Atom::Joint(n), Atom::Tilt(n, 0), Atom::Tilt(n, 1), Atom::Bend(n)])
        .collect();
    for k in 0..3 {
        out.extend((0..nodes).map(|n| Atom::LinkShift(Some(n), k)));
        out.push(Atom::LinkShift(None, k));
        out.extend((0..nodes).map(|n| Atom::OriginShift(n, k)));
        out.extend((0..problem.marker_sites.len()).map(|m| Atom::MarkerShift(m, k)));
    }
    out.extend((0..6).map(Atom::CameraMount));
    out.extend((0..6).map(Atom::BoardMount));
    out.extend([Atom::Focal, Atom::Center(0), Atom::Center(1), Atom::Dk1, Atom::BoardScale]);
    out.extend([Atom::Glass, Atom::Curvature]);
    out.extend((0..2).flat_map(|k| (0..3).map(move |by| Atom::MarkerImage(k, by))));
    out.extend((0..nodes).flat_map(|n| (0..3).flat_map(move |k| [Atom::Turn(n, k), Atom::Sag(n, k)])));
    out.extend((0..nodes).map(Atom::Beam));
    out.extend((0..nodes).flat_map(|n| (0..2).flat_map(move |k| [Atom::Across(n, k), Atom::Rock(n, k)])));
    out.extend((0..ASTIGMATISM.end).map(Atom::FreeOptics));
    out
}

/// With all columns, the corners as rows or condensed.
pub(super) fn task<'a>(
    problem: &Problem,
    deformation: &'a Deformation,
    eye: Option<&'a Eye>,
    free: bool,
    condensed: bool,
) -> Task<'a> {
    Task {
        deformation,
        eye,
        noise: problem.noise,
        with_board: true,
        gaussian: true,
        wanted: Wanted { optics: true, lens: true, mirror: true, free },
        planes: None,
        condensed,
    }
}

/// The frame evaluated at a deformation, its plane at its own optimum there.
fn evaluated(problem: &Problem, deformation: &Deformation, frame: usize) -> FrameWork {
    let eye = problem.eye(deformation).unwrap();
    let task = task(problem, deformation, eye.as_ref(), true, false);
    let mut work = FrameWork::new(problem);
    assert!(work.evaluate(problem, &task, frame));
    work
}

/// The rows without their projected part.
fn rows(work: &FrameWork, x: &[f64]) -> DVector<f64> {
    DVector::from_column_slice(&x[..work.row_count])
}

fn column(work: &FrameWork, problem: &Problem, d: &Deformation, atom: Atom) -> Option<Vec<f64>> {
    let mut out = vec![0.0; work.row_count + PROJECTED];
    work.column(problem, d, atom, &mut out).then_some(out)
}

/// Off the plane's directions: `I − D (DᵀD)⁻¹ Dᵀ`. The plane's own small motion under a change lies along them.
fn off_plane(work: &FrameWork) -> DMatrix<f64> {
    let plane = work.plane_rows();
    let inverse = (plane.transpose() * &plane).try_inverse().unwrap();
    DMatrix::identity(work.row_count, work.row_count) - &plane * inverse * plane.transpose()
}

#[test]
fn every_atoms_column_is_the_derivative_of_the_exact_model() {
    let problems = [
        (problem_with(true), 0),
        (problem_with(true), 3),
        (problem_with(false), 2),
        (problem_with_gears(), 1),
    ];
    for (problem, frame) in problems {
        let deformation = somewhere(&problem);
        let work = evaluated(&problem, &deformation, frame);
        let off = off_plane(&work);
        let mut checked = 0;
        let always = |atom| Column::constant(atom);
        let from_here = |atom| {
            let since = (0..problem.frames.len()).map(|f| f64::from(u8::from(f >= frame)));
            Column { atom, weight: Weight::Frames(since.collect()) }
        };
        // What can slip: the board, the camera and markers move from a frame on.
        let slips = |a: &Atom| matches!(a, Atom::CameraMount(_) | Atom::MarkerShift(..));
        let all = atoms(&problem);
        let sliding = all.iter().copied().filter(slips).chain((0..6).map(Atom::BoardSlip)).map(from_here);
        for by in all.iter().copied().map(always).chain(sliding) {
            let atom = by.atom;
            let h = if matches!(atom, Atom::Center(_) | Atom::MarkerImage(_, 0)) { 0.05 } else { 1e-5 };
            let moved = |sign: f64| {
                let mut d = deformation.clone();
                by.add(sign * h, &problem.scene, &mut d);
                let work = evaluated(&problem, &d, frame);
                rows(&work, &work.residual)
            };
            let difference = &off * (moved(-1.0) - moved(1.0)) / (2.0 * h);
            let claimed = column(&work, &problem, &deformation, atom)
                .map_or_else(|| DVector::zeros(work.row_count), |c| &off * rows(&work, &c));
            let scale = difference.norm().max(claimed.norm());
            if scale < 1e-3 {
                continue;
            }
            checked += 1;
            // A bend on top of a bend (3 mrad here) turns about axes that the first one turned: first order in it.
            let bends = matches!(atom, Atom::Bend(_) | Atom::Beam(_) | Atom::Turn(..) | Atom::Across(..));
            let tolerance = if bends { 1e-2 } else { 1e-3 };
            let miss = (&difference - &claimed).norm() / scale;
            assert!(miss < tolerance, "{by:?} in frame {frame}: {miss:e} of {scale:e}");
        }
        assert!(checked > 60, "{checked}");
    }
}

/// Board, camera and markers by the numbers of their slip, against differences of the exact model.
#[test]
fn what_slips_has_the_columns_of_its_motion() {
    let (board, camera, marker) = (Slipped::Board, Slipped::Camera, Slipped::Marker(1));
    for (what, neck) in [(board, true), (camera, true), (board, false), (marker, true)] {
        let problem = problem_with(neck);
        let mut deformation = problem.nominal();
        deformation.camera_mount[1] = 0.004;
        deformation.marker_shift[1] = Vector3::new(0.002, 0.001, -0.001);
        let work = evaluated(&problem, &deformation, 1);
        let off = off_plane(&work);
        for k in 0..6 {
            let moved = |step: f64| {
                let mut slipped = problem.clone();
                let motion = nalgebra::Vector6::ith(k, step);
                slipped.slips.push(Slip { what, first: 0, motion });
                slipped.fit_boards().unwrap();
                let work = evaluated(&slipped, &deformation, 1);
                rows(&work, &work.residual)
            };
            let difference = &off * (moved(-1e-5) - moved(1e-5)) / 2e-5;
            let mut claimed = vec![0.0; work.row_count + PROJECTED];
            let moves = work.column_of_slip(&problem, &deformation, what, k, &mut claimed);
            assert_eq!(moves, what != marker || k >= 3);
            if !moves {
                assert!(difference.norm() < 1e-6);
                continue;
            }
            let claimed = &off * rows(&work, &claimed);
            let miss = (&difference - &claimed).norm() / difference.norm();
            assert!(miss < 1e-3, "{what:?} {k}: {miss:e}");
        }
    }
}

#[test]
fn every_effects_columns_are_the_derivative_of_its_deformation() {
    columns_are_derivatives(&problem());
    columns_are_derivatives(&column_world::problem());
}

fn columns_are_derivatives(problem: &Problem) {
    let scene = &problem.scene;
    let catalogue = Catalogue::new(scene, vocabulary().into_iter().map(Arc::from).collect(), &[]);
    for (h, hypothesis) in catalogue.hypotheses.iter().enumerate() {
        let effect = catalogue.effect(h);
        // Away from zero and from kinks; a play keeps its contacts under so small a change.
        let at: Vec<f64> = hypothesis.prior_std.iter().map(|s| 0.3 * s).collect();
        let last = hypothesis.variants.last().copied().unwrap_or_default();
        let beside = effect.variant_beside(scene, hypothesis.place, last, &at);
        for &variant in hypothesis.variants.iter().take(4).chain(&beside) {
            let term = Term { hypothesis: h, variant, parameters: at.clone(), prior_scale: 1.0 };
            let columns = catalogue.columns(scene, &term);
            assert_eq!(columns.len(), at.len());
            for (k, column) in columns.iter().enumerate() {
                let step = 1e-6 * hypothesis.prior_std[k].max(1e-9);
                let deformed = |sign: f64| {
                    let mut d = problem.nominal();
                    let mut parameters = at.clone();
                    parameters[k] += sign * step;
                    effect.deform(scene, hypothesis.place, variant, &parameters, &mut d);
                    d
                };
                let mut claimed = problem.nominal();
                column.add(1.0, scene, &mut claimed);
                let (plus, minus) = (flat(problem, &deformed(1.0)), flat(problem, &deformed(-1.0)));
                let claimed = flat(problem, &claimed);
                let difference = (plus - minus) / (2.0 * step);
                let scale = claimed.norm().max(1e-9);
                assert!(
                    (&difference - &claimed).norm() < 1e-4 * scale,
                    "{} parameter {k} variant {variant}: {}",
                    catalogue.name(scene, h),
                    (&difference - &claimed).norm() / scale
                );
            }
        }
    }
}

/// All numbers of a deformation in one vector.
fn flat(problem: &Problem, d: &Deformation) -> DVector<f64> {
    let (frames, nodes) = (problem.scene.frames, problem.scene.nodes());
    let mut out = Vec::new();
    for f in 0..frames {
        for n in 0..nodes {
            out.push(d.joint_delta(f, n));
            out.extend(d.bend(f, n).copied().unwrap_or_else(Vector3::zeros).iter());
            out.extend(d.rock(f, n).copied().unwrap_or_else(Vector2::zeros).iter());
            out.extend(d.sag(f, n).copied().unwrap_or_else(Vector3::zeros).iter());
        }
        for m in 0..problem.marker_sites.len() {
            out.extend(d.marker_shift_in(f, m).iter());
        }
    }
    out.extend(d.tilt.iter().flat_map(|t| [t.x, t.y]));
    out.extend(d.link_shift.iter().chain(&d.origin_shift).flat_map(|s| [s.x, s.y, s.z]));
    out.extend(d.camera_mount.iter().chain(&d.board_mount));
    out.extend([d.focal_scale_error, d.center_px.x, d.center_px.y, d.dk1, d.board_scale_error]);
    out.extend(d.marker_image.iter());
    out.extend([d.glass_thickness_m, d.curvature_per_m]);
    DVector::from_vec(out)
}

/// The pose in the frame of measured points, of a base that stands still or moves, in a frame that is known or not.
#[test]
fn a_base_that_moves_has_the_columns_of_its_motion() {
    for known in [false, true] {
        let mut problem = column_world::problem();
        if known {
            problem.unknown_frame = None;
        }
        let mut deformation = problem.nominal();
        if !known {
            deformation.frame_pose = nalgebra::Vector6::new(0.02, -0.01, 0.03, 0.1, 0.2, -0.1);
        }
        for moving in [false, true] {
            if moving {
                (0..6).for_each(|k| deformation.add_frame_sway(3, k, 0.01 * (k as f64 - 2.0)));
            }
            let work = evaluated(&problem, &deformation, 3);
            for k in 0..6 {
                let by = Column { atom: Atom::FramePose(k), weight: Weight::Frames(vec![1.0; 10]) };
                let moved = |sign: f64| {
                    let mut d = deformation.clone();
                    by.add(sign * 1e-5, &problem.scene, &mut d);
                    let work = evaluated(&problem, &d, 3);
                    rows(&work, &work.residual)
                };
                let difference = (moved(-1.0) - moved(1.0)) / 2e-5;
                let claimed = column(&work, &problem, &deformation, by.atom).unwrap();
                let claimed = rows(&work, &claimed);
                let miss = (&difference - &claimed).norm() / difference.norm();
                let turned = !known || moving;
                assert!(
                    miss < if turned { 0.05 } else { 1e-6 },
                    "known {known}, moving {moving}, {k}: {miss:e}"
                );
            }
        }
    }
}

#[test]
fn the_inner_product_is_that_of_the_projected_columns() {
    let problem = problem();
    let deformation = somewhere(&problem);
    let work = evaluated(&problem, &deformation, 1);
    let off = off_plane(&work);
    let columns: Vec<Vec<f64>> =
        atoms(&problem).into_iter().filter_map(|a| column(&work, &problem, &deformation, a)).collect();
    for x in &columns {
        let projected = &off * rows(&work, x);
        for y in &columns {
            let exact = projected.dot(&rows(&work, y));
            let scale = rows(&work, x).norm() * rows(&work, y).norm();
            assert!((inner(x, y) - exact).abs() < 1e-9 * scale);
        }
    }
}

#[test]
fn the_ideal_mirrors_short_cut_is_the_general_optics() {
    // The same session by the short cut, and by the general optics through a pane of no thickness worth the name.
    let problem = problem();
    let short = problem.nominal();
    let mut long = problem.nominal();
    long.glass_thickness_m = 1e-12;
    for frame in 0..problem.frames.len() {
        let run = |d: &Deformation| {
            let eye = problem.eye(d).unwrap();
            let task = task(&problem, d, eye.as_ref(), true, false);
            let mut work = FrameWork::new(&problem);
            assert!(work.evaluate(&problem, &task, frame));
            let by_mirror = [Atom::Glass, Atom::Curvature].map(|a| column(&work, &problem, d, a).unwrap());
            (work.residual.clone(), work.foot, work.plane_rows(), by_mirror)
        };
        let ((a, foot_a, rows_a, by_a), (b, foot_b, rows_b, by_b)) = (run(&short), run(&long));
        for (x, y) in by_a.iter().zip(&by_b) {
            let (x, y) = (DVector::from_column_slice(x), DVector::from_column_slice(y));
            assert!((&x - &y).norm() < 1e-6 * x.norm());
        }
        assert!((foot_a - foot_b).norm() < 1e-9);
        assert!((&rows_a - &rows_b).norm() < 1e-7 * rows_a.norm());
        assert!(a.iter().zip(&b).all(|(x, y)| (x - y).abs() < 1e-6));
    }
}

/// Markers are seen together where no free-form error is asked for, and one by one where one is: in a flat mirror, and in one of glass and curved.
#[test]
fn markers_seen_together_are_those_seen_one_by_one() {
    let problem = problem();
    for d in [problem.nominal(), somewhere(&problem)] {
        let eye = problem.eye(&d).unwrap();
        for frame in 0..problem.frames.len() {
            let run = |free: bool| {
                let task = task(&problem, &d, eye.as_ref(), free, false);
                let mut work = FrameWork::new(&problem);
                assert!(work.evaluate(&problem, &task, frame));
                let of = [Atom::Focal, Atom::Center(1), Atom::Dk1, Atom::Glass, Atom::Curvature];
                let columns = of.map(|a| column(&work, &problem, &d, a).unwrap());
                (work.residual.clone(), work.plane_rows(), columns)
            };
            let ((a, plane_a, by_a), (b, plane_b, by_b)) = (run(false), run(true));
            let far = |x: &[f64], y: &[f64]| {
                let (x, y) = (DVector::from_column_slice(x), DVector::from_column_slice(y));
                (&x - &y).norm() / x.norm()
            };
            assert!(far(&a, &b) < 1e-6, "{}", far(&a, &b));
            assert!((&plane_a - &plane_b).norm() < 1e-9 * plane_a.norm());
            for (x, y) in by_a.iter().zip(&by_b) {
                assert!(far(x, y) < 1e-8, "{}", far(x, y));
            }
        }
    }
}

/// Condensed corners have the products of the corners themselves: of every atom with every atom and with the residual.
#[test]
fn condensed_corners_have_the_same_products() {
    for (neck, flat) in [(true, false), (false, false), (true, true), (false, true)] {
        let problem = problem_with(neck);
        let mut d = somewhere(&problem);
        if flat {
            // In a flat mirror the products are made without the rows.
            (d.glass_thickness_m, d.curvature_per_m) = (0.0, 0.0);
        }
        let eye = problem.eye(&d).unwrap();
        let full = evaluated(&problem, &d, 1);
        let mut condensed = FrameWork::new(&problem);
        let task = task(&problem, &d, eye.as_ref(), false, true);
        assert!(condensed.evaluate(&problem, &task, 1));
        assert!(condensed.row_count < full.row_count / 2);
        assert!((condensed.foot - full.foot).norm() < 1e-9);
        assert!((condensed.cost - full.cost).abs() < 1e-9 * full.cost);
        assert!((condensed.board_excess - full.board_excess).abs() < 1e-9 * full.cost);
        let all = atoms(&problem).into_iter();
        let atoms: Vec<Atom> = all.filter(|a| !matches!(a, Atom::FreeOptics(_))).collect();
        let vectors = |work: &FrameWork| -> Vec<Option<Vec<f64>>> {
            let of_atoms = atoms.iter().map(|&a| column(work, &problem, &d, a));
            of_atoms.chain([Some(work.residual.clone())]).collect()
        };
        let (exact, few) = (vectors(&full), vectors(&condensed));
        for (i, (x, a)) in exact.iter().zip(&few).enumerate() {
            assert_eq!(x.is_some(), a.is_some(), "atom {i}");
            let (Some(x), Some(a)) = (x, a) else { continue };
            for (y, b) in exact.iter().zip(&few).take(i) {
                let (Some(y), Some(b)) = (y, b) else { continue };
                let scale = (dot(x, x) * dot(y, y)).sqrt();
                let difference = (inner(x, y) - inner(a, b)).abs();
                // Columns that depend on others are left out: their products are off by the root of what is not in them.
                assert!(difference <= 1e-7 * scale, "{:?}: {difference} of {scale}", atoms.get(i));
            }
        }
    }
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(a, b)| a * b).sum()
}
