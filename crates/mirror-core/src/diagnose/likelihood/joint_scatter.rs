//! Joints that come to rest elsewhere in each posture: a variance component of all joints together.
//!
//! Servos repeat to a few tenths of a degree, and people type positions in whole degrees: in posture p joint j is at
//! `θ = q + δ`, `δ_pj ~ N(0, s²)`, independent. With the columns X of the joints in the frames of a posture, mirrors
//! projected out, `H_p = XᵀX`, `g_p = Xᵀr`, the errors of a posture have the information `H_p + I/s²`; they are
//! estimated posture by posture with everything else as in a model, s by expectation maximisation,
//! `s² = mean(δ² + diag (H_p + I/s²)⁻¹)`. The marginal likelihood of all postures is Laplace's:
//!
//! `−2 log L = cost(δ̂) + Σ_p (|δ̂_p|²/s² + log det(I + s² H_p))`.
//!
//! A law fitted to such data is less certain than independent observations make it: all views and markers of a posture
//! share its errors. The score of a joint in a posture has the variance `H_jj + s² Σ_k H_jk²` instead of `H_jj`. Over all
//! postures the noise counts as larger by the root of their ratio ([`Widening`]), which makes the variance of a law
//! right that all joints share alike.
//!
//! Sources: Laird and Ware (1982) for the random effects; Liang and Zeger (1986) for the variance of scores.

use crate::diagnose::likelihood::constant_columns::ConstantColumns;
use crate::diagnose::likelihood::factor::{cholesky, log_det, trace_of_inverse};
use crate::diagnose::likelihood::noise::{SETTLED, effective};
use crate::diagnose::likelihood::normal_equations::{changes_sight, counts};
use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{Grid, Size};
use crate::error::Result;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// The scale from which the estimate starts, rad: between an encoder's line and a loose servo.
const START_RAD: Grid = 3e-3;
/// Rounds of expectation maximisation: each brings the scale closer by the share that the data determine.
const ROUNDS: Size = 6;

/// The scatter of all joints that a search allows for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scatter {
    /// Standard deviation of a joint's error in a posture.
    pub std_rad: f64,
    /// By how much the measured noise counts as larger.
    pub widening: Widening,
}

/// Factors on the noise of markers and of the board's corners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Widening {
    pub markers: f64,
    pub corners: f64,
}

impl Widening {
    pub const NONE: Self = Self { markers: 1.0, corners: 1.0 };

    /// The noise with which fits count observations of a posture together.
    pub fn of(self, noise: Noise) -> Noise {
        Noise {
            marker_px: noise.marker_px * self.markers,
            corner_px: noise.corner_px * self.corners,
            ..noise
        }
    }

    /// The noise that was widened.
    pub fn undone(self, noise: Noise) -> Noise {
        Self { markers: self.markers.recip(), corners: self.corners.recip() }.of(noise)
    }

    /// Whether neither differs by more than a noise that counts as settled.
    pub fn is_near(self, other: Self) -> bool {
        let near = |a: f64, b: f64| a > SETTLED * b && b > SETTLED * a;
        near(self.markers, other.markers) && near(self.corners, other.corners)
    }
}

/// The scatter of joints around a model, all of one scale.
#[derive(Debug, Clone)]
pub(crate) struct JointScatter {
    /// Standard deviation of a joint's error in a posture.
    pub std_rad: f64,
    /// The noise that is left beside it, never below the measured one.
    pub noise: Noise,
    /// −2 log of the marginal likelihood at that noise, up to what all models of the recording share.
    pub cost: f64,
    /// By how much the measured noise must count as larger so that laws of the joints are as uncertain as they are.
    pub widening: Widening,
}

/// What one posture says of the joints' errors.
struct OfPosture {
    h: DMatrix<f64>,
    g: DVector<f64>,
    cost: f64,
}

/// The revolute joints that the session sees.
pub(crate) fn scattering_joints(problem: &Problem) -> Vec<NodeId> {
    let scene = &problem.scene;
    (0..scene.nodes()).filter(|&n| scene.relevant[n] && !scene.body.nodes[n].prismatic).collect()
}

