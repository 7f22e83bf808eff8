//! Prefixes that wrappers such as `DataParallel` add to tensor names.

use std::collections::{BTreeMap, BTreeSet};

use crate::checkpoint::Checkpoint;

/// Name components added by PyTorch's own wrappers (DataParallel, compile, FSDP, activation checkpoints).
const WRAPPERS: [&str; 4] = [
    "module",
    "_orig_mod",
    "_fsdp_wrapped_module",
    "_checkpoint_wrapped_module",
];

impl Checkpoint {
    /// Removes wrapper prefixes and wrapper components from all tensor names. A name's prefix is everything before one
    /// of `roots`, which are the first components of the network's own names and must not contain a wrapper's name.
    /// Returns what was removed (`module._orig_mod.`), if anything.
    ///
    /// # Errors
    /// All prefixes found, sorted, if there are several, or if two tensors would get the same name.
    pub fn without_prefix(
        &mut self,
        roots: &BTreeSet<String>,
    ) -> Result<Option<String>, Vec<String>> {
        let split = |name: &str| {
            let parts: Vec<&str> = name.split('.').collect();
            let at = parts.iter().position(|part| roots.contains(*part))?;
            let (before, own) = parts.split_at(at);
            let kept: Vec<&str> = own
                .iter()
                .copied()
                .filter(|p| !WRAPPERS.contains(p))
                .collect();
            let prefix: String = before.iter().map(|part| format!("{part}.")).collect();
            let inner = own.iter().filter(|part| WRAPPERS.contains(*part));
            let inner: BTreeSet<String> = inner.map(|part| format!("{part}.")).collect();
            Some((prefix, inner, kept.join(".")))
        };
        let mut prefixes = BTreeSet::new();
        let mut inner = BTreeSet::new();
        let mut own = BTreeSet::new();
        let mut count = 0;
        for (prefix, within, name) in self.names().filter_map(split) {
            prefixes.insert(prefix);
            inner.extend(within);
            own.insert(name);
            count += 1;
        }
        if prefixes.contains("") && inner.is_empty() {
            return Ok(None);
        }
        // If two names would become the same, the file contains two networks.
        if prefixes.len() > 1 || own.len() < count {
            return Err(prefixes.into_iter().collect());
        }
        let left_out: String = prefixes.into_iter().chain(inner).collect();
        let renamed = |name: String| split(&name).map_or(name, |(_, _, own)| own);
        let tensors = std::mem::take(&mut self.tensors).into_iter();
        self.tensors = tensors
            .map(|(name, layout)| (renamed(name), layout))
            .collect::<BTreeMap<_, _>>();
        let others = std::mem::take(&mut self.others).into_iter();
        self.others = others.map(renamed).collect();
        Ok((!left_out.is_empty()).then_some(left_out))
    }
}
