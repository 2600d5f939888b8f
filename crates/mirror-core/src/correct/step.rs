//! One correction step: `Δθ = λ J⁺ (p_ref − p_now)`, damped, whitened, within limits. A pure function without
//! allocation.

use super::cholesky::solve;
use super::damping::{Damping, Gram};
use crate::error::{Error, Result, finite, positive};
use nalgebra::{DMatrix, Matrix3, Vector3};

/// How a step is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepOptions {
    /// λ, in (0, 1]: the paper's gain.
    pub gain: f64,
    /// Damping of the pseudo-inverse.
    pub damping: Damping,
    /// The most that any joint may turn in one step, rad (m for a prismatic joint).
    pub largest_step_rad: f64,
}

impl Default for StepOptions {
    fn default() -> Self {
        Self { gain: 0.8, damping: Damping::default(), largest_step_rad: 0.15 }
    }
}

impl StepOptions {
    /// Refuses options that make no sense.
    ///
    /// # Errors
    /// A gain outside (0, 1], a damping below 0, a largest step that is not above 0.
    pub fn check(&self) -> Result<()> {
        if !(finite("gain", self.gain)? > 0.0 && self.gain <= 1.0) {
            return Err(Error::OutOfRange {
                what: "gain".to_owned(),
                got: self.gain,
                needed: "a number above 0 and at most 1".to_owned(),
            });
        }
        self.damping.check()?;
        positive("largest_step_rad", self.largest_step_rad).map(|_| ())
    }
}

/// What a step is computed from. N joints, M markers.
#[derive(Debug, Clone, Copy)]
pub struct StepProblem<'a> {
    /// J, 3M×N: rows x, y, z of marker after marker, m/rad (m/m for prismatic joints).
    pub jacobian: &'a DMatrix<f64>,
    /// `p_ref − p_now`, M of them, m.
    pub error_m: &'a [Vector3<f64>],
    /// Covariance of each marker's measured position, M of them, m².
    pub covariance_m2: &'a [Matrix3<f64>],
    /// The commanded positions now, N of them, rad (m).
    pub positions: &'a [f64],
    /// Lower limits, N of them; may be −∞.
    pub lower: &'a [f64],
    /// Upper limits, N of them; may be +∞.
    pub upper: &'a [f64],
    /// Which joints may move; the others are held.
    pub free: &'a [bool],
}

/// A step, in the workspace that it was computed in.
#[derive(Debug, Clone, Copy)]
pub struct Step<'w> {
    /// Change of each command, N of them, rad (m); 0 for held joints.
    pub change: &'w [f64],
    /// Which joints a limit stopped.
    pub at_limit: &'w [bool],
    /// The damping that was used, m/rad.
    pub mu_m_per_rad: f64,
    /// 1, or by how much all joints' changes were shortened together for the largest step.
    pub scale: f64,
}

/// The places that a step computes in; made once, used for any number of steps.
#[derive(Debug, Clone, Default)]
pub struct StepWorkspace {
    /// Whitened columns of the free joints, one after the other, 3M each.
    columns: Vec<f64>,
    whitened_error: Vec<f64>,
    remaining: Vec<f64>,
    joints: Vec<usize>,
    active: Vec<usize>,
    gram: Vec<f64>,
    factor: Vec<f64>,
    inverse: Vec<f64>,
    solution: Vec<f64>,
    change: Vec<f64>,
    at_limit: Vec<bool>,
}

impl StepWorkspace {
    /// A workspace for this many markers and joints; it grows by itself where it is given more.
    pub fn new(markers: usize, joints: usize) -> Self {
        let mut workspace = Self::default();
        workspace.resize(3 * markers, joints);
        workspace
    }

    fn resize(&mut self, rows: usize, joints: usize) {
        let n = rows.min(joints);
        self.columns.resize(rows * joints, 0.0);
        self.whitened_error.resize(rows, 0.0);
        self.remaining.resize(rows, 0.0);
        self.joints.reserve(joints);
        self.active.reserve(joints);
        for square in [&mut self.gram, &mut self.factor, &mut self.inverse] {
            square.resize(n * n, 0.0);
        }
        self.solution.resize(rows.max(joints), 0.0);
        self.change.resize(joints, 0.0);
        self.at_limit.resize(joints, false);
    }
}

