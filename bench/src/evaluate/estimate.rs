//! What an evaluation would cost, measured on a few of its pairs.

use std::path::Path;
use std::time::{Duration, Instant};

use cpu_time::ProcessTime;
use serde::Serialize;

use super::error::EvaluateError;
use super::folder::RunFolder;
use super::keys::Keys;
use super::manifest::RendererRecord;
use super::pipeline::{RunOptions, UnitCounts, run};
use super::prepare::Evaluation;
use crate::io::atomic_files::FileError;
use crate::io::machine::peak_bytes;
use crate::io::observer::Quiet;
use crate::pairs::pair_list::ResolvedPair;

/// Sources that are measured.
const SOURCES: usize = 3;

/// The cost of a whole evaluation, whatever a folder holds of it.
///
/// Linear in sources and pairs: the first pair of a source costs its prediction too, the others do not where the method
/// predicts Gaussians. What `common_region` scores again is not counted, and the time of programs behind `command` counts
/// in [`wall_secs`](Self::wall_secs) only.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    pub units: usize,
    /// Different source views.
    pub sources: usize,
    pub pairs: usize,
    pub measured_pairs: usize,
    /// Units among them that failed.
    pub measured_failures: usize,
    /// Time of all cores together, s.
    pub cpu_secs: f64,
    /// As this machine was while measuring, s.
    pub wall_secs: f64,
    /// `None` where the system does not say.
    pub peak_bytes: Option<u64>,
    /// What the run folder would take.
    pub disk_bytes: u64,
}

impl Evaluation {
    /// Evaluates a few pairs into a temporary folder, and tells what all of them would cost.
    ///
    /// # Errors
    /// When there is no room for temporary files, or the renderer's device fails.
    pub fn estimate(&self, options: RunOptions) -> Result<Estimate, EvaluateError> {
        let pairs = self.pairs()?;
        let same_source = |a: &ResolvedPair, b: &ResolvedPair| std::ptr::eq(a.source, b.source);
        let groups: Vec<&[ResolvedPair]> = pairs.chunk_by(same_source).collect();
        // Evenly over the sources, which are sorted by dataset and scene.
        let count = groups.len().min(SOURCES);
        let chosen: Vec<&[ResolvedPair]> = (0..count)
            .map(|i| groups[(2 * i + 1) * groups.len() / (2 * count)])
            .collect();
        let temporary = std::env::temp_dir();
        let folder =
            tempfile::tempdir().map_err(FileError::new(&temporary, "create a folder in"))?;
        let run_folder = RunFolder::create(folder.path())?;
        let keys = Keys::new(&self.datasets, &RendererRecord::of(&self.renderer));
        // Kept, so that the second pairs find the predictions of the first.
        let kept = RunOptions {
            keep_gaussians: true,
            ..options
        };
        let measure = |pairs: Vec<ResolvedPair<'_>>| -> Result<Cost, EvaluateError> {
            let job = self.job(pairs, &keys, kept);
            let (cpu, wall) = (ProcessTime::now(), Instant::now());
            let counts = run(&job, &run_folder, &Quiet)?;
            Ok(Cost {
                pairs: job.pairs.len(),
                counts,
                cpu: cpu.elapsed(),
                wall: wall.elapsed(),
            })
        };
        let first = measure(chosen.iter().map(|group| group[0]).collect())?;
        let second = measure(chosen.iter().filter_map(|g| g.get(1)).copied().collect())?;
        let gaussian_bytes = size(&run_folder.gaussians_path()) as f64;
        let (sources, others) = (groups.len() as f64, (pairs.len() - groups.len()) as f64);
        let total = |secs: fn(&Cost) -> Duration| {
            let each = |cost: &Cost| secs(cost).as_secs_f64() / cost.pairs.max(1) as f64;
            each(&first) * sources + each(&second) * others
        };
        let measured_pairs = first.pairs + second.pairs;
        let per_pair = (size(folder.path()) as f64 - gaussian_bytes) / measured_pairs as f64;
        let per_source = match options.keep_gaussians {
            true => gaussian_bytes / first.pairs as f64,
            false => 0.0,
        };
        Ok(Estimate {
            units: pairs.len() * self.methods.len(),
            sources: groups.len(),
            pairs: pairs.len(),
            measured_pairs,
            measured_failures: first.counts.failed + second.counts.failed,
            cpu_secs: total(|cost| cost.cpu),
            wall_secs: total(|cost| cost.wall),
            peak_bytes: peak_bytes(),
            disk_bytes: (per_pair * pairs.len() as f64 + per_source * sources) as u64,
        })
    }
}

/// What measuring some pairs took.
struct Cost {
    pairs: usize,
    counts: UnitCounts,
    cpu: Duration,
    wall: Duration,
}

/// Bytes of the files below a folder; nothing where it is not.
fn size(path: &Path) -> u64 {
    let Ok(entries) = std::fs::read_dir(path) else {
        return std::fs::metadata(path).map_or(0, |file| file.len());
    };
    entries.flatten().map(|entry| size(&entry.path())).sum()
}
