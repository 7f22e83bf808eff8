//! LaTeX of a table for a paper: booktabs, with the coloured cells of the SHARP paper.

use std::fmt::Write as _;

use super::grid::TextGrid;
use super::{Cell, Table, letter, letters, spans};
use crate::io::text::visible_line;
use crate::report::column::Column;

/// Preamble, with the paper's colours, that documents with these tables need.
pub const PREAMBLE: &str = "\
\\usepackage{booktabs,graphicx,amssymb}
\\usepackage[table]{xcolor}
\\definecolor{tab_first}{RGB}{119, 221, 119}
\\definecolor{tab_second}{RGB}{223, 255, 0}
\\definecolor{tab_third}{RGB}{255, 253, 208}
";

impl Table {
    /// A complete `table` environment, preceded by the required preamble as a comment.
    pub fn latex(&self) -> String {
        let mut body = String::new();
        let ranks = if self.is_ranked() {
            " \\colorbox{tab_first}{Best}, \\colorbox{tab_second}{second-best}, and \
             \\colorbox{tab_third}{third-best} in each column are highlighted; ranks are taken after rounding."
        } else {
            ""
        };
        let per_group = self.columns.len();
        let columns = vec!["c".repeat(per_group); self.groups.len()].join("|");
        for (g, group) in self.groups.iter().enumerate() {
            let rule = if g + 1 < self.groups.len() { "c|" } else { "c" };
            let pairs = group
                .pairs
                .map(|n| format!(" ($n={n}$)"))
                .unwrap_or_default();
            let _ = write!(
                body,
                " & \\multicolumn{{{per_group}}}{{{rule}}}{{{}{}{pairs}}}",
                escape(&group.title),
                marks(group.note.as_slice())
            );
        }
        body.push_str(" \\\\\n");
        let heads = Column::heads(&self.columns);
        for _ in &self.groups {
            for head in &heads {
                let _ = write!(body, " & {}", escape(head).replace(" $", "$"));
            }
        }
        body.push_str(" \\\\\n\\midrule\n");
        for (at, row) in self.rows.iter().enumerate() {
            if self.has_rule_before(&at) {
                body.push_str("\\midrule\n");
            }
            body.push_str(&escape(&self.label(row)));
            body.push_str(&marks(row.note.as_slice()));
            for (column, cell) in self.cells(row) {
                let _ = write!(body, " & {}", number(&self.number(column, cell), cell));
            }
            body.push_str(" \\\\\n");
        }
        let names = Column::names(&self.columns);
        let keys =
            self.columns.iter().zip(names).map(|(column, name)| {
                format!("{}: \\texttt{{{}}}", escape(name), escape(&column.key))
            });
        let keys: Vec<String> = keys.collect();
        let mut below = format!("{}.\n", keys.join("; "));
        for remark in &self.remarks {
            let _ = writeln!(below, "\\par {}", rich(remark));
        }
        for (i, note) in self.notes.iter().enumerate() {
            let _ = writeln!(
                below,
                "\\par\\textsuperscript{{{}}}~{}",
                letter(i),
                rich(note)
            );
        }
        if !self.checklist.is_empty() {
            below.push_str("\\par What a strict comparison needs:\n");
        }
        for check in &self.checklist {
            let mark = if check.is_met {
                "\\boxtimes"
            } else {
                "\\square"
            };
            let _ = writeln!(below, "\\par ${mark}$~{}", rich(&check.text));
        }
        let environment = Environment {
            caption: &format!("{}.{ranks}", escape(&self.title)),
            label: Some(&self.name),
            columns: &format!("l{columns}"),
            // Wide tables are shrunk to the line width, as in the paper.
            is_wide: self.groups.len() * per_group > 6,
        };
        let preamble = PREAMBLE.lines().map(|line| format!("% {line}\n"));
        noted(preamble.collect::<String>() + &environment.around(&body, &below))
    }
}

/// A `table` environment with booktabs; its texts are LaTeX.
pub(in crate::report) struct Environment<'a> {
    pub(in crate::report) caption: &'a str,
    /// Label without `tab:`.
    pub(in crate::report) label: Option<&'a str>,
    pub(in crate::report) columns: &'a str,
    /// Whether the table is shrunk to the line width.
    pub(in crate::report) is_wide: bool,
}

impl Environment<'_> {
    /// The environment around the rows `body`, with rules, and with the small print `below` under the table.
    pub(in crate::report) fn around(&self, body: &str, below: &str) -> String {
        let label = self.label.map(|label| format!("\\label{{tab:{label}}}\n"));
        let (open, close) = if self.is_wide {
            ("\\resizebox{\\linewidth}{!}{%\n", "%\n}\n")
        } else {
            ("", "\n")
        };
        format!(
            "\\begin{{table}}[!htbp]\n\\centering\n\\caption{{{}}}\n{}{open}\\begin{{tabular}}{{{}}}\n\\toprule\n\
             {body}\\bottomrule\n\\end{{tabular}}{close}\n\\smallskip\\raggedright\\footnotesize\n{below}\\end{{table}}\n",
            self.caption,
            label.unwrap_or_default(),
            self.columns
        )
    }
}

