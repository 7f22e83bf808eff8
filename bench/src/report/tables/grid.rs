//! Tables of text and numbers in shapes other than methods by datasets.

use std::fmt::Write as _;

use super::markdown::{escape, rich};
use super::shown;
use crate::io::text::visible_line;

/// A table of any shape.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TextGrid {
    /// Caption.
    pub title: String,
    pub heads: Vec<String>,
    /// Rows, each as long as [`Self::heads`].
    pub rows: Vec<Vec<GridCell>>,
    /// Sentences below the table.
    pub remarks: Vec<String>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct GridCell {
    pub text: String,
    /// Number that a page sorts the cell by; `None` for words.
    pub value: Option<f64>,
}

impl GridCell {
    pub fn words(text: impl Into<String>) -> Self {
        Self {
            text: visible_line(&text.into()).into_owned(),
            value: None,
        }
    }

    pub fn number(text: impl Into<String>, value: f64) -> Self {
        Self {
            text: text.into(),
            value: Some(value),
        }
    }

    pub fn count(n: usize) -> Self {
        Self::number(n.to_string(), n as f64)
    }

    /// A number with `decimals` decimals.
    pub fn rounded(value: f64, decimals: usize) -> Self {
        Self::number(shown(value, decimals), value)
    }

    /// A number, or `-` for `None`; `-` is sorted last.
    pub fn optional(value: Option<f64>, text: impl Fn(f64) -> String) -> Self {
        match value {
            Some(value) => Self::number(text(value), value),
            None => Self::number("-", f64::NAN),
        }
    }

    /// Text `low .. high`; an unknown end is `-`.
    pub fn interval(low: Option<f64>, high: Option<f64>, decimals: usize) -> Self {
        if low.is_none() && high.is_none() {
            return Self::optional(None, |_| String::new());
        }
        let [from, to] = [low, high].map(|end| match end {
            Some(end) => shown(end, decimals),
            None => "-".to_owned(),
        });
        Self::number(format!("{from} .. {to}"), low.unwrap_or(f64::NEG_INFINITY))
    }
}

impl TextGrid {
    /// A table without remarks.
    pub fn new(
        title: impl Into<String>,
        heads: &[&str],
        rows: impl IntoIterator<Item = Vec<GridCell>>,
    ) -> Self {
        Self {
            title: title.into(),
            heads: heads.iter().map(|head| (*head).to_owned()).collect(),
            rows: rows.into_iter().collect(),
            remarks: Vec::new(),
        }
    }

    #[must_use]
    pub fn remarked(self, remarks: impl IntoIterator<Item = String>) -> Self {
        Self {
            remarks: remarks.into_iter().collect(),
            ..self
        }
    }

    /// Whether a column has words, which are left-aligned.
    pub(crate) fn is_text(&self, column: &usize) -> bool {
        self.rows.iter().all(|row| row[*column].value.is_none())
    }

    /// Plain text for a terminal.
    pub fn text(&self) -> String {
        let columns = 0..self.heads.len();
        let width = |column: usize| {
            let cells = self.rows.iter().map(|row| row[column].text.as_str());
            let cells = cells.chain([self.heads[column].as_str()]);
            cells.map(|text| text.chars().count()).max().unwrap_or(0)
        };
        let shape: Vec<(usize, bool)> = columns.map(|c| (width(c), self.is_text(&c))).collect();
        let line = |cells: Vec<&str>| {
            let padded = cells.iter().zip(&shape).map(|(cell, (width, is_text))| {
                if *is_text {
                    format!("{cell:<width$}")
                } else {
                    format!("{cell:>width$}")
                }
            });
            format!("  {}", padded.collect::<Vec<_>>().join("  ").trim_end())
        };
        let mut lines = vec![self.title.clone()];
        lines.push(line(self.heads.iter().map(String::as_str).collect()));
        let rows = self.rows.iter();
        lines.extend(rows.map(|row| line(row.iter().map(|cell| cell.text.as_str()).collect())));
        lines.extend(self.remarks.iter().map(|remark| format!("  {remark}")));
        lines.join("\n") + "\n"
    }

    /// GitHub-flavoured Markdown, without the title.
    pub fn markdown(&self) -> String {
        let mut out = String::new();
        let heads: Vec<String> = self.heads.iter().map(|head| escape(head)).collect();
        let _ = writeln!(out, "| {} |", heads.join(" | "));
        for column in 0..self.heads.len() {
            out.push_str(if self.is_text(&column) {
                "|:---"
            } else {
                "|---:"
            });
        }
        out.push_str("|\n");
        for row in &self.rows {
            let cells: Vec<String> = row.iter().map(|cell| escape(&cell.text)).collect();
            let _ = writeln!(out, "| {} |", cells.join(" | "));
        }
        for remark in &self.remarks {
            let _ = write!(out, "\n{}\n", rich(remark));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_right_and_words_left() {
        let row = |name: &str, value: f64| {
            vec![
                GridCell::words(name),
                GridCell::number(value.to_string(), value),
            ]
        };
        let grid = TextGrid {
            title: "T".into(),
            heads: vec!["name".into(), "n".into()],
            rows: vec![row("a|b", 10.0), row("long name", 2.5)],
            remarks: vec!["Said.".into()],
        };
        assert_eq!(
            grid.text(),
            "T\n  name         n\n  a|b         10\n  long name  2.5\n  Said.\n"
        );
        let expected = "| name | n |\n|:---|---:|\n| a\\|b | 10 |\n| long name | 2.5 |\n\nSaid.\n";
        assert_eq!(grid.markdown(), expected);
    }
}
