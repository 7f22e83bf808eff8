//! The scenes of a dataset, and those that were left out, with the reasons.

use crate::left_out::LeftOutScenes;
use crate::{DatasetError, Scene};

/// The scenes of a dataset in natural order, and the scenes that exist but were
/// excluded.
#[derive(Debug, Default)]
pub struct FoundScenes {
    pub scenes: Vec<Scene>,
    pub left_out: Vec<LeftOutScene>,
}

/// A scene, or a folder that may contain scenes, that exists but was excluded.
#[derive(Debug)]
pub struct LeftOutScene {
    /// Id of the scene, or of its folder if nothing else is known.
    pub id: String,
    pub why: Why,
}

/// Reason for excluding a scene.
#[derive(Debug)]
pub enum Why {
    /// The scene cannot be read or is incomplete.
    Fault(DatasetError),
    /// A setting excludes the scene, which itself has no fault.
    Choice(String),
}

impl FoundScenes {
    /// Adds a scene, or the reason that it cannot be read.
    pub(crate) fn add(&mut self, id: impl Into<String>, scene: Result<Scene, DatasetError>) {
        match scene {
            Ok(scene) => self.scenes.push(scene),
            Err(error) => self.left_out.push(LeftOutScene {
                id: id.into(),
                why: Why::Fault(error),
            }),
        }
    }

    /// Records that a setting excludes a scene.
    pub(crate) fn rule_out(&mut self, id: impl Into<String>, reason: impl Into<String>) {
        self.left_out.push(LeftOutScene {
            id: id.into(),
            why: Why::Choice(reason.into()),
        });
    }

    /// Excludes the scenes whose ids do not satisfy `belongs`, whether readable or
    /// broken.
    pub fn choose(&mut self, belongs: impl Fn(&str) -> bool, reason: &str) {
        let (scenes, others) = std::mem::take(&mut self.scenes)
            .into_iter()
            .partition(|scene| belongs(&scene.id));
        self.scenes = scenes;
        for left_out in self.left_out.iter_mut().filter(|scene| !belongs(&scene.id)) {
            left_out.why = Why::Choice(reason.to_owned());
        }
        let others: Vec<Scene> = others;
        others
            .into_iter()
            .for_each(|scene| self.rule_out(scene.id, reason));
    }

    /// Returns the scenes if none is faulty.
    ///
    /// # Errors
    /// If a scene is faulty; returns the error of the first faulty scene.
    pub fn all(self) -> Result<Vec<Scene>, DatasetError> {
        let faults = self.left_out.into_iter();
        match faults.map(|scene| scene.why).find(Why::is_fault) {
            Some(Why::Fault(error)) => Err(error),
            _ => Ok(self.scenes),
        }
    }
}

impl Why {
    pub fn is_fault(&self) -> bool {
        matches!(self, Self::Fault(_))
    }
}

impl std::fmt::Display for Why {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Fault(error) => error.fmt(f),
            Self::Choice(reason) => f.write_str(reason),
        }
    }
}

/// Groups scenes by reason, in the order of the first scene of each group.
pub fn by_reason(left_out: &[LeftOutScene]) -> Vec<LeftOutScenes> {
    let mut groups: Vec<LeftOutScenes> = Vec::new();
    for LeftOutScene { id, why } in left_out {
        let (reason, by_choice) = (why.to_string(), !why.is_fault());
        let mut same = groups.iter_mut();
        match same.find(|group| group.reason == reason && group.by_choice == by_choice) {
            Some(group) => group.scenes.push(id.clone()),
            None => groups.push(LeftOutScenes {
                reason,
                by_choice,
                scenes: vec![id.clone()],
            }),
        }
    }
    groups
}
