//! In what two manifests differ, what each way of bringing their results together makes of it, and the manifest of both.

use std::fmt;
use std::path::Path;

use sharp_metrics::{MetricInfo, MetricKey};

use super::error::EvaluateError;
use super::manifest::{AGGREGATION, DatasetRecord, Manifest, MethodRecord, MetricRecord};

/// How results of two manifests come together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meeting {
    /// A run, or scores, are added to a folder.
    Added,
    /// Results are read side by side, as by `report` and `compare`.
    Read,
    /// Units are copied into one folder.
    Merged,
    /// A process does its share of a plan.
    Shard,
}

/// What becomes of a difference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Allowed,
    /// The later meaning of the name counts, and results under the earlier one no longer show.
    Replaced,
    Refused,
}

/// A fact in which two manifests may differ.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Fact {
    /// The metrics' networks ran on another device.
    MetricDevice,
    Protocol,
    Aggregation,
    /// Of those that turn predictions into scored pictures, by name.
    Convention(String),
    /// A setting of the renderer besides its backend.
    Rendering(&'static str),
    /// One is scored on the part that all of its own methods predict.
    CommonRegion,
    /// What a metric computes: its convention, its network, …
    Metric(MetricKey, &'static str),
    /// How a dataset of one name is read.
    Dataset(String),
    /// What a method of one label is.
    Method(String),
    Backend,
    /// The class of CPU kernels.
    Kernels,
    /// Weights or code of a metric.
    MetricCode(MetricKey),
    MethodCode(String),
    /// The later manifest has what the earlier one lacks.
    Unplanned(String),
}

/// A fact with its two values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Difference {
    fact: Fact,
    before: String,
    now: String,
}

impl Fact {
    /// The only place that says which differences are allowed where.
    fn verdict(&self, meeting: Meeting) -> Verdict {
        use Verdict::{Allowed, Refused, Replaced};
        let [added, read, merged, shard] = match self {
            Self::MetricDevice | Self::Protocol | Self::Aggregation | Self::Rendering(_) => {
                [Refused; 4]
            }
            // Scoring rules are part of what identifies a metric's code.
            Self::Convention(_) | Self::Metric(..) => [Allowed, Refused, Refused, Refused],
            // No plan has one.
            Self::CommonRegion => [Allowed, Refused, Refused, Refused],
            Self::Dataset(_) | Self::Method(_) => [Replaced, Refused, Refused, Refused],
            // Scores move in decimals that no table shows.
            Self::Backend | Self::Kernels => [Refused, Allowed, Refused, Refused],
            Self::MetricCode(_) => [Replaced, Allowed, Refused, Refused],
            // Units of other code are other units.
            Self::MethodCode(_) => [Allowed, Allowed, Refused, Refused],
            Self::Unplanned(_) => [Allowed, Allowed, Allowed, Refused],
        };
        match meeting {
            Meeting::Added => added,
            Meeting::Read => read,
            Meeting::Merged => merged,
            Meeting::Shard => shard,
        }
    }
}

impl Difference {
    pub(super) fn verdict(&self, meeting: Meeting) -> Verdict {
        self.fact.verdict(meeting)
    }

    /// What the earlier results of a replaced name are.
    pub(super) fn replaced(&self) -> String {
        match &self.fact {
            Fact::MetricCode(key) => format!("{key} was computed with other weights or code"),
            fact => format!("{fact} was {}", self.before),
        }
    }
}

impl fmt::Display for Fact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MetricDevice => f.write_str("the device behind LPIPS and DISTS"),
            Self::Protocol => f.write_str("the protocol"),
            Self::Aggregation => f.write_str("the aggregation"),
            Self::Convention(name) => f.write_str(name),
            Self::Rendering(what) => write!(f, "the renderer's {what}"),
            Self::CommonRegion => f.write_str("--common-region"),
            Self::Metric(key, what) => write!(f, "{what} of {key}"),
            Self::Dataset(name) => write!(f, "the reading of dataset '{name}'"),
            Self::Method(label) | Self::MethodCode(label) => write!(f, "method '{label}'"),
            Self::Backend => f.write_str("the renderer"),
            Self::Kernels => f.write_str("the class of CPU kernels (`run --simd` pins it)"),
            Self::MetricCode(key) => write!(f, "{key}"),
            Self::Unplanned(what) => f.write_str(what),
        }
    }
}

impl Difference {
    /// As a sentence; `one` and `other` say where the values are.
    pub(super) fn between(&self, one: &str, other: &str) -> String {
        let Self { fact, before, now } = self;
        match fact {
            Fact::CommonRegion => "a common region (--common-region) is that of a folder's own methods: evaluate all of \
                 them in one"
                .to_owned(),
            Fact::MetricCode(_) | Fact::MethodCode(_) => {
                format!("{fact} was computed by another version of the code")
            }
            Fact::Unplanned(what) => format!("{what} is not in the plan"),
            fact => format!("{fact} is \"{before}\" {one} and \"{now}\" {other}"),
        }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.between("in one", "in the other"))
    }
}

/// The first difference that rules a meeting out.
pub(super) fn refusal(before: &Manifest, now: &Manifest, meeting: Meeting) -> Option<Difference> {
    let found = differences(before, now).into_iter();
    let mut refused = found.filter(|found| found.verdict(meeting) == Verdict::Refused);
    refused.next()
}

