//! Writes a report into a folder.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use askama::Template as _;
use rayon::prelude::*;
use sharp_datasets::Scene;

use crate::evaluate::Results;
use crate::evaluate::record::{Record, Score, Status};
use crate::io::atomic_files::{FileError, write_atomic, write_replaceable};
use crate::io::counts::counted;
use crate::io::text::{visible, without_folders};

use super::board::Board;
use super::column::Column;
use super::error::ReportError;
use super::facts::facts;
use super::figures::qualitative;
use super::gallery::{Gallery, THUMBNAILS};
use super::options::{Layout, ReportOptions};
use super::page::Page;
use super::pictures::ReportPictures;
use super::statistics::Uncertainty;
use super::tables::{Table, build, remarks};
use super::{markdown, paper, plots};
use sharp_plots::Figure;

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportFiles {
    /// The page to open.
    pub html: PathBuf,
    /// The page's content as Markdown.
    pub markdown: PathBuf,
    /// Location of the page's pictures.
    pub layout: Layout,
    /// Every file, sorted.
    pub all: Vec<PathBuf>,
    /// Kept pictures that are not shown because they differ from the scored ones, sorted.
    pub not_scored: Vec<PathBuf>,
}

/// List of a report's files, by which the next report in the folder finds obsolete files.
const LIST: &str = "files.txt";

const PAGE: &str = "index.html";
const MARKDOWN: &str = "report.md";

/// Text that identifies pages written by any version of this program.
const MARK: &str = "<p class=\"eyebrow\">sharp-bench report</p>";

/// Subfolders of a report.
const FOLDERS: [&str; 3] = ["tables", "plots", THUMBNAILS];

