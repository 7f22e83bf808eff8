//! A table for a README: best in bold, then ② and ③; n under each number.

use std::fmt::Write as _;

use super::{Cell, Table, letter, shown, spans};
use crate::report::input::Metric;

/// GitHub-flavoured Markdown, footnotes below.
pub fn markdown(table: &Table) -> String {
    let mut out = format!("| {} |", escape(table.row_head));
    let heads = table.heads();
    for group in &table.groups {
        for head in &heads {
            let _ = write!(out, " {}", escape(&group.title));
            marks(&mut out, group.note.iter());
            let _ = write!(out, "<br>{} |", escape(head));
        }
    }
    out.push_str("\n|:---|");
    out.push_str(&"---:|".repeat(table.groups.len() * table.metrics.len()));
    out.push('\n');
    for row in &table.rows {
        let _ = write!(out, "| {}", escape(&row.label));
        marks(&mut out, row.note.iter());
        out.push_str(" |");
        for (i, cell) in row.cells.iter().enumerate() {
            let _ = write!(out, " {} |", number(cell, table.metric_of(i)));
        }
        out.push('\n');
    }
    out.push('\n');
    let keys = table.metrics.iter().zip(&heads).map(|(metric, head)| {
        let key = metric.key.replace('`', "'");
        format!("{}: `{key}`, {}", escape(head), metric.better.words())
    });
    let keys: Vec<String> = keys.collect();
    let _ = write!(out, "{}.", keys.join("; "));
    if table
        .rows
        .iter()
        .flat_map(|r| &r.cells)
        .any(|c| c.rank.is_some())
    {
        out.push_str(" **Best**, second ② and third ③ of each column, after rounding.");
    }
    if table.groups.iter().any(|g| g.pairs.is_some()) {
        out.push_str(" Small: pairs behind the number.");
    }
    out.push('\n');
    for (i, note) in table.notes.iter().enumerate() {
        let _ = write!(out, "\n<sup>{}</sup> {}\\", letter(i), rich(note));
    }
    if out.ends_with('\\') {
        out.pop();
        out.push('\n');
    }
    out
}

fn number(cell: &Cell, metric: &Metric) -> String {
    let mut out = match cell.value {
        None => "n/a".to_owned(),
        Some(value) => {
            let text = shown(value, metric.decimals);
            match cell.rank {
                Some(1) => format!("**{text}**"),
                Some(2) => format!("{text} ②"),
                Some(3) => format!("{text} ③"),
                _ => text,
            }
        }
    };
    match cell.coverage {
        Some((n, total)) if n == total => {
            let _ = write!(out, " <sub>{n}</sub>");
        }
        Some((n, total)) => {
            let _ = write!(out, " <sub>{n}/{total}</sub>");
        }
        None => {}
    }
    marks(&mut out, cell.notes.iter());
    out
}

fn marks<'a>(out: &mut String, notes: impl Iterator<Item = &'a usize>) {
    let letters: Vec<String> = notes.map(|i| letter(*i)).collect();
    if !letters.is_empty() {
        let _ = write!(out, "<sup>{}</sup>", letters.join(","));
    }
}

/// A note with its code set as code, unless that could be read as markup by a lenient reader.
pub(in crate::report) fn rich(note: &str) -> String {
    let spans = spans(note).into_iter();
    let spans = spans.map(|(code, text)| {
        if code && !text.is_empty() && text.chars().all(|c| c != '<' && !c.is_control()) {
            format!("`{text}`")
        } else {
            escape(text)
        }
    });
    spans.collect()
}

/// Text that stays text: no markup, no new column, no HTML.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            '\\' | '`' | '*' | '_' | '[' | ']' | '|' | '~' => {
                out.push('\\');
                out.push(c);
            }
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}
