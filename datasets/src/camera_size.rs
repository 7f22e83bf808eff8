//! Rejects pictures whose size differs from their camera's, or scales the camera if requested.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sharp::image_file::{OrientationRule, PictureRules};

use crate::format::picture;
use crate::lens::Lens;
use crate::setting::{Setting, choice};
use crate::{DatasetError, DatasetSpec, mask};

/// Treatment of pictures whose size differs from their camera's.
pub(crate) const CAMERA_SIZE: Setting = Setting::choice(
    "camera-size",
    "what to do with pictures whose size differs from their camera's",
    &[
        choice("exact", "report an error"),
        choice(
            "scaled",
            "scale the camera if the ratio is the same on both axes; otherwise report an error",
        ),
    ],
);

type PixelSize = (u32, u32);

/// Fits cameras to pictures as [`CAMERA_SIZE`] specifies, and counts the scaled cameras.
#[derive(Debug)]
pub(crate) struct CameraSizes {
    /// Source file of the cameras, for notes.
    file: PathBuf,
    scale: bool,
    /// True if the dataset format offers the setting [`CAMERA_SIZE`].
    pub(crate) is_offered: bool,
    rules: PictureRules,
    /// Number of scaled cameras, keyed by the camera's size and the picture's.
    scaled: BTreeMap<(PixelSize, PixelSize), usize>,
}

impl CameraSizes {
    pub(crate) fn new(spec: &DatasetSpec, file: &Path) -> Self {
        Self {
            file: file.to_owned(),
            scale: spec.setting(CAMERA_SIZE.key) == "scaled",
            is_offered: spec.entry.settings.iter().any(|s| s.key == CAMERA_SIZE.key),
            rules: spec.picture_rules(),
            scaled: BTreeMap::new(),
        }
    }

    /// Sets the file from which the cameras were read, to be named in notes.
    pub(crate) fn cameras_from(&mut self, file: Option<&PathBuf>) {
        if let Some(file) = file {
            self.file.clone_from(file);
        }
    }

    /// Camera of a picture, scaled to the picture's size if necessary. Pixels are measured from the picture's corner,
    /// so focal lengths and principal point are multiplied by the factor of their axis; distortion acts on
    /// dimensionless coordinates and is unchanged.
    ///
    /// # Errors
    /// If the scaled camera is invalid; names the picture.
    pub(crate) fn fit(&mut self, lens: Lens, image: &Path) -> Result<Lens, DatasetError> {
        let k = lens.intrinsics();
        let from = (k.width, k.height);
        // A picture that cannot be read is reported when it is decoded.
        let Some(header) = self.scale.then(|| picture::header(image).ok()).flatten() else {
            return Ok(lens);
        };
        let sizes = match self.rules.orientation {
            OrientationRule::Auto => vec![header.size, header.upright_size()],
            OrientationRule::Stored => vec![header.size],
            OrientationRule::Upright => vec![header.upright_size()],
        };
        let Some(to) = sizes.into_iter().find(|to| is_same_ratio(from, *to)) else {
            return Ok(lens);
        };
        if to == from {
            return Ok(lens);
        }
        *self.scaled.entry((from, to)).or_default() += 1;
        let x = f64::from(to.0) / f64::from(from.0);
        let y = f64::from(to.1) / f64::from(from.1);
        let (focal, center) = ((k.fx * x, k.fy * y), (k.cx * x, k.cy * y));
        Lens::new(focal, center, to, lens.distortion())
            .map_err(|source| DatasetError::camera(image, source))
    }

    /// Notes on the scaled cameras, one for each pair of sizes.
    pub(crate) fn notes(&self) -> Vec<String> {
        self.scaled
            .iter()
            .map(|((from, to), count)| {
                format!(
                    "{}: {count} camera(s) calibrated for {}x{} were scaled to the pictures' size, {}x{}",
                    self.file.display(),
                    from.0,
                    from.1,
                    to.0,
                    to.1
                )
            })
            .collect()
    }
}

