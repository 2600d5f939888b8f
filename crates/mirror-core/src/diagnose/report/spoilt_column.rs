//! The warning for a spoilt column that no effect describes.

use crate::diagnose::prepare::prepared::Prepared;

/// The warning for a joint whose column is unrelated to it, is clipped, or has another zero from a row on. `numbers`: the
/// rows' numbers in the session.
pub(crate) fn column_is_spoilt(prepared: &Prepared, numbers: &[i64]) -> Option<String> {
    let nodes = &prepared.arranged.scene.body.nodes;
    if let Some((step, _)) = prepared.step() {
        let node = &nodes[step.node];
        let far = if node.prismatic {
            format!("{:.1} mm", step.offset * 1e3)
        } else {
            format!("{:.3} rad", step.offset)
        };
        return Some(format!(
            "joint:{} has another zero from row {} on: it is {far} further than its column says (homed again, slipped \
             on its shaft, lost steps); diagnose the rows before and after as two sessions, or record again",
            node.joint, step.first_frame
        ));
    }
    let lost = prepared.lost()?;
    let joint = &nodes[lost.node].joint;
    let rows: Vec<usize> = lost.postures.iter().flat_map(|p| p.0.iter().copied()).collect();
    Some(if rows.len() == numbers.len() {
        format!(
            "the column of joint:{joint} is unrelated to the joint: its error is independent in each posture; check \
             whether the column is another joint's, sorted differently, without signs or empty, and record again"
        )
    } else {
        let first = rows.iter().min().and_then(|&f| numbers.get(f)).copied().unwrap_or_default();
        format!(
            "the column of joint:{joint} is clipped: it stays at its extreme values in {} of {} rows (first in row \
             {first}) while the joint moves on; remove the log's limit and record again",
            rows.len(),
            numbers.len()
        )
    })
}
