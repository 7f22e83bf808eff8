//! The series of a history as text, for terminal and page.

use crate::report::tables::grid::{GridCell, TextGrid};
use crate::report::tables::shown;
use crate::track::compare::verdict_word;

use super::{History, Point, Rule, Series};

const HEADS: [&str; 9] = [
    "entry", "label", "mean", "95 %", "pairs", "scenes", "failed", "weights", "change",
];

impl History {
    /// A table with the metadata of all entries.
    pub fn entries_grid(&self) -> TextGrid {
        let rows = self.entries.iter().map(|(number, occasion)| {
            let commit = occasion.commit.as_deref().unwrap_or("-");
            let words = [occasion.label.as_str(), commit, occasion.date.as_str()];
            let words = words.map(GridCell::words);
            [GridCell::count(*number as usize)]
                .into_iter()
                .chain(words)
                .collect()
        });
        TextGrid::new("entries", &["entry", "label", "commit", "date"], rows)
    }

    /// One table per series.
    pub fn series_grids(&self) -> Vec<TextGrid> {
        let grid = |series: &Series| {
            let points = series.points.iter();
            let remarks = points.clone().flat_map(|point| {
                let events = series.events(point).into_iter();
                events.map(|event| format!("entry {}: {event}", point.entry))
            });
            let rows = points.map(|point| series.cells(point, self.label(point.entry)));
            TextGrid::new(series.title(), &HEADS, rows).remarked(remarks)
        };
        self.series.iter().map(grid).collect()
    }

    /// Label of an entry; empty if there is no such entry.
    pub fn label(&self, entry: u32) -> &str {
        self.occasion(entry).map_or("", |occasion| &occasion.label)
    }
}

impl Rule {
    pub fn word(self) -> &'static str {
        match self {
            Self::Step => "step",
            Self::Drift => "drift",
        }
    }
}

impl Series {
    /// Title of the series: metric, dataset and method.
    pub fn title(&self) -> String {
        format!("{}, {}: {}", self.metric.key, self.dataset, self.method)
    }

    fn cells(&self, point: &Point, label: &str) -> Vec<GridCell> {
        let pairs = match point.n_planned {
            planned if planned == point.n_pairs => planned.to_string(),
            planned => format!("{} of {planned}", point.n_pairs),
        };
        let change = match (&point.change, point.follows) {
            (Some(mark), _) => format!(
                "{} than {} ({})",
                verdict_word(mark.verdict),
                mark.against,
                mark.rule.word()
            ),
            (None, None) if point.broken.is_some() => "starts again".to_owned(),
            (None, Some(before)) if point.broken.is_some() => format!("continues {before}"),
            (None, _) => String::new(),
        };
        let weights = match point.weights.as_str() {
            "" => "-",
            weights => weights,
        };
        vec![
            GridCell::count(point.entry as usize),
            GridCell::words(label),
            GridCell::optional(point.mean, |mean| shown(mean, self.decimals())),
            GridCell::interval(point.ci_low, point.ci_high, self.decimals()),
            GridCell::number(pairs, point.n_pairs as f64),
            GridCell::count(point.n_scenes),
            GridCell::count(point.n_failed),
            GridCell::words(weights),
            GridCell::words(change),
        ]
    }

    /// Events at a point, as sentences without full stops.
    pub fn events(&self, point: &Point) -> Vec<String> {
        let mut events: Vec<String> = point.broken.iter().cloned().collect();
        if let (Some(_), Some(before)) = (&point.broken, point.follows) {
            events.push(format!("continues from entry {before}"));
        }
        let mut before = self.points.iter();
        let before = before.find(|before| Some(before.entry) == point.follows);
        if let Some(before) = before.filter(|before| before.identity != point.identity) {
            let entry = before.entry;
            events.push(format!(
                "weights or options differ from those in entry {entry}"
            ));
        }
        if let Some(mark) = &point.change {
            let size = shown(mark.difference.abs(), self.decimals());
            let unit = match self.metric.unit.as_str() {
                "" => String::new(),
                unit => format!(" {unit}"),
            };
            let p = match mark.p {
                Some(p) if p < 0.0001 => "p < 0.0001".to_owned(),
                p => format!("p = {:.4}", p.unwrap_or(f64::NAN)),
            };
            let how = match mark.rule {
                Rule::Step => "",
                Rule::Drift => ", over several entries",
            };
            let (word, against) = (verdict_word(mark.verdict), mark.against);
            events.push(format!(
                "{word} by {size}{unit} than entry {against}{how} ({p})"
            ));
        }
        events
    }

    /// One decimal more than for single scores, because means of many pairs are compared here.
    fn decimals(&self) -> usize {
        self.metric.decimals + 1
    }
}
