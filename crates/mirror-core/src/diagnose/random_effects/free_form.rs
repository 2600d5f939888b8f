//! Free-form errors: at every place a smooth error without a law (a non-parametric term). They are never causes.
//! They show where an error is that the vocabulary lacks, and on which variables it depends.
//!
//! | place | error | depends on |
//! | --- | --- | --- |
//! | joint | of its position | constant, its position, load, direction of motion, its path (hysteresis), time, another joint's position, both joints' positions |
//! | joint | of its axis | constant |
//! | link | turn in the moment of gravity; shift | load; constant, time (a line and a parabola from the first row on) |
//! | marker | shift | constant, direction of gravity, time |
//! | base | pose in the frame of the measured points | time; load (turn only) |
//! | camera | mount; smooth warp of the image; mount (turn only); focal length | constant; constant; time, a joint's position; time (both with knots, and as a line and a parabola from the first row on) |
//! | board | scale and shape | constant |
//! | mirror | glass, curvature, astigmatism | constant |

use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::effects::{Effect, Place, joint_error};
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::free_values::{ASTIGMATISM, BOARD_SHAPE, WARP};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::principles::{Grid, Prior, Size};
use nalgebra::Vector3;

/// Smooth functions a dependence has: knots of a piecewise linear function.
const KNOTS: Size = 6;
/// Knots of a joint's dependence on time, as shares of the recording: as far apart as the others, and two more where what was cold
/// warms up.
const TIME_KNOTS: [Grid; 8] = [0.0, 0.04, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0];
/// The same of a dependence on another place's quantity.
const FEW_KNOTS: Size = 4;
/// The same of the camera's on time: lenses and mounts warm up, breathe and come back within a recording.
const CAMERA_TIME_KNOTS: Size = 10;
/// Along each of two joints' positions.
const KNOTS_A_SIDE: Size = 3;
/// How far hysteresis reaches back, as shares of the range that the joint moves through.
const HYSTERESIS_REACH: [f64; 4] = [0.04, 0.12, 0.3, 0.6];
/// The scales that an error's prior may have, as shares of the sizes below; the most probable one is learned. Where only the largest
/// is tried, several causes that each do a part are more probable than one small smooth error.
const SCALES: [Prior; 3] = [1.0, 0.25, 0.0625];
/// A common size of an error of an angle, rad.
pub(crate) const TYPICAL_RAD: Prior = 0.03;
/// A common size of a shift, m.
const TYPICAL_M: Prior = 0.005;
/// A common size of an error of the optics: a share of the image's or of the board's size, or a turn of the camera, rad.
const TYPICAL_SHARE: Prior = 0.02;

/// On what an error depends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum On {
    Nothing,
    Position,
    Load,
    Direction,
    /// The path that the joint came along.
    History,
    Time,
    /// Time, without coming back: what creeps, sinks or warms up.
    Creep,
    /// The direction of gravity.
    Posture,
    /// The position of another joint.
    Joint(NodeId),
    /// The joint's own position and another's.
    Both(NodeId),
}

impl On {
    fn told(self, scene: &Scene) -> DependsOn {
        let joint = |n: NodeId| scene.body.nodes[n].joint.clone();
        match self {
            Self::Nothing => DependsOn::Nothing,
            Self::Position => DependsOn::Position,
            Self::Load => DependsOn::Load,
            Self::Direction => DependsOn::Direction,
            Self::History => DependsOn::History,
            Self::Time | Self::Creep => DependsOn::Time,
            Self::Posture => DependsOn::Posture,
            Self::Joint(n) => DependsOn::PositionOf(joint(n)),
            Self::Both(n) => DependsOn::PositionAnd(joint(n)),
        }
    }
}

/// What is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum What {
    Joint,
    Axis,
    LinkTurn,
    LinkShift,
    Base,
    Marker,
    CameraMount,
    Image,
    Focal,
    Board,
    Mirror,
}

