//! Middlebury's `calib.txt`: a rectified stereo rig, one `key=value` per line.

use std::collections::BTreeMap;

use super::FormatError;

/// A rectified pair of cameras as described by Middlebury 2014 and MiddEval3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StereoCalibration {
    /// Focal length of both cameras in pixels.
    pub focal: f64,
    /// Principal point of the left camera in pixels, in the file's own convention.
    pub left_center: (f64, f64),
    /// Principal point of the right camera in pixels, in the file's own convention.
    pub right_center: (f64, f64),
    /// `cx1 − cx0` in pixels; added to a disparity before conversion to depth.
    pub doffs: f64,
    /// Distance between the two cameras in metres (millimetres in the file).
    pub baseline_m: f64,
    /// Size of the pictures, if stated.
    pub size: Option<(u32, u32)>,
    /// Lowest and highest disparity in pixels: `vmin` and `vmax`, or else 0 and `ndisp`; `None` if
    /// the file states neither.
    pub disparities: Option<(f64, f64)>,
}

/// Parses a `calib.txt`.
///
/// Line endings, a byte order mark, blanks around `=` and the order of the keys are irrelevant; unknown keys are
/// ignored. The size may be absent, and so may `doffs`, which is then `cx1 − cx0`.
///
/// # Errors
/// If a key is missing, is not a finite number, or contradicts another key; names the key.
pub fn parse(text: &str) -> Result<StereoCalibration, FormatError> {
    let mut entries = BTreeMap::new();
    for line in text.trim_start_matches('\u{feff}').lines() {
        if let Some((key, value)) = line.split_once('=') {
            entries.insert(key.trim(), value.trim());
        }
    }
    let text_of = |key: &str| {
        entries
            .get(key)
            .copied()
            .ok_or_else(|| invalid!("the key '{key}' is missing"))
    };
    let left = matrix("cam0", text_of("cam0")?)?;
    let right = matrix("cam1", text_of("cam1")?)?;
    for (name, m) in [("cam0", left), ("cam1", right)] {
        if m[0] <= 0.0 || (m[0] - m[4]).abs() > 1e-6 * m[0] {
            return Err(invalid!(
                "{name} has focal lengths {} and {}, but a rectified pair must have a single positive one",
                m[0],
                m[4]
            ));
        }
    }
    if (left[0] - right[0]).abs() > 1e-6 * left[0] {
        return Err(invalid!(
            "cam0 has focal length {} and cam1 {}, but the cameras of a rectified pair must have the same focal length",
            left[0],
            right[0]
        ));
    }
    let center_offset = right[2] - left[2];
    let doffs = match entries.get("doffs") {
        Some(text) => number("doffs", text)?,
        None => center_offset,
    };
    // A tolerance is needed, because published files round both values to three decimals, and files for rescaled images
    // round a second time.
    if (doffs - center_offset).abs() > 0.01 {
        return Err(invalid!(
            "doffs is {doffs}, but must equal cx1 - cx0, which is {center_offset}"
        ));
    }
    let baseline_mm = number("baseline", text_of("baseline")?)?;
    if baseline_mm <= 0.0 {
        return Err(invalid!(
            "baseline is {baseline_mm} mm, but must be above zero"
        ));
    }
    let size = match (entries.get("width"), entries.get("height")) {
        (Some(width), Some(height)) => Some((pixels("width", width)?, pixels("height", height)?)),
        _ => None,
    };
    // Depth does not depend on this range, so a range that cannot be parsed is treated as absent.
    let stated = |key: &str| entries.get(key).and_then(|text| number(key, text).ok());
    let range = stated("vmin").zip(stated("vmax"));
    let range = range.or_else(|| Some((0.0, stated("ndisp")?)));
    Ok(StereoCalibration {
        disparities: range.filter(|(low, high)| low < high),
        focal: left[0],
        left_center: (left[2], left[5]),
        right_center: (right[2], right[5]),
        doffs,
        baseline_m: baseline_mm / 1000.0,
        size,
    })
}

/// Parses a 3×3 matrix, written `[a b c; d e f; g h i]`; returns its entries row by row.
fn matrix(key: &str, text: &str) -> Result<[f64; 9], FormatError> {
    let inner = text
        .strip_prefix('[')
        .and_then(|t| t.strip_suffix(']'))
        .ok_or_else(|| invalid!("{key} is '{text}', not a matrix in brackets"))?;
    let values = inner
        .split([' ', '\t', ';', ','])
        .filter(|t| !t.is_empty())
        .map(|t| number(key, t))
        .collect::<Result<Vec<_>, _>>()?;
    <[f64; 9]>::try_from(values)
        .map_err(|values| invalid!("{key} has {} entries instead of 9", values.len()))
}

fn number(key: &str, text: &str) -> Result<f64, FormatError> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(invalid!("{key} is '{text}', not a finite number")),
    }
}

fn pixels(key: &str, text: &str) -> Result<u32, FormatError> {
    match text.parse::<u32>() {
        Ok(value) if value > 0 => Ok(value),
        _ => Err(invalid!("{key} is '{text}', not a number of pixels")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: &str = "cam0=[994.97775 0 311.193; 0 994.97775 254.87675; 0 0 1]\n\
        cam1=[994.97775 0 342.27875; 0 994.97775 254.87675; 0 0 1]\n\
        doffs=31.08575\nbaseline=193.001\nwidth=741\nheight=500\nndisp=68\n";

    #[test]
    fn the_rig_is_read_in_metres() {
        let rig = parse(PLAIN).unwrap();
        assert_eq!(rig.focal, 994.97775);
        assert_eq!(rig.left_center, (311.193, 254.87675));
        assert_eq!(rig.right_center, (342.27875, 254.87675));
        assert_eq!(rig.doffs, 31.08575);
        assert_eq!(rig.baseline_m, 0.193_001);
        assert_eq!(rig.size, Some((741, 500)));
        assert_eq!(rig.disparities, Some((0.0, 68.0)));
        let with = |more: &str| parse(&format!("{PLAIN}{more}")).unwrap().disparities;
        assert_eq!(with("vmin=7\nvmax=60\n"), Some((7.0, 60.0)));
        assert_eq!(with("vmin=0\nvmax=0\n"), None);
    }

    #[test]
    fn contradictions_and_gaps_are_refused() {
        for (from, to, reason) in [
            ("doffs=31.08575", "doffs=nan", "doffs is 'nan'"),
            ("doffs=31.08575", "doffs=3.1", "cx1 - cx0"),
            ("baseline=193.001", "baseline=-1", "baseline is -1 mm"),
            ("baseline=193.001", "", "'baseline' is missing"),
            ("width=741", "width=741.5", "width is '741.5'"),
            ("cam1=[994.97775", "cam1=[994.9", "a single positive one"),
            ("; 0 0 1]\ncam1", "; 0 0]\ncam1", "8 entries"),
        ] {
            let error = parse(&PLAIN.replace(from, to)).unwrap_err();
            assert!(error.to_string().contains(reason), "{error}");
        }
    }
}
