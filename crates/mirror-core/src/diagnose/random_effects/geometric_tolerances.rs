//! Small errors everywhere: manufacturing tolerances and mounts by hand, fitted as one group of random effects with
//! a common scale for each kind.
//!
//! Every relevant joint's zero and axis and every link's shape may be slightly off, every loaded joint yields
//! slightly, and board, camera and markers may be displaced: `θ_k ~ N(0, s²)`, one s for each [`Kind`]. For springs,
//! s is the deflection of the joint with the highest load relative to its rated torque; stiffness is proportional to
//! the rated torque, and a compliance is never negative. The scales are estimated by maximising the marginal
//! likelihood (empirical Bayes). So the group explains what is spread over the robot, and leaves what is
//! concentrated at one place to a single cause.
//!
//! Source: MacKay, "Bayesian interpolation" (1992), the evidence framework.

use crate::diagnose::data::diagnosis::Member;
use crate::diagnose::data::recording::Tolerances;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::{Place, joint_error};
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Group, fit};
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Guard;
use crate::diagnose::random_effects::small_errors::{
    KINDS, Kind, markers, mounts, single_effect, softness, spring_of, springs, stated, transmission_errors,
};
use crate::error::Result;

/// Values and variances of the group's parameters.
type Values = (Vec<f64>, Vec<f64>);

/// The scale of each kind of small errors, in its own unit.
pub(crate) type Spreads = [f64; KINDS];

/// The group and its spreads.
#[derive(Debug, Clone)]
pub(crate) struct Geometry {
    pub group: Group,
    spreads: Spreads,
    /// The tolerances that the session states, column by column.
    stated: Vec<Option<f64>>,
    /// What a spread of 1 is in each column's own unit.
    units: Vec<f64>,
    /// Whether it contains only the mounts and the joints' zeros, not the links.
    pub setup_only: bool,
    /// Whether board and camera are in it, so that the mounts are reported separately and not as errors of the
    /// robot.
    pub mounted: bool,
}

impl Geometry {
    /// All columns of the group with start values of the scales; with those of board and camera where displaced
    /// mounts were found, and with springs where the catalogue has them.
    pub fn new(problem: &Problem, catalogue: &Catalogue, with_setup: bool) -> Self {
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
        columns.extend(markers(scene));
        if with_setup {
            columns.extend(mounts(scene));
        }
        columns.extend(springs(scene, catalogue));
        Self::of(columns, problem, false)
    }

    /// The mounts by hand and the joints' zeros; `without` are effects that are switched off. Empty where there are
    /// no mounts.
    pub fn of_setup(problem: &Problem, without: &[String]) -> Self {
        let scene = &problem.scene;
        let on = |name: &str| !without.iter().any(|w| w == name);
        let mut columns: Vec<Column> = mounts(scene).chain(markers(scene)).collect();
        columns.retain(|c| single_effect(c).is_some_and(|(effect, ..)| on(effect)));
        if !columns.is_empty() && on("geometry") {
            let zeros = (0..scene.nodes()).filter(|&n| scene.relevant[n]);
            columns.extend(zeros.map(|n| Column::constant(Atom::Joint(n))));
        }
        Self::of(columns, problem, true)
    }

