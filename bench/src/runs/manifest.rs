//! `manifest.json`: what was run and under which conventions, said once for all its numbers.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::metric_facts::MetricFacts;
use super::store::RunFolder;
use super::unit::cpu_backend;
use crate::durable::{FileError, write_atomic};

/// Changes whenever an older reader would misunderstand the folder.
pub const FORMAT: u32 = 1;

/// Everything that the numbers of a run share. Holds no time and no machine path besides those that the user gave,
/// so that two runs of the same thing have the same manifest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`FORMAT`] of the writer.
    pub format: u32,
    /// Version of the harness.
    pub version: String,
    /// Hash of the sources and locked dependencies it was built from.
    pub source_fingerprint: String,
    /// The exact backend that renders, `cpu-avx512` or `wgpu:<adapter, driver>`; one for the whole run.
    pub backend: String,
    /// In the order given.
    pub datasets: Vec<DatasetFacts>,
    /// The pair list.
    pub pairs: PairFacts,
    /// In the order given.
    pub methods: Vec<MethodFacts>,
    /// In the order of the columns.
    pub metrics: Vec<MetricFacts>,
    /// How predictions become scored pictures.
    pub scoring: BTreeMap<String, String>,
}

/// One dataset instance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DatasetFacts {
    /// Its column group in the tables.
    pub name: String,
    /// `[NAME:]FORMAT=PATH` as given.
    pub spec: String,
    /// The wildcard that chose among its scenes (`--scenes`); `None` for all of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub only_scenes: Option<String>,
    /// Scenes found.
    pub scenes: usize,
    /// Views found.
    pub views: usize,
    /// What the reader assumed or left out.
    pub notes: Vec<String>,
}

/// The pair list and how it came about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairFacts {
    /// sha256 of `pairs.csv`.
    pub sha256: String,
    /// Rows of the list.
    pub listed: usize,
    /// Pairs that this run evaluates.
    pub evaluated: usize,
    /// The limit of the run (`--limit`); `None` for all selected pairs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<usize>,
    /// `built`, or `given` where a list was handed in.
    pub origin: String,
    /// Every open choice of the protocol, by name.
    pub options: BTreeMap<String, String>,
}

/// One method instance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MethodFacts {
    /// Its row in the tables.
    pub label: String,
    /// As given on the command line.
    pub spec: String,
    /// Everything that its pictures depend on.
    pub identity: String,
}

impl Manifest {
    /// Writes the manifest of a run.
    ///
    /// # Errors
    /// Names the file and what the system said.
    pub fn write(&self, folder: &RunFolder) -> Result<(), FileError> {
        let path = folder.manifest_path();
        let mut bytes = serde_json::to_vec_pretty(self)
            .map_err(|error| FileError::new(&path, "encode")(error.into()))?;
        bytes.push(b'\n');
        write_atomic(&path, &bytes)
    }

    /// Refuses to go on in a folder whose results another backend rendered: a run has one.
    ///
    /// # Errors
    /// Names the folder and both backends.
    pub fn check_backend(&self, folder: &RunFolder) -> Result<(), FileError> {
        // A folder without a readable manifest holds no finished run; its units are found by their keys.
        match Self::read(folder) {
            Ok(before) if before.backend != self.backend => {
                let reason = std::io::Error::other(format!(
                    "it was started with backend {}, this is {}; a run has one backend: choose another folder",
                    before.backend, self.backend
                ));
                Err(FileError::new(folder.root(), "go on in")(reason))
            }
            _ => Ok(()),
        }
    }

    /// Reads the manifest of a run.
    ///
    /// # Errors
    /// When the file is missing, not a manifest, or of a later format.
    pub fn read(folder: &RunFolder) -> Result<Self, FileError> {
        let path = folder.manifest_path();
        let bytes = std::fs::read(&path).map_err(FileError::new(&path, "read"))?;
        let manifest: Self = serde_json::from_slice(&bytes)
            .map_err(|error| FileError::new(&path, "parse")(error.into()))?;
        if manifest.format > FORMAT {
            let reason = format!("format {} is newer than {FORMAT}", manifest.format);
            return Err(FileError::new(&path, "use")(std::io::Error::other(reason)));
        }
        Ok(manifest)
    }
}

/// What decodes pictures, with versions: two JPEG decoders may differ by a level.
pub const DECODERS: &str = env!("SHARP_BENCH_DECODERS");

/// The scoring conventions of this build, for [`Manifest::scoring`]; `renderer` is the exact backend, `networks` how
/// those behind the metrics are computed.
pub fn scoring_facts(renderer: &str, networks: &str) -> BTreeMap<String, String> {
    let kind = renderer.split([':', '-']).next().unwrap_or(renderer);
    let renderer = format!("{kind}, near 0.01, far 1e10, eps2d 0");
    [
        ("prediction", "sRGB, 8 bit, rounded to nearest"),
        (
            "target",
            "sRGB, 8 bit, as decoded; colour profiles ignored; undistorted or masked where the dataset's notes say so",
        ),
        ("decoder", DECODERS),
        (
            "resolution",
            "full resolution of the target, which is never resized; resized predictions are marked in the tables",
        ),
        ("background", "black, in linear light"),
        ("renderer", renderer.as_str()),
        ("kernels", cpu_backend()),
        (
            "aggregation",
            "mean over pairs; a mean that holds inf is inf",
        ),
        (
            "excluded pixels",
            "where the dataset's mask excludes pixels of the target, both pictures take the mean colour of its other \
             pixels, and PSNR is over those",
        ),
        ("frustum mask", "margin 1.05, z > 0, invalid depth outside"),
        ("metric networks", networks),
    ]
    .map(|(name, value)| (name.to_owned(), value.to_owned()))
    .into()
}
