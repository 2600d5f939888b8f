//! The warning for a spoilt column that no effect describes.

use crate::diagnose::prepare::prepared::Prepared;

/// The warning for a joint whose column is unrelated to it, is clipped, or has another zero from a row on. `numbers`: the
/// rows' numbers in the session.
pub(crate) fn column_is_spoilt(prepared: &Prepared, numbers: &[i64]) -> Option<String> {
    let nodes = &prepared.arranged.scene.body.nodes;
    if let Some((step, _)) = prepared.step() {
        let node = &nodes[step.node];
        return Some(format!(
            "joint:{} has another zero from row {} on: its position is {} than its column says (homed again, slipped \
             on its shaft, lost steps); diagnose the rows before and after as two sessions, or record again",
            node.joint,
            step.first_frame,
            by_how_much(step.offset, node.prismatic)
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

/// `0.150 rad larger`, `20.0 mm smaller`.
fn by_how_much(offset: f64, prismatic: bool) -> String {
    let than = if offset < 0.0 { "smaller" } else { "larger" };
    if prismatic {
        format!("{:.1} mm {than}", offset.abs() * 1e3)
    } else {
        format!("{:.3} rad {than}", offset.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::by_how_much;

    #[test]
    fn another_zero_is_told_by_its_side_and_not_by_a_sign() {
        assert_eq!(by_how_much(-0.15, false), "0.150 rad smaller");
        assert_eq!(by_how_much(0.02, true), "20.0 mm larger");
    }
}
