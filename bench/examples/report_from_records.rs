//! Writes a report from another program's records: tables, plots and a page that opens from disk.
//!
//! ```console
//! $ cargo run --release -p sharp-bench --example report_from_records -- [FOLDER]
//! ```
//! `sharp-bench schema record` and `schema manifest` print what a record and a manifest may contain. The report is written
//! to FOLDER, or to a temporary folder.

#![allow(clippy::print_stdout, reason = "an example that prints its result")]

use std::error::Error;
use std::path::PathBuf;

use serde_json::{Value, json};
use sharp_bench::evaluate::Results;
use sharp_bench::evaluate::record::Record;
use sharp_bench::report::{PublishedNumbers, ReportOptions, mean_tables, report};
use sharp_metrics::{MetricInfo, MetricKey};

fn record(method: &str, centimetres: u32, psnr: f64) -> serde_json::Result<Record> {
    serde_json::from_value(json!({
        "pair_id": format!("Lab/desk/0__{centimetres}"),
        "dataset": "Lab", "scene": "desk", "cluster": "desk",
        "source": "0", "target": centimetres.to_string(), "method": method,
        "baseline_m": f64::from(centimetres) / 100.0, "rotation_deg": 0.0,
        "status": "ok", "scores": { "psnr": psnr }, "extras": {},
    }))
}

/// Contents of `manifest.json`: the run's dataset, methods and metrics, and how they were made.
fn manifest(methods: [&str; 2]) -> serde_json::Result<Value> {
    let mut psnr = serde_json::to_value(MetricInfo::new(MetricKey::PSNR, &[]))?;
    psnr["identity"] = "by hand".into();
    let methods = methods.map(|label| {
        json!({
            "label": label, "spec": "", "identity": { "kind": "by hand", "settings": {} }, "privilege": "none", "sources": "",
        })
    });
    Ok(json!({
        "format": 2, "version": "0", "sources": {}, "kernels": "portable", "scoring": {},
        "renderer": { "backend": "none", "near": 0.0, "far": 0.0, "eps2d": 0.0, "background": "black" },
        "metric_networks": { "device": "cpu", "instruction_set": "portable", "algorithm": "winograd" },
        "datasets": [{
            "name": "Lab", "spec": "", "format": "Lab", "identity": "", "scenes": 1, "views": 5, "readings": [], "notes": [],
        }],
        "pairs": { "sha256": "", "listed": 4, "evaluated": 4, "lists": [] },
        "methods": methods, "metrics": [psnr],
    }))
}

fn main() -> Result<(), Box<dyn Error>> {
    let temporary = tempfile::tempdir()?;
    let folder = std::env::args_os().nth(1);
    let folder = folder.map_or(temporary.path().to_owned(), PathBuf::from);

    let mut records = Vec::new();
    for centimetres in [2, 5, 10, 20] {
        let motion = f64::from(centimetres).ln();
        records.push(record("steady", centimetres, 30.0 - 2.0 * motion)?);
        records.push(record("bold", centimetres, 33.0 - 4.0 * motion)?);
    }
    let results = Results {
        manifest: serde_json::from_value(manifest(["steady", "bold"])?)?,
        records,
        missing: Default::default(),
        pictures: Vec::new(),
        damaged: Vec::new(),
        methods_listed: false,
    };
    for table in mean_tables(&results, None)? {
        println!("{}", table.text());
    }
    let options = ReportOptions {
        published: PublishedNumbers::Never,
        ..ReportOptions::default()
    };
    let written = report(&results, &[], &folder, &options)?;
    println!("{}", written.html.display());
    Ok(())
}
