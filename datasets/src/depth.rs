//! Ground-truth depth from files: disparity, metric maps, raw floats.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use sharp::resize::nearest;

use crate::depth_map::valid_depth;
use crate::format::{self, FloatMap, raw_floats};
use crate::lens::Lens;
use crate::mask::check_size;
use crate::scan_depth::{ScanFile, points_seen_by};
use crate::setting::{Setting, choice};
use crate::undistort::{Undistortion, ViewGeometry};
use crate::{DatasetError, DatasetSpec, DepthMap, files};

/// Source of a view's depth.
#[derive(Debug)]
pub(crate) enum ViewDepth {
    /// A disparity map of one view of a rectified pair, and the number of pixels of disparity per stored unit: 1, or
    /// 1/256 in a 16-bit PNG.
    Disparity(PathBuf, StereoGeometry, f64),
    /// A map with the geometry of the stored picture.
    Map(PathBuf, DepthEncoding),
    /// A map with the geometry of a camera other than the stored picture's.
    MapOf(PathBuf, DepthEncoding, Lens),
    /// A laser scan or mesh in world coordinates.
    Scan(ScanFile),
    /// Points in world coordinates that the view sees, and the file from which they were read.
    Points(PathBuf, Vec<DVec3>),
}

impl ViewDepth {
    pub(crate) fn file(&self) -> &Path {
        match self {
            Self::Disparity(file, ..)
            | Self::Map(file, _)
            | Self::MapOf(file, ..)
            | Self::Points(file, _) => file,
            Self::Scan(scan) => &scan.file,
        }
    }

    /// File and values of a map that stores depth as z or ray length in whole numbers; `None` for depth stored in any
    /// other way.
    pub(crate) fn stored(
        &self,
        view: &ViewGeometry,
    ) -> Result<Option<(PathBuf, FloatMap)>, DatasetError> {
        let (file, size) = match self {
            Self::Map(file, DepthEncoding::Units(_, DepthKind::Z | DepthKind::Ray)) => {
                (file, view.size)
            }
            Self::MapOf(file, DepthEncoding::Units(_, DepthKind::Z | DepthKind::Ray), lens) => {
                let k = lens.intrinsics();
                (file, (k.width, k.height))
            }
            _ => return Ok(None),
        };
        let fits = |found| check_shape(file, found, size);
        let map = format::read_map_if(file, &fits)?;
        let is_whole = map.iter().all(|v| v.fract() == 0.0);
        Ok(is_whole.then(|| (file.clone(), map)))
    }

    /// Reads the depth map of a view, with the size of the view's pinhole camera.
    pub(crate) fn load(&self, view: &ViewGeometry) -> Result<DepthMap, DatasetError> {
        match self {
            Self::Disparity(file, geometry, unit) => {
                let fits = |size| check_size(file, size, view.size);
                let mut disparity = format::read_map_if(file, &fits)?;
                if *unit != 1.0 {
                    for d in disparity.iter_mut() {
                        *d = (f64::from(*d) * unit) as f32;
                    }
                }
                geometry.depth_map(file, &disparity)
            }
            Self::Map(file, encoding) => {
                let mut depth = encoding.read(file, view.size)?;
                if let DepthEncoding::Units(_, DepthKind::Ray) = encoding {
                    let lens = match &view.undistortion {
                        Some(undistortion) => Some(*undistortion.lens()),
                        None => Lens::of_pinhole(view.pinhole),
                    };
                    for (x, y, z) in depth.enumerate_pixels_mut() {
                        let middle = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                        let ray = lens.and_then(|lens| lens.unproject(middle));
                        let length = ray.map_or(f64::INFINITY, DVec3::length);
                        z.0[0] = valid_depth(f64::from(z.0[0]) / length);
                    }
                }
                Ok(match &view.undistortion {
                    Some(undistortion) => encoding.resampled(&depth, undistortion),
                    None => depth,
                })
            }
            Self::MapOf(file, encoding, lens) => {
                let k = lens.intrinsics();
                let depth = encoding.read(file, (k.width, k.height))?;
                Ok(encoding.resampled(&depth, &Undistortion::new(*lens, view.pinhole)))
            }
            Self::Scan(scan) => scan.seen_by(&view.pinhole, &view.camera_from_world),
            Self::Points(_, points) => {
                let points = points.iter().copied();
                Ok(points_seen_by(
                    &view.pinhole,
                    &view.camera_from_world,
                    points,
                    0,
                ))
            }
        }
    }
}

/// Ratio of negative to positive disparities above which the sign is considered inverted.
const MIN_NEGATIVE_RATIO: u64 = 20;

