//! What a reader left out, and why.

use std::collections::BTreeMap;
use std::path::Path;

/// Frames, scenes, folders or files that were left out, by reason.
#[derive(Debug)]
pub(crate) struct LeftOut {
    what: &'static str,
    by_reason: BTreeMap<&'static str, Vec<String>>,
}

impl LeftOut {
    /// `what` is the singular of the things that are left out.
    pub(crate) fn of(what: &'static str) -> Self {
        Self {
            what,
            by_reason: BTreeMap::new(),
        }
    }

    pub(crate) fn add(&mut self, reason: &'static str, name: impl Into<String>) {
        self.by_reason.entry(reason).or_default().push(name.into());
    }

    /// One note a reason; `file` says where the names are from.
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

/// The first three of some names.
pub(crate) fn first_few(names: &[String]) -> String {
    let first = names.iter().take(3).map(String::as_str);
    let more = (names.len() > 3).then_some("…");
    first.chain(more).collect::<Vec<_>>().join(", ")
}
