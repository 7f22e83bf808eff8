//! The report as one page that opens from disk: no server, no network, readable without scripts.
//!
//! The templates, the style and the script lie in `bench/templates`. Text from outside reaches the page only through
//! templates, which escape it, and no such text is ever part of the script; a content security policy forbids anything
//! else.

use std::path::{Path, absolute};

use askama::Template;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest as _, Sha256};
use sharp_metrics::Direction;

use crate::evaluate::record::{Record, Score, Status};

use super::board::{Board, PairBoard};
use super::error_map;
use super::gallery::{self, Gallery};
use super::input::{Column, FactGroup, ReportInput};
use super::plots::Figure;
use super::plots::canvas::{GRID, INK, MUTED, PAPER};
use super::plots::palette::style;
use super::tables::{Table, html::html};

pub(crate) const STYLE: &str = include_str!("../../templates/style.css");
const SCRIPT: &str = include_str!("../../templates/script.js");
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Failures listed in the page at most.
const FAILURES: usize = 200;

/// What the page shows; rendered by [`Template::render`].
#[derive(Template)]
#[template(path = "report.html")]
pub struct Page<'a> {
    pub input: &'a ReportInput<'a>,
    /// Folder of the report.
    pub out: &'a Path,
    /// Those of the input that are shown.
    pub metrics: &'a [Column],
    /// Nouns with their numbers.
    pub counts: [(&'static str, usize); 6],
    /// The counts and the input's summary.
    pub lead: &'a str,
    pub board: &'a Board<'a>,
    /// Tables of this run.
    pub ours: &'a [Table],
    /// Tables of the paper.
    pub published: &'a [Table],
    /// Plots by file stem.
    pub figures: &'a [(String, Figure)],
    pub gallery: &'a Gallery<'a>,
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

    /// Position of the method that a method stands against.
    fn against(&self, method: &usize) -> Option<usize> {
        gallery::against(self.input, self.board, *method)
    }

    /// By how much B is worse on a pair, with the metric's position.
    fn losses(&self, facts: &Record) -> Vec<(usize, f64)> {
        let comparison = self.input.comparison.as_ref();
        let of_pair = comparison.and_then(|comparison| comparison.losses.get(&facts.pair_id));
        let loss = |metric: &Column| of_pair?.get(&metric.key).copied();
        let metrics = self.metrics.iter().enumerate();
        metrics
            .filter_map(|(at, metric)| Some((at, loss(metric)?)))
            .collect()
    }

    fn table(&self, table: &Table, prefix: &str, position: &usize) -> askama::Result<String> {
        html(table, &format!("{prefix}{position}"))
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

    fn shown(&self, column: &Column, value: &f64) -> String {
        column.shown(*value)
    }

    fn heads(&self) -> Vec<String> {
        Column::heads(self.metrics)
    }

    /// Whether some pixels of a target count in no score.
    fn excludes_pixels(&self) -> bool {
        let mut records = self.input.records.iter();
        records.any(|r| r.crop.is_some() || r.valid_share.is_some())
    }

    /// Where the full prediction lies: [`Self::full_path`], or nothing.
    fn full(&self, record: &Record) -> String {
        self.full_path(record).unwrap_or_default()
    }

    /// Relative to the page, with `/`, if the run lies beside the report's folder or around it. A crop is not linked: the
    /// page shows it in its place.
    fn full_path(&self, record: &Record) -> Option<String> {
        let kept = self.input.pictures.kept(record);
        let path = absolute(kept.filter(|_| record.crop.is_none())?).ok()?;
        let out = absolute(self.out).ok()?;
        let inside = path.strip_prefix(out.parent()?).ok()?;
        let parts: Option<Vec<&str>> = inside.iter().map(|part| part.to_str()).collect();
        Some(format!("../{}", parts?.join("/")))
    }

    /// Where the full target lies: the self-test, which is not ranked, keeps it as its prediction.
    fn full_target(&self, pair: &PairBoard<'_>) -> String {
        let mut records = pair.by_method.iter().zip(&self.board.methods);
        let itself = records.find(|(_, method)| method.unranked.is_some());
        let record = itself.and_then(|(record, _)| *record);
        record.map_or_else(String::new, |record| self.full(record))
    }

    fn pair_facts(&self, facts: &Record) -> Vec<String> {
        let known = |value: Option<f64>| value.filter(|v| v.is_finite());
        let facts = [
            known(Some(facts.baseline_m)).map(|v| format!("baseline {v:.3} m")),
            known(Some(facts.rotation_deg)).map(|v| format!("rotation {v:.1}°")),
            known(facts.median_depth_m).map(|v| format!("median depth {v:.2} m")),
            known(facts.overlap).map(|v| format!("overlap {:.1} %", v * 100.0)),
        ];
        facts.into_iter().flatten().collect()
    }

    /// What a method reports about its prediction.
    fn extras(&self, record: &Record) -> Vec<(&Column, f64)> {
        let reported = record.reported();
        let extras = self.input.extras.iter();
        let extras = extras.filter_map(|e| Some((e, *reported.get(e.key.as_str())?)));
        extras.collect()
    }

    /// Methods, datasets and the facts of the run, as far as there is something to say.
    pub(super) fn fact_groups(&self) -> Vec<FactGroup> {
        let methods = self.board.methods.iter();
        let methods = methods.map(|m| (m.label.clone(), m.description.clone()));
        let datasets = self.board.datasets.iter().map(|d| &d.dataset);
        let datasets = datasets.map(|d| (d.title().to_owned(), d.description.clone()));
        let group = |title: &str, facts| FactGroup {
            title: title.to_owned(),
            facts,
        };
        let mut groups = vec![
            group("Methods", methods.collect()),
            group("Datasets", datasets.collect()),
        ];
        groups.extend(self.input.facts.iter().cloned());
        for group in &mut groups {
            group.facts.retain(|(_, value)| !value.is_empty());
        }
        groups.retain(|group| !group.facts.is_empty());
        groups
    }
}

/// The same drawing with the page's own colours for paper, ink and grid, so that it is readable in the dark.
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