/// Writes the report of some results: `index.html`, `report.md`, `tables/*.{md,csv,tex}`, `plots/*.{svg,png}`, and
/// `thumbs/*.jpg` if the page does not embed its pictures. `files.txt` lists these files. Source and target pictures
/// are read from `scenes`. Each file is written atomically. Removes files of an earlier report that the new one does
/// not have; keeps all other files.
///
/// # Errors
/// If the folder is neither empty nor a report, the results contradict each other, or a file cannot be written.
pub fn report(
    results: &Results,
    scenes: &[Scene],
    out: &Path,
    options: &ReportOptions,
) -> Result<ReportFiles, ReportError> {
    check_folder(out)?;
    let public = options.public.then(|| without_paths(results));
    let results = public.as_ref().unwrap_or(results);
    let mut board = Board::of(results)?;
    let mut facts = facts(&results.manifest);
    let mut pictures = ReportPictures::new(results, scenes);
    if options.public {
        let datasets = board.datasets.iter_mut();
        let descriptions = datasets.map(|one| &mut one.dataset.description);
        let methods = board.methods.iter_mut().map(|one| &mut one.description);
        let facts = facts.iter_mut().flat_map(|group| &mut group.facts);
        for text in descriptions
            .chain(methods)
            .chain(facts.map(|(_, value)| value))
        {
            *text = without_folders(text);
        }
        let withheld = board.withheld().map(|dataset| dataset.name.clone());
        pictures = pictures.public(withheld.collect());
    }
    let (metrics, mut ours) = score_tables(&board, &results.records);
    let extras = build::extras(&board);
    ours.extend(build::of_extras(&board, &extras));
    let mut published = paper::beside(&board, &metrics, options.published);
    let here = pairs_here(&board);
    for table in &mut published {
        table.remarks.extend(here.clone());
    }

    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    let on_page = options.uncertainty.unwrap_or(Uncertainty::Ci95);
    let on_page: Vec<Table> = with_uncertainty(&ours, Some(on_page));
    let ours = with_uncertainty(&ours, options.uncertainty);
    for table in ours.iter().chain(&published) {
        let stem = format!("tables/{}", table.name);
        files.extend([
            (format!("{stem}.md"), table.markdown().into_bytes()),
            (format!("{stem}.csv"), table.csv()),
            (format!("{stem}.tex"), table.latex().into_bytes()),
        ]);
    }
    if let Some(comparison) = &options.comparison {
        files.extend(comparison.files.iter().cloned());
    }
    let figures = figures(&metrics, &board)?;
    let mut plots = Vec::new();
    for (stem, figure) in &figures {
        let png = format!("plots/{stem}.png");
        plots.push((figure.title.clone(), png.clone()));
        files.push((format!("plots/{stem}.svg"), figure.svg.clone().into_bytes()));
        files.push((png, figure.png.clone()));
    }
    if let Some(bytes) = qualitative::figure(&board, &metrics, &pictures)? {
        let png = "plots/qualitative.png".to_owned();
        plots.push(("Predictions side by side".to_owned(), png.clone()));
        files.push((png, bytes));
    }
    let counts = board.counts(metrics.len());
    let gallery = Gallery::new(&board, &metrics, options, &pictures);
    let page = Page {
        title: match options.comparison {
            Some(_) => "Two runs compared",
            None => "View synthesis from a single photograph",
        },
        lead: summary(results),
        results,
        options,
        out,
        metrics: &metrics,
        extras: &extras,
        facts: &facts,
        counts,
        board: &board,
        ours: &on_page,
        published: &published,
        figures: &figures,
        gallery: &gallery,
        pictures: &pictures,
    };
    let text = markdown::report(&page, &ours, &plots);
    files.push((MARKDOWN.into(), text.into_bytes()));
    files.push((PAGE.into(), page.render()?.into_bytes()));
    for (name, bytes) in &mut files {
        // Escape characters that a viewer of the file could interpret as commands.
        if !name.ends_with(".png")
            && let Ok(text) = str::from_utf8(bytes)
            && let Cow::Owned(harmless) = visible(text)
        {
            *bytes = harmless.into_bytes();
        }
    }

    let thumbnails = gallery.files();
    let names = files.iter().map(|(name, _)| name);
    let names: BTreeSet<&String> = names.chain(thumbnails.keys()).collect();
    let list = out.join(LIST);
    for name in listed_earlier(&list) {
        let path = out.join(&name);
        if !names.contains(&name) && path.is_file() {
            std::fs::remove_file(&path).map_err(FileError::new(&path, "remove"))?;
        }
    }
    let lines: String = names.iter().map(|name| format!("{name}\n")).collect();
    write_atomic(&list, lines.as_bytes())?;
    let all = names.iter().map(|name| out.join(name));
    let mut all: Vec<PathBuf> = all.chain([list]).collect();
    // Write the page last, when everything that it loads exists.
    thumbnails
        .par_iter()
        .try_for_each(|(name, jpeg)| write_replaceable(&out.join(name), jpeg))?;
    for (name, bytes) in files {
        write_atomic(&out.join(name), &bytes)?;
    }
    all.sort();
    Ok(ReportFiles {
        html: out.join(PAGE),
        layout: gallery.layout,
        markdown: out.join(MARKDOWN),
        all,
        not_scored: pictures.not_scored(),
    })
}

/// A copy of the results for publishing, without this machine's folders in reasons for failures, and without paths of
/// datasets.
fn without_paths(results: &Results) -> Results {
    let mut results = results.clone();
    for record in &mut results.records {
        if let Status::Failed { reason } = &mut record.status {
            *reason = without_folders(reason);
        }
        for score in record.scores.values_mut() {
            if let Score::Unavailable { unavailable } = score {
                *unavailable = without_folders(unavailable);
            }
        }
    }
    for dataset in &mut results.manifest.datasets {
        dataset.spec = None;
    }
    results
}

/// One or two sentences below the title.
fn summary(results: &Results) -> String {
    let unfinished = match results.missing.len() {
        0 => String::new(),
        missing => format!(
            " The run has not ended: {} of {} are done.",
            results.records.len(),
            counted(results.records.len() + missing, "unit")
        ),
    };
    let version = &results.manifest.version;
    format!("Evaluated by sharp-bench {version}.{unfinished}")
}

/// Tables of mean scores.
///
/// # Errors
/// If the results contradict each other.
pub fn mean_tables(
    results: &Results,
    uncertainty: Option<Uncertainty>,
) -> Result<Vec<Table>, ReportError> {
    let (_, tables) = score_tables(&Board::of(results)?, &results.records);
    Ok(with_uncertainty(&tables, uncertainty))
}

fn with_uncertainty(tables: &[Table], uncertainty: Option<Uncertainty>) -> Vec<Table> {
    let tables = tables.iter();
    tables
        .map(|table| table.with_uncertainty(uncertainty))
        .collect()
}

