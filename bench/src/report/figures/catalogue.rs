//! The list of the paper's figures.

use std::sync::LazyLock;

use serde::Serialize;

/// A figure of the paper and the command that makes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct FigureEntry {
    pub name: &'static str,
    /// The figure's label in the paper, without `fig:`; empty if the figure has no label.
    pub paper: &'static str,
    pub shows: &'static str,
    pub needs: &'static str,
    pub command: &'static str,
}

/// All figures, in the order of the paper.
pub static FIGURES: LazyLock<Vec<FigureEntry>> = LazyLock::new(|| {
    let lines = include_str!("../../../data/figures.tsv").lines().skip(1);
    let figures = lines.filter_map(|line| {
        let fields: [&str; 5] = line.split('\t').collect::<Vec<_>>().try_into().ok()?;
        let [name, paper, command, needs, shows] = fields;
        Some(FigureEntry {
            name,
            paper,
            shows,
            needs,
            command,
        })
    });
    figures.collect()
});
