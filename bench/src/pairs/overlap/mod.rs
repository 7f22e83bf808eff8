//! Share of one view that is visible in another.
//!
//! The paper selects pairs by "depth overlap" above 60 % without defining it. Here overlap has a direction: the pixels
//! of one view are unprojected by their depth and projected into the other view, where each counts as seen or not.
//! Arithmetic is in f64 and the result is a count, so it depends neither on the number of threads nor on the order of
//! pixels.

use clap::ValueEnum;
use glam::{DAffine3, DVec3};
use image::Luma;
use rayon::prelude::*;

use super::depth::PosedDepth;
use super::valid_depth::is_valid_depth;

/// Condition for a projected pixel to count as seen. In addition, its point must be in front of the other camera and
/// project into that camera's image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OverlapTest {
    Frustum,
    /// The other view's depth at the projected position differs by at most `relative · z` from the projected z.
    Consistent {
        /// Tolerance as a share of z.
        relative: f64,
    },
    /// The other view's depth at the projected position differs by less than `absolute_m + relative · z` from the
    /// projected z, and z exceeds `min_depth_m`. [`Self::MAP_ANYTHING`] has the values of MapAnything's covisibility.
    AbsoluteRelative {
        /// Tolerance, in metres.
        absolute_m: f64,
        /// Tolerance as a share of z.
        relative: f64,
        /// Minimum depth to count as seen, in metres.
        min_depth_m: f64,
    },
}

impl OverlapTest {
    /// `|D − z| < 0.1 + 0.005 z − ln(0.5) · 0.1` and `z > 0.04`, where `z` is the projected depth and `D` the other
    /// view's depth there.
    pub const MAP_ANYTHING: Self = Self::AbsoluteRelative {
        absolute_m: 0.1 + std::f64::consts::LN_2 * 0.1,
        relative: 0.005,
        min_depth_m: 0.04,
    };
}

/// Lookup of the other view's depth at a projected position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DepthLookup {
    /// The pixel that contains the position.
    Nearest,
    /// Interpolation between the four surrounding pixel centres, with the border repeated. If any of the four is
    /// invalid, the projected pixel counts as unseen.
    Bilinear,
    /// All valid pixels within this many rows and columns of the pixel that contains the position, of which one must
    /// agree. For sparse depth, where few pixels have a value.
    #[value(skip)]
    Window { radius: u32 },
}

/// Denominator of the share of pixels that are seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Denominator {
    /// Pixels with valid depth in the projected view.
    Valid,
    /// All pixels of the projected view.
    All,
    /// Pixels with valid depth in the view projected into; the share may exceed 1.
    ValidOther,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverlapOptions {
    pub test: OverlapTest,
    pub lookup: DepthLookup,
    pub denominator: Denominator,
    /// Projects every `stride`-th pixel of every `stride`-th row, starting at `stride / 2`. `stride` is at least 1.
    pub stride: u32,
    /// Depth maps are first reduced to this longer side, in pixels; see [`PosedDepth::reduced`]. `None` keeps their
    /// size.
    pub max_side: Option<u32>,
}

impl Default for OverlapOptions {
    /// Depths agree if they differ by at most 5 % at the nearest pixel. All pixels with valid depth are projected, at
    /// full size, and form the denominator.
    fn default() -> Self {
        Self {
            test: OverlapTest::Consistent { relative: 0.05 },
            lookup: DepthLookup::Nearest,
            denominator: Denominator::Valid,
            stride: 1,
            max_side: None,
        }
    }
}

/// Counts from projecting one view's pixels into another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OverlapCounts {
    /// Projected pixels that are visible in the other view.
    pub seen: u64,
    /// Projected pixels, which all have valid depth.
    pub valid: u64,
    /// All pixels of the projected view that the stride selects.
    pub pixels: u64,
    /// Pixels of the other view that have valid depth and that the stride selects; 0 unless [`Denominator::ValidOther`]
    /// is used.
    pub valid_other: u64,
}

impl OverlapCounts {
    /// The share of pixels that are seen; `None` if the denominator is 0.
    pub fn share(&self, denominator: Denominator) -> Option<f64> {
        let by = match denominator {
            Denominator::Valid => self.valid,
            Denominator::All => self.pixels,
            Denominator::ValidOther => self.valid_other,
        };
        (by > 0 && self.valid > 0).then(|| self.seen as f64 / by as f64)
    }
}

/// Projects the pixels of `view` into `other` and counts those that are visible there. Ignores
/// [`OverlapOptions::max_side`], which the caller must have applied.
///
/// By default, the overlap of an ordered pair (source, target) is `overlap(target, source)`.
pub fn overlap(view: &PosedDepth, other: &PosedDepth, options: &OverlapOptions) -> OverlapCounts {
    let projection = Projection::new(view, other);
    let step = options.stride.max(1) as usize;
    let (width, height) = view.depth().dimensions();
    let columns = || (step / 2..width as usize).step_by(step);
    let mut counts = (step / 2..height as usize)
        .into_par_iter()
        .step_by(step)
        .map(|y| {
            let row = row_of(view, y);
            let mut counts = OverlapCounts::default();
            for x in columns() {
                counts.pixels += 1;
                let depth = row[x];
                if is_valid_depth(depth) {
                    counts.valid += 1;
                    let point = projection.apply(x, y, f64::from(depth));
                    counts.seen += u64::from(is_seen(point, other, options));
                }
            }
            counts
        })
        .reduce(OverlapCounts::default, |a, b| OverlapCounts {
            seen: a.seen + b.seen,
            valid: a.valid + b.valid,
            pixels: a.pixels + b.pixels,
            valid_other: 0,
        });
    if options.denominator == Denominator::ValidOther {
        counts.valid_other = count_valid(other, step);
    }
    counts
}

