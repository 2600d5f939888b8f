//! The chain of joints between two links.

use super::model::Robot;
use crate::error::Result;

/// Which way a chain goes through a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Direction {
    /// From the child to the parent: the joint's motion enters inverted.
    Up,
    /// From the parent to the child.
    Down,
}

impl Direction {
    /// −1 up, +1 down: the sign with which the joint's motion enters `a_from_b`.
    pub fn sign(self) -> f64 {
        match self {
            Self::Up => -1.0,
            Self::Down => 1.0,
        }
    }
}

/// One joint of a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ChainStep {
    /// Index of the joint; fixed joints are steps too.
    pub joint: usize,
    /// Which way it is passed.
    pub direction: Direction,
}

/// The joints between two links, in order: up from link a to the link above both, then down to link b.
///
/// `a_from_b = Π` over the steps of `parent_from_child` (down) or its inverse (up).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chain {
    /// Where it starts.
    pub link_a: usize,
    /// Where it ends.
    pub link_b: usize,
    /// The link above both.
    pub top_link: usize,
    /// The joints in order from a to b.
    pub steps: Vec<ChainStep>,
}

impl Robot {
    /// The joints between two links, movable and fixed, in order from link a to link b.
    ///
    /// # Errors
    /// An index that is no link.
    pub fn chain(&self, link_a: usize, link_b: usize) -> Result<Chain> {
        self.check_link("start of the chain", link_a)?;
        self.check_link("end of the chain", link_b)?;
        let mut steps = Vec::new();
        let mut top = link_a;
        while !self.is_below(link_b, top) {
            let Some(joint) = self.links[top].parent_joint else { break };
            steps.push(ChainStep { joint, direction: Direction::Up });
            top = self.joints[joint].parent_link;
        }
        let turn = steps.len();
        let mut at = link_b;
        while at != top {
            let Some(joint) = self.links[at].parent_joint else { break };
            steps.push(ChainStep { joint, direction: Direction::Down });
            at = self.joints[joint].parent_link;
        }
        steps[turn..].reverse();
        Ok(Chain { link_a, link_b, top_link: top, steps })
    }
}
