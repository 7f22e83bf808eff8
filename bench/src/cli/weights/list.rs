//! `weights list`: lists published weights and whether they are on this machine.

use std::path::PathBuf;

use serde_json::json;
use sharp::model::bundled;
use sharp_metrics::weights::Published;
use sharp_metrics::{Backbone, Weights};

use crate::cli::{Outcome, output};
use crate::io::checkpoint::record::{self, record_file};
use crate::io::checkpoint::release::{LICENCE_ADDRESS, LICENCE_NAME, RELEASE_ADDRESS};
use crate::io::checkpoint::{bundled_weights, find_checkpoint};

pub(super) fn execute(json: bool) -> anyhow::Result<Outcome> {
    let weights = Weights::at_hand();
    let shown = |file: Option<PathBuf>| file.map(|path| path.display().to_string());
    let mut entries = Vec::new();
    for backbone in Backbone::ALL {
        let published = Published::of(backbone);
        let kept = weights.source(backbone).map(ToString::to_string);
        let mib = published.size_milli_mib as f64 / 1000.0;
        if !json {
            output::line(format!(
                "{:<14} {mib:>9.3} MiB  {}  {}\n{:<14} sha256 {}…, licence {}",
                backbone.name(),
                published.address,
                kept.as_deref().unwrap_or("missing"),
                "",
                published.sha256_prefix,
                published.licence
            ))?;
        }
        entries.push(json!({
            "name": backbone.name(),
            "address": published.address,
            "size_mib": mib,
            "sha256_prefix": published.sha256_prefix,
            "features_sha256": backbone.published_features(),
            "licence": published.licence,
            "file": kept,
        }));
    }
    let sharp = shown(find_checkpoint().ok());
    let recorded = record_file().map(|file| record::read(&file)).transpose()?;
    let recorded = recorded.flatten();
    let mini = shown(bundled_weights().ok());
    let description = bundled::description()?;
    if json {
        entries.push(json!({
            "name": bundled::NAME,
            "description": description,
            "sha256": bundled::weights_sha256(),
            "licence": "MIT or Apache-2.0",
            "file": mini,
        }));
        entries.push(json!({
            "name": "sharp",
            "address": RELEASE_ADDRESS,
            "licence": LICENCE_NAME,
            "licence_address": LICENCE_ADDRESS,
            "recorded": recorded,
            "file": sharp,
        }));
        output::json(&entries)?;
    } else {
        let known = recorded.map_or_else(
            || "no hash is published: unverified until its first use".to_owned(),
            |record| format!("sha256 {} recorded on {}", record.sha256, record.recorded),
        );
        output::line(format!(
            "{:<14} {:>13}  {description}  {}\n{:<14} sha256 {:.8}…, licence MIT or Apache-2.0",
            bundled::NAME,
            "bundled",
            mini.as_deref().unwrap_or("missing"),
            "",
            bundled::weights_sha256(),
        ))?;
        output::line(format!(
            "{:<14} {:>13}  {RELEASE_ADDRESS}  {}\n{:<14} {known}, licence {LICENCE_NAME} (research only)",
            "sharp",
            "2.8 GB",
            sharp.as_deref().unwrap_or("missing"),
            "",
        ))?;
    }
    Ok(Outcome::Done)
}
