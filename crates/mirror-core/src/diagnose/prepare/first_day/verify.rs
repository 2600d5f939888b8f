//! Model comparison of a mistake with small errors: both models may have every small error of the vocabulary at
//! once.
//!
//! Whether a mistake or small errors explain a session is a comparison of two models that differ only in the
//! mistake. In both, all small errors (zeros, ratios, tilts, lengths, springs, mounts, lens) are random effects of
//! their usual sizes. So nothing that small errors can explain is called a mistake, and small errors do not hide a
//! mistake. The marginal likelihoods (Laplace) are compared at one noise: the smallest that any of the models
//! leaves.

use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::effects::{Place, vocabulary};
use crate::diagnose::likelihood::covariance::Covariance;
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Group, Until, fit_until};
use crate::diagnose::likelihood::noise::SETTLED;
use crate::diagnose::likelihood::score_test::{Score, screen};
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Observation, Problem, Seen};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Size;
use crate::error::Result;
use crate::statistics::CHI_SQUARED_MEDIANS;
use std::sync::Arc;

/// Steps of a fit between two estimates of the scale.
const STEPS: Size = 2;

/// There are as many couplings as pairs of joints: they would explain exchanged columns. Sticking follows any path.
const NO_SMALL_ERRORS: [&str; 2] = ["joint_coupling", "stiction"];

/// A problem fitted with all small errors.
pub(super) struct Tolerant {
    problem: Problem,
    /// Of the small errors.
    catalogue: Catalogue,
    /// Of the model's causes.
    causes: Catalogue,
    group: Group,
    mask: Vec<bool>,
    model: Model,
    /// Where the further columns begin in the group, and the covariance of all parameters.
    first_further: usize,
    covariance: Option<Covariance>,
    /// The scale that half of the observations are within.
    pub noise: Noise,
}

