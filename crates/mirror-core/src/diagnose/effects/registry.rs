//! The vocabulary of effects in words, for readers and files; collected from the effects' own files.

use super::about::{PlaceKind, WrittenTo};
use super::{Effect, vocabulary};
use crate::robot::JointTerm;
use serde::Serialize;

/// An effect of the vocabulary, in words.
///
/// ```
/// let effects = mirror_core::diagnose::effects();
/// let play = effects.iter().find(|e| e.name == "backlash").ok_or("no such effect")?;
/// assert_eq!(play.parameters, ["width_rad"]);
/// assert_eq!(play.at.name(), "joint");
/// # Ok::<(), &str>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EffectInfo {
    /// Its name in the public vocabulary.
    pub name: String,
    /// At which kind of place it can be.
    pub at: PlaceKind,
    /// Its parameters, each with its unit as suffix.
    pub parameters: Vec<String>,
    /// Its law: θ the joint's position, q the commanded one, τ gravity's torque, t time.
    pub law: &'static str,
    /// What happens, in words for the reader.
    pub words: String,
    /// What to do about it.
    pub remedy: &'static str,
    /// The file into which it is written.
    pub written_to: WrittenTo,
    /// Whether commands can be shifted against it (`correct --feed-forward`).
    pub fed_forward: bool,
    /// At a joint: which term of the joint law each parameter is, in the order of the parameters; otherwise empty.
    pub joint_law: &'static [JointTerm],
    /// What it looks like in the data.
    pub signature: &'static str,
    /// Which postures show it.
    pub shown_by: &'static str,
    /// What it is confused with.
    pub confused_with: &'static str,
}

/// The vocabulary of effects, in words. `geometry` (small errors everywhere) and `pairing` (slipped rows) are
/// separate.
pub fn effects() -> Vec<EffectInfo> {
    vocabulary().iter().filter_map(|e| info(e.as_ref())).collect()
}

fn info(effect: &dyn Effect) -> Option<EffectInfo> {
    let about = effect.about()?;
    Some(EffectInfo {
        name: effect.name().to_owned(),
        at: about.at,
        parameters: effect.parameters(),
        law: about.law,
        words: effect.words().to_owned(),
        remedy: about.remedy,
        written_to: about.written_to,
        fed_forward: about.joint_law.iter().any(|term| term.is_fed_forward()),
        joint_law: about.joint_law,
        signature: about.signature,
        shown_by: about.shown_by,
        confused_with: about.confused_with,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Endings of parameters' names: the units, and what has none.
    const UNITS: [&str; 9] =
        ["_rad", "_rad_per_nm", "_rad_per_nm_m", "_rad_per_m", "_rad_per_s", "_m", "_px", "_per_m", "_error"];

    #[test]
    fn every_effect_of_the_vocabulary_tells_about_itself_with_units() {
        let told = effects();
        assert_eq!(told.len(), vocabulary().len(), "an effect without `about`");
        for (i, effect) in told.iter().enumerate() {
            assert!(!told[..i].iter().any(|e| e.name == effect.name), "{} twice", effect.name);
            for text in [effect.law, effect.remedy, effect.signature, effect.shown_by, effect.confused_with] {
                assert!(text.len() > 5, "{effect:?}");
            }
            let terms = effect.joint_law.len();
            assert!(terms == 0 || terms == effect.parameters.len(), "{}: a term a parameter", effect.name);
            assert!(terms == 0 || matches!(effect.at, PlaceKind::Joint | PlaceKind::JointPair), "{effect:?}");
            for parameter in &effect.parameters {
                // rad for each rad, px for each px.
                let unitless =
                    ["coupling", "dk1"].contains(&parameter.as_str()) || parameter.contains("_by_");
                assert!(unitless || UNITS.iter().any(|u| parameter.ends_with(u)), "{parameter}");
            }
        }
    }
}
