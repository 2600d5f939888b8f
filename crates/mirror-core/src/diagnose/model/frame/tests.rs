//! A frame's markers in the mirror.

#![allow(clippy::unwrap_used)]

mod plane;

use super::marker_sights::Markers;
use super::mirror_and_lens::MirrorAndLens;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::tests::gap_world::{Plan, World};
use crate::robot::Robot;
use nalgebra::Vector3;

/// Where the plane moves little the outlines' offsets are kept, and are those of the plane to a part of a thousandth of a
/// pixel; where it moves farther they are computed again.
#[test]
fn offsets_of_outlines_are_kept_where_the_plane_hardly_moves() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let problem = Problem::new(&robot, &world.record(&Plan::default())).unwrap();
    let eye = problem.eye(&problem.nominal()).unwrap().unwrap();
    let foot = problem.boards[0].unwrap().foot;
    let point = foot * 0.2 + Vector3::new(0.05, -0.04, 0.0);
    let markers = |feet: &[Vector3<f64>]| {
        let mut markers = Markers::default();
        markers.clear();
        markers.push(point, point, 0.01);
        markers.fill_up();
        for foot in feet {
            markers.see(&MirrorAndLens::of(&eye, foot).unwrap(), *foot);
        }
        (markers.by_foot(0).unwrap().0, markers.offset(0))
    };
    let (near, far) = (foot * 1.005, foot * 1.02);
    let (kept, exact) = (markers(&[foot, near]), markers(&[near]));
    assert_eq!(kept.0, exact.0);
    assert!(kept.1 != exact.1 && exact.1.norm() > 1e-3, "{kept:?} {exact:?}");
    assert!((kept.1 - exact.1).norm() < 0.02 * exact.1.norm(), "{kept:?} {exact:?}");
    assert_eq!(markers(&[foot, far]), markers(&[far]));
}
