//! Parsers for each list format, line by line. Errors give the line (from 1) and the reason; the caller adds the file.

use std::fmt;

use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::{Context, ForeignCounts, FrameName, ListForm, TargetSlot};

pub(super) type Wrong = (u64, String);

/// A scene's source and target views, as named in a list.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    /// Line where the entry begins.
    line: u64,
    /// Scene; `None` if the list is for a single scene.
    scene: Option<String>,
    inputs: Vec<FrameName>,
    targets: Vec<FrameName>,
}

/// Entries in the order of the file, with unique keys.
struct Index(Vec<(String, IndexEntry)>);

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct IndexEntry {
    #[serde(deserialize_with = "positions")]
    context: Vec<FrameName>,
    #[serde(deserialize_with = "positions")]
    target: Vec<FrameName>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MineLine {
    sequence_id: String,
    src_img_obj: MineFrame,
    tgt_img_obj_5_frames: MineFrame,
    tgt_img_obj_10_frames: MineFrame,
    tgt_img_obj_random: MineFrame,
}

/// One frame; its cameras are ignored because poses are taken from the dataset.
#[derive(Deserialize)]
struct MineFrame {
    frame_ts: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SevaSplit {
    #[serde(deserialize_with = "positions")]
    train_ids: Vec<FrameName>,
    #[serde(deserialize_with = "positions")]
    test_ids: Vec<FrameName>,
}

/// Parses a list of positions. Rejects null with an error that says what to write instead.
fn positions<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<FrameName>, D::Error> {
    let places: Option<Vec<u32>> = Option::deserialize(deserializer)?;
    let places = places.ok_or_else(|| {
        serde::de::Error::custom("null instead of a list of positions; use [] for none")
    })?;
    Ok(places.into_iter().map(FrameName::Position).collect())
}

/// A pair as named in a list.
pub(super) struct NamedPair {
    pub(super) line: u64,
    /// Scene; `None` if the list is for a single scene.
    pub(super) scene: Option<String>,
    pub(super) source: FrameName,
    pub(super) target: FrameName,
    /// The highest position of any view in the entry, even if this pair does not use the view; `None` for other kinds
    /// of names.
    pub(super) last: Option<FrameName>,
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
                    checked_key(&key).map_err(serde::de::Error::custom)?;
                    if !seen.insert(key.clone()) {
                        let reason = format!("scene '{key}' is given twice");
                        return Err(serde::de::Error::custom(reason));
                    }
                    if entry.as_ref().is_some_and(|entry| entry.context.is_empty()) {
                        let reason = format!("scene '{key}' has no context view");
                        return Err(serde::de::Error::custom(reason));
                    }
                    entries.push((key, entry.unwrap_or_default()));
                }
                Ok(Index(entries))
            }
        }
        deserializer.deserialize_map(Entries)
    }
}

/// Rejects a scene's name that, as a path, would lead out of a folder.
fn checked_key(key: &str) -> Result<&str, String> {
    let is_absolute = key.starts_with(['/', '\\']) || key.get(1..2) == Some(":");
    let leads_out = key.split(['/', '\\']).any(|part| part == "..");
    if key.is_empty() || is_absolute || leads_out || key.chars().any(char::is_control) {
        Err(format!(
            "'{}' is not the name of a scene",
            key.escape_debug()
        ))
    } else {
        Ok(key)
    }
}

/// The non-blank lines of a text with their numbers.
fn lines(bytes: &[u8]) -> Result<Vec<(u64, &str)>, Wrong> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let before = bytes[..error.valid_up_to()].iter();
        let line = 1 + before.filter(|byte| **byte == b'\n').count() as u64;
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

/// Parses a list.
///
/// # Errors
/// The line and reason of the first mistake.
pub(super) fn parse(form: ListForm, bytes: &[u8]) -> Result<Vec<Entry>, Wrong> {
    let entries = match form {
        ListForm::Index => {
            let index: Index = json(bytes, 1)?;
            let entries = index.0.into_iter().map(|(scene, entry)| Entry {
                line: 1,
                scene: Some(scene),
                inputs: entry.context,
                targets: entry.target,
            });
            entries.collect()
        }
        ListForm::Seva => {
            let split: SevaSplit = json(bytes, 1)?;
            vec![Entry {
                line: 1,
                scene: None,
                inputs: split.train_ids,
                targets: split.test_ids,
            }]
        }
        ListForm::Flash3d => parsed(bytes, |n, line| flash3d_row(n, line).map_err(|e| (n, e)))?,
        ListForm::Unisharp => parsed(bytes, |n, line| manifest_line(n, line).map_err(|e| (n, e)))?,
        ListForm::Mine => parsed(bytes, |n, line| mine_line(n, json(line.as_bytes(), n)?))?,
    };
    if entries.is_empty() {
        Err((1, "the list is empty".to_owned()))
    } else {
        Ok(entries)
    }
}

