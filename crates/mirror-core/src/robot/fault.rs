//! What can be wrong with a robot's description, by name.

/// A robot model that cannot be used: what is wrong with it, where, and the fix.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelFault {
    /// The file cannot be read.
    #[error("robot model {path}: {reason}; needed a readable URDF file in UTF-8")]
    File {
        /// The file's path.
        path: String,
        /// What the operating system said.
        reason: String,
    },
    /// The text is no well-formed XML, or no URDF.
    #[error("robot model is not URDF (at byte {at_byte}): {reason}")]
    NotUrdf {
        /// Where in the text.
        at_byte: u64,
        /// What was found, and what was required.
        reason: String,
    },
    /// An element lacks a required part, or contains something that cannot be read.
    #[error("robot model, {element}: {reason}")]
    Element {
        /// The link or joint, by name.
        element: String,
        /// What was found, and what was required.
        reason: String,
    },
    /// The file describes no links.
    #[error(
        "robot model has no <link>, so that there is no robot in it; if it is a xacro file, expand it first (xacro robot.xacro > \
         robot.urdf); if it was expanded from a xacro file that only defines macros, expand the file that uses them"
    )]
    NoLinks,
    /// Two links, or two joints, of one name.
    #[error("robot model: two {kind}s are named {name:?}; give each its own name")]
    DuplicateName {
        /// `link` or `joint`.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A joint names a link that the model does not have.
    #[error("robot model, joint {joint:?}: its {role} link {link:?} does not exist; {}", suggestion(.nearest))]
    UnknownLink {
        /// The joint.
        joint: String,
        /// `parent` or `child`.
        role: &'static str,
        /// The name that was got.
        link: String,
        /// The valid names nearest to it.
        nearest: Vec<String>,
    },
    /// A link is the child of two joints.
    #[error(
        "robot model, link {link:?} has two parents, by joints {first:?} and {second:?}; a robot must be a tree: \
         remove one of the joints (a closed loop of links cannot be modelled)"
    )]
    TwoParents {
        /// The link.
        link: String,
        /// One joint above it.
        first: String,
        /// The other.
        second: String,
    },
    /// Several links have no parent.
    #[error("robot model has {} root links ({}); connect them by joints so that one is left", .roots.len(), .roots.join(", "))]
    SeveralRoots {
        /// The links without a parent.
        roots: Vec<String>,
    },
    /// Joints that form a loop.
    #[error("robot model: joints {} form a loop; a robot must be a tree: remove one of them", .joints.join(" → "))]
    Loop {
        /// The joints, in order.
        joints: Vec<String>,
    },
    /// A joint whose axis has no direction.
    #[error(
        "robot model, joint {joint:?}: its axis ({x}, {y}, {z}) has no direction; give <axis xyz=\"…\"/> a length above 0"
    )]
    ZeroAxis {
        /// The joint.
        joint: String,
        /// x of the axis.
        x: f64,
        /// y.
        y: f64,
        /// z.
        z: f64,
    },
    /// A number that is not finite, or outside the range that makes sense.
    #[error("robot model, {element}: {quantity} is {got}, needed {needed}")]
    Number {
        /// The link or joint, by name.
        element: String,
        /// Which number.
        quantity: &'static str,
        /// What was got.
        got: String,
        /// What was needed.
        needed: &'static str,
    },
    /// A joint of a type with more than one degree of freedom, or of no known type.
    #[error(
        "robot model, joint {joint:?}: type {got:?} is not supported; use revolute, continuous, prismatic or fixed \
         (a floating or planar base: make it fixed, the sessions' root link stands still; a spherical joint: three \
         revolute joints in a row)"
    )]
    UnsupportedJoint {
        /// The joint.
        joint: String,
        /// Its type.
        got: String,
    },
    /// A joint mimics one that does not exist, or that does not move.
    #[error("robot model, joint {joint:?} mimics {mimicked:?}, which {reason}; {}", suggestion(.nearest))]
    MimicTarget {
        /// The joint that mimics.
        joint: String,
        /// The one that it names.
        mimicked: String,
        /// What is wrong with it.
        reason: &'static str,
        /// The valid names nearest to it.
        nearest: Vec<String>,
    },
    /// Joints that mimic each other in a circle.
    #[error("robot model: joints {} mimic each other in a circle; one must move by itself: remove its <mimic>", .joints.join(" → "))]
    MimicCycle {
        /// The joints, in order.
        joints: Vec<String>,
    },
    /// A link or joint that the robot does not have.
    #[error("the robot has no {kind} {got:?}; {}", suggestion(.nearest))]
    UnknownName {
        /// `link`, `joint` or `movable joint`.
        kind: &'static str,
        /// The name that was got.
        got: String,
        /// The valid names nearest to it.
        nearest: Vec<String>,
    },
}

/// How many valid names an error lists.
const SUGGESTIONS: usize = 5;

/// The valid names nearest to a wrong one, best first.
pub(super) fn nearest<'a>(wrong: &str, valid: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut scored: Vec<(f64, &str)> =
        valid.map(|name| (strsim::jaro_winkler(&wrong.to_lowercase(), &name.to_lowercase()), name)).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.into_iter().take(SUGGESTIONS).map(|(_, name)| name.to_owned()).collect()
}

fn suggestion(nearest: &[String]) -> String {
    if nearest.is_empty() {
        "there are none".to_owned()
    } else {
        format!("the nearest names are {}", nearest.join(", "))
    }
}