    /// The markers whose mount has a stated tolerance, if `told` has an effect for them. Empty where nothing is
    /// stated.
    pub fn of_stated_markers(problem: &Problem, told: impl Fn(&'static str, Place) -> bool) -> Self {
        let mut columns: Vec<Column> = markers(&problem.scene).collect();
        columns.retain(|c| {
            stated(&problem.tolerances, c.atom).is_some()
                && single_effect(c).is_some_and(|(effect, place, _)| told(effect, place))
        });
        Self::of(columns, problem, true)
    }

    /// With every joint's transmission error at the positions that it visits.
    pub fn with_transmission_errors(&self, scene: &Scene) -> Self {
        let mut wider = self.clone();
        let columns: Vec<Column> = transmission_errors(scene).collect();
        let count = columns.len();
        wider.group.columns.extend(columns);
        wider.group.positive.resize(wider.group.columns.len(), false);
        wider.stated.extend(core::iter::repeat_n(None, count));
        wider.units.extend(core::iter::repeat_n(1.0, count));
        wider.set_priors();
        wider
    }

    /// No group at all.
    pub fn empty() -> Self {
        Self::with_units(Vec::new(), &Tolerances::default(), Vec::new(), true)
    }

    /// With the columns of another group, whose scales are given, at its end.
    pub fn beside(mut self, other: &Group) -> Self {
        self.group.columns.extend(other.columns.iter().cloned());
        self.stated.extend(other.prior_std.iter().map(|std| Some(*std)));
        self.units.resize(self.group.columns.len(), 1.0);
        self.set_priors();
        self
    }

    /// The displacements of the group's mounts, each once, as its effect.
    pub fn mounts(&self) -> impl Iterator<Item = (&'static str, Place)> + '_ {
        let mut last = None;
        let of_setup = self.group.columns.iter().filter(|c| Kind::of(c).is_of_setup());
        of_setup.filter_map(single_effect).filter_map(move |(effect, place, _)| {
            let new = last != Some((effect, place));
            last = Some((effect, place));
            new.then_some((effect, place))
        })
    }

    fn of(mut columns: Vec<Column>, problem: &Problem, setup_only: bool) -> Self {
        let (scene, tolerances) = (&problem.scene, &problem.tolerances);
        // What is exact is no random effect.
        columns.retain(|c| stated(tolerances, c.atom) != Some(0.0));
        let softness = softness(scene, columns.iter().filter_map(spring_of));
        let unit = |c: &Column| match (Kind::of(c), c.atom) {
            (Kind::Spring, Atom::Joint(n)) => softness[&n],
            // Of a joint that slides, rad at the robot's reach.
            (Kind::Angle, Atom::Joint(n)) => joint_error(scene, n, 1.0),
            _ => 1.0,
        };
        let units = columns.iter().map(unit).collect();
        Self::with_units(columns, tolerances, units, setup_only)
    }

    fn with_units(columns: Vec<Column>, tolerances: &Tolerances, units: Vec<f64>, setup_only: bool) -> Self {
        let mounted = setup_only
            || columns.iter().any(|c| matches!(c.atom, Atom::BoardMount(_) | Atom::CameraMount(_)));
        let mut out = Self {
            stated: columns.iter().map(|c| stated(tolerances, c.atom)).collect(),
            units,
            // A joint deflects in the direction of gravity's torque.
            group: Group {
                positive: columns.iter().map(|c| Kind::of(c) == Kind::Spring).collect(),
                columns,
                prior_std: Vec::new(),
            },
            spreads: Kind::ALL.map(|kind| kind.habit(setup_only).common),
            setup_only,
            mounted,
        };
        out.set_priors();
        out
    }

    fn set_priors(&mut self) {
        let spreads =
            self.group.columns.iter().zip(&self.units).map(|(c, unit)| self.spread(Kind::of(c)) * unit);
        self.group.prior_std =
            spreads.zip(&self.stated).map(|(spread, stated)| stated.unwrap_or(spread)).collect();
    }

    /// The spread of a kind, rad or m.
    pub fn spread(&self, kind: Kind) -> f64 {
        self.spreads[kind as usize]
    }

    /// A value of the k-th column in the unit of its kind's scale.
    fn of_its_kind(&self, k: usize, value: f64) -> f64 {
        value / self.units[k]
    }

    /// The scale of zeros for which the data determine `told` values, with this sum of squares.
    pub fn usual_zero(&self, sum: f64, told: f64) -> f64 {
        let habit = Kind::Angle.habit(self.setup_only);
        let spread = ((sum + habit.worth * habit.common.powi(2)) / (told + habit.worth).max(1e-9)).sqrt();
        spread.clamp(habit.least, habit.most)
    }

    /// Whether links, axes, springs or markers would have to be off by more than small errors are.
    pub fn is_at_its_bound(&self) -> bool {
        let largest = |kind: Kind| self.spread(kind) >= kind.habit(self.setup_only).most;
        [Kind::Angle, Kind::Length, Kind::Spring, Kind::Marker].into_iter().any(largest)
    }

    /// Whether there are errors of a kind in it.
    pub fn has(&self, kind: Kind) -> bool {
        self.group.columns.iter().any(|c| Kind::of(c) == kind)
    }

    /// The scales that were learned last.
    pub fn spreads(&self) -> Spreads {
        self.spreads
    }

    /// Sets the scales, and with them the priors of columns whose tolerance is not stated.
    pub fn set_spreads(&mut self, spreads: &Spreads) {
        self.spreads = *spreads;
        self.set_priors();
    }

    /// By how much the spreads differ from another group's, log.
    pub fn change_from(&self, other: &Self) -> f64 {
        let told = |kind: Kind| self.group.columns.iter().any(|c| Kind::of(c) == kind);
        Kind::ALL
            .into_iter()
            .filter(|&kind| told(kind))
            .map(|kind| (self.spread(kind) / other.spread(kind)).ln().abs())
            .sum()
    }

    /// The effective number of values of each kind: each counts by the square of the share by which the data narrow it.
    fn values_told(&self, fit: &Fit) -> [f64; KINDS] {
        let first = fit.model.nuisances.len();
        let mut told = [0.0; KINDS];
        for (k, (column, prior)) in self.group.columns.iter().zip(&self.group.prior_std).enumerate() {
            let share = 1.0 - (fit.covariance[(first + k, first + k)] / (prior * prior)).clamp(0.0, 1.0);
            told[Kind::of(column) as usize] += share * share;
        }
        told
    }

    /// Standard deviations of the scales of angles and of links' lengths. A scale estimated from n values is known
    /// to one part in √(2 n).
    pub fn spread_stds(&self, fit: &Fit) -> [f64; 2] {
        let told = self.values_told(fit);
        let std = |kind: Kind| self.spread(kind) * (2.0 * told[kind as usize]).max(1.0).sqrt().recip();
        [std(Kind::Angle), std(Kind::Length)]
    }

    /// The effective number of values of the better known of the scales of angles and lengths.
    pub fn told(&self, fit: &Fit) -> f64 {
        let told = self.values_told(fit);
        told[Kind::Angle as usize].max(told[Kind::Length as usize])
    }

    /// Each small error of the robot in a fit (not of the mounts), as single effects, with its standard deviation
    /// from `stds`.
    pub fn members(&self, fit: &Fit, stds: &[f64], scene: &Scene) -> Vec<Member> {
        let told = self.group.columns.iter().zip(&fit.model.group).enumerate();
        told.filter(|(_, (column, _))| self.is_of_robot(column))
            .filter_map(|(k, (column, value))| {
                let (effect, place, parameter) = single_effect(column)?;
                Some(Member {
                    effect: effect.into(),
                    at: place.name(scene),
                    parameter,
                    value: *value,
                    std: stds[k],
                })
            })
            .collect()
    }

    /// Whether a hypothesis is one of the small errors of the group.
    pub fn holds(&self, catalogue: &Catalogue, hypothesis: usize) -> bool {
        let own = (catalogue.effect(hypothesis).name(), catalogue.hypotheses[hypothesis].place);
        self.group.columns.iter().filter_map(single_effect).any(|(effect, place, _)| (effect, place) == own)
    }

    /// Whether a column is reported as an error of the robot.
    pub fn is_of_robot(&self, column: &Column) -> bool {
        let kind = Kind::of(column);
        kind != Kind::Position && !(self.mounted && kind.is_of_setup())
    }

    /// Fits a model with the group, and the scales, alternately.
    ///
    /// At each linear model the scales are iterated to a maximum of the evidence, `s² ← (Σ μ² + ν s₀²) / (γ + ν)`,
    /// with `γ = Σ (1 − Σ_kk / s²)` the effective number of values that the data determine, s₀ the usual size and ν
    /// the number of values as which it counts.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
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
        for _ in 0..SOLVER.rounds {
            let here = Linearised::at(problem, catalogue, &self.group, &best.model, options, mask)?;
            let before = self.clone();
            self.learned_from(&|prior_std| here.posterior(best.model.nuisances.len(), prior_std));
            best = fit(
                problem,
                catalogue,
                &self.group,
                &best.model,
                FitOptions { steps: SOLVER.few_steps, ..options },
                mask,
            )?;
            if self.change_from(&before) < SOLVER.spreads_settled {
                break;
            }
        }
        Ok(best)
    }

    /// The scales for other data than those of a fit: at a linear model that gives values and variances of the
    /// group under given prior deviations, iterated until they converge.
    pub fn learned_from(&mut self, posterior: &dyn Fn(&[f64]) -> Option<Values>) {
        for _ in 0..SOLVER.spread_steps {
            if !self.step_spreads(posterior(&self.group.prior_std)) {
                break;
            }
        }
    }

    /// One step of the spreads by values and variances under the present ones; false where they are settled, or numbers overflow.
    fn step_spreads(&mut self, posterior: Option<Values>) -> bool {
        let Some((values, variances)) = posterior else { return false };
        let (mut sum, mut told) = ([0.0; KINDS], [0.0; KINDS]);
        let learned = |k: &usize| self.stated[*k].is_none();
        for k in (0..self.group.columns.len()).filter(learned) {
            let (column, prior) = (&self.group.columns[k], self.group.prior_std[k]);
            let kind = Kind::of(column) as usize;
            sum[kind] += self.of_its_kind(k, values[k]).powi(2);
            told[kind] += 1.0 - (variances[k] / (prior * prior)).clamp(0.0, 1.0);
        }
        let before = self.clone();
        for kind in Kind::ALL {
            let (habit, at) = (kind.habit(self.setup_only), kind as usize);
            let weight = told[at] + habit.worth;
            if weight > LEAST_TOLD {
                let next = ((sum[at] + habit.worth * habit.common.powi(2)) / weight).sqrt();
                // Not in one leap: the next step's values depend on it.
                let next = next.clamp(
                    self.spreads[at] / SOLVER.largest_spread_step,
                    self.spreads[at] * SOLVER.largest_spread_step,
                );
                self.spreads[at] = next.clamp(habit.least, habit.most);
            }
        }
        self.set_priors();
        self.change_from(&before) > 0.1 * SOLVER.spreads_settled
    }
}

/// Spreads that changed by less than this (log, summed over the kinds) since causes were searched need no second search.
pub(crate) const SPREADS_SETTLED: Guard = 0.5;
/// A kind of which the data determine less than this of one value keeps its scale.
const LEAST_TOLD: Guard = 0.05;
