//! Views at a reduced size, at which interpretations of a dataset can be compared cheaply. An error of many pixels of the
//! photograph is only a few pixels here.

use std::sync::Arc;

use glam::{DVec2, DVec3};
use image::RgbImage;
use sharp::camera::Intrinsics;

use crate::View;

/// Maximum width of the reduced views, in pixels.
pub(super) const WIDEST: u32 = 256;

/// Distance, in reduced pixels, at which colours count as unrelated.
const APART: usize = 8;

/// The part of a view that is flipped; the other part stays as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Part {
    Picture,
    Depth,
}

/// Flips that occur by mistake in pictures and depth maps: flags for horizontal and vertical, and a description.
pub(super) const FLIPS: [((bool, bool), &str); 3] = [
    ((false, true), "upside down"),
    ((true, false), "mirrored left to right"),
    ((true, true), "turned by 180 degrees"),
];

/// A view's camera, picture and depth at reduced size.
#[derive(Debug, Clone)]
pub(super) struct SmallView {
    pub(super) camera: Intrinsics,
    /// Block means in 8-bit levels; `None` if a mask excludes a pixel of the block.
    colours: Arc<[Option<[f32; 3]>]>,
    /// Depth at the centre of each block, or else the block's smallest depth, under the reader's interpretation; 0
    /// where unknown. Empty if the view has no depth.
    depth: Arc<[f32]>,
}

impl SmallView {
    /// Reads a view, reduced to a width of at most `widest`. `None` if its picture cannot be read. Depth that cannot be
    /// read counts as missing.
    pub(super) fn new(view: &View, with_depth: bool, widest: u32) -> Option<Self> {
        Self::of(view, view.content.image().ok()?, with_depth, widest)
    }

    /// Like [`Self::new`], with another picture of the same size instead of the view's photograph.
    pub(super) fn of(
        view: &View,
        picture: RgbImage,
        with_depth: bool,
        widest: u32,
    ) -> Option<Self> {
        let valid = view.content.valid_pixels().ok()?;
        let depth = if with_depth {
            view.content.depth().ok().flatten()
        } else {
            None
        };
        let k = view.intrinsics;
        let factor = k.width.div_ceil(widest).max(1).min(k.height);
        let (width, height) = (k.width / factor, k.height / factor);
        let by = f64::from(factor);
        let camera = Intrinsics {
            fx: k.fx / by,
            fy: k.fy / by,
            cx: k.cx / by,
            cy: k.cy / by,
            width,
            height,
        };
        let block = |x: u32, y: u32| {
            let rows = y * factor..(y + 1) * factor;
            rows.flat_map(move |v| (x * factor..(x + 1) * factor).map(move |u| (u, v)))
        };
        let blocks = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let colours = blocks.clone().map(|(x, y)| {
            let excluded = valid
                .as_ref()
                .is_some_and(|valid| block(x, y).any(|(u, v)| valid.get_pixel(u, v).0[0] < 255));
            let mut sum = [0_u32; 3];
            for (u, v) in block(x, y) {
                let pixel = picture.get_pixel(u, v).0;
                sum.iter_mut()
                    .zip(pixel)
                    .for_each(|(sum, level)| *sum += u32::from(level));
            }
            (!excluded).then(|| sum.map(|sum| sum as f32 / (factor * factor) as f32))
        });
        let depth = depth.iter().flat_map(|depth| {
            blocks.clone().map(|(x, y)| {
                let middle = depth
                    .get_pixel(x * factor + factor / 2, y * factor + factor / 2)
                    .0[0];
                let all = || block(x, y).map(|(u, v)| depth.get_pixel(u, v).0[0]);
                let nearest = || all().filter(|z| *z > 0.0).fold(f32::INFINITY, f32::min);
                if middle > 0.0 {
                    middle
                } else {
                    Some(nearest()).filter(|z| z.is_finite()).unwrap_or(0.0)
                }
            })
        });
        Some(Self {
            camera,
            colours: colours.collect(),
            depth: depth.collect(),
        })
    }

