//! Detects pictures whose samples are right but lie in other places, as after a wrong reshape, roll or order of patches.
//!
//! Each of a list of rearrangements is undone at some points. The best is tried on the whole picture, and reported only
//! if it brings all parts of the picture significantly closer to the photograph.

use image::imageops::{crop_imm, thumbnail};
use image::{Rgb, RgbImage};

use super::change::{MAX_OF_SPACES, MIN_EXPLAINED, MIN_GAIN, shrunk};
use super::finding::PictureChange;
use crate::evaluate::gaussians::likeness::{Likeness, window};
use crate::scoring::Region;

/// Number of points at which all rearrangements are tried. With this number, gains are exact to some tenths of a dB,
/// and a picture takes about a millisecond.
const POINTS: usize = 1024;
/// Like [`MAX_OF_SPACES`], but for blocks of sub-pixels, in dB. It is higher, because exchanged sub-pixels do the least
/// harm: good pictures keep about 24 dB.
const MAX_OF_BLOCKS: f64 = 30.0;
/// Minimum side of patches that are tried, in pixels. Patches of networks have sides of 8 to 64 pixels.
const MIN_PATCH: usize = 8;
/// Numbers of patches across and down that are tried whatever the shape of the patches, as in tiled inference.
const GRIDS: std::ops::RangeInclusive<usize> = 2..=4;
/// Sides of blocks of sub-pixels: factors of pixel shuffles, and patches of vision transformers.
const BLOCKS: [usize; 7] = [2, 3, 4, 8, 14, 16, 32];
/// Number of parts across, and of parts down, all of which must become closer to the photograph. A picture that is
/// merely shifted, such as a copy of the source, becomes closer everywhere but in the part that a roll brings to the
/// opposite side.
const PARTS: u32 = 4;
/// Maximum factor by which undoing a rearrangement may multiply the error of a part: slightly above 1, because parts
/// without content do not change.
const MAX_PART_ERROR: f64 = 1.1;

/// A rearrangement of a picture's samples.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Rearrangement {
    /// The stored samples are in the order channel, row, column.
    Planes,
    /// The stored planes hold samples in the order row, column, channel.
    Pixels,
    /// The stored pixels are in the order column, row.
    Columns,
    /// The stored columns hold pixels in the order row, column.
    Rows,
    /// The picture is moved right and down by these numbers of quarters of its size; what leaves at one side enters at the
    /// opposite one.
    Rolled([usize; 2]),
    /// The patches of this grid (across, down) are listed column by column and stored row by row.
    PatchColumns([usize; 2]),
    /// The patches of this grid (across, down) are listed row by row and stored column by column.
    PatchRows([usize; 2]),
    /// Rows and columns are exchanged within each block of this size.
    Blocks(usize),
}

impl Rearrangement {
    /// Where the sample that belongs at `[x, y, channel]` is stored in a picture of size `[width, height]`.
    fn stored(self, [x, y, channel]: [usize; 3], [width, height]: [usize; 2]) -> [usize; 3] {
        let patch = |[across, down]: [usize; 2],
                     moved: fn([usize; 2], [usize; 2]) -> [usize; 2]| {
            let [w, h] = [width / across, height / down];
            let [column, row] = moved([x / w, y / h], [across, down]);
            [column * w + x % w, row * h + y % h, channel]
        };
        match self {
            Self::Planes => {
                let at = (channel * height + y) * width + x;
                [at / 3 % width, at / 3 / width, at % 3]
            }
            Self::Pixels => {
                let at = (y * width + x) * 3 + channel;
                [at % width, at / width % height, at / width / height]
            }
            Self::Columns => {
                let at = x * height + y;
                [at % width, at / width, channel]
            }
            Self::Rows => {
                let at = y * width + x;
                [at / height, at % height, channel]
            }
            Self::Rolled([right, down]) => [
                (x + right * width / 4) % width,
                (y + down * height / 4) % height,
                channel,
            ],
            Self::PatchColumns(grid) => patch(grid, |[column, row], [across, down]| {
                let at = column * down + row;
                [at % across, at / across]
            }),
            Self::PatchRows(grid) => patch(grid, |[column, row], [across, down]| {
                let at = row * across + column;
                [at / down, at % down]
            }),
            Self::Blocks(n) if x - x % n + n <= width && y - y % n + n <= height => {
                [x - x % n + y % n, y - y % n + x % n, channel]
            }
            Self::Blocks(_) => [x, y, channel],
        }
    }