/// Rejects a picture whose size differs from its camera's. If both axes differ by the same ratio,
/// the error suggests [`CAMERA_SIZE`] or, for formats without that setting, other files.
pub(crate) fn check_size(
    path: &Path,
    found: PixelSize,
    expected: PixelSize,
    has_setting: bool,
) -> Result<(), DatasetError> {
    mask::check_size(path, found, expected).map_err(|error| match error {
        DatasetError::Malformed { path, reason } if is_same_ratio(expected, found) => {
            let helps = if has_setting {
                "set camera-size=scaled to scale the camera"
            } else {
                "use pictures of the camera's size, or a calibration for this size"
            };
            let reason = format!("{reason} (the ratio is the same on both axes); {helps}");
            DatasetError::malformed(path, reason)
        }
        error => error,
    })
}

/// True if a single factor maps one size to the other, with both new sides rounded to whole pixels in the same way:
/// down, or to the nearest.
fn is_same_ratio(from: PixelSize, to: PixelSize) -> bool {
    let ([w, h], [v, u]) = (
        [from.0, from.1].map(i128::from),
        [to.0, to.1].map(i128::from),
    );
    // For each axis, the factors that give the new side form an interval. The intervals of both
    // axes must overlap.
    let down = v * h < (u + 1) * w && u * w < (v + 1) * h;
    let nearest = (2 * v - 1) * h <= (2 * u + 1) * w && (2 * u - 1) * w <= (2 * v + 1) * h;
    down || nearest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Distortion;

    #[test]
    fn the_ratio_must_be_that_of_both_axes() {
        for (from, to, same) in [
            ((160, 120), (80, 60), true),
            ((160, 120), (320, 240), true),
            // Half the size, rounded down; a third, rounded to nearest.
            ((1921, 1081), (960, 540), true),
            ((1921, 1081), (640, 360), true),
            ((160, 120), (80, 61), false),
            ((160, 120), (120, 160), false),
            ((160, 120), (160, 119), false),
            ((6048, 4032), (6198, 4129), false),
            ((u32::MAX, 1), (1, u32::MAX), false),
        ] {
            assert_eq!(is_same_ratio(from, to), same, "{from:?} {to:?}");
        }
    }

    #[test]
    fn scaled_cameras_are_those_of_the_smaller_picture() {
        let folder = tempfile::tempdir().unwrap();
        let image = folder.path().join("a.png");
        image::RgbImage::new(80, 60).save(&image).unwrap();
        let distortion = Distortion::perspective("RADIAL", &[-0.1, 0.02], [0.0; 2]);
        let lens = |s: f64, size| {
            Lens::new(
                (150.0 * s, 151.0 * s),
                (81.0 * s, 59.5 * s),
                size,
                distortion,
            )
            .unwrap()
        };
        let spec = |settings: &str| {
            let spec = DatasetSpec::parse(&format!("colmap=x{settings}")).unwrap();
            CameraSizes::new(&spec, Path::new("c.txt"))
        };
        let mut scaled = spec(",camera-size=scaled");
        let found = scaled.fit(lens(1.0, (160, 120)), &image).unwrap();
        assert_eq!(found, lens(0.5, (80, 60)));
        assert_eq!(
            scaled.notes(),
            ["c.txt: 1 camera(s) calibrated for 160x120 were scaled to the pictures' size, 80x60"]
        );
        let other = lens(1.0, (160, 100));
        assert_eq!(scaled.fit(other, &image).unwrap(), other);
        let mut exact = spec("");
        let large = lens(1.0, (160, 120));
        assert_eq!(exact.fit(large, &image).unwrap(), large);
        assert!(exact.notes().is_empty());
    }

    #[test]
    fn the_error_names_the_setting_where_it_would_help() {
        let error_of = |found, has_setting| {
            check_size(Path::new("a.png"), found, (160, 120), has_setting)
                .unwrap_err()
                .to_string()
        };
        let error = |found| error_of(found, true);
        let helped = error((80, 60));
        assert!(
            helped.starts_with("a.png: is 80x60, but its camera is for 160x120 pixels (the ratio")
        );
        assert!(helped.contains("camera-size=scaled"), "{helped}");
        let without = error_of((80, 60), false);
        assert!(
            without.ends_with("or a calibration for this size"),
            "{without}"
        );
        assert_eq!(
            error((80, 80)),
            "a.png: is 80x80, but its camera is for 160x120 pixels"
        );
    }
}
