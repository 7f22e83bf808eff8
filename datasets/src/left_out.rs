//! Scenes and views that were excluded, with the reasons.

use std::collections::BTreeMap;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Scenes excluded for the same reason. Displayed as a line that lists the first few.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct LeftOutScenes {
    /// Description of the reason; names the faulty file.
    pub reason: String,
    /// True if excluded by a setting or an option, false if broken or incomplete.
    pub by_choice: bool,
    /// Ids of the scenes, or of folders if nothing more is known about them.
    pub scenes: Vec<String>,
}

impl std::fmt::Display for LeftOutScenes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&left_out_line("scene", &self.scenes, &self.reason))
    }
}

/// Views of a scene excluded for the same reason: a file that they need is missing, incomplete or
/// unreadable. Displayed as a line that lists the first few.
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

    /// One note per reason; `file` is the file that lists the excluded names.
    pub(crate) fn notes(&self, file: &Path) -> Vec<String> {
        let reasons = self.by_reason.iter();
        reasons
            .map(|(reason, names)| {
                format!(
                    "{}: {} {}(s) left out ({}): {reason}",
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
