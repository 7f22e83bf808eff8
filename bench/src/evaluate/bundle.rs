//! The scores of a run in a single file, small enough to send, publish or commit as a baseline.
//!
//! A ZIP archive of these members:
//!
//! * `bundle.json`: version and digest.
//! * `manifest.json`: as in the run folder.
//! * `pairs.csv`: only the evaluated pairs.
//! * `units.jsonl`: the outcome of each unit (one method on one pair).
//! * `missing.json`: planned units without a result.
//! * `scores.bin`: one column of f64 numbers per metric of the manifest. A column starts with the first bytes of all
//!   its numbers (big endian), followed by all second bytes, and so on, because this compresses better than number by
//!   number.
//! * `timings.json`, if times are included: the times of each method by pair.
//!
//! Pictures and the values that methods report are not included. Equal results without times give equal bytes.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Cursor, Read, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::error::EvaluateError;
use super::folder::RunFolder;
use super::manifest::Manifest;
use super::record::{ChosenScale, Crop, PairFiles, Record, Score, Status};
use super::results::{Current, Results};
use super::score::empty_record;
use super::unit::Timing;
use crate::io::atomic_files::{FileError, write_atomic};
use crate::io::hash::StableHasher;
use crate::pairs::PairList;

/// Version of the layout of bundles that are written. Older versions remain readable.
const FORMAT: u32 = 2;

/// Maximum unpacked size of a text member, in bytes: a hundred times what the paper's whole evaluation needs.
const MAX_MEMBER: u64 = 1 << 28;

/// Archive member with prediction times; absent from bundles without times.
const TIMINGS: &str = "timings.json";

/// Bits that stand for a missing score in `scores.bin`: a NaN that arithmetic does not produce.
const ABSENT: u64 = u64::MAX;

/// Contents of `bundle.json`, which can be read without the other members.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Head {
    format: u32,
    /// Hash of the manifest and the records; in format 1, of the records alone.
    pub(crate) digest: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) occasion: Option<Occasion>,
}

/// Facts about a run that its author states when adding it to a history.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Occasion {
    pub label: String,
    /// Version of the author's code, such as a git hash.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
    /// `YYYY-MM-DD`, or `YYYY-MM-DDTHH:MM`.
    pub date: String,
}

#[derive(Debug, Clone)]
pub struct Bundle {
    pub results: Results,
    /// List of the planned pairs.
    pub pairs: PairList,
    pub occasion: Option<Occasion>,
    /// Times of each method on each pair; usually empty.
    pub timings: Timings,
}

/// Times of predictions, keyed by the method's label and then by the pair's id.
pub type Timings = BTreeMap<String, BTreeMap<String, Timing>>;

/// A line of `units.jsonl`: a method's result on a pair, without scores and without the columns of the pair list.
#[derive(Serialize, Deserialize)]
struct UnitLine {
    /// Index of the pair in `pairs.csv`.
    pair: usize,
    /// Index of the method in the manifest.
    method: usize,
    cluster: String,
    #[serde(flatten)]
    status: Status,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    unavailable: BTreeMap<String, String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    crop: Option<Crop>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    valid_share: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    resized_from: Option<(u32, u32)>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    scale: Option<ChosenScale>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    files: Option<PairFiles>,
}

/// Writes the results of a run folder or another bundle to the file `out`. Prediction times are included only if
/// `with_times`.
///
/// # Errors
/// If the run cannot be read or the file cannot be written. An existing file is overwritten only if it is a bundle
/// without an [`Occasion`]; bundles with an `Occasion` are entries of a history.
pub fn write_bundle(run: &Path, out: &Path, with_times: bool) -> Result<Results, EvaluateError> {
    let is_other = |there: Result<Bundle, _>| there.map_or(true, |there| there.occasion.is_some());
    if out.exists() && is_other(read_file(out)) {
        let reason = "the file exists and is not overwritten, because it is not a bundle or \
                      belongs to a history; choose another file";
        return Err(FileError::new(out, "write")(std::io::Error::other(reason)).into());
    }
    let mut bundle = Bundle::read(run)?;
    bundle.occasion = None;
    if !with_times {
        bundle.timings.clear();
    } else if run.is_dir() {
        for method in &bundle.results.manifest.methods {
            let times = timings(run, &method.label)?;
            bundle.timings.insert(method.label.clone(), times);
        }
    }
    let bytes = bundle.bytes().map_err(FileError::new(out, "encode"))?;
    write_atomic(out, &bytes)?;
    Ok(bundle.results)
}

