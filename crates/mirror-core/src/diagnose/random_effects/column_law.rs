//! The discrepancy of `column_bending`: the moment times any smooth function of the column's extension.

use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::Size;

/// Knots of the function, from the least extension to the most.
const KNOTS: Size = 3;

/// About each direction k across the column: `m_k/m_max` times a hat function at each knot.
pub(crate) fn column_law(scene: &Scene, n: NodeId) -> Vec<Column> {
    let Some(out) = scene.extensions_m(n) else { return Vec::new() };
    let (least, most) =
        out.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), e| (a.min(*e), b.max(*e)));
    let step = ((most - least) / (KNOTS - 1) as f64).max(NEGLIGIBLE);
    let largest = (0..scene.frames).map(|f| scene.moment(f, n).norm()).fold(NEGLIGIBLE, f64::max);
    (0..2)
        .flat_map(|k| {
            let direction = scene.body.nodes[n].tilt_directions[k];
            let weight = |of: &dyn Fn(f64) -> f64| {
                let share = |f: usize| direction.dot(scene.moment(f, n)) / largest * of(out[f]);
                Weight::Frames((0..scene.frames).map(share).collect())
            };
            let knot = |j: usize| {
                let at = least + j as f64 * step;
                Column {
                    atom: Atom::Across(n, k),
                    weight: weight(&|e: f64| (1.0 - ((e - at) / step).abs()).max(0.0)),
                }
            };
            (0..KNOTS).map(knot).collect::<Vec<Column>>()
        })
        .collect()
}
