//! From URDF text to a validated robot.

use super::fault::ModelFault;
use super::joint::{Joint, JointKind, Limits};
use super::model::{Link, Robot};
use super::tidy::{MOST_BYTES, tidy};
use super::tree::{self, NamedJoint};
use crate::error::Result;
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use std::path::Path;

/// Largest coordinate of an origin or a centre of mass, m: beyond it the unit is another, mm most likely.
const LONGEST_M: f64 = 50.0;
/// Largest angle of an origin, rad: a whole turn, and what rounding adds. Beyond it these are degrees.
const LARGEST_ANGLE: f64 = 1.001 * core::f64::consts::TAU;
/// Largest coordinate of an axis, whose length has no meaning.
const LARGEST_AXIS: f64 = 1e6;
/// Largest mass of a link, kg.
const HEAVIEST_KG: f64 = 1e9;
/// Largest factor or offset of a mimic joint.
const LARGEST_MIMIC: f64 = 1e6;
/// Shortest axis that still has a direction.
const SHORTEST_AXIS: f64 = 1e-9;

impl Robot {
    /// Reads a robot from URDF text.
    ///
    /// Takes any tree of revolute, continuous, prismatic, fixed and mimic joints. Pictures, collision shapes,
    /// transmissions, simulator and xacro tags are ignored; links may lack an inertial, and then have no mass.
    ///
    /// # Errors
    /// A [`ModelFault`] that names the link or joint, what was got and the fix.
    pub fn from_urdf_str(text: &str) -> Result<Self> {
        let tidied = tidy(text)?;
        let urdf = urdf_rs::read_from_string(&tidied).map_err(|e| ModelFault::Element {
            element: "some link or joint".to_owned(),
            reason: e.to_string(),
        })?;
        let links = urdf.links.iter().map(link).collect::<core::result::Result<Vec<_>, _>>()?;
        let joints = urdf.joints.iter().map(joint).collect::<core::result::Result<Vec<_>, _>>()?;
        Ok(tree::grow(urdf.name, links, joints)?)
    }

    /// Reads a robot from a URDF file.
    ///
    /// # Errors
    /// [`ModelFault::File`] where it cannot be read or is no regular file (a pipe would be waited for), else as
    /// [`Robot::from_urdf_str`].
    pub fn from_urdf_file(path: &Path) -> Result<Self> {
        let fault = |reason: String| ModelFault::File { path: path.display().to_string(), reason };
        let kind = std::fs::metadata(path).map_err(|e| fault(e.to_string()))?;
        if !kind.is_file() || kind.len() > MOST_BYTES as u64 {
            return Err(fault(format!("needed a regular file of at most {MOST_BYTES} bytes")).into());
        }
        let text = std::fs::read_to_string(path).map_err(|e| fault(e.to_string()))?;
        Self::from_urdf_str(&text)
    }
}

fn within(
    element: &str,
    quantity: &'static str,
    value: f64,
    bound: f64,
    needed: &'static str,
) -> core::result::Result<f64, ModelFault> {
    if value.is_finite() && value.abs() <= bound {
        return Ok(value);
    }
    Err(ModelFault::Number { element: element.to_owned(), quantity, got: value.to_string(), needed })
}

fn pose(element: &str, origin: &urdf_rs::Pose) -> core::result::Result<Isometry3<f64>, ModelFault> {
    for x in *origin.xyz {
        within(
            element,
            "a coordinate of its origin",
            x,
            LONGEST_M,
            "a length in m, at most 50: is it in mm?",
        )?;
    }
    for x in *origin.rpy {
        within(
            element,
            "an angle of its origin",
            x,
            LARGEST_ANGLE,
            "an angle in rad, at most a whole turn: is it in degrees?",
        )?;
    }
    let ([x, y, z], [roll, pitch, yaw]) = (*origin.xyz, *origin.rpy);
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}

