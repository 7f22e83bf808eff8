//! Writes a table of the paper in every format.

use std::path::{Path, PathBuf};

use askama::Template;

use crate::io::atomic_files::write_all_over_own;
use crate::io::text::visible;
use crate::report::ReportError;
use crate::report::html::STYLE;
use crate::report::tables::csv::csv_of;
use crate::report::tables::{Table, latex};

use super::grid::numbers;
use super::published::PublishedTable;

#[derive(Template)]
#[template(path = "paper.html")]
struct TablePage<'a> {
    title: &'a str,
    label: &'a str,
    /// HTML of the table, which its own template has already escaped.
    table: String,
}

/// Marks files written by this program; other files are not overwritten.
const MARK: &str = "sharp-bench table";

/// Writes `NAME.md`, `NAME.csv`, `NAME.tex` (to be put into a paper), `NAME-document.tex` (compiles by itself) and
/// `NAME.html`.
///
/// # Errors
/// If a file cannot be written, or exists and was not written by this program.
pub fn write_table(
    paper: &PublishedTable,
    table: &Table,
    out: &Path,
) -> Result<Vec<PathBuf>, ReportError> {
    let page = TablePage {
        title: &table.title,
        label: paper.label,
        table: table.html(paper.name)?,
    };
    let document = format!(
        "% {MARK}\n\\documentclass{{article}}\n\\usepackage[a4paper,landscape,margin=15mm]{{geometry}}\n\
         \\usepackage[utf8]{{inputenc}}\n\\usepackage[T1]{{fontenc}}\n{}\\begin{{document}}\n\\thispagestyle{{empty}}\n\
         \\input{{{}.tex}}\n\\end{{document}}\n",
        latex::PREAMBLE,
        paper.name
    );
    let numbers = csv_of(numbers(paper, table))?;
    let numbers = String::from_utf8_lossy(&numbers).into_owned();
    let files = [
        (
            ".md",
            format!(
                "<!-- {MARK} -->\n\n# {}\n\n{}",
                table.title,
                table.markdown()
            ),
        ),
        (".csv", numbers),
        (".tex", format!("% {MARK}\n{}", table.latex())),
        ("-document.tex", document),
        (".html", page.render()?),
    ];
    let files = files.map(|(suffix, text)| {
        let path = out.join(format!("{}{suffix}", paper.name));
        let mark = if suffix == ".csv" {
            "row,origin,dataset"
        } else {
            MARK
        };
        (path, visible(&text).into_owned(), mark)
    });
    Ok(write_all_over_own(&files)?)
}