impl Tolerant {
    /// Fits a problem on some frames; `least` is the measurement's noise.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn fitted(problem: &Problem, frames: &[usize], least: Noise) -> Result<Self> {
        Self::fitted_with(problem, frames, least, Vec::new())
    }

    /// As [`Tolerant::fitted`], with further columns, their priors' standard deviations and where they start.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn fitted_with(
        problem: &Problem,
        frames: &[usize],
        least: Noise,
        further: Vec<(Column, f64, f64)>,
    ) -> Result<Self> {
        Self::unfitted(problem, frames, least, &NO_SMALL_ERRORS.map(str::to_owned), further).begun(least)
    }

    /// As [`Tolerant::fitted_with`], from a scale at which no marker seems false: at the one of half of the observations, an error that moves
    /// a single marker far is taken for false observations, and stays unfitted.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn from_afar(
        problem: &Problem,
        frames: &[usize],
        least: Noise,
        further: Vec<(Column, f64, f64)>,
    ) -> Result<Self> {
        let mut far = Self::unfitted(problem, frames, least, &NO_SMALL_ERRORS.map(str::to_owned), further);
        far.noise = far.widest_scale(&far.deformation(), least)?;
        far.settle(least)?;
        Ok(far)
    }

    /// As [`Tolerant::fitted_with`], with all markers exactly where the model has them.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn with_markers_in_place(
        problem: &Problem,
        frames: &[usize],
        least: Noise,
        further: Vec<(Column, f64, f64)>,
    ) -> Result<Self> {
        let mut without = NO_SMALL_ERRORS.map(str::to_owned).to_vec();
        without.push("marker_mount".into());
        Self::unfitted(problem, frames, least, &without, further).begun(least)
    }

    /// With small errors of these kinds only.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn of_effects(
        problem: &Problem,
        frames: &[usize],
        least: Noise,
        which: &[&str],
        further: Vec<(Column, f64, f64)>,
    ) -> Result<Self> {
        Self::unfitted(problem, frames, least, &all_but(which), further).begun(least)
    }

    /// With small errors of all kinds but some, before a fit.
    fn unfitted(
        problem: &Problem,
        frames: &[usize],
        least: Noise,
        without: &[String],
        further: Vec<(Column, f64, f64)>,
    ) -> Self {
        let catalogue = catalogue_without(problem, without);
        let mut group = all_at_once(problem, &catalogue);
        let first_further = group.columns.len();
        let mut starts = Vec::new();
        for (column, std, start) in further {
            group.columns.push(column);
            group.prior_std.push(std);
            starts.push(start);
        }
        let mut model = Model::nominal(problem);
        model.group = vec![0.0; first_further];
        model.group.extend(starts);
        let mut mask = vec![false; problem.frames.len()];
        frames.iter().for_each(|&f| mask[f] = true);
        Self {
            problem: problem.clone(),
            catalogue,
            causes: Catalogue::new(&problem.scene, Vec::new(), &[]),
            group,
            mask,
            model,
            first_further,
            covariance: None,
            noise: least,
        }
    }

    /// Model and scale in turn, from the present values on.
    fn begun(mut self, least: Noise) -> Result<Self> {
        self.noise = self.scale(&self.deformation(), least)?;
        self.settle(least)?;
        Ok(self)
    }

    /// Model and scale in turn.
    fn settle(&mut self, least: Noise) -> Result<()> {
        for _ in 0..SOLVER.rounds {
            let fit = self.fit(self.noise, STEPS, Until::WithinDeviations)?;
            self.covariance = Some(fit.covariance);
            self.model = fit.model;
            let next = self.scale(&self.deformation(), least)?;
            // The scale only falls: a fit that loses half of the data is no better.
            let settled = next.marker_px > SETTLED * self.noise.marker_px
                && next.point_m > SETTLED * self.noise.point_m;
            self.noise = smaller(self.noise, next);
            if settled {
                break;
            }
        }
        Ok(())
    }

    /// The same with a cause beside all small errors, fitted from its parameters. At its place the small error of the
    /// effect `instead` starts from none.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn with_cause(&self, causes: Catalogue, cause: Term, instead: &str, least: Noise) -> Result<Self> {
        let mut model = self.model.clone();
        if let Some(at) = self.first_of(instead, causes.hypotheses[cause.hypothesis].place) {
            model.group[at] = 0.0;
        }
        model.terms.push(cause);
        let mut out = Self {
            problem: self.problem.clone(),
            catalogue: Catalogue::new(&self.problem.scene, Vec::new(), &[]),
            causes,
            group: self.group.clone(),
            mask: self.mask.clone(),
            model,
            first_further: self.first_further,
            covariance: None,
            noise: self.noise,
        };
        out.settle(least)?;
        Ok(out)
    }

    /// The likeliest of some causes beside all small errors, by the score test, with its log Bayes factor.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn likeliest(&self, causes: &Catalogue) -> Result<Option<(Term, f64)>> {
        let mask = Some(self.mask.as_slice());
        let screening = screen(&self.problem, causes, &self.group, &self.model, self.noise, mask)?;
        Ok(screening.scores.into_iter().next().map(|best| {
            let Score { hypothesis, variant, parameters, log_bayes, .. } = best;
            (Term { hypothesis, variant, parameters, prior_scale: 1.0 }, log_bayes)
        }))
    }

    /// The column of the small error of an effect at a place, and its value.
    pub fn small(&self, effect: &str, place: Place) -> Option<(&Column, f64)> {
        self.first_of(effect, place).map(|at| (&self.group.columns[at], self.model.group[at]))
    }

    /// Where the parameters of the small error of an effect at a place begin.
    fn first_of(&self, effect: &str, place: Place) -> Option<usize> {
        let which = self.catalogue.find(effect, place)?;
        Some(self.catalogue.hypotheses[..which].iter().map(|h| h.prior_std.len()).sum())
    }

    /// The vocabulary of these effects only.
    pub fn only(problem: &Problem, which: &[&str]) -> Catalogue {
        catalogue_without(problem, &all_but(which))
    }

    /// The frames, of those that count, that the fitted model predicts: whose board it finds in a mirror.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn predicted(&self) -> Result<Vec<usize>> {
        let deformation = self.deformation();
        let eye = self.problem.eye(&deformation)?;
        let task = Task::of_residuals(&self.problem, &deformation, eye.as_ref(), self.noise);
        let mut work = FrameWork::new(&self.problem);
        let frames = self.frames().into_iter();
        Ok(frames.filter(|&f| work.evaluate(&self.problem, &task, f) && work.has_plane()).collect())
    }

    /// The problem that is fitted.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// The frames that count.
    pub fn frames(&self) -> Vec<usize> {
        (0..self.mask.len()).filter(|&f| self.mask[f]).collect()
    }

    /// Lets only these frames count from here on.
    pub fn keep(&mut self, frames: &[usize]) {
        self.mask.fill(false);
        frames.iter().for_each(|&f| self.mask[f] = true);
    }

    /// Values of the further columns, and their standard deviations.
    pub fn further(&self) -> Vec<(f64, f64)> {
        let before = self.model.nuisances.len();
        let values = self.model.group.iter().enumerate().skip(self.first_further);
        let std = |i: usize| self.covariance.as_ref().map_or(0.0, |c| c[(i, i)].max(0.0).sqrt());
        values.map(|(i, v)| (*v, std(before + i))).collect()
    }

    /// The small error that is largest for its kind: effect and place.
    pub fn largest(&self) -> Option<(String, String)> {
        let mut at = 0;
        let mut best: Option<(f64, usize)> = None;
        for (h, hypothesis) in self.catalogue.hypotheses.iter().enumerate() {
            let own = at..at + hypothesis.prior_std.len();
            at = own.end;
            let of = |k: usize| (self.model.group[k] / self.group.prior_std[k]).powi(2);
            let size: f64 = own.map(of).sum();
            if best.is_none_or(|b| size > b.0) {
                best = Some((size, h));
            }
        }
        let (_, h) = best?;
        let place = self.catalogue.hypotheses[h].place.name(&self.problem.scene);
        Some((self.catalogue.effect(h).name().to_owned(), place))
    }

    /// What all small errors together do.
    pub fn deformation(&self) -> Deformation {
        self.model.deformation(&self.problem, &self.causes, &self.group.columns)
    }

    /// What the small errors do without the further columns.
    pub fn small_errors(&self) -> Deformation {
        let (mut model, mut columns) = (self.model.clone(), self.group.columns.clone());
        model.group.truncate(self.first_further);
        columns.truncate(self.first_further);
        model.deformation(&self.problem, &self.causes, &columns)
    }

    fn fit(&self, noise: Noise, steps: usize, until: Until) -> Result<Fit> {
        let (options, mask) = (FitOptions { noise, steps }, Some(self.mask.as_slice()));
        fit_until(&self.problem, &self.causes, &self.group, &self.model, options, mask, until)
    }

    /// Log marginal likelihood at a noise.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn log_evidence(&mut self, noise: Noise) -> Result<f64> {
        let fit = self.fit(noise, STEPS + 1, Until::BEST)?;
        self.model = fit.model;
        Ok(fit.log_evidence)
    }

    /// Standard deviations by the median of the residuals: half of the data may be false. What is not predicted counts as far.
    fn scale(&self, deformation: &Deformation, least: Noise) -> Result<Noise> {
        self.scale_of(1, deformation, least)
    }

    /// The same by the marker whose median is largest: nothing that is wrong at one place seems false to it.
    fn widest_scale(&self, deformation: &Deformation, least: Noise) -> Result<Noise> {
        self.scale_of(deformation.marker_shift.len(), deformation, least)
    }

    /// The largest of the medians of so many parts, each of the markers that have the same remainder.
    fn scale_of(&self, parts: usize, deformation: &Deformation, least: Noise) -> Result<Noise> {
        let problem = &self.problem;
        let eye = problem.eye(deformation)?;
        let task = Task::of_residuals(problem, deformation, eye.as_ref(), least);
        let mut work = FrameWork::new(problem);
        let (mut pixels, mut points) = (vec![Vec::new(); parts.max(1)], vec![Vec::new(); parts.max(1)]);
        let mut corners = Vec::new();
        let far_px2 = eye.as_ref().map_or(0.0, |eye| {
            let (width, height) = eye.camera.size_px();
            f64::from(width).powi(2) + f64::from(height).powi(2)
        });
        for frame in (0..problem.frames.len()).filter(|&f| self.mask[f]) {
            let before: usize = pixels.iter().map(Vec::len).sum();
            let predicted = work.evaluate(problem, &task, frame);
            if predicted {
                work.raw_residuals(|marker, measured, r| {
                    let part = marker.unwrap_or(0) % parts.max(1);
                    if measured { &mut points[part] } else { &mut pixels[part] }.push(r.norm_squared());
                });
            }
            let (Some(eye), Some(nominal)) = (&eye, problem.boards[frame]) else { continue };
            let of_marker = |o: &&Observation| matches!(o, Observation::Pixel { seen: Seen::Marker(_), .. });
            let seen = problem.frames[frame].others.iter().filter(of_marker).count();
            if parts == 1 {
                let all = pixels[0].len().max(before + seen);
                pixels[0].resize(all, far_px2);
            }
            let fitted = if problem.needs_fresh_board(deformation) {
                work.fit_board(problem, deformation, Some(eye), frame, Some(nominal.foot))
            } else {
                Some(nominal)
            };
            if let Some(fit) = fitted.filter(|f| f.corners > 2) {
                corners.push(2.0 * fit.chi2_px2 / (2.0 * fit.corners as f64 - 3.0));
            }
        }
        let of = |squares: &mut Vec<f64>, chi2: f64, least: f64| {
            squares.sort_by(f64::total_cmp);
            squares.get(squares.len() / 2).map_or(least, |m| (m / chi2).sqrt().max(least))
        };
        let widest = |parts: &mut [Vec<f64>], chi2: f64, least: f64| {
            parts.iter_mut().map(|squares| of(squares, chi2, least)).fold(least, f64::max)
        };
        Ok(Noise {
            corner_px: of(&mut corners, 2.0, least.corner_px),
            marker_px: widest(&mut pixels, CHI_SQUARED_MEDIANS[1], least.marker_px),
            point_m: widest(&mut points, CHI_SQUARED_MEDIANS[2], least.point_m),
        })
    }
}