/// Minimum number of distinct negative disparities for them to count as values rather than marks of invalid pixels.
const MIN_DIFFERENT_NEGATIVES: usize = 8;

/// Reciprocal of the largest fraction of disparities that may give depth behind the cameras. Up to this fraction, such
/// disparities are attributed to noise.
const MAX_BEHIND: u64 = 20;

/// Conversion from disparity to depth: `Z = baseline · f / (d + doffs)`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StereoGeometry {
    /// Focal length in pixels.
    pub(crate) focal: f64,
    /// Distance between the two cameras, in metres.
    pub(crate) baseline_m: f64,
    /// Difference of the principal points, in pixels.
    pub(crate) doffs: f64,
}

impl StereoGeometry {
    /// Depth in metres; 0 if the disparity is zero, not finite or at most `least`, or if its point
    /// would be behind the cameras.
    fn depth(&self, disparity: f32, least: f64) -> f32 {
        let shifted = f64::from(disparity) + self.doffs;
        let is_value = disparity != 0.0 && f64::from(disparity) > least;
        if !disparity.is_finite() || !is_value || shifted <= 0.0 {
            return 0.0;
        }
        valid_depth(self.baseline_m * self.focal / shifted)
    }

    /// Converts a disparity map.
    ///
    /// Rejects a map that has values but no disparity within the picture's width: if the byte order is wrong,
    /// disparities are denormal or astronomical. Also rejects a map whose disparities are nearly all negative, unless
    /// `doffs` makes all their depths positive, as in pictures that were cropped differently. In that case, only a
    /// comparison of the pictures can show whether the disparities were negated.
    fn depth_map(&self, path: &Path, disparity: &FloatMap) -> Result<DepthMap, DatasetError> {
        let widest = f64::from(disparity.width());
        let (mut sane, mut strange, mut negative, mut mark) = (0_u64, 0_u64, 0_u64, None);
        let (mut values, mut lowest) = (BTreeSet::new(), 0.0_f32);
        for &d in disparity.as_raw() {
            // Zero and -1 commonly mark invalid pixels, so they are neither sane nor strange.
            let magnitude = f64::from(d.abs());
            if d.is_finite() && (magnitude >= widest || (magnitude > 0.0 && magnitude < 1e-6)) {
                strange += 1;
            } else if d.is_finite() && d > 0.0 {
                sane += 1;
            } else if d.is_finite() && d < 0.0 {
                // If all negative values are equal, they mark invalid pixels.
                negative += u64::from(d != *mark.get_or_insert(d));
                lowest = lowest.min(d);
                if values.len() < MIN_DIFFERENT_NEGATIVES {
                    values.insert(d.to_bits());
                }
            }
        }
        let are_values =
            values.len() == MIN_DIFFERENT_NEGATIVES && f64::from(lowest) + self.doffs > 0.0;
        let least = if are_values { -widest } else { 0.0 };
        let stored = disparity.as_raw().iter();
        let depth = stored.map(|d| self.depth(*d, least)).collect();
        if negative > MIN_NEGATIVE_RATIO * sane.max(1) && !are_values {
            let least = if self.doffs != 0.0 {
                format!(
                    "above {}, the difference of the principal points",
                    -self.doffs
                )
            } else {
                "positive".to_owned()
            };
            return Err(DatasetError::malformed(
                path,
                format!(
                    "{negative} disparities are negative and {sane} positive, but disparity (x in the left picture \
                     minus x in the right one) must be {least}; perhaps the pictures are swapped or the disparities \
                     are negated"
                ),
            ));
        }
        if sane == 0 && strange > 0 && !are_values {
            return Err(DatasetError::malformed(
                path,
                format!(
                    "none of {strange} disparities lies within the picture's width of {widest} \
                     pixels; perhaps they are in another unit (as in KITTI's 16-bit PNG, 1/256 pixel; with format \
                     stereo, set disparity_unit in rig.txt), they are depths, or the byte order is wrong"
                ),
            ));
        }
        let is_behind = |d: &&f32| **d > 0.0 && f64::from(**d) + self.doffs <= 0.0;
        let behind = disparity.iter().filter(is_behind).count() as u64;
        if sane > 0 && behind * MAX_BEHIND > sane {
            return Err(DatasetError::malformed(
                path,
                format!(
                    "{behind} of {sane} disparities are below {}, so their points would lie behind the cameras; \
                     perhaps the principal points of the two cameras are swapped",
                    -self.doffs
                ),
            ));
        }
        DepthMap::from_vec(disparity.width(), disparity.height(), depth)
            .ok_or_else(|| DatasetError::malformed(path, "the map's size overflows"))
    }
}

