//! Writes a report from records of another program: tables, plots and a page that opens from disk.
//!
//! ```console
//! $ cargo run --release -p sharp-bench --example report_from_records -- [FOLDER]
//! ```
//! `sharp-bench schema record` prints what a record may hold. The report lies in FOLDER, or in a temporary folder.

#![allow(clippy::print_stdout, reason = "an example that prints its result")]

use std::error::Error;
use std::path::PathBuf;

use serde_json::json;
use sharp_bench::evaluate::record::Record;
use sharp_bench::report::{
    NoPictures, PublishedNumbers, ReportInput, ReportOptions, text_tables, write_report,
};
use sharp_metrics::MetricKey;

fn record(method: &str, centimetres: u32, psnr: f64) -> serde_json::Result<Record> {
    serde_json::from_value(json!({
        "pair_id": format!("Lab/desk/0__{centimetres}"),
        "dataset": "Lab", "scene": "desk", "cluster": "desk",
        "source": "0", "target": centimetres.to_string(), "method": method,
        "baseline_m": f64::from(centimetres) / 100.0, "rotation_deg": 0.0,
        "status": "ok", "scores": { "psnr": psnr }, "extras": {},
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
    let input = ReportInput {
        title: "Two methods before a desk".into(),
        summary: "Eight records made by hand.".into(),
        records: &records,
        metrics: vec![MetricKey::PSNR.into()],
        extras: Vec::new(),
        datasets: Vec::new(),
        methods: Vec::new(),
        facts: Vec::new(),
        published: PublishedNumbers::Never,
        comparison: None,
        pictures: &NoPictures,
        options: ReportOptions::default(),
    };
    println!("{}", text_tables(&input)?);
    println!("{}", write_report(&input, &folder)?.html.display());
    Ok(())
}
