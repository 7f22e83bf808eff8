//! Estimates the cost of an evaluation by measuring a few of its pairs.

use std::path::Path;
use std::time::Instant;

use cpu_time::ProcessTime;

use super::error::EvaluateError;
use super::folder::RunFolder;
use super::job::{RunOptions, Stages};
use super::keys::Keys;
use super::manifest::RendererRecord;
use super::pipeline::run;
use super::plan::{Estimate, StageCost};
use super::prepare::Evaluation;
use super::shard::Shard;
use crate::config::Keep;
use crate::io::atomic_files::FileError;
use crate::io::machine::{peak_bytes, reset_peak};
use crate::io::observer::Quiet;
use crate::pairs::pair_list::ResolvedPair;

/// Number of sources measured.
const SOURCES: usize = 3;

impl Evaluation {
    /// Evaluates a few pairs in a temporary folder and extrapolates to the cost of all.
    ///
    /// # Errors
    /// If there is no space for temporary files, or the renderer's device fails.
    pub fn estimate(&self, options: RunOptions) -> Result<Estimate, EvaluateError> {
        let pairs = self.pairs()?;
        let same_source = |a: &ResolvedPair, b: &ResolvedPair| std::ptr::eq(a.source, b.source);
        let groups: Vec<&[ResolvedPair]> = pairs.chunk_by(same_source).collect();
        // Spread evenly over the sources, which are sorted by dataset and scene.
        let count = groups.len().min(SOURCES);
        let chosen: Vec<&[ResolvedPair]> = (0..count)
            .map(|i| groups[(2 * i + 1) * groups.len() / (2 * count)])
            .collect();
        let temporary = std::env::temp_dir();
        let folder =
            tempfile::tempdir().map_err(FileError::new(&temporary, "create a folder in"))?;
        let run_folder = RunFolder::create(folder.path())?;
        let first: Vec<ResolvedPair> = chosen.iter().map(|group| group[0]).collect();
        let second: Vec<ResolvedPair> = chosen.iter().filter_map(|g| g.get(1)).copied().collect();
        let (sources, others) = (groups.len() as f64, (pairs.len() - groups.len()) as f64);
        let keys = Keys::new(&self.datasets, &RendererRecord::of(&self.renderer));
        let mut failures = 0;
        let mut stage = |stages: Stages| -> Result<StageCost, EvaluateError> {
            // Keep all predictions, so that the second pair of each source reuses that of the
            // first.
            let kept = RunOptions {
                stages,
                keep_gaussians: true,
                ..options
            };
            reset_peak();
            let mut cost = StageCost::default();
            for (measured, all) in [(&first, sources), (&second, others)] {
                if measured.is_empty() {
                    continue;
                }
                let job = self.job(
                    measured.clone(),
                    Default::default(),
                    &keys,
                    kept,
                    Shard::WHOLE,
                );
                let (cpu, wall, disk) = (ProcessTime::now(), Instant::now(), size(folder.path()));
                failures += run(&job, &run_folder, &Quiet)?.failed;
                let share = all / measured.len() as f64;
                cost.cpu_secs += cpu.elapsed().as_secs_f64() * share;
                cost.wall_secs += wall.elapsed().as_secs_f64() * share;
                let written = size(folder.path()).saturating_sub(disk);
                cost.disk_bytes += (written as f64 * share) as u64;
            }
            cost.peak_bytes = peak_bytes();
            Ok(cost)
        };
        let predict = stage(Stages::Predict)?;
        let render = stage(Stages::Render)?;
        let score = stage(Stages::Score)?;
        let (all, first, measured) = (pairs.len() as f64, first.len(), first.len() + second.len());
        let gaussians = size(&run_folder.gaussians_path());
        let pictures = size(&run_folder.root().join("predictions"));
        let units = size(folder.path()).saturating_sub(gaussians + pictures);
        let of_pairs = match options.keep {
            Keep::None => units,
            _ => units + pictures,
        } as f64
            / measured as f64;
        let of_sources = if options.keep_gaussians {
            gaussians as f64 / first as f64
        } else {
            0.0
        };
        let stages = [predict, render, score];
        Ok(Estimate {
            units: pairs.len() * self.methods.len(),
            sources: groups.len(),
            pairs: pairs.len(),
            measured_pairs: measured,
            measured_failures: failures,
            total: StageCost {
                cpu_secs: stages.iter().map(|cost| cost.cpu_secs).sum(),
                wall_secs: stages.iter().map(|cost| cost.wall_secs).sum(),
                peak_bytes: stages.iter().filter_map(|cost| cost.peak_bytes).max(),
                disk_bytes: (of_pairs * all + of_sources * sources) as u64,
            },
            predict,
            render,
            score,
        })
    }
}

/// Total size of the files below a folder, bytes; 0 if it does not exist.
fn size(path: &Path) -> u64 {
    let Ok(entries) = std::fs::read_dir(path) else {
        return std::fs::metadata(path).map_or(0, |file| file.len());
    };
    entries.flatten().map(|entry| size(&entry.path())).sum()
}