impl JointScatter {
    /// The scatter of some joints around a model that is given by its deformation.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn fitted(
        problem: &Problem,
        model: &Deformation,
        joints: &[NodeId],
        measured: Noise,
        mask: Option<&[bool]>,
    ) -> Result<Self> {
        let groups = grouped(problem, mask);
        let mut errors = vec![DVector::zeros(joints.len()); groups.len()];
        let mut moved = model.clone();
        let mut noise = effective(problem, &moved, measured, mask)?;
        let mut std_rad = START_RAD;
        for _ in 0..ROUNDS {
            let sums = sums(problem, &moved, &groups, joints, noise)?;
            let precision = std_rad.powi(-2);
            let mut square = 0.0;
            for (error, of) in errors.iter_mut().zip(&sums) {
                let ridge = DMatrix::identity(joints.len(), joints.len()) * precision;
                // Not positive only where numbers overflow: the posture keeps its errors.
                let Some(factor) = cholesky(&of.h + ridge) else { continue };
                *error += factor.solve(&(&of.g - &*error * precision));
                square += error.norm_squared() + trace_of_inverse(&factor);
            }
            std_rad = (square / (groups.len() * joints.len()).max(1) as f64).sqrt();
            moved = displaced(model, &groups, joints, &errors);
            noise = effective(problem, &moved, measured, mask)?;
        }
        let precision = std_rad.powi(-2);
        let of_posture = |(error, of): (&DVector<f64>, OfPosture)| {
            let scaled = of.h / precision + DMatrix::identity(joints.len(), joints.len());
            let log_det = scaled.cholesky().map_or(f64::INFINITY, |f| log_det(&f));
            of.cost + error.norm_squared() * precision + log_det
        };
        let sums = sums(problem, &moved, &groups, joints, noise)?;
        let widening = widening(problem, joints, &sums, std_rad);
        let left = noise.marker_px / measured.marker_px;
        let widening = Widening { markers: widening.markers * left, ..widening };
        let cost = errors.iter().zip(sums).map(of_posture).sum();
        Ok(Self { std_rad, noise, cost, widening })
    }

    /// How much more likely than none a scatter of all joints can make a model, to first order, in log likelihood, and by
    /// which factor the noise that the model leaves is above the measured one: `½ Σ (gᵀ (H + I/s²)⁻¹ g − log det(I + s² H))` at
    /// the scale that the postures estimate.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn gain(
        problem: &Problem,
        model: &Deformation,
        joints: &[NodeId],
        measured: Noise,
        mask: Option<&[bool]>,
    ) -> Result<(f64, f64)> {
        let noise = effective(problem, model, measured, mask)?;
        let sums = sums(problem, model, &grouped(problem, mask), joints, noise)?;
        let mut variance = START_RAD.powi(2);
        let mut gain = 0.0;
        for _ in 0..ROUNDS {
            let (mut square, mut all) = (0.0, 0.0);
            for of in &sums {
                let scaled = &of.h * variance + DMatrix::identity(joints.len(), joints.len());
                // Not positive only where numbers overflow: such a posture tells nothing.
                let Some(factor) = cholesky(scaled) else { continue };
                let error = factor.solve(&of.g) * variance;
                square += error.norm_squared() + variance * trace_of_inverse(&factor);
                all += 0.5 * (error.dot(&of.g) - log_det(&factor));
            }
            gain = all;
            variance = square / (sums.len() * joints.len()).max(1) as f64;
        }
        Ok((gain, noise.marker_px / measured.marker_px))
    }

    /// The joints that alone would scatter most likely around a model, best first, to first order: with one error e of
    /// variance s² in each posture the likelihood gains `½ Σ (g² / (h + s⁻²) − log(1 + h s²))`.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn likeliest_alone(
        problem: &Problem,
        model: &Deformation,
        joints: &[NodeId],
        measured: Noise,
        mask: Option<&[bool]>,
    ) -> Result<Vec<NodeId>> {
        let noise = effective(problem, model, measured, mask)?;
        let sums = sums(problem, model, &grouped(problem, mask), joints, noise)?;
        let gain = |i: usize| {
            let mut variance = START_RAD.powi(2);
            for _ in 0..ROUNDS {
                let square = |of: &OfPosture| {
                    let precision = of.h[(i, i)] + 1.0 / variance;
                    (of.g[i] / precision).powi(2) + 1.0 / precision
                };
                variance = sums.iter().map(square).sum::<f64>() / sums.len().max(1) as f64;
            }
            let of_posture = |of: &OfPosture| {
                let h = of.h[(i, i)];
                of.g[i].powi(2) / (h + 1.0 / variance) - (h * variance).ln_1p()
            };
            sums.iter().map(of_posture).sum::<f64>()
        };
        let mut gains: Vec<(f64, NodeId)> = joints.iter().enumerate().map(|(i, j)| (gain(i), *j)).collect();
        gains.sort_by(|a, b| b.0.total_cmp(&a.0));
        Ok(gains.into_iter().map(|g| g.1).collect())
    }

    /// The same model without scatter, at the noise that it leaves by itself.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn none(
        problem: &Problem,
        model: &Deformation,
        joints: &[NodeId],
        measured: Noise,
        mask: Option<&[bool]>,
    ) -> Result<Self> {
        let noise = effective(problem, model, measured, mask)?;
        let sums = sums(problem, model, &grouped(problem, mask), joints, noise)?;
        let cost = sums.iter().map(|s| s.cost).sum();
        Ok(Self { std_rad: 0.0, noise, cost, widening: Widening::NONE })
    }
}

