//! Resampling of pictures and depth from a camera with a lens to a pinhole camera.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use glam::{DVec2, DVec3};
use image::{GrayImage, ImageBuffer, Luma, Pixel, Rgb, RgbImage};
use rayon::prelude::*;
use sharp::camera::{Intrinsics, RigidTransform};

use crate::DepthMap;
use crate::lens::{Lens, LensError};

/// Geometry of a view, from its stored picture to its pinhole camera and pose.
#[derive(Debug)]
pub(crate) struct ViewGeometry {
    /// Size of the stored picture according to the camera, before resampling.
    pub(crate) size: (u32, u32),
    /// Mapping from the lens to the pinhole camera; `None` if the lens has no distortion.
    pub(crate) undistortion: Option<Undistortion>,
    pub(crate) pinhole: Intrinsics,
    pub(crate) camera_from_world: RigidTransform,
}

/// A lens and the pinhole camera to which its pictures are resampled; both look along the same axis.
#[derive(Debug, Clone, Copy)]
pub struct Undistortion {
    lens: Lens,
    pinhole: Intrinsics,
    rule: &'static str,
}

impl Undistortion {
    /// Resamples `lens` to the given pinhole camera, of any size.
    pub fn new(lens: Lens, pinhole: Intrinsics) -> Self {
        Self {
            lens,
            pinhole,
            rule: "a given pinhole camera",
        }
    }

    /// Resamples to a pinhole camera of the same size and principal point: the one with the widest
    /// field of view that shows nothing beyond the stored picture (COLMAP's `blank_pixels = 0`).
    ///
    /// # Errors
    /// [`LensError::NoWholePinhole`] if even the narrowest pinhole view has blank pixels.
    pub fn without_blank_pixels(lens: Lens) -> Result<Self, LensError> {
        let scaled = |zoom: f64| Intrinsics {
            fx: lens.intrinsics().fx * zoom,
            fy: lens.intrinsics().fy * zoom,
            ..lens.intrinsics()
        };
        // Zoom is quantised to 1/4096, so that the last bits of atan do not affect the result.
        let (mut narrow, mut wide) = (16 * 4096_u32, 512_u32);
        if !shows_only_the_picture(&lens, &scaled(f64::from(narrow) / 4096.0)) {
            return Err(LensError::NoWholePinhole);
        }
        while narrow - wide > 1 {
            let middle = wide.midpoint(narrow);
            if shows_only_the_picture(&lens, &scaled(f64::from(middle) / 4096.0)) {
                narrow = middle;
            } else {
                wide = middle;
            }
        }
        Ok(Self {
            lens,
            pinhole: scaled(f64::from(narrow) / 4096.0),
            rule: "the widest pinhole camera without blank pixels",
        })
    }

    /// The pinhole camera to which ScanNet++'s toolbox resamples its fisheye pictures: OpenCV's
    /// `estimateNewCameraMatrixForUndistortRectify` with balance 0, and the principal point moved to the centre of the
    /// picture.
    ///
    /// # Errors
    /// [`LensError::EdgesUnseen`] if the midpoints of the picture's edges are outside the lens's field of view.
    pub fn like_scannetpp(lens: Lens) -> Result<Self, LensError> {
        let k = lens.intrinsics();
        let (w, h) = (f64::from(k.width), f64::from(k.height));
        // OpenCV halves the size by integer division.
        let (middle_x, middle_y) = (f64::from(k.width / 2), f64::from(k.height / 2));
        let aspect = k.fx / k.fy;
        let mut edges = [DVec2::ZERO; 4];
        for (edge, pixel) in edges.iter_mut().zip([
            DVec2::new(middle_x, 0.0),
            DVec2::new(w, middle_y),
            DVec2::new(middle_x, h),
            DVec2::new(0.0, middle_y),
        ]) {
            let ray = lens.unproject(pixel).ok_or(LensError::EdgesUnseen)?;
            *edge = DVec2::new(ray.x, ray.y * aspect);
        }
        let center = edges.iter().sum::<DVec2>() / 4.0;
        let low = edges.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let high = edges.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let half = DVec2::new(w, h * aspect) * 0.5;
        let focal = (half / (center - low))
            .max_element()
            .max((half / (high - center)).max_element());
        let pinhole = Intrinsics::new(
            (focal, focal / aspect),
            (w / 2.0, h / 2.0),
            (k.width, k.height),
        )?;
        Ok(Self {
            lens,
            pinhole,
            rule: "the pinhole camera of ScanNet++'s toolbox (balance 0, principal point in the middle)",
        })
    }

