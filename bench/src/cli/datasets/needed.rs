//! `datasets list --needed-for`: lists exactly the files that a pair list needs.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::json;
use sharp_datasets::registry::ENTRIES;
use sharp_datasets::required_files::{FileRole, RequiredFile};
use sharp_datasets::{DatasetEntry, DatasetSpec, Pairing, Scene, View};

use crate::cli::{Outcome, output};
use crate::io::counts::counted;
use crate::pairs::{DatasetConfig, PairList};

#[derive(Debug, Serialize)]
struct Needed {
    /// The dataset's name in the pair list.
    dataset: String,
    /// The dataset's format; `None` if neither its name nor --dataset determines it.
    format: Option<&'static str>,
    pairs: usize,
    archives: BTreeSet<String>,
    files: Vec<Listed>,
    /// Number of missing files; `None` if the dataset's folder is unknown.
    missing: Option<usize>,
}

#[derive(Debug, Serialize)]
struct Listed {
    #[serde(flatten)]
    file: RequiredFile,
    /// Whether the file exists under one of its possible names; `None` if the dataset's folder is unknown.
    present: Option<bool>,
}

pub(super) fn execute(
    list: &Path,
    datasets: &[DatasetConfig],
    as_json: bool,
) -> anyhow::Result<Outcome> {
    let list = PairList::read(list)?;
    let mut specs: BTreeMap<&str, &DatasetSpec> = datasets
        .iter()
        .map(|dataset| (dataset.spec.name.as_str(), &dataset.spec))
        .collect();
    let names: BTreeSet<&str> = list.pairs.iter().map(|p| p.dataset.as_str()).collect();
    if let Some(unused) = specs.keys().find(|name| !names.contains(*name)) {
        anyhow::bail!(
            "--dataset {unused}: the list has no dataset with this name; its datasets are {}; give the name as \
             NAME:FORMAT=PATH",
            names.into_iter().collect::<Vec<_>>().join(", ")
        );
    }
    let found: Vec<Needed> = names
        .into_iter()
        .map(|name| needed(&list, name, specs.remove(name)))
        .collect();
    let missing: usize = found.iter().filter_map(|needed| needed.missing).sum();
    let value = || json!({"sha256": list.sha256, "datasets": found, "missing": missing});
    output::print(as_json, value, || {
        found.iter().map(ToString::to_string).collect()
    })?;
    Ok(Outcome::of_problems(missing > 0))
}

fn needed(list: &PairList, name: &str, spec: Option<&DatasetSpec>) -> Needed {
    let named = || {
        let mut entries = ENTRIES.into_iter();
        entries.find(|entry| entry.format.eq_ignore_ascii_case(name))
    };
    let entry: Option<&DatasetEntry> = spec.as_ref().map(|spec| spec.entry).or_else(named);
    let (mut archives, mut files, mut pairs) = (BTreeSet::new(), BTreeSet::new(), 0);
    let root = spec.as_ref().map(|spec| folder_of(&spec.path));
    let scenes = spec
        .as_ref()
        .map(|spec| sharp_datasets::open_each(spec).unwrap_or_default().scenes);
    let found = found_views(scenes.as_deref().unwrap_or_default());
    let split = spec.as_ref().map(|spec| spec.setting("split"));
    for pair in list
        .pairs
        .iter()
        .filter(|p| p.dataset == name && p.selected)
    {
        pairs += 1;
        let views = [
            (&pair.source, &pair.source_file),
            (&pair.target, &pair.target_file),
        ];
        // Procedural views have no file to list.
        for (view, picture) in views.into_iter().filter(|(_, picture)| !picture.is_empty()) {
            let by_layout = match entry {
                Some(entry) => {
                    archives.extend(entry.archives(&pair.scene, picture));
                    entry.required_files(&pair.scene, picture)
                }
                None => vec![RequiredFile::picture(picture)],
            };
            let by_layout = by_layout
                .into_iter()
                .filter_map(|file| of_split(file, split));
            match found.get(&(pair.scene.as_str(), view.as_str())) {
                // The reader knows all files that the view needs, so only the list files are taken from the layout.
                Some(view) => {
                    let folder = root.as_deref().unwrap_or(Path::new(""));
                    files.extend(view.required_files(folder));
                    files.extend(by_layout.filter(|file| file.role == FileRole::List));
                }
                None => files.extend(by_layout),
            }
        }
    }
    let files: Vec<Listed> = files
        .into_iter()
        .map(|file| {
            let there = |root: &Path| {
                let mut names = std::iter::once(&file.path).chain(&file.or);
                names.any(|name| root.join(name).is_file())
            };
            let present = root.as_deref().map(there);
            Listed { file, present }
        })
        .collect();
    let lacking = |listed: &&Listed| {
        // Masks are optional, and lists of views are not needed once the pairs are known.
        let counts = !matches!(listed.file.role, FileRole::Mask | FileRole::List);
        counts && listed.present == Some(false)
    };
    Needed {
        dataset: name.to_owned(),
        format: entry.map(|entry| entry.format),
        pairs,
        archives,
        missing: root.as_ref().map(|_| files.iter().filter(lacking).count()),
        files,
    }
}

/// The folder that listed file names are relative to: the dataset's folder, or the parent folder if the dataset is a
/// file.
fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if path.is_file() => folder.to_owned(),
        _ => path.to_owned(),
    }
}

/// The views that the reader finds, keyed by scene and view. A view's depth and masks are those listed in a
/// `transforms.json`, or named like its picture.
///
/// Empty for an incomplete dataset, which cannot be opened yet. Leaves out stereo pairs, because the dataset's layout
/// determines all files that they need.
fn found_views(scenes: &[Scene]) -> BTreeMap<(&str, &str), &View> {
    let multi_view = scenes
        .iter()
        .filter(|scene| scene.pairing == Pairing::MultiView);
    let views = multi_view.flat_map(|scene| {
        let views = scene.views.iter();
        views.map(move |view| ((scene.id.as_str(), view.id.as_str()), view))
    });
    views.collect()
}

/// Replaces a list file of ScanNet++ with the list file of the requested split; other files are returned unchanged.
/// `None` if the split is the whole dataset, which needs no list file.
fn of_split(mut file: RequiredFile, split: Option<&str>) -> Option<RequiredFile> {
    if let (FileRole::List, Some(split)) = (file.role, split)
        && file.path.starts_with("splits/")
    {
        if split == "all" {
            return None;
        }
        file.path = format!("splits/{split}.txt");
    }
    Some(file)
}

impl Display for Needed {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let format = match self.format {
            Some(format) if format != self.dataset => format!(" ({format})"),
            Some(_) => String::new(),
            None => " (format unknown: give it with --dataset NAME:FORMAT=PATH)".to_owned(),
        };
        writeln!(
            f,
            "{}{format}: {}, {}",
            self.dataset,
            counted(self.pairs, "selected pair"),
            counted(self.files.len(), "file")
        )?;
        for archive in &self.archives {
            writeln!(f, "  download {archive}")?;
        }
        for listed in &self.files {
            let role = match listed.file.role {
                FileRole::Picture => "picture",
                FileRole::Camera => "camera",
                FileRole::List => "list",
                FileRole::Mask => "mask",
                FileRole::Depth => "depth",
            };
            let names = std::iter::once(&listed.file.path).chain(&listed.file.or);
            let names: Vec<&str> = names.map(String::as_str).collect();
            let absent = if listed.present == Some(false) {
                "  MISSING"
            } else {
                ""
            };
            writeln!(f, "  {role:<8} {}{absent}", names.join(" or "))?;
        }
        Ok(())
    }
}