    /// All rearrangements that change pictures of this size.
    fn all([width, height]: [usize; 2]) -> Vec<Self> {
        let mut all = vec![Self::Planes, Self::Pixels];
        if width != height {
            all.extend([Self::Columns, Self::Rows]);
        }
        let quarters = (0..4).flat_map(|right| (0..4).map(move |down| [right, down]));
        all.extend(quarters.filter(|by| *by != [0; 2]).map(Self::Rolled));
        let tiles = GRIDS.flat_map(|across| GRIDS.map(move |down| [across, down]));
        let sides = (MIN_PATCH..=width.min(height) / 2).map(|side| [width / side, height / side]);
        let divides = |[across, down]: &[usize; 2]| width % across == 0 && height % down == 0;
        let is_square = |[across, down]: &[usize; 2]| width * down == height * across;
        let mut grids: Vec<[usize; 2]> = sides.filter(is_square).chain(tiles).collect();
        grids.retain(divides);
        grids.sort_unstable();
        grids.dedup();
        for grid in grids {
            all.push(Self::PatchColumns(grid));
            if grid[0] != grid[1] {
                all.push(Self::PatchRows(grid));
            }
        }
        all.extend(BLOCKS.map(Self::Blocks));
        all
    }

    fn undone(self, picture: &RgbImage) -> RgbImage {
        let size = size_of(picture);
        RgbImage::from_fn(picture.width(), picture.height(), |x, y| {
            Rgb([0, 1, 2].map(|c| self.sample(picture, [x as usize, y as usize, c], size)))
        })
    }

    /// The sample of `picture` that belongs at `[x, y, channel]`.
    fn sample(self, picture: &RgbImage, at: [usize; 3], size: [usize; 2]) -> u8 {
        let [x, y, channel] = self.stored(at, size);
        picture.as_raw()[(y * size[0] + x) * 3 + channel]
    }

    fn change(self) -> PictureChange {
        match self {
            Self::Planes => PictureChange::ReshapedPlanes,
            Self::Pixels => PictureChange::ReshapedPixels,
            Self::Columns | Self::Rows => PictureChange::ReshapedSides,
            Self::Rolled(_) => PictureChange::Rolled,
            Self::PatchColumns(_) | Self::PatchRows(_) => PictureChange::PatchOrder,
            Self::Blocks(_) => PictureChange::SubPixelOrder,
        }
    }
}

fn size_of(picture: &RgbImage) -> [usize; 2] {
    [picture.width() as usize, picture.height() as usize]
}

/// The rearrangement that a picture probably has, and the [`shrunk`] picture after undoing it. `None` if no
/// rearrangement explains it.
pub(super) fn rearranged(
    photograph: &RgbImage,
    picture: &RgbImage,
) -> Option<(PictureChange, RgbImage)> {
    if photograph.dimensions() != picture.dimensions() {
        return None;
    }
    let size = size_of(picture);
    // A sequence without period in either coordinate (generalised golden ratio).
    let places = (0..POINTS).map(|k| {
        let along = |ratio: f64, side: usize| ((k as f64 * ratio).fract() * side as f64) as usize;
        [
            along(0.754_877_666, size[0]),
            along(0.569_840_291, size[1]),
            k % 3,
        ]
    });
    let places: Vec<[usize; 3]> = places.collect();
    let error = |sample: &dyn Fn([usize; 3]) -> u8| -> f64 {
        let off = |[x, y, c]: &[usize; 3]| {
            let seen = photograph.as_raw()[(y * size[0] + x) * 3 + c];
            f64::from(seen.abs_diff(sample([*x, *y, *c]))).powi(2)
        };
        places.iter().map(off).sum()
    };
    let as_read = error(&|[x, y, c]| picture.as_raw()[(y * size[0] + x) * 3 + c]);
    let psnr = 10.0 * (255.0 * 255.0 * POINTS as f64 / as_read).log10();
    if psnr >= MAX_OF_BLOCKS {
        return None;
    }
    let is_tried =
        |by: &Rearrangement| psnr < MAX_OF_SPACES || matches!(by, Rearrangement::Blocks(_));
    let errors = Rearrangement::all(size).into_iter().filter(is_tried);
    let errors = errors.map(|by| (by, error(&|at| by.sample(picture, at, size))));
    let (found, least) = errors.min_by(|a, b| a.1.total_cmp(&b.1))?;
    if 10.0 * (as_read / least).log10() < MIN_GAIN {
        return None;
    }
    let undone = found.undone(picture);
    let small = shrunk(&undone);
    let is_found = match found {
        // Blocks of sub-pixels are hardly visible in the reduced picture.
        Rearrangement::Blocks(_) => {
            let Region {
                x,
                y,
                width,
                height,
            } = window(photograph);
            let [seen, undone, shown] = [photograph, &undone, picture]
                .map(|of| crop_imm(of, x, y, width, height).to_image());
            is_closer(&seen, [&undone, &shown])
        }
        _ => {
            let shown = thumbnail(picture, small.width(), small.height());
            is_closer(&shrunk(photograph), [&small, &shown])
        }
    };
    is_found.then(|| (found.change(), small))
}

