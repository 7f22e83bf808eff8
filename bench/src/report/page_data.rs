//! Data of the pairs, from which the page's script builds the cards that are in view.

use serde_json::{Value, json};

use crate::evaluate::record::{Record, Score, Status};
use crate::io::text::visible_line;
use crate::pictures::keyed_scores::json_number;

use super::column::Column;
use super::gallery::{self, GalleryPair, Pictures};
use super::html::{Page, without_tags};
use super::options::Layout;
use super::pictures::Thumbnail;
use sharp_plots::palette::style;

/// JSON that is safe inside a `script` element: without `<` and control characters.
pub(super) fn json(page: &Page<'_>) -> String {
    let methods = page.board.methods.iter().enumerate().map(|(at, method)| {
        json!({
            "label": visible_line(&method.label),
            "colour": style(at).ink.hex(),
            "ranked": method.unranked.is_none(),
            "against": gallery::against(page.options, page.board, at),
        })
    });
    let datasets = page.board.datasets.iter();
    let datasets = datasets.map(|d| visible_line(d.dataset.title()));
    let shared = json!({
        "datasets": datasets.collect::<Vec<_>>(),
        "methods": methods.collect::<Vec<_>>(),
        "heads": Column::heads(page.metrics),
        "keys": page.metrics.iter().map(|metric| &metric.key).collect::<Vec<_>>(),
    });
    // Serialise pair by pair, because a JSON tree of all pairs would take many times as much memory
    // as the text.
    let pairs = page.gallery.pairs.iter();
    let pairs = pairs.map(|pair| without_tags(&pair_data(page, pair)));
    let mut text = without_tags(&shared);
    // Remove the closing brace, in order to append to the object.
    text.pop();
    text += ",\"pairs\":[";
    for (at, pair) in pairs.enumerate() {
        if at > 0 {
            text.push(',');
        }
        text += &pair;
    }
    text + "]}"
}

fn pair_data(page: &Page<'_>, shown: &GalleryPair<'_>) -> Value {
    let facts = shown.pair.facts;
    let methods = shown.methods.iter().map(|shown| {
        let shown = shown.as_ref()?;
        let record = shown.record;
        let mut data = json!({
            "pictures": pictures(page, &shown.pictures),
            "full": page.full_path(record),
        });
        if let Some(viewer) = page.viewer_path(record) {
            data["viewer"] = json!(viewer);
        }
        match &record.status {
            Status::Failed { reason } => data["failed"] = json!(visible_line(reason)),
            Status::Ok => {
                let scores = page.metrics.iter().map(|metric| score(record, metric));
                data["scores"] = scores.collect();
                data["extras"] = extras(page.extras, record);
            }
        }
        Some(data)
    });
    let [source, target] = page.full_views(shown.pair);
    json!({
        "id": visible_line(&facts.pair_id),
        "dataset": shown.dataset,
        "scene": visible_line(&facts.scene),
        "views": [visible_line(&facts.source), visible_line(&facts.target)],
        "baseline": Some(facts.baseline_m).filter(|v| v.is_finite()),
        "overlap": facts.overlap.filter(|v| v.is_finite()),
        "facts": facts_of(facts),
        "losses": losses(page, facts),
        "pictures": pictures(page, &shown.views),
        "full": {"source": source, "target": target},
        "methods": methods.collect::<Vec<_>>(),
    })
}

/// Maps each kind to `[address, width, height]`, or to the reason why the picture is missing.
fn pictures(page: &Page<'_>, pictures: &Pictures) -> Value {
    let address = |picture: &Thumbnail| match page.gallery.layout {
        Layout::File => picture.address(),
        Layout::Folder => gallery::file_name(picture),
    };
    let shown = pictures.iter().map(|(kind, picture)| {
        let value = match picture {
            Ok(picture) => json!([address(picture), picture.width, picture.height]),
            Err(reason) => json!(visible_line(&reason.to_string())),
        };
        (kind.name().to_owned(), value)
    });
    Value::Object(shown.collect())
}

/// `[number, displayed text]`, or the reason why the score is missing.
fn score(record: &Record, metric: &Column) -> Value {
    match record.scores.get(&metric.key) {
        Some(Score::Value(value)) => json!([json_number(*value), metric.shown(*value)]),
        Some(Score::Unavailable { unavailable }) => json!(visible_line(unavailable)),
        None => json!("not computed in this run"),
    }
}

/// Values that a method reports about its prediction: `[label, text]`.
fn extras(columns: &[Column], record: &Record) -> Value {
    let reported = record.reported();
    let extras = columns.iter().filter_map(|column| {
        let value = *reported.get(column.key.as_str())?;
        Some(json!([column.label, column.shown(value)]))
    });
    extras.collect()
}

fn facts_of(facts: &Record) -> Vec<String> {
    let known = |value: Option<f64>| value.filter(|v| v.is_finite());
    let facts = [
        known(Some(facts.baseline_m)).map(|v| format!("baseline {v:.3} m")),
        known(Some(facts.rotation_deg)).map(|v| format!("rotation {v:.1}°")),
        known(facts.median_depth_m).map(|v| format!("median depth {v:.2} m")),
        known(facts.overlap).map(|v| format!("overlap {:.1} %", v * 100.0)),
    ];
    facts.into_iter().flatten().collect()
}

/// By how much method B is worse on a pair, for each metric; `None` if the page is not a
/// comparison.
fn losses(page: &Page<'_>, facts: &Record) -> Option<Vec<Option<f64>>> {
    let of_pair = page
        .options
        .comparison
        .as_ref()?
        .losses
        .get(&facts.pair_id)?;
    let metrics = page.metrics.iter();
    let losses = metrics.map(|metric| of_pair.get(&metric.key).copied());
    Some(losses.map(|loss| loss.filter(|v| v.is_finite())).collect())
}
