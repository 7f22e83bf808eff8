//! Lists of pairs.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;
use sharp_bench::io::observer::Observer;
use sharp_bench::pairs::pair_list::COLUMNS;
use sharp_bench::pairs::{
    OpenDataset, OverlapCache, Pair, PairList, PairOptions, PairRecipe, SceneChecks,
};

use crate::errors::{failed, refused};
use crate::table::{Column, Table};
use crate::views::configs;

/// Collects warnings for the user.
#[derive(Default)]
pub(crate) struct Warnings(Mutex<Vec<String>>);

impl Warnings {
    pub(crate) fn push(&self, text: &str) {
        lock(&self.0).push(text.to_owned());
    }

    pub(crate) fn take(&self) -> Vec<String> {
        std::mem::take(&mut lock(&self.0))
    }
}

/// Locks a mutex, ignoring poisoning: no code that holds a lock panics in the middle of a
/// change.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Observer for Warnings {
    fn warn(&self, text: &str) {
        self.push(text);
    }
}

/// The user's cache of measured overlaps; `None` if there is no cache folder.
pub(crate) fn cache() -> Option<OverlapCache> {
    OverlapCache::users_folder().map(OverlapCache::in_folder)
}

pub(crate) fn scene_checks() -> SceneChecks {
    SceneChecks::new(OverlapCache::users_folder())
}

/// The pairs of datasets, with warnings; written to `out` if given.
#[pyfunction]
#[pyo3(signature = (specs, scenes, options, out))]
pub(crate) fn pairs(
    py: Python<'_>,
    specs: Vec<String>,
    scenes: Option<String>,
    options: &str,
    out: Option<PathBuf>,
) -> PyResult<(Table, Vec<String>)> {
    let options: PairOptions = options.parse().map_err(refused)?;
    let warnings = Warnings::default();
    let built = py.detach(|| -> anyhow::Result<_> {
        let mut datasets = OpenDataset::open_all(&configs(&specs)?, scenes.as_deref())?;
        for dataset in &mut datasets {
            scene_checks().look_at(dataset, &warnings);
        }
        let built = PairRecipe::new(options).build(&datasets, cache().as_ref(), &warnings)?;
        let list = built.list(out.clone().unwrap_or_default());
        if out.is_some() {
            list.write()?;
        }
        for sentence in &built.advice {
            warnings.push(sentence);
        }
        Ok(list)
    });
    Ok((table(&built.map_err(failed)?), warnings.take()))
}

/// A table of the pair list, with the columns of its CSV file.
fn table(list: &PairList) -> Table {
    let all = || list.pairs.iter();
    let number = |of: fn(&Pair) -> Option<f64>| Column::Number(all().map(of).collect());
    let column = |name: &'static str| match name {
        "pair_id" => Column::text(all().map(|pair| pair.pair_id.as_str())),
        "dataset" => Column::text(all().map(|pair| pair.dataset.as_str())),
        "scene" => Column::text(all().map(|pair| pair.scene.as_str())),
        "set" => number(|pair| pair.set.map(f64::from)),
        "source" => Column::text(all().map(|pair| pair.source.as_str())),
        "target" => Column::text(all().map(|pair| pair.target.as_str())),
        "source_file" => Column::text(all().map(|pair| pair.source_file.as_str())),
        "target_file" => Column::text(all().map(|pair| pair.target_file.as_str())),
        "source_sha256" => Column::text(all().map(|pair| pair.source_sha256.as_str())),
        "target_sha256" => Column::text(all().map(|pair| pair.target_sha256.as_str())),
        "baseline_m" => number(|pair| Some(pair.baseline_m)),
        "rotation_deg" => number(|pair| Some(pair.rotation_deg)),
        "median_depth_m" => number(|pair| pair.median_depth_m),
        "overlap" => number(|pair| pair.overlap),
        "overlap_source_to_target" => number(|pair| pair.overlap_source_to_target),
        _ => Column::Truth(all().map(|pair| pair.selected).collect()),
    };
    Table::new(COLUMNS.map(|name| (name.to_owned(), column(name))).into())
}
