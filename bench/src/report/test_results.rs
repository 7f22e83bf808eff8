//! Results for tests: records with the datasets and methods that they name.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use sharp_datasets::natural_order;
use sharp_metrics::{MetricInfo, MetricKey};

use crate::evaluate::Results;
use crate::evaluate::record::Record;

/// Results scored by some metrics. Datasets and methods are those in the records, in natural order;
/// their formats and kinds equal their names.
pub(crate) fn results(keys: &[MetricKey], records: Vec<Record>) -> Results {
    let named = |name: fn(&Record) -> &str, make: &dyn Fn(&str) -> Value| -> Vec<Value> {
        let names: BTreeSet<&str> = records.iter().map(name).collect();
        let mut names = Vec::from_iter(names);
        names.sort_by(|a, b| natural_order::compare(a, b));
        names.into_iter().map(make).collect()
    };
    let datasets = named(|record| &record.dataset, &|name| {
        json!({
            "name": name, "spec": "", "format": name, "identity": name, "scenes": 1, "views": 2, "readings": [], "notes": [],
        })
    });
    let methods = named(|record| &record.method, &|label| {
        json!({
            "label": label, "spec": "", "identity": { "kind": label, "settings": {} }, "privilege": "none", "sources": "",
        })
    });
    let metrics = keys.iter().map(|key| {
        let mut metric = serde_json::to_value(MetricInfo::new(*key, &[])).unwrap();
        metric["identity"] = "i".into();
        metric
    });
    let manifest = json!({
        "format": 2, "version": "0", "sources": {}, "kernels": "portable", "scoring": {},
        "renderer": { "backend": "cpu-portable", "near": 0.01, "far": 1.0, "eps2d": 0.0, "background": "black" },
        "metric_networks": { "device": "cpu", "instruction_set": "portable", "algorithm": "winograd" },
        "pairs": { "sha256": "", "listed": 0, "evaluated": 0, "lists": [] },
        "datasets": datasets, "methods": methods, "metrics": metrics.collect::<Vec<_>>(),
    });
    Results {
        manifest: serde_json::from_value(manifest).unwrap(),
        records,
        missing: BTreeSet::new(),
        pictures: Vec::new(),
        damaged: Vec::new(),
        methods_listed: false,
    }
}
