//! Independently computed numbers, from decoded pixels, without code of the product.

use std::collections::BTreeMap;
use std::path::Path;

use image::RgbImage;

use super::case::{Case, Said, Verdict};

/// Relative tolerance of a PSNR; both sides sum squares of integers in f64.
const TOLERANCE: f64 = 1e-9;

/// Rows of a CSV file by column.
pub(crate) type Rows = Vec<BTreeMap<String, String>>;

pub(crate) fn rows(path: &Path) -> Result<Rows, String> {
    let wrong = |error: csv::Error| format!("{}: {error}", path.display());
    let mut reader = csv::Reader::from_path(path).map_err(wrong)?;
    let header = reader.headers().map_err(wrong)?.clone();
    let mut rows = Rows::new();
    for row in reader.records() {
        let row = row.map_err(wrong)?;
        let cells = header.iter().zip(&row);
        rows.push(cells.map(|(k, v)| (k.to_owned(), v.to_owned())).collect());
    }
    Ok(rows)
}

/// Peak signal-to-noise ratio, dB; infinite for equal pictures, `None` for unequal sizes.
pub(crate) fn psnr(a: &RgbImage, b: &RgbImage) -> Option<f64> {
    if a.dimensions() != b.dimensions() {
        return None;
    }
    let squares = a
        .iter()
        .zip(b.iter())
        .map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
    let mean = squares.sum::<f64>() / a.len() as f64;
    Some(20.0 * 255_f64.log10() - 10.0 * mean.log10())
}

/// The pixels of a file, whatever its name; `None` if its bytes are not a picture.
pub(crate) fn pixels(path: &Path) -> Option<RgbImage> {
    let reader = image::ImageReader::open(path)
        .ok()?
        .with_guessed_format()
        .ok()?;
    Some(reader.decode().ok()?.into_rgb8())
}

pub(crate) fn same(found: &str, expected: f64) -> bool {
    let found: f64 = found.parse().unwrap_or(f64::NAN);
    found == expected || (found - expected).abs() <= TOLERANCE * expected.abs()
}

/// Judges a run: it must end with a clean error, or each of its rows must have a reason for its failure, or the
/// oracle's number, if the oracle knows one.
pub(crate) fn judge_run(
    case: &Case,
    said: &Said,
    run: &str,
    oracle: &dyn Fn(&BTreeMap<String, String>) -> Known,
) -> Result<Verdict, String> {
    if !matches!(said.code, 0 | 4) {
        return Ok(Verdict::Error);
    }
    let rows = rows(&case.path(run).join("scores.csv"))?;
    let mut verdict = Verdict::Error;
    for row in &rows {
        if row["status"] != "ok" {
            // A reason may name a view of its pair.
            let is_of_view = [&row["source"], &row["target"]]
                .iter()
                .any(|view| row["reason"].starts_with(&format!("{view}: ")));
            if !is_of_view {
                case.judge_reason(&row["reason"])?;
            }
            if said.code == 0 {
                return Err(format!("exit code 0 beside a failure: {}", row["reason"]));
            }
            continue;
        }
        match oracle(row) {
            Known::Number(expected) if same(&row["psnr"], expected) => verdict = Verdict::Number,
            Known::Number(expected) => {
                return Err(format!("{} instead of {expected}: {row:?}", row["psnr"]));
            }
            Known::Impossible(why) => return Err(format!("{why}, and yet a score: {row:?}")),
            Known::Nothing => {}
        }
    }
    if rows.is_empty() {
        Err("a run without a row".to_owned())
    } else {
        Ok(verdict)
    }
}

/// What the oracle knows about a row's PSNR.
pub(crate) enum Known {
    Number(f64),
    /// There is no PSNR, for the given reason.
    Impossible(&'static str),
    Nothing,
}

/// The PSNR of two files.
pub(crate) fn psnr_of_files(a: &Path, b: &Path) -> Known {
    match (pixels(a), pixels(b)) {
        (Some(a), Some(b)) => match psnr(&a, &b) {
            Some(number) => Known::Number(number),
            None => Known::Impossible("the sizes differ"),
        },
        _ => Known::Impossible("one picture cannot be decoded"),
    }
}
