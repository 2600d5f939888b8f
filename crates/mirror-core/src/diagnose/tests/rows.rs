//! Rows that hold the measurement of other rows are so beside the causes found too.

use super::gap_world::{Plan, World, Wrong};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::prepare::row_slip::{Slip, find, is_slipped, with_overwritten_rows};
use crate::diagnose::selection::search::Search;
use crate::robot::Robot;
use std::sync::Arc;

#[test]
fn rows_are_slipped_where_other_rows_fit_them_beside_the_causes_and_in_order_where_their_own_do() {
    const SHIFT: usize = 4;
    const NOISE: Noise = super::prior::NOISE;
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let wrong = vec![Wrong::BoardScale(0.4)];
    let mut recording = world.record(&Plan { postures: 30, noise_px: 0.15, wrong, ..Plan::default() });
    let run = |first: usize, last: usize| Slip { first, last, shift: SHIFT as i64, gain: 0.0 };
    let (moved, in_order) = (run(30, 41), run(10, 21));
    let seen: Vec<_> = recording.frames.iter().map(|f| f.sightings.clone()).collect();
    for f in moved.first..=moved.last {
        recording.frames[f].sightings.clone_from(&seen[f + SHIFT]);
    }
    let problem = Problem::new(&robot, &recording).unwrap();
    let catalogue = Catalogue::new(&problem.scene, vocabulary().into_iter().map(Arc::from).collect(), &[]);
    let search: Search = super::prior::search(&problem, &catalogue);
    let named = |h: &usize| catalogue.name(&problem.scene, *h) == "board_scale@board";
    let scale = (0..catalogue.hypotheses.len()).find(named).unwrap();
    let mut model = Model::nominal(&problem).with(&catalogue, scale, 0.0);
    model.terms[0].parameters = vec![0.4];
    let fit = search.fit(&model, search.effective(&model).unwrap(), 6).unwrap();
    let found = |p: &Problem| fit.model.deformation(p, &catalogue, &[]);
    assert!(is_slipped(&problem, found, NOISE, &moved).unwrap());
    assert!(!is_slipped(&problem, found, NOISE, &in_order).unwrap());
}

#[test]
fn a_frame_that_is_commanded_as_another_bears_its_loads_and_comes_from_its_side() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let problem = Problem::new(&robot, &world.record(&Plan { postures: 9, ..Plan::default() })).unwrap();
    let (scene, frame, from) = (&problem.scene, 6, 3);
    let mut moved = scene.clone();
    moved.command_as(frame, scene, from);
    let mut differ = 0;
    for n in 0..scene.nodes() {
        let of = |scene: &Scene, f: usize| {
            (scene.q(f, n), scene.direction(f, n), scene.torque(f, n), *scene.moment(f, n))
        };
        assert_eq!(of(&moved, frame), of(scene, from));
        assert_eq!(of(&moved, from), of(scene, from));
        differ += usize::from(scene.direction(frame, n) != scene.direction(from, n));
    }
    assert!(differ > 0);
    assert_eq!(moved.base_moment[frame], scene.base_moment[from]);
    assert_eq!(moved.down_in_mount(frame, 1), scene.down_in_mount(from, 1));
    assert_eq!(moved.time_s, scene.time_s);
}

#[test]
fn rows_whose_positions_a_run_has_overwritten_count_as_slipped() {
    let world = World::new(4, true);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let plan = Plan { postures: 40, views: 1, noise_px: 0.15, ..Plan::default() };
    let noise = super::prior::NOISE;
    let run = |overwrite: &dyn Fn(usize) -> usize| {
        let mut recording = world.record(&plan);
        let rows: Vec<_> = recording.frames.iter().map(|f| f.commanded.clone()).collect();
        for f in 12..=25 {
            recording.frames[f].commanded.clone_from(&rows[overwrite(f)]);
        }
        let problem = Problem::new(&robot, &recording).unwrap();
        let found = find(&problem, Noise { marker_px: 20.0, ..noise }).unwrap().unwrap();
        (found, with_overwritten_rows(&problem, found).unwrap())
    };
    let (found, whole) = run(&|f| f + 3);
    assert_eq!((found.shift, whole.first, whole.last), (-3, 12, found.last));
    assert!(found.first > 12);
    let (found, whole) = run(&|f| f - 3);
    assert_eq!((found.shift, whole.first, whole.last), (3, found.first, 25));
    assert!(found.last < 25);
}
