//! Mistakes without a public name are set apart: their place is reported, and no cause.

use super::changes::settle_zero;
use super::lost;
use super::mistake::Mistake;
use super::spoilt::{Step, node_of};
use super::undone::Undone;
use crate::error::Result;

impl Undone {
    /// Handles a mistake without a public name: a step is undone; an unrelated column's positions are no longer used.
    pub(super) fn set_apart(&mut self, mistake: &Mistake) -> Result<()> {
        match *mistake {
            Mistake::ColumnLost { joint, ref rows } => {
                let found = lost::lost(self, joint, rows)?;
                if let Some(frame) = found.as_ref().and_then(|found| found.1) {
                    self.problem.unknown_frame = Some(frame);
                }
                self.lost = found.map(|found| found.0);
                // Everything that the joint moves has an unknown error: no slips or false observations can be told.
                self.unsettled = true;
                Ok(())
            }
            Mistake::ZeroLost { joint, first, offset } => {
                let Some(node) = node_of(&self.problem, joint) else { return Ok(()) };
                let first_frame = self.problem.frame_numbers[first];
                let as_logged = self.problem.clone();
                let multiplier = as_logged.scene.body.nodes[node].command.1;
                let offset = settle_zero(&as_logged, node, first, multiplier * offset)? / multiplier;
                self.undo(&Mistake::ZeroLost { joint, first, offset }, 0.0)?;
                self.step = Some((Step { node, first_frame, offset }, as_logged));
                Ok(())
            }
            _ => self.undo(mistake, 0.0),
        }
    }
}
