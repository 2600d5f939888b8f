//! Where the links of a robot bend, and about what, for those who write `link_bending` into another simulator's model.

use crate::diagnose::data::recording::Recording;
use crate::diagnose::model::body::Node;
use crate::diagnose::model::problem::Problem;
use crate::error::Result;
use crate::robot::Robot;
use nalgebra::Vector3;

/// The hinges that bend a link as `link_bending` does, in the link's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkBend {
    /// The link's URDF name.
    pub link: String,
    /// The place at which it bends, m: the middle of the line to what it carries next, or to the farthest marker on it.
    pub middle_m: Vector3<f64>,
    /// Unit axes about which it bends: two across that line, or all three of a link without a direction.
    pub axes: Vec<Vector3<f64>>,
}

/// Where each link bends that moves a marker or a board of the recording relative to what observes it. A column of
/// sliding joints bends in the middle of its extended part, which differs in each posture: here it is retracted.
///
/// # Errors
/// As [`crate::diagnose::diagnose`].
pub fn link_bends(robot: &Robot, recording: &Recording) -> Result<Vec<LinkBend>> {
    let scene = Problem::new(robot, recording)?.scene;
    let nodes = scene.body.nodes.iter().zip(&scene.relevant).filter(|(_, relevant)| **relevant);
    Ok(nodes
        .map(|(node, _)| LinkBend { link: node.link.clone(), middle_m: node.bend_pivot, axes: axes(node) })
        .collect())
}

/// The components of gravity's moment that bend a link, as axes: across the link, or all where it has no direction.
fn axes(node: &Node) -> Vec<Vector3<f64>> {
    match node.long_axis {
        None => (0..3).map(|k| Vector3::ith(k, 1.0)).collect(),
        Some(along) => {
            let first = along.cross(&Vector3::ith(along.iamin(), 1.0)).normalize();
            vec![first, along.cross(&first)]
        }
    }
}
