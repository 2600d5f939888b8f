//! The vocabulary of effects: one file for each effect, one line for each here.
//!
//! An effect has a name, the places where it can occur, its parameters with their prior scales, and its columns:
//! which elementary change ([`Atom`]) each parameter makes, and how strongly in each frame. A new effect is one file
//! and one line in [`vocabulary`].

pub(super) mod about;
mod axis_tilt;
mod backlash;
mod board_mount;
mod board_scale;
pub(super) mod camera_center;
mod camera_focal;
mod camera_mount;
mod column_bending;
mod drift;
pub(super) mod everywhere;
mod gear_eccentricity;
mod gear_ratio;
pub(super) mod hypothesis;
mod joint_compliance;
mod joint_coupling;
mod joint_offset;
mod lens_distortion;
mod link_bending;
mod link_length;
mod link_twist;
mod marker_image;
mod marker_mount;
mod mirror_curvature;
mod mirror_glass;
pub(super) mod own;
pub(super) mod registry;
mod stiction;
mod telescopes;
mod tilt_play;
mod transverse_compliance;

pub(crate) use stiction::Stiction;

use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::model::solver::NEGLIGIBLE;
use about::About;

use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::Prior;

/// Factors on a discrete unknown (a friction torque) that are tried once the cause is found.
const VARIANT_FACTORS: [f64; 8] = [0.7, 0.8, 0.88, 0.95, 1.06, 1.14, 1.25, 1.4];

/// Where a cause can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Place {
    Joint(NodeId),
    /// The first joint's error depends on the second's position.
    JointPair(NodeId, NodeId),
    /// The body that a joint moves; none is the base.
    Link(Option<NodeId>),
    Marker(usize),
    Camera,
    Board,
    Mirror,
}

impl Place {
    /// The place in the public vocabulary: `joint:J`, `link:L`, `marker:M`, `camera`, ….
    pub fn name(self, scene: &Scene) -> String {
        let joint = |n: NodeId| format!("joint:{}", scene.body.nodes[n].joint);
        match self {
            Self::Joint(n) => joint(n),
            Self::JointPair(j, k) => format!("{}<-{}", joint(j), joint(k)),
            Self::Link(n) => format!("link:{}", scene.body.node_link_name(n)),
            Self::Marker(m) => format!("marker:{}", scene.marker_names[m]),
            Self::Camera => "camera".into(),
            Self::Board => "board".into(),
            Self::Mirror => "mirror".into(),
        }
    }

    /// The joint of the place, or the one that moves its link; none of the base, a marker, camera, board and mirror.
    pub fn node(self) -> Option<NodeId> {
        match self {
            Self::Joint(n) | Self::JointPair(n, _) => Some(n),
            Self::Link(n) => n,
            _ => None,
        }
    }
}

/// The variable in which the law of an effect may differ from the textbook's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LawFreedom {
    /// None: the law is geometry.
    Exact,
    /// In the joint's load: no spring is linear.
    Load,
    /// In load and direction: play and friction.
    LoadAndDirection,
    /// In the moment on the link.
    Moment,
    /// In how it grows with a column's extension.
    Extension,
    /// In time.
    Time,
}

/// Whom a cause concerns: the `kind` of the public format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Concern {
    /// The robot itself.
    Robot,
    /// Mounts by hand: board, camera, markers.
    Setup,
    /// The camera's lens and sensor.
    Camera,
    /// The mirror.
    Mirror,
}

impl Concern {
    /// Its name in the public format.
    pub fn word(self) -> &'static str {
        match self {
            Self::Robot => "robot",
            Self::Setup => "setup",
            Self::Camera => "camera",
            Self::Mirror => "mirror",
        }
    }
}

/// One kind of cause. Effects are linear in their parameters unless they implement [`Effect::deform`].
pub(crate) trait Effect: Send + Sync {
    /// Its name in the public vocabulary.
    fn name(&self) -> &str;

