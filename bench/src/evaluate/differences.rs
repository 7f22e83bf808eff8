//! Compares two manifests, decides whether their results may be combined, and if so combines them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;

use sharp_metrics::MetricInfo;

use super::error::EvaluateError;
use super::manifest::{AGGREGATION, DatasetRecord, Manifest};

/// Why two manifests are compared; indexes a [`Row`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    /// `run` or `score` adds to a folder.
    Added,
    /// `report` or `compare` shows both.
    Read,
    /// `merge` copies the units into one folder.
    Merged,
    /// A shard executes a plan.
    Shard,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Effect {
    Allowed,
    /// The new meaning of the dataset's or method's name applies; tables no longer show earlier results under this
    /// name.
    Replaced,
    Refused,
}
use Effect::{Allowed, Refused, Replaced};

/// The effect of a difference for each [`Purpose`]. The constants below are all rows in use.
type Row = [Effect; 4];
/// Facts that affect every value; results that differ in such a fact are never combined.
const RULE: Row = [Refused, Refused, Refused, Refused];
/// Scoring conventions. Each metric's identity includes them, so a change within a folder replaces scores.
const CONVENTION: Row = [Allowed, Refused, Refused, Refused];
/// The meaning of a dataset's or method's name.
const NAME: Row = [Replaced, Refused, Refused, Refused];
/// Facts that change scores only in digits that no table shows.
const MACHINE: Row = [Refused, Allowed, Refused, Refused];
/// Code of a method or reader; weights or code of a metric.
const CODE: Row = [Replaced, Allowed, Refused, Refused];
/// A metric, method or dataset that the plan does not have.
const UNPLANNED: Row = [Allowed, Allowed, Allowed, Refused];

/// A fact in which two manifests differ.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ManifestDifference {
    row: Row,
    /// The name of the fact that differs; if `values` is `None`, a complete sentence on the difference.
    what: String,
    /// The old and the new value.
    values: Option<[String; 2]>,
    /// Advice that follows the sentence.
    advice: &'static str,
}

impl ManifestDifference {
    pub(super) fn effect(&self, purpose: Purpose) -> Effect {
        self.row[purpose as usize]
    }

    /// Text for a message about earlier results that tables no longer show: the fact that differs, with the old value
    /// if known.
    pub(super) fn replaced(&self) -> String {
        match &self.values {
            Some([before, _]) => format!("{} was {before}", self.what),
            None => self.what.clone(),
        }
    }

    /// A sentence with both values; `one` and `other` name their sources.
    pub(super) fn between(&self, one: &str, other: &str) -> String {
        let what = &self.what;
        match &self.values {
            Some([before, now]) => format!("{what} is \"{before}\" {one} and \"{now}\" {other}"),
            None => what.clone(),
        }
    }
}

impl fmt::Display for ManifestDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.between("in the first", "in the second"))?;
        f.write_str(self.advice)
    }
}

/// For each dataset, the sources of the depth that decided overlap, with checkpoint hashes if known.
fn overlap_depths(manifest: &Manifest) -> BTreeMap<&str, String> {
    let mut sources: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for (dataset, choices) in manifest.pairs.lists.iter().flat_map(|list| &list.choices) {
        let sources = sources.entry(dataset).or_default();
        sources.insert(choices.overlap_depth.clone());
    }
    let sources = sources.into_iter();
    sources
        .map(|(dataset, all)| (dataset, Vec::from_iter(all).join(" and ")))
        .collect()
}

/// The first difference that forbids combining the results.
pub(super) fn refusal(
    before: &Manifest,
    now: &Manifest,
    purpose: Purpose,
) -> Option<ManifestDifference> {
    let found = differences(before, now).into_iter();
    let mut refused = found.filter(|found| found.effect(purpose) == Refused);
    refused.next()
}