/// Factors on the noise for a scatter of joints: on the corners' by the joints between board and camera, on the markers'
/// by all others.
fn widening(problem: &Problem, joints: &[NodeId], sums: &[OfPosture], std_rad: f64) -> Widening {
    let moves_board = |i: usize| changes_sight(problem, &[Column::constant(Atom::Joint(joints[i]))]);
    let together = |of_board: bool| {
        let (mut variance, mut told) = (0.0, 0.0);
        for i in (0..joints.len()).filter(|&i| moves_board(i) == of_board) {
            for of in sums {
                told += of.h[(i, i)];
                variance += of.h[(i, i)] + std_rad * std_rad * of.h.column(i).norm_squared();
            }
        }
        if told > 0.0 { (variance / told).sqrt() } else { 1.0 }
    };
    Widening { markers: together(false), corners: together(true) }
}

/// The frames that count, by posture.
fn grouped(problem: &Problem, mask: Option<&[bool]>) -> Vec<Vec<usize>> {
    let of = |frames: Vec<usize>| frames.into_iter().filter(|&f| counts(mask, f)).collect::<Vec<usize>>();
    postures(problem).into_iter().map(of).filter(|frames| !frames.is_empty()).collect()
}

/// A model with the joints elsewhere in each posture.
fn displaced(
    model: &Deformation,
    groups: &[Vec<usize>],
    joints: &[NodeId],
    errors: &[DVector<f64>],
) -> Deformation {
    let mut out = model.clone();
    for (frames, error) in groups.iter().zip(errors) {
        for (&node, by) in joints.iter().zip(error.iter()) {
            frames.iter().for_each(|&f| out.add_joint_delta(f, node, *by));
        }
    }
    out
}

fn sums(
    problem: &Problem,
    model: &Deformation,
    groups: &[Vec<usize>],
    joints: &[NodeId],
    noise: Noise,
) -> Result<Vec<OfPosture>> {
    let eye = problem.eye(model)?;
    let columns: Vec<Column> = joints.iter().map(|&n| Column::constant(Atom::Joint(n))).collect();
    let residuals = Task::of_residuals(problem, model, eye.as_ref(), noise);
    let with_board = residuals.with_board || changes_sight(problem, &columns);
    let task = Task { gaussian: false, with_board, condensed: true, ..residuals };
    let start = || (FrameWork::new(problem), ConstantColumns::of(columns.iter().map(|c| c.atom)));
    let of_posture = |(work, sums): &mut (FrameWork, ConstantColumns), frames: &Vec<usize>| {
        let mut cost = 0.0;
        sums.clear();
        for &frame in frames {
            let seen = work.evaluate(problem, &task, frame);
            cost += work.cost;
            if seen {
                sums.add(work, problem, model);
            }
        }
        OfPosture { h: sums.information(), g: sums.gradient(), cost }
    };
    let sums = groups.par_iter().map_init(start, of_posture).collect();
    problem.cancel.check()?;
    Ok(sums)
}
