//! Joints that come to rest elsewhere than logged.

use mirror_core::diagnose::Recording;

/// Moves the logged positions of some joints, in each posture by itself, by what `off` draws: posture by posture, and
/// there in the joints' order.
pub fn rest_elsewhere(recording: &mut Recording, joints: &[usize], mut off: impl FnMut() -> f64) {
    let (mut posture, mut errors) = (None, Vec::new());
    for frame in &mut recording.frames {
        if posture.replace(frame.posture) != Some(frame.posture) {
            errors = joints.iter().map(|_| off()).collect();
        }
        joints.iter().zip(&errors).for_each(|(joint, error)| frame.commanded[*joint] += error);
    }
}