/// All differences that affect values, including facts that only `now` has.
pub(super) fn differences(before: &Manifest, now: &Manifest) -> Vec<ManifestDifference> {
    let mut found = Found(Vec::new());
    let both = [before, now];
    if both.iter().all(|manifest| manifest.has_networks()) {
        let devices = both.map(|manifest| manifest.metric_networks.device.to_string());
        found.compare(RULE, "the device behind LPIPS and DISTS", devices);
    }
    let protocols = both.map(|manifest| {
        let followed = manifest.protocol.as_ref();
        followed.map_or_else(|| "none".to_owned(), |protocol| protocol.name.clone())
    });
    found.compare(RULE, "the protocol", protocols);
    let aggregations = both.map(|manifest| manifest.aggregation.to_string());
    found.compare(RULE, "the aggregation", aggregations);
    for (name, text) in now.scoring.iter().filter(|(name, _)| *name != AGGREGATION) {
        // Older versions did not record every convention; an unrecorded convention was the same as today's.
        let stated = before.scoring.get(name).unwrap_or(text);
        found.compare(CONVENTION, name, [stated.clone(), text.clone()]);
    }
    let settings = before.renderer.settings().into_iter();
    for ((what, before), (_, now)) in settings.zip(now.renderer.settings()) {
        found.compare(RULE, &format!("the renderer's {what}"), [before, now]);
    }
    if before.common_region || now.common_region {
        let what = "a common region (--common-region) depends on all methods of a folder; evaluate \
                    all methods in one folder";
        found.add(CONVENTION, what.to_owned());
    }
    let depths = both.map(overlap_depths);
    for (dataset, before) in &depths[0] {
        if let Some(now) = depths[1].get(dataset) {
            let what = format!("the depth that decides overlap in dataset '{dataset}'");
            found.compare(RULE, &what, [before.clone(), now.clone()]);
        }
    }
    let metrics = by_name(&before.metrics, &now.metrics, |metric| metric.info.key);
    let datasets = by_name(&before.datasets, &now.datasets, |dataset| {
        dataset.name.clone()
    });
    let methods = by_name(&before.methods, &now.methods, |method| method.label.clone());
    for (key, before, now) in &metrics {
        let facts = metric_facts(&before.unwrap_or(now).info).into_iter();
        for ((what, before), (_, now)) in facts.zip(metric_facts(&now.info)) {
            found.compare(CONVENTION, &format!("{what} of {key}"), [before, now]);
        }
    }
    for (name, before, now) in &datasets {
        let Some(before) = before.filter(|before| before.identity != now.identity) else {
            continue;
        };
        match readings(before, now) {
            [before, now] if before == now => {
                let what = format!("dataset '{name}' was read by a different version of the code");
                found.add(CODE, what);
            }
            texts => found.compare(NAME, &format!("the setting of dataset '{name}'"), texts),
        }
    }
    for (label, before, now) in &methods {
        let texts = [before.unwrap_or(now), now].map(|method| {
            let known: String = method
                .privilege
                .phrases()
                .map(|p| format!(", {p}"))
                .collect();
            format!("{}{known}", method.identity)
        });
        if texts[0] != texts[1] {
            found.0.push(ManifestDifference {
                row: NAME,
                what: format!("method '{label}'"),
                values: Some(texts),
                advice: "; `report NAME=FOLDER` distinguishes two methods with the same label",
            });
        }
    }
    let backends = both.map(|manifest| manifest.renderer.backend.clone());
    found.compare(MACHINE, "the renderer", backends);
    let kernels = both.map(|manifest| manifest.kernels.name().to_owned());
    let what = "the class of CPU kernels (`run --simd` pins it)";
    found.compare(MACHINE, what, kernels);
    let other_code = |name: &str| format!("{name} was computed with different weights or code");
    for (key, before, now) in metrics {
        match before {
            None => found.add(UNPLANNED, format!("{key} is not in the plan")),
            Some(before) if before.identity != now.identity => {
                found.add(CODE, other_code(&key.to_string()));
            }
            Some(_) => {}
        }
    }
    for (label, before, now) in methods {
        match before {
            None => found.add(UNPLANNED, format!("method '{label}' is not in the plan")),
            Some(before) if before.sources != now.sources => {
                found.add(CODE, other_code(&format!("method '{label}'")));
            }
            Some(_) => {}
        }
    }
    for (name, ..) in datasets.iter().filter(|(_, before, _)| before.is_none()) {
        found.add(UNPLANNED, format!("dataset '{name}' is not in the plan"));
    }
    found.0
}