impl Results {
    /// Reads the results of a bundle or a run folder; the run may be unfinished.
    ///
    /// # Errors
    /// If `run` is neither a run folder nor a bundle, if its format is not supported, or if evaluated pairs have been
    /// removed from its pair list or plan.
    pub fn read(run: &Path) -> Result<Self, EvaluateError> {
        if run.exists() && !run.is_dir() {
            Ok(read_file(run)?.results)
        } else {
            Self::of_folder(run)
        }
    }
}

impl Bundle {
    /// Reads a file written by [`write_bundle`], or creates a bundle from a run folder.
    ///
    /// # Errors
    /// If `run` is neither a bundle nor a run folder, or was written by a later version.
    pub fn read(run: &Path) -> Result<Self, EvaluateError> {
        if run.exists() && !run.is_dir() {
            return read_file(run);
        }
        let results = Results::of_folder(run)?;
        let listed = PairList::read(&RunFolder::open(run)?.pairs_path())?;
        let used: BTreeSet<&str> = results
            .records
            .iter()
            .map(|record| record.pair_id.as_str())
            .chain(results.missing.iter().map(|(pair, _)| pair.as_str()))
            .collect();
        let mut pairs = listed.pairs;
        pairs.retain(|pair| used.contains(pair.pair_id.as_str()));
        Ok(Self {
            pairs: PairList::new("pairs.csv", pairs),
            results,
            occasion: None,
            timings: Timings::new(),
        })
    }

    pub(crate) fn head(&self) -> serde_json::Result<Head> {
        Ok(Head {
            format: FORMAT,
            digest: digest(
                FORMAT,
                &self.results.manifest,
                &self.results.records,
                &self.timings,
            )?,
            occasion: self.occasion.clone(),
        })
    }

    /// The bundle as the bytes of its file.
    ///
    /// # Errors
    /// If the results refer to a pair that is not in the pair list or a method that is not in the manifest.
    pub fn bytes(&self) -> std::io::Result<Vec<u8>> {
        let Results {
            manifest,
            records,
            missing,
            ..
        } = &self.results;
        let places = |names: Vec<&str>| -> BTreeMap<String, usize> {
            names.into_iter().map(str::to_owned).zip(0..).collect()
        };
        let listed = self.pairs.pairs.iter();
        let pairs = places(listed.map(|p| p.pair_id.as_str()).collect());
        let methods = places(manifest.methods.iter().map(|m| m.label.as_str()).collect());
        let unknown =
            |what: &str| std::io::Error::other(format!("{what} is not in the folder's lists"));
        let mut units = String::new();
        for record in records {
            let line = UnitLine {
                pair: *pairs
                    .get(&record.pair_id)
                    .ok_or_else(|| unknown(&record.pair_id))?,
                method: *methods
                    .get(&record.method)
                    .ok_or_else(|| unknown(&record.method))?,
                cluster: record.cluster.clone(),
                status: record.status.clone(),
                unavailable: unavailable(record),
                crop: record.crop,
                valid_share: record.valid_share,
                resized_from: record.resized_from,
                scale: record.scale,
                files: record.files.clone(),
            };
            units += &serde_json::to_string(&line)?;
            units.push('\n');
        }
        let mut scores = Vec::new();
        for metric in &manifest.metrics {
            let key = metric.info.key.to_string();
            let column: Vec<[u8; 8]> = records
                .iter()
                .map(|record| {
                    let value = record.scores.get(&key).and_then(Score::value);
                    value.map_or(ABSENT, f64::to_bits).to_be_bytes()
                })
                .collect();
            scores.extend((0..8).flat_map(|byte| column.iter().map(move |value| value[byte])));
        }
        let head = self.head()?;
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .compression_level(Some(9));
        for (name, bytes) in [
            ("bundle.json", serde_json::to_vec(&head)?),
            ("manifest.json", serde_json::to_vec(manifest)?),
            ("pairs.csv", self.pairs.bytes().to_vec()),
            ("units.jsonl", units.into_bytes()),
            ("missing.json", serde_json::to_vec(missing)?),
            ("scores.bin", scores),
        ] {
            archive.start_file(name, options)?;
            archive.write_all(&bytes)?;
        }
        if !self.timings.is_empty() {
            archive.start_file(TIMINGS, options)?;
            archive.write_all(&serde_json::to_vec(&self.timings)?)?;
        }
        Ok(archive.finish()?.into_inner())
    }

