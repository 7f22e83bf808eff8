//! `datasets check`: checks datasets for broken files and contradictions.

use serde_json::json;
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
    as_json: bool,
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
    let value = || json!({"datasets": reports, "problems": problems});
    output::print(as_json, value, || reports.iter().map(report_text).collect())?;
    Ok(Outcome::of_problems(problems > 0))
}

fn report_text(report: &DatasetReport) -> String {
    let mut text = format!("{}\n", report.dataset);
    for reading in &report.readings {
        let standing = match (reading.proxy, reading.open) {
            (true, _) => " (proxy: differs from the paper)",
            (false, true) => " (open in the paper)",
            (false, false) => "",
        };
        text += &format!("  reading {}={}{standing}\n", reading.key, reading.value);
    }
    text.extend(report.scenes.iter().map(scene_text));
    for problem in &report.unreadable {
        text += &format!("  BROKEN {problem}\n");
    }
    for ruled_out in &report.ruled_out {
        text += &format!("  note {ruled_out}\n");
    }
    let in_scenes: usize = report.scenes.iter().map(|s| s.problems.len()).sum();
    let views: usize = report.scenes.iter().map(|scene| scene.views).sum();
    text + &format!(
        "{}, {}; {} unreadable; problems: {}\n",
        counted(report.scenes.len(), "scene"),
        counted(views, "view"),
        counted(report.problems - in_scenes, "scene"),
        report.problems
    )
}

/// Describes how well neighbouring views agree under the dataset's camera convention, and under the best alternative
/// convention.
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

fn scene_text(scene: &SceneReport) -> String {
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
    let views = counted(scene.views, "view");
    let mut text = format!("  {}: {views}, {sizes}; {depth}\n", scene.id);
    if let Some(found) = &scene.consistency {
        text += &format!("    poses: {}\n", poses(found));
    }
    for note in &scene.notes {
        text += &format!("    note {note}\n");
    }
    for problem in &scene.problems {
        text += &format!("    BROKEN {problem}\n");
    }
    text
}
