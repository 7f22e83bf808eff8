//! Options shared by several commands: datasets, pairs, metrics, the backend.

use clap::Args;
use sharp_datasets::registry::ENTRIES;
use sharp_datasets::setting::PICTURES;

use super::output;
use crate::io::counts::counted;
use crate::pairs::frame::Frame;
use crate::pairs::{DatasetConfig, OpenDataset, PairError, clap_dataset};

/// Datasets, and a selection of their scenes.
#[derive(Debug, Args)]
pub(super) struct DatasetArgs {
    /// A dataset, [NAME:]FORMAT=PATH[,key=value…]; repeatable
    #[arg(long = "dataset", value_name = "SPEC", required = true, value_parser = clap_dataset)]
    pub(super) datasets: Vec<DatasetConfig>,
    /// Use only scenes whose id matches this pattern; `*` and `?` are wildcards
    #[arg(long, value_name = "GLOB")]
    pub(super) scenes: Option<String>,
}

impl DatasetArgs {
    /// Opens the datasets and prints notes on scenes left out.
    pub(super) fn open(&self) -> Result<Vec<OpenDataset>, PairError> {
        let datasets = OpenDataset::open_all(&self.datasets, self.scenes.as_deref())?;
        say_what_was_opened(&datasets);
        Ok(datasets)
    }
}

/// Prints which scenes were left out, and the assumptions that the dataset readers noted.
pub(super) fn say_what_was_opened(datasets: &[OpenDataset]) {
    for dataset in datasets {
        for group in &dataset.left_out {
            let kind = if group.by_choice { "note" } else { "warning" };
            output::remark(format!("{kind}: {}: {group}", dataset.name));
        }
        say_notes(dataset);
        for warning in dataset.warnings() {
            output::remark(format!("warning: {warning}"));
        }
    }
}

/// Maximum number of notes printed per dataset.
const NOTES: usize = 6;

/// Prints the notes of the dataset readers, each with the first scene that it applies to.
fn say_notes(dataset: &OpenDataset) {
    let mut notes: Vec<(&str, &str, usize)> = Vec::new();
    for scene in &dataset.scenes {
        for note in &scene.notes {
            match notes.iter_mut().find(|(known, ..)| known == note) {
                Some((_, _, count)) => *count += 1,
                None => notes.push((note, &scene.id, 1)),
            }
        }
    }
    for (note, scene, count) in notes.iter().take(NOTES) {
        let others = match count {
            1 => String::new(),
            _ => format!(" and {} more", count - 1),
        };
        output::remark(format!("note: {}/{scene}{others}: {note}", dataset.name));
    }
    if notes.len() > NOTES {
        let more = counted(notes.len() - NOTES, "note");
        let name = &dataset.name;
        output::remark(format!(
            "note: {name}: {more} not shown (`datasets check` prints them)"
        ));
    }
}

/// The formats of `--dataset` and their settings, for `--help`.
pub(super) fn formats_help() -> String {
    let mut text =
        "Datasets, [NAME:]FORMAT=PATH[,key=value…], with their settings and the defaults:\n"
            .to_owned();
    for entry in ENTRIES {
        text += &format!("  {:<18} {}: {}\n", entry.format, entry.title, entry.layout);
        for setting in entry.settings {
            text += &format!(
                "    {}={}  {}\n",
                setting.key, setting.default, setting.meaning
            );
        }
    }
    let pictures = PICTURES
        .iter()
        .map(|s| format!("    {}={}  {}\n", s.key, s.default, s.meaning));
    let pictures: String = pictures.collect();
    text += &format!(
        "  settings of every format\n    frame=RULE  resize the dataset's views and adjust their cameras: \
         {}\n{pictures}    pairs.KEY=VALUE  a pair option for this dataset only (keys: `pairs \
         --help-all`)\n  `datasets list` shows the values of each setting\n",
        Frame::forms()
    );
    text
}
