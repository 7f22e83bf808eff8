//! What a reader left out, and why.

use std::collections::BTreeMap;
use std::path::Path;

/// Frames, scenes or folders that were left out, by reason, as one note a reason.
#[derive(Debug)]
pub(crate) struct Skipped {
    what: &'static str,
    by_reason: BTreeMap<&'static str, Vec<String>>,
}

impl Default for Skipped {
    fn default() -> Self {
        Self::of("frame")
    }
}

impl Skipped {
    /// For things of that name, in the singular.
    pub(crate) fn of(what: &'static str) -> Self {
        Self {
            what,
            by_reason: BTreeMap::new(),
        }
    }

    pub(crate) fn add(&mut self, reason: &'static str, name: &str) {
        self.by_reason
            .entry(reason)
            .or_default()
            .push(name.to_owned());
    }

    pub(crate) fn notes(&self, file: &Path) -> Vec<String> {
        self.by_reason
            .iter()
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
