//! The gross mistakes that a session could contain, each with its unknown parameter tried on a grid.

use super::exchanges::source;
use super::misfit::{LEAST_FALL, Misfit, Work};
use super::mistake::{LENGTH_UNITS, LateKind, Mistake, UNITS, is_unit};
use super::placed::Placed;
use super::still_log::{SAME, still_runs};
use super::variant::{Variant, seen_joints};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::problem::{Observation, Problem, Seen};
use crate::diagnose::prepare::row_slip::LARGEST_SHIFT;
use crate::diagnose::principles::{FEWEST_FRAMES, Grid, NEARLY_ALL, Size, Threshold, WORTH_NAMING};
use crate::statistics::{best_run, least_between};
use core::convert::Infallible;
use core::f64::consts::{FRAC_PI_2, PI};
use std::collections::BTreeSet;

/// Other factors that are tried, and refined: a transmission that is another one.
const FACTORS: [f64; 10] = [0.2, 1.0 / 3.0, 0.5, 2.0 / 3.0, 0.8, 1.25, 1.5, 2.0, 3.0, 5.0];
/// Factors on the board's squares; the best is refined within its interval.
const SQUARES: [f64; 10] = [0.5, 2.0 / 3.0, 0.75, 0.8, 0.9, 1.1, 1.25, 4.0 / 3.0, 1.5, 2.0];
const SQUARES_STEP: Grid = 1.12;
/// Zeros that are tried, rad: every 15°.
const ZERO_STEP: Grid = PI / 12.0;
/// A zero is off by a right angle if it is no farther from one than zeros usually are (rad); then no separate
/// parameter is justified.
const NEARLY_RIGHT: Threshold = 0.05;
/// Whole rows by which a column may be late, and parts of a row.
const LATE_ROWS: Size = 8;
const LATE_PARTS: Size = 10;
/// The same of all joints at once: where every row is a mixture, one with half a row is nearly as far from one with
/// 0.54 as from none.
const LATE_PARTS_OF_ALL: Size = 40;
/// A part of a row must shrink the loss by this share: a whole number needs no other explanation.
const WORTH_A_PART: Threshold = WORTH_NAMING;
/// A frame whose loss falls by this was seen with another label, or at another row.
const CLEAR: Threshold = 1.5;

/// Everything that alternatives are made of.
pub(super) struct Session<'a> {
    pub problem: &'a Problem,
    pub misfit: &'a Misfit<'a>,
    pub joints: Vec<(usize, NodeId)>,
    /// Frames by posture.
    pub postures: Vec<Vec<usize>>,
    pub ordered: bool,
    /// The log's columns as joints, in its order; empty if that is not known.
    log: &'a [usize],
}

impl<'a> Session<'a> {
    pub fn new(problem: &'a Problem, misfit: &'a Misfit<'a>, log: &'a [usize]) -> Self {
        Self {
            log,
            joints: seen_joints(&problem.scene.body, &problem.scene.relevant),
            postures: crate::diagnose::likelihood::saturated::postures(problem),
            ordered: problem.scene.ordered,
            problem,
            misfit,
        }
    }

    /// Whether a joint turns, and does not slide.
    pub fn turns(&self, node: NodeId) -> bool {
        !self.problem.scene.body.nodes[node].prismatic
    }

