//! The mirror of a frame: near the camera, where a corner is false, and where the board hardly shows it.

use crate::diagnose::model::camera_and_mirror::Eye;
use crate::diagnose::model::frame::plane_of_frame::Pull;
use crate::diagnose::model::frame::sight::mirrored_pixel;
use crate::diagnose::model::frame::work::{FrameWork, Task};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::robust::Mixture;
use crate::diagnose::principles::Prior;
use crate::diagnose::tests::gap_world::{Plan, World};
use crate::geometry::Plane;
use crate::random::Random;
use crate::robot::Robot;
use nalgebra::{Matrix2x3, Matrix3, Point3, Vector2, Vector3};

const NOISE_PX: Prior = 0.2;

fn session() -> Problem {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    Problem::new(&robot, &world.record(&Plan::default())).unwrap()
}

fn eye_of(problem: &Problem) -> Eye {
    problem.eye(&problem.nominal()).unwrap().unwrap()
}

/// The first frame's corners in the camera's frame.
fn corners_before_camera(problem: &Problem, eye: &Eye) -> Vec<Vector3<f64>> {
    let mut work = FrameWork::new(problem);
    work.pose(problem, &problem.nominal(), 0);
    let board = problem.board_in(0).unwrap();
    let camera_from_board = work.camera_from_world(problem, eye).then(&work.world_from_board(&board));
    problem.corners.iter().map(|corner| camera_from_board.point(corner)).collect()
}

/// The corners as a mirror of this foot point shows them, with noise; none where one of them is not in the picture.
fn shown(
    eye: &Eye,
    foot: &Vector3<f64>,
    corners: &[Vector3<f64>],
    random: &mut Random,
) -> Option<Vec<(usize, Vector2<f64>)>> {
    let (width, height) = eye.camera.size_px();
    let within =
        |p: &Vector2<f64>| (0.0..f64::from(width)).contains(&p.x) && (0.0..f64::from(height)).contains(&p.y);
    let seen = |(index, point)| {
        let (pixel, _) = mirrored_pixel(eye, foot, point).filter(|(pixel, _)| within(pixel))?;
        Some((index, pixel + Vector2::new(random.normal(), random.normal()) * NOISE_PX))
    };
    corners.iter().enumerate().map(seen).collect()
}

/// Wherever in the picture the reflected board is, and however obliquely it is seen: a fit that does not know the mirror ends where the
/// one ends that starts at it.
#[test]
fn mirrors_near_the_camera_are_found_without_a_start() {
    let mut problem = session();
    let eye = eye_of(&problem);
    let corners = corners_before_camera(&problem, &eye);
    let middle = Point3::from(corners.iter().sum::<Vector3<f64>>() / corners.len() as f64);
    let mut random = Random::new(3);
    let (mut tried, mut near, mut wrong) = (0, 0, Vec::new());
    while tried < 200 {
        let (width, height) = eye.camera.size_px();
        let pixel = Vector2::new(random.unit() * f64::from(width), random.unit() * f64::from(height));
        let Ok(ray) = eye.camera.unproject(&pixel) else { continue };
        let reflected = Point3::from(ray.into_inner() * (0.3 + 0.7 * random.unit()));
        let plane = Plane::between(&middle, &reflected).unwrap();
        let foot = plane.foot_point();
        if plane.offset_m() < 0.1 {
            continue;
        }
        let Some(seen) = shown(&eye, &foot, &corners, &mut random) else { continue };
        problem.frames[0].corners = seen;
        let (mut work, nominal) = (FrameWork::new(&problem), problem.nominal());
        let mut fit = |start| work.fit_board(&problem, &nominal, Some(&eye), 0, start);
        tried += 1;
        near += usize::from(plane.offset_m() < 0.3);
        let (found, known) = (fit(None).map(|fit| fit.foot), fit(Some(foot)).unwrap().foot);
        if !found.is_some_and(|found| (found - known).norm() < 1e-5) {
            wrong.push((foot, found, known));
        }
    }
    assert!(near > 20, "{near}");
    assert!(wrong.is_empty(), "{} of {tried}: {:?}", wrong.len(), wrong[0]);
}

/// One corner of a board that is a square's width off is left out, and its mirror is the one without it.
#[test]
fn a_false_corner_does_not_turn_the_mirror_of_its_frame() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let mut recording = world.record(&Plan::default());
    let sound = Problem::new(&robot, &recording).unwrap();
    assert_eq!(sound.false_corners, vec![]);
    let of_corner = |s: &&mut crate::diagnose::Sighting| {
        matches!(s.target, crate::diagnose::Target::Corner(5)) && s.via == crate::mirror::Via::Mirror
    };
    let corner = recording.frames[0].sightings.iter_mut().find(of_corner).unwrap();
    corner.pixel += Vector2::new(9.0, -12.0);
    let spoilt = Problem::new(&robot, &recording).unwrap();
    let told: Vec<_> = spoilt.false_corners.iter().map(|corner| (corner.frame, corner.index)).collect();
    assert_eq!(told, vec![(0, 5)]);
    assert_eq!(spoilt.frames[0].corners.len() + 1, sound.frames[0].corners.len());
    let (a, b) = (sound.boards[0].unwrap(), spoilt.boards[0].unwrap());
    let away = a.foot - b.foot;
    let deviations = (away.dot(&(b.information * away)) / spoilt.noise.corner_px.powi(2)).sqrt();
    assert!(deviations < 1.0, "{deviations}");
}

/// A plane that its board shows poorly is moved by the markers, also where they are many deviations of their own noise from where its
/// board alone has them.
#[test]
fn markers_that_are_right_correct_a_plane_that_its_board_hardly_shows() {
    let mut problem = session();
    let eye = eye_of(&problem);
    let truth = problem.boards[0].unwrap();
    let variance = problem.noise.corner_px.powi(2);
    let off = Vector3::new(0.004, -0.003, 0.005);
    let at = problem.boards[0].as_mut().unwrap();
    at.foot += off;
    // Two deviations of the board's alone.
    at.information *= 4.0 * variance / off.dot(&(at.information * off));
    let nominal = problem.nominal();
    let task = Task { gaussian: false, ..Task::of_residuals(&problem, &nominal, Some(&eye), problem.noise) };
    let mut work = FrameWork::new(&problem);
    assert!(work.evaluate(&problem, &task, 0));
    let before = off.norm();
    let after = (work.best_foot() - truth.foot).norm();
    assert!(after < 0.3 * before, "{after} of {before}");
}

/// A residual counts against what plane and noise together allow.
#[test]
fn a_marker_is_weighed_beside_a_plane_that_is_not_known() {
    let mixture = Mixture::new(0.2, 2, 640.0 * 480.0);
    let by_foot = Matrix2x3::new(5e3, 0.0, 0.0, 0.0, 5e3, 0.0);
    let covariance = Matrix3::from_diagonal(&Vector3::new(4e-6, 0.0, 0.0));
    let (along, across) = (Vector2::new(12.0, 0.0), Vector2::new(0.0, 12.0));
    let of = |known: Option<Matrix3<f64>>, r| {
        let mut pull = Pull::zero();
        pull.add(Some(&mixture), &known, &by_foot, &r);
        pull.information[(0, 0)] / 5e3_f64.powi(2)
    };
    assert!(of(None, along) < 1e-6 && of(None, across) < 1e-6);
    assert!(of(Some(covariance), along) > 0.999 && of(Some(covariance), across) < 1e-6);
}