    /// Hash of the manifest, the records, and the pairs with the hashes of their photographs. Equal for two runs of the
    /// same evaluation, wherever their files are.
    ///
    /// # Errors
    /// If serialisation fails, which does not happen in memory.
    pub fn content_sha256(&self) -> serde_json::Result<String> {
        let mut manifest = self.results.manifest.clone();
        for dataset in &mut manifest.datasets {
            dataset.spec = None;
        }
        for method in &mut manifest.methods {
            method.spec = None;
        }
        let mut hasher = StableHasher::default();
        hasher
            .add("manifest", &serde_json::to_string(&manifest)?)
            .add("pairs", &self.pairs.sha256)
            .add(
                "records",
                &digest(1, &manifest, &self.results.records, &Timings::new())?,
            )
            .add("missing", &serde_json::to_string(&self.results.missing)?);
        Ok(hasher.finish())
    }
}

fn unavailable(record: &Record) -> BTreeMap<String, String> {
    let scores = record.scores.iter();
    scores
        .filter_map(|(key, score)| match score {
            Score::Value(_) => None,
            Score::Unavailable { unavailable } => Some((key.clone(), unavailable.clone())),
        })
        .collect()
}

/// Digest of the manifest, the records and, if included, the times, as the bundle's format defines it.
fn digest(
    format: u32,
    manifest: &Manifest,
    records: &[Record],
    timings: &Timings,
) -> serde_json::Result<String> {
    let mut hasher = StableHasher::default();
    if format > 1 {
        hasher.add("manifest", &serde_json::to_string(manifest)?);
    }
    for record in records {
        let kept = Record {
            extras: BTreeMap::new(),
            warnings: BTreeMap::new(),
            ..record.clone()
        };
        hasher.add("record", &serde_json::to_string(&kept)?);
    }
    if !timings.is_empty() {
        hasher.add("timings", &serde_json::to_string(timings)?);
    }
    Ok(hasher.finish())
}

struct Members<'a> {
    path: &'a Path,
    archive: ZipArchive<Cursor<Vec<u8>>>,
}

impl<'a> Members<'a> {
    fn open(path: &'a Path) -> Result<Self, EvaluateError> {
        let bytes = sharp::files::read(path).map_err(FileError::new(path, "read"))?;
        let archive = ZipArchive::new(Cursor::new(bytes));
        let archive = archive.map_err(|error| unreadable(path, error.to_string()))?;
        Ok(Self { path, archive })
    }

    fn bytes(&mut self, name: &str, longest: u64) -> Result<Vec<u8>, EvaluateError> {
        let wrong = |reason: String| unreadable(self.path, format!("{name}: {reason}"));
        let file = self.archive.by_name(name);
        let file = file.map_err(|error| wrong(error.to_string()))?;
        let mut bytes = Vec::new();
        let read = file.take(longest).read_to_end(&mut bytes);
        read.map_err(|error| wrong(error.to_string()))?;
        Ok(bytes)
    }

    fn json<T: serde::de::DeserializeOwned>(&mut self, name: &str) -> Result<T, EvaluateError> {
        let value = serde_json::from_slice(&self.bytes(name, MAX_MEMBER)?);
        value.map_err(|error| unreadable(self.path, error.to_string()))
    }

    fn timings(&mut self) -> Result<Timings, EvaluateError> {
        match self.archive.index_for_name(TIMINGS) {
            Some(_) => self.json(TIMINGS),
            None => Ok(Timings::new()),
        }
    }

    fn head(&mut self) -> Result<Head, EvaluateError> {
        let head: Head = self.json("bundle.json")?;
        match head.format {
            ..=FORMAT => Ok(head),
            later => Err(unreadable(
                self.path,
                format!("format {later}, but this version reads formats only up to {FORMAT}"),
            )),
        }
    }
}

