//! The columns in which the law of a cause may differ from the textbook's: smooth in load, direction or time; of a bending link
//! also what tells a beam from a hinge in its middle.

use crate::diagnose::effects::{Effect, LawFreedom, Place};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, Weight, transverse_load, transverse_moment};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::Prior;
use crate::diagnose::random_effects::column_law::column_law;
use crate::diagnose::random_effects::free_form::{FreeForm, On, What};
use nalgebra::Vector3;

/// Scale of a law's discrepancy, as a share of the largest error that its cause makes (one standard deviation at a
/// knot).
pub(crate) const LAW_SHARE: Prior = 0.07;

/// A bending link lies by this share of the difference between a hinge in its middle and a uniform beam off either (one standard
/// deviation).
const BEAM_SHARE: Prior = 0.5;

/// The columns in which a law may differ from the textbook's, at a cause's place.
pub(crate) fn law_columns(scene: &Scene, place: Place, freedom: LawFreedom) -> Vec<Column> {
    let kinds: &[(What, On)] = match freedom {
        LawFreedom::Exact | LawFreedom::Extension => &[],
        LawFreedom::Load => &[(What::Joint, On::Load)],
        LawFreedom::LoadAndDirection => &[(What::Joint, On::Load), (What::Joint, On::Direction)],
        LawFreedom::Moment => &[(What::LinkTurn, On::Load)],
        LawFreedom::Time => &[(What::Joint, On::Time)],
    };
    let mut columns: Vec<Column> = kinds
        .iter()
        .flat_map(|&(what, on)| FreeForm::new(what, on, scene).columns(scene, place, 0.0, &[]))
        .collect();
    if let (LawFreedom::Moment, Place::Link(Some(n))) = (freedom, place) {
        columns.extend(beyond_linear(scene, n));
        columns.extend(as_a_beam(scene, n));
    }
    if let (LawFreedom::Extension, Place::Link(Some(n))) = (freedom, place) {
        columns.extend(column_law(scene, n));
    }
    columns
}

/// Deviations of a bending link from the linear law: about each axis the moment's cube (springs stiffen), and the
/// product of the moments about the other two (two successive turns produce a third).
fn beyond_linear(scene: &Scene, n: NodeId) -> Vec<Column> {
    let largest = (0..scene.frames).map(|f| scene.moment(f, n).norm()).fold(1e-12, f64::max);
    let weight = |of: &dyn Fn(&Vector3<f64>) -> f64| {
        Weight::Frames((0..scene.frames).map(|f| of(&(scene.moment(f, n) / largest))).collect())
    };
    (0..3)
        .flat_map(|k| {
            let atom = Atom::Turn(n, k);
            [
                Column { atom, weight: weight(&|m| m[k] * m.norm_squared()) },
                Column { atom, weight: weight(&|m| m[(k + 1) % 3] * m[(k + 2) % 3]) },
            ]
        })
        .collect()
}

/// What tells a beam from a hinge in the link's middle: how much its own mass turns the end, and how far the end sags beyond that turn.
fn as_a_beam(scene: &Scene, n: NodeId) -> Vec<Column> {
    let frames = 0..scene.frames;
    let of_both = |f: usize| [scene.moment(f, n).norm(), scene.beam(f, n).moment.norm()];
    let share = BEAM_SHARE / LAW_SHARE / frames.clone().flat_map(of_both).fold(1e-12, f64::max);
    let turn = |f: usize| transverse_load(scene, f, n).moment - transverse_moment(scene, f, n);
    let sag = |f: usize| transverse_load(scene, f, n).sag;
    let column = |atom: Atom, k: usize, of: &dyn Fn(usize) -> Vector3<f64>| {
        let weights: Vec<f64> = frames.clone().map(|f| of(f)[k] * share).collect();
        let acts = weights.iter().any(|w| w.abs() > NEGLIGIBLE);
        acts.then_some(Column { atom, weight: Weight::Frames(weights) })
    };
    (0..3)
        .flat_map(|k| [column(Atom::Turn(n, k), k, &turn), column(Atom::Sag(n, k), k, &sag)])
        .flatten()
        .collect()
}