    /// Mistakes of single joints and pairs of them, of all rows alike.
    ///
    /// `finely`: late logs of all joints in finer parts.
    pub fn of_joints(&self, variant: &Variant, finely: bool) -> Vec<Mistake> {
        let mut out = Vec::new();
        let moving: Vec<(usize, NodeId)> =
            self.joints.iter().copied().filter(|(j, _)| moves(&variant.column(*j))).collect();
        for &(joint, node) in &moving {
            out.push(Mistake::AxisSign { node });
            // What a factor makes nearly constant is not that column in another unit: nothing shows that it is the joint's.
            let (low, high) = range(&variant.column(joint));
            let reach = if self.turns(node) { self.problem.scene.reach_m } else { 1.0 };
            let still_moves = |factor: &&f64| (high - low) * **factor * reach > self.misfit.usual_m;
            let units: &[f64] = if self.turns(node) { &UNITS } else { &LENGTH_UNITS };
            let units = units.iter().chain(&FACTORS).filter(still_moves);
            out.extend(units.map(|&factor| Mistake::JointUnit { joint, factor }));
        }
        for (i, &(a, _)) in moving.iter().enumerate() {
            out.extend(moving[..i].iter().map(|&(b, _)| Mistake::JointsSwapped { joints: (b, a) }));
        }
        // The column of a joint that nothing shows may have a seen joint's positions.
        let unseen = |c: &usize| !self.joints.iter().any(|(j, _)| j == c) && moves(&variant.column(*c));
        for &other in self.log.iter().filter(|c| unseen(c)) {
            let pair = |j: usize| (j.min(other), j.max(other));
            out.extend(moving.iter().map(|&(j, _)| Mistake::JointsSwapped { joints: pair(j) }));
        }
        for &(joint, _) in self.joints.iter().filter(|(_, n)| self.turns(*n)) {
            let steps = (PI / ZERO_STEP).round() as i32;
            let zeros = (1 - steps..=steps).filter(|k| k.abs() > 1);
            out.extend(zeros.map(|k| Mistake::Zero { joint, offset: f64::from(k) * ZERO_STEP }));
        }
        let of_turning = self.problem.scene.body.nodes.iter().filter(|node| !node.prismatic);
        let turning: BTreeSet<usize> = of_turning.map(|node| node.command.0).collect();
        let turning = Vec::from_iter(turning);
        out.extend(UNITS.iter().map(|&factor| Mistake::AllUnits { turning: turning.clone(), factor }));
        out.extend(self.sides());
        out.extend(self.moved_on());
        out.extend(self.late(&moving, finely));
        out
    }

    /// The board printed at another size.
    pub fn of_squares(&self, variant: &Variant) -> Vec<Mistake> {
        if self.problem.board.is_none() || variant.squares != 1.0 {
            return Vec::new();
        }
        SQUARES.iter().map(|&factor| Mistake::Squares { factor }).collect()
    }

    /// Measured points in a left-handed frame. An unknown frame can be turned, so one coordinate is as good as another.
    pub fn of_points(&self, variant: &Variant) -> Vec<Mistake> {
        let measured = |o: &Observation| matches!(o, Observation::Point { .. });
        if variant.mirrored.is_some() || !self.problem.frames.iter().any(|f| f.others.iter().any(measured)) {
            return Vec::new();
        }
        let axes = if self.problem.unknown_frame.is_some() { 2..3 } else { 0..3 };
        axes.map(|axis| Mistake::PointsMirrored { axis }).collect()
    }

    /// Two like chains of joints exchanged at once: left and right.
    fn sides(&self) -> Vec<Mistake> {
        let body = &self.problem.scene.body;
        let mut chains: Vec<Vec<usize>> = Vec::new();
        for &(joint, node) in &self.joints {
            // A chain begins where its parent carries several, or none that is seen.
            let parent = body.nodes[node].parent;
            let siblings = self.joints.iter().filter(|(_, n)| body.nodes[*n].parent == parent).count();
            match chains.iter_mut().find(|c| {
                siblings == 1
                    && c.last()
                        .is_some_and(|&l| self.joints.iter().any(|&(j, n)| j == l && Some(n) == parent))
            }) {
                Some(chain) => chain.push(joint),
                None => chains.push(vec![joint]),
            }
        }
        let mut out = Vec::new();
        for (i, a) in chains.iter().enumerate() {
            for b in chains[..i].iter().filter(|b| b.len() == a.len() && a.len() > 1) {
                out.push(Mistake::ColumnsSwapped {
                    pairs: b.iter().copied().zip(a.iter().copied()).collect(),
                });
            }
        }
        out
    }

    /// All columns from one to another shifted by one place, the last one first: an additional or a missing column. In the
    /// order of the robot's joints, and in that of the log's columns, which a program may have sorted.
    fn moved_on(&self) -> Vec<Mistake> {
        let of_robot: Vec<usize> = self.joints.iter().map(|(j, _)| *j).collect();
        let mut places: Vec<Vec<usize>> = Vec::new();
        let mut out = Vec::new();
        for columns in [&of_robot[..], self.log] {
            // Short runs first: a longer one may differ in columns only that nothing shows.
            for (first, last) in (2..columns.len()).flat_map(|n| (n..columns.len()).map(move |b| (b - n, b)))
            {
                // Exchanges of neighbours carry one column through all others: forward, or back.
                let neighbours = columns[first..=last].windows(2).map(|two| (two[0], two[1]));
                for pairs in [neighbours.clone().collect::<Vec<_>>(), neighbours.rev().collect()] {
                    // Exchanges among unseen joints have no effect.
                    let place: Vec<usize> = of_robot.iter().map(|&j| source(&pairs, j)).collect();
                    let moved = place.iter().zip(&of_robot).filter(|(from, to)| from != to).count();
                    // Where one seen joint has another column, that is an exchange of two, tried above.
                    if moved < 2 || places.contains(&place) {
                        continue;
                    }
                    places.push(place);
                    out.push(Mistake::ColumnsSwapped { pairs });
                }
            }
        }
        out
    }

