//! What each form holds, line by line. Errors are the line (from 1) and the bare reason.

use std::fmt;

use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::python_json::{self, line_of};
use super::{Context, ForeignCounts, FrameName, ListForm, TargetSlot};

pub(super) type Wrong = (u64, String);

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Content {
    Index(Index),
    Flash3d(Vec<Flash3dRow>),
    Mine(Vec<MineLine>),
    Unisharp(Vec<ManifestLine>),
    Seva(SevaSplit),
}

/// In the order of the file; no key twice.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Index(pub(super) Vec<(String, Option<IndexEntry>)>);

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct IndexEntry {
    #[serde(deserialize_with = "positions")]
    pub(super) context: Vec<u32>,
    #[serde(deserialize_with = "positions")]
    pub(super) target: Vec<u32>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Flash3dRow {
    pub(super) key: String,
    pub(super) source: u32,
    /// Five and ten frames on, and a random one.
    pub(super) targets: [u32; 3],
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MineLine {
    sequence_id: String,
    src_img_obj: MineFrame,
    tgt_img_obj_5_frames: MineFrame,
    tgt_img_obj_10_frames: MineFrame,
    tgt_img_obj_random: MineFrame,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MineFrame {
    sequence_id: String,
    camera_intrinsics: [f64; 4],
    camera_pose: [f64; 12],
    frame_ts: String,
}

/// The scene's fields, one to three, are kept as they are: they may be paths of its authors.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ManifestLine {
    pub(super) fields: Vec<String>,
    pub(super) source: String,
    pub(super) targets: Vec<String>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SevaSplit {
    #[serde(deserialize_with = "positions")]
    pub(super) train_ids: Vec<u32>,
    #[serde(deserialize_with = "positions")]
    pub(super) test_ids: Vec<u32>,
}

/// Positions, or a word on what stands for none.
fn positions<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u32>, D::Error> {
    let places = Option::deserialize(deserializer)?;
    places.ok_or_else(|| {
        serde::de::Error::custom(
            "null instead of a list of positions, which is [] where there are none",
        )
    })
}

/// A pair as the list names it.
pub(super) struct NamedPair {
    pub(super) line: u64,
    /// `None` where the list is of one scene.
    pub(super) scene: Option<String>,
    pub(super) source: FrameName,
    pub(super) target: FrameName,
}

impl<'de> Deserialize<'de> for Index {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Entries;
        impl<'de> Visitor<'de> for Entries {
            type Value = Index;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of scenes")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Index, A::Error> {
                let mut seen = std::collections::BTreeSet::new();
                let mut entries = Vec::new();
                while let Some((key, entry)) = map.next_entry::<String, Option<IndexEntry>>()? {
                    let checked = checked_key(&key).map_err(serde::de::Error::custom)?;
                    if !seen.insert(checked.to_owned()) {
                        let reason = format!("scene '{key}' is given twice");
                        return Err(serde::de::Error::custom(reason));
                    }
                    if entry.as_ref().is_some_and(|entry| entry.context.is_empty()) {
                        let reason = format!("scene '{key}' has no context view");
                        return Err(serde::de::Error::custom(reason));
                    }
                    entries.push((key, entry));
                }
                Ok(Index(entries))
            }
        }
        deserializer.deserialize_map(Entries)
    }
}

impl Serialize for Index {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(key, entry)| (key, entry)))
    }
}

/// A scene's name never leads out of a folder.
fn checked_key(key: &str) -> Result<&str, String> {
    let is_absolute = key.starts_with(['/', '\\']) || key.get(1..2) == Some(":");
    let leads_out = key.split(['/', '\\']).any(|part| part == "..");
    match key.is_empty() || is_absolute || leads_out || key.chars().any(char::is_control) {
        true => Err(format!("'{}' is no scene's name", key.escape_debug())),
        false => Ok(key),
    }
}

/// The lines of a text that are not blank, each with its number.
fn lines(bytes: &[u8]) -> Result<Vec<(u64, &str)>, Wrong> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let line = line_of(bytes, error.valid_up_to());
        (line, "not UTF-8".to_owned())
    })?;
    let lines = (1..).zip(text.lines().map(|line| line.trim_end_matches('\r')));
    Ok(lines.filter(|(_, line)| !line.trim().is_empty()).collect())
}

fn json<'de, T: Deserialize<'de>>(bytes: &'de [u8], first: u64) -> Result<T, Wrong> {
    serde_json::from_slice(bytes).map_err(|error| {
        let line = first + (error.line() as u64).saturating_sub(1);
        (line, error.to_string())
    })
}

