//! `weights fetch`: downloads published weights into the cache.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, anyhow, bail};
use clap::Args;
use serde_json::{Value, json};
use sharp_metrics::weights::{Published, cache_folder};
use sharp_metrics::{Backbone, Weights};

use crate::cli::output::Terminal;
use crate::cli::{Outcome, output};
use crate::io::checkpoint::fetch::fetch;
use crate::io::checkpoint::record::{Standing, compare_or_record, record_file};
use crate::io::checkpoint::release::{Release, ReleasedNetwork, licence_text};
use crate::io::checkpoint::{find_checkpoint, find_resnet};
use crate::io::hash::file_sha256;
use crate::io::observer::Observer;

/// Names of the weights to fetch, and whether the licence is accepted.
#[derive(Debug, Args)]
pub(super) struct FetchArgs {
    /// `metrics` for all missing networks of LPIPS and DISTS, alexnet, vgg16 or squeezenet1_1 for one of them, `sharp`
    /// for the official checkpoint, or `resnet50dilated` for the network of the perceptual loss, used in training
    #[arg(required = true, value_name = "NAME")]
    names: Vec<String>,
    /// Only report whether the named weights are present
    #[arg(long)]
    offline: bool,
    /// Accept the licence of SHARP's checkpoint; without this option, the licence is shown and the checkpoint is not
    /// downloaded
    #[arg(long)]
    accept_licence: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &FetchArgs) -> anyhow::Result<Outcome> {
    let (backbones, releases) = wanted(&args.names)?;
    let Some(cache) = cache_folder() else {
        bail!("no cache folder; set HOME or SHARP_BENCH_WEIGHTS");
    };
    let mut results = Vec::new();
    for backbone in backbones {
        results.push(backbone_features(args, backbone, &cache)?);
    }
    for release in releases {
        results.push(published(args, &release, &cache)?);
    }
    if args.json {
        output::json(&results)?;
    }
    Ok(Outcome::Done)
}

/// The backbones and other releases that the names stand for, each once.
fn wanted(names: &[String]) -> anyhow::Result<(BTreeSet<Backbone>, Vec<Release>)> {
    let mut backbones = BTreeSet::new();
    let mut releases = vec![Release::official(), Release::resnet50dilated()];
    releases.retain(|release| names.iter().any(|name| name == release.name));
    for name in names {
        match name.as_str() {
            "metrics" => backbones.extend(Backbone::ALL),
            name if releases.iter().any(|release| release.name == name) => {}
            name => {
                let hint = "`metrics` means all missing networks of LPIPS and DISTS, `sharp` the official checkpoint, \
                            `resnet50dilated` the network of the perceptual loss";
                let known = name.parse().map_err(|error| anyhow!("{error}; {hint}"));
                backbones.insert(known?);
            }
        }
    }
    Ok((backbones, releases))
}

/// Downloads a backbone's features into the cache and describes them. If they are already on this machine, downloads
/// them only if the backbone was named explicitly.
fn backbone_features(args: &FetchArgs, backbone: Backbone, cache: &Path) -> anyhow::Result<Value> {
    let by_name = args.names.iter().any(|name| name == backbone.name());
    let at_hand = Weights::at_hand();
    let file = match at_hand.source(backbone) {
        Some(source) if !by_name => source.to_string(),
        _ => {
            let terminal = Terminal::default();
            let published = Published::of(backbone);
            let fetched = sharp_metrics::weights::fetch(&published, cache, args.offline, |at| {
                terminal.advance(backbone.name(), "bytes", at.done, at.total);
            });
            let file = fetched.with_context(|| {
                format!(
                    "{backbone} was not fetched; download the file yourself and pass --weights \
                         {backbone}=FILE"
                )
            })?;
            terminal.end();
            file.display().to_string()
        }
    };
    if !args.json {
        output::line(format!("{:<15} {file}", backbone.name()))?;
    }
    Ok(json!({ "name": backbone.name(), "file": file }))
}

/// Finds or downloads a release and compares it with the record of its first use.
fn published(args: &FetchArgs, release: &Release, cache: &Path) -> anyhow::Result<Value> {
    let is_sharp = matches!(release.network, ReleasedNetwork::Sharp(_));
    let found = if is_sharp {
        find_checkpoint().ok()
    } else {
        find_resnet()
    };
    let (file, standing) = match found {
        Some(file) => {
            let sha256 = file_sha256(&file)?;
            let own = || cache.join(format!("{}.json", release.file));
            let record = record_file(release.file).unwrap_or_else(own);
            let standing = compare_or_record(&file, release.published, &sha256, &record)?;
            (file, standing)
        }
        None => transfer(args, release, cache)?,
    };
    if !args.json {
        output::line(format!(
            "{:<15} {}\n{:<15} {standing}",
            release.name,
            file.display(),
            ""
        ))?;
    }
    let (licence, address) = release.licence;
    Ok(json!({
        "name": release.name,
        "file": file.display().to_string(),
        "verified": matches!(standing, Standing::Matches(_)),
        "record": standing.to_string(),
        "licence": licence,
        "licence_address": address,
    }))
}

/// Downloads a release; SHARP's checkpoint is downloaded only if the user has accepted its licence.
fn transfer(
    args: &FetchArgs,
    release: &Release,
    cache: &Path,
) -> anyhow::Result<(std::path::PathBuf, Standing)> {
    let is_sharp = matches!(release.network, ReleasedNetwork::Sharp(_));
    let option = if is_sharp {
        "--checkpoint FILE"
    } else {
        "`loss_options.percep.resnet50dilated` of the training's configuration"
    };
    let by_hand = format!(
        "download {} yourself and save it as {}, or give it with {option}",
        release.published,
        cache.join(release.file).display()
    );
    if args.offline {
        bail!(
            "{} is missing, and --offline forbids fetching it; {by_hand}",
            release.name
        );
    }
    if is_sharp {
        output::remark(licence_text());
    }
    if is_sharp && !args.accept_licence {
        bail!(
            "nothing was fetched; read the licence above and accept it with --accept-licence, or {by_hand}"
        );
    }
    let terminal = Terminal::default();
    let found = fetch(release, cache, |at| {
        terminal.advance(release.name, "bytes", at.done, at.total);
    })
    .with_context(|| format!("{} was not fetched; {by_hand}", release.name))?;
    terminal.end();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stand_for_files_and_each_is_fetched_once() {
        let of = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(ToString::to_string).collect();
            wanted(&names)
        };
        let named = |names: &[&str]| {
            let (backbones, releases) = of(names).unwrap();
            (
                backbones,
                releases
                    .iter()
                    .map(|release| release.name)
                    .collect::<Vec<_>>(),
            )
        };
        let (backbones, releases) = named(&["vgg16", "metrics", "sharp", "sharp"]);
        assert!(backbones.into_iter().eq(Backbone::ALL));
        assert_eq!(releases, ["sharp"]);
        assert_eq!(
            named(&["resnet50dilated", "alexnet"]).1,
            ["resnet50dilated"]
        );
        let error = of(&["vgg19"]).unwrap_err().to_string();
        assert!(
            error.contains("vgg19") && error.contains("`sharp`"),
            "{error}"
        );
    }
}
