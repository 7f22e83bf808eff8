//! The report as a page that opens from disk, without server or network. Tables and plots are
//! readable without scripts.
//!
//! Templates, style and scripts are in `bench/templates`. Untrusted text enters the page only through templates, which
//! escape it, or as data, which the script displays as text. A content security policy blocks everything else.

use std::path::{Component, Path, PathBuf, absolute};

use askama::Template;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};
use sharp_metrics::Direction;
use sharp_plots::Figure;
use sharp_plots::palette::style;

use crate::evaluate::Results;
use crate::evaluate::record::{Record, Score, Status};
use crate::io::text::visible_line;
use crate::pictures::keyed_scores::json_number;

use super::board::{Board, PairBoard, ReportDataset};
use super::column::Column;
use super::error_map;
use super::facts::FactGroup;
use super::gallery::{self, Gallery, GalleryPair, PictureKind, Pictures};
use super::html::{STYLE, VERSION, themed, without_tags};
use super::options::{Layout, ReportOptions};
use super::pictures::{ReportPictures, Thumbnail};
use super::tables::Table;
use super::tables::build::REPORTED;

/// Scripts of tables, of the pair cards, and of the large view, in this order.
const SCRIPT: &str = concat!(
    "(function () {\n'use strict';\n",
    include_str!("../../templates/tables.js"),
    include_str!("../../templates/pairs.js"),
    include_str!("../../templates/viewer.js"),
    "}());\n"
);
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
    /// The nouns and numbers of [`Board::counts`].
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

    /// Whether any target has pixels that are not scored.
    fn excludes_pixels(&self) -> bool {
        let mut records = self.results.records.iter();
        records.any(|r| r.crop.is_some() || r.valid_share.is_some())
    }

    /// Data of the pairs as JSON for the script.
    fn data(&self) -> String {
        json(self)
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

    /// Link to the page that `render --viewer` wrote next to the kept prediction; `None` if there is no such page.
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
        self.board.withheld().collect()
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

/// JSON from which the page's script builds the cards of the pairs in view. It is safe inside a `script` element: it
/// contains neither `<` nor control characters.
fn json(page: &Page<'_>) -> String {
    let methods = page.board.methods.iter().enumerate().map(|(at, method)| {
        json!({
            "label": visible_line(&method.label),
            "colour": style(at).ink.hex(),
            "ranked": method.unranked.is_none(),
            "against": gallery::against(page.options, page.board, at),
        })
    });
    let datasets = page.board.datasets.iter();
    let datasets = datasets.map(|d| visible_line(d.dataset.title()));
    let shared = json!({
        "datasets": datasets.collect::<Vec<_>>(),
        "methods": methods.collect::<Vec<_>>(),
        "heads": Column::heads(page.metrics),
        "keys": page.metrics.iter().map(|metric| &metric.key).collect::<Vec<_>>(),
    });
    // Serialise pair by pair, because a JSON tree of all pairs would take many times as much memory
    // as the text.
    let pairs = page.gallery.pairs.iter();
    let pairs = pairs.map(|pair| without_tags(&pair_data(page, pair)));
    let mut text = without_tags(&shared);
    // Remove the closing brace, in order to append to the object.
    text.pop();
    text += ",\"pairs\":[";
    for (at, pair) in pairs.enumerate() {
        if at > 0 {
            text.push(',');
        }
        text += &pair;
    }
    text + "]}"
}

fn pair_data(page: &Page<'_>, shown: &GalleryPair<'_>) -> Value {
    let facts = shown.pair.facts;
    let methods = shown.methods.iter().map(|shown| {
        let shown = shown.as_ref()?;
        let record = shown.record;
        let mut data = json!({
            "pictures": pictures(page, &shown.pictures),
            "full": page.full_path(record),
        });
        if let Some(viewer) = page.viewer_path(record) {
            data["viewer"] = json!(viewer);
        }
        match &record.status {
            Status::Failed { reason } => data["failed"] = json!(visible_line(reason)),
            Status::Ok => {
                let scores = page.metrics.iter().map(|metric| score(record, metric));
                data["scores"] = scores.collect();
                data["extras"] = extras(page.extras, record);
            }
        }
        Some(data)
    });
    let [source, target] = page.full_views(shown.pair);
    json!({
        "id": visible_line(&facts.pair_id),
        "dataset": shown.dataset,
        "scene": visible_line(&facts.scene),
        "views": [visible_line(&facts.source), visible_line(&facts.target)],
        "baseline": Some(facts.baseline_m).filter(|v| v.is_finite()),
        "overlap": facts.overlap.filter(|v| v.is_finite()),
        "facts": facts_of(facts),
        "losses": losses(page, facts),
        "pictures": pictures(page, &shown.views),
        "full": {"source": source, "target": target},
        "methods": methods.collect::<Vec<_>>(),
    })
}

/// Maps each kind to `[address, width, height]`, or to the reason why the picture is missing.
fn pictures(page: &Page<'_>, pictures: &Pictures) -> Value {
    let address = |picture: &Thumbnail| match page.gallery.layout {
        Layout::File => picture.address(),
        Layout::Folder => gallery::file_name(picture),
    };
    let shown = pictures.iter().map(|(kind, picture)| {
        let value = match picture {
            Ok(picture) => json!([address(picture), picture.width, picture.height]),
            Err(reason) => json!(visible_line(&reason.to_string())),
        };
        (kind.name().to_owned(), value)
    });
    Value::Object(shown.collect())
}

/// `[number, displayed text]`, or the reason why the score is missing.
fn score(record: &Record, metric: &Column) -> Value {
    match record.scores.get(&metric.key) {
        Some(Score::Value(value)) => json!([json_number(*value), metric.shown(*value)]),
        Some(Score::Unavailable { unavailable }) => json!(visible_line(unavailable)),
        None => json!("not computed in this run"),
    }
}

/// Values that a method reports about its prediction: `[label, text]`.
fn extras(columns: &[Column], record: &Record) -> Value {
    let reported = record.reported();
    let extras = columns.iter().filter_map(|column| {
        let value = *reported.get(column.key.as_str())?;
        Some(json!([column.label, column.shown(value)]))
    });
    extras.collect()
}

fn facts_of(facts: &Record) -> Vec<String> {
    let known = |value: Option<f64>| value.filter(|v| v.is_finite());
    let facts = [
        known(Some(facts.baseline_m)).map(|v| format!("baseline {v:.3} m")),
        known(Some(facts.rotation_deg)).map(|v| format!("rotation {v:.1}°")),
        known(facts.median_depth_m).map(|v| format!("median depth {v:.2} m")),
        known(facts.overlap).map(|v| format!("overlap {:.1} %", v * 100.0)),
    ];
    facts.into_iter().flatten().collect()
}

/// By how much method B is worse on a pair, for each metric; `None` if the page is not a
/// comparison.
fn losses(page: &Page<'_>, facts: &Record) -> Option<Vec<Option<f64>>> {
    let of_pair = page
        .options
        .comparison
        .as_ref()?
        .losses
        .get(&facts.pair_id)?;
    let metrics = page.metrics.iter();
    let losses = metrics.map(|metric| of_pair.get(&metric.key).copied());
    Some(losses.map(|loss| loss.filter(|v| v.is_finite())).collect())
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
