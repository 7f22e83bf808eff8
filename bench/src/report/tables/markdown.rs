//! Markdown of a table, as for a README: the best number is bold, the second and third are marked ② and ③, and the
//! number of pairs is below each number.

use std::fmt::Write as _;

use super::{Cell, Table, letter, letters, spans};
use crate::io::text::visible_line;
use crate::report::column::Column;

impl Table {
    /// GitHub-flavoured Markdown with footnotes below.
    pub fn markdown(&self) -> String {
        let mut out = format!("| {} |", escape(self.row_head));
        let heads = Column::heads(&self.columns);
        for group in &self.groups {
            let title = escape(&group.title) + &marks(group.note.as_slice());
            for head in &heads {
                let _ = write!(out, " {title}<br>{} |", escape(head));
            }
        }
        out.push_str("\n|:---|");
        out.push_str(&"---:|".repeat(self.groups.len() * self.columns.len()));
        out.push('\n');
        for (at, row) in self.rows.iter().enumerate() {
            if self.has_rule_before(&at) {
                let cells = " |".repeat(row.cells.len());
                let _ = writeln!(out, "| *{}:* |{cells}", row.origin.name());
            }
            let _ = write!(
                out,
                "| {}{} |",
                escape(&self.label(row)),
                marks(row.note.as_slice())
            );
            for (column, cell) in self.cells(row) {
                let _ = write!(out, " {} |", number(self.number(column, cell), cell));
            }
            out.push('\n');
        }
        let keys = self.columns.iter().zip(&heads).map(|(column, head)| {
            let key = column.key.replace('`', "'");
            format!("{}: `{key}`, {}", escape(head), column.direction_words())
        });
        let keys: Vec<String> = keys.collect();
        let _ = write!(out, "\n{}.", keys.join("; "));
        if self.is_ranked() {
            out.push_str(" **Best**, second ② and third ③ of each column, after rounding.");
        }
        if self.groups.iter().any(|g| g.pairs.is_some()) {
            out.push_str(" Small: pairs behind the number.");
        }
        out.push('\n');
        for remark in &self.remarks {
            let _ = write!(out, "\n{}\n", rich(remark));
        }
        let notes = self.notes.iter().enumerate();
        let notes: Vec<String> = notes
            .map(|(i, note)| format!("\n<sup>{}</sup> {}", letter(i), rich(note)))
            .collect();
        if !notes.is_empty() {
            out += &notes.join("\\");
            out.push('\n');
        }
        if !self.checklist.is_empty() {
            out.push_str("\nWhat a strict comparison needs:\n\n");
        }
        for check in &self.checklist {
            let mark = if check.is_met { 'x' } else { ' ' };
            let _ = writeln!(out, "- [{mark}] {}", rich(&check.text));
        }
        out
    }
}

fn number(text: String, cell: &Cell) -> String {
    let text = match cell.rank {
        Some(1) => format!("**{text}**"),
        Some(2) => text + " ②",
        Some(3) => text + " ③",
        _ => text,
    };
    let pairs = match cell.coverage {
        Some((n, total)) if n == total => format!(" <sub>{n}</sub>"),
        Some((n, total)) => format!(" <sub>{n}/{total}</sub>"),
        None => String::new(),
    };
    text + &pairs + &marks(&cell.notes)
}

fn marks(notes: &[usize]) -> String {
    letters("<sup>", notes, "</sup>")
}

/// Escapes a note, but keeps its code spans unless a lenient parser could take them for markup.
pub(in crate::report) fn rich(note: &str) -> String {
    let spans = spans(note).into_iter().map(|(code, text)| {
        if code && !text.is_empty() && text.chars().all(|c| c != '<' && !c.is_control()) {
            format!("`{text}`")
        } else {
            escape(text)
        }
    });
    spans.collect()
}

/// Escapes Markdown and HTML, column separators and `@` mentions.
pub fn escape(text: &str) -> String {
    let text = visible_line(text);
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            '\\' | '`' | '*' | '_' | '[' | ']' | '|' | '~' => out.extend(['\\', c]),
            // A zero-width space, because hosts search for mentions after removing markup.
            '@' => out.push_str("@&#8203;"),
            c => out.push(c),
        }
    }
    out
}