    /// The names of its parameters, in order, each with its unit as suffix.
    fn parameters(&self) -> Vec<String>;

    /// Where it can be in this scene.
    fn places(&self, scene: &Scene) -> Vec<Place>;

    /// Standard deviation of the prior of each parameter at a place: the size that such an error commonly has.
    fn prior_std(&self, scene: &Scene, place: Place) -> Vec<f64>;

    /// A discrete unknown of the effect (for example a friction torque): the values that are tried. Most effects
    /// have none.
    fn variants(&self, _scene: &Scene, _place: Place) -> Vec<f64> {
        vec![0.0]
    }

    /// Whether the discrete unknown is the scale of the prior: a factor of its standard deviations, which is learned.
    fn is_scaled_by_variant(&self) -> bool {
        false
    }

    /// A value of the discrete unknown that differs from this one only where the effect has a size: with these parameters.
    fn variant_beside(
        &self,
        _scene: &Scene,
        _place: Place,
        _variant: f64,
        _parameters: &[f64],
    ) -> Option<f64> {
        None
    }

    /// Values of the discrete unknown near one that was found, among which it is refined.
    fn variants_near(&self, _scene: &Scene, _place: Place, variant: f64) -> Vec<f64> {
        if variant.is_finite() && variant != 0.0 {
            VARIANT_FACTORS.map(|factor| factor * variant).into()
        } else {
            Vec::new()
        }
    }

    /// Each parameter's column, at the given parameters.
    fn columns(&self, scene: &Scene, place: Place, variant: f64, parameters: &[f64]) -> Vec<Column>;

    /// Adds the effect to a deformation.
    fn deform(
        &self,
        scene: &Scene,
        place: Place,
        variant: f64,
        parameters: &[f64],
        deformation: &mut Deformation,
    ) {
        for (column, value) in self.columns(scene, place, variant, parameters).iter().zip(parameters) {
            column.add(*value, scene, deformation);
        }
    }

    /// Whether none of its parameters can be negative.
    fn is_positive(&self) -> bool {
        false
    }

    /// Whether gravity's loads must be computed again when the effect is large: its basis depends on the actual
    /// posture.
    fn depends_on_load(&self) -> bool {
        false
    }

    /// Whether it yields in proportion to a load. Of play and of friction the load's sign alone counts, and with gravity in another
    /// direction that sign is any function of the posture.
    fn is_spring(&self) -> bool {
        self.depends_on_load() && self.law_freedom() != LawFreedom::LoadAndDirection
    }

    /// Whether in this session it equals a simpler effect, so that no posture separates the two.
    fn is_like_a_simpler_one(&self, _scene: &Scene, _place: Place, _variant: f64) -> bool {
        false
    }

    /// Log prior probability against the other effects, which are all equally probable.
    fn log_prior(&self) -> Prior {
        0.0
    }

    /// Relative uncertainty of the parameter because real joints obey the law only approximately.
    fn law_uncertainty(&self) -> f64 {
        0.0
    }

    /// The variable in which its law may differ from the textbook's.
    fn law_freedom(&self) -> LawFreedom {
        LawFreedom::Exact
    }

    /// Whether only robots with a telescopic column can have it.
    fn is_of_columns(&self) -> bool {
        false
    }

    /// Whether every joint has a little of it by manufacture; then a small size is no cause in addition to
    /// `geometry`.
    fn is_tolerance(&self) -> bool {
        false
    }

    /// Whether it can also be far larger than the prior says: where another gear box or part was built in.
    fn may_be_of_another_part(&self) -> bool {
        false
    }

    /// The simpler effect that it is equivalent to at these parameters, and that effect's parameters: where its own part is 0.
    fn comes_down_to(&self, _parameters: &[f64]) -> Option<(&'static str, Vec<f64>)> {
        None
    }

    /// Whether it is of the detection of markers, not of what is seen: it is small beside a gross mistake, and no piece of an unknown
    /// law.
    fn is_of_detection(&self) -> bool {
        false
    }