/// A smooth error of one kind.
pub(super) struct FreeForm {
    what: What,
    on: On,
    told: DependsOn,
    /// The same in words.
    name: String,
}

/// Hat functions over the range of a quantity: a piecewise linear function with as many free values as knots.
fn hats(values: &[f64], knots: usize) -> Vec<Vec<f64>> {
    let shares: Vec<f64> = (0..knots).map(|k| k as f64 / (knots - 1) as f64).collect();
    hats_at(values, &shares)
}

/// The same with knots at these shares of the range, ascending from 0 to 1.
fn hats_at(values: &[f64], shares: &[f64]) -> Vec<Vec<f64>> {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let range = (high - low).max(1e-12);
    let hat = |k: usize| {
        let to = |other: Option<&f64>| other.map_or(f64::INFINITY, |other| (shares[k] - other).abs() * range);
        let (before, after) = (to(k.checked_sub(1).and_then(|k| shares.get(k))), to(shares.get(k + 1)));
        let from_knot = |v: &f64| v - low - shares[k] * range;
        let value = |v: &f64| {
            let away = from_knot(v);
            (1.0 - away.abs() / if away < 0.0 { before } else { after }).max(0.0)
        };
        values.iter().map(value).collect()
    };
    (0..shares.len()).map(hat).collect()
}

/// A line and a parabola from 0 at the first row: how a base sinks or a frame creeps.
fn from_start(time_s: &[f64]) -> Vec<Vec<f64>> {
    let Some((first, last)) = time_s.first().zip(time_s.last()) else { return Vec::new() };
    let share = |t: &f64| (t - first) / (last - first).max(1e-12);
    vec![time_s.iter().map(share).collect(), time_s.iter().map(|t| share(t).powi(2)).collect()]
}

/// Components of a moment over the largest, without those that are the same in all frames.
fn yielding(moments: &[Vector3<f64>]) -> Vec<Vec<f64>> {
    let largest = moments.iter().map(Vector3::norm).fold(1e-12, f64::max);
    let component = |k: usize| moments.iter().map(|m| m[k] / largest).collect::<Vec<f64>>();
    let varies = |of: &Vec<f64>| of.iter().any(|w| (w - of[0]).abs() > NEGLIGIBLE);
    (0..3).map(component).filter(varies).collect()
}

/// The stop operator of a path that starts at `from`: its distance from the centre of a dead zone of half width
/// `reach` that it drags along, −reach to reach. Sums of a few represent any rate-independent hysteresis of Prandtl
/// and Ishlinskii: play, and approximately Bouc–Wen's law.
fn stop(from: f64, path: &[f64], reach: f64) -> Vec<f64> {
    let mut dragged = from;
    path.iter()
        .map(|&q| {
            // No clamp: positions whose range overflows have no finite reach, and so no dead zone.
            dragged = dragged.max(q - reach).min(q + reach);
            let share = (q - dragged) / reach;
            if share.is_finite() { share } else { 0.0 }
        })
        .collect()
}

impl FreeForm {
    pub(super) fn new(what: What, on: On, scene: &Scene) -> Self {
        let told = on.told(scene);
        Self { what, on, name: told.to_string(), told }
    }