    /// Camera of the resampled pictures.
    pub fn pinhole(&self) -> &Intrinsics {
        &self.pinhole
    }

    /// Rule by which the pinhole camera was chosen, for notes.
    pub fn rule(&self) -> &'static str {
        self.rule
    }

    /// Camera of the stored pictures.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// Resamples a photograph bilinearly. Beyond its border, the photograph is mirrored about the
    /// outermost pixels (OpenCV's `BORDER_REFLECT_101`). Pixels that the lens does not see are
    /// black.
    pub fn image(&self, stored: &RgbImage) -> RgbImage {
        let size = (i64::from(stored.width()), i64::from(stored.height()));
        self.gathered(|place| {
            let Some(place) = place else {
                return Rgb([0; 3]);
            };
            let floor = (place - 0.5).floor();
            let blend = place - 0.5 - floor;
            let xs = [0, 1].map(|i| mirror(floor.x as i64 + i, size.0));
            let ys = [0, 1].map(|i| mirror(floor.y as i64 + i, size.1));
            let at = |i: usize, j: usize| stored.get_pixel(xs[i], ys[j]).0;
            let corners = [
                (at(0, 0), (1.0 - blend.x) * (1.0 - blend.y)),
                (at(1, 0), blend.x * (1.0 - blend.y)),
                (at(0, 1), (1.0 - blend.x) * blend.y),
                (at(1, 1), blend.x * blend.y),
            ];
            Rgb([0, 1, 2].map(|c| {
                let sum: f64 = corners.iter().map(|(p, w)| f64::from(p[c]) * w).sum();
                (sum + 0.5) as u8
            }))
        })
    }

    /// Resamples a dense depth map to the nearest stored value; depths are never blended. z-depth does not change,
    /// because both cameras look along the same axis.
    pub fn depth_nearest(&self, stored: &DepthMap) -> DepthMap {
        let (w, h) = stored.dimensions();
        let inside =
            |p: &DVec2| p.x >= 0.0 && p.y >= 0.0 && p.x < f64::from(w) && p.y < f64::from(h);
        self.gathered(|place| {
            let place = place.filter(inside);
            place.map_or(Luma([0.0]), |p| *stored.get_pixel(p.x as u32, p.y as u32))
        })
    }

    /// Resamples a mask as in ScanNet++'s toolbox: bilinearly, with 255 beyond its border. Values
    /// below 255 then become zero, as do pixels that the lens does not see.
    pub fn mask(&self, stored: &GrayImage) -> GrayImage {
        let (w, h) = (i64::from(stored.width()), i64::from(stored.height()));
        let lack = |x: i64, y: i64| {
            let inside = x >= 0 && y >= 0 && x < w && y < h;
            let value = inside.then(|| stored.get_pixel(x as u32, y as u32).0[0]);
            f64::from(255 - value.unwrap_or(255))
        };
        self.gathered(|place| {
            let Some(place) = place else {
                return Luma([0]);
            };
            let floor = (place - 0.5).floor();
            let blend = place - 0.5 - floor;
            let (x, y) = (floor.x as i64, floor.y as i64);
            let above = lack(x, y) * (1.0 - blend.x) + lack(x + 1, y) * blend.x;
            let below = lack(x, y + 1) * (1.0 - blend.x) + lack(x + 1, y + 1) * blend.x;
            // Values are rounded to integer levels, and 254.5 to the even 254.
            let whole = above * (1.0 - blend.y) + below * blend.y < 0.5;
            Luma([if whole { 255 } else { 0 }])
        })
    }

    /// Projects each valid pixel of a sparse depth map to its new position; if several land on one
    /// pixel, the smallest depth counts. Unlike [`Self::depth_nearest`], this loses no samples when
    /// the picture shrinks.
    pub fn depth_splat(&self, stored: &DepthMap) -> DepthMap {
        let (width, height) = (self.pinhole.width, self.pinhole.height);
        // For positive floats, the bits have the same order as the values.
        let nothing = f32::INFINITY.to_bits();
        let mut nearest = Vec::new();
        nearest.resize_with(width as usize * height as usize, || AtomicU32::new(nothing));
        stored
            .par_chunks_exact(stored.width() as usize)
            .zip(0..stored.height())
            .for_each(|(row, y)| {
                for (&z, x) in row.iter().zip(0_u32..).filter(|(z, _)| **z > 0.0) {
                    let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let ray = self.lens.unproject(center);
                    let place = ray.and_then(|ray| self.pinhole.project(ray));
                    if let Some(place) = place.filter(|place| self.pinhole.contains(*place)) {
                        let pixel = place.y as usize * width as usize + place.x as usize;
                        nearest[pixel].fetch_min(z.to_bits(), Relaxed);
                    }
                }
            });
        // Collected in place, because both types take four bytes.
        let depths = nearest.into_iter().map(AtomicU32::into_inner);
        let depths = depths.map(|bits| {
            if bits == nothing {
                0.0
            } else {
                f32::from_bits(bits)
            }
        });
        DepthMap::from_vec(width, height, depths.collect()).unwrap_or_default()
    }

    /// The pinhole picture. `pixel` computes each pixel from its position in the stored picture, or from `None` if the
    /// lens does not see it.
    fn gathered<P>(
        &self,
        pixel: impl Fn(Option<DVec2>) -> P + Sync,
    ) -> ImageBuffer<P, Vec<P::Subpixel>>
    where
        P: Pixel,
        P::Subpixel: Send,
    {
        let channels = usize::from(P::CHANNEL_COUNT);
        let mut picture = ImageBuffer::new(self.pinhole.width, self.pinhole.height);
        picture
            .par_chunks_exact_mut(self.pinhole.width as usize * channels)
            .zip(0..self.pinhole.height)
            .for_each(|(row, y)| {
                for (into, x) in row.chunks_exact_mut(channels).zip(0..) {
                    into.copy_from_slice(pixel(self.stored_place(x, y)).channels());
                }
            });
        picture
    }

    /// Position of a pinhole pixel's centre in the stored picture (pixels, corner convention); `None` if the lens does
    /// not see it.
    pub fn stored_place(&self, x: u32, y: u32) -> Option<DVec2> {
        let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        self.lens
            .project_unfolded(self.pinhole.unproject(center, 1.0))
    }
}