/// A command this far outside its limits is rounding; farther is refused.
const LIMIT_SLACK: f64 = 1e-9;

/// One step of Algorithm 1 (paper, section II-B-3): `Δθ = λ Jᵀ W (W J Jᵀ Wᵀ + μ² I)⁻¹ W e`, e the stacked `p_ref −
/// p_now`.
///
/// W whitens each marker by its covariance, scaled by the mean deviation s, so that with equal, isotropic
/// covariances W = I and this is the paper's equation (with μ = 0). A joint that would leave its limits is set to
/// the limit, and the others compensate as far as they can (bounded least squares by active sets); joints whose
/// multiplier changes sign are released. At the end all changes are scaled together to the largest step. A command
/// within its limits stays within them.
///
/// # Errors
/// Arrays whose sizes differ, numbers that are not finite, a covariance that is not positive definite, a command
/// outside its limits.
pub fn correction_step<'w>(
    problem: &StepProblem<'_>,
    options: &StepOptions,
    workspace: &'w mut StepWorkspace,
) -> Result<Step<'w>> {
    check(problem)?;
    let rows = problem.jacobian.nrows();
    workspace.resize(rows, problem.positions.len());
    let noise_m = whiten(problem, workspace)?;
    let mut mu = None;
    workspace.at_limit.fill(false);
    workspace.change.fill(0.0);
    // Each pass sets one joint to a limit or releases one; three passes a joint are far more than ever needed.
    for _ in 0..3 * workspace.joints.len() + 1 {
        leave_to_active(options.gain, rows, workspace);
        let chosen = solve_active(rows, options.damping, noise_m, mu, workspace);
        mu.get_or_insert(chosen);
        if let Some((joint, change)) = worst_beyond(problem, workspace) {
            workspace.change[joint] = change;
            workspace.at_limit[joint] = true;
            continue;
        }
        match to_release(problem, rows, chosen, workspace) {
            Some(joint) => {
                workspace.at_limit[joint] = false;
                workspace.change[joint] = 0.0;
            }
            None => break,
        }
    }
    let scale = finish(problem, options.largest_step_rad, workspace);
    Ok(Step {
        change: &workspace.change,
        at_limit: &workspace.at_limit,
        mu_m_per_rad: mu.unwrap_or(0.0),
        scale,
    })
}

fn check(p: &StepProblem<'_>) -> Result<()> {
    let (joints, markers) = (p.positions.len(), p.error_m.len());
    let lengths = [
        ("columns of the Jacobian", p.jacobian.ncols(), joints),
        ("rows of the Jacobian", p.jacobian.nrows(), 3 * markers),
        ("covariances", p.covariance_m2.len(), markers),
        ("lower limits", p.lower.len(), joints),
        ("upper limits", p.upper.len(), joints),
        ("free joints' mask", p.free.len(), joints),
    ];
    for (what, got, needed) in lengths {
        if got != needed {
            return Err(Error::LengthMismatch { what: what.to_owned(), got, needed });
        }
    }
    if markers == 0 {
        return Err(Error::TooFew { what: "markers of a correction".to_owned(), got: 0, needed: 1 });
    }
    let bad = p.jacobian.iter().chain(p.error_m.iter().flatten()).find(|x| !x.is_finite());
    if let Some(&got) = bad {
        return Err(Error::NotFinite { what: "Jacobian or error of a correction".to_owned(), got });
    }
    for (j, &position) in p.positions.iter().enumerate() {
        let inside = position >= p.lower[j] - LIMIT_SLACK && position <= p.upper[j] + LIMIT_SLACK;
        if p.free[j] && !(inside && position.is_finite()) {
            return Err(Error::OutOfRange {
                what: format!("command of joint {j}"),
                got: position,
                needed: format!("{} to {}, its limits", p.lower[j], p.upper[j]),
            });
        }
    }
    Ok(())
}

