//! Scores with their metrics, for JSON and CSV.

use serde_json::{Map, Value, json};
use sharp_metrics::MetricKey;

use crate::evaluate::record::finite_or_text;
use crate::evaluate::results::number;

/// Each metric's score, or the reason why it is missing.
pub type KeyedScores = Vec<(MetricKey, Result<f64, String>)>;

/// A JSON number, or `"inf"`, `"-inf"` or `"nan"` for values that JSON cannot represent.
pub fn json_number(value: f64) -> Value {
    finite_or_text::text(value).map_or_else(|| json!(value), |text| json!(text))
}

/// Scores keyed by metric, then the reasons for missing scores, also keyed by metric.
pub fn json_scores(scores: &KeyedScores) -> [Map<String, Value>; 2] {
    let (mut values, mut unavailable) = (Map::new(), Map::new());
    for (key, score) in scores {
        match score {
            Ok(value) => values.insert(key.to_string(), json_number(*value)),
            Err(reason) => unavailable.insert(key.to_string(), json!(reason)),
        };
    }
    [values, unavailable]
}

/// One cell per score, empty if the score is missing, then one cell with the reasons for
/// all missing scores.
pub fn csv_cells(scores: &KeyedScores) -> Vec<String> {
    let value = |score: &Result<f64, String>| {
        score
            .as_ref()
            .map_or_else(|_| String::new(), |v| number(*v))
    };
    let mut cells: Vec<String> = scores.iter().map(|(_, score)| value(score)).collect();
    let missing = scores.iter();
    let missing = missing.filter_map(|(key, s)| Some(format!("{key}: {}", s.as_ref().err()?)));
    cells.push(missing.collect::<Vec<_>>().join("; "));
    cells
}