/// Meaning of the values in a stored depth map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DepthKind {
    Z,
    Ray,
    Inverse,
}

impl DepthKind {
    pub(crate) const SETTING: Setting = Setting::choice(
        "depth-kind",
        "which quantity the depth maps contain",
        &[
            choice("z", "depth along the camera's axis"),
            choice("ray", "the length of the ray to the point"),
            choice("inverse", "the reciprocal of depth along the axis"),
        ],
    );

    pub(crate) fn of(spec: &DatasetSpec) -> Self {
        match spec.setting(Self::SETTING.key) {
            "ray" => Self::Ray,
            "inverse" => Self::Inverse,
            _ => Self::Z,
        }
    }
}

/// Encoding of a stored depth map, which also determines how it is resampled to the pinhole camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum DepthEncoding {
    /// A self-describing file. The number is the metres per stored unit or, for reciprocals, 1/m
    /// per stored unit. In integer maps, 0 and 65535 mean no depth. Maps are dense, so each pixel
    /// takes the nearest stored value.
    Units(f64, DepthKind),
    /// Headerless f32 values, in metres. The map is sparse, so each sample is projected to its position in the pinhole
    /// view.
    RawFloats,
}

impl DepthEncoding {
    /// Reads z-depth for a photograph that is stored at `size`. A map with the same aspect ratio
    /// but another size is resized by nearest neighbour (phones store depth at a fraction of the
    /// picture's size).
    fn read(self, file: &Path, size: (u32, u32)) -> Result<DepthMap, DatasetError> {
        let (stored, unit_m) = match self {
            Self::Units(unit_m, _) => {
                let fits = |found| check_shape(file, found, size);
                (format::read_map_if(file, &fits)?, unit_m)
            }
            Self::RawFloats => {
                let parse = |bytes: &[u8]| raw_floats::parse(bytes, size);
                (files::parse(file, parse)?, 1.0)
            }
        };
        let whole_numbered = stored.iter().all(|v| *v >= 0.0 && v.fract() == 0.0);
        let mut depth = fit(file, stored, size)?;
        for z in depth.iter_mut() {
            let saturated = whole_numbered && *z == 65535.0;
            let metres = f64::from(*z) * unit_m;
            *z = match self {
                _ if saturated => 0.0,
                Self::Units(_, DepthKind::Inverse) => valid_depth(1.0 / metres),
                _ => valid_depth(metres),
            };
        }
        Ok(depth)
    }

    fn resampled(self, depth: &DepthMap, undistortion: &Undistortion) -> DepthMap {
        match self {
            Self::Units(..) => undistortion.depth_nearest(depth),
            Self::RawFloats => undistortion.depth_splat(depth),
        }
    }
}

/// Maximum ratio of a picture's width to its depth map's. No device stores smaller depth maps, and a small map must not
/// cause a huge allocation.
const LARGEST_FACTOR: f64 = 64.0;
/// Maximum ratio of a depth map's width to its picture's.
const LARGEST_MAP: f64 = 8.0;

/// Rejects a map whose aspect ratio differs from the picture's, or whose size differs too much.
fn check_shape(path: &Path, found: (u32, u32), size: (u32, u32)) -> Result<(), DatasetError> {
    let (w, h) = (f64::from(found.0), f64::from(found.1));
    let width = f64::from(size.0);
    // Rounding may make the other side differ by one pixel from the exact ratio.
    let other = w * f64::from(size.1) / width;
    let other_size = w * LARGEST_FACTOR < width || w > LARGEST_MAP * width;
    if other_size || (other - h).abs() > 1.0 {
        check_size(path, found, size)?;
    }
    Ok(())
}