/// The metrics to show, and their tables. A remark in the first table states why other metrics are not shown.
fn score_tables(board: &Board<'_>, records: &[Record]) -> (Vec<Column>, Vec<Table>) {
    let (metrics, remark) = remarks::scored(records, &board.metrics);
    let mut tables = build::of_scores(board, &metrics);
    if let Some(first) = tables.first_mut() {
        first.remarks.extend(remark);
        let said = board.methods.iter().flat_map(|m| {
            let texts = [&m.note, &m.doubt].into_iter().flatten();
            texts.map(|text| format!("{}: {text}.", m.label))
        });
        first.remarks.extend(said);
    }
    (metrics, tables)
}

/// Fails if the folder is neither empty nor a report, or if a subfolder of the report is a link. A report is recognised
/// by the mark in its page or, if the page was not written yet, by a list of files that names the page. Ignores files
/// whose names begin with a dot.
fn check_folder(out: &Path) -> Result<(), FileError> {
    let refused = |path: &Path, reason: &str| {
        let reason = format!("{reason}; choose another folder with --out");
        Err(FileError::new(path, "write a report into")(
            std::io::Error::other(reason),
        ))
    };
    if let Some(link) = FOLDERS
        .map(|name| out.join(name))
        .iter()
        .find(|path| path.is_symlink())
    {
        return refused(link, "it is a link to another place");
    }
    let entries = match std::fs::read_dir(out) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(FileError::new(out, "write a report into")(error)),
    };
    let names = entries.flatten().map(|entry| entry.file_name());
    let mut foreign = names.filter(|name| !name.to_string_lossy().starts_with('.'));
    let Some(first) = foreign.next() else {
        return Ok(());
    };
    let is_ours = match sharp::files::read(&out.join(PAGE)) {
        Ok(page) => String::from_utf8_lossy(&page).contains(MARK),
        Err(_) => {
            let list = sharp::files::read_text(&out.join(LIST)).unwrap_or_default();
            [PAGE, MARKDOWN]
                .iter()
                .all(|name| list.lines().any(|line| line == *name))
        }
    };
    if is_ours {
        Ok(())
    } else {
        refused(
            out,
            &format!(
                "it contains {} and is not a report of sharp-bench",
                first.display()
            ),
        )
    }
}

/// The names in an earlier report's list, limited to those that a report can write.
fn listed_earlier(list: &Path) -> Vec<String> {
    let text = sharp::files::read_text(list).unwrap_or_default();
    let ours = |name: &&str| {
        !name.contains("..")
            && FOLDERS.iter().any(|folder| {
                let inside = name.strip_prefix(folder).and_then(|n| n.strip_prefix('/'));
                inside.is_some_and(|n| !n.contains('/'))
            })
    };
    text.lines().filter(ours).map(str::to_owned).collect()
}

/// A sentence with the number of pairs evaluated here, for datasets of the paper.
fn pairs_here(board: &Board<'_>) -> Option<String> {
    let datasets = board.datasets.iter();
    let of_paper = datasets.filter(|d| paper::column(&d.dataset).is_some());
    let of_paper = of_paper.map(|d| {
        let pairs = counted(d.pairs.len(), "pair");
        format!("{pairs} of {}", d.dataset.title())
    });
    let of_paper: Vec<String> = of_paper.collect();
    (!of_paper.is_empty()).then(|| format!("Measured here: {}.", of_paper.join(", ")))
}

/// Plots of each metric against the baseline, of each metric by scene, and the histogram, each with its file stem.
fn figures(metrics: &[Column], board: &Board<'_>) -> Result<Vec<(String, Figure)>, ReportError> {
    let mut figures = Vec::new();
    for metric in metrics {
        if let Some(figure) = plots::against_metric(board, metric)? {
            figures.push((format!("motion-{}", metric.slug()), figure));
        }
    }
    for metric in metrics {
        if let Some(figure) = plots::by_scene(board, metric)? {
            figures.push((format!("scenes-{}", metric.slug()), figure));
        }
    }
    if let Some(figure) = plots::histogram(board, None)? {
        figures.push(("baselines".into(), figure));
    }
    Ok(figures)
}