/// The vocabulary without these effects, and without those of the detection.
fn catalogue_without(problem: &Problem, without: &[String]) -> Catalogue {
    let seen = vocabulary().into_iter().filter(|effect| !effect.is_of_detection());
    Catalogue::new(&problem.scene, seen.map(Arc::from).collect(), without)
}

/// All hypotheses of a catalogue as random effects of their usual sizes.
pub(super) fn all_at_once(problem: &Problem, catalogue: &Catalogue) -> Group {
    let mut group = Group::default();
    for (hypothesis, entry) in catalogue.hypotheses.iter().enumerate() {
        let term = Term {
            hypothesis,
            variant: entry.variants.first().copied().unwrap_or(0.0),
            parameters: vec![0.0; entry.prior_std.len()],
            prior_scale: 1.0,
        };
        group.columns.extend(catalogue.columns(&problem.scene, &term));
        group.prior_std.extend(&entry.prior_std);
    }
    group
}

/// The names of all effects but these.
fn all_but(which: &[&str]) -> Vec<String> {
    let all = vocabulary().into_iter().map(|effect| effect.name().to_owned());
    all.filter(|name| !which.contains(&name.as_str())).collect()
}

/// The smaller noise of two, each kind by itself.
pub(super) fn smaller(a: Noise, b: Noise) -> Noise {
    Noise {
        corner_px: a.corner_px.min(b.corner_px),
        marker_px: a.marker_px.min(b.marker_px),
        point_m: a.point_m.min(b.point_m),
    }
}
