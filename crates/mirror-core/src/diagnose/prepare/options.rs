//! Options of a diagnosis, and further sessions on which it is checked.

use crate::cancel::Cancel;
use crate::diagnose::data::progress::Progress;
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::everywhere::EVERYWHERE;
use crate::diagnose::effects::hypothesis::Catalogue;
use crate::diagnose::effects::own::{OwnEffect, own_effects};
use crate::diagnose::effects::{Effect, Stiction, vocabulary};
use crate::diagnose::model::scene::Scene;
use crate::error::{Error, Result};
use crate::robot::Robot;
use std::sync::Arc;

/// How to diagnose.
#[derive(Debug, Clone, Default)]
pub struct DiagnoseOptions {
    /// Effects that are switched off.
    pub without: Vec<String>,
    /// No more causes than this; 0 for the usual six.
    pub most_causes: usize,
    /// Further effects in addition to the vocabulary.
    pub own: Vec<OwnEffect>,
    /// Whether the markers are reported posture by posture.
    pub markers: bool,
    /// Stops the diagnosis from outside.
    pub cancel: Cancel,
    /// Watches it from outside.
    pub progress: Progress,
}

/// A further session on which the result is checked.
#[derive(Debug, Clone)]
pub struct OtherSession {
    /// Its name.
    pub name: String,
    /// Its robot.
    pub robot: Robot,
    /// What was recorded.
    pub recording: Recording,
    /// The user's effects, with their weights in this session; those that are not here are not predicted.
    pub own: Vec<OwnEffect>,
}

impl DiagnoseOptions {
    /// Whether an effect, or a group or fault of the data, is not switched off.
    pub(crate) fn allows(&self, name: &str) -> bool {
        !self.without.iter().any(|w| w == name)
    }

    /// The hypotheses of a session: the vocabulary and the user's effects, without those that are switched off.
    ///
    /// # Errors
    /// [`Error::UnknownName`]: an unknown name in `without`; a user's effect that this session cannot have.
    pub(crate) fn catalogue(&self, scene: &Scene) -> Result<Catalogue> {
        let mut effects = vocabulary();
        if !self.allows("joint_compliance") {
            effects.retain(|e| e.name() != "stiction");
            effects.push(Box::new(Stiction { droops: false }));
        }
        effects.extend(own_effects(&self.own, scene)?);
        self.check_names(&effects)?;
        Ok(Catalogue::new(scene, effects.into_iter().map(Arc::from).collect(), &self.without))
    }

    /// Refuses names in `without` that are none.
    ///
    /// # Errors
    /// [`Error::UnknownName`], with the valid names.
    fn check_names(&self, effects: &[Box<dyn Effect>]) -> Result<()> {
        let valid = || effects.iter().map(|e| e.name()).chain(EVERYWHERE.iter().map(|m| m.name));
        match self.without.iter().find(|w| !valid().any(|v| v == w.as_str())) {
            None => Ok(()),
            Some(unknown) => Err(Error::UnknownName {
                what: "effect in `without`",
                got: unknown.clone(),
                valid: valid().collect::<Vec<_>>().join(", "),
            }),
        }
    }
}
