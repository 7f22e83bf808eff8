//! The scores of a run in one file, small enough to be sent, published or committed as a baseline.
//!
//! A ZIP archive: `bundle.json` (version and digest), `manifest.json`, `pairs.csv` (the evaluated pairs alone),
//! `units.jsonl` (what became of each unit), `missing.json`, and `scores.bin`, a column per metric of the manifest: all
//! first bytes of its numbers (f64, big endian), then all second bytes, and so on, which packs better than number by
//! number. Without pictures, timings, and what methods report about their predictions. Equal results are equal bytes.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Cursor, Read, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::error::EvaluateError;
use super::folder::RunFolder;
use super::manifest::Manifest;
use super::record::{ChosenScale, Crop, Record, Score, Status};
use super::results::Results;
use crate::io::atomic_files::{FileError, write_atomic};
use crate::io::hash::StableHasher;
use crate::pairs::{Pair, PairList};

/// Version of the layout. Older ones stay readable.
const FORMAT: u32 = 1;

/// Bytes that a member of text may unpack to: a hundred times those of the paper's whole evaluation.
const MAX_MEMBER: u64 = 1 << 28;

/// Stands for a score that a unit does not have. No arithmetic makes this NaN.
const ABSENT: u64 = u64::MAX;

#[derive(Serialize, Deserialize)]
struct Head {
    format: u32,
    /// Hash of the records.
    digest: String,
}

/// A unit without its scores and what the pair list says of its pair.
#[derive(Serialize, Deserialize)]
struct UnitLine {
    /// Position in `pairs.csv`.
    pair: usize,
    /// Position in the manifest.
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
}

/// Writes the results of a run folder into a file.
///
/// # Errors
/// When the folder cannot be read or the file not be written; also where there is a file that is no bundle.
pub fn write_bundle(root: &Path, out: &Path) -> Result<Results, EvaluateError> {
    if out.exists() && read_bundle(out).is_err() {
        return Err(EvaluateError::Bundle {
            path: out.to_owned(),
            reason: "so it is not written over; choose another file".to_owned(),
        });
    }
    let results = Results::read(root)?;
    let listed = PairList::read(&RunFolder::open(root)?.pairs_path())?;
    let used: BTreeSet<&str> = results
        .records
        .iter()
        .map(|record| record.pair_id.as_str())
        .chain(results.missing.iter().map(|(pair, _)| pair.as_str()))
        .collect();
    let mut pairs = listed.pairs;
    pairs.retain(|pair| used.contains(pair.pair_id.as_str()));
    let bytes = pack(&results, pairs).map_err(FileError::new(out, "encode"))?;
    write_atomic(out, &bytes)?;
    Ok(results)
}

pub(super) fn pack(results: &Results, pairs: Vec<Pair>) -> std::io::Result<Vec<u8>> {
    let Results {
        manifest,
        records,
        missing,
        ..
    } = results;
    let list = PairList::new("pairs.csv", pairs);
    let places = |names: Vec<&str>| -> BTreeMap<String, usize> {
        let names = names.into_iter().map(str::to_owned);
        names.zip(0..).collect()
    };
    let pairs = places(list.pairs.iter().map(|p| p.pair_id.as_str()).collect());
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
    let head = Head {
        format: FORMAT,
        digest: digest(records)?,
    };
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .compression_level(Some(9));
    for (name, bytes) in [
        ("bundle.json", serde_json::to_vec(&head)?),
        ("manifest.json", serde_json::to_vec(manifest)?),
        ("pairs.csv", list.bytes().to_vec()),
        ("units.jsonl", units.into_bytes()),
        ("missing.json", serde_json::to_vec(missing)?),
        ("scores.bin", scores),
    ] {
        archive.start_file(name, options)?;
        archive.write_all(&bytes)?;
    }
    Ok(archive.finish()?.into_inner())
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

/// Hash of what a bundle holds of records.
fn digest(records: &[Record]) -> serde_json::Result<String> {
    let mut hasher = StableHasher::default();
    for record in records {
        let kept = Record {
            extras: BTreeMap::new(),
            ..record.clone()
        };
        hasher.add("record", &serde_json::to_string(&kept)?);
    }
    Ok(hasher.finish())
}

/// Reads what [`write_bundle`] wrote.
///
/// # Errors
/// When it is no whole bundle, or one of a later version.
pub(super) fn read_bundle(path: &Path) -> Result<Results, EvaluateError> {
    let unreadable = |reason: String| EvaluateError::Bundle {
        path: path.to_owned(),
        reason,
    };
    let bytes = sharp::files::read(path).map_err(FileError::new(path, "read"))?;
    let mut members = ZipArchive::new(Cursor::new(bytes.as_slice()))
        .map_err(|error| unreadable(error.to_string()))?;
    let mut member = |name: &str, longest: u64| -> Result<Vec<u8>, EvaluateError> {
        let file = members.by_name(name);
        let file = file.map_err(|error| unreadable(format!("{name}: {error}")))?;
        let mut bytes = Vec::new();
        let read = file.take(longest).read_to_end(&mut bytes);
        read.map_err(|error| unreadable(format!("{name}: {error}")))?;
        Ok(bytes)
    };
    fn parse<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
        serde_json::from_slice(bytes).map_err(|error| error.to_string())
    }
    let head: Head = parse(&member("bundle.json", MAX_MEMBER)?).map_err(unreadable)?;
    if head.format > FORMAT {
        return Err(unreadable(format!(
            "format {}; this version reads formats up to {FORMAT}",
            head.format
        )));
    }
    let manifest: Manifest = parse(&member("manifest.json", MAX_MEMBER)?).map_err(unreadable)?;
    let missing = parse(&member("missing.json", MAX_MEMBER)?).map_err(unreadable)?;
    let list = PairList::parse(&path.join("pairs.csv"), &member("pairs.csv", MAX_MEMBER)?)?;
    let units = member("units.jsonl", MAX_MEMBER)?;
    let lines: Vec<UnitLine> = serde_json::Deserializer::from_slice(&units)
        .into_iter()
        .collect::<Result<_, _>>()
        .map_err(|error| unreadable(format!("units.jsonl: {error}")))?;
    let n = lines.len();
    let expected = 8 * n * manifest.metrics.len();
    let scores = member("scores.bin", expected as u64 + 1)?;
    if scores.len() != expected {
        return Err(unreadable(
            "scores.bin is not of its units' length".to_owned(),
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
                "units.jsonl names a pair or method that is not there".to_owned(),
            ));
        };
        records.push(Record {
            pair_id: pair.pair_id.clone(),
            dataset: pair.dataset.clone(),
            scene: pair.scene.clone(),
            cluster: line.cluster,
            source: pair.source.clone(),
            target: pair.target.clone(),
            method: method.label.clone(),
            baseline_m: pair.baseline_m,
            rotation_deg: pair.rotation_deg,
            median_depth_m: pair.median_depth_m,
            overlap: pair.overlap,
            status: line.status,
            scores: found,
            crop: line.crop,
            valid_share: line.valid_share,
            resized_from: line.resized_from,
            scale: line.scale,
            extras: BTreeMap::new(),
        });
    }
    let found = digest(&records).map_err(|error| unreadable(error.to_string()))?;
    if found != head.digest {
        return Err(unreadable(
            "damaged: its records are not those that were packed".to_owned(),
        ));
    }
    Ok(Results {
        manifest,
        records,
        missing,
        pictures: Vec::new(),
    })
}
