//! The verdict in one sentence.

use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::diagnosis::{Cause, Gap, Verdict, Where};
use crate::diagnose::likelihood::probability::tempered;
use crate::diagnose::principles::{LEAST_LOG_ODDS, SEVERAL_CAUSES, WORTH_NAMING};

/// The verdict, its reasons, and the gap's sizes; `in_picture_only` are causes that are not named for that.
pub(crate) fn sentence(
    verdict: Verdict,
    causes: &[Cause],
    places: &[Where],
    gap: &Gap,
    in_picture_only: &[(String, String)],
) -> String {
    let sizes = match (gap.in_pixels(), [gap.before_m, gap.after_m, gap.noise_floor_m]) {
        (Some([before, after, floor]), _) => {
            format!("{before:.2} px before, {after:.2} px after, {floor:.2} px noise floor")
        }
        (None, [Some(before), Some(after), Some(floor)]) => format!(
            "{:.2} mm before, {:.2} mm after, {:.2} mm noise floor",
            before * 1e3,
            after * 1e3,
            floor * 1e3
        ),
        (None, [None, Some(after), Some(floor)]) => format!(
            "before nothing could be compared, {:.2} mm after, {:.2} mm noise floor",
            after * 1e3,
            floor * 1e3
        ),
        (None, _) => "no gap could be computed".to_owned(),
    };
    // Of three postures none is held out: what few are left would not show an unknown frame or mount.
    let on = if gap.is_told() && gap.held_out_postures == 0 {
        "the postures that were fitted, which are too few to hold some out"
    } else {
        "postures that the fit did not see"
    };
    let sizes = format!("{sizes}, on {on}");
    // A place that slipped, and came back, is named once.
    let mut names: Vec<String> = Vec::new();
    // What is improbable with all its alternatives stays in the list of causes, and explains nothing.
    let with_rivals = |c: &Cause| c.probability + c.alternatives.iter().map(|a| a.probability).sum::<f64>();
    let likely: Vec<&Cause> = causes.iter().filter(|c| with_rivals(c) >= WORTH_NAMING).collect();
    let causes = if likely.is_empty() { causes.iter().collect() } else { likely };
    for told in causes.iter().map(|cause| name(cause)) {
        if !names.contains(&told) {
            names.push(told);
        }
    }
    let left = unexplained_place(places);
    match verdict {
        Verdict::None if !in_picture_only.is_empty() => {
            let names: Vec<String> =
                in_picture_only.iter().map(|(effect, at)| of_place(effect, at)).collect();
            format!(
                "No cause is named: {} would make the gap smaller in the picture, but no smaller in metres ({sizes}).",
                listed(&names)
            )
        }
        Verdict::None => format!(
            "Nothing is wrong that these postures could show: the model predicts to the noise floor ({sizes})."
        ),
        Verdict::Explained => format!("The gap is explained by {} ({sizes}).", listed(&names)),
        Verdict::Partial if !gap.is_told() => format!(
            "Named: {}. No marker was left to predict, so it is not known how far this closes the gap.",
            listed(&names)
        ),
        Verdict::Partial => {
            let explain =
                if causes.len() == 1 && causes[0].effect != "geometry" { "explains" } else { "explain" };
            format!(
                "{} {explain} a part of the gap ({sizes}); what is left lies {}.",
                capitalised(&listed(&names)),
                where_and_on_what(left)
            )
        }
        Verdict::Insufficient => "These data are too few to say anything.".into(),
        Verdict::Unknown => format!(
            "There is a gap that no effect of the vocabulary explains; it lies {} ({sizes}).",
            where_and_on_what(left)
        ),
    }
}

/// The place of the unexplained part: that of a free-form error; otherwise no single place, or the optics if only
/// the corners' remainder is evidence.
fn unexplained_place(places: &[Where]) -> Option<&Where> {
    let at = |name: &str| places.iter().find(|w| w.at == name);
    places.iter().find(|w| w.depends_on.is_some()).or_else(|| at(Where::NOWHERE)).or_else(|| at("camera"))
}

/// `effect at place`, or, if it is less probable than a cause at the minimum odds against none, `effect or other
/// effect at place`.
fn name(cause: &Cause) -> String {
    let rival = cause.alternatives.first().filter(|r| r.probability >= WORTH_NAMING);
    let own = of_place(&cause.effect, &cause.at);
    match rival.filter(|_| cause.probability < tempered(LEAST_LOG_ODDS)) {
        None => own,
        Some(rival) if rival.at == cause.at && !cause.at.contains("<-") => {
            of_place(&format!("{} or {}", cause.effect, rival.effect), &cause.at)
        }
        Some(rival) if rival.effect == cause.effect && !cause.at.contains("<-") => {
            format!("{own} or {}{}", article(&rival.at), rival.at)
        }
        Some(rival) => format!("{own} or {}", of_place(&rival.effect, &rival.at)),
    }
}

fn of_place(effect: &str, at: &str) -> String {
    match (effect, at.split_once("<-")) {
        ("geometry", _) => "many small errors of the robot's geometry".into(),
        ("pairing", _) => "rows of the data that contain the measurement of other rows".into(),
        ("points_mirrored", _) => "measured points in a left-handed frame".into(),
        ("marker_parent", Some((marker, link))) => format!("{marker} being fixed to {link}"),
        (effect, Some((joint, other))) if joint.ends_with("<->") || other.starts_with('>') => {
            format!("{} of {} and {}", effect.replace('_', " "), joint, other.trim_start_matches('>'))
        }
        (effect, Some((joint, other))) => format!("{} of {joint} with {other}", effect.replace('_', " ")),
        (effect, None) => format!("{} at {}{at}", effect.replace('_', " "), article(at)),
    }
}