/// Resizes a map with the picture's aspect ratio to the picture's size.
fn fit(path: &Path, map: FloatMap, size: (u32, u32)) -> Result<DepthMap, DatasetError> {
    if map.dimensions() == size {
        return Ok(map);
    }
    let side = |(width, height): (u32, u32)| (width as usize, height as usize);
    let depth = nearest(map.as_raw(), side(map.dimensions()), side(size));
    DepthMap::from_vec(size.0, size.1, depth)
        .ok_or_else(|| DatasetError::malformed(path, "the map's size overflows"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{depth_png, npy};

    const RIG: StereoGeometry = StereoGeometry {
        focal: 1000.0,
        baseline_m: 0.2,
        doffs: 30.0,
    };

    #[test]
    fn disparity_becomes_metric_depth() {
        assert_eq!(RIG.depth(20.0, 0.0), 4.0);
        for invalid in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(RIG.depth(invalid, 0.0), 0.0);
        }
        assert_eq!(RIG.depth(-10.0, -24.0), 10.0);
        assert_eq!(RIG.depth(0.0, -24.0), 0.0);
        let negative_offset = StereoGeometry {
            doffs: -30.0,
            ..RIG
        };
        assert_eq!(negative_offset.depth(20.0, 0.0), 0.0);
    }

    /// The right picture was cropped, so that the farthest points have negative disparities.
    #[test]
    fn an_offset_makes_negative_disparities_valid() {
        let path = Path::new("d.pfm");
        let read = |doffs: f64, from: i32| {
            let map = FloatMap::from_vec(40, 1, (from..from + 40).map(|d| d as f32).collect());
            let rig = StereoGeometry { doffs, ..RIG };
            let depth = rig.depth_map(path, &map.unwrap()).unwrap().into_raw();
            depth.into_iter().filter(|z| *z > 0.0).count()
        };
        // All values except 0.
        assert_eq!(read(30.0, -12), 39);
        assert_eq!(read(0.0, -12), 27);
        // With few negative values, they are invalid-pixel marks or points behind the cameras.
        assert_eq!(read(30.0, -3), 36);
        assert_eq!(read(9.0, -12), 27);
    }

    #[test]
    fn disparities_in_the_wrong_byte_order_are_noticed() {
        let path = Path::new("d.pfm");
        let swapped = |v: f32| f32::from_bits(v.to_bits().swap_bytes());
        let map =
            FloatMap::from_vec(3, 1, vec![swapped(1.7), swapped(2.2), f32::INFINITY]).unwrap();
        let error = RIG.depth_map(path, &map).unwrap_err().to_string();
        assert!(error.contains("byte order"), "{error}");
        let negated = FloatMap::from_vec(24, 1, (1..25).map(|d| -d as f32).collect()).unwrap();
        for (doffs, least) in [(0.0, "positive; "), (20.0, "above -20, ")] {
            let rig = StereoGeometry { doffs, ..RIG };
            let error = rig.depth_map(path, &negated).unwrap_err().to_string();
            assert!(
                error.contains("22 disparities are negative and 0 positive")
                    && error.contains(&format!("must be {least}")),
                "{error}"
            );
        }
        // The offset makes all depths positive.
        let depth = RIG.depth_map(path, &negated).unwrap().into_raw();
        assert_eq!(depth.iter().filter(|z| **z > 0.0).count(), 23);
        let swapped = StereoGeometry {
            doffs: -10.0,
            ..RIG
        };
        let below = |d: f32| {
            let map = FloatMap::from_vec(24, 1, [vec![d; 2], vec![20.0; 22]].concat());
            swapped.depth_map(path, &map.unwrap())
        };
        let error = below(8.0).unwrap_err().to_string();
        assert!(
            error.contains("2 of 24 disparities are below 10"),
            "{error}"
        );
        assert!(below(12.0).is_ok());
        let marked = FloatMap::from_vec(24, 1, vec![-2.0; 24]).unwrap();
        assert!(RIG.depth_map(path, &marked).is_ok());
        let unknown = FloatMap::from_vec(3, 1, vec![f32::INFINITY, 0.0, -1.0]).unwrap();
        assert_eq!(
            RIG.depth_map(path, &unknown).unwrap().as_raw(),
            &[0.0, 0.0, 0.0]
        );
    }

    const MILLIMETRES: DepthEncoding = DepthEncoding::Units(0.001, DepthKind::Z);

    #[test]
    fn units_invalid_marks_and_small_maps() {
        let folder = tempfile::tempdir().unwrap();
        let png = folder.path().join("d.png");
        let map = FloatMap::from_vec(2, 2, vec![0.0, 1500.0, 65535.0, 65534.0]).unwrap();
        depth_png::write(&png, &map).unwrap();
        let depth = MILLIMETRES.read(&png, (2, 2)).unwrap();
        assert_eq!(depth.as_raw(), &[0.0, 1.5, 0.0, 65.534]);
        let larger = MILLIMETRES.read(&png, (4, 4)).unwrap();
        assert_eq!(larger.get_pixel(3, 1).0[0], 1.5);
        let error = MILLIMETRES.read(&png, (8, 2)).unwrap_err().to_string();
        assert!(error.contains("2x2"), "{error}");

        let npy = folder.path().join("d.npy");
        let map = FloatMap::from_vec(2, 2, vec![f32::NAN, -1.0, f32::INFINITY, 250.5]).unwrap();
        npy::write(&npy, &map).unwrap();
        let depth = MILLIMETRES.read(&npy, (2, 2)).unwrap();
        assert_eq!(depth.as_raw(), &[0.0, 0.0, 0.0, 0.2505]);
    }
}
