//! Many small errors everywhere: manufacturing tolerance, fitted as a group with a common spread.
//!
//! Every relevant joint's zero and axis and every link's shape may be a little off: `θ_k ~ N(0, s²)`, one s for angles, one
//! for the links' lengths and one for the markers' places. The spreads are found by maximising the marginal likelihood (empirical Bayes, by expectation and
//! maximisation), so that the group takes what is spread over the robot and leaves what is concentrated to a single cause.
//!
//! Source: MacKay, "Bayesian interpolation" (1992), the evidence framework.

use crate::diagnose::data::diagnosis::Member;
use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Group, fit};
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::scene::Scene;
use crate::error::Result;

/// Where the spreads start: 1 mm and 0.3°.
const START_SPREAD_M: f64 = 1e-3;
const START_SPREAD_RAD: f64 = 5e-3;
/// Below these a spread is nothing.
const LEAST_SPREAD_M: f64 = 2e-6;
const LEAST_SPREAD_RAD: f64 = 5e-6;
const SPREAD_STEPS: usize = 10;

/// The group and its spreads.
#[derive(Debug, Clone, Default)]
pub(crate) struct Geometry {
    pub group: Group,
    pub spread_m: f64,
    pub spread_rad: f64,
    /// Of the markers' places on their links.
    pub mount_spread_m: f64,
}

/// Angles, lengths of links, places of markers: each kind has its own spread. A marker is mounted by other hands, and by
/// another tolerance, than the links are made.
pub(crate) const KINDS: usize = 3;

/// Which kind an elementary small error is of, below [`KINDS`].
pub(crate) fn kind(atom: Atom) -> usize {
    match atom {
        Atom::LinkShift(..) | Atom::OriginShift(..) => 1,
        Atom::MarkerShift(..) => 2,
        _ => 0,
    }
}

/// An elementary small error in the words of a single effect: its name, place and parameter.
pub(crate) fn single_effect(atom: Atom) -> Option<(&'static str, Place, &'static str)> {
    let of_axis = |k: usize| ["dx_m", "dy_m", "dz_m"][k];
    Some(match atom {
        Atom::Joint(n) => ("joint_offset", Place::Joint(n), "offset_rad"),
        Atom::Tilt(n, 0) => ("axis_tilt", Place::Joint(n), "tilt_1_rad"),
        Atom::Tilt(n, _) => ("axis_tilt", Place::Joint(n), "tilt_2_rad"),
        Atom::LinkShift(n, axis) => ("link_length", Place::Link(n), of_axis(axis)),
        Atom::OriginShift(n, axis) => ("joint_origin", Place::Joint(n), of_axis(axis)),
        Atom::MarkerShift(m, axis) => ("marker_mount", Place::Marker(m), of_axis(axis)),
        _ => return None,
    })
}

impl Geometry {
    /// All columns of the group with spreads to start from.
    pub fn new(problem: &Problem) -> Self {
        let scene = &problem.scene;
        let mut columns = Vec::new();
        for n in (0..scene.nodes()).filter(|&n| scene.relevant[n]) {
            columns.push(Column::constant(Atom::Joint(n)));
            if scene.moves(n) {
                columns.extend((0..2).map(|k| Column::constant(Atom::Tilt(n, k))));
            }
            let parent = scene.body.nodes[n].parent;
            // Of several joints on one link each has its own place there.
            let only_child = (0..scene.nodes())
                .filter(|&k| scene.relevant[k] && scene.body.nodes[k].parent == parent)
                .count()
                == 1;
            let shift = |k| if only_child { Atom::LinkShift(parent, k) } else { Atom::OriginShift(n, k) };
            columns.extend((0..3).map(|k| Column::constant(shift(k))));
        }
        for m in (0..scene.marker_names.len()).filter(|&m| scene.mount_known[m]) {
            columns.extend((0..3).map(|k| Column::constant(Atom::MarkerShift(m, k))));
        }
        let mut out = Self {
            group: Group { columns, prior_std: Vec::new() },
            spread_m: START_SPREAD_M,
            spread_rad: START_SPREAD_RAD,
            mount_spread_m: START_SPREAD_M,
        };
        out.set_priors();
        out
    }

    fn set_priors(&mut self) {
        let spreads = [self.spread_rad, self.spread_m, self.mount_spread_m];
        self.group.prior_std = self.group.columns.iter().map(|c| spreads[kind(c.atom)]).collect();
    }

    /// Standard deviations of the spreads of angles and of links' lengths. A spread found from n values is known to one part
    /// in √(2 n); a value of which the data tell only a share counts by that share's square.
    pub fn spread_stds(&self, fit: &Fit) -> [f64; 2] {
        let first = fit.model.nuisances.len();
        let mut told = [0.0; KINDS];
        for (k, (column, prior)) in self.group.columns.iter().zip(&self.group.prior_std).enumerate() {
            let share = 1.0 - (fit.covariance[(first + k, first + k)] / (prior * prior)).clamp(0.0, 1.0);
            told[kind(column.atom)] += share * share;
        }
        let std = |spread: f64, told: f64| spread * (2.0 * told).max(1.0).sqrt().recip();
        [std(self.spread_rad, told[0]), std(self.spread_m, told[1])]
    }

    /// Each small error of a fit, in the words of single effects, with its standard deviation.
    pub fn members(&self, fit: &Fit, scene: &Scene) -> Vec<Member> {
        let first = fit.model.nuisances.len();
        let told = self.group.columns.iter().zip(&fit.model.group).enumerate();
        told.filter_map(|(k, (column, value))| {
            let (effect, place, parameter) = single_effect(column.atom)?;
            Some(Member {
                effect: effect.into(),
                at: place.name(scene),
                parameter: parameter.into(),
                value: *value,
                std: fit.covariance[(first + k, first + k)].max(0.0).sqrt(),
            })
        })
        .collect()
    }

    /// Fits a model with the group, and the spreads, in turn.
    ///
    /// # Errors
    /// A camera or mirror that cannot be.
    pub fn fit(
        &mut self,
        problem: &Problem,
        catalogue: &Catalogue,
        start: &Model,
        options: FitOptions,
        mask: Option<&[bool]>,
    ) -> Result<Fit> {
        let mut model = start.clone();
        model.group.resize(self.group.columns.len(), 0.0);
        let mut best = fit(problem, catalogue, &self.group, &model, options, mask)?;
        for _ in 0..SPREAD_STEPS {
            let first = best.model.nuisances.len();
            let (mut sum, mut count) = ([0.0; KINDS], [0.0; KINDS]);
            for (k, column) in self.group.columns.iter().enumerate() {
                let kind = kind(column.atom);
                let variance = best.covariance[(first + k, first + k)];
                sum[kind] += best.model.group[k].powi(2) + variance;
                count[kind] += 1.0;
            }
            let (old_rad, old_m) = (self.spread_rad, self.spread_m);
            let spread = |kind: usize| (sum[kind] / f64::max(count[kind], 1.0)).sqrt();
            self.spread_rad = spread(0).max(LEAST_SPREAD_RAD);
            self.spread_m = spread(1).max(LEAST_SPREAD_M);
            self.mount_spread_m = spread(2).max(LEAST_SPREAD_M);
            self.set_priors();
            best =
                fit(problem, catalogue, &self.group, &best.model, FitOptions { steps: 3, ..options }, mask)?;
            let change = (self.spread_rad / old_rad).ln().abs() + (self.spread_m / old_m).ln().abs();
            if change < 0.05 {
                break;
            }
        }
        Ok(best)
    }
}
