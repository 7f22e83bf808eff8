//! A table for a terminal: aligned columns, `*` for the best.

use super::{Cell, Table, letter, shown};
use crate::report::input::Metric;

/// Lines without trailing blanks, footnotes below. Width counts characters, which is exact for the arrows
/// and the infinity sign.
pub fn text(table: &Table) -> String {
    let mut grid: Vec<Vec<String>> = vec![vec![String::new()], vec![table.row_head.into()]];
    let heads = table.heads();
    for group in &table.groups {
        for (m, head) in heads.iter().enumerate() {
            grid[0].push(if m > 0 {
                String::new()
            } else {
                let title = format!("{}{}", group.title, marks(group.note.iter()));
                match group.pairs {
                    Some(n) => format!("{title} (n={n})"),
                    None => title,
                }
            });
            grid[1].push(format!("{head} "));
        }
    }
    for row in &table.rows {
        let mut line = vec![format!("{}{}", row.label, marks(row.note.iter()))];
        line.extend(
            row.cells
                .iter()
                .enumerate()
                .map(|(i, cell)| number(cell, table.metric_of(i))),
        );
        grid.push(line);
    }
    let per_group = table.metrics.len().max(1);
    let mut widths = vec![0; grid[1].len()];
    for line in &grid[1..] {
        for (width, cell) in widths.iter_mut().zip(line) {
            *width = (*width).max(length(cell));
        }
    }
    // A long dataset name widens the last column of its group.
    for g in 0..table.groups.len() {
        let columns = 1 + g * per_group..1 + (g + 1) * per_group;
        let width: usize = widths[columns.clone()].iter().map(|w| w + 2).sum();
        let title = length(&grid[0][columns.start]) + 2;
        widths[columns.end - 1] += title.saturating_sub(width);
    }
    let mut out = String::new();
    let mut heads = " ".repeat(widths[0]);
    for g in 0..table.groups.len() {
        let columns = 1 + g * per_group..1 + (g + 1) * per_group;
        let width: usize = widths[columns.clone()].iter().map(|w| w + 2).sum();
        let title = &grid[0][columns.start];
        heads.push_str("  ");
        heads.push_str(title);
        heads.push_str(&" ".repeat((width - 2).saturating_sub(length(title))));
    }
    out.push_str(heads.trim_end());
    out.push('\n');
    for line in &grid[1..] {
        let mut text = pad(&line[0], widths[0], false);
        for (cell, width) in line.iter().zip(&widths).skip(1) {
            text.push_str("  ");
            text.push_str(&pad(cell, *width, true));
        }
        out.push_str(text.trim_end());
        out.push('\n');
    }
    let keys = table.metrics.iter().zip(table.heads());
    let keys: Vec<String> = keys.map(|(m, head)| format!("{head} {}", m.key)).collect();
    let mut cells = table.rows.iter().flat_map(|row| &row.cells);
    if cells.any(|cell| cell.rank.is_some()) {
        out.push_str("* best of its column; ");
    }
    out.push_str(&format!("{}\n", keys.join(", ")));
    for (i, note) in table.notes.iter().enumerate() {
        out.push_str(&format!("{}) {note}\n", letter(i)));
    }
    out
}

fn number(cell: &Cell, metric: &Metric) -> String {
    let mut out = match cell.value {
        None => "n/a".to_owned(),
        Some(value) => shown(value, metric.decimals),
    };
    if let Some((n, total)) = cell.coverage.filter(|(n, total)| n != total && *n > 0) {
        out.push_str(&format!(" ({n}/{total})"));
    }
    out.push_str(&marks(cell.notes.iter()));
    out.push(if cell.rank == Some(1) { '*' } else { ' ' });
    out
}

fn marks<'a>(notes: impl Iterator<Item = &'a usize>) -> String {
    let letters: Vec<String> = notes.map(|i| letter(*i)).collect();
    if letters.is_empty() {
        String::new()
    } else {
        format!(" {})", letters.join(","))
    }
}

fn length(text: &str) -> usize {
    text.chars().count()
}

fn pad(text: &str, width: usize, right: bool) -> String {
    let blanks = " ".repeat(width.saturating_sub(length(text)));
    if right {
        blanks + text
    } else {
        text.to_owned() + &blanks
    }
}
