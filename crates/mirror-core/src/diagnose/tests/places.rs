//! Every effect at every place that it names: of its kind, and with as many priors and columns as parameters.

use super::column_world;
use super::gap_world::{Plan, World};
use crate::diagnose::effects::about::PlaceKind;
use crate::diagnose::effects::{Place, vocabulary};
use crate::diagnose::model::problem::Problem;
use crate::robot::Robot;

fn kind(place: Place) -> PlaceKind {
    match place {
        Place::Joint(_) => PlaceKind::Joint,
        Place::JointPair(..) => PlaceKind::JointPair,
        Place::Link(_) => PlaceKind::Link,
        Place::Marker(_) => PlaceKind::Marker,
        Place::Camera => PlaceKind::Camera,
        Place::Board => PlaceKind::Board,
        Place::Mirror => PlaceKind::Mirror,
    }
}

#[test]
fn places_are_of_the_kind_that_the_effect_tells_and_have_all_its_parameters() {
    let world = World::new(4, false);
    let robot = Robot::from_urdf_str(&world.urdf()).unwrap();
    let problem = Problem::new(&robot, &world.record(&Plan { postures: 6, ..Plan::default() })).unwrap();
    let scenes = [&problem.scene, &column_world::problem().scene];
    for effect in vocabulary() {
        let count = effect.parameters().len();
        let mut somewhere = false;
        for scene in scenes {
            for place in effect.places(scene) {
                somewhere = true;
                let at = format!("{} at {}", effect.name(), place.name(scene));
                assert_eq!(effect.about().map(|a| a.at), Some(kind(place)), "{at}");
                assert_eq!(effect.prior_std(scene, place).len(), count, "{at}");
                for variant in effect.variants(scene, place) {
                    let columns = effect.columns(scene, place, variant, &vec![0.0; count]);
                    assert_eq!(columns.len(), count, "{at}");
                }
            }
        }
        assert!(somewhere, "{} has no place", effect.name());
    }
}