fn link(urdf: &urdf_rs::Link) -> core::result::Result<Link, ModelFault> {
    let element = format!("link {:?}", urdf.name);
    let mass_kg = urdf.inertial.mass.value;
    within(&element, "its mass", mass_kg, HEAVIEST_KG, "a finite mass in kg, at least 0 and at most 1e9")?;
    if mass_kg < 0.0 {
        return Err(ModelFault::Number {
            element,
            quantity: "its mass",
            got: mass_kg.to_string(),
            needed: "a mass in kg of at least 0",
        });
    }
    let com = pose(&element, &urdf.inertial.origin)?;
    Ok(Link {
        name: urdf.name.clone(),
        mass_kg,
        com_in_link_m: Point3::from(com.translation.vector),
        parent_joint: None,
    })
}

fn axis(name: &str, urdf: &urdf_rs::Joint) -> core::result::Result<Unit<Vector3<f64>>, ModelFault> {
    let element = format!("joint {name:?}");
    let [x, y, z] = *urdf.axis.xyz;
    for value in [x, y, z] {
        within(&element, "a coordinate of its axis", value, LARGEST_AXIS, "a finite number, at most 1e6")?;
    }
    Unit::try_new(Vector3::new(x, y, z), SHORTEST_AXIS).ok_or_else(|| ModelFault::ZeroAxis {
        joint: name.to_owned(),
        x,
        y,
        z,
    })
}

fn limits(
    element: &str,
    kind: JointKind,
    limit: &urdf_rs::JointLimit,
) -> core::result::Result<Option<Limits>, ModelFault> {
    if matches!(kind, JointKind::Fixed | JointKind::Continuous) {
        return Ok(None);
    }
    let (lower, upper) = (limit.lower, limit.upper);
    if lower.is_nan() || upper.is_nan() || lower > upper || lower == upper && lower.is_infinite() {
        return Err(ModelFault::Number {
            element: element.to_owned(),
            quantity: "its range",
            got: format!("lower {lower}, upper {upper}"),
            needed: "lower ≤ upper",
        });
    }
    // No <limit>, or one without a range, reads as 0 to 0: a joint that cannot move is written as a fixed one, or locked elsewhere.
    let given = lower < upper || lower == upper && lower != 0.0;
    Ok(given.then_some(Limits { lower, upper }))
}

fn joint(urdf: &urdf_rs::Joint) -> core::result::Result<NamedJoint, ModelFault> {
    let name = urdf.name.clone();
    let element = format!("joint {name:?}");
    let kind = match urdf.joint_type {
        urdf_rs::JointType::Revolute => JointKind::Revolute,
        urdf_rs::JointType::Continuous => JointKind::Continuous,
        urdf_rs::JointType::Prismatic => JointKind::Prismatic,
        urdf_rs::JointType::Fixed => JointKind::Fixed,
        ref other => {
            return Err(ModelFault::UnsupportedJoint {
                joint: name,
                got: format!("{other:?}").to_lowercase(),
            });
        }
    };
    let mimic = match urdf.mimic.as_ref().filter(|_| kind.moves()) {
        None => None,
        Some(mimic) => {
            let multiplier = mimic.multiplier.unwrap_or(1.0);
            let offset = mimic.offset.unwrap_or(0.0);
            let needed = "a finite number, at most 1e6";
            within(&element, "the multiplier of its <mimic>", multiplier, LARGEST_MIMIC, needed)?;
            within(&element, "the offset of its <mimic>", offset, LARGEST_MIMIC, needed)?;
            Some((mimic.joint.clone(), multiplier, offset))
        }
    };
    Ok(NamedJoint {
        joint: Joint {
            kind,
            parent_link: 0,
            child_link: 0,
            parent_from_joint: pose(&element, &urdf.origin)?,
            // A fixed joint's axis is often written as 0 0 0.
            axis: if kind.moves() { axis(&name, urdf)? } else { Vector3::x_axis() },
            limits: limits(&element, kind, &urdf.limit)?,
            effort_limit: Some(urdf.limit.effort).filter(|effort| effort.is_finite() && *effort > 0.0),
            mimic: None,
            drive: None,
            name,
        },
        parent: urdf.parent.link.clone(),
        child: urdf.child.link.clone(),
        mimic,
    })
}