/// Whether `undone` is significantly closer to `seen` than `shown` is, in all parts.
fn is_closer(seen: &RgbImage, [undone, shown]: [&RgbImage; 2]) -> bool {
    let fits = |Region {
                    x,
                    y,
                    width,
                    height,
                }: Region| {
        let [seen, undone, shown] =
            [seen, undone, shown].map(|of| crop_imm(of, x, y, width, height).to_image());
        [undone, shown].map(|of| Likeness::of(&seen, Region::whole((width, height)), &of))
    };
    let (width, height) = seen.dimensions();
    let strips = (0..PARTS).flat_map(|k| {
        let [x, y] = [width, height].map(|side| (k * side / PARTS, (k + 1) * side / PARTS));
        let across = Region {
            x: x.0,
            y: 0,
            width: x.1 - x.0,
            height,
        };
        let down = Region {
            x: 0,
            y: y.0,
            width,
            height: y.1 - y.0,
        };
        [across, down]
    });
    let [after, before] = fits(Region::whole((width, height)));
    after.explained() >= MIN_EXPLAINED
        && after.gain_over(&before) >= MIN_GAIN
        && after.is_closer_than(&before)
        && strips
            .map(fits)
            .all(|[after, before]| after.error() <= MAX_PART_ERROR * before.error())
}

#[cfg(test)]
mod tests {
    use image::imageops::fast_blur;

    use super::*;

