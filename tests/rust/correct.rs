//! The correction: its step against an independent pseudo-inverse, its limits, its judgement against simulated truth.

use mirror_core::correct::*;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

struct Case {
    jacobian: DMatrix<f64>,
    error_m: Vec<Vector3<f64>>,
    covariance_m2: Vec<Matrix3<f64>>,
    positions: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    free: Vec<bool>,
}

impl Case {
    fn random(seed: u64, markers: usize, joints: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let covariance = |rng: &mut ChaCha8Rng| {
            let a = Matrix3::from_fn(|_, _| rng.random_range(-1e-4..1e-4));
            a * a.transpose() + Matrix3::identity() * 1e-9
        };
        Self {
            jacobian: DMatrix::from_fn(3 * markers, joints, |_, _| rng.random_range(-0.15..0.15)),
            error_m: (0..markers).map(|_| Vector3::from_fn(|_, _| rng.random_range(-0.01..0.01))).collect(),
            covariance_m2: (0..markers).map(|_| covariance(&mut rng)).collect(),
            positions: (0..joints).map(|_| rng.random_range(-1.0..1.0)).collect(),
            lower: vec![f64::NEG_INFINITY; joints],
            upper: vec![f64::INFINITY; joints],
            free: vec![true; joints],
        }
    }

    fn problem(&self) -> StepProblem<'_> {
        StepProblem {
            jacobian: &self.jacobian,
            error_m: &self.error_m,
            covariance_m2: &self.covariance_m2,
            positions: &self.positions,
            lower: &self.lower,
            upper: &self.upper,
            free: &self.free,
        }
    }

    fn change(&self, options: &StepOptions) -> Vec<f64> {
        correction_step(&self.problem(), options, &mut StepWorkspace::default()).unwrap().change.to_vec()
    }

    fn stacked_error(&self) -> DVector<f64> {
        DVector::from_iterator(3 * self.error_m.len(), self.error_m.iter().flatten().copied())
    }

    /// Whitened squared error after a change.
    fn cost(&self, change: &[f64]) -> f64 {
        let left = self.stacked_error() - &self.jacobian * DVector::from_column_slice(change);
        let one = |m: usize| {
            let v = left.fixed_rows::<3>(3 * m).into_owned();
            v.dot(&(self.covariance_m2[m].try_inverse().unwrap() * v))
        };
        (0..self.error_m.len()).map(one).sum()
    }
}

fn plain(gain: f64) -> StepOptions {
    StepOptions { gain, damping: Damping::Fixed { mu_m_per_rad: 0.0 }, largest_step_rad: f64::MAX }
}

/// The paper's equation: with equal covariances and no damping the step is λ J⁺ Δp, J⁺ by nalgebra's SVD.
#[test]
fn the_step_is_the_papers_pseudo_inverse() {
    for (markers, joints) in [(1, 3), (1, 7), (2, 4), (3, 7), (4, 6)] {
        let mut case = Case::random(3, markers, joints);
        case.covariance_m2 = vec![Matrix3::identity() * 4e-8; markers];
        let expected = case.jacobian.clone().pseudo_inverse(1e-12).unwrap() * case.stacked_error() * 0.3;
        for (got, needed) in case.change(&plain(0.3)).iter().zip(expected.iter()) {
            assert!((got - needed).abs() < 1e-7 * expected.norm(), "{markers} markers, {joints} joints");
        }
    }
}

/// Damped as `Jᵀ (J Jᵀ + μ² I)⁻¹`, by nalgebra's inverse; held joints stay.
#[test]
fn damping_and_held_joints_are_as_written() {
    let mut case = Case::random(5, 2, 5);
    case.covariance_m2 = vec![Matrix3::identity() * 1e-8; 2];
    case.free[1] = false;
    let mut j = case.jacobian.clone();
    j.column_mut(1).fill(0.0);
    let mu: f64 = 0.05;
    let inverse = (&j * j.transpose() + DMatrix::identity(6, 6) * mu * mu).try_inverse().unwrap();
    let expected = j.transpose() * inverse * case.stacked_error();
    let options = StepOptions { damping: Damping::Fixed { mu_m_per_rad: mu }, ..plain(1.0) };
    let change = case.change(&options);
    assert_eq!(change[1], 0.0);
    for (got, needed) in change.iter().zip(expected.iter()) {
        assert!((got - needed).abs() < 1e-12);
    }
}

/// The noise of a step damped by the measurement's covariance, sampled, is what was allowed where J is nearly singular.
#[test]
fn damping_by_noise_bounds_the_steps_noise() {
    let mut case = Case::random(9, 1, 3);
    let twin = case.jacobian.column(0) + DVector::from_element(3, 1e-4);
    case.jacobian.set_column(1, &twin);
    let std = 2e-4;
    case.covariance_m2 = vec![Matrix3::identity() * std * std];
    let allowed = 0.01;
    let options = StepOptions { damping: Damping::Noise { step_std_rad: allowed }, ..plain(1.0) };
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut squares = 0.0;
    let trials = 4000;
    for _ in 0..trials {
        case.error_m[0] = Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal) * std);
        squares += case.change(&options).iter().map(|x| x * x).sum::<f64>();
    }
    let sampled = (squares / f64::from(trials)).sqrt();
    assert!((sampled / allowed - 1.0).abs() < 0.05, "sampled {sampled}, allowed {allowed}");
    // Undamped it is far beyond.
    let loose: f64 = case.change(&plain(1.0)).iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!(loose > 10.0 * allowed);
}

