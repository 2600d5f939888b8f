//! Play in tilt of the guide of a prismatic link: the link leans to the side to which gravity's moment presses it,
//! `ω_k = ± (w + g h(e))/2` about one direction k across the joint (those of `axis_tilt`), with h(e) as in
//! `column_bending`.
//!
//! The side changes where the moment overcomes what else presses the guide (preload, masses that the model lacks).
//! The moment at which it does, N m, is the discrete unknown. Friction in the guide cannot be separated from it.

use super::about::{About, PlaceKind, WrittenTo};
use super::telescopes::{columns_last, moment_across, slackening_m};
use super::{Effect, Place, named};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::{Grid, Prior};

/// Where the side is tried to change, as shares of the frames whose moment is below.
const LEVELS: [f64; 9] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];
/// Once it is found, so many steps of so large a share of the frames are tried to either side.
const TRIED: i64 = 6;
const FINER: Grid = 0.015;
/// A common play of a guide, rad.
const TYPICAL_RAD: Prior = 0.003;

/// See the module.
pub(crate) struct TiltPlay {
    /// About which of the two directions across the joint: 0 or 1.
    pub direction: usize,
}

impl TiltPlay {
    fn sorted_moments(&self, scene: &Scene, n: NodeId) -> Vec<f64> {
        let mut moments: Vec<f64> = moment_across(scene, n, self.direction).collect();
        moments.sort_by(f64::total_cmp);
        moments
    }
}

/// The middle between the i-th of some sorted numbers and the one before.
fn between(sorted: &[f64], i: usize) -> f64 {
    let at = i.clamp(1, sorted.len().max(2) - 1);
    match (sorted.get(at - 1), sorted.get(at)) {
        (Some(a), Some(b)) => 0.5 * (a + b),
        _ => 0.0,
    }
}

impl Effect for TiltPlay {
    fn name(&self) -> &str {
        ["tilt_play_1", "tilt_play_2"][self.direction]
    }

    fn parameters(&self) -> Vec<String> {
        named(&["width_rad", "growth_rad_per_m"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        columns_last(scene).map(|n| Place::Link(Some(n))).collect()
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let Some(n) = place.node() else { return Vec::new() };
        let out = slackening_m(scene, n).into_iter().fold(NEGLIGIBLE, f64::max);
        vec![TYPICAL_RAD, TYPICAL_RAD / out]
    }

    /// Moments at which the side may change, N m.
    fn variants(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let Some(n) = place.node() else { return Vec::new() };
        let moments = self.sorted_moments(scene, n);
        LEVELS.map(|share| between(&moments, (share * moments.len() as f64) as usize)).into()
    }

    /// Moments among those of a level's share of the frames to either side.
    fn variants_near(&self, scene: &Scene, place: Place, variant: f64) -> Vec<f64> {
        let Some(n) = place.node() else { return Vec::new() };
        let moments = self.sorted_moments(scene, n);
        let here = moments.partition_point(|m| *m <= variant);
        let step = (FINER * moments.len() as f64).max(1.0);
        (-TRIED..=TRIED)
            .filter(|k| *k != 0)
            .map(|k| here as f64 + k as f64 * step)
            .filter(|i| *i >= 1.0 && *i < moments.len() as f64)
            .map(|i| between(&moments, i as usize))
            .collect()
    }

    fn columns(&self, scene: &Scene, place: Place, variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        let sides: Vec<f64> =
            moment_across(scene, n, self.direction).map(|m| if m > variant { 0.5 } else { -0.5 }).collect();
        let grown = sides.iter().zip(slackening_m(scene, n)).map(|(s, h)| s * h).collect();
        [sides, grown]
            .map(|weights| Column { atom: Atom::Across(n, self.direction), weight: Weight::Frames(weights) })
            .into()
    }

    fn is_of_columns(&self) -> bool {
        true
    }

    fn is_positive(&self) -> bool {
        true
    }

    fn depends_on_load(&self) -> bool {
        true
    }

    fn is_spring(&self) -> bool {
        false
    }

    fn words(&self) -> &str {
        "the guide has play: the sliding part leans to the side to which its load presses it"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Link,
            law: "ω = ± (w + g h(e))/2 across the joint, on the side of the moment: e the extension, h = e/(1 − e/D)",
            remedy: "preload or shim the guide",
            written_to: WrittenTo::Nothing,
            joint_law: &[],
            signature: "a step where the moment changes its side, the higher the further the column is out",
            shown_by: "loads to both sides of the column at several extensions",
            confused_with: "`column_bending` where the moment keeps its side",
        })
    }
}
