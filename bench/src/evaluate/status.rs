//! Progress of a run, read from its folder while other processes may be writing.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::{Duration, SystemTime};

use serde::Serialize;

use super::error::EvaluateError;
use super::folder::RunFolder;
use super::plan::{Estimate, RunPlan, RunStatus};
use super::record::Status;
use super::results::{Current, check_rows};
use super::shard::Shard;
use super::unit::{Unit, UnitProgress};
use crate::pairs::PairList;

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunProgress {
    /// Progress of all methods together.
    pub all: RunStatus,
    /// Progress of each method, in the order of the plan.
    pub methods: Vec<(String, RunStatus)>,
    /// Number of units finished within the last ten minutes of work, and the seconds that they took; `None` if unknown.
    pub pace: Option<(usize, f64)>,
    pub estimate: Option<Estimate>,
    /// Damaged files; their units count as missing.
    pub damaged: usize,
    /// Whether pairs are missing because scenes or views cannot be read.
    pub lacks_files: bool,
}

/// Period over which the pace is measured.
const WINDOW: Duration = Duration::from_secs(600);

impl RunProgress {
    /// Reads a folder.
    ///
    /// # Errors
    /// If it is not a run folder, or cannot be read.
    pub fn read(root: &Path) -> Result<Self, EvaluateError> {
        let folder = RunFolder::open(root)?;
        let (plan, current) = read(&folder)?;
        let units: BTreeMap<(&str, &str), &Unit> = current
            .units
            .iter()
            .map(|unit| {
                (
                    (unit.slot.pair_id.as_str(), unit.slot.method.as_str()),
                    unit,
                )
            })
            .collect();
        let mut methods: Vec<(String, RunStatus)> = Vec::new();
        let mut all = RunStatus::default();
        for (pair, method) in plan.units() {
            let at = methods.iter().position(|(label, _)| label == method);
            let at = at.unwrap_or_else(|| {
                methods.push((method.to_owned(), RunStatus::default()));
                methods.len() - 1
            });
            let standing = match units.get(&(pair, method)) {
                Some(unit) => unit.progress(unit.scores.is_empty()),
                None => UnitProgress::Missing,
            };
            all.add(standing);
            methods[at].1.add(standing);
        }
        let order = |label: &str| {
            let mut labels = current.manifest.methods.iter();
            labels.position(|method| method.label == label)
        };
        methods.sort_by_key(|(label, _)| order(label));
        Ok(Self {
            all,
            methods,
            pace: pace(folder.unit_times()?),
            estimate: plan.estimate,
            damaged: current.damaged.len(),
            lacks_files: current.manifest.lacks_files(),
        })
    }

    /// Number of missing or unscored units. Excludes recorded failures, although a run would retry them.
    pub fn open(&self) -> usize {
        self.all.missing + self.all.unscored
    }

    /// Estimated seconds until no unit is open, at the current pace; `None` if the pace is unknown.
    pub fn secs_left(&self) -> Option<f64> {
        let (units, secs) = self.pace?;
        Some(self.open() as f64 * secs / units as f64)
    }
}

/// Splits the plan into `count` shards. Returns the numbers (from 1) of the shards that contain a unit without a result
/// or, with `retry_failed`, a failed unit.
///
/// # Errors
/// Those of [`RunProgress::read`]; also if `count` is out of range.
pub fn unfinished_shards(
    root: &Path,
    count: usize,
    retry_failed: bool,
) -> Result<Vec<usize>, EvaluateError> {
    let shards = Shard::new(1, count)?;
    let folder = RunFolder::open(root)?;
    let (plan, current) = read(&folder)?;
    let mut open: BTreeSet<&str> = current
        .missing
        .iter()
        .map(|(pair, _)| pair.as_str())
        .collect();
    if retry_failed {
        let failed = current
            .units
            .iter()
            .filter(|unit| unit.record.status != Status::Ok);
        open.extend(failed.map(|unit| unit.slot.pair_id.as_str()));
    }
    let shares = shards.deal(plan.pairs().into_iter().collect(), |id| id);
    let unfinished = shares.iter().enumerate();
    let unfinished = unfinished.filter(|(_, share)| share.iter().any(|id| open.contains(id)));
    Ok(unfinished.map(|(at, _)| at + 1).collect())
}

fn read(folder: &RunFolder) -> Result<(RunPlan, Current), EvaluateError> {
    let (plan, current) = (folder.plan()?, Current::read(folder)?);
    let list = PairList::read(&folder.pairs_path())?;
    check_rows(folder, &current.manifest.pairs, &plan, &list)?;
    Ok((plan, current))
}

/// Number of units that finished within [`WINDOW`] before the last one, and the seconds between the first and the last.
/// The first of these units is not counted, because only its end is in the period. `None` if only one unit finished in
/// the period, or if the last one finished longer ago than [`WINDOW`].
fn pace(mut times: Vec<SystemTime>) -> Option<(usize, f64)> {
    times.sort();
    let last = *times.last()?;
    // If the clock was set back, treat the last unit as just finished.
    let since = last.elapsed().unwrap_or_default();
    let first = *times
        .iter()
        .find(|time| last.duration_since(**time).is_ok_and(|t| t <= WINDOW))?;
    let count = times.iter().filter(|time| **time > first).count();
    let secs = last.duration_since(first).unwrap_or_default().as_secs_f64();
    (since <= WINDOW && count > 0 && secs > 0.0).then_some((count, secs))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pace_is_that_of_the_last_minutes() {
        let now = SystemTime::now();
        let ago = |secs: u64| now - Duration::from_secs(secs);
        assert_eq!(pace(vec![]), None);
        assert_eq!(pace(vec![ago(5)]), None);
        // Units before the window are ignored; the first unit in the window only marks the start time.
        let times = vec![ago(9000), ago(8999), ago(100), ago(50), ago(0)];
        assert_eq!(pace(times), Some((2, 100.0)));
        assert_eq!(pace(vec![ago(9000), ago(8000)]), None);
    }
}
