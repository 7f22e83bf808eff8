//! What is known of how a pair list came about: from building it, or from the file beside it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::bail;
use serde::{Deserialize, Serialize};

use super::pair_recipe::Built;
use crate::durable::{FileError, write_atomic};
use crate::methods::Method;
use crate::protocol::{PairList, PairOptions};
use crate::runs::unit::SOURCE_FINGERPRINT;

/// Says that overlap came from a checkpoint, by its sha256.
const CHECKPOINT: &str = "overlap checkpoint";

/// How a list came about, for a manifest.
pub(super) struct ListFacts {
    /// `built` or `given`.
    pub(super) origin: &'static str,
    /// Every open choice and the depth behind the overlap; empty where nobody knows.
    options: BTreeMap<String, String>,
}

/// `FILE.json` beside a list `FILE`: the list's columns hold the pairs, this holds the choices behind them.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct ListCompanion {
    /// sha256 of the list that it belongs to.
    pub(super) sha256: String,
    /// As in a manifest.
    pub(super) options: BTreeMap<String, String>,
    /// Of these, the choices that are known to differ from the paper's.
    #[serde(default)]
    proxies: Vec<String>,
    /// The datasets as given.
    pub(super) datasets: Vec<String>,
    /// Version of the harness.
    version: String,
    /// Hash of its sources.
    source_fingerprint: String,
}

impl ListCompanion {
    pub(super) fn new(sha256: &str, built: &Built, datasets: &[String]) -> Self {
        Self {
            sha256: sha256.to_owned(),
            options: options_of(built),
            proxies: proxies_of(&options_of(built)),
            datasets: datasets.to_vec(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            source_fingerprint: SOURCE_FINGERPRINT.to_owned(),
        }
    }

    /// Where the companion of a list lies.
    pub(super) fn path(list: &Path) -> PathBuf {
        let mut name = list.as_os_str().to_owned();
        name.push(".json");
        name.into()
    }

    pub(super) fn write(&self, list: &Path) -> Result<(), FileError> {
        let path = Self::path(list);
        let mut bytes = serde_json::to_vec_pretty(self)
            .map_err(|error| FileError::new(&path, "encode")(error.into()))?;
        bytes.push(b'\n');
        write_atomic(&path, &bytes)
    }

    /// The companion of exactly this list; a list may well have none.
    fn of(list: &PairList) -> Option<Self> {
        let bytes = std::fs::read(Self::path(&list.path)).ok()?;
        let companion: Self = serde_json::from_slice(&bytes).ok()?;
        (companion.sha256 == list.sha256).then_some(companion)
    }
}

impl ListFacts {
    /// # Errors
    /// When a method under test chose the pairs.
    pub(super) fn of_built(built: &Built, methods: &[Box<dyn Method>]) -> anyhow::Result<Self> {
        Self::new("built", options_of(built), methods)
    }

    /// # Errors
    /// When a method under test chose the pairs.
    pub(super) fn of_given(list: &PairList, methods: &[Box<dyn Method>]) -> anyhow::Result<Self> {
        let options = ListCompanion::of(list).map(|companion| companion.options);
        Self::new("given", options.unwrap_or_default(), methods)
    }

    fn new(
        origin: &'static str,
        options: BTreeMap<String, String>,
        methods: &[Box<dyn Method>],
    ) -> anyhow::Result<Self> {
        // Pairs must not be chosen by what is judged on them.
        if let Some(checkpoint) = options.get(CHECKPOINT)
            && let Some(method) = methods.iter().find(|m| m.identity().contains(checkpoint))
        {
            bail!(
                "the pairs were chosen by the depth of the checkpoint that method '{}' is evaluated with; choose them by \
                 other depth, such as --overlap-depth DIR",
                method.label()
            );
        }
        Ok(Self { origin, options })
    }

    /// For [`PairFacts::options`](crate::runs::manifest::PairFacts::options).
    pub(super) fn options(&self) -> BTreeMap<String, String> {
        self.options.clone()
    }

    /// For [`PairFacts::proxies`](crate::runs::manifest::PairFacts::proxies).
    pub(super) fn proxies(&self) -> Vec<String> {
        proxies_of(&self.options)
    }
}

fn proxies_of(options: &BTreeMap<String, String>) -> Vec<String> {
    PairOptions::of_facts(options).map_or_else(Vec::new, |options| options.proxies())
}

fn options_of(built: &Built) -> BTreeMap<String, String> {
    let mut options = built.facts.clone();
    if let Some(checkpoint) = &built.checkpoint_sha256 {
        options.insert(CHECKPOINT.to_owned(), checkpoint.clone());
    }
    options
}