    /// This picture with the depth of another view of the same size.
    pub(super) fn with_depth_of(&self, other: &Self) -> Option<Self> {
        let size = |view: &Self| (view.camera.width, view.camera.height);
        (size(self) == size(other) && other.has_depth()).then(|| Self {
            depth: Arc::clone(&other.depth),
            ..self.clone()
        })
    }

    pub(super) fn with_camera(&self, camera: Intrinsics) -> Self {
        Self {
            camera,
            ..self.clone()
        }
    }

    pub(super) fn with_depth_times(&self, factor: f64) -> Self {
        let depth = self.depth.iter().map(|z| z * factor as f32);
        Self {
            depth: depth.collect(),
            ..self.clone()
        }
    }

    /// Fraction of pixels that a mask excludes.
    pub(super) fn excluded(&self) -> f64 {
        let excluded = self.colours.iter().filter(|colour| colour.is_none());
        excluded.count() as f64 / self.colours.len() as f64
    }

    /// True if all pixels that are not excluded have the same colour.
    pub(super) fn is_of_one_colour(&self) -> bool {
        let mut colours = self.colours.iter().flatten();
        let first = colours.next();
        first.is_some_and(|first| colours.all(|colour| colour == first))
    }

    /// True if both pictures are identical and not blank.
    pub(super) fn has_picture_of(&self, other: &Self) -> bool {
        self.colours == other.colours && !self.is_of_one_colour()
    }

    /// True if both depth maps are identical and not constant.
    pub(super) fn has_depth_of(&self, other: &Self) -> bool {
        self.depth == other.depth && self.depth.iter().any(|z| *z != self.depth[0])
    }

    /// Root mean square difference of colours a few pixels apart, in levels: about as much as unrelated pictures
    /// differ.
    pub(super) fn unrelated_levels(&self) -> f64 {
        let (w, h) = (self.camera.width as usize, self.camera.height as usize);
        let all = (0..w * h).step_by(3);
        let steps = all.flat_map(|i| {
            [
                (i, i % w + APART < w, i + APART),
                (i, i / w + APART < h, i + APART * w),
            ]
        });
        let pairs = steps.filter(|step| step.1);
        let pairs = pairs.filter_map(|(i, _, j)| self.colours[i].zip(self.colours[j]));
        let (n, squares) = pairs.fold((0.0, 0.0), |(n, sum), (a, b)| {
            let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
            (n + 3.0, sum + squares.sum::<f64>())
        });
        (squares / f64::max(n, 1.0)).sqrt()
    }

    /// Flips the picture or the depth horizontally, vertically, or both.
    pub(super) fn flipped(&self, (across, down): (bool, bool), part: Part) -> Self {
        let (w, h) = (self.camera.width as usize, self.camera.height as usize);
        let from = |i: usize| {
            let (x, y) = (i % w, i / w);
            let x = if across { w - 1 - x } else { x };
            let y = if down { h - 1 - y } else { y };
            y * w + x
        };
        let mut flipped = self.clone();
        match part {
            Part::Picture => flipped.colours = (0..w * h).map(|i| self.colours[from(i)]).collect(),
            Part::Depth => {
                let all = 0..self.depth.len();
                flipped.depth = all.map(|i| self.depth[from(i)]).collect();
            }
        }
        flipped
    }

    pub(super) fn grey(self) -> Grey {
        let levels = self.colours.iter();
        let levels = levels.map(|colour| colour.map_or(f32::NAN, |c| c.iter().sum::<f32>() / 3.0));
        Grey {
            camera: self.camera,
            levels: levels.collect(),
        }
    }

    /// Adjusts the mean and the spread of each channel to those of another picture.
    pub(super) fn match_levels(&mut self, other: &Self) {
        let (own, wanted) = (self.levels(), other.levels());
        let matched = |colour: [f32; 3]| {
            std::array::from_fn(|i| {
                let ((mean, spread), (to_mean, to_spread)) = (own[i], wanted[i]);
                to_mean + (colour[i] - mean) * to_spread / spread.max(1.0)
            })
        };
        self.colours = self
            .colours
            .iter()
            .map(|colour| colour.map(matched))
            .collect();
    }

