//! `weights list`: lists published weights and whether they are on this machine.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use serde::Serialize;
use sharp::model::bundled;
use sharp_metrics::weights::Published;
use sharp_metrics::{Backbone, Weights};

use crate::cli::{Outcome, output};
use crate::io::checkpoint::record::{self, CheckpointRecord, record_file};
use crate::io::checkpoint::release::Release;
use crate::io::checkpoint::{bundled_weights, find_checkpoint, find_resnet};

/// Published weights and where they are on this machine.
#[derive(Serialize)]
#[serde(untagged)]
enum ListedWeights {
    Backbone {
        name: &'static str,
        address: String,
        size_mib: f64,
        sha256_prefix: String,
        features_sha256: &'static str,
        licence: &'static str,
        file: Option<String>,
    },
    Bundled {
        name: &'static str,
        description: String,
        sha256: &'static str,
        licence: &'static str,
        file: Option<String>,
    },
    Release {
        name: &'static str,
        address: &'static str,
        licence: &'static str,
        licence_address: &'static str,
        recorded: Option<CheckpointRecord>,
        file: Option<String>,
        #[serde(skip)]
        size: &'static str,
        #[serde(skip)]
        note: &'static str,
    },
}

#[derive(Serialize)]
struct KnownWeights(Vec<ListedWeights>);

impl Display for KnownWeights {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let place = |file: &Option<String>| file.clone().unwrap_or_else(|| "missing".to_owned());
        self.0.iter().try_for_each(|listed| match listed {
            ListedWeights::Backbone {
                name,
                address,
                size_mib,
                sha256_prefix,
                licence,
                file,
                ..
            } => writeln!(
                f,
                "{name:<15} {size_mib:>9.3} MiB  {address}  {}\n{:<15} sha256 {sha256_prefix}…, licence {licence}",
                place(file),
                ""
            ),
            ListedWeights::Bundled {
                name,
                description,
                sha256,
                licence,
                file,
            } => writeln!(
                f,
                "{name:<15} {:>13}  {description}  {}\n{:<15} sha256 {sha256:.8}…, licence {licence}",
                "bundled",
                place(file),
                ""
            ),
            ListedWeights::Release {
                name,
                address,
                licence,
                recorded,
                file,
                size,
                note,
                ..
            } => {
                let known = recorded.as_ref().map_or_else(
                    || "no hash is published, so it is unverified until its first use".to_owned(),
                    |record| format!("sha256 {} recorded on {}", record.sha256, record.recorded),
                );
                writeln!(
                    f,
                    "{name:<15} {size:>13}  {address}  {}\n{:<15} {known}, licence {licence}{note}",
                    place(file),
                    ""
                )
            }
        })
    }
}
pub(super) fn execute(json: bool) -> anyhow::Result<Outcome> {
    let weights = Weights::at_hand();
    let shown = |file: Option<PathBuf>| file.map(|path| path.display().to_string());
    let mut entries = Vec::new();
    for backbone in Backbone::ALL {
        let published = Published::of(backbone);
        let kept = weights.source(backbone).map(ToString::to_string);
        let mib = published.size_milli_mib as f64 / 1000.0;
        entries.push(ListedWeights::Backbone {
            name: backbone.name(),
            address: published.address.into_owned(),
            size_mib: mib,
            sha256_prefix: published.sha256_prefix.into_owned(),
            features_sha256: backbone.published_features(),
            licence: published.licence,
            file: kept,
        });
    }
    let mini = shown(bundled_weights().ok());
    entries.push(ListedWeights::Bundled {
        name: bundled::NAME,
        description: bundled::description()?,
        sha256: bundled::weights_sha256(),
        licence: "MIT or Apache-2.0",
        file: mini,
    });
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
        entries.push(ListedWeights::Release {
            name: release.name,
            address: release.published,
            licence,
            licence_address,
            recorded,
            file,
            size,
            note,
        });
    }
    output::print(&KnownWeights(entries), json)?;
    Ok(Outcome::Done)
}
