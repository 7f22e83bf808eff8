//! The report as Markdown: tables, links to plots, and facts on how the numbers were computed.

use std::fmt::Write as _;

use super::page::Page;
use super::tables::Table;
use super::tables::markdown::escape;
use crate::io::counts::counted;

/// The page's contents as GitHub-flavoured Markdown, without the pairs. Shows `tables` instead of the page's own;
/// `plots` are titles and paths of PNGs. Paths are relative to the report, with `/` as separator.
pub fn report(page: &Page<'_>, tables: &[Table], plots: &[(String, String)]) -> String {
    let counts = page.counts.map(|(noun, n)| counted(n, noun)).join(", ");
    let mut out = format!(
        "# {}\n\n{counts}. {}\n\n",
        escape(page.title),
        escape(&page.lead)
    );
    if let Some(comparison) = &page.options.comparison {
        let _ = write!(out, "{}\n\n", escape(&comparison.lead));
        for grid in comparison.grids.iter().chain(&comparison.details) {
            let _ = write!(out, "## {}\n\n{}\n", escape(&grid.title), grid.markdown());
        }
    }
    for table in tables {
        let _ = write!(out, "## {}\n\n{}\n", escape(&table.title), table.markdown());
    }
    let failures = page.board.failures();
    if !failures.is_empty() {
        let _ = write!(out, "## Failures ({})\n\n", failures.len());
        for (record, reason) in failures.iter().take(20) {
            let _ = writeln!(
                out,
                "- {}, {}: {}",
                escape(&record.pair_id),
                escape(&record.method),
                escape(reason)
            );
        }
        if failures.len() > 20 {
            let _ = writeln!(out, "- and {} more, in the records", failures.len() - 20);
        }
        out.push('\n');
    }
    if !page.published.is_empty() {
        out.push_str("## Published numbers\n\n");
        for table in page.published {
            let _ = write!(
                out,
                "### {}\n\n{}\n",
                escape(&table.title),
                table.markdown()
            );
        }
    }
    if !plots.is_empty() {
        out.push_str("## Plots\n\n");
        for (title, png) in plots {
            let _ = write!(out, "![{}]({png})\n\n", escape(title));
        }
    }
    out.push_str("## How the numbers came about\n\n");
    for column in page.metrics.iter().chain(page.extras) {
        let mut unit = column.unit.clone();
        if !unit.is_empty() {
            unit.insert_str(0, ", ");
        }
        let _ = writeln!(
            out,
            "- `{}` ({}{unit}): {}",
            column.key.replace('`', "'"),
            column.direction_words(),
            escape(&column.convention)
        );
    }
    for group in page.fact_groups() {
        let _ = write!(
            out,
            "\n### {}\n\n| | |\n|:---|:---|\n",
            escape(&group.title)
        );
        for (name, value) in &group.facts {
            let _ = writeln!(out, "| {} | {} |", escape(name), escape(value));
        }
    }
    out
}
