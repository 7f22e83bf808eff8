//! Origin of a pair list: recorded in a file next to the list when it is built, and read from there later.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sharp_datasets::registry::entry;
use sharp_datasets::spec::PaperOverlap;

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
    /// SHA-256 of the checkpoint that predicted depth for overlap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlap_checkpoint: Option<String>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct DepthMaps {
    pub count: usize,
    pub sha256: String,
}

impl PairProvenance {
    /// The choices, as `key=value`, that are known to differ from the paper's for a dataset of the format `format` with
    /// `selected` selected pairs.
    pub fn proxies(&self, format: &str, selected: usize) -> Vec<String> {
        let kind = entry(format).map_or(PaperOverlap::Dense, |entry| entry.paper_overlap);
        self.options.proxies_on(kind, selected)
    }
}

/// `FILE.json` next to a list `FILE`: records the choices behind the list's pairs.
#[derive(Debug, Serialize, Deserialize)]
pub struct ListCompanion {
    schema: u32,
    /// SHA-256 of the list that the companion belongs to.
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

    pub fn path(list: &Path) -> PathBuf {
        let mut name = list.as_os_str().to_owned();
        name.push(".json");
        name.into()
    }

    pub fn write(&self, list: &Path) -> Result<(), FileError> {
        write_json(&Self::path(list), self)
    }

    /// The companion of `list`; `None` if there is none, or if it was written for a list with other contents.
    pub fn of(list: &PairList) -> Option<Self> {
        let companion = Self::read(&Self::path(&list.path))?;
        (companion.schema == SCHEMA && companion.sha256 == list.sha256).then_some(companion)
    }

    fn read(path: &Path) -> Option<Self> {
        serde_json::from_slice(&sharp::files::read(path).ok()?).ok()
    }

    /// Removes the companion of a list that is about to be overwritten. Keeps a file of this name that is not a
    /// companion.
    pub fn remove(list: &Path) -> Result<(), FileError> {
        let path = Self::path(list);
        match Self::read(&path) {
            Some(_) => fs::remove_file(&path).map_err(FileError::new(&path, "remove")),
            None => Ok(()),
        }
    }
}
