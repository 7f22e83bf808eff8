//! Measured times as tables.

use sharp_metrics::Direction;

use super::Measured;
use super::spread::Spread;
use crate::evaluate::results::number;
use crate::evaluate::speed::{Speed, Splats};
use crate::io::counts::counted;
use crate::io::text::csv_bytes;
use crate::report::board::ReportDataset;
use crate::report::column::Column;
use crate::report::tables::csv::text;
use crate::report::tables::grid::{GridCell, TextGrid};
use crate::report::tables::{Cell, Group, Row, Table};

/// Columns of [`csv()`].
pub(super) const CSV_HEAD: &str =
    "method,dataset,format,quantity,n,median,first_quartile,third_quartile,least,most";

/// Median seconds under each dataset, as in the paper.
pub fn table(measured: &Measured) -> Table {
    let mut notes = Vec::new();
    let datasets = measured.manifest.datasets.iter();
    let datasets = datasets.map(|record| ReportDataset::of(&record.name, &record.format));
    let datasets: Vec<ReportDataset> = datasets.collect();
    let methods = measured.manifest.methods.iter().map(|method| {
        let cells = datasets.iter().flat_map(|dataset| {
            let mut speeds = measured.speeds.iter();
            let speed = speeds.find(|s| s.method == method.label && s.dataset == dataset.name);
            let kind = method.identity.kind.as_str();
            cells(speed, kind, &mut notes)
        });
        Row::measured(&method.label, cells.collect())
    });
    let rows = methods.collect();
    let groups = datasets.iter().map(|dataset| {
        let of_dataset = measured.speeds.iter().filter(|s| s.dataset == dataset.name);
        Group {
            pairs: of_dataset.map(|speed| speed.pairs).max(),
            ..Group::titled(dataset.title())
        }
    });
    let columns = vec![
        column(
            "inference_secs",
            "Inference",
            "median seconds over rounds and pairs, from the source picture to the Gaussians",
        ),
        column(
            "render_secs",
            "Render",
            "median seconds over rounds and pairs, from the Gaussians to the picture",
        ),
    ];
    let title = "Run time (seconds)";
    Table {
        remarks: remarks(measured),
        notes,
        ..Table::new("speed", title, groups.collect(), columns, rows)
    }
}

fn column(key: &str, label: &str, convention: &str) -> Column {
    Column {
        direction: Some(Direction::Lower),
        ..Column::reported(key, label, 3, convention)
    }
}

/// Cells for inference and rendering of a method on a dataset.
fn cells(speed: Option<&Speed>, kind: &str, notes: &mut Vec<String>) -> [Cell; 2] {
    let none: &[f64] = &[];
    let inference = speed.map_or(none, |speed| &speed.inference_secs);
    let render = speed.map_or(none, |speed| &speed.render_secs);
    let failed = speed.and_then(|speed| speed.failures.first());
    let why = |what: &str| match (failed, kind) {
        (Some(failure), _) => format!("Not measured: {failure}."),
        (None, "target") => "Not measured: the ground truth is not a method.".to_owned(),
        (None, "imported" | "gaussians") if what == "inference" => {
            "Its predictions are read from files, which is not inference.".to_owned()
        }
        (None, _) if what == "inference" => "Not measured.".to_owned(),
        (None, _) => {
            "The method makes pictures directly, so all of its time is inference.".to_owned()
        }
    };
    [("inference", inference), ("render", render)].map(|(what, secs)| {
        let value = Spread::of(secs).map(|summary| summary.median);
        let reason = value.is_none().then(|| Table::note(notes, why(what)));
        Cell {
            notes: reason.into_iter().collect(),
            ..Cell::of(value)
        }
    })
}

fn remarks(measured: &Measured) -> Vec<String> {
    let manifest = &measured.manifest;
    let devices = manifest.methods.iter().filter_map(|method| {
        let device = method.identity.settings.get("device")?;
        Some(format!("{} on {device}", method.label))
    });
    let devices: Vec<String> = devices.collect();
    let machine = measured
        .machine
        .as_deref()
        .unwrap_or("an unidentified processor");
    let mut remarks = vec![
        "Inference: from the source picture in memory to the Gaussians in memory, or to the picture for methods \
         that make pictures; the data transfer of `command` methods is included, reading files is not."
            .to_owned(),
        format!(
            "Render: from Gaussians loaded in the renderer to the 8-bit picture in memory, one view at a time, at \
             each target's own resolution, by {}. Loading them (on a GPU the upload) is `load_secs` of speed.csv.",
            manifest.renderer
        ),
        format!(
            "Medians over {} of each pair, after a warm-up of {} on the first pair; each method was measured alone, \
             on {machine}{}.",
            counted(measured.options.repeat, "round"),
            counted(measured.options.warmup, "round"),
            if devices.is_empty() {
String::new()
} else {
format!(" (networks: {})", devices.join(", "))
}
        ),
    ];
    let failures: usize = measured
        .speeds
        .iter()
        .map(|speed| speed.failures.len())
        .sum();
    if failures > 0 {
        remarks.push(format!(
            "{} could not be measured.",
            counted(failures, "prediction")
        ));
    }
    remarks
}

