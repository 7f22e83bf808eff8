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
use crate::io::checkpoint::find_checkpoint;
use crate::io::checkpoint::record::{Standing, compare_or_record, record_file};
use crate::io::checkpoint::release::{
    LICENCE_ADDRESS, LICENCE_NAME, RELEASE_ADDRESS, RELEASE_FILE, Release, licence_text,
};
use crate::io::hash::file_sha256;
use crate::io::observer::Observer;

/// Names to fetch, and accepted terms.
#[derive(Debug, Args)]
pub(super) struct FetchArgs {
    /// `metrics` for all missing backbones; alexnet, vgg16, squeezenet1_1; `sharp` for the official checkpoint
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
    let (backbones, sharp) = wanted(&args.names)?;
    let Some(cache) = cache_folder() else {
        bail!("no cache folder: set HOME or SHARP_BENCH_WEIGHTS");
    };
    let mut results = Vec::new();
    for backbone in backbones {
        results.push(backbone_features(args, backbone, &cache)?);
    }
    if sharp {
        results.push(checkpoint(args, &cache)?);
    }
    if args.json {
        output::json(&results)?;
    }
    Ok(Outcome::Done)
}

/// The backbones in a list of names, each once, and whether it includes SHARP's checkpoint.
fn wanted(names: &[String]) -> anyhow::Result<(BTreeSet<Backbone>, bool)> {
    let (mut backbones, mut sharp) = (BTreeSet::new(), false);
    for name in names {
        match name.as_str() {
            "metrics" => backbones.extend(Backbone::ALL),
            "sharp" => sharp = true,
            name => {
                let hint = "`metrics` means all missing backbones, `sharp` the official checkpoint";
                let known = name.parse().map_err(|error| anyhow!("{error}; {hint}"));
                backbones.insert(known?);
            }
        }
    }
    Ok((backbones, sharp))
}

/// Downloads a backbone's features into the cache; if they are already present, only if the
/// backbone was named explicitly. Returns their location.
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
        output::line(format!("{:<14} {file}", backbone.name()))?;
    }
    Ok(json!({ "name": backbone.name(), "file": file }))
}

/// Finds or fetches the official checkpoint and compares it with its record.
fn checkpoint(args: &FetchArgs, cache: &Path) -> anyhow::Result<Value> {
    let (file, standing) = match find_checkpoint() {
        Ok(file) => {
            let sha256 = file_sha256(&file)?;
            let record =
                record_file().unwrap_or_else(|| cache.join(format!("{RELEASE_FILE}.json")));
            let standing = compare_or_record(&file, &sha256, &record)?;
            (file, standing)
        }
        Err(_) => transfer(args, cache)?,
    };
    if !args.json {
        output::line(format!(
            "{:<14} {}\n{:<14} {standing}",
            "sharp",
            file.display(),
            ""
        ))?;
    }
    Ok(json!({
        "name": "sharp",
        "file": file.display().to_string(),
        "verified": matches!(standing, Standing::Matches(_)),
        "record": standing.to_string(),
        "licence": LICENCE_NAME,
        "licence_address": LICENCE_ADDRESS,
    }))
}

/// Shows the licence and, if accepted, downloads the checkpoint.
fn transfer(args: &FetchArgs, cache: &Path) -> anyhow::Result<(std::path::PathBuf, Standing)> {
    output::remark(licence_text());
    let by_hand = format!(
        "download {RELEASE_ADDRESS} yourself and save it as {}, or give it with --checkpoint FILE",
        cache.join(RELEASE_FILE).display()
    );
    if args.offline {
        bail!("the checkpoint is missing, and --offline forbids fetching it; {by_hand}");
    }
    if !args.accept_licence {
        bail!(
            "nothing was fetched: read the licence above and accept it with --accept-licence; or \
             {by_hand}"
        );
    }
    let terminal = Terminal::default();
    let found = fetch(&Release::official(), cache, |at| {
        terminal.advance("sharp", "bytes", at.done, at.total);
    })
    .with_context(|| format!("the checkpoint was not fetched; {by_hand}"))?;
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
        let (backbones, sharp) = of(&["vgg16", "metrics", "sharp", "sharp"]).unwrap();
        assert!(backbones.into_iter().eq(Backbone::ALL));
        assert!(sharp);
        assert!(!of(&["alexnet"]).unwrap().1);
        let error = of(&["vgg19"]).unwrap_err().to_string();
        assert!(
            error.contains("vgg19") && error.contains("`sharp`"),
            "{error}"
        );
    }
}
