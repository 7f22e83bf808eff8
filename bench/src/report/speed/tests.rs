//! Tables from made-up times.

use std::collections::BTreeSet;

use super::compute::{MethodCompute, grid};
use super::*;
use crate::evaluate::manifest::MethodRecord;
use crate::evaluate::speed::Splats;
use crate::evaluate::test_records::manifest;
use crate::evaluate::unit::Timing;
use crate::methods::{MethodIdentity, Privilege};

fn measured() -> Measured {
    let method = |label: &str, kind: &str| MethodRecord {
        label: label.to_owned(),
        spec: None,
        identity: MethodIdentity::new(kind, [("device", "cpu".to_owned())]),
        privilege: Privilege::NONE,
        sources: String::new(),
        notes: Vec::new(),
        drawn: Vec::new(),
        warnings: Vec::new(),
    };
    let speed = |method: &str, inference: &[f64], render: &[f64]| Speed {
        dataset: "D_1".to_owned(),
        method: method.to_owned(),
        sizes: BTreeSet::from([(640, 480)]),
        pairs: 1,
        inference_secs: inference.into(),
        load_secs: render.iter().map(|_| 0.001).collect(),
        render_secs: render.into(),
        device_secs: render.iter().map(|_| 0.002).collect(),
        splats: render
            .iter()
            .take(1)
            .map(|_| Splats {
                count: 1000,
                visible: 500,
                tiles: 2400,
                picture_tiles: 1200,
            })
            .collect(),
        peak_bytes: Some(512 << 20),
        failures: Vec::new(),
    };
    let manifest = manifest("psnr");
    let mut failing = speed("fails", &[], &[]);
    failing.failures.push("D_1/s/a__b: no depth".to_owned());
    Measured {
        speeds: vec![
            speed("=splat", &[1.0, 0.5, 2.0], &[0.010, 0.020]),
            speed("pictures", &[0.12], &[]),
            failing,
        ],
        options: SpeedOptions {
            warmup: 1,
            repeat: 3,
        },
        manifest: Manifest {
            methods: vec![
                method("=splat", "sharp"),
                method("pictures", "command"),
                method("fails", "sharp"),
                method("truth", "target"),
            ],
            ..manifest
        },
        machine: Some("A processor, 2 threads".to_owned()),
    }
}

#[test]
fn the_table_has_medians_and_says_why_a_cell_is_empty() {
    let measured = measured();
    let table = tables::table(&measured);
    let values: Vec<Option<f64>> = table
        .rows
        .iter()
        .flat_map(|row| row.cells.iter().map(|cell| cell.value))
        .collect();
    let expected = [
        Some(1.0),
        Some(0.015),
        Some(0.12),
        None,
        None,
        None,
        None,
        None,
    ];
    assert_eq!(values, expected);
    let why = |row: usize, cell: usize| table.notes[table.rows[row].cells[cell].notes[0]].as_str();
    assert_eq!(
        why(1, 1),
        "The method makes pictures directly, so all of its time is inference."
    );
    assert_eq!(why(2, 0), "Not measured: D_1/s/a__b: no depth.");
    assert!(why(3, 0).contains("truth"));
    assert!(table.remarks[2].contains("3 rounds of each pair, after a warm-up of 1 round"));
    assert!(table.remarks[2].contains("A processor, 2 threads (networks: =splat on cpu"));
    assert!(table.remarks[3].starts_with("1 prediction"));
    let details = tables::details(&measured);
    let row: Vec<&str> = details.rows[0]
        .iter()
        .map(|cell| cell.text.as_str())
        .collect();
    let expected = [
        "=splat",
        "D_1",
        "640×480",
        "1",
        "1.0000 [0.7500, 1.5000]",
        "0.0010 [0.0010, 0.0010]",
        "0.0150 [0.0125, 0.0175]",
        "0.0020 [0.0020, 0.0020]",
        "1000",
        "500",
        "4.80",
        "2.0",
        "512",
    ];
    assert_eq!(row, expected);
    let csv = String::from_utf8(tables::csv(&measured)).unwrap();
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(
        lines[1],
        "'=splat,D_1,synthetic,inference_secs,3,1,0.75,1.5,0.5,2"
    );
    assert!(lines.contains(&"pictures,D_1,synthetic,inference_secs,1,0.12,0.12,0.12,0.12,0.12"));
}

#[test]
fn hours_are_sums_and_hardware_is_named() {
    let timing = |predict_secs: f64, machine: &str, mib: u64| Timing {
        predict_secs,
        score_secs: 900.0,
        machine: Some(machine.to_owned()),
        peak_bytes: Some(mib << 20),
        ..Timing::default()
    };
    let method = |label: &str, timings: Vec<Timing>| MethodCompute {
        run: "runs/a".to_owned(),
        method: label.to_owned(),
        renderer: "cpu-avx2".to_owned(),
        device: None,
        timings,
    };
    let grid = grid(&[
        method("a", vec![timing(1800.0, "X", 10), timing(5400.0, "Y", 30)]),
        method("b", vec![timing(3600.0, "X", 20)]),
    ]);
    let row = |at: usize| -> Vec<&str> {
        let cells = grid.rows[at].iter().map(|cell| cell.text.as_str());
        cells.collect()
    };
    assert_eq!(
        row(0),
        [
            "runs/a", "a", "X; Y", "", "cpu-avx2", "2", "2.0000", "0.5000", "30"
        ]
    );
    assert_eq!(
        row(2),
        ["all", "", "", "", "", "3", "3.0000", "0.7500", "30"]
    );
}