impl Content {
    pub(super) fn parse(form: ListForm, bytes: &[u8]) -> Result<Self, Wrong> {
        let content = match form {
            ListForm::Index => Self::Index(json(bytes, 1)?),
            ListForm::Seva => Self::Seva(json(bytes, 1)?),
            ListForm::Flash3d => Self::Flash3d(parsed(bytes, flash3d_row)?),
            ListForm::Unisharp => Self::Unisharp(parsed(bytes, manifest_line)?),
            ListForm::Mine => {
                let lines = lines(bytes)?.into_iter();
                let lines = lines.map(|(n, text)| {
                    let line: MineLine = json(text.as_bytes(), n)?;
                    checked_key(&line.sequence_id).map_err(|reason| (n, reason))?;
                    Ok(line)
                });
                Self::Mine(lines.collect::<Result<_, Wrong>>()?)
            }
        };
        match content.counts().entries {
            0 => Err((1, "the list is empty".to_owned())),
            _ => Ok(content),
        }
    }

    pub(super) fn bytes(&self) -> Vec<u8> {
        let of_lines = |lines: Vec<String>| {
            let text: String = lines.into_iter().map(|line| line + "\n").collect();
            text.into_bytes()
        };
        match self {
            Self::Index(index) => python_json::text(index).into_bytes(),
            Self::Seva(split) => python_json::text(split).into_bytes(),
            Self::Mine(lines) => of_lines(lines.iter().map(python_json::text).collect()),
            Self::Flash3d(rows) => of_lines(
                rows.iter()
                    .map(|row| {
                        let [five, ten, random] = row.targets;
                        format!("{} {} {five} {ten} {random}", row.key, row.source)
                    })
                    .collect(),
            ),
            Self::Unisharp(lines) => of_lines(
                lines
                    .iter()
                    .map(|line| {
                        let (fields, targets) = (line.fields.join("|"), line.targets.join(","));
                        format!("{fields}|{}|{targets}", line.source)
                    })
                    .collect(),
            ),
        }
    }

    pub(super) fn counts(&self) -> ForeignCounts {
        let count = |inputs_and_targets: Vec<(Vec<FrameName>, Vec<FrameName>)>, entries: usize| {
            let targets = inputs_and_targets.iter().map(|(_, targets)| targets.len());
            let inputs = inputs_and_targets.iter().map(|(inputs, targets)| {
                targets
                    .iter()
                    .filter(|target| inputs.contains(target))
                    .count()
            });
            ForeignCounts {
                entries,
                with_pairs: inputs_and_targets
                    .iter()
                    .filter(|(_, targets)| !targets.is_empty())
                    .count(),
                targets: targets.sum(),
                targets_that_are_inputs: inputs.sum(),
            }
        };
        let at = |places: &[u32]| places.iter().map(|&p| FrameName::Position(p)).collect();
        let named = |names: &[String]| names.iter().cloned().map(FrameName::Name).collect();
        match self {
            Self::Index(index) => {
                let entries = index.0.iter().filter_map(|(_, entry)| entry.as_ref());
                let entries = entries.map(|e| (at(&e.context), at(&e.target)));
                count(entries.collect(), index.0.len())
            }
            Self::Seva(split) => {
                let one = vec![(at(&split.train_ids), at(&split.test_ids))];
                count(one, 1)
            }
            Self::Flash3d(rows) => {
                let entries = rows.iter().map(|row| (at(&[row.source]), at(&row.targets)));
                count(entries.collect(), rows.len())
            }
            Self::Unisharp(lines) => {
                let entries = lines.iter();
                let entries =
                    entries.map(|l| (named(std::slice::from_ref(&l.source)), named(&l.targets)));
                count(entries.collect(), lines.len())
            }
            Self::Mine(lines) => {
                let entries = lines.iter().map(|line| {
                    let [source, targets @ ..] = line.stamps();
                    (named(&[source]), named(&targets))
                });
                count(entries.collect(), lines.len())
            }
        }
    }

