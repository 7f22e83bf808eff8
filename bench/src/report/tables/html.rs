//! HTML of a table for the page, from `templates/table.html`.

use askama::Template;

use crate::report::column::Column;

use super::{Cell, Table, letter, spans};

#[derive(Template)]
#[template(path = "table.html")]
struct HtmlTable<'a> {
    table: &'a Table,
    id: &'a str,
}

impl Table {
    /// A `figure` with caption, table and footnotes. `id` makes its anchors unique in the page.
    ///
    /// # Errors
    /// If the template cannot be filled in.
    pub fn html(&self, id: &str) -> askama::Result<String> {
        HtmlTable { table: self, id }.render()
    }
}

impl HtmlTable<'_> {
    fn heads(&self) -> Vec<String> {
        Column::heads(&self.table.columns)
    }

    fn letter(&self, note: &usize) -> String {
        letter(*note)
    }

    fn spans<'n>(&self, note: &'n str) -> Vec<(bool, &'n str)> {
        spans(note)
    }

    /// CSS classes of cell `index` in a row.
    fn classes(&self, index: &usize, cell: &Cell) -> String {
        let rank = cell.rank.map(|rank| format!("rank{rank}"));
        let state = match (cell.value, cell.partial()) {
            (None, _) => Some("absent"),
            (_, Some(_)) => Some("partial"),
            _ => None,
        };
        let first = index
            .is_multiple_of(self.table.columns.len())
            .then_some("first");
        let classes = [first, rank.as_deref(), state];
        classes.into_iter().flatten().collect::<Vec<_>>().join(" ")
    }
}