pub(super) fn counts(entries: &[Entry]) -> ForeignCounts {
    let own_inputs = |entry: &Entry| {
        let targets = entry.targets.iter();
        targets
            .filter(|target| entry.inputs.contains(target))
            .count()
    };
    ForeignCounts {
        entries: entries.len(),
        with_pairs: entries.iter().filter(|e| !e.targets.is_empty()).count(),
        targets: entries.iter().map(|entry| entry.targets.len()).sum(),
        targets_that_are_inputs: entries.iter().map(own_inputs).sum(),
    }
}

impl Entry {
    /// The pairs in order. If an entry has several input views, `context` selects one for each target. In formats with
    /// three kinds of targets, only targets of the kind `slot` are used.
    pub(super) fn pairs(
        &self,
        form: ListForm,
        context: Context,
        slot: TargetSlot,
    ) -> Result<Vec<NamedPair>, Wrong> {
        let (rule, targets) = match form {
            ListForm::Index | ListForm::Seva => (context, &self.targets[..]),
            ListForm::Unisharp => (Context::First, &self.targets[..]),
            ListForm::Flash3d | ListForm::Mine => {
                (Context::First, &self.targets[slot as usize..][..1])
            }
        };
        // Record the highest position, because a position beyond the scene shows that the list counts from 1.
        let last = self.inputs.iter().chain(targets).max().cloned();
        let last = last.filter(|_| matches!(form, ListForm::Index | ListForm::Seva));
        let pair = |target: &FrameName| {
            let source = source(&self.inputs, target, rule).ok_or_else(|| {
                let scene = self.scene.as_ref();
                let what = scene.map_or("train_ids".to_owned(), |key| format!("scene '{key}'"));
                (self.line, format!("{what} has too few context views"))
            })?;
            Ok(NamedPair {
                line: self.line,
                scene: self.scene.clone(),
                source: source.clone(),
                target: target.clone(),
                last: last.clone(),
            })
        };
        targets.iter().map(pair).collect()
    }
}

fn source<'a>(
    context: &'a [FrameName],
    target: &FrameName,
    rule: Context,
) -> Option<&'a FrameName> {
    let place = |frame: &FrameName| match frame {
        FrameName::Position(at) => *at,
        FrameName::Name(_) => 0,
    };
    match rule {
        Context::First => context.first(),
        Context::Second => context.get(1),
        Context::Nearest => context
            .iter()
            .min_by_key(|frame| place(frame).abs_diff(place(target))),
    }
}

fn parsed(
    bytes: &[u8],
    line: impl Fn(u64, &str) -> Result<Entry, Wrong>,
) -> Result<Vec<Entry>, Wrong> {
    let lines = lines(bytes)?.into_iter();
    lines.map(|(number, text)| line(number, text)).collect()
}

fn flash3d_row(number: u64, line: &str) -> Result<Entry, String> {
    let wrong = || "expected 'key source target target target', positions from 0".to_owned();
    let [key, numbers @ ..] =
        <[&str; 5]>::try_from(line.split(' ').collect::<Vec<_>>()).map_err(|_| wrong())?;
    let numbers = numbers.map(|number| number.parse().ok().map(FrameName::Position));
    let [Some(source), Some(five), Some(ten), Some(random)] = numbers else {
        return Err(wrong());
    };
    Ok(Entry {
        line: number,
        scene: Some(checked_key(key)?.to_owned()),
        inputs: vec![source],
        targets: vec![five, ten, random],
    })
}

fn mine_line(number: u64, line: MineLine) -> Result<Entry, Wrong> {
    checked_key(&line.sequence_id).map_err(|reason| (number, reason))?;
    let stamp = |frame: MineFrame| FrameName::Name(frame.frame_ts);
    let targets = [
        line.tgt_img_obj_5_frames,
        line.tgt_img_obj_10_frames,
        line.tgt_img_obj_random,
    ];
    Ok(Entry {
        line: number,
        scene: Some(line.sequence_id),
        inputs: vec![stamp(line.src_img_obj)],
        targets: targets.map(stamp).into(),
    })
}

fn manifest_line(number: u64, line: &str) -> Result<Entry, String> {
    let fields: Vec<&str> = line.split('|').collect();
    // If the first of four fields names a chunk of scenes, the second names the scene.
    let (scene, source, targets) = match fields[..] {
        [chunk, scene, source, targets] if chunk.ends_with(".torch") => (scene, source, targets),
        [scene, source, targets] | [scene, _, source, targets] => (scene, source, targets),
        _ => {
            return Err(format!(
                "{} fields instead of the 3 or 4 of 'scene|source|target,…' (the original silently drops such lines)",
                fields.len()
            ));
        }
    };
    if targets.trim().is_empty() {
        return Err("no target after the last '|'".to_owned());
    }
    let names = targets.split(',').chain([source]);
    for name in names {
        let is_plain = !name.contains(['/', '\\']) && !name.chars().any(char::is_control);
        if name.trim().is_empty() || !is_plain {
            return Err(format!(
                "'{}' is not the name of a view",
                name.escape_debug()
            ));
        }
    }
    let named = |name: &str| FrameName::Name(name.to_owned());
    Ok(Entry {
        line: number,
        scene: Some(checked_key(scene)?.to_owned()),
        inputs: vec![named(source)],
        targets: targets.split(',').map(named).collect(),
    })
}