/// For each pixel of `view`, row by row, whether it is visible in `other`; false where depth is invalid. Ignores the
/// stride.
pub fn seen_mask(view: &PosedDepth, other: &PosedDepth, options: &OverlapOptions) -> Vec<bool> {
    let projection = Projection::new(view, other);
    let (width, height) = view.depth().dimensions();
    (0..height as usize)
        .into_par_iter()
        .flat_map_iter(|y| {
            let row = row_of(view, y);
            let projection = &projection;
            (0..width as usize).map(move |x| {
                is_valid_depth(row[x])
                    && is_seen(projection.apply(x, y, f64::from(row[x])), other, options)
            })
        })
        .collect()
}

fn row_of(view: &PosedDepth, y: usize) -> &[f32] {
    let width = view.depth().width() as usize;
    &view.depth().as_raw()[y * width..(y + 1) * width]
}

fn count_valid(view: &PosedDepth, step: usize) -> u64 {
    let (width, height) = view.depth().dimensions();
    (step / 2..height as usize)
        .step_by(step)
        .map(|y| {
            let row = row_of(view, y);
            let valid = (step / 2..width as usize)
                .step_by(step)
                .filter(|&x| is_valid_depth(row[x]));
            valid.count() as u64
        })
        .sum()
}

/// The map from pixel and depth of one view to homogeneous pixels `(u z, v z, z)` of another.
pub(crate) struct Projection(DAffine3);

impl Projection {
    pub(crate) fn new(view: &PosedDepth, other: &PosedDepth) -> Self {
        let other_from_view = other
            .camera_from_world()
            .after(&view.camera_from_world().inverse());
        let k = other.intrinsics().matrix();
        Self(DAffine3::from_mat3_translation(
            k * other_from_view.rotation * view.intrinsics().matrix().inverse(),
            k * other_from_view.translation,
        ))
    }

    pub(crate) fn apply(&self, x: usize, y: usize, depth: f64) -> DVec3 {
        let centre = DVec3::new(x as f64 + 0.5, y as f64 + 0.5, 1.0);
        self.0.transform_point3(centre * depth)
    }
}

fn is_seen(point: DVec3, other: &PosedDepth, options: &OverlapOptions) -> bool {
    let z = point.z;
    if z <= 0.0 {
        return false;
    }
    let (u, v) = (point.x / z, point.y / z);
    let (width, height) = other.depth().dimensions();
    if !(u >= 0.0 && v >= 0.0 && u < f64::from(width) && v < f64::from(height)) {
        return false;
    }
    let agrees = |depth: f64| match options.test {
        OverlapTest::Frustum => true,
        OverlapTest::Consistent { relative } => (depth - z).abs() <= relative * z,
        OverlapTest::AbsoluteRelative {
            absolute_m,
            relative,
            min_depth_m,
        } => z > min_depth_m && (depth - z).abs() < absolute_m + relative * z,
    };
    if options.test == OverlapTest::Frustum {
        return true;
    }
    match options.lookup {
        DepthLookup::Nearest => {
            let Luma([depth]) = *other.depth().get_pixel(u as u32, v as u32);
            is_valid_depth(depth) && agrees(f64::from(depth))
        }
        DepthLookup::Bilinear => sample_bilinear(other, u, v).is_some_and(agrees),
        DepthLookup::Window { radius } => {
            let (column, row) = (u as u32, v as u32);
            let last_row = row.saturating_add(radius).min(height - 1);
            let columns = column.saturating_sub(radius) as usize
                ..=column.saturating_add(radius).min(width - 1) as usize;
            (row.saturating_sub(radius)..=last_row).any(|y| {
                row_of(other, y as usize)[columns.clone()]
                    .iter()
                    .any(|&depth| is_valid_depth(depth) && agrees(f64::from(depth)))
            })
        }
    }
}

/// Depth interpolated between the four surrounding pixel centres, with the border repeated; `None` if any of the four
/// is invalid. `u` and `v` must lie inside the image.
fn sample_bilinear(view: &PosedDepth, u: f64, v: f64) -> Option<f64> {
    let (width, height) = view.depth().dimensions();
    let taps = |at: f64, n: u32| {
        let first = (at - 0.5).floor();
        let clamp = |i: f64| i.clamp(0.0, f64::from(n - 1)) as u32;
        (clamp(first), clamp(first + 1.0), at - 0.5 - first)
    };
    let (x0, x1, fx) = taps(u, width);
    let (y0, y1, fy) = taps(v, height);
    let tap = |x, y| {
        let Luma([depth]) = *view.depth().get_pixel(x, y);
        is_valid_depth(depth).then(|| f64::from(depth))
    };
    let top = tap(x0, y0)? * (1.0 - fx) + tap(x1, y0)? * fx;
    let bottom = tap(x0, y1)? * (1.0 - fx) + tap(x1, y1)? * fx;
    Some(top * (1.0 - fy) + bottom * fy)
}

#[cfg(test)]
mod tests;
