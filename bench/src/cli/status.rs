//! `status`: progress of a run.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::output::span;
use super::{Outcome, output};
use crate::evaluate::{RunProgress, status::unfinished_shards};
use crate::io::counts::counted;

/// Show the progress of a run
///
/// Counts units: a unit is the result of one method on one pair. Reads only the run folder, on any machine with access
/// to the folder, even while shards are running. The exit code is 75 while units are missing; after that, it is 4 if
/// units failed or the datasets had broken files.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench status runs/all
  sharp-bench status runs/all --unfinished-shards 64     (shards to submit, such as 2,17-19)")]
pub(super) struct StatusArgs {
    /// The run folder
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Print only which of N shards are unfinished, as a list for a scheduler (2,17-19)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    unfinished_shards: Option<u32>,
    /// Split the list of unfinished shards into job arrays with indices up to INDEX. Each line has an offset and
    /// indices; offset plus index is the shard
    #[arg(long, value_name = "INDEX", requires = "unfinished_shards", value_parser = clap::value_parser!(u32).range(1..))]
    max_index: Option<u32>,
    /// Count shards with recorded failures as unfinished
    #[arg(long, requires = "unfinished_shards")]
    retry_failed: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &StatusArgs) -> anyhow::Result<Outcome> {
    if let Some(count) = args.unfinished_shards {
        let shards = unfinished_shards(&args.run, count as usize, args.retry_failed)?;
        output::print(
            args.json,
            || &shards,
            || match args.max_index {
                // One line for each of the scheduler's job arrays.
                Some(max) => {
                    let arrays = arrays(&shards, max as usize).into_iter();
                    let lines =
                        arrays.map(|(offset, indices)| format!("{offset} {}\n", ranges(&indices)));
                    lines.collect()
                }
                None => ranges(&shards),
            },
        )?;
        return Ok(Outcome::Done);
    }
    let progress = RunProgress::read(&args.run)?;
    let shown = ShownProgress {
        progress: &progress,
        secs_left: progress.secs_left(),
    };
    output::print(args.json, || &shown, || shown.to_string())?;
    if progress.damaged > 0 {
        output::remark(format!(
            "warning: {}; damaged units count as missing, and the next run recomputes them",
            counted(progress.damaged, "damaged unit file")
        ));
    }
    Ok(match (progress.open(), progress.all.failed) {
        (0, 0) => Outcome::of_problems(progress.lacks_files),
        (0, _) => Outcome::RecordedFailures,
        _ => Outcome::Resumable,
    })
}

#[derive(Serialize)]
struct ShownProgress<'a> {
    #[serde(flatten)]
    progress: &'a RunProgress,
    secs_left: Option<f64>,
}

impl Display for ShownProgress<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let progress = self.progress;
        writeln!(
            f,
            "               units      done    failed  unscored   missing"
        )?;
        let all = [("all".to_owned(), progress.all)];
        for (label, count) in progress.methods.iter().chain(&all) {
            writeln!(
                f,
                "{label:<12}{:>8}{:>10}{:>10}{:>10}{:>10}",
                count.units, count.done, count.failed, count.unscored, count.missing
            )?;
        }
        if let (Some((units, secs)), Some(left), true) =
            (progress.pace, self.secs_left, progress.open() > 0)
        {
            let (last, left) = (span(secs), span(left));
            write!(
                f,
                "{units} units in the last {last}; at this speed, the rest takes {left}"
            )?;
        }
        Ok(())
    }
}

/// Formats numbers as ranges, such as `2,5-7`.
fn ranges(numbers: &[usize]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b);
    let runs = runs.map(|run| match run {
        [one] => one.to_string(),
        _ => format!("{}-{}", run[0], run[run.len() - 1]),
    });
    runs.collect::<Vec<_>>().join(",")
}

/// Splits shards into job arrays with indices from 1 to `max`. Each array is given as the offset to add to its indices,
/// and the indices.
fn arrays(shards: &[usize], max: usize) -> Vec<(usize, Vec<usize>)> {
    let offset = |shard: usize| (shard - 1) / max * max;
    let chunks = shards.chunk_by(|a, b| offset(*a) == offset(*b));
    let arrays = chunks.map(|chunk| {
        let offset = offset(chunk[0]);
        (offset, chunk.iter().map(|shard| shard - offset).collect())
    });
    arrays.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_listed_as_schedulers_take_them() {
        assert_eq!(ranges(&[]), "");
        assert_eq!(ranges(&[1, 3, 4, 5, 9]), "1,3-5,9");
        assert_eq!(ranges(&[1, 2]), "1-2");
        let chunks = arrays(&[1, 1000, 1001, 2500], 1000);
        assert_eq!(
            chunks,
            [(0, vec![1, 1000]), (1000, vec![1]), (2000, vec![500])]
        );
    }
}
