//! Bending of a column of prismatic links, proportional to gravity's moment at its upper end and growing with its
//! extension: `ω_k = (c_k + g_k h(e)) m_k` about each of the two directions k across it (those of `axis_tilt`), in
//! the middle of the extended part.
//!
//! e is the column's extension. A beam of constant section bends in proportion to its length: `h = e`. Telescopic
//! tubes yield where they overlap, and the overlap D − e shrinks: `h = e/(1 − e/D)`. Each direction has its own
//! stiffness, because sections are hardly ever square.

use super::about::{About, PlaceKind, WrittenTo};
use super::telescopes::{columns_last, largest_moment, moment_across, slackening_m};
use super::{Effect, LawFreedom, Place, named};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::Prior;

/// A common size of a column's slope at its end under the largest moment, rad.
const TYPICAL_RAD: Prior = 0.01;

/// See the module.
pub(crate) struct ColumnBending;

impl Effect for ColumnBending {
    fn name(&self) -> &str {
        "column_bending"
    }

    fn parameters(&self) -> Vec<String> {
        named(&[
            "compliance_1_rad_per_nm",
            "compliance_2_rad_per_nm",
            "growth_1_rad_per_nm_m",
            "growth_2_rad_per_nm_m",
        ])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        columns_last(scene).map(|n| Place::Link(Some(n))).collect()
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let Some(n) = place.node() else { return Vec::new() };
        let largest = largest_moment(scene, n);
        let out = slackening_m(scene, n).into_iter().fold(NEGLIGIBLE, f64::max);
        let (fixed, grown) = (TYPICAL_RAD / largest, TYPICAL_RAD / (largest * out));
        vec![fixed, fixed, grown, grown]
    }

    fn columns(&self, scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        let share = slackening_m(scene, n);
        let column = |k: usize, out: bool| {
            let moments = moment_across(scene, n, k);
            let weights =
                if out { moments.zip(&share).map(|(m, u)| m * u).collect() } else { moments.collect() };
            Column { atom: Atom::Across(n, k), weight: Weight::Frames(weights) }
        };
        vec![column(0, false), column(1, false), column(0, true), column(1, true)]
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

    fn law_freedom(&self) -> LawFreedom {
        LawFreedom::Extension
    }

    fn words(&self) -> &str {
        "the column bends under the load of gravity, and more the further it is extended"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Link,
            law: "ω_k = (c_k + g_k h(e)) m_k: e the extension, h = e/(1 − e/D), m_k the moment about direction k",
            remedy: "stiffen the column's guides, or model it as flexible",
            written_to: WrittenTo::Nothing,
            joint_law: &[],
            signature: "a line against the moment, across the column, steeper the further it is out",
            shown_by: "the same loads at several extensions",
            confused_with: "`link_bending` of the same link over a short range of extension",
        })
    }
}