    fn late(&self, moving: &[(usize, NodeId)], finely: bool) -> Vec<Mistake> {
        if !self.ordered {
            return Vec::new();
        }
        let who = moving.iter().map(|(j, _)| Some(*j)).chain([None]);
        let mut out = Vec::new();
        for joint in who {
            for rows in 1..=LATE_ROWS {
                out.push(Mistake::Late { joint, rows: rows as f64, kind: LateKind::Follow });
            }
            let parts = if joint.is_none() && finely { LATE_PARTS_OF_ALL } else { LATE_PARTS };
            for part in 1..parts {
                let rows = part as f64 / parts as f64;
                out.push(Mistake::Late { joint, rows, kind: LateKind::Follow });
                out.push(Mistake::Late { joint, rows, kind: LateKind::Blend });
            }
        }
        // Where the measurements are late, all columns are early.
        let parts = if finely { LATE_PARTS_OF_ALL } else { LATE_PARTS };
        let early = (1..=LATE_ROWS).map(|rows| rows as f64);
        let of_parts = (1..parts).map(|part| part as f64 / parts as f64);
        let early = early.map(|rows| (rows, LateKind::Follow));
        let early = early.chain(of_parts.clone().map(|rows| (rows, LateKind::Follow)));
        let early = early.chain(of_parts.map(|rows| (rows, LateKind::Blend)));
        out.extend(early.map(|(rows, kind)| Mistake::Late { joint: None, rows: -rows, kind }));
        out
    }

    /// [`Misfit::frame_losses`] where the frame of measured points, and unknown mounts, are known.
    fn losses_where(&self, placed: &Placed, variant: &Variant) -> Vec<(f64, usize)> {
        let mut work = self.misfit.work();
        work.placed = Some(placed.clone());
        let mut of = |frame: usize| {
            let mut out = (0.0, 0);
            self.misfit.of_frame(&mut work, variant, frame, |_, size_m| {
                out = (out.0 + self.misfit.loss(size_m), out.1 + 1);
            });
            out
        };
        (0..self.problem.frames.len()).map(&mut of).collect()
    }

    /// Names of two markers exchanged: in the frames that are clearly better so.
    pub fn of_labels(&self, variant: &Variant) -> Vec<Mistake> {
        let markers = self.problem.marker_sites.len();
        let all: Vec<usize> = (0..self.problem.frames.len()).collect();
        // Unknown mounts would be exchanged with the names, and nothing gained; they are those of most frames.
        let placed = self.misfit.placed(variant, &all);
        let losses = |variant: &Variant| match &placed {
            Some(placed) => self.losses_where(placed, variant),
            None => self.misfit.frame_losses(variant),
        };
        let (own, again) = (losses(variant), placed.is_some().then(|| self.misfit.frame_losses(variant)));
        let mut out = Vec::new();
        for b in 0..markers {
            for a in 0..b {
                let mut swapped = variant.clone();
                (0..swapped.labels.len()).for_each(|f| swapped.exchange_labels(f, (a, b)));
                let gains = |own: &[(f64, usize)], other: &[(f64, usize)]| -> Vec<usize> {
                    (0..own.len()).filter(|&f| own[f].0 - other[f].0 > CLEAR).collect()
                };
                let mut frames = gains(&own, &losses(&swapped));
                if let Some(again) = again.as_ref().filter(|_| frames.len() < 2) {
                    frames = gains(again, &self.misfit.frame_losses(&swapped));
                }
                let seen: Vec<usize> = (0..own.len()).filter(|&f| shows(self.problem, f, a, b)).collect();
                // If both places look alike a frame gives no information; so a share that is nearly all counts as
                // all.
                let always = frames.len() as f64 >= NEARLY_ALL * seen.len() as f64;
                if always {
                    frames = seen;
                }
                if frames.len() > 1 {
                    out.push(Mistake::MarkersSwapped { markers: (a, b), frames, always });
                }
            }
        }
        out
    }