proptest! {
    /// Whatever the problem: limits are never left, held joints never moved, no joint beyond the largest step, nothing not finite.
    #[test]
    fn limits_are_never_left(seed in 0_u64..1_000_000, markers in 1_usize..4, joints in 1_usize..9,
                             room in 0.0_f64..0.1, largest in 0.001_f64..1.0, gain in 0.05_f64..1.0) {
        let mut case = Case::random(seed, markers, joints);
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 77);
        for j in 0..joints {
            // Some stand on a limit.
            case.lower[j] = case.positions[j] - if rng.random_bool(0.3) { 0.0 } else { rng.random_range(0.0..=room) };
            case.upper[j] = case.positions[j] + if rng.random_bool(0.3) { 0.0 } else { rng.random_range(0.0..=room) };
            case.free[j] = rng.random_bool(0.85);
        }
        let options = StepOptions { gain, largest_step_rad: largest, ..StepOptions::default() };
        let change = case.change(&options);
        for j in 0..joints {
            prop_assert!(change[j].is_finite());
            prop_assert!(change[j].abs() <= largest * (1.0 + 1e-12));
            prop_assert!(case.free[j] || change[j] == 0.0);
            let to = case.positions[j] + change[j];
            prop_assert!(to >= case.lower[j] - 1e-12 && to <= case.upper[j] + 1e-12);
        }
    }

    /// Within limits the step is the best one: no other change within them has a smaller error (bounded least squares).
    #[test]
    fn a_limited_step_is_the_best_within_the_limits(seed in 0_u64..1_000_000, room in 0.002_f64..0.05) {
        let mut case = Case::random(seed, 3, 6);
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 5);
        for j in 0..6 {
            case.lower[j] = case.positions[j] - rng.random_range(0.0..room);
            case.upper[j] = case.positions[j] + rng.random_range(0.0..room);
        }
        let best = case.change(&plain(1.0));
        let cost = case.cost(&best);
        for _ in 0..50 {
            let scale = 10_f64.powf(rng.random_range(-6.0..0.0));
            let other: Vec<f64> = (0..6)
                .map(|j| (best[j] + scale * rng.random_range(-room..room))
                    .clamp(case.lower[j] - case.positions[j], case.upper[j] - case.positions[j]))
                .collect();
            prop_assert!(case.cost(&other) >= cost * (1.0 - 1e-9), "{} < {}", case.cost(&other), cost);
        }
    }

    /// The same of the damped step, against all ways of holding joints at an end: `min ‖e − J x‖² + μ² ‖x‖²` within the limits.
    #[test]
    fn a_damped_limited_step_is_the_best_of_all_active_sets(
        seed in 0_u64..1_000_000, joints in 1_usize..5, markers in 1_usize..3, room in 0.002_f64..0.2, mu in 0.01_f64..0.2,
    ) {
        let mut case = Case::random(seed, markers, joints);
        case.covariance_m2 = vec![Matrix3::identity() * 1e-8; markers];
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 9);
        for j in 0..joints {
            case.lower[j] = case.positions[j] - rng.random_range(0.0..room);
            case.upper[j] = case.positions[j] + rng.random_range(0.0..room);
        }
        let ends: Vec<[f64; 2]> = (0..joints)
            .map(|j| [case.lower[j] - case.positions[j], case.upper[j] - case.positions[j]])
            .collect();
        let error = case.stacked_error();
        let cost = |x: &DVector<f64>| (&error - &case.jacobian * x).norm_squared() + mu * mu * x.norm_squared();
        let mut best = f64::INFINITY;
        for set in 0..3_usize.pow(joints as u32) {
            // 0: free; 1 and 2: at an end.
            let held: Vec<usize> = (0..joints).map(|j| set / 3_usize.pow(j as u32) % 3).collect();
            let mut x = DVector::from_fn(joints, |j, _| if held[j] == 0 { 0.0 } else { ends[j][held[j] - 1] });
            let free: Vec<usize> = (0..joints).filter(|&j| held[j] == 0).collect();
            let columns = case.jacobian.select_columns(&free);
            let normal = columns.transpose() * &columns + DMatrix::identity(free.len(), free.len()) * mu * mu;
            let right = columns.transpose() * (&error - &case.jacobian * &x);
            if !free.is_empty() {
                let moved = normal.lu().solve(&right).unwrap();
                free.iter().zip(moved.iter()).for_each(|(&j, value)| x[j] = *value);
            }
            if (0..joints).all(|j| x[j] >= ends[j][0] - 1e-12 && x[j] <= ends[j][1] + 1e-12) {
                best = best.min(cost(&x));
            }
        }
        let options = StepOptions { damping: Damping::Fixed { mu_m_per_rad: mu }, ..plain(1.0) };
        let got = cost(&DVector::from_vec(case.change(&options)));
        prop_assert!(got <= best * (1.0 + 1e-9), "{got} > {best}");
    }

    /// A marker whose covariance is huge has no say: it moves the step by at most w κ² of its size, where w = 1e-12 is
    /// the ratio of the weights and κ the condition of the other marker's Jacobian.
    #[test]
    fn markers_weigh_by_their_covariance(seed in 0_u64..100_000) {
        let mut case = Case::random(seed, 2, 3);
        let stretch = case.jacobian.rows(0, 3).into_owned().singular_values();
        prop_assume!(stretch[2] > 1e-3 * stretch[0]);
        case.covariance_m2 = vec![Matrix3::identity() * 1e-8, Matrix3::identity() * 1e4];
        let both = case.change(&plain(1.0));
        let mut one = Case { jacobian: case.jacobian.rows(0, 3).into_owned(), ..case };
        one.error_m.truncate(1);
        one.covariance_m2.truncate(1);
        let alone = one.change(&plain(1.0));
        let size: f64 = alone.iter().map(|x| x.abs()).sum();
        for j in 0..3 {
            prop_assert!((both[j] - alone[j]).abs() < 1e-3 * size);
        }
    }
}