fn unreadable(path: &Path, reason: String) -> EvaluateError {
    EvaluateError::Bundle {
        path: path.to_owned(),
        reason,
    }
}

/// Reads only `bundle.json`, so it works even if the other members are damaged.
pub(crate) fn read_head(path: &Path) -> Result<Head, EvaluateError> {
    Members::open(path)?.head()
}

/// Times of a method's successful predictions, keyed by pair id. `root` is a run folder or a bundle; a bundle without
/// times gives an empty map.
///
/// # Errors
/// If the folder or bundle cannot be read.
pub fn timings(root: &Path, method: &str) -> Result<BTreeMap<String, Timing>, EvaluateError> {
    if !root.is_dir() {
        let times = root
            .is_file()
            .then(|| Members::open(root)?.timings())
            .transpose()?;
        return Ok(times
            .and_then(|mut times| times.remove(method))
            .unwrap_or_default());
    }
    let units = Current::read(&RunFolder::open(root)?)?.units.into_iter();
    let units = units.filter(|unit| unit.slot.method == method && unit.record.status == Status::Ok);
    Ok(units.map(|unit| (unit.slot.pair_id, unit.timing)).collect())
}

fn read_file(path: &Path) -> Result<Bundle, EvaluateError> {
    let unreadable = |reason: String| unreadable(path, reason);
    let mut members = Members::open(path)?;
    let head = members.head()?;
    let mut manifest: Manifest = members.json("manifest.json")?;
    if head.format == 1 {
        manifest.restate_target_convention();
    }
    manifest.check_metrics().map_err(&unreadable)?;
    let missing = members.json("missing.json")?;
    let listed = members.bytes("pairs.csv", MAX_MEMBER)?;
    let list = PairList::parse(&path.join("pairs.csv"), &listed)?;
    let units = members.bytes("units.jsonl", MAX_MEMBER)?;
    let lines: Vec<UnitLine> = serde_json::Deserializer::from_slice(&units)
        .into_iter()
        .collect::<Result<_, _>>()
        .map_err(|error| unreadable(format!("units.jsonl: {error}")))?;
    let n = lines.len();
    let expected = 8 * n * manifest.metrics.len();
    let scores = members.bytes("scores.bin", expected as u64 + 1)?;
    if scores.len() != expected {
        return Err(unreadable(
            "the length of scores.bin does not match the number of units".to_owned(),
        ));
    }
    let mut records = Vec::with_capacity(n);
    for (at, line) in lines.into_iter().enumerate() {
        let mut found = BTreeMap::new();
        for (metric, column) in manifest
            .metrics
            .iter()
            .zip(scores.chunks_exact((8 * n).max(1)))
        {
            let bytes: [u8; 8] = std::array::from_fn(|byte| column[byte * n + at]);
            let bits = u64::from_be_bytes(bytes);
            if bits != ABSENT {
                found.insert(
                    metric.info.key.to_string(),
                    Score::Value(f64::from_bits(bits)),
                );
            }
        }
        let reasons = line.unavailable.into_iter();
        found.extend(reasons.map(|(key, unavailable)| (key, Score::Unavailable { unavailable })));
        let (Some(pair), Some(method)) =
            (list.pairs.get(line.pair), manifest.methods.get(line.method))
        else {
            return Err(unreadable(
                "units.jsonl names an unknown pair or method".to_owned(),
            ));
        };
        records.push(Record {
            status: line.status,
            scores: found,
            crop: line.crop,
            valid_share: line.valid_share,
            resized_from: line.resized_from,
            scale: line.scale,
            files: line.files,
            ..empty_record(pair, &line.cluster, &method.label)
        });
    }
    let timings = members.timings()?;
    let found = digest(head.format, &manifest, &records, &timings);
    let found = found.map_err(|error| unreadable(error.to_string()))?;
    if found != head.digest {
        return Err(unreadable(
            "damaged: its contents differ from what was packed".to_owned(),
        ));
    }
    let results = Results {
        manifest,
        records,
        missing,
        pictures: Vec::new(),
        damaged: Vec::new(),
        methods_listed: false,
    };
    Ok(Bundle {
        results,
        pairs: list,
        occasion: head.occasion,
        timings,
    })
}