    /// Its pairs, in its order.
    pub(super) fn pairs(
        &self,
        context: Context,
        slot: TargetSlot,
    ) -> Result<Vec<NamedPair>, Wrong> {
        let mut pairs = Vec::new();
        let mut add = |line: u64, scene: Option<&str>, source: FrameName, target: FrameName| {
            pairs.push(NamedPair {
                line,
                scene: scene.map(str::to_owned),
                source,
                target,
            });
        };
        let slot = match slot {
            TargetSlot::Five => 0,
            TargetSlot::Ten => 1,
            TargetSlot::Random => 2,
        };
        let position = FrameName::Position;
        match self {
            Self::Index(index) => {
                for (key, entry) in &index.0 {
                    let Some(entry) = entry else { continue };
                    for &target in &entry.target {
                        let source = source(&entry.context, target, context).ok_or_else(|| {
                            (1, format!("scene '{key}' has no such context view"))
                        })?;
                        add(1, Some(key), position(source), position(target));
                    }
                }
            }
            Self::Seva(split) => {
                for &target in &split.test_ids {
                    let source = source(&split.train_ids, target, context)
                        .ok_or_else(|| (1, "train_ids has no such view".to_owned()))?;
                    add(1, None, position(source), position(target));
                }
            }
            Self::Flash3d(rows) => {
                for (line, row) in (1..).zip(rows) {
                    let target = row.targets[slot];
                    add(line, Some(&row.key), position(row.source), position(target));
                }
            }
            Self::Mine(lines) => {
                for (number, line) in (1..).zip(lines) {
                    let [source, targets @ ..] = line.stamps().map(FrameName::Name);
                    add(
                        number,
                        Some(&line.sequence_id),
                        source,
                        targets[slot].clone(),
                    );
                }
            }
            Self::Unisharp(lines) => {
                for (number, line) in (1..).zip(lines) {
                    let source = FrameName::Name(line.source.clone());
                    for target in &line.targets {
                        let target = FrameName::Name(target.clone());
                        add(number, Some(line.scene()), source.clone(), target);
                    }
                }
            }
        }
        Ok(pairs)
    }
}

fn source(context: &[u32], target: u32, rule: Context) -> Option<u32> {
    match rule {
        Context::First => context.first().copied(),
        Context::Second => context.get(1).copied(),
        Context::Nearest => context.iter().copied().min_by_key(|c| c.abs_diff(target)),
    }
}

fn parsed<T>(bytes: &[u8], line: fn(&str) -> Result<T, String>) -> Result<Vec<T>, Wrong> {
    let lines = lines(bytes)?.into_iter();
    let parsed = lines.map(|(number, text)| line(text).map_err(|reason| (number, reason)));
    parsed.collect()
}

fn flash3d_row(line: &str) -> Result<Flash3dRow, String> {
    let wrong = || "'key source target target target' is needed, positions from 0".to_owned();
    let [key, numbers @ ..] =
        <[&str; 5]>::try_from(line.split(' ').collect::<Vec<_>>()).map_err(|_| wrong())?;
    let numbers = numbers.map(|number| number.parse::<u32>().ok());
    let [Some(source), Some(five), Some(ten), Some(random)] = numbers else {
        return Err(wrong());
    };
    Ok(Flash3dRow {
        key: checked_key(key)?.to_owned(),
        source,
        targets: [five, ten, random],
    })
}

fn manifest_line(line: &str) -> Result<ManifestLine, String> {
    let fields: Vec<&str> = line.split('|').collect();
    let (3..=4, [scene @ .., source, targets]) = (fields.len(), fields.as_slice()) else {
        return Err(format!(
            "{} fields, where 'scene|source|target,…' has 3 or 4 (theirs drops the line without a word)",
            fields.len()
        ));
    };
    if targets.trim().is_empty() {
        return Err("no target after the last '|'".to_owned());
    }
    let line = ManifestLine {
        fields: scene.iter().map(ToString::to_string).collect(),
        source: (*source).to_owned(),
        targets: targets.split(',').map(str::to_owned).collect(),
    };
    checked_key(line.scene())?;
    let names = std::iter::once(&line.source).chain(&line.targets);
    for name in names {
        let is_plain = !name.contains(['/', '\\']) && !name.chars().any(char::is_control);
        if name.trim().is_empty() || !is_plain {
            return Err(format!("'{}' is no view's name", name.escape_debug()));
        }
    }
    Ok(line)
}

impl ManifestLine {
    /// The second field where the first is a chunk of scenes.
    pub(super) fn scene(&self) -> &str {
        match self.fields.as_slice() {
            [chunk, key, ..] if chunk.ends_with(".torch") => key,
            [scene, ..] => scene,
            [] => "",
        }
    }
}

impl MineLine {
    /// Time stamps of the source and of the three targets.
    fn stamps(&self) -> [String; 4] {
        [
            &self.src_img_obj,
            &self.tgt_img_obj_5_frames,
            &self.tgt_img_obj_10_frames,
            &self.tgt_img_obj_random,
        ]
        .map(|frame| frame.frame_ts.clone())
    }
}