    /// Whether it is known in the session's own frames only.
    fn is_tabulated(&self) -> bool {
        false
    }

    /// On what it depends, if it is an error without a law.
    fn depends_on(&self) -> Option<&DependsOn> {
        None
    }

    /// Whom it concerns.
    fn concern(&self, place: Place) -> Concern {
        match place {
            Place::Joint(_) | Place::JointPair(..) | Place::Link(_) => Concern::Robot,
            Place::Marker(_) | Place::Board => Concern::Setup,
            Place::Camera => Concern::Camera,
            Place::Mirror => Concern::Mirror,
        }
    }

    /// What happens, in a sentence for the reader.
    fn words(&self) -> &str;

    /// Its description for readers and files; every effect of the vocabulary has one.
    fn about(&self) -> Option<About> {
        None
    }
}

/// All effects of `effects.md` except the groups (`geometry`) and faults of the data (`pairing`), which have no
/// single place.
pub(crate) fn vocabulary() -> Vec<Box<dyn Effect>> {
    vec![
        Box::new(joint_offset::JointOffset),
        Box::new(gear_ratio::GearRatio),
        Box::new(gear_eccentricity::GearEccentricity),
        Box::new(backlash::Backlash),
        Box::new(Stiction { droops: true }),
        Box::new(joint_compliance::JointCompliance),
        Box::new(link_bending::LinkBending),
        Box::new(column_bending::ColumnBending),
        Box::new(tilt_play::TiltPlay { direction: 0 }),
        Box::new(tilt_play::TiltPlay { direction: 1 }),
        Box::new(transverse_compliance::TransverseCompliance),
        Box::new(link_length::LinkLength),
        Box::new(link_twist::LinkTwist),
        Box::new(axis_tilt::AxisTilt),
        Box::new(joint_coupling::JointCoupling),
        Box::new(drift::Drift),
        Box::new(marker_mount::MarkerMount),
        Box::new(marker_image::MarkerImage),
        Box::new(board_mount::BoardMount),
        Box::new(camera_mount::CameraMount),
        Box::new(camera_focal::CameraFocal),
        Box::new(camera_center::CameraCenter),
        Box::new(lens_distortion::LensDistortion),
        Box::new(board_scale::BoardScale),
        Box::new(mirror_glass::MirrorGlass),
        Box::new(mirror_curvature::MirrorCurvature),
    ]
}

/// Joints whose position the observations show, as places.
fn joints(scene: &Scene) -> Vec<Place> {
    (0..scene.nodes()).filter(|&n| scene.is_seen(n)).map(Place::Joint).collect()
}

/// Those that were commanded to more than one position.
fn moving_joints(scene: &Scene) -> Vec<Place> {
    (0..scene.nodes()).filter(|&n| scene.is_seen(n) && scene.moves(n)).map(Place::Joint).collect()
}

/// A common size of an angular error at a joint, rad (about 3°); of a prismatic joint the same displacement at the reach, m.
pub(crate) fn joint_error(scene: &Scene, node: NodeId, typical_rad: f64) -> f64 {
    if scene.body.nodes[node].prismatic { typical_rad * scene.reach_m.max(0.05) } else { typical_rad }
}

/// Names of parameters. That of a joint's position has the suffix `rad`, as in the vocabulary; sliding joints share the names.
fn named(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| (*n).to_owned()).collect()
}

/// A common size of a place error, m: of a small robot some millimetres, of a large one two percent of its reach.
fn place_error_m(scene: &Scene) -> f64 {
    (0.02 * scene.reach_m).clamp(0.004, 0.012)
}

/// Those on which gravity pulls.
fn loaded_joints(scene: &Scene) -> Vec<Place> {
    (0..scene.nodes())
        .filter(|&n| scene.is_seen(n) && scene.largest_torque(n) > NEGLIGIBLE)
        .map(Place::Joint)
        .collect()
}