    /// Coloured blobs without symmetry, moved by `by`, with `noise` added.
    fn picture((width, height): (u32, u32), by: f64, noise: f64) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| {
            let (u, v) = ((f64::from(x) + by) / 9.0, f64::from(y) / 13.0);
            let hash = f64::from((x * 7919 + y * 104_729) % 31) - 15.0;
            let wave =
                |phase: f64| (u + phase + 0.02 * u * v).sin() + (v + 0.3 * u + 2.0 * phase).cos();
            let level = |phase: f64| 120.0 + 55.0 * wave(phase) + noise * hash;
            Rgb([0.0, 0.9, 2.4].map(|phase| level(phase).clamp(0.0, 255.0) as u8))
        })
    }

    const SIZE: (u32, u32) = (120, 96);

    /// The picture that a wrong program stores.
    fn done(by: Rearrangement, picture: &RgbImage) -> RgbImage {
        let (size, mut stored) = (size_of(picture), picture.clone());
        for (x, y, pixel) in picture.enumerate_pixels() {
            for (channel, level) in pixel.0.into_iter().enumerate() {
                let [x, y, channel] = by.stored([x as usize, y as usize, channel], size);
                stored.get_pixel_mut(x as u32, y as u32).0[channel] = level;
            }
        }
        stored
    }

    fn told(seen: &RgbImage, shown: &RgbImage) -> Option<PictureChange> {
        rearranged(seen, shown).map(|(change, _)| change)
    }

    #[test]
    fn every_rearrangement_is_told_and_undone() {
        // With fine texture, which swapped sub-pixels alter.
        let (seen, proper) = (picture(SIZE, 0.0, 2.0), picture(SIZE, 1.0, 2.0));
        for by in Rearrangement::all(size_of(&seen)) {
            let stored = done(by, &proper);
            assert_eq!(by.undone(&stored), proper, "{by:?}");
            assert_eq!(told(&seen, &stored), Some(by.change()), "{by:?}");
        }
    }

    #[test]
    fn samples_are_where_programs_put_them() {
        let small = RgbImage::from_raw(2, 1, vec![1, 2, 3, 4, 5, 6]).unwrap();
        let planes = done(Rearrangement::Planes, &small);
        assert_eq!(planes.into_raw(), [1, 4, 2, 5, 3, 6]);
        let pixels = done(Rearrangement::Pixels, &small);
        assert_eq!(pixels.into_raw(), [1, 3, 5, 2, 4, 6]);
        // Rows of the picture: 0 1 2 and 3 4 5.
        let numbered = RgbImage::from_fn(3, 2, |x, y| Rgb([(3 * y + x) as u8; 3]));
        let told = |by| -> Vec<u8> { done(by, &numbered).pixels().map(|p| p.0[0]).collect() };
        assert_eq!(told(Rearrangement::Columns), [0, 3, 1, 4, 2, 5]);
        assert_eq!(told(Rearrangement::Rows), [0, 2, 4, 1, 3, 5]);
        assert_eq!(
            told(Rearrangement::PatchColumns([3, 2])),
            [0, 3, 1, 4, 2, 5]
        );
        assert_eq!(told(Rearrangement::PatchRows([3, 2])), [0, 2, 4, 1, 3, 5]);
        assert_eq!(told(Rearrangement::Blocks(2)), [0, 3, 2, 1, 4, 5]);
    }

    #[test]
    fn proper_and_poor_predictions_are_not() {
        let seen = picture(SIZE, 0.0, 0.0);
        let bars = |of: RgbImage| {
            RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
                if (20..76).contains(&y) {
                    *of.get_pixel(x, y)
                } else {
                    Rgb([0; 3])
                }
            })
        };
        let mirror = |of: RgbImage| {
            RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
                *of.get_pixel(x.min(SIZE.0 - 1 - x), y.min(SIZE.1 - 1 - y))
            })
        };
        let waves = |by: u32| {
            RgbImage::from_fn(SIZE.0, SIZE.1, |x, _| {
                Rgb([if ((x + by) / 5).is_multiple_of(2) {
                    60
                } else {
                    190
                }; 3])
            })
        };
        // Shifted by a quarter, with new content at the side, as if the method ignored a motion.
        let shifted = picture(SIZE, 30.0, 0.0);
        for (what, seen, poor) in [
            ("itself", &seen, seen.clone()),
            ("parallax", &seen, picture(SIZE, 6.0, 0.0)),
            ("much parallax", &seen, picture(SIZE, 20.0, 0.0)),
            ("a quarter of the width", &seen, shifted),
            ("noise", &seen, picture(SIZE, 0.0, 6.0)),
            ("blurred", &seen, fast_blur(&picture(SIZE, 2.0, 0.0), 6.0)),
            (
                "one colour",
                &seen,
                RgbImage::from_pixel(SIZE.0, SIZE.1, Rgb([120, 90, 60])),
            ),
            ("black", &seen, RgbImage::new(SIZE.0, SIZE.1)),
            ("another scene", &seen, picture(SIZE, 400.0, 2.0)),
            ("bars", &bars(seen.clone()), bars(picture(SIZE, 3.0, 2.0))),
            (
                "symmetric",
                &mirror(seen.clone()),
                mirror(picture(SIZE, 3.0, 2.0)),
            ),
            ("repetitive", &waves(0), waves(3)),
            (
                "without texture",
                &RgbImage::from_pixel(SIZE.0, SIZE.1, Rgb([200; 3])),
                picture(SIZE, 0.0, 0.0),
            ),
        ] {
            assert_eq!(told(seen, &poor), None, "{what}");
        }
    }
}