/// `a`, `a and b`, `a, b and c`, `a, b, c and 2 further causes`.
fn listed(names: &[String]) -> String {
    let mut shown: Vec<String> = names.iter().take(SEVERAL_CAUSES).cloned().collect();
    match names.len().saturating_sub(SEVERAL_CAUSES) {
        0 => {}
        1 => shown.extend(names.last().cloned()),
        more => shown.push(format!("{more} further causes")),
    }
    match shown.split_last() {
        None => String::new(),
        Some((last, [])) => last.clone(),
        Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
    }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// `at joint:x and depends on its load`.
fn where_and_on_what(place: Option<&Where>) -> String {
    let Some(place) = place.filter(|p| p.at != Where::NOWHERE) else {
        return "at no single place".into();
    };
    let depends = match &place.depends_on {
        None => String::new(),
        Some(DependsOn::Nothing) => ", the same in every posture".into(),
        Some(DependsOn::Position) => " and depends on its position".into(),
        Some(DependsOn::Load) => " and depends on its load".into(),
        Some(DependsOn::Direction) => " and depends on the direction of its last motion".into(),
        Some(DependsOn::History) => " and depends on the path that it came along".into(),
        Some(DependsOn::Time) => " and depends on time".into(),
        Some(DependsOn::Posture) => " and depends on how gravity pulls at it".into(),
        Some(DependsOn::PositionAnd(joint)) => {
            format!(" and depends on its position and the position of joint:{joint}")
        }
        Some(other) => format!(" and depends on the {other}"),
    };
    format!("at {}{}{depends}", article(&place.at), place.at)
}

/// `the ` before a place of which there is only one.
fn article(at: &str) -> &'static str {
    if matches!(at, "camera" | "board" | "mirror" | "robot") { "the " } else { "" }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::data::diagnosis::Alternative;

    fn place(at: &str, on: DependsOn) -> Where {
        Where { at: at.into(), share: 1.0, depends_on: Some(on) }
    }

    #[test]
    fn what_only_the_picture_shows_is_not_said_to_be_nothing() {
        let told = |shown: &[(String, String)]| sentence(Verdict::None, &[], &[], &Gap::default(), shown);
        assert!(told(&[]).starts_with("Nothing is wrong that these postures could show"));
        let shown = [("gear_eccentricity".to_owned(), "joint:elbow".to_owned())];
        let words =
            "No cause is named: gear eccentricity at joint:elbow would make the gap smaller in the picture";
        assert!(told(&shown).starts_with(words), "{}", told(&shown));
    }

    #[test]
    fn names_are_listed_as_people_list_them() {
        let names: Vec<String> = ["a", "b", "c", "d", "e"].map(String::from).into();
        assert_eq!(listed(&names[..1]), "a");
        assert_eq!(listed(&names[..2]), "a and b");
        assert_eq!(listed(&names[..3]), "a, b and c");
        assert_eq!(listed(&names[..4]), "a, b, c and d");
        assert_eq!(listed(&names), "a, b, c and 2 further causes");
    }

    #[test]
    fn what_cannot_be_told_apart_is_told_together() {
        let told = |probability, effect: &str, at: &str| {
            let alternatives =
                vec![Alternative { effect: effect.into(), at: at.into(), probability: 0.98 - probability }];
            name(&Cause {
                kind: "robot".into(),
                effect: "backlash".into(),
                at: "joint:elbow".into(),
                probability,
                stability: None,
                alternatives,
                parameters: Default::default(),
                words: String::new(),
                rms_shift: 1.0,
                frames: Vec::new(),
                members: Vec::new(),
            })
        };
        assert_eq!(told(0.6, "stiction", "joint:elbow"), "backlash or stiction at joint:elbow");
        assert_eq!(told(0.6, "backlash", "joint:knee"), "backlash at joint:elbow or joint:knee");
        assert_eq!(
            told(0.6, "camera_mount", "camera"),
            "backlash at joint:elbow or camera mount at the camera"
        );
        assert_eq!(told(0.9, "stiction", "joint:elbow"), "backlash at joint:elbow");
    }

    #[test]
    fn what_is_left_at_no_place_is_not_laid_at_a_cause() {
        let cause = Where { at: "robot".into(), share: 0.9, depends_on: None };
        let nowhere = Where { at: "unknown".into(), share: 0.1, depends_on: None };
        let left = unexplained_place(&[cause.clone(), nowhere.clone()]).map(|w| w.at.clone());
        assert_eq!(left.as_deref(), Some("unknown"));
        let found = place("joint:elbow", DependsOn::Load);
        let left = unexplained_place(&[cause, nowhere, found]).map(|w| w.at.clone());
        assert_eq!(left.as_deref(), Some("joint:elbow"));
    }

    #[test]
    fn a_place_says_on_what_it_depends() {
        assert_eq!(
            where_and_on_what(Some(&place("joint:elbow", DependsOn::PositionOf("knee".into())))),
            "at joint:elbow and depends on the position of joint:knee"
        );
        assert_eq!(
            where_and_on_what(Some(&place("marker:hand", DependsOn::Nothing))),
            "at marker:hand, the same in every posture"
        );
        assert_eq!(
            where_and_on_what(Some(&place("camera", DependsOn::Time))),
            "at the camera and depends on time"
        );
        assert_eq!(where_and_on_what(None), "at no single place");
    }
}
