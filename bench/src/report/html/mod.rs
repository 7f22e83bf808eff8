//! The report as one page that opens from disk: no server, no network, readable without scripts.
//!
//! * [`cards`]: the pairs with their pictures; [`provenance`]: how the numbers came about.
//! * `style.css`, `script.js`: written into the page.
//!
//! Text from outside reaches the page only through [`escape()`], and no such text is ever part of the script; a
//! content security policy forbids anything else.

pub mod cards;
pub mod provenance;

use std::fmt::Write as _;

use sha2::{Digest as _, Sha256};

use super::error_map;
use super::escape::escape;
use super::gallery::Gallery;
use super::input::ReportInput;
use super::pictures::base64;
use super::plots::Figure;
use super::plots::canvas::{GRID, INK, MUTED, PAPER};
use super::records::Board;
use super::tables::Table;
use super::tables::html::html as table_html;

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("script.js");

/// What the page shows.
pub struct Page<'a> {
    /// Title, facts, options.
    pub input: &'a ReportInput<'a>,
    /// The run.
    pub board: &'a Board<'a>,
    /// Tables of this run.
    pub ours: &'a [Table],
    /// Tables of the paper.
    pub published: &'a [Table],
    /// Plots by file stem.
    pub figures: &'a [(String, Figure)],
    /// Pictures.
    pub gallery: &'a Gallery<'a>,
}

/// The whole document.
pub fn page(page: &Page<'_>) -> String {
    let title = escape(&page.input.title);
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; \
         style-src 'unsafe-inline'; script-src 'sha256-{}'\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n\
         <style>\n{STYLE}.errorbar{{background:{}}}\n</style>\n</head>\n<body>\n\
         <a class=\"skip\" href=\"#results\">Skip to the results</a>\n",
        base64(&Sha256::digest(SCRIPT)),
        error_map::css_gradient()
    );
    header(&mut out, page, &title);
    out.push_str("<main>\n");
    results(&mut out, page);
    plots(&mut out, page.figures);
    cards::section(&mut out, page);
    provenance::section(&mut out, page);
    out.push_str("</main>\n");
    let _ = write!(
        out,
        "<footer><p>Made by sharp-bench {}. This page is one file and loads nothing.</p></footer>\n\
         <script>{SCRIPT}</script>\n</body>\n</html>\n",
        env!("CARGO_PKG_VERSION")
    );
    out
}

fn header(out: &mut String, page: &Page<'_>, title: &str) {
    let pairs: usize = page.board.datasets.iter().map(|d| d.total()).sum();
    let failures = page.board.failures().len();
    let _ = write!(
        out,
        "<header class=\"top\">\n<div class=\"title\"><p class=\"eyebrow\">sharp-bench report</p>\
         <h1>{title}</h1><p class=\"lead\">{}</p></div>\n<dl class=\"tiles\">\n",
        escape(&page.input.summary)
    );
    let tile = |out: &mut String, n: usize, one: &str, many: &str, class: &str| {
        let word = if n == 1 { one } else { many };
        let _ = writeln!(out, "<div{class}><dt>{word}</dt><dd>{n}</dd></div>");
    };
    tile(out, page.board.datasets.len(), "dataset", "datasets", "");
    tile(out, pairs, "pair", "pairs", "");
    tile(out, page.board.methods.len(), "method", "methods", "");
    tile(out, page.input.metrics.len(), "metric", "metrics", "");
    let class = if failures > 0 { " class=\"bad\"" } else { "" };
    tile(out, failures, "failure", "failures", class);
    out.push_str(
        "</dl>\n</header>\n<nav aria-label=\"Sections\"><a href=\"#results\">Results</a><a href=\"#plots\">Plots</a>\
         <a href=\"#pairs\">Pairs</a><a href=\"#provenance\">Provenance</a>\
         <button type=\"button\" id=\"theme\" class=\"js\">Light / dark</button></nav>\n",
    );
}

fn results(out: &mut String, page: &Page<'_>) {
    out.push_str("<section id=\"results\">\n<h2>Results</h2>\n");
    if page
        .ours
        .iter()
        .flat_map(|t| &t.rows)
        .flat_map(|r| &r.cells)
        .any(|c| c.rank.is_some())
    {
        out.push_str(
            "<p class=\"key\">Means over the pairs of each dataset. <span class=\"rank1\">best</span> \
             <span class=\"rank2\">second</span> <span class=\"rank3\">third</span> of each column, after rounding to \
             the digits shown; equal numbers share a rank. <span class=\"js\">Click a heading to sort.</span></p>\n",
        );
    }
    for (i, table) in page.ours.iter().enumerate() {
        out.push_str(&table_html(table, &format!("t{i}")));
    }
    if !page.published.is_empty() {
        out.push_str(
            "<details class=\"published\"><summary>Published numbers of the paper, for orientation</summary>\n",
        );
        for (i, table) in page.published.iter().enumerate() {
            out.push_str(&table_html(table, &format!("p{i}")));
        }
        out.push_str("</details>\n");
    }
    out.push_str("</section>\n");
}

fn plots(out: &mut String, figures: &[(String, Figure)]) {
    out.push_str("<section id=\"plots\">\n<h2>Plots</h2>\n");
    if figures.is_empty() {
        out.push_str("<p class=\"empty\">No metric has a number, and no pair a baseline: nothing to plot.</p>\n");
    }
    for (stem, figure) in figures {
        let _ = writeln!(
            out,
            "<figure class=\"plot\" id=\"plot-{stem}\"><figcaption><h3>{}</h3></figcaption>\
             <div class=\"scroll\">{}</div></figure>",
            escape(&figure.title),
            themed(&figure.svg)
        );
    }
    out.push_str("</section>\n");
}

/// The same drawing with the page's own colours for paper, ink and grid, so that it is readable in the dark.
fn themed(svg: &str) -> String {
    let mut out = svg.to_owned();
    for (ink, variable) in [
        (PAPER, "var(--card)"),
        (INK, "var(--ink)"),
        (MUTED, "var(--muted)"),
        (GRID, "var(--grid)"),
    ] {
        let hex = ink.hex();
        for attribute in ["fill", "stroke"] {
            out = out.replace(
                &format!("{attribute}=\"{hex}\""),
                &format!("{attribute}=\"{variable}\""),
            );
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_escapes() {
        assert_eq!(
            escape("<script>alert(\"1\")</script>&'\u{7}"),
            "&lt;script&gt;alert(&quot;1&quot;)&lt;/script&gt;&amp;&#39;\u{FFFD}"
        );
    }

    #[test]
    fn plots_take_the_colours_of_the_page() {
        let svg = "<rect fill=\"#FFFFFF\"/><text fill=\"#1B1F24\">#FFFFFF</text>";
        assert_eq!(
            themed(svg),
            "<rect fill=\"var(--card)\"/><text fill=\"var(--ink)\">#FFFFFF</text>"
        );
    }
}
