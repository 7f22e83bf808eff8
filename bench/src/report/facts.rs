//! Facts about how the numbers of a run were computed, as names and values under headings.

use std::collections::BTreeMap;

use crate::evaluate::manifest::{ListRecord, Manifest, ProtocolRecord};
use crate::io::hash::sha256_hex;
use crate::pairs::PairProvenance;
use crate::pairs::options::paper::PROXY;

/// Name and value of a fact.
type Fact = (String, String);

/// Facts under one heading, in the order shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FactGroup {
    /// Heading such as `Scoring` or `Pair list`.
    pub title: String,
    pub facts: Vec<Fact>,
}

impl FactGroup {
    pub(super) fn new(title: &str, facts: Vec<Fact>) -> Self {
        Self {
            title: title.to_owned(),
            facts,
        }
    }
}

/// The facts in a manifest: options, versions and pair lists.
pub(super) fn facts(manifest: &Manifest) -> Vec<FactGroup> {
    let mut groups = Vec::new();
    let notes = dataset_notes(manifest);
    if !notes.is_empty() {
        groups.push(FactGroup::new("Dataset notes", notes));
    }
    let mut scoring: Vec<Fact> = manifest.scoring.clone().into_iter().collect();
    scoring.extend([
        fact("kernels", format!("cpu-{}", manifest.kernels)),
        fact("metric networks", manifest.metric_networks),
        fact("renderer", &manifest.renderer),
    ]);
    if manifest.common_region {
        let rule = "on the part of a target that all methods predict (--common-region)";
        scoring.push(fact("region", rule));
    }
    scoring.sort();
    groups.push(FactGroup::new("Scoring", scoring));
    if let Some(protocol) = &manifest.protocol {
        groups.push(FactGroup::new("Protocol", protocol_facts(protocol)));
    }
    for list in &manifest.pairs.lists {
        groups.push(FactGroup::new("Pair list", list_facts(list)));
    }
    let sources: String = manifest.sources.values().map(String::as_str).collect();
    let sources = sha256_hex(sources.as_bytes());
    let build = vec![
        fact("sharp-bench", &manifest.version),
        fact("sources", format!("{sources} (by stage in manifest.json)")),
    ];
    groups.push(FactGroup::new("Build", build));
    groups
}

fn dataset_notes(manifest: &Manifest) -> Vec<Fact> {
    let mut notes = Vec::new();
    for dataset in &manifest.datasets {
        let readings = dataset.readings.iter().map(|r| {
            let open = if r.open && !r.proxy {
                " (open in the paper)"
            } else {
                ""
            };
            format!("{}={}{}{open}", r.key, r.value, mark(r.proxy))
        });
        let left_out = dataset.left_out.iter().map(ToString::to_string);
        let all = readings
            .chain(dataset.notes.iter().cloned())
            .chain(left_out);
        notes.extend(all.map(|note| (dataset.name.clone(), note)));
    }
    notes
}

fn protocol_facts(protocol: &ProtocolRecord) -> Vec<Fact> {
    let mut facts = vec![
        fact("name", &protocol.name),
        fact("source", &protocol.source),
        fact("failures", &protocol.failures),
    ];
    let traps = protocol.traps.iter();
    facts.extend(traps.map(|trap| fact("kept as it is", trap)));
    let departures = protocol.departures.iter();
    facts.extend(departures.map(|departure| fact("differs here", departure)));
    facts
}

fn choice_facts(choices: &PairProvenance) -> Vec<Fact> {
    let proxies = choices.options.proxies();
    let mut facts = vec![fact("overlap depth", &choices.overlap_depth)];
    if let Some(maps) = &choices.overlap_depth_maps {
        let value = format!("{} maps, sha256 {}", maps.count, maps.sha256);
        facts.push(fact("overlap depth maps", value));
    }
    facts.extend(choices.options.entries().into_iter().map(|(key, value)| {
        let mark = mark(proxies.contains(&format!("{key}={value}")));
        fact(key, format!("{value}{mark}"))
    }));
    facts
}

fn list_facts(list: &ListRecord) -> Vec<Fact> {
    let mut facts = vec![
        fact("sha256", &list.sha256),
        fact("listed", list.listed),
        fact("evaluated", list.evaluated),
    ];
    if let Some(limit) = list.limit {
        let text = format!("{limit} (not all selected pairs)");
        facts.push(fact("limit", text));
    }
    // Merge facts that several datasets have in common.
    let mut rows: BTreeMap<Fact, Vec<&str>> = BTreeMap::new();
    for (dataset, choices) in &list.choices {
        for row in choice_facts(choices) {
            rows.entry(row).or_default().push(dataset);
        }
    }
    facts.extend(rows.into_iter().map(|((key, value), datasets)| {
        if datasets.len() == list.choices.len() {
            (key, value)
        } else {
            (format!("{}: {key}", datasets.join(", ")), value)
        }
    }));
    facts
}

fn fact(name: &str, value: impl ToString) -> Fact {
    (name.to_owned(), value.to_string())
}

fn mark(is_proxy: bool) -> String {
    if is_proxy {
        format!(" ({PROXY})")
    } else {
        String::new()
    }
}
