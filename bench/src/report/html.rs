//! The report as a page that opens from disk, without server or network. Tables and plots are
//! readable without scripts.
//!
//! Templates, style and scripts are in `bench/templates`. Untrusted text enters the page only through templates, which
//! escape it, or as data, which the script displays as text. A content security policy blocks everything else.

use std::path::{Component, Path, PathBuf, absolute};

use askama::Template;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use sharp_metrics::Direction;

use crate::evaluate::Results;
use crate::evaluate::record::Record;

use super::board::{Board, PairBoard, ReportDataset};
use super::column::Column;
use super::facts::FactGroup;
use super::gallery::{self, Gallery, PictureKind};
use super::options::{Layout, ReportOptions};
use super::pictures::ReportPictures;
use super::tables::Table;
use super::tables::build::REPORTED;
use super::write::withheld;
use super::{error_map, page_data};
use sharp_plots::Figure;
use sharp_plots::ink::{GRID, INK, MUTED, PAPER};
use sharp_plots::palette::style;

pub(crate) const STYLE: &str = include_str!("../../templates/style.css");
/// Scripts of tables, of the pair cards, and of the large view, in this order.
const SCRIPT: &str = concat!(
    "(function () {\n'use strict';\n",
    include_str!("../../templates/tables.js"),
    include_str!("../../templates/pairs.js"),
    include_str!("../../templates/viewer.js"),
    "}());\n"
);
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Maximum number of failed pairs listed on the page.
const FAILURES: usize = 200;

/// Contents of the page; rendered by [`Template::render`].
#[derive(Template)]
#[template(path = "report.html")]
pub struct Page<'a> {
    pub title: &'static str,
    /// Text below the title: a summary of the run.
    pub lead: String,
    pub results: &'a Results,
    pub options: &'a ReportOptions,
    pub out: &'a Path,
    /// Metrics with at least one score.
    pub metrics: &'a [Column],
    pub extras: &'a [Column],
    pub facts: &'a [FactGroup],
    /// Pluralised names and counts, as in [`Board::counts`].
    pub counts: [(&'static str, usize); 6],
    pub board: &'a Board<'a>,
    pub ours: &'a [Table],
    pub published: &'a [Table],
    /// Plots, each with its file stem.
    pub figures: &'a [(String, Figure)],
    pub gallery: &'a Gallery<'a>,
    pub pictures: &'a ReportPictures<'a>,
}

impl Page<'_> {
    fn script_sha256(&self) -> String {
        STANDARD.encode(Sha256::digest(SCRIPT))
    }

    fn error_gradient(&self) -> String {
        error_map::css_gradient()
    }

    fn change_gradient(&self) -> String {
        error_map::change_gradient()
    }

    fn table(&self, table: &Table, prefix: &str, position: &usize) -> askama::Result<String> {
        table.html(&format!("{prefix}{position}"))
    }

    fn plot(&self, figure: &Figure) -> String {
        themed(&figure.svg)
    }

    fn is_ranked(&self) -> bool {
        self.ours.iter().any(Table::is_ranked)
    }

    fn colour(&self, method: &usize) -> String {
        style(*method).ink.hex()
    }

    /// Whether some pixels of some target are not scored.
    fn excludes_pixels(&self) -> bool {
        let mut records = self.results.records.iter();
        records.any(|r| r.crop.is_some() || r.valid_share.is_some())
    }

    /// Data of the pairs as JSON for the script.
    fn data(&self) -> String {
        page_data::json(self)
    }

    fn has(&self, kind: PictureKind) -> bool {
        self.gallery.has(kind)
    }

    /// Link to the full prediction. `None` for a cropped prediction, because the page shows it at its position in the
    /// target.
    pub(super) fn full_path(&self, record: &Record) -> Option<String> {
        let kept = self.pictures.linked(record);
        self.link(&kept.filter(|_| record.crop.is_none())?)
    }

    /// Link to a page by `render --viewer` next to the kept prediction; `None` if there is none.
    pub(super) fn viewer_path(&self, record: &Record) -> Option<String> {
        let page = self.pictures.linked(record)?.with_extension("html");
        page.is_file().then(|| self.link(&page))?
    }

    /// Links to the full source and target. The target's link leads to the picture that was kept for the method
    /// `target`, or else to the dataset's photograph.
    pub(super) fn full_views(&self, pair: &PairBoard<'_>) -> [Option<String>; 2] {
        let mut records = pair.by_method.iter().zip(&self.board.methods);
        let itself = records.find(|(_, method)| method.unranked.is_some());
        let itself = itself.and_then(|(record, _)| self.full_path(record.as_ref()?));
        let [source, target] = self.pictures.linked_photographs(pair.facts);
        let target = itself.or_else(|| self.link(&target?));
        [source.and_then(|source| self.link(&source)), target]
    }

    /// Link relative to the page, with `/` as separator; `None` if page and file have no common folder.
    fn link(&self, file: &Path) -> Option<String> {
        relative(&absolute(file).ok()?, &absolute(self.out).ok()?)
    }

    /// Datasets whose pictures are left out of a public report.
    fn withheld(&self) -> Vec<&ReportDataset> {
        withheld(self.board).collect()
    }

    fn terms(&self, dataset: &ReportDataset) -> &'static str {
        dataset.entry().map_or("terms unknown", |entry| entry.terms)
    }

    /// Methods, datasets and facts of the run, without empty groups.
    pub(super) fn fact_groups(&self) -> Vec<FactGroup> {
        let methods = self.board.methods.iter();
        let methods = methods.map(|m| (m.label.clone(), m.description.clone()));
        let datasets = self.board.datasets.iter().map(|d| &d.dataset);
        let datasets = datasets.map(|d| (d.title().to_owned(), d.description.clone()));
        let mut groups = vec![
            FactGroup::new("Methods", methods.collect()),
            FactGroup::new("Datasets", datasets.collect()),
        ];
        groups.extend(self.facts.iter().cloned());
        for group in &mut groups {
            group.facts.retain(|(_, value)| !value.is_empty());
        }
        groups.retain(|group| !group.facts.is_empty());
        groups
    }
}