    /// The weights of its dependence at a place, one list for each column and elementary change.
    fn weights(&self, scene: &Scene, place: Place) -> Vec<Weight> {
        let frames = 0..scene.frames;
        let of = |f: &dyn Fn(usize) -> f64| -> Vec<f64> { frames.clone().map(f).collect() };
        let table = |rows: Vec<Vec<f64>>| rows.into_iter().map(Weight::Frames).collect();
        match (self.on, place) {
            (On::Nothing, _) => vec![Weight::One],
            (On::Joint(k), Place::Camera) => {
                let (low, high) = scene.commanded_range[k];
                let middle = 0.5 * (low + high);
                let half = (0.5 * (high - low)).max(1e-9);
                table(vec![of(&|f| (scene.q(f, k) - middle) / half)])
            }
            (On::Joint(k), _) => table(hats(&of(&|f| scene.q(f, k)), FEW_KNOTS)),
            (On::Both(k), Place::Joint(n)) => {
                let own = hats(&of(&|f| scene.q(f, n)), KNOTS_A_SIDE);
                let other = hats(&of(&|f| scene.q(f, k)), KNOTS_A_SIDE);
                let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).collect();
                table(own.iter().flat_map(|a| other.iter().map(move |b| product(a, b))).collect())
            }
            (On::Time, Place::Joint(_)) => table(hats_at(&scene.time_s, &TIME_KNOTS)),
            (On::Creep, _) => table(from_start(&scene.time_s)),
            (On::Time, Place::Camera) => table(hats(&scene.time_s, CAMERA_TIME_KNOTS)),
            (On::Time, _) => table(hats(&scene.time_s, FEW_KNOTS)),
            (On::Position, Place::Joint(n)) => table(hats(&of(&|f| scene.q(f, n)), KNOTS)),
            (On::Direction, Place::Joint(n)) => {
                let mut rows = hats(&of(&|f| scene.q(f, n)), FEW_KNOTS);
                for row in &mut rows {
                    row.iter_mut().enumerate().for_each(|(f, w)| *w *= scene.direction(f, n));
                }
                table(rows)
            }
            (On::History, Place::Joint(n)) => {
                let path = of(&|f| scene.q(f, n));
                let (low, high) = scene.commanded_range[n];
                let range = (high - low).max(1e-9);
                let at_rest = scene.body.nodes[n].at_rest();
                let own = path.iter().map(|q| (q - 0.5 * (low + high)) / (0.5 * range)).collect();
                let stops = HYSTERESIS_REACH.iter().map(|reach| stop(at_rest, &path, reach * range));
                table(core::iter::once(own).chain(stops).collect())
            }
            (On::Load, Place::Joint(n)) => table(hats(&of(&|f| scene.torque(f, n)), KNOTS)),
            (On::Load, Place::Link(Some(n))) => {
                let largest = (0..scene.frames).map(|f| scene.moment(f, n).norm()).fold(1e-12, f64::max);
                table((0..3).map(|k| of(&|f| scene.moment(f, n)[k] / largest)).collect())
            }
            (On::Load, Place::Link(None)) => table(yielding(&scene.base_moment)),
            (On::Posture, Place::Marker(m)) => {
                table((0..3).map(|k| of(&|f| scene.down_in_mount(f, m)[k])).collect())
            }
            _ => Vec::new(),
        }
    }

    /// The elementary changes at a place, each with a common size.
    fn atoms(&self, scene: &Scene, place: Place) -> Vec<(Atom, f64)> {
        let optics =
            |range: core::ops::Range<usize>, size: f64| range.map(move |k| (Atom::FreeOptics(k), size));
        let pose = |atom: fn(usize) -> Atom| -> Vec<(Atom, f64)> {
            (0..6).map(|k| (atom(k), if k < 3 { TYPICAL_SHARE } else { TYPICAL_M })).collect()
        };
        let path_m = scene.reach_m.max(0.1);
        match (self.what, place) {
            (What::Joint, Place::Joint(n)) => {
                vec![(Atom::Joint(n), joint_error(scene, n, TYPICAL_RAD))]
            }
            (What::Axis, Place::Joint(n)) => (0..2).map(|k| (Atom::Tilt(n, k), TYPICAL_RAD)).collect(),
            (What::LinkTurn, Place::Link(Some(n))) => {
                (0..3).map(|k| (Atom::Turn(n, k), TYPICAL_RAD)).collect()
            }
            (What::LinkShift, Place::Link(n)) => (0..3).map(|k| (Atom::LinkShift(n, k), TYPICAL_M)).collect(),
            (What::Base, _) if self.on == On::Load => {
                (0..3).map(|k| (Atom::FramePose(k), TYPICAL_RAD)).collect()
            }
            (What::Base, _) => pose(Atom::FramePose),
            (What::Marker, Place::Marker(m)) => {
                (0..3).map(|k| (Atom::MarkerShift(m, k), TYPICAL_M)).collect()
            }
            (What::CameraMount, _) if self.on == On::Nothing => pose(Atom::CameraMount),
            (What::CameraMount, _) => (0..3).map(|k| (Atom::CameraMount(k), TYPICAL_SHARE)).collect(),
            (What::Image, _) => {
                (0..2).map(|k| (Atom::Center(k), 8.0)).chain(optics(WARP, TYPICAL_SHARE)).collect()
            }
            (What::Focal, _) => vec![(Atom::Focal, TYPICAL_SHARE)],
            (What::Board, _) => core::iter::once((Atom::BoardScale, TYPICAL_SHARE))
                .chain(optics(BOARD_SHAPE, TYPICAL_SHARE))
                .collect(),
            (What::Mirror, _) => [(Atom::Glass, 0.004), (Atom::Curvature, TYPICAL_SHARE / path_m)]
                .into_iter()
                .chain(optics(ASTIGMATISM, TYPICAL_SHARE / path_m))
                .collect(),
            _ => Vec::new(),
        }
    }
}