/// Fills the whitened columns of the free joints and the whitened error; returns the mean deviation s, m.
fn whiten(p: &StepProblem<'_>, w: &mut StepWorkspace) -> Result<f64> {
    let rows = p.jacobian.nrows();
    w.joints.clear();
    // A joint that moves no marker has no part in the step, and would make the matrix singular.
    w.joints.extend(
        (0..p.positions.len()).filter(|&j| p.free[j] && p.jacobian.column(j).iter().any(|x| *x != 0.0)),
    );
    let mut information = 0.0;
    for (m, (covariance, error)) in p.covariance_m2.iter().zip(p.error_m).enumerate() {
        let Some(l) = lower_factor(covariance) else {
            return Err(Error::Undetermined {
                what: "weight of a marker (its covariance is not positive definite)",
            });
        };
        // W = L⁻¹, by forward substitution.
        let apply = |v: [f64; 3]| {
            let x = v[0] / l[0];
            let y = (v[1] - l[1] * x) / l[2];
            [x, y, (v[2] - l[3] * x - l[4] * y) / l[5]]
        };
        // tr Σ⁻¹ = ‖L⁻¹‖².
        for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
            information += apply(axis).iter().map(|x| x * x).sum::<f64>();
        }
        w.whitened_error[3 * m..3 * m + 3].copy_from_slice(&apply([error.x, error.y, error.z]));
        for (k, &joint) in w.joints.iter().enumerate() {
            let column = p.jacobian.column(joint);
            let v = apply([column[3 * m], column[3 * m + 1], column[3 * m + 2]]);
            w.columns[k * rows + 3 * m..k * rows + 3 * m + 3].copy_from_slice(&v);
        }
    }
    let noise_m = (rows as f64 / information).sqrt();
    let used = w.joints.len() * rows;
    w.columns[..used].iter_mut().for_each(|x| *x *= noise_m);
    w.whitened_error.iter_mut().for_each(|x| *x *= noise_m);
    Ok(noise_m)
}

/// The lower factor of a 3×3 covariance: l00, l10, l11, l20, l21, l22.
fn lower_factor(c: &Matrix3<f64>) -> Option<[f64; 6]> {
    let a = c[(0, 0)].sqrt();
    let b = c[(1, 0)] / a;
    let d = (c[(1, 1)] - b * b).sqrt();
    let e = c[(2, 0)] / a;
    let f = (c[(2, 1)] - e * b) / d;
    let g = (c[(2, 2)] - e * e - f * f).sqrt();
    let good = [a, d, g].iter().all(|x| x.is_finite() && *x > 0.0);
    good.then_some([a, b, d, e, f, g])
}

/// Lists the joints that are off their limits, and what error those on limits leave to them.
fn leave_to_active(gain: f64, rows: usize, w: &mut StepWorkspace) {
    w.active.clear();
    for (to, from) in w.remaining.iter_mut().zip(&w.whitened_error) {
        *to = gain * from;
    }
    for (k, &joint) in w.joints.iter().enumerate() {
        if !w.at_limit[joint] {
            w.active.push(k);
            continue;
        }
        let change = w.change[joint];
        for (left, column) in w.remaining.iter_mut().zip(&w.columns[k * rows..(k + 1) * rows]) {
            *left -= column * change;
        }
    }
}