/// JSON that is safe inside a `script` element: without `<`.
pub(crate) fn without_tags(value: &Value) -> String {
    value.to_string().replace('<', "\\u003c")
}

/// Relative path from a folder to a file; `None` if they have no common folder except the root of the file system.
fn relative(file: &Path, folder: &Path) -> Option<String> {
    let common = file.components().zip(folder.components());
    let common = common.take_while(|(a, b)| a == b);
    let common = common.filter(|(part, _)| matches!(part, Component::Normal(_)));
    let common: PathBuf = common.map(|(part, _)| part).collect();
    if common.as_os_str().is_empty() {
        return None;
    }
    let of = |path: &Path| -> Option<Vec<String>> {
        let parts = path.components();
        let parts = parts.filter(|part| matches!(part, Component::Normal(_)));
        let parts = parts.skip(common.components().count());
        parts
            .map(|part| part.as_os_str().to_str().map(str::to_owned))
            .collect()
    };
    let up = of(folder)?.into_iter().map(|_| "..".to_owned());
    let down = of(file)?.into_iter().map(|part| encoded(&part));
    Some(up.chain(down).collect::<Vec<_>>().join("/"))
}

/// Percent-encodes a part of a URL, except characters that every browser accepts.
fn encoded(part: &str) -> String {
    let bytes = part.bytes().map(|byte| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => {
            char::from(byte).to_string()
        }
        _ => format!("%{byte:02X}"),
    });
    bytes.collect()
}

/// The SVG with the page's variables for paper, ink and grid in place of its colours, so that it follows the page's
/// theme.
pub(crate) fn themed(svg: &str) -> String {
    let mut out = svg.to_owned();
    for (ink, variable) in [
        (PAPER, "var(--card)"),
        (INK, "var(--ink)"),
        (MUTED, "var(--muted)"),
        (GRID, "var(--grid)"),
    ] {
        for attribute in ["fill", "stroke"] {
            let from = format!("{attribute}=\"{}\"", ink.hex());
            out = out.replace(&from, &format!("{attribute}=\"{variable}\""));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plots_take_the_colours_of_the_page() {
        let svg = "<rect fill=\"#FFFFFF\"/><text fill=\"#1B1F24\">#FFFFFF</text>";
        assert_eq!(
            themed(svg),
            "<rect fill=\"var(--card)\"/><text fill=\"var(--ink)\">#FFFFFF</text>"
        );
    }
}