/// A table of any shape, as a `table` environment of full line width.
pub fn grid(grid: &TextGrid) -> String {
    let columns: Vec<&str> = (0..grid.heads.len())
        .map(|column| if grid.is_text(&column) { "l" } else { "r" })
        .collect();
    let line = |cells: Vec<&str>| {
        let cells: Vec<String> = cells.into_iter().map(escape).collect();
        format!("{} \\\\\n", cells.join(" & "))
    };
    let mut body = line(grid.heads.iter().map(String::as_str).collect()) + "\\midrule\n";
    for row in &grid.rows {
        body += &line(row.iter().map(|cell| cell.text.as_str()).collect());
    }
    let remarks = grid.remarks.iter();
    let remarks = remarks.map(|remark| format!("\\par {}\n", rich(remark)));
    let environment = Environment {
        caption: &format!("{}.", escape(&grid.title)),
        label: None,
        columns: &columns.concat(),
        is_wide: true,
    };
    noted(environment.around(&body, &remarks.collect::<String>()))
}

fn number(number: &str, cell: &Cell) -> String {
    let colour = match cell.rank {
        Some(1) => "\\cellcolor{tab_first} ",
        Some(2) => "\\cellcolor{tab_second} ",
        Some(3) => "\\cellcolor{tab_third} ",
        _ => "",
    };
    let pairs = cell.partial().map_or_else(String::new, |(n, total)| {
        format!("\\,{{\\scriptsize({n}/{total})}}")
    });
    let number = escape(number).replace(" $\\pm$ ", "\\,$\\pm$\\,");
    format!("{colour}{number}{pairs}{}", marks(&cell.notes))
}

fn marks(notes: &[usize]) -> String {
    letters("\\textsuperscript{", notes, "}")
}

/// Escapes a note for LaTeX, with its code spans as code.
fn rich(note: &str) -> String {
    let spans = spans(note).into_iter();
    let spans = spans.map(|(code, text)| match (code, escape(text)) {
        (true, text) => format!("\\texttt{{{text}}}"),
        (false, text) => text,
    });
    spans.collect()
}

/// Escapes text for LaTeX, in OT1 and T1. A character without a glyph in pdflatex is replaced by its code point; see
/// [`noted`].
pub fn escape(text: &str) -> String {
    let text = visible_line(text);
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            // At the start of a row, LaTeX would take these as arguments of the preceding `\\`.
            '[' | '*' if out.trim_ascii().is_empty() => out.extend(['{', c, '}']),
            '\\' => out.push_str("\\textbackslash{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '^' => out.push_str("\\textasciicircum{}"),
            '<' => out.push_str("\\textless{}"),
            '>' => out.push_str("\\textgreater{}"),
            '|' => out.push_str("\\textbar{}"),
            '"' => out.push_str("\\char34{}"),
            '`' => out.push_str("\\`{}"),
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => out.extend(['\\', c]),
            '∞' => out.push_str("$\\infty$"),
            '−' => out.push_str("$-$"),
            '×' => out.push_str("$\\times$"),
            '±' => out.push_str("$\\pm$"),
            '→' => out.push_str("$\\rightarrow$"),
            '↑' => out.push_str("$\\uparrow$"),
            '↓' => out.push_str("$\\downarrow$"),
            '≥' => out.push_str("$\\geq$"),
            '≤' => out.push_str("$\\leq$"),
            '…' => out.push_str("\\ldots{}"),
            'α' => out.push_str("$\\alpha$"),
            'σ' => out.push_str("$\\sigma$"),
            'μ' | 'µ' => out.push_str("$\\mu$"),
            '†' => out.push_str("$^\\dagger$"),
            '–' => out.push_str("--"),
            '—' => out.push_str("---"),
            '‘' => out.push('`'),
            '’' => out.push('\''),
            '“' => out.push_str("``"),
            '”' => out.push_str("''"),
            '·' => out.push_str("$\\cdot$"),
            '²' => out.push_str("$^2$"),
            '÷' => out.push_str("$\\div$"),
            '°' => out.push_str("$^\\circ$"),
            c if c.is_ascii() || is_composed(c) => out.push(c),
            c => {
                let _ = write!(out, "{STAND_IN}{:04X}]}}", u32::from(c));
            }
        }
    }
    out
}

/// Start of the text that replaces a character by its code point.
const STAND_IN: &str = "{[U+";

/// Adds a comment that explains `[U+…]` if the fragment contains such replacements.
pub fn noted(fragment: String) -> String {
    if fragment.contains(STAND_IN) {
        format!(
            "% [U+...] stands for the character of that number in Unicode, for which pdflatex has no glyph\n{fragment}"
        )
    } else {
        fragment
    }
}

/// Whether the encoding OT1 has the letter, or can compose it from an ASCII letter and an accent.
fn is_composed(c: char) -> bool {
    ('À'..='ž').contains(&c) && !"ÐÞðþĄąĐđĘęĦħĮįĸĿŀŉŊŋŦŧŲų".contains(c)
}