/// The least-squares change of the active joints into `change`; returns μ.
fn solve_active(rows: usize, damping: Damping, noise_m: f64, mu: Option<f64>, w: &mut StepWorkspace) -> f64 {
    let StepWorkspace { columns, remaining, joints, active, gram, factor, inverse, solution, change, .. } = w;
    let count = active.len();
    if count == 0 {
        return mu.unwrap_or(0.0);
    }
    let column = |a: usize| &columns[active[a] * rows..(active[a] + 1) * rows];
    // The smaller of Jᵀ J and J Jᵀ: (Jᵀ J + μ² I)⁻¹ Jᵀ = Jᵀ (J Jᵀ + μ² I)⁻¹.
    let by_joints = count <= rows;
    let n = count.min(rows);
    if by_joints {
        for a in 0..n {
            for b in 0..=a {
                let dot = dot(column(a), column(b));
                gram[a * n + b] = dot;
                gram[b * n + a] = dot;
            }
            solution[a] = dot(column(a), remaining);
        }
    } else {
        gram[..n * n].fill(0.0);
        for a in 0..count {
            let c = column(a);
            for i in 0..n {
                for j in 0..=i {
                    gram[i * n + j] += c[i] * c[j];
                }
            }
        }
        solution[..n].copy_from_slice(&remaining[..n]);
    }
    let mut matrix = Gram { matrix: gram, n, factor, inverse };
    // The damping of the first pass is kept: joints at limits do not change the effect of the noise.
    let mu = matrix.choose(mu.map_or(damping, |mu_m_per_rad| Damping::Fixed { mu_m_per_rad }), noise_m);
    solve(&factor[..n * n], n, solution);
    for a in 0..count {
        change[joints[active[a]]] = if by_joints {
            solution[a]
        } else {
            column(a).iter().zip(&solution[..n]).map(|(x, y)| x * y).sum()
        };
    }
    mu
}

/// The inner product of two stacks of 3-vectors: by threes, so that it is unrolled.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.chunks_exact(3).zip(b.chunks_exact(3)).map(|(x, y)| x[0] * y[0] + x[1] * y[1] + x[2] * y[2]).sum()
}

/// The active joint that goes farthest beyond a limit, and the change that puts it there.
fn worst_beyond(p: &StepProblem<'_>, w: &StepWorkspace) -> Option<(usize, f64)> {
    let mut worst: Option<(usize, f64, f64)> = None;
    for &k in &w.active {
        let joint = w.joints[k];
        let (least, most) = room(p, joint);
        let change = w.change[joint];
        let held = change.clamp(least, most);
        let beyond = (change - held).abs();
        if beyond > 0.0 && worst.is_none_or(|(_, _, most_beyond)| beyond > most_beyond) {
            worst = Some((joint, held, beyond));
        }
    }
    worst.map(|(joint, change, _)| (joint, change))
}

/// The changes that keep a joint within its limits.
fn room(p: &StepProblem<'_>, joint: usize) -> (f64, f64) {
    ((p.lower[joint] - p.positions[joint]).min(0.0), (p.upper[joint] - p.positions[joint]).max(0.0))
}

/// A joint at a limit that would now move back inside, by the sign of its multiplier: `Jᵀ r − μ² Δθ` of the damped problem, r what is left.
fn to_release(p: &StepProblem<'_>, rows: usize, mu: f64, w: &mut StepWorkspace) -> Option<usize> {
    if !w.at_limit.iter().any(|&at| at) {
        return None;
    }
    // What is left after the active joints' part.
    for &k in &w.active {
        let change = w.change[w.joints[k]];
        for (left, column) in w.remaining.iter_mut().zip(&w.columns[k * rows..(k + 1) * rows]) {
            *left -= column * change;
        }
    }
    for (k, &joint) in w.joints.iter().enumerate() {
        if !w.at_limit[joint] {
            continue;
        }
        let ((least, most), change) = (room(p, joint), w.change[joint]);
        let column = w.columns[k * rows..(k + 1) * rows].iter();
        let pull = column.zip(&w.remaining[..rows]).map(|(x, y)| x * y).sum::<f64>() - mu * mu * change;
        if (change <= least && change < most && pull > 0.0)
            || (change >= most && change > least && pull < 0.0)
        {
            return Some(joint);
        }
    }
    None
}

/// Shortens the step to the largest one and clamps what rounding left outside; returns the factor.
fn finish(p: &StepProblem<'_>, largest: f64, w: &mut StepWorkspace) -> f64 {
    let most = w.change.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let scale = if most > largest { largest / most } else { 1.0 };
    for (joint, change) in w.change.iter_mut().enumerate() {
        let (least, most) = room(p, joint);
        *change = if p.free[joint] { (*change * scale).clamp(least, most) } else { 0.0 };
    }
    scale
}