impl Effect for FreeForm {
    fn name(&self) -> &str {
        &self.name
    }

    fn parameters(&self) -> Vec<String> {
        Vec::new()
    }

    fn places(&self, scene: &Scene) -> Vec<Place> {
        let joints = (0..scene.nodes()).filter(|&n| scene.relevant[n]);
        let on = self.on;
        match self.what {
            What::Joint => joints
                .filter(|&n| match on {
                    On::Position => scene.moves(n),
                    On::Direction | On::History => scene.ordered && scene.moves(n),
                    On::Load => scene.largest_torque(n) > 1e-6,
                    On::Joint(k) => k != n && scene.body.share_a_limb(n, k),
                    On::Both(k) => k != n && scene.moves(n) && scene.body.share_a_limb(n, k),
                    _ => true,
                })
                .map(Place::Joint)
                .collect(),
            What::Axis => joints.filter(|&n| scene.moves(n)).map(Place::Joint).collect(),
            What::LinkTurn => joints
                .filter(|&n| (0..scene.frames).any(|f| scene.moment(f, n).norm() > 1e-6))
                .map(|n| Place::Link(Some(n)))
                .collect(),
            What::LinkShift => joints.map(|n| Place::Link(Some(n))).collect(),
            // A camera of the robot's own moves with its base, and measured points alone show that.
            What::Base if scene.has_camera => Vec::new(),
            What::Base if on == On::Load && yielding(&scene.base_moment).is_empty() => Vec::new(),
            What::Base => vec![Place::Link(None)],
            What::Marker => {
                let known = |m: &usize| on != On::Nothing || scene.mount_known[*m];
                (0..scene.marker_names.len()).filter(known).map(Place::Marker).collect()
            }
            What::CameraMount | What::Image | What::Focal => {
                if scene.has_camera {
                    vec![Place::Camera]
                } else {
                    Vec::new()
                }
            }
            What::Board => {
                if scene.has_board {
                    vec![Place::Board]
                } else {
                    Vec::new()
                }
            }
            What::Mirror => {
                if scene.has_board {
                    vec![Place::Mirror]
                } else {
                    Vec::new()
                }
            }
        }
    }

    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64> {
        let weights = self.weights(scene, place).len();
        self.atoms(scene, place).into_iter().flat_map(|(_, size)| vec![size; weights]).collect()
    }

    fn variants(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        SCALES.into()
    }

    // The score test has found the most probable scale.
    fn variants_near(&self, _scene: &Scene, _place: Place, _variant: f64) -> Vec<f64> {
        Vec::new()
    }