    /// Mean and standard deviation of each channel.
    fn levels(&self) -> [(f32, f32); 3] {
        std::array::from_fn(|i| {
            let all = self
                .colours
                .iter()
                .flatten()
                .map(|colour| f64::from(colour[i]));
            let (n, sum, squares) = all.fold((0.0, 0.0, 0.0), |(n, sum, squares), level| {
                (n + 1.0, sum + level, squares + level * level)
            });
            let mean = sum / f64::max(n, 1.0);
            let variance = squares / f64::max(n, 1.0) - mean * mean;
            (mean as f32, variance.max(0.0).sqrt() as f32)
        })
    }

    fn index(&self, x: u32, y: u32) -> usize {
        (y * self.camera.width + x) as usize
    }

    pub(super) fn has_depth(&self) -> bool {
        self.depth.iter().any(|z| *z > 0.0)
    }

    /// Pixels with depth: position, depth under the reader's interpretation, and colour.
    pub(super) fn samples(&self) -> impl Iterator<Item = Sample> {
        let pixels =
            (0..self.camera.height).flat_map(|y| (0..self.camera.width).map(move |x| (x, y)));
        let with_depth = pixels.zip(self.depth.iter()).filter(|(_, z)| **z > 0.0);
        with_depth.filter_map(|((x, y), z)| {
            Some(Sample {
                x,
                y,
                depth: f64::from(*z),
                colour: self.colours[self.index(x, y)]?,
            })
        })
    }

    /// Depth of the pixel that contains `place`, under the reader's interpretation, and the pixel's
    /// centre. `None` if that pixel has no depth.
    pub(super) fn depth_at(&self, place: DVec2) -> Option<(f64, DVec2)> {
        let (x, y) = (place.x as u32, place.y as u32);
        let z = *self.depth.get(self.index(x, y))?;
        let middle = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        (z > 0.0).then_some((f64::from(z), middle))
    }

    /// Colour at a position in the picture, interpolated between pixel centres; the border is repeated.
    #[inline]
    pub(super) fn colour_at(&self, place: DVec2) -> Option<[f32; 3]> {
        let taps = |at: f64, n: u32| {
            let at = (at - 0.5).clamp(0.0, f64::from(n - 1));
            let first = at as u32;
            (
                first,
                (first + 1).min(n - 1),
                (at - f64::from(first)) as f32,
            )
        };
        let (x0, x1, fx) = taps(place.x, self.camera.width);
        let (y0, y1, fy) = taps(place.y, self.camera.height);
        let at = |x, y| self.colours[self.index(x, y)];
        let corners = [at(x0, y0)?, at(x1, y0)?, at(x0, y1)?, at(x1, y1)?];
        Some(std::array::from_fn(|i| {
            let [a, b, c, d] = corners.map(|corner| corner[i]);
            let (top, bottom) = (a + (b - a) * fx, c + (d - c) * fx);
            top + (bottom - top) * fy
        }))
    }
}

/// Mean of a picture's channels; NaN where a mask excludes a pixel.
pub(super) struct Grey {
    pub(super) camera: Intrinsics,
    levels: Vec<f32>,
}

impl Grey {
    pub(super) fn size(&self) -> (u32, u32) {
        (self.camera.width, self.camera.height)
    }

    /// True if both pictures are identical.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        let levels = self.levels.iter().map(|level| level.to_bits());
        levels.eq(other.levels.iter().map(|level| level.to_bits()))
    }

    pub(super) fn at(&self, x: u32, y: u32) -> f32 {
        self.levels[(y * self.camera.width + x) as usize]
    }
}

/// A pixel with depth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) x: u32,
    pub(super) y: u32,
    pub(super) depth: f64,
    pub(super) colour: [f32; 3],
}

impl Sample {
    pub(super) fn middle(&self) -> DVec2 {
        DVec2::new(f64::from(self.x) + 0.5, f64::from(self.y) + 0.5)
    }
}

/// The ray through a position, at z = 1.
pub(super) fn ray(camera: &Intrinsics, place: DVec2) -> DVec3 {
    DVec3::new(
        (place.x - camera.cx) / camera.fx,
        (place.y - camera.cy) / camera.fy,
        1.0,
    )
}
