//! `weights check`: lists the contents of a file and checks that they fit a network.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use serde_json::json;
use sharp::model::inventory::CheckpointSource;
use sharp_checkpoint::Checkpoint;

use super::load_config;
use crate::cli::{Outcome, output};
use crate::io::checkpoint::record::{compare_or_record, record_file};
use crate::io::checkpoint::{RELEASE_ADDRESS, RELEASE_FILE, named_network};

#[derive(Debug, Default, Serialize)]
struct Module {
    tensors: usize,
    parameters: usize,
    not_finite: usize,
}

pub(super) fn execute(
    file: &Path,
    config: Option<&str>,
    allow_unused: &[String],
    as_json: bool,
) -> anyhow::Result<Outcome> {
    let checkpoint = Checkpoint::open(file)?;
    // By default, only files with SHARP's modules are compared with a network.
    const SHARP: &str = "monodepth_model";
    let source = if config.is_some() || checkpoint.names().any(|name| name.contains(SHARP)) {
        Some(CheckpointSource::open(file)?)
    } else {
        None
    };
    let source = source.filter(|source| config.is_some() || source.has(SHARP));
    let prefix = source.as_ref().and_then(CheckpointSource::left_out);
    let prefix = prefix.unwrap_or_default();
    let mut modules: BTreeMap<String, Module> = BTreeMap::new();
    for name in checkpoint.names() {
        let module = module_of(name.strip_prefix(prefix).unwrap_or(name));
        let module = modules.entry(module).or_default();
        let values = checkpoint.tensor_f32(name)?;
        module.tensors += 1;
        module.parameters += values.len();
        module.not_finite += values.iter().filter(|v| !v.is_finite()).count();
    }
    let not_finite: usize = modules.values().map(|m| m.not_finite).sum();
    let sha256 = checkpoint.sha256()?;
    let record = standing(file, &sha256)?;
    let tensors = checkpoint.names().len();
    let parameters = modules.values().map(|m| m.parameters).sum();
    let value = || {
        json!({
            "file": file.display().to_string(),
            "sha256": sha256,
            "record": record,
            "tensors": tensors,
            "parameters": parameters,
            "not_finite": not_finite,
            "modules": modules,
        })
    };
    output::print(as_json, value, || {
        let line = |name: &str, parameters, tensors| {
            let parameters = grouped(parameters);
            format!("{parameters:>13} in {tensors:>4} tensors  {name}\n")
        };
        let mut text = String::new();
        for (name, module) in &modules {
            text += &line(name, module.parameters, module.tensors);
        }
        text += &line("in all", parameters, tensors);
        text += &format!("not finite    {not_finite}\nsha256        {sha256}\n");
        if let Some(record) = &record {
            text += &format!("record        {record}");
        }
        text
    })?;
    if let Some(source) = source {
        let implausible = source.implausible_weights()?.filter(|_| source.has(SHARP));
        if let Some(implausible) = &implausible {
            output::remark(format!("warning: {}: {implausible}", file.display()));
        }
        let (name, network) = match config {
            Some(name) => (name.to_owned(), load_config(name)?),
            // Choose the network as `predict` does without a configuration.
            None => {
                let found = named_network(Some(file), None)?;
                let notes = found.notes.iter();
                for note in notes.filter(|note| Some(*note) != implausible.as_ref()) {
                    output::remark(format!("note: {note}"));
                }
                (found.config.preset.clone(), found.config)
            }
        };
        source.check(&network, allow_unused)?;
        if !as_json {
            output::line(format!("has all tensors of the network '{name}'"))?;
        }
    }
    anyhow::ensure!(
        not_finite == 0,
        "{}: {not_finite} values are not finite",
        file.display()
    );
    Ok(Outcome::Done)
}

/// Compares a file named like the official checkpoint with the record of its first use; `None` for
/// other files.
fn standing(file: &Path, sha256: &str) -> anyhow::Result<Option<String>> {
    let official = file.file_name().is_some_and(|name| name == RELEASE_FILE);
    match record_file(RELEASE_FILE).filter(|_| official) {
        Some(record) => Ok(Some(
            compare_or_record(file, RELEASE_ADDRESS, sha256, &record)?.to_string(),
        )),
        None => Ok(None),
    }
}

/// The part of the network that a tensor belongs to: the first four levels of its name in SHARP's
/// encoder, three in the rest of SHARP's depth network, and one elsewhere.
fn module_of(name: &str) -> String {
    let levels = if name.starts_with("monodepth_model.monodepth_predictor.encoder.") {
        4
    } else if name.starts_with("monodepth_model.") {
        3
    } else {
        1
    };
    name.split('.').take(levels).collect::<Vec<_>>().join(".")
}

/// Groups thousands: 702 305 169.
fn grouped(n: usize) -> String {
    match n / 1000 {
        0 => n.to_string(),
        thousands => format!("{} {:03}", grouped(thousands), n % 1000),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_and_thousands() {
        let encoder =
            "monodepth_model.monodepth_predictor.encoder.patch_encoder.blocks.0.ls1.gamma";
        assert_eq!(
            module_of(encoder),
            "monodepth_model.monodepth_predictor.encoder.patch_encoder"
        );
        assert_eq!(module_of("features.0.weight"), "features");
        assert_eq!(grouped(702_305_169), "702 305 169");
        assert_eq!(grouped(12), "12");
    }
}