    /// A run of rows that contains other rows' measurements. If it is nearly all rows, the log is late
    /// ([`Session::late`]).
    pub fn of_rows(&self, variant: &Variant) -> Vec<Mistake> {
        let own = self.misfit.frame_losses(variant);
        let count = own.len();
        let mut out = Vec::new();
        for shift in (-LARGEST_SHIFT..=LARGEST_SHIFT).filter(|s| *s != 0) {
            let mut shifted = variant.clone();
            Mistake::Rows { first: 0, last: count - 1, shift }.on_variant(&mut shifted);
            let other = self.misfit.frame_losses(&shifted);
            let gains: Vec<f64> = own.iter().zip(&other).map(|(a, b)| a.0 - b.0).collect();
            if let Some((first, last)) = best_run(&gains).filter(|(a, b)| b - a + 1 >= FEWEST_FRAMES) {
                if (last + 1 - first) as f64 >= NEARLY_ALL * count as f64 {
                    continue;
                }
                out.push(Mistake::Rows { first, last, shift });
            }
        }
        out
    }

    /// A joint's log, or the joint itself, that stands still over a run of rows.
    pub fn of_stops(&self, variant: &Variant) -> Vec<Mistake> {
        let mut out = Vec::new();
        if !self.ordered {
            return out;
        }
        let own = self.misfit.frame_losses(variant);
        let all: Vec<usize> = (0..own.len()).collect();
        let mut work = self.misfit.work();
        work.placed = self.misfit.placed(variant, &all);
        for &(joint, _) in &self.joints {
            let column = variant.column(joint);
            if !moves(&column) {
                continue;
            }
            // Where another alternative holds a joint, its log does not stand still.
            let runs = still_runs(&column, &variant.positions).into_iter();
            let logged = runs.filter(|(first, last)| self.is_logged_still(*first, *last));
            out.extend(logged.map(|(first, last)| Mistake::LogFrozen { joint, first, last }));
            // The joint stays where it was commanded to last; each posture may be the last.
            let mut best: Option<(f64, Mistake)> = None;
            let mut held = variant.clone();
            for posture in &self.postures {
                let position = column[posture[0]];
                let first = posture[0];
                let gains = self.gains_while_held(&mut work, &mut held, (joint, position), &own, first);
                let changed = first..first + gains.len();
                held.positions
                    .range_mut(changed.clone())
                    .zip(&column[changed])
                    .for_each(|(row, q)| row[joint] = *q);
                let Some((a, b)) = best_run(&gains).filter(|(a, b)| b - a + 1 >= FEWEST_FRAMES) else {
                    continue;
                };
                let gain: f64 = gains[a..=b].iter().sum();
                if best.as_ref().is_none_or(|x| gain > x.0) {
                    let stop = Mistake::JointFrozen { joint, first: first + a, last: first + b, position };
                    best = Some((gain, stop));
                }
            }
            out.extend(best.map(|b| b.1));
        }
        out
    }

    /// Whether the log of a joint that moves elsewhere stands still over a run of rows.
    fn is_logged_still(&self, first: usize, last: usize) -> bool {
        let scene = &self.problem.scene;
        let stands = |n: usize| (first..=last).all(|f| (scene.q(f, n) - scene.q(first, n)).abs() < SAME);
        (0..scene.nodes()).any(|n| scene.moves(n) && stands(n))
    }

    /// What each row from the first on gains if a joint stands at a position, up to the end of the run of gaining rows: a
    /// joint that stands still does so from here on. These rows of the variant are left with the joint held: most runs
    /// are short, and a variant of all rows for each would cost the square of their number.
    fn gains_while_held(
        &self,
        work: &mut Work,
        held: &mut Variant,
        (joint, position): (usize, f64),
        own: &[(f64, usize)],
        first: usize,
    ) -> Vec<f64> {
        let (mut gains, mut sum, mut top): (Vec<f64>, f64, f64) = (Vec::new(), 0.0, 0.0);
        for (frame, (before, _)) in own.iter().enumerate().skip(first) {
            let mut after = 0.0;
            held.positions[frame][joint] = position;
            self.misfit.of_frame(work, held, frame, |_, r| after += self.misfit.loss(r));
            sum += before - after;
            gains.push(before - after);
            top = top.max(sum);
            if sum < top - 2.0 * CLEAR {
                break;
            }
        }
        gains
    }

