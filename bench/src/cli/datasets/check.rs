//! `datasets check`: checks datasets for broken files and contradictions.

use std::fmt::{self, Display, Formatter};

use serde::Serialize;
use sharp_datasets::check::consistency::{Consistency, Fit};
use sharp_datasets::check::{DatasetReport, SceneReport, check};

use crate::cli::output::Terminal;
use crate::cli::{Outcome, output};
use crate::io::counts::counted;
use crate::io::observer::Observer;
use crate::pairs::DatasetConfig;

pub(super) fn execute(
    datasets: &[DatasetConfig],
    views: usize,
    json: bool,
) -> anyhow::Result<Outcome> {
    anyhow::ensure!(views > 0, "--views 0: must be at least 1");
    let mut reports = Vec::with_capacity(datasets.len());
    // Views are checked as stored: resizing and pair options do not apply.
    for DatasetConfig { spec, .. } in datasets {
        let terminal = Terminal::default();
        reports.push(check(spec, views, &|done, total| {
            terminal.advance(&spec.name, "scenes", done as u64, total as u64);
        })?);
        terminal.end();
    }
    let problems: usize = reports.iter().map(|report| report.problems).sum();
    let datasets = reports;
    output::print(&Checked { datasets, problems }, json)?;
    Ok(Outcome::of_problems(problems > 0))
}

#[derive(Serialize)]
struct Checked {
    datasets: Vec<DatasetReport>,
    problems: usize,
}

impl Display for Checked {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.datasets
            .iter()
            .try_for_each(|report| write_report(f, report))
    }
}

fn write_report(f: &mut Formatter<'_>, report: &DatasetReport) -> fmt::Result {
    writeln!(f, "{}", report.dataset)?;
    for reading in &report.readings {
        let standing = match (reading.proxy, reading.open) {
            (true, _) => " (proxy: differs from the paper)",
            (false, true) => " (open in the paper)",
            (false, false) => "",
        };
        writeln!(f, "  reading {}={}{standing}", reading.key, reading.value)?;
    }
    for scene in &report.scenes {
        write_scene(f, scene)?;
    }
    for problem in &report.unreadable {
        writeln!(f, "  BROKEN {problem}")?;
    }
    for ruled_out in &report.ruled_out {
        writeln!(f, "  note {ruled_out}")?;
    }
    let in_scenes: usize = report.scenes.iter().map(|s| s.problems.len()).sum();
    let views: usize = report.scenes.iter().map(|scene| scene.views).sum();
    writeln!(
        f,
        "{}, {}; {} unreadable; problems: {}",
        counted(report.scenes.len(), "scene"),
        counted(views, "view"),
        counted(report.problems - in_scenes, "scene"),
        report.problems
    )
}

/// Describes how well neighbouring views agree, as read and under the best convention.
fn poses(found: &Consistency) -> String {
    let levels = |fit: &Fit| match fit.colour_levels {
        Some(levels) => format!(", colours differ by {levels:.1} levels"),
        None => String::new(),
    };
    let as_read = &found.as_read;
    let mut text = format!(
        "{:.1} % of depths agree between neighbouring views{}",
        100.0 * as_read.depth,
        levels(as_read)
    );
    let others = found.otherwise.iter();
    if let Some(best) = others.max_by(|a, b| a.depth.total_cmp(&b.depth)) {
        let share = 100.0 * best.depth;
        text += &format!("; under other conventions, at most {share:.1} % agree");
    }
    let others = found.otherwise.iter().filter_map(|fit| fit.colour_levels);
    if let Some(least) = others.min_by(f64::total_cmp) {
        text += &format!(" and colours differ by at least {least:.1} levels");
    }
    text
}

fn write_scene(f: &mut Formatter<'_>, scene: &SceneReport) -> fmt::Result {
    let sizes = match scene.sizes.as_slice() {
        sizes @ ([] | [_] | [_, _] | [_, _, _]) => sizes.join(", "),
        [first, .., last] => format!("{} sizes from {first} to {last}", scene.sizes.len()),
    };
    let depth = match scene.depth_coverage {
        Some(coverage) => format!(
            "depth in {} of {} decoded views, at {:.1} % of the pixels",
            scene.with_depth,
            scene.decoded,
            100.0 * coverage
        ),
        None => format!("no depth in {} decoded views", scene.decoded),
    };
    writeln!(
        f,
        "  {}: {}, {sizes}; {depth}",
        scene.id,
        counted(scene.views, "view")
    )?;
    if let Some(found) = &scene.consistency {
        writeln!(f, "    poses: {}", poses(found))?;
    }
    for note in &scene.notes {
        writeln!(f, "    note {note}")?;
    }
    for problem in &scene.problems {
        writeln!(f, "    BROKEN {problem}")?;
    }
    Ok(())
}
