//! The series of a history in words, for terminal and page.

use crate::report::tables::shown;
use crate::track::compare::verdict_word;

use super::{Point, Rule, Series};

/// Columns of [`Series::cells`].
pub const HEADS: [&str; 9] = [
    "entry", "label", "mean", "95 %", "pairs", "scenes", "failed", "weights", "change",
];

impl Rule {
    pub fn word(self) -> &'static str {
        match self {
            Self::Step => "step",
            Self::Drift => "drift",
        }
    }
}

impl Series {
    /// Metric, dataset and method.
    pub fn title(&self) -> String {
        format!("{}, {}: {}", self.metric.key, self.dataset, self.method)
    }

    /// A point as a line of a table under [`HEADS`]; `label` is that of its entry.
    pub fn cells(&self, point: &Point, label: &str) -> [String; 9] {
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| self.number(v));
        let interval = match (point.ci_low, point.ci_high) {
            (None, None) => "-".to_owned(),
            (low, high) => format!("{} .. {}", number(low), number(high)),
        };
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
            (None, None) if point.broken.is_some() => "begins anew".to_owned(),
            (None, Some(before)) if point.broken.is_some() => format!("continues {before}"),
            (None, _) => String::new(),
        };
        let weights = match point.weights.as_str() {
            "" => "-",
            weights => weights,
        };
        [
            point.entry.to_string(),
            label.to_owned(),
            number(point.mean),
            interval,
            pairs,
            point.n_scenes.to_string(),
            point.n_failed.to_string(),
            weights.to_owned(),
            change,
        ]
    }

    /// What a point is remarkable for, in sentences without their ends.
    pub fn events(&self, point: &Point) -> Vec<String> {
        let mut events: Vec<String> = point.broken.iter().cloned().collect();
        if let (Some(_), Some(before)) = (&point.broken, point.follows) {
            events.push(format!("continues from entry {before}"));
        }
        let mut before = self.points.iter();
        let before = before.find(|before| Some(before.entry) == point.follows);
        if let Some(before) = before.filter(|before| before.identity != point.identity) {
            let entry = before.entry;
            events.push(format!("other weights or options than in entry {entry}"));
        }
        if let Some(mark) = &point.change {
            let size = self.number(mark.difference.abs());
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
                Rule::Drift => ", little by little",
            };
            let (word, against) = (verdict_word(mark.verdict), mark.against);
            events.push(format!(
                "{word} by {size}{unit} than entry {against}{how} ({p})"
            ));
        }
        events
    }

    /// One decimal more than single scores: means of many are compared.
    fn number(&self, value: f64) -> String {
        shown(value, self.metric.decimals + 1)
    }
}
