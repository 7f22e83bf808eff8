//! Origin of a pair list: recorded when it is built, read from the file next to it later.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sharp_datasets::entry::{PaperOverlap, entry};

use super::options::PairOptions;
use super::pair_list::PairList;
use crate::io::atomic_files::{FileError, write_json};
use crate::pairs::DatasetConfig;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PairProvenance {
    pub options: PairOptions,
    pub overlap_depth: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlap_depth_maps: Option<DepthMaps>,
    /// sha256 of the checkpoint whose depth decided overlap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlap_checkpoint: Option<String>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct DepthMaps {
    pub count: usize,
    pub sha256: String,
}

impl PairProvenance {
    /// The choices that are known to differ from the paper's on a dataset of a format, of which `selected` pairs were
    /// selected, as `key=value`.
    pub fn proxies(&self, format: &str, selected: usize) -> Vec<String> {
        let kind = entry(format).map_or(PaperOverlap::Dense, |entry| entry.paper_overlap);
        self.options.proxies_on(kind, selected)
    }
}

/// `FILE.json` next to a list `FILE`: the list holds the pairs, this file the choices behind them.
#[derive(Debug, Serialize, Deserialize)]
pub struct ListCompanion {
    schema: u32,
    /// sha256 of the list that it belongs to.
    pub sha256: String,
    pub choices: BTreeMap<String, PairProvenance>,
    pub datasets: Vec<String>,
    version: String,
}

const SCHEMA: u32 = 2;

impl ListCompanion {
    pub fn new(
        list: &PairList,
        choices: &BTreeMap<String, PairProvenance>,
        datasets: &[DatasetConfig],
    ) -> Self {
        Self {
            schema: SCHEMA,
            sha256: list.sha256.clone(),
            choices: choices.clone(),
            datasets: datasets.iter().map(ToString::to_string).collect(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        }
    }

    /// Where the companion of a list lies.
    pub fn path(list: &Path) -> PathBuf {
        let mut name = list.as_os_str().to_owned();
        name.push(".json");
        name.into()
    }

    pub fn write(&self, list: &Path) -> Result<(), FileError> {
        write_json(&Self::path(list), self)
    }

    /// The companion of exactly this list; a list may well have none.
    pub fn of(list: &PairList) -> Option<Self> {
        let companion = Self::read(&Self::path(&list.path))?;
        (companion.schema == SCHEMA && companion.sha256 == list.sha256).then_some(companion)
    }

    fn read(path: &Path) -> Option<Self> {
        serde_json::from_slice(&sharp::files::read(path).ok()?).ok()
    }

    /// Removes that of an earlier list in the place of one that has none. A file of somebody else stays.
    pub fn remove(list: &Path) -> Result<(), FileError> {
        let path = Self::path(list);
        match Self::read(&path) {
            Some(_) => fs::remove_file(&path).map_err(FileError::new(&path, "remove")),
            None => Ok(()),
        }
    }
}