struct Found(Vec<ManifestDifference>);

impl Found {
    fn compare(&mut self, row: Row, what: &str, [before, now]: [String; 2]) {
        if before != now {
            self.0.push(ManifestDifference {
                row,
                what: what.to_owned(),
                values: Some([before, now]),
                advice: "",
            });
        }
    }

    fn add(&mut self, row: Row, what: String) {
        self.0.push(ManifestDifference {
            row,
            what,
            values: None,
            advice: "",
        });
    }
}

/// Pairs each item of `now` with the item of the same name in `before`.
fn by_name<'m, T, N: PartialEq>(
    before: &'m [T],
    now: &'m [T],
    name: fn(&T) -> N,
) -> Vec<(N, Option<&'m T>, &'m T)> {
    let old = |new: &T| before.iter().find(|old| name(old) == name(new));
    now.iter().map(|new| (name(new), old(new), new)).collect()
}

fn metric_facts(info: &MetricInfo) -> [(&'static str, String); 4] {
    let network = info.backbone.as_ref();
    [
        ("the convention", info.convention.clone()),
        (
            "the network",
            network.map(ToString::to_string).unwrap_or_default(),
        ),
        ("the input range", info.input_range.clone()),
        ("the resize rule", info.resize.clone()),
    ]
}

/// The first reader setting whose value differs between the manifests, as `key=value` for each manifest. Skips settings
/// that only one manifest records, because versions differ in what they record. If no value differs, returns both
/// specs.
fn readings(before: &DatasetRecord, now: &DatasetRecord) -> [String; 2] {
    let mut differing = before.readings.iter().filter_map(|old| {
        let new = now.readings.iter().find(|new| new.key == old.key)?;
        let texts = [old, new].map(|reading| format!("{}={}", reading.key, reading.value));
        (old.value != new.value).then_some(texts)
    });
    let specs = || [before, now].map(DatasetRecord::spec_text);
    differing.next().unwrap_or_else(specs)
}

/// The folder's manifest after adding `new` to `before`. Also returns [`ManifestDifference::replaced`] for each
/// difference that makes tables hide earlier results.
///
/// # Errors
/// If the manifests differ in a fact that all results of a folder must share, such as renderer, kernels or protocol.
pub(super) fn extended(
    before: Manifest,
    new: Manifest,
    root: &Path,
) -> Result<(Manifest, Vec<String>), EvaluateError> {
    let found = differences(&before, &new);
    let of = |effect: Effect| {
        let added =
            move |difference: &&ManifestDifference| difference.effect(Purpose::Added) == effect;
        found.iter().filter(added)
    };
    if let Some(refused) = of(Refused).next() {
        return Err(EvaluateError::OtherMachine {
            folder: root.to_owned(),
            difference: refused.between("in its results", "in this run"),
        });
    }
    let replaced = of(Replaced).map(ManifestDifference::replaced).collect();
    // If `new` uses no network, columns kept from `before` may still depend on its networks, so keep their record.
    let metric_networks = if new.has_networks() {
        new.metric_networks
    } else {
        before.metric_networks
    };
    let mut pairs = new.pairs;
    let lists = std::mem::take(&mut pairs.lists);
    pairs.lists = before.pairs.lists;
    pairs.lists.retain(|list| !lists.contains(list));
    pairs.lists.extend(lists);
    let merged = Manifest {
        datasets: union(
            before.datasets,
            new.datasets,
            |d| d.name.clone(),
            |old, new| *old = new,
        ),
        methods: union(
            before.methods,
            new.methods,
            |m| m.label.clone(),
            |old, new| *old = new,
        ),
        metrics: union(
            before.metrics,
            new.metrics,
            |m| m.info.key,
            |old, new| *old = new,
        ),
        metric_networks,
        pairs,
        ..new
    };
    Ok((merged, replaced))
}

/// Combines two manifests for results that are shown together.
///
/// # Errors
/// If the results cannot share columns or names; the error is the first difference that prevents it.
pub(super) fn joined(one: Manifest, other: Manifest) -> Result<Manifest, String> {
    if let Some(difference) = refusal(&one, &other, Purpose::Read) {
        return Err(difference.to_string());
    }
    let mut scoring = one.scoring;
    for (name, text) in other.scoring {
        scoring.entry(name).or_insert(text);
    }
    let mut pairs = one.pairs;
    for list in other.pairs.lists {
        if !pairs.lists.contains(&list) {
            pairs.listed = pairs.listed.max(list.listed);
            pairs.evaluated = pairs.evaluated.max(list.evaluated);
            pairs.lists.push(list);
        }
    }
    let join_dataset = |before: &mut DatasetRecord, new: DatasetRecord| {
        before.scenes = before.scenes.max(new.scenes);
        before.views = before.views.max(new.views);
        before.unreadable_views = before.unreadable_views.max(new.unreadable_views);
        let groups = new.left_out.into_iter();
        let unknown = groups.filter(|group| !before.left_out.contains(group));
        before.left_out = before.left_out.iter().cloned().chain(unknown).collect();
    };
    Ok(Manifest {
        datasets: union(
            one.datasets,
            other.datasets,
            |d| d.name.clone(),
            join_dataset,
        ),
        methods: union(one.methods, other.methods, |m| m.label.clone(), |_, _| {}),
        metrics: union(one.metrics, other.metrics, |m| m.info.key, |_, _| {}),
        scoring,
        pairs,
        ..one
    })
}

/// The items of `all`, then those items of `new` whose names are not in `all`. `meet` combines two
/// items of the same name.
fn union<T, N: PartialEq>(
    mut all: Vec<T>,
    new: Vec<T>,
    name: impl Fn(&T) -> N,
    meet: impl Fn(&mut T, T),
) -> Vec<T> {
    for item in new {
        match all.iter_mut().find(|old| name(old) == name(&item)) {
            Some(old) => meet(old, item),
            None => all.push(item),
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::test_records::manifest;
    use crate::methods::TrueDepth;

    /// The effect of a single difference, for each purpose.
    fn effects(change: impl Fn(&mut Manifest)) -> [Effect; 4] {
        let before = manifest("psnr");
        let mut now = before.clone();
        change(&mut now);
        let found = differences(&before, &now);
        assert_eq!(found.len(), 1, "{found:?}");
        [
            Purpose::Added,
            Purpose::Read,
            Purpose::Merged,
            Purpose::Shard,
        ]
        .map(|purpose| found[0].effect(purpose))
    }

    #[test]
    fn each_difference_has_its_row() {
        assert_eq!(differences(&manifest("psnr"), &manifest("psnr")), []);
        let rule = |now: &mut Manifest| now.renderer.near = 1.0;
        assert_eq!(effects(rule), RULE);
        let convention = |now: &mut Manifest| now.metrics[0].info.input_range = "0..2".to_owned();
        assert_eq!(effects(convention), CONVENTION);
        assert_eq!(
            effects(|now| now.methods[0].privilege.depth = TrueDepth::DepthScale),
            NAME
        );
        assert_eq!(
            effects(|now| now.renderer.backend = "wgpu".to_owned()),
            MACHINE
        );
        // Another version of a reader with the same settings.
        assert_eq!(effects(|now| now.datasets[0].identity.clear()), CODE);
        assert_eq!(effects(|now| now.methods[0].sources.clear()), CODE);
        assert_eq!(effects(|now| now.metrics[0].identity.clear()), CODE);
        assert_eq!(
            effects(|now| now.methods[0].label = "new".to_owned()),
            UNPLANNED
        );
    }

    #[test]
    fn datasets_of_one_name_are_told_apart_by_a_setting() {
        let before = manifest("psnr");
        let mut now = before.clone();
        now.datasets[0].identity.clear();
        now.datasets[0].readings[0].value = "9x9".to_owned();
        let found = refusal(&before, &now, Purpose::Read).unwrap().to_string();
        assert!(found.contains("=9x9"), "{found}");
    }
}