/// Mirrors an index about the first and last pixel, as often as needed.
fn mirror(i: i64, size: i64) -> u32 {
    let period = (2 * (size - 1)).max(1);
    let i = i.rem_euclid(period);
    u32::try_from(i.min(period - i).min(size - 1)).unwrap_or(0)
}

/// True if every point of the pinhole picture's border is inside the stored picture.
fn shows_only_the_picture(lens: &Lens, pinhole: &Intrinsics) -> bool {
    let (w, h) = (f64::from(pinhole.width), f64::from(pinhole.height));
    (0..=256).all(|i| {
        let t = f64::from(i) / 256.0;
        [
            DVec2::new(t * w, 0.0),
            DVec2::new(t * w, h),
            DVec2::new(0.0, t * h),
            DVec2::new(w, t * h),
        ]
        .into_iter()
        .all(|pixel| {
            let ray: DVec3 = pinhole.unproject(pixel, 1.0);
            lens.project_unfolded(ray).is_some_and(|p| {
                // A tolerance, because rounding must not reject a border that maps onto itself.
                (-1e-9..=w + 1e-9).contains(&p.x) && (-1e-9..=h + 1e-9).contains(&p.y)
            })
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Distortion;

    fn fisheye() -> Lens {
        let k = [-0.03, -0.008, -9e-4, 3e-4];
        let distortion = Distortion::OpenCvFisheye { k };
        Lens::new((79.0, 79.2), (88.0, 58.6), (175, 117), distortion).unwrap()
    }

    #[test]
    fn a_pinhole_resampled_to_itself_does_not_change() {
        let lens = Lens::new((50.0, 60.0), (11.0, 7.0), (21, 15), Distortion::None).unwrap();
        let whole = Undistortion::without_blank_pixels(lens).unwrap();
        assert_eq!(whole.pinhole(), &lens.intrinsics());
        let stored = RgbImage::from_fn(21, 15, |x, y| image::Rgb([x as u8 * 9, y as u8, 77]));
        assert_eq!(whole.image(&stored), stored);
        let depth = DepthMap::from_fn(21, 15, |x, y| Luma([(x * y) as f32]));
        assert_eq!(whole.depth_nearest(&depth), depth);
        assert_eq!(whole.depth_splat(&depth), depth);
    }

    #[test]
    fn no_blank_pixel_appears_and_no_view_is_wasted() {
        let lens = fisheye();
        let whole = Undistortion::without_blank_pixels(lens).unwrap();
        let white = RgbImage::from_pixel(175, 117, image::Rgb([255; 3]));
        assert!(whole.image(&white).iter().all(|v| *v == 255));
        let wider = Intrinsics {
            fx: whole.pinhole().fx * 0.999,
            fy: whole.pinhole().fy * 0.999,
            ..*whole.pinhole()
        };
        assert!(!shows_only_the_picture(&lens, &wider));
    }

    #[test]
    fn a_resampled_picture_shows_what_the_lens_saw() {
        // A picture whose colour encodes the position: resampling must return the position of the ray.
        let lens = fisheye();
        let stored = RgbImage::from_fn(175, 117, |x, y| image::Rgb([x as u8, y as u8, 0]));
        let view = Undistortion::like_scannetpp(lens).unwrap();
        let image = view.image(&stored);
        for (x, y) in [(87, 58), (20, 20), (150, 100), (5, 110)] {
            let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let place = lens.project(view.pinhole().unproject(center, 2.0)).unwrap() - 0.5;
            let found = image.get_pixel(x, y).0;
            assert!(
                (f64::from(found[0]) - place.x).abs() <= 0.51,
                "{place} {found:?}"
            );
            assert!(
                (f64::from(found[1]) - place.y).abs() <= 0.51,
                "{place} {found:?}"
            );
        }
        assert_eq!((view.pinhole().cx, view.pinhole().cy), (87.5, 58.5));
    }

    #[test]
    fn splatting_keeps_the_nearer_sample() {
        let lens = Lens::new((40.0, 40.0), (10.0, 10.0), (20, 20), Distortion::None).unwrap();
        let half = Undistortion::new(lens, lens.intrinsics().resized(10, 10));
        let mut stored = DepthMap::new(20, 20);
        stored.put_pixel(4, 6, Luma([3.0]));
        stored.put_pixel(5, 7, Luma([2.0]));
        let depth = half.depth_splat(&stored);
        assert_eq!(depth.get_pixel(2, 3).0[0], 2.0);
        assert_eq!(depth.iter().filter(|z| **z > 0.0).count(), 1);
    }

    #[test]
    fn splatting_a_map_does_not_depend_on_threads() {
        let view = Undistortion::without_blank_pixels(fisheye()).unwrap();
        let stored = DepthMap::from_fn(175, 117, |x, y| {
            Luma([((x * 31 + y * 57) % 97) as f32 * 0.1])
        });
        let mut expected = DepthMap::new(175, 117);
        for (x, y, z) in stored.enumerate_pixels().filter(|p| p.2.0[0] > 0.0) {
            let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let ray = view.lens().unproject(center).unwrap();
            let place = view.pinhole().project(ray).unwrap();
            if view.pinhole().contains(place) {
                let into = &mut expected.get_pixel_mut(place.x as u32, place.y as u32).0[0];
                if *into == 0.0 || z.0[0] < *into {
                    *into = z.0[0];
                }
            }
        }
        assert_eq!(view.depth_splat(&stored), expected);
        assert!(expected.iter().filter(|z| **z > 0.0).count() > 10_000);
    }

    /// A masked pixel also masks the pixels whose bilinear footprint includes it. Pixels beyond the
    /// stored mask count as valid.
    #[test]
    fn a_resampled_mask_takes_all_that_a_masked_pixel_reaches() {
        let lens = Lens::new((40.0, 40.0), (10.0, 10.0), (20, 20), Distortion::None).unwrap();
        let mut stored = GrayImage::from_pixel(20, 20, Luma([255]));
        stored.put_pixel(4, 6, Luma([0]));
        stored.put_pixel(0, 12, Luma([254]));
        let masked = |shift: DVec2| {
            let pinhole = Intrinsics {
                cx: 10.0 - shift.x,
                cy: 10.0 - shift.y,
                ..lens.intrinsics()
            };
            let mask = Undistortion::new(lens, pinhole).mask(&stored);
            assert!(mask.iter().all(|v| [0, 255].contains(v)));
            let pixels = mask.enumerate_pixels().filter(|(_, _, v)| v.0[0] == 0);
            pixels.map(|(x, y, _)| (x, y)).collect::<Vec<_>>()
        };
        assert_eq!(masked(DVec2::ZERO), [(4, 6), (0, 12)]);
        // A contribution below half a level is rounded away.
        assert_eq!(masked(DVec2::new(0.0015, 0.0)), [(4, 6), (0, 12)]);
        assert_eq!(masked(DVec2::new(0.0025, 0.0)), [(3, 6), (4, 6), (0, 12)]);
        assert_eq!(masked(DVec2::new(0.75, 0.0)), [(3, 6), (4, 6)]);
        let four = masked(DVec2::new(0.25, 0.25));
        assert_eq!(four, [(3, 5), (4, 5), (3, 6), (4, 6), (0, 12)]);
    }

    #[test]
    fn mirroring_repeats() {
        let found: Vec<u32> = (-4..8).map(|i| mirror(i, 4)).collect();
        assert_eq!(found, [2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1]);
        assert_eq!(mirror(-3, 1), 0);
    }
}
