//! Shares of the gap by place: what each cause moves, and what is unexplained.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::criteria::cross_validation::{seen_size, size};
use crate::diagnose::data::diagnosis::{Cause, Where};
use crate::diagnose::report::rms_shift::noise_square;

/// Whether mistakes were undone without which nothing of the session as it was given could be compared with the model.
pub(super) fn nothing_was_compared(findings: &Findings<'_>) -> bool {
    let before = size(&findings.before);
    !findings.mistakes.is_empty() && before.told_m().is_none() && before.rms_px.is_none()
}

/// Places by their share of the explained and unexplained squares, the largest first. Mistakes without which nothing could be compared
/// have all of it.
pub(super) fn places(findings: &Findings<'_>, causes: &[Cause]) -> Vec<Where> {
    let mut out: Vec<Where> = Vec::new();
    let whole = |c: &Cause| findings.mistakes.iter().any(|m| m.effect == c.effect && m.at == c.at);
    let unmeasured = nothing_was_compared(findings) && causes.iter().any(whole);
    let square = |c: &Cause| if unmeasured { f64::from(u8::from(whole(c))) } else { c.rms_shift.powi(2) };
    let explained: f64 = causes.iter().map(square).sum();
    let after = seen_size(&findings.after).powi(2);
    let floor = noise_square(&findings.search.problem, findings.search.detector_noise());
    let is_left = findings.unexplained.is_some() && !unmeasured;
    let left = if is_left { (after - floor).max(0.0) } else { 0.0 };
    let total = (explained + left).max(1e-30);
    for cause in causes {
        let share = square(cause) / total;
        match out.iter_mut().find(|w| w.at == cause.at) {
            Some(w) => w.share += share,
            None => out.push(Where { at: cause.at.clone(), share, depends_on: None }),
        }
    }
    if let Some(unexplained) = &findings.unexplained {
        let scene = &findings.search.problem.scene;
        let of_all: f64 = unexplained.places.iter().map(|p| p.shift).sum();
        for place in &unexplained.places {
            let at = place.name(scene);
            let part = if of_all > 0.0 { place.shift / of_all } else { 1.0 };
            let share = part * if explained == 0.0 { 1.0 } else { left / total };
            let depends_on = place.depends_on.clone();
            match out.iter_mut().find(|w| w.at == at) {
                Some(w) => {
                    w.share += share;
                    w.depends_on = w.depends_on.take().or(depends_on);
                }
                None => out.push(Where { at, share, depends_on }),
            }
        }
    }
    out.sort_by(|a, b| b.share.total_cmp(&a.share));
    out
}