/// Everything that decides numbers and differs, and what only `now` has.
pub(super) fn differences(before: &Manifest, now: &Manifest) -> Vec<Difference> {
    let mut found = Found(Vec::new());
    if before.has_networks() && now.has_networks() {
        let devices = [before, now].map(|manifest| manifest.metric_networks.device.to_string());
        found.compare(Fact::MetricDevice, devices);
    }
    let protocols = [before, now].map(|manifest| {
        let followed = manifest.protocol.as_ref();
        followed.map_or_else(|| "none".to_owned(), |protocol| protocol.name.clone())
    });
    found.compare(Fact::Protocol, protocols);
    let aggregations = [before, now].map(|manifest| manifest.aggregation.to_string());
    found.compare(Fact::Aggregation, aggregations);
    for (name, text) in now.scoring.iter().filter(|(name, _)| *name != AGGREGATION) {
        // A version that did not state a convention yet had the same one.
        let stated = before.scoring.get(name).unwrap_or(text);
        found.compare(
            Fact::Convention(name.clone()),
            [stated.clone(), text.clone()],
        );
    }
    let settings = before.renderer.settings().into_iter();
    for ((what, before), (_, now)) in settings.zip(now.renderer.settings()) {
        found.compare(Fact::Rendering(what), [before, now]);
    }
    if before.common_region || now.common_region {
        found.add(Fact::CommonRegion);
    }
    let metrics = by_name(&before.metrics, &now.metrics, |metric| metric.info.key);
    let datasets = by_name(&before.datasets, &now.datasets, |dataset| {
        dataset.name.clone()
    });
    let methods = by_name(&before.methods, &now.methods, |method| method.label.clone());
    for (key, before, now) in &metrics {
        let Some(before) = before else {
            found.add(Fact::Unplanned(key.to_string()));
            continue;
        };
        let facts = metric_facts(&before.info).into_iter();
        for ((what, before), (_, now)) in facts.zip(metric_facts(&now.info)) {
            found.compare(Fact::Metric(*key, what), [before, now]);
        }
    }
    for (name, before, now) in &datasets {
        match before {
            None => found.add(Fact::Unplanned(format!("dataset '{name}'"))),
            Some(before) if before.identity != now.identity => {
                found.compare(Fact::Dataset(name.clone()), readings(before, now));
            }
            Some(_) => {}
        }
    }
    for (label, before, now) in &methods {
        match before {
            None => found.add(Fact::Unplanned(format!("method '{label}'"))),
            Some(before) => {
                let identities = [before, now].map(|method| method.identity.to_string());
                found.compare(Fact::Method(label.clone()), identities);
            }
        }
    }
    let backends = [before, now].map(|manifest| manifest.renderer.backend.clone());
    found.compare(Fact::Backend, backends);
    let kernels = [before, now].map(|manifest| manifest.kernels.name().to_owned());
    found.compare(Fact::Kernels, kernels);
    for (key, before, now) in metrics {
        let identity = |metric: &MetricRecord| metric.identity.clone();
        found.compare(
            Fact::MetricCode(key),
            [before.unwrap_or(now), now].map(identity),
        );
    }
    for (label, before, now) in methods {
        let sources = |method: &MethodRecord| method.sources.clone();
        found.compare(
            Fact::MethodCode(label),
            [before.unwrap_or(now), now].map(sources),
        );
    }
    found.0
}

struct Found(Vec<Difference>);

impl Found {
    fn compare(&mut self, fact: Fact, [before, now]: [String; 2]) {
        if before != now {
            self.0.push(Difference { fact, before, now });
        }
    }

    fn add(&mut self, fact: Fact) {
        let (before, now) = Default::default();
        self.0.push(Difference { fact, before, now });
    }
}

/// Each item of `now` with that of its name in `before`.
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

/// The first setting that both state and that differs, else the specs: another version may state more settings.
fn readings(before: &DatasetRecord, now: &DatasetRecord) -> [String; 2] {
    let mut differing = before.readings.iter().filter_map(|old| {
        let new = now.readings.iter().find(|new| new.key == old.key)?;
        let texts = [old, new].map(|reading| format!("{}={}", reading.key, reading.value));
        (old.value != new.value).then_some(texts)
    });
    let specs = || [before, now].map(DatasetRecord::spec_text);
    differing.next().unwrap_or_else(specs)
}

/// A manifest after `new` was added to its folder, with a sentence for each earlier result that tables no longer
/// show because a name now means something else.
///
/// # Errors
/// When results of both would not share a table: the folder's renderer, kernels, protocol, … are others.
pub(super) fn extended(
    before: Manifest,
    new: Manifest,
    root: &Path,
) -> Result<(Manifest, Vec<String>), EvaluateError> {
    let found = differences(&before, &new);
    let of = |verdict: Verdict| {
        let added = move |difference: &&Difference| difference.verdict(Meeting::Added) == verdict;
        found.iter().filter(added)
    };
    if let Some(refused) = of(Verdict::Refused).next() {
        return Err(EvaluateError::OtherMachine {
            folder: root.to_owned(),
            difference: refused.between("in its results", "in this run"),
        });
    }
    let replaced = of(Verdict::Replaced).map(Difference::replaced).collect();
    // Whatever computed the networks of columns that stay.
    let metric_networks = match new.has_networks() {
        true => new.metric_networks,
        false => before.metric_networks,
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

/// Both manifests as one, for results that stand side by side.
///
/// # Errors
/// The first difference that columns of one name, or names of one meaning, cannot have.
pub(super) fn joined(one: Manifest, other: Manifest) -> Result<Manifest, String> {
    if let Some(difference) = refusal(&one, &other, Meeting::Read) {
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

/// Items by name: those that were there, then new ones; `meet` decides on two of one name.
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