/// Details per method and dataset: spread of the times, memory, and numbers of rendered Gaussians.
pub fn details(measured: &Measured) -> TextGrid {
    let heads = [
        "Method",
        "Dataset",
        "Pixels",
        "Pairs",
        "Inference, s",
        "Load, s",
        "Render, s",
        "On the GPU, s",
        "Gaussians",
        "Visible",
        "Tiles per Gaussian",
        "Gaussians per tile",
        "Peak, MiB",
    ];
    let rows = measured.speeds.iter().map(|speed| {
        let sizes = speed.sizes.iter().map(|(w, h)| format!("{w}×{h}"));
        let sizes: Vec<String> = sizes.collect();
        let mean = |of: fn(&Splats) -> f64| {
            let sum: f64 = speed.splats.iter().map(of).sum();
            (!speed.splats.is_empty()).then(|| sum / speed.splats.len() as f64)
        };
        let number = |value: Option<f64>, decimals: usize| match value {
            Some(value) => GridCell::rounded(value, decimals),
            None => GridCell::words(""),
        };
        vec![
            GridCell::words(&speed.method),
            GridCell::words(&speed.dataset),
            GridCell::words(match sizes.as_slice() {
                [first, .., last] => format!("{first} to {last}"),
                sizes => sizes.concat(),
            }),
            GridCell::count(speed.pairs),
            spread(&speed.inference_secs),
            spread(&speed.load_secs),
            spread(&speed.render_secs),
            spread(&speed.device_secs),
            number(mean(|splats| splats.count as f64), 0),
            number(mean(|splats| splats.visible as f64), 0),
            number(mean(|s| s.tiles as f64 / (s.visible as f64).max(1.0)), 2),
            number(
                mean(|s| s.tiles as f64 / (s.picture_tiles as f64).max(1.0)),
                1,
            ),
            number(
                speed
                    .peak_bytes
                    .map(|bytes| bytes as f64 / f64::from(1 << 20)),
                0,
            ),
        ]
    });
    TextGrid::new("Spread of times, memory and rendering load", &heads, rows).remarked([
        "Times: median, first and third quartile of all rounds. On the GPU: drawing without copying the \
             picture back, as compared in the paper's tables. Gaussians: means over pairs; \
             visible ones reach the target's picture; tiles are 16 × 16 pixels, and a Gaussian \
             counts in each tile in which its alpha can reach 1/255. Peak: largest resident size \
             of the process while the method was measured; the memory of a device is not included."
        .to_owned(),
    ])
}

fn spread(secs: &[f64]) -> GridCell {
    match Spread::of(secs) {
        None => GridCell::words(""),
        Some(Spread {
            median,
            quartiles: [low, high],
            ..
        }) => GridCell::number(format!("{median:.4} [{low:.4}, {high:.4}]"), median),
    }
}

/// One line per quantity, at full precision; `quantity` is `inference_secs`, `load_secs`, `render_secs`, `device_secs`,
/// `peak_bytes`, `gaussians`, `visible`, `tiles` or `picture_tiles`.
pub fn csv(measured: &Measured) -> Vec<u8> {
    let mut lines = Vec::new();
    for speed in &measured.speeds {
        let mut records = measured.manifest.datasets.iter();
        let record = records.find(|record| record.name == speed.dataset);
        let format = record.map_or("", |record| &record.format);
        let of = |of: fn(&Splats) -> u64| -> Vec<f64> {
            let splats = speed.splats.iter();
            splats.map(|splats| of(splats) as f64).collect()
        };
        let peak = speed.peak_bytes.iter().map(|bytes| *bytes as f64).collect();
        let quantities = [
            ("inference_secs", speed.inference_secs.clone()),
            ("load_secs", speed.load_secs.clone()),
            ("render_secs", speed.render_secs.clone()),
            ("device_secs", speed.device_secs.clone()),
            ("peak_bytes", peak),
            ("gaussians", of(|splats| splats.count)),
            ("visible", of(|splats| splats.visible)),
            ("tiles", of(|splats| splats.tiles)),
            ("picture_tiles", of(|splats| splats.picture_tiles)),
        ];
        for (quantity, numbers) in quantities {
            let Some(summary) = Spread::of(&numbers) else {
                continue;
            };
            let [low, high] = summary.quartiles;
            lines.push([
                text(&speed.method),
                text(&speed.dataset),
                format.to_owned(),
                quantity.to_owned(),
                summary.n.to_string(),
                number(summary.median),
                number(low),
                number(high),
                number(summary.least),
                number(summary.most),
            ]);
        }
    }
    csv_bytes(CSV_HEAD.split(','), lines)
}
