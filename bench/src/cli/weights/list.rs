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

pub(super) fn execute(as_json: bool) -> anyhow::Result<Outcome> {
    let weights = Weights::at_hand();
    let shown = |file: Option<PathBuf>| file.map(|path| path.display().to_string());
    let place = |file: &Option<String>| file.clone().unwrap_or_else(|| "missing".to_owned());
    let (mut values, mut text) = (Vec::new(), String::new());
    for backbone in Backbone::ALL {
        let Published {
            address,
            sha256_prefix,
            licence,
            size_milli_mib,
            ..
        } = Published::of(backbone);
        let (name, size_mib) = (backbone.name(), size_milli_mib as f64 / 1000.0);
        let file = weights.source(backbone).map(ToString::to_string);
        text += &format!(
            "{name:<15} {size_mib:>9.3} MiB  {address}  {}\n{:<15} sha256 {sha256_prefix}…, licence {licence}\n",
            place(&file),
            ""
        );
        values.push(json!({
            "name": name,
            "address": address,
            "size_mib": size_mib,
            "sha256_prefix": sha256_prefix,
            "features_sha256": backbone.published_features(),
            "licence": licence,
            "file": file,
        }));
    }
    let (name, description) = (bundled::NAME, bundled::description()?);
    let (sha256, licence) = (bundled::weights_sha256(), "MIT or Apache-2.0");
    let file = shown(bundled_weights().ok());
    text += &format!(
        "{name:<15} {:>13}  {description}  {}\n{:<15} sha256 {sha256:.8}…, licence {licence}\n",
        "bundled",
        place(&file),
        ""
    );
    values.push(json!({
        "name": name,
        "description": description,
        "sha256": sha256,
        "licence": licence,
        "file": file,
    }));
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
        let (licence, licence_address) = release.licence;
        let known = recorded.as_ref().map_or_else(
            || "no hash is published, so it is unverified until its first use".to_owned(),
            |record| format!("sha256 {} recorded on {}", record.sha256, record.recorded),
        );
        text += &format!(
            "{:<15} {size:>13}  {}  {}\n{:<15} {known}, licence {licence}{note}\n",
            release.name,
            release.published,
            place(&file),
            ""
        );
        values.push(json!({
            "name": release.name,
            "address": release.published,
            "licence": licence,
            "licence_address": licence_address,
            "recorded": recorded,
            "file": file,
        }));
    }
    output::print(as_json, || values, || text)?;
    Ok(Outcome::Done)
}
