//! A table for the page: sortable, with the paper's colours and a rank that can also be read.

use std::fmt::Write as _;

use super::{Cell, Table, letter, shown, spans};
use crate::report::escape::escape;
use crate::report::input::Metric;

/// A `figure` with caption, table and footnotes. `id` makes its anchors unique in the page.
pub fn html(table: &Table, id: &str) -> String {
    let mut out = format!(
        "<figure class=\"table\" id=\"{id}\"><figcaption><h3>{}</h3></figcaption>\n<div class=\"scroll\">\
         <table class=\"scores{}\">\n<thead>\n<tr><td></td>",
        escape(&table.title),
        if table.groups.len() * table.metrics.len() > 9 {
            " wide"
        } else {
            ""
        }
    );
    let per_group = table.metrics.len();
    for group in &table.groups {
        let pairs = match group.pairs {
            Some(1) => " <small>1 pair</small>".to_owned(),
            Some(n) => format!(" <small>{n} pairs</small>"),
            None => String::new(),
        };
        let _ = write!(
            out,
            "<th scope=\"colgroup\" colspan=\"{per_group}\">{}",
            escape(&group.title)
        );
        marks(&mut out, group.note.iter(), id);
        let _ = write!(out, "{pairs}</th>");
    }
    out.push_str("</tr>\n<tr><th scope=\"col\" data-sort=\"text\">Method</th>");
    for _ in &table.groups {
        for (m, (metric, head)) in table.metrics.iter().zip(table.heads()).enumerate() {
            let class = if m == 0 { " class=\"first\"" } else { "" };
            let _ = write!(
                out,
                "<th scope=\"col\" data-sort=\"number\"{class} title=\"{}\">{}<code>{}</code></th>",
                escape(&format!("{}: {}", metric.better.words(), metric.convention)),
                escape(&head),
                escape(&metric.key)
            );
        }
    }
    out.push_str("</tr>\n</thead>\n<tbody>\n");
    for row in &table.rows {
        let _ = write!(out, "<tr><th scope=\"row\">{}", escape(&row.label));
        marks(&mut out, row.note.iter(), id);
        out.push_str("</th>");
        for (i, cell) in row.cells.iter().enumerate() {
            number(&mut out, cell, table.metric_of(i), i % per_group == 0, id);
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</tbody></table></div>\n");
    if !table.notes.is_empty() {
        out.push_str("<ol class=\"notes\">\n");
        for (i, note) in table.notes.iter().enumerate() {
            let letter = letter(i);
            let _ = writeln!(
                out,
                "<li id=\"{id}-{letter}\"><sup>{letter}</sup> {}</li>",
                rich(note)
            );
        }
        out.push_str("</ol>\n");
    }
    out.push_str("</figure>\n");
    out
}

fn number(out: &mut String, cell: &Cell, metric: &Metric, first: bool, id: &str) {
    let mut classes = Vec::new();
    if first {
        classes.push("first".to_owned());
    }
    if let Some(rank) = cell.rank {
        classes.push(format!("rank{rank}"));
    }
    if cell.value.is_none() {
        classes.push("absent".to_owned());
    } else if !cell.complete() {
        classes.push("partial".to_owned());
    }
    out.push_str("<td");
    if !classes.is_empty() {
        let _ = write!(out, " class=\"{}\"", classes.join(" "));
    }
    match cell.value {
        Some(value) => {
            let _ = write!(
                out,
                " data-value=\"{value}\">{}",
                shown(value, metric.decimals)
            );
        }
        None => out.push_str(">n/a"),
    }
    if let Some(rank) = cell.rank {
        let word = match rank {
            1 => "best",
            2 => "second best",
            _ => "third best",
        };
        let _ = write!(out, "<i aria-label=\"{word}\" title=\"{word}\">{rank}</i>");
    }
    marks(out, cell.notes.iter(), id);
    match cell.coverage {
        Some((n, total)) if n == total => {
            let _ = write!(out, "<small>n = {n}</small>");
        }
        Some((n, total)) => {
            let _ = write!(out, "<small>n = {n} of {total}</small>");
        }
        None => {}
    }
    out.push_str("</td>");
}

fn marks<'a>(out: &mut String, notes: impl Iterator<Item = &'a usize>, id: &str) {
    let links: Vec<String> = notes
        .map(|i| {
            let letter = letter(*i);
            format!("<a href=\"#{id}-{letter}\">{letter}</a>")
        })
        .collect();
    if !links.is_empty() {
        let _ = write!(out, "<sup>{}</sup>", links.join(","));
    }
}

/// A note with its code set as code.
pub(in crate::report) fn rich(note: &str) -> String {
    let spans = spans(note).into_iter();
    let spans = spans.map(|(code, text)| match (code, escape(text)) {
        (true, text) => format!("<code>{text}</code>"),
        (false, text) => text,
    });
    spans.collect()
}