    fn is_scaled_by_variant(&self) -> bool {
        true
    }

    fn columns(&self, scene: &Scene, place: Place, _variant: f64, _parameters: &[f64]) -> Vec<Column> {
        let weights = self.weights(scene, place);
        self.atoms(scene, place)
            .into_iter()
            .flat_map(|(atom, _)| weights.iter().map(move |w| Column { atom, weight: w.clone() }))
            .collect()
    }

    fn depends_on_load(&self) -> bool {
        self.on == On::Load
    }

    fn depends_on(&self) -> Option<&DependsOn> {
        Some(&self.told)
    }

    fn words(&self) -> &str {
        "a smooth error without a law"
    }
}

/// All free-form errors of a scene.
pub(crate) fn free_forms(scene: &Scene) -> Vec<Box<dyn Effect>> {
    use On::{Both, Creep, Direction, History, Joint, Load, Nothing, Position, Posture, Time};
    let mut kinds = vec![
        (What::Joint, Nothing),
        (What::Joint, Position),
        (What::Joint, Load),
        (What::Joint, Direction),
        (What::Joint, History),
        (What::Joint, Time),
        (What::Axis, Nothing),
        (What::LinkTurn, Load),
        (What::LinkShift, Nothing),
        (What::LinkShift, Creep),
        (What::Marker, Nothing),
        (What::Marker, Posture),
        (What::Marker, Time),
        (What::Base, Creep),
        (What::Base, Load),
        (What::CameraMount, Nothing),
        (What::CameraMount, Time),
        (What::CameraMount, Creep),
        (What::Image, Nothing),
        (What::Focal, Time),
        (What::Focal, Creep),
        (What::Board, Nothing),
        (What::Mirror, Nothing),
    ];
    for n in (0..scene.nodes()).filter(|&n| scene.relevant[n] && scene.moves(n)) {
        kinds.push((What::Joint, Joint(n)));
        kinds.push((What::Joint, Both(n)));
        kinds.push((What::CameraMount, Joint(n)));
    }
    kinds.into_iter().map(|(what, on)| Box::new(FreeForm::new(what, on, scene)) as Box<dyn Effect>).collect()
}

#[cfg(test)]
mod tests {
    use super::{TIME_KNOTS, hats, hats_at, stop};

    #[test]
    fn hats_sum_to_one_and_follow_what_warms_up() {
        let time_s: Vec<f64> = (0..200).map(|k| 10.0 * k as f64).collect();
        let error = |hats: Vec<Vec<f64>>| {
            let warm = |t: f64| (-t / 100.0).exp();
            // The value at each knot is the function's there: where its hat is highest.
            let at = |hat: &Vec<f64>| {
                hat.iter().zip(&time_s).max_by(|a, b| a.0.total_cmp(b.0)).map_or(0.0, |b| warm(*b.1))
            };
            let values: Vec<f64> = hats.iter().map(at).collect();
            let off = |k: usize| {
                let all: f64 = hats.iter().map(|h| h[k]).sum();
                assert!((all - 1.0).abs() < 1e-12, "{k}: {all}");
                let fit: f64 = hats.iter().zip(&values).map(|(h, v)| h[k] * v).sum();
                (fit - warm(time_s[k])).abs()
            };
            (0..time_s.len()).map(off).fold(0.0, f64::max)
        };
        let (early, even) = (error(hats_at(&time_s, &TIME_KNOTS)), error(hats(&time_s, TIME_KNOTS.len())));
        assert!(early < 0.08 && even > 0.2, "{early} {even}");
    }

    #[test]
    fn a_stop_drags_its_slack_along_and_remembers_the_way() {
        // Forth by ten reaches, back by one: the slack is left half taken up; back by ten more: on the other side.
        let told = stop(0.0, &[0.0, 10.0, 9.0, -1.0], 1.0);
        assert_eq!(told, vec![0.0, 1.0, 0.0, -1.0]);
    }
}
