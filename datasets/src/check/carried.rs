//! One view's depth and colours, carried into another view by a pose.

use glam::DVec2;
use image::{GrayImage, RgbImage};
use sharp::camera::RigidTransform;

use crate::{DepthMap, View};

/// Depth values of a view that are carried over.
const SAMPLES: usize = 20_000;
/// Relative difference up to which depths agree.
const TOLERANCE: f64 = 0.05;
/// Fewer depths that meet say nothing about a pair.
const ENOUGH: f64 = 0.05;

/// A view with its pixels.
pub(super) struct LoadedView<'a> {
    view: &'a View,
    depth: DepthMap,
    picture: RgbImage,
    /// 255 where a pixel is valid; `None` where all are.
    valid: Option<GrayImage>,
}

impl<'a> LoadedView<'a> {
    /// `None` for a view without depth, or of which something cannot be read.
    pub(super) fn new(view: &'a View) -> Option<Self> {
        Some(Self {
            view,
            depth: view.content.depth().ok()??,
            picture: view.content.image().ok()?,
            valid: view.content.valid_pixels().ok()?,
        })
    }

    /// The colour at a place in the picture, between pixel centres; the border is repeated. `None` where a mask excludes
    /// one of the pixels.
    fn colour(&self, place: DVec2) -> Option<[f64; 3]> {
        let (width, height) = self.picture.dimensions();
        let taps = |at: f64, n: u32| {
            let at = (at - 0.5).clamp(0.0, f64::from(n - 1));
            let first = at as u32;
            (first, (first + 1).min(n - 1), at - f64::from(first))
        };
        let (x0, x1, fx) = taps(place.x, width);
        let (y0, y1, fy) = taps(place.y, height);
        let corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)];
        if let Some(valid) = &self.valid
            && corners
                .iter()
                .any(|&(x, y)| valid.get_pixel(x, y).0[0] < 255)
        {
            return None;
        }
        Some(std::array::from_fn(|channel| {
            let at = |x, y| f64::from(self.picture.get_pixel(x, y).0[channel]);
            let top = at(x0, y0) * (1.0 - fx) + at(x1, y0) * fx;
            let bottom = at(x0, y1) * (1.0 - fx) + at(x1, y1) * fx;
            top * (1.0 - fy) + bottom * fy
        }))
    }
}

/// What became of one view's depth values in another view.
#[derive(Debug, Default, Clone)]
pub(super) struct Carried {
    pub(super) samples: usize,
    /// The other view's depth over the one carried there, where it has any.
    ratios: Vec<f64>,
    /// Values whose colour could be compared: they land inside, and no depth there contradicts.
    pub(super) compared: usize,
    /// Of these: the sum of squared differences over three channels, levels².
    pub(super) squares: f64,
}

impl Carried {
    /// Carries a's sampled depth values into b; `None` when a has none.
    pub(super) fn between(
        a: &LoadedView<'_>,
        b: &LoadedView<'_>,
        b_from_a: &RigidTransform,
    ) -> Option<Self> {
        let valid = a.depth.iter().filter(|z| **z > 0.0).count();
        let stride = valid.div_ceil(SAMPLES).max(1);
        let mut carried = Self::default();
        let with_depth = a.depth.enumerate_pixels().filter(|(_, _, z)| z.0[0] > 0.0);
        for (x, y, z) in with_depth.step_by(stride) {
            carried.samples += 1;
            let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let point = b_from_a.apply(a.view.intrinsics.unproject(centre, f64::from(z.0[0])));
            let Some(place) = b.view.intrinsics.project(point) else {
                continue;
            };
            if !b.view.intrinsics.contains(place) {
                continue;
            }
            let there = f64::from(b.depth.get_pixel(place.x as u32, place.y as u32).0[0]);
            if there > 0.0 {
                carried.ratios.push(there / point.z);
                if !agrees(there / point.z) {
                    continue;
                }
            }
            let Some(there) = b.colour(place) else {
                continue;
            };
            let here = a.picture.get_pixel(x, y).0;
            carried.compared += 1;
            for (one, other) in here.into_iter().zip(there) {
                carried.squares += (f64::from(one) - other).powi(2);
            }
        }
        (carried.samples > 0).then_some(carried)
    }

    fn agreeing(&self) -> usize {
        self.ratios.iter().filter(|ratio| agrees(**ratio)).count()
    }

    /// The share of all samples whose depth agrees.
    pub(super) fn agreement(&self) -> f64 {
        self.agreeing() as f64 / self.samples as f64
    }

    /// The share of those that meet a depth, and the median ratio; `None` where too few do.
    pub(super) fn agreeing_where_met(&self) -> Option<(f64, f64)> {
        let met = self.ratios.len();
        if (met as f64) < ENOUGH * self.samples as f64 || met == 0 {
            return None;
        }
        let mut sorted = self.ratios.clone();
        sorted.sort_by(f64::total_cmp);
        Some((self.agreeing() as f64 / met as f64, sorted[met / 2]))
    }
}

fn agrees(ratio: f64) -> bool {
    (ratio - 1.0).abs() <= TOLERANCE
}
