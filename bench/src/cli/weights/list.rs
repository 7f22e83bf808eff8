//! `weights list`: what is published, and what is at hand.

use serde_json::json;
use sharp_metrics::Backbone;
use sharp_metrics::weights::{Published, cache_folder};

use super::super::{Outcome, output};
use crate::io::checkpoint::find_checkpoint;
use crate::io::checkpoint::record::{self, record_file};
use crate::io::checkpoint::release::{LICENCE_ADDRESS, LICENCE_NAME, RELEASE_ADDRESS};

/// Prints one entry a file.
pub(super) fn execute(json: bool) -> anyhow::Result<Outcome> {
    let cache = cache_folder();
    let mut entries = Vec::new();
    for backbone in Backbone::ALL {
        let published = Published::of(backbone);
        let kept = cache.as_deref().map(|cache| published.cached(cache));
        let kept = kept.filter(|path| path.is_file());
        if !json {
            output::line(format!(
                "{:<14} {:>9.3} MiB  {}  {}\n{:<14} sha256 {}…, licence {}",
                backbone.name(),
                published.size_milli_mib as f64 / 1000.0,
                published.address,
                kept.as_ref()
                    .map_or_else(|| "not fetched".to_owned(), |p| p.display().to_string()),
                "",
                published.sha256_prefix,
                published.licence
            ))?;
        }
        entries.push(json!({
            "name": backbone.name(),
            "address": published.address,
            "size_mib": published.size_milli_mib as f64 / 1000.0,
            "sha256_prefix": published.sha256_prefix,
            "licence": published.licence,
            "file": kept.map(|p| p.display().to_string()),
        }));
    }
    let sharp = find_checkpoint().ok();
    let recorded = match record_file() {
        Some(file) => record::read(&file)?,
        None => None,
    };
    if json {
        entries.push(json!({
            "name": "sharp",
            "address": RELEASE_ADDRESS,
            "licence": LICENCE_NAME,
            "licence_address": LICENCE_ADDRESS,
            "recorded": recorded,
            "file": sharp.map(|p| p.display().to_string()),
        }));
        output::json(&entries)?;
    } else {
        let known = recorded.map_or_else(
            || "no hash is published: unverified until its first use".to_owned(),
            |record| format!("sha256 {} recorded on {}", record.sha256, record.recorded),
        );
        output::line(format!(
            "{:<14} {:>13}  {RELEASE_ADDRESS}  {}\n{:<14} {known}, licence {LICENCE_NAME} (research only)",
            "sharp",
            "2.8 GB",
            sharp.map_or_else(|| "not at hand".to_owned(), |p| p.display().to_string()),
            "",
        ))?;
    }
    Ok(Outcome::Done)
}
