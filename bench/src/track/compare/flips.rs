//! Pairs on which one of two methods scores better in run A, and the other in run B.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use sharp_metrics::MetricInfo;

use super::{Against, RunComparison};
use crate::io::counts::counted;
use crate::pictures::keyed_scores::json_number;
use crate::report::tables::grid::{GridCell, TextGrid};

/// The pairs for which one metric ranks two methods differently in A and B; ties do not count.
#[derive(Debug, Clone)]
pub struct Flips<'a> {
    metric: &'a MetricInfo,
    methods: [&'a Against; 2],
    /// Number of pairs for which both methods have scores in both A and B.
    n_pairs: usize,
    flipped: Vec<Flipped<'a>>,
}

/// A pair with the two methods' scores in A and in B.
#[derive(Debug, Clone)]
struct Flipped<'a> {
    pair_id: &'a str,
    a: [f64; 2],
    b: [f64; 2],
}

impl RunComparison {
    /// Changes of rank by metric and pair of methods; empty for fewer than two methods.
    pub fn flips(&self) -> Vec<Flips<'_>> {
        let mut all = Vec::new();
        for metric in &self.results.manifest.metrics {
            let metric = &metric.info;
            for (at, first) in self.against.iter().enumerate() {
                for second in &self.against[at + 1..] {
                    all.push(self.flips_of(metric, [first, second]));
                }
            }
        }
        all
    }

    fn flips_of<'a>(&'a self, metric: &'a MetricInfo, methods: [&'a Against; 2]) -> Flips<'a> {
        let [of_first, of_second] = methods.map(|against| {
            let changes = self.changes(against, metric).into_iter();
            let scores = changes.map(|change| (change.a.pair_id.as_str(), change.scores));
            scores.collect::<BTreeMap<&str, [f64; 2]>>()
        });
        let both = of_first.into_iter().filter_map(|(pair_id, one)| {
            let other = of_second.get(pair_id)?;
            Some(Flipped {
                pair_id,
                a: [one[0], other[0]],
                b: [one[1], other[1]],
            })
        });
        let mut flipped: Vec<Flipped<'_>> = both.collect();
        let n_pairs = flipped.len();
        flipped.retain(|Flipped { a, b, .. }| (a[0] - a[1]) * (b[0] - b[1]) < 0.0);
        Flips {
            metric,
            methods,
            n_pairs,
            flipped,
        }
    }
}

impl Flips<'_> {
    pub fn grid(&self) -> TextGrid {
        let [first, second] = self.methods;
        let title = format!(
            "{}: {} of {} changed the order of {} and {}",
            self.metric.key,
            self.flipped.len(),
            counted(self.n_pairs, "pair"),
            first.b,
            second.b
        );
        let heads = [
            "pair".to_owned(),
            format!("{} in A", first.a),
            format!("{} in A", second.a),
            format!("{} in B", first.b),
            format!("{} in B", second.b),
        ];
        let number = |value: &f64| GridCell::rounded(*value, self.metric.decimals + 1);
        let rows = self.flipped.iter().map(|Flipped { pair_id, a, b }| {
            let scores = a.iter().chain(b).map(number);
            std::iter::once(GridCell::words(*pair_id))
                .chain(scores)
                .collect()
        });
        TextGrid::new(title, &heads.each_ref().map(String::as_str), rows)
    }

    /// An entry of `flips` in `compare --json`.
    pub(super) fn json(&self) -> Value {
        let [first, second] = self.methods;
        let pairs = self.flipped.iter().map(|Flipped { pair_id, a, b }| {
            json!({"pair_id": pair_id, "a": a.map(json_number), "b": b.map(json_number)})
        });
        json!({
            "metric": self.metric.key.to_string(),
            "methods_a": [first.a, second.a],
            "methods_b": [first.b, second.b],
            "n_pairs": self.n_pairs,
            "pairs": pairs.collect::<Vec<_>>(),
        })
    }
}
