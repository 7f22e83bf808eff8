//! `weights list`: lists published weights and whether they are on this machine.

use std::path::PathBuf;

use serde_json::json;
use sharp::model::bundled;
use sharp_metrics::weights::Published;
use sharp_metrics::{Backbone, Weights};

use crate::cli::{Outcome, output};
use crate::io::checkpoint::record::{self, record_file};
use crate::io::checkpoint::release::Release;
use crate::io::checkpoint::{bundled_weights, find_checkpoint, find_resnet};

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
                "{:<15} {mib:>9.3} MiB  {}  {}\n{:<15} sha256 {}…, licence {}",
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
    } else {
        output::line(format!(
            "{:<15} {:>13}  {description}  {}\n{:<15} sha256 {:.8}…, licence MIT or Apache-2.0",
            bundled::NAME,
            "bundled",
            mini.as_deref().unwrap_or("missing"),
            "",
            bundled::weights_sha256(),
        ))?;
    }
    for (release, size, note, file) in [
        (
            Release::official(),
            "2.8 GB",
            " (research only)",
            find_checkpoint().ok(),
        ),
        (Release::resnet50dilated(), "95 MB", "", find_resnet()),
    ] {
        let file = shown(file);
        let recorded = record_file(release.file).map(|file| record::read(&file));
        let recorded = recorded.transpose()?.flatten();
        let (licence, address) = release.licence;
        if !json {
            let known = recorded.as_ref().map_or_else(
                || "no hash is published: unverified until its first use".to_owned(),
                |record| format!("sha256 {} recorded on {}", record.sha256, record.recorded),
            );
            output::line(format!(
                "{:<15} {size:>13}  {}  {}\n{:<15} {known}, licence {licence}{note}",
                release.name,
                release.published,
                file.as_deref().unwrap_or("missing"),
                "",
            ))?;
        }
        entries.push(json!({
            "name": release.name,
            "address": release.published,
            "licence": licence,
            "licence_address": address,
            "recorded": recorded,
            "file": file,
        }));
    }
    if json {
        output::json(&entries)?;
    }
    Ok(Outcome::Done)
}