/// Both joints are set to their limits first; the damping alone pulls the second one back inside: `x₂ = c·(e − b x₁) / (c·c + μ²)`.
#[test]
fn damping_takes_a_joint_off_its_limit() {
    let (b, c) = (Vector3::new(-0.01, -0.15, -0.07), Vector3::new(0.04, 0.09, 0.02));
    let (error, mu, ends) = (Vector3::new(0.03, 0.0, -0.02), 0.05, [0.08, 0.17]);
    let case = Case {
        jacobian: DMatrix::from_fn(3, 2, |row, column| [b, c][column][row]),
        error_m: vec![error],
        covariance_m2: vec![Matrix3::identity() * 1e-8],
        positions: vec![0.0; 2],
        lower: vec![-0.11, -0.08],
        upper: ends.to_vec(),
        free: vec![true; 2],
    };
    let options = StepOptions { damping: Damping::Fixed { mu_m_per_rad: mu }, ..plain(1.0) };
    let change = case.change(&options);
    let second = c.dot(&(error - b * ends[0])) / (c.dot(&c) + mu * mu);
    assert!((change[0] - ends[0]).abs() < 1e-12 && (change[1] - second).abs() < 1e-9, "{change:?}, {second}");
    assert!(second < ends[1] - 0.009);
}

#[test]
fn what_makes_no_sense_is_refused() {
    let good = Case::random(1, 2, 4);
    let refused = |case: &Case, options: &StepOptions| {
        correction_step(&case.problem(), options, &mut StepWorkspace::default()).unwrap_err().to_string()
    };
    let mut case = Case::random(1, 2, 4);
    case.covariance_m2[1] = Matrix3::zeros();
    assert!(refused(&case, &plain(1.0)).contains("positive definite"));
    let mut case = Case::random(1, 2, 4);
    case.upper[2] = case.positions[2] - 0.1;
    assert!(refused(&case, &plain(1.0)).contains("joint 2"));
    let mut case = Case::random(1, 2, 4);
    case.error_m[0].x = f64::NAN;
    assert!(refused(&case, &plain(1.0)).contains("finite"));
    let mut case = Case::random(1, 2, 4);
    case.free.pop();
    assert!(refused(&case, &plain(1.0)).contains("free"));
    for gain in [0.0, -1.0, 1.1, f64::NAN] {
        assert!(StepOptions { gain, ..plain(1.0) }.check().is_err());
    }
    assert!(good.change(&plain(1.0)).iter().any(|x| *x != 0.0));
}

/// The bound on a distance holds as often as it says, for flat and for round covariances, near the target and far.
#[test]
fn distance_bounds_cover_the_truth() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    for (stds, truth) in
        [([1.0, 1.0, 1.0], 0.0), ([1.0, 1.0, 1.0], 4.0), ([0.2, 0.2, 1.5], 1.0), ([0.1, 0.1, 1.0], 8.0)]
    {
        let covariance = Matrix3::from_diagonal(&Vector3::from(stds.map(|s: f64| s * s)));
        let (trials, mut beyond, mut below) = (20_000, 0, 0);
        for _ in 0..trials {
            // The measured one is given; the truth is spread about it.
            let measured = Vector3::new(0.6, 0.48, 0.64) * truth;
            let real = measured + Vector3::from_fn(|i, _| rng.sample::<f64, _>(StandardNormal) * stds[i]);
            let bounds = DistanceBounds::new(&measured, &covariance);
            beyond += i32::from(real.norm() > bounds.at(2.326));
            below += i32::from(real.norm() < bounds.at(-2.326));
        }
        let part = |n: i32| f64::from(n) / f64::from(trials);
        assert!(part(beyond) < 0.016, "{stds:?} {truth}: {} beyond, 0.01 meant", part(beyond));
        assert!(part(below) < 0.03, "{stds:?} {truth}: {} below, 0.01 meant", part(below));
    }
}