    /// A run in which a log stands still, from the first row on that its own position does not fit.
    pub fn begun(&self, variant: &Variant, freed: &Variant, first: usize, last: usize) -> usize {
        let (own, free) = (self.misfit.frame_losses(variant), self.misfit.frame_losses(freed));
        (first..=last).find(|&f| own[f].0 - free[f].0 > CLEAR).unwrap_or(first)
    }

    /// A mistake with its number refined on some frames.
    pub fn refined(&self, mistake: &Mistake, variant: &Variant, frames: &[usize]) -> Mistake {
        let loss = |m: &Mistake| {
            let mut tried = variant.clone();
            m.on_variant(&mut tried);
            self.misfit.mean_loss(&tried, frames)
        };
        match *mistake {
            Mistake::Zero { joint, offset } => {
                let of = |offset| Mistake::Zero { joint, offset };
                let best = least(offset - ZERO_STEP, offset + ZERO_STEP, |x| loss(&of(x)));
                // A horn that is mounted a tooth or a side further is off by a right angle: if that fits as well,
                // no separate parameter is needed.
                let right = (best / FRAC_PI_2).round() * FRAC_PI_2;
                let is_right = (best - right).abs() < NEARLY_RIGHT;
                of(if is_right && loss(&of(right)) <= loss(&of(best)) + LEAST_FALL { right } else { best })
            }
            Mistake::JointUnit { joint, factor } if !is_unit(factor) => {
                let of = |factor| Mistake::JointUnit { joint, factor };
                of(least(factor * 0.8, factor * 1.25, |x| loss(&of(x))))
            }
            Mistake::Squares { factor } => {
                let of = |factor| Mistake::Squares { factor };
                of(least(factor / SQUARES_STEP, factor * SQUARES_STEP, |x| loss(&of(x))))
            }
            Mistake::Late { joint, rows, kind } if rows.abs() < 1.0 => {
                let of = |rows| Mistake::Late { joint, rows, kind };
                let part = 1.0 / LATE_PARTS as f64;
                let (low, high) = if rows < 0.0 { (-0.99, -0.01) } else { (0.01, 0.99) };
                let best = least((rows - part).max(low), (rows + part).min(high), |x| loss(&of(x)));
                // Near half a row errors die out slowly from one row to the next: the loss has several minima.
                of(if loss(mistake) <= loss(&of(best)) { rows } else { best })
            }
            Mistake::Late { joint, rows, .. } => {
                // Late by more than a row: between the rows next to the best whole one.
                let between = |(kind, from): (LateKind, f64)| {
                    let of = |rows| Mistake::Late { joint, rows, kind };
                    let best = of(least(from + 0.01, from + 0.99, |x| loss(&of(x))));
                    (loss(&best), best)
                };
                let blend = (rows > 0.0).then_some(LateKind::Blend);
                let kinds = core::iter::once(LateKind::Follow).chain(blend);
                let tried = kinds.flat_map(|kind| [(kind, rows - 1.0), (kind, rows)]);
                let best = core::iter::once((loss(mistake) * (1.0 - WORTH_A_PART), mistake.clone()))
                    .chain(tried.map(between))
                    .min_by(|a, b| a.0.total_cmp(&b.0));
                best.map_or_else(|| mistake.clone(), |b| b.1)
            }
            _ => mistake.clone(),
        }
    }
}

/// Whether a frame shows one of two markers.
fn shows(problem: &Problem, frame: usize, a: usize, b: usize) -> bool {
    problem.frames[frame].others.iter().any(|o| match o {
        Observation::Pixel { seen: Seen::Marker(m), .. } => *m == a || *m == b,
        Observation::Pixel { .. } => false,
        Observation::Point { marker, .. } => *marker == a || *marker == b,
    })
}

/// In how many frames one of two markers is seen.
pub(super) fn seen_in(problem: &Problem, a: usize, b: usize) -> usize {
    (0..problem.frames.len()).filter(|&f| shows(problem, f, a, b)).count()
}

/// The lowest and the highest of some values.
pub(super) fn range(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(*q), high.max(*q)))
}

/// Whether a column takes more than one value.
fn moves(column: &[f64]) -> bool {
    column.iter().any(|q| (q - column[0]).abs() > 1e-6)
}

/// The minimum of a function between two numbers by golden sections.
pub(super) fn least(a: f64, b: f64, mut of: impl FnMut(f64) -> f64) -> f64 {
    let Ok(at) = least_between(a, b, 14, |x| Ok::<_, Infallible>(of(x)));
    at
}
