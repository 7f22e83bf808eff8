//! Scenes and views that were excluded, with the reasons.

use std::collections::BTreeMap;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{DatasetError, Scene};

/// Scenes in natural order, and those that exist but were excluded.
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

/// Reason that a scene was excluded.
#[derive(Debug)]
pub enum Why {
    /// It cannot be read or is incomplete.
    Fault(DatasetError),
    /// It was excluded by a setting; nothing is wrong with it.
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

    /// Adds a scene that was excluded by a setting.
    pub(crate) fn rule_out(&mut self, id: impl Into<String>, reason: impl Into<String>) {
        self.left_out.push(LeftOutScene {
            id: id.into(),
            why: Why::Choice(reason.into()),
        });
    }

    /// Excludes the scenes whose ids do not satisfy `belongs`, including broken ones.
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

    /// Returns the scenes, or the first fault if there is one.
    ///
    /// # Errors
    /// The first fault.
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

/// Scenes excluded for the same reason. Displayed as a line that includes the first few.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct LeftOutScenes {
    /// Description of the reason; names the faulty file.
    pub reason: String,
    /// True if excluded by a setting or an option, false if broken or incomplete.
    pub by_choice: bool,
    /// Ids of the scenes, or of folders of which no more is known.
    pub scenes: Vec<String>,
}

impl std::fmt::Display for LeftOutScenes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&left_out_line("scene", &self.scenes, &self.reason))
    }
}

/// Views of a scene excluded for the same reason: a file that they need is missing, incomplete or unreadable. Displayed
/// as a line that includes the first few.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOutViews {
    /// Description of the reason; names the file.
    pub reason: String,
    pub views: Vec<String>,
}

impl LeftOutViews {
    /// Adds a view to the group with the same reason.
    pub fn add(all: &mut Vec<Self>, reason: impl Into<String>, view: impl Into<String>) {
        let (reason, view) = (reason.into(), view.into());
        match all.iter_mut().find(|group| group.reason == reason) {
            Some(group) => group.views.push(view),
            None => all.push(Self {
                reason,
                views: vec![view],
            }),
        }
    }
}

impl std::fmt::Display for LeftOutViews {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&left_out_line("view", &self.views, &self.reason))
    }
}

fn left_out_line(what: &str, ids: &[String], reason: &str) -> String {
    let s = if ids.len() == 1 { "" } else { "s" };
    format!(
        "{} {what}{s} left out ({}): {reason}",
        ids.len(),
        first_few(ids)
    )
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

/// Excluded frames or files of a scene, by reason.
#[derive(Debug)]
pub(crate) struct LeftOut {
    what: &'static str,
    by_reason: BTreeMap<String, Vec<String>>,
}

impl LeftOut {
    /// `what` is the singular noun for the excluded items.
    pub(crate) fn of(what: &'static str) -> Self {
        Self {
            what,
            by_reason: BTreeMap::new(),
        }
    }

    pub(crate) fn add(&mut self, reason: impl Into<String>, name: impl Into<String>) {
        let names = self.by_reason.entry(reason.into()).or_default();
        names.push(name.into());
    }

    /// One note per reason; `file` is the list that contains the names.
    pub(crate) fn notes(&self, file: &Path) -> Vec<String> {
        let reasons = self.by_reason.iter();
        reasons
            .map(|(reason, names)| {
                format!(
                    "{}: {} {}(s) left out, {reason}: {}",
                    file.display(),
                    names.len(),
                    self.what,
                    first_few(names)
                )
            })
            .collect()
    }
}

/// Formats the first three names.
pub(crate) fn first_few(names: &[String]) -> String {
    let first = names.iter().take(3).map(String::as_str);
    let more = (names.len() > 3).then_some("…");
    first.chain(more).collect::<Vec<_>>().join(", ")
}
