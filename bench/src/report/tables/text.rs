//! Plain text of a table for a terminal: aligned columns, with `*` at the best numbers.

use super::{Cell, Table, letter, letters};
use crate::io::text::visible_line;
use crate::report::column::Column;

impl Table {
    /// The table as lines without trailing spaces, with footnotes below. Widths are counted in characters. Every
    /// character, including arrows and the infinity sign, takes one column.
    pub fn text(&self) -> String {
        let heads = Column::heads(&self.columns);
        let mut grid = vec![vec![self.row_head.to_owned()]];
        for _ in &self.groups {
            grid[0].extend(heads.iter().map(|head| format!("{head} ")));
        }
        for row in &self.rows {
            let mut line = vec![self.label(row) + &marks(row.note.as_slice())];
            let cells = self.cells(row);
            line.extend(cells.map(|(column, cell)| number(self.number(column, cell), cell)));
            grid.push(line);
        }
        let width = |column: usize| grid.iter().map(|line| length(&line[column])).max();
        let mut widths: Vec<usize> = (0..grid[0].len()).filter_map(width).collect();
        let mut titles = " ".repeat(widths[0]);
        for (group, widths) in self
            .groups
            .iter()
            .zip(widths[1..].chunks_mut(heads.len().max(1)))
        {
            let mut title = visible_line(&group.title).into_owned() + &marks(group.note.as_slice());
            if let Some(n) = group.pairs {
                title += &format!(" (n={n})");
            }
            // If a dataset's name is wider than its group, widen the group's last column.
            let room = widths.iter().map(|w| w + 2).sum::<usize>() - 2;
            if let Some(last) = widths.last_mut() {
                *last += length(&title).saturating_sub(room);
            }
            titles += &format!("  {title:<room$}");
        }
        let mut out = format!("{}\n", titles.trim_end());
        let whole: usize = widths.iter().map(|w| w + 2).sum();
        for (at, line) in grid.iter().enumerate() {
            if at
                .checked_sub(1)
                .is_some_and(|row| self.has_rule_before(&row))
            {
                out += &format!("{}\n", "-".repeat(whole - 2));
            }
            let mut text = format!("{:<1$}", line[0], widths[0]);
            for (cell, width) in line.iter().zip(&widths).skip(1) {
                text += &format!("  {cell:>width$}");
            }
            out += text.trim_end();
            out.push('\n');
        }
        if self.is_ranked() {
            out.push_str("* best of its column; ");
        }
        let keys = self.columns.iter().zip(heads);
        let keys: Vec<String> = keys.map(|(c, head)| format!("{head} {}", c.key)).collect();
        out += &format!("{}\n", keys.join(", "));
        for remark in &self.remarks {
            out += &format!("{remark}\n");
        }
        for (i, note) in self.notes.iter().enumerate() {
            out += &format!("{}) {note}\n", letter(i));
        }
        for check in &self.checklist {
            let mark = if check.is_met { 'x' } else { ' ' };
            out += &format!("[{mark}] {}\n", check.text);
        }
        out
    }
}

fn number(number: String, cell: &Cell) -> String {
    let pairs = cell.partial().map(|(n, total)| format!(" ({n}/{total})"));
    let best = if cell.rank == Some(1) { '*' } else { ' ' };
    let pairs = pairs.unwrap_or_default();
    format!("{number}{pairs}{}{best}", marks(&cell.notes))
}

fn marks(notes: &[usize]) -> String {
    letters(" ", notes, ")")
}

fn length(text: &str) -> usize {
    text.chars().count()
}
