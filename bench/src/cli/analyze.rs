//! `analyze`: repeats the paper's experiment on the metrics' sensitivity to shifts.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, Subcommand};
use serde_json::json;
use sharp_metrics::Scorer;

use super::metrics::demand_explicit;
use super::output::Terminal;
use super::{Outcome, output};
use crate::analyze::translation::{Experiment, Shifts, figure, strip, table};
use crate::config::MetricConfig;
use crate::config::metrics::demand_weights;
use crate::io::atomic_files::{check_writable, write_atomic};
use crate::io::observer::Observer;
use crate::io::pictures;
use crate::pictures::keyed_scores::json_scores;
use crate::report::figures::sheet::SheetMedium;

/// Repeat the paper's experiment on the metrics' sensitivity to small shifts, on your pictures
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench analyze translation photo.png
  sharp-bench analyze translation photo.png --out sensitivity/
  sharp-bench analyze translation photo.png --shifts 0.1,0.2,0.5,1,2,5 --metrics all --json")]
pub(super) struct AnalyzeArgs {
    #[command(subcommand)]
    command: AnalyzeCommand,
}

#[derive(Debug, Subcommand)]
enum AnalyzeCommand {
    Translation(TranslationArgs),
}

/// Measure how much each metric reacts to a small shift of a picture, and to replacing the picture by its mean colour
///
/// Reproduces the paper's table of sensitivity. Shifting moves a window over the picture, so that no border has to be
/// filled in. Sub-pixel shifts are interpolated linearly; all pictures are rounded to 8 bits.
#[derive(Debug, Args)]
struct TranslationArgs {
    /// The picture
    image: PathBuf,
    /// Shifts in per cent of the picture's width; the defaults are the paper's
    #[arg(long, value_name = "LIST", default_value = "0.1,1,5")]
    shifts: Shifts,
    #[command(flatten)]
    metrics: MetricConfig,
    /// Write the table (Markdown, CSV, LaTeX), the figure (SVG, PNG) and the pictures into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn execute(args: &AnalyzeArgs) -> anyhow::Result<Outcome> {
    match &args.command {
        AnalyzeCommand::Translation(args) => translation(args),
    }
}

fn translation(args: &TranslationArgs) -> anyhow::Result<Outcome> {
    let selection = args.metrics.selection()?;
    if let Some(key) = selection.keys().find(|key| key.is_masked()) {
        anyhow::bail!(
            "--metrics {key}: this experiment uses no masks; name metrics without @ and a mask"
        );
    }
    let scorer = Scorer::with_options(
        &selection,
        &args.metrics.weights()?,
        args.metrics.options()?,
    )?;
    demand_weights(&selection, &scorer)?;
    let picture = pictures::read_rgb8(&args.image)?;
    if let Some(folder) = &args.out {
        check_writable(folder)?;
    }
    let terminal = Terminal::default();
    terminal.begin("shifting", args.shifts.percent().len() + 1, "comparisons");
    let advance = || terminal.step();
    let experiment = Experiment::run(&picture, &args.shifts, &scorer, advance)
        .with_context(|| args.image.display().to_string())?;
    terminal.end();
    for comparison in &experiment.comparisons {
        demand_explicit(&selection, &comparison.scores, &args.image)?;
    }
    let name = args.image.file_name();
    let name = name.map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let written = match &args.out {
        Some(folder) => write(&experiment, &name, args.shifts.are_the_papers(), folder)?,
        None => Vec::new(),
    };
    let (width, height) = experiment.reference.dimensions();
    let value = || {
        let comparisons = experiment.comparisons.iter().map(|comparison| {
            let [scores, unavailable] = json_scores(&comparison.scores);
            json!({
                "comparison": comparison.label(),
                "shift_percent": comparison.shift.map(|(percent, _)| percent),
                "shift_px": comparison.shift.map(|(_, pixels)| pixels),
                "scores": scores,
                "unavailable": unavailable,
            })
        });
        json!({
            "image": args.image.display().to_string(),
            // Width and height of the compared part, in pixels.
            "window": [width, height],
            "comparisons": comparisons.collect::<Vec<_>>(),
            "metrics": scorer.info(),
            "files": output::names(&written),
        })
    };
    output::print(args.json, value, || {
        let table = table::table(&experiment, &name).text();
        format!("{}\n{}", table.trim_end(), output::wrote(&written))
    })?;
    Ok(Outcome::Done)
}

/// Writes the table, the figure and the pictures; returns the files' paths.
fn write(
    experiment: &Experiment,
    name: &str,
    with_published: bool,
    folder: &Path,
) -> anyhow::Result<Vec<PathBuf>> {
    let ours = table::table(experiment, name);
    let (mut md, mut tex) = (ours.markdown(), ours.latex());
    if let Some(published) = table::published().filter(|_| with_published) {
        md += &format!("\n{}", published.markdown());
        tex += &format!("\n{}", published.latex());
    }
    let mut files = vec![
        ("translation.md", md.into_bytes()),
        ("translation.csv", table::csv(experiment)),
        ("translation.tex", tex.into_bytes()),
    ];
    if let Some(figure) = figure::figure(experiment)? {
        files.push(("translation.svg", figure.svg.into_bytes()));
        files.push(("translation.png", figure.png));
    }
    let pictures = strip::strip(experiment).png(&SheetMedium::screen())?;
    files.extend(pictures.map(|png| ("translation-pictures.png", png)));
    let mut written = Vec::new();
    for (name, bytes) in files {
        let path = folder.join(name);
        write_atomic(&path, &bytes)?;
        written.push(path);
    }
    Ok(written)
}
