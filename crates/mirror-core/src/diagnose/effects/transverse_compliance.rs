//! Compliance across a prismatic joint's axis, of its guide or of what carries it: `ω_k = c_k m_k` about each of the
//! two directions k across the joint, at the joint's origin. m_k is gravity's moment on the link and all that it
//! carries.

use super::about::{About, PlaceKind, WrittenTo};
use super::telescopes::{columns_first, largest_moment, moment_across};
use super::{Effect, Place, named};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::Prior;

/// A common size of a guide's turn under the largest moment, rad.
const TYPICAL_RAD: Prior = 0.005;

/// See the module.
pub(crate) struct TransverseCompliance;

impl Effect for TransverseCompliance {
    fn name(&self) -> &str {
        "transverse_compliance"
    }

    fn parameters(&self) -> Vec<String> {
        named(&["compliance_1_rad_per_nm", "compliance_2_rad_per_nm"])
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        columns_first(scene).map(|n| Place::Link(Some(n))).collect()
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let Some(n) = place.node() else { return Vec::new() };
        vec![TYPICAL_RAD / largest_moment(scene, n); 2]
    }

    fn columns(&self, scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let Some(n) = place.node() else { return Vec::new() };
        let column = |k| Column {
            atom: Atom::Rock(n, k),
            weight: Weight::Frames(moment_across(scene, n, k).collect()),
        };
        vec![column(0), column(1)]
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

    fn words(&self) -> &str {
        "the link's guide, or its support, yields across its axis under the load of gravity"
    }

    fn about(&self) -> Option<About> {
        Some(About {
            at: PlaceKind::Link,
            law: "ω_k = c_k m_k about each of the two directions k across the joint, at its origin",
            remedy: "stiffen the guide, or the ground on which the robot stands",
            written_to: WrittenTo::Nothing,
            joint_law: &[],
            signature: "a line against the moment across the joint, at every extension the same",
            shown_by: "loads to all sides at several extensions",
            confused_with: "`column_bending` over a short range of extension",
        })
    }
}
