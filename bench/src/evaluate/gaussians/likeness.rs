//! Compares pictures with a part of a photograph and decides whether one is significantly closer.

use image::imageops::thumbnail;
use image::{Rgb, RgbImage};

use crate::scoring::Region;

/// Size of the reduced pictures that `blur` compares, in pixels.
const COARSE: (u32, u32) = (16, 12);
/// A picture counts as blurred if at least this share of the photograph's contrast is missing. Pictures of other views
/// have full contrast.
const MIN_BLUR: f64 = 0.4;
/// Maximum width and height of the compared part of a photograph, in pixels.
const SIDES: (u32, u32) = (160, 120);
/// Minimum gain, in dB, of settings of the file reader that count as better. If a file was read correctly, other
/// settings reduce the error by only some hundredths of a dB.
const MARGIN: f64 = 0.5;
/// Minimum significant gain, as a multiple of its standard error.
const SIGNIFICANCE: f64 = 3.0;
/// Like [`SIGNIFICANCE`], but for the gain after fitting brightness and contrast. It is lower, because this gain only
/// confirms the gain without the fit.
const SIGNIFICANCE_FREE: f64 = 2.0;
/// Maximum ratio of two errors that count as about equal.
const MAX_ABOUT_EQUAL: f64 = 1.1;
/// A picture explains a photograph if it accounts for at least this share of the photograph's variance.
const MIN_EXPLAINED: f64 = 0.5;
/// Contrasts of a picture and its photograph are reported only if the larger is at least this multiple of the smaller.
const MIN_CONTRAST_RATIO: f64 = 1.6;
/// Contrasts are reported only if correcting brightness and contrast gains at least this much, in dB.
const MIN_CONTRAST_GAIN_DB: f64 = 6.0;
/// Mean squared error below which pictures count as equal, in levels²; rounding and truncation to 8 bit differ by less.
const ROUNDING: f64 = 1.0;

/// The part of a photograph with the most contrast. It is compared at full resolution, because reduced pictures would
/// hide errors of half a pixel and wrong shapes of small Gaussians.
pub(in crate::evaluate) fn window(photograph: &RgbImage) -> Region {
    let (width, height) = photograph.dimensions();
    let size = (width.min(SIDES.0), height.min(SIDES.1));
    let steps = |whole: u32, part: u32| {
        let step = (part / 2).max(1) as usize;
        (0..=whole - part).step_by(step)
    };
    let mut best = (0, Region::whole(size));
    for y in steps(height, size.1) {
        for x in steps(width, size.0) {
            let region = Region {
                x,
                y,
                width: size.0,
                height: size.1,
            };
            let contrast = contrast(photograph, region);
            if contrast > best.0 {
                best = (contrast, region);
            }
        }
    }
    best.1
}

/// Sum of the differences between neighbouring green levels at every fourth row and column. A difference counts for at
/// most 64 levels, so that a single sharp edge is not decisive.
fn contrast(photograph: &RgbImage, region: Region) -> u64 {
    let level = |x: u32, y: u32| photograph.get_pixel(x, y).0[1];
    let mut sum = 0;
    for y in (region.y..region.y + region.height - 1).step_by(4) {
        for x in (region.x..region.x + region.width - 1).step_by(4) {
            let (here, right, below) = (level(x, y), level(x + 1, y), level(x, y + 1));
            let steps = [here.abs_diff(right), here.abs_diff(below)];
            sum += steps
                .iter()
                .map(|step| u64::from((*step).min(64)))
                .sum::<u64>();
        }
    }
    sum
}

/// Moments of one channel, from which errors and regressions are computed.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    n: f64,
    p: f64,
    r: f64,
    pp: f64,
    rr: f64,
    pr: f64,
}

impl Sums {
    fn plus(self, other: Self, sign: f64) -> Self {
        Self {
            n: self.n + sign * other.n,
            p: self.p + sign * other.p,
            r: self.r + sign * other.r,
            pp: self.pp + sign * other.pp,
            rr: self.rr + sign * other.rr,
            pr: self.pr + sign * other.pr,
        }
    }

    /// Sum of squared differences.
    fn error(self) -> f64 {
        self.pp - 2.0 * self.pr + self.rr
    }

    /// Sum of squared deviations of the photograph from its mean.
    fn variance(self) -> f64 {
        self.pp - self.p * self.p / self.n
    }

    /// Sum of squared differences that remain after the linear fit of the rendering to the photograph.
    fn residual(self) -> f64 {
        let covariance = self.pr - self.p * self.r / self.n;
        let of_rendering = self.rr - self.r * self.r / self.n;
        let explained = if of_rendering > 1e-6 * self.n {
            covariance * covariance / of_rendering
        } else {
            0.0
        };
        (self.variance() - explained).max(0.0)
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Errors {
    error: f64,
    /// Squared error after the best fit of brightness and contrast.
    residual: f64,
    variance: f64,
}

impl Errors {
    fn of(channels: [Sums; 3]) -> Self {
        let sum = |of: fn(Sums) -> f64| {
            channels
                .iter()
                .map(|c| of(*c) + c.n * ROUNDING)
                .sum::<f64>()
        };
        Self {
            error: sum(Sums::error),
            residual: sum(Sums::residual),
            variance: sum(Sums::variance),
        }
    }
}

#[derive(Debug, Clone, Default)]
pub(in crate::evaluate) struct Likeness {
    /// Moments per block of the picture, row by row.
    blocks: Vec<[Sums; 3]>,
    total: [Sums; 3],
}

/// Number of blocks along each side of the picture.
const BLOCKS: u32 = 6;

impl Likeness {
    /// Compares `picture` with the part of the photograph that it shows.
    pub(in crate::evaluate) fn of(
        photograph: &RgbImage,
        region: Region,
        picture: &RgbImage,
    ) -> Self {
        let mut blocks = vec![[Sums::default(); 3]; (BLOCKS * BLOCKS) as usize];
        for (x, y, rendered) in picture.enumerate_pixels() {
            let at = (y * BLOCKS / region.height) * BLOCKS + x * BLOCKS / region.width;
            let seen = photograph.get_pixel(region.x + x, region.y + y);
            for (channel, sums) in blocks[at as usize].iter_mut().enumerate() {
                let (p, r) = (f64::from(seen.0[channel]), f64::from(rendered.0[channel]));
                let pixel = Sums {
                    n: 1.0,
                    p,
                    r,
                    pp: p * p,
                    rr: r * r,
                    pr: p * r,
                };
                *sums = sums.plus(pixel, 1.0);
            }
        }
        blocks.retain(|block| block[0].n > 0.0);
        let add = |a: [Sums; 3], b: &[Sums; 3]| std::array::from_fn(|c| a[c].plus(b[c], 1.0));
        let total = blocks.iter().fold([Sums::default(); 3], add);
        Self { blocks, total }
    }

    /// The comparison over the pixels of both comparisons.
    pub(in crate::evaluate) fn joined(&self, other: &Self) -> Self {
        let total = [&self.total, &other.total];
        Self {
            blocks: [&self.blocks[..], &other.blocks].concat(),
            total: std::array::from_fn(|c| total[0][c].plus(total[1][c], 1.0)),
        }
    }

    /// The factor by which this comparison's squared error is smaller than that of `other`, in dB.
    pub(in crate::evaluate) fn gain_over(&self, other: &Self) -> f64 {
        10.0 * (other.error() / self.error()).log10()
    }

    /// PSNR, dB, at most 100.
    pub(in crate::evaluate) fn psnr(&self) -> f64 {
        let error: f64 = self.total.iter().map(|sums| sums.error()).sum();
        let mean = error / (3.0 * self.total[0].n);
        (10.0 * (255.0 * 255.0 / mean).log10()).min(100.0)
    }

    /// Sum of squared differences.
    pub(in crate::evaluate) fn error(&self) -> f64 {
        Errors::of(self.total).error
    }

    /// Mean colour of the photograph's part, in levels.
    pub(in crate::evaluate) fn mean_color(&self) -> [f64; 3] {
        self.total.map(|sums| sums.p / sums.n)
    }

    /// True if the picture is no closer to the photograph than a uniform picture in the photograph's mean colour, and
    /// explains less than a tenth of the photograph's variance at any brightness and contrast.
    pub(in crate::evaluate) fn is_unrelated(&self) -> bool {
        let Errors {
            error,
            residual,
            variance,
        } = Errors::of(self.total);
        // A photograph of a single colour has no variance to explain, so an error of up to 8 levels never counts as
        // unrelated.
        let noise = 64.0 * 3.0 * self.total[0].n;
        // The mean colour is rounded to whole levels, so its error is slightly larger than that of the exact mean.
        error >= (0.99 * variance).max(noise) && residual > 0.9 * variance
    }

    pub(in crate::evaluate) fn explains(&self) -> bool {
        self.explained() >= MIN_EXPLAINED
    }

    /// Share of the photograph's variance that the picture explains after fitting brightness and contrast.
    pub(in crate::evaluate) fn explained(&self) -> f64 {
        let whole = Errors::of(self.total);
        1.0 - whole.residual / whole.variance
    }

    /// The picture's contrast as a multiple of the photograph's, and the PSNR after correcting brightness and contrast,
    /// dB. `None` unless the contrasts differ much and the correction removes most of the error.
    pub(in crate::evaluate) fn contrast(&self) -> Option<(f64, f64)> {
        let sum = |of: fn(&Sums) -> f64| self.total.iter().map(of).sum::<f64>();
        let covariance = sum(|c| c.pr - c.p * c.r / c.n);
        let contrast = sum(|c| c.rr - c.r * c.r / c.n) / covariance;
        let Errors {
            error, residual, ..
        } = Errors::of(self.total);
        let gain = 10.0 * (error / residual).log10();
        let is_other = contrast > 0.0 && contrast.ln().abs() >= MIN_CONTRAST_RATIO.ln();
        (is_other && self.explains() && gain >= MIN_CONTRAST_GAIN_DB)
            .then(|| (contrast, self.psnr() + gain))
    }

    /// Whether the picture explains its photograph, and [is significantly closer](Self::is_closer_than) to it than the
    /// picture of `other` is to its own photograph.
    pub(in crate::evaluate) fn is_better_than(&self, other: &Self) -> bool {
        self.explains() && self.is_closer_than(other)
    }

    /// Whether the picture is significantly closer to its photograph than the picture of `other` is to its own
    /// photograph, both in squared error and after fitting brightness and contrast.
    pub(in crate::evaluate) fn is_closer_than(&self, other: &Self) -> bool {
        let share = |e: Errors| e.residual / e.variance;
        self.is_nearer_than(other) && self.gains(other, [share; 2], MARGIN / 2.0, SIGNIFICANCE_FREE)
    }

    /// Whether this picture's squared error is significantly smaller than that of `other`.
    pub(in crate::evaluate) fn is_nearer_than(&self, other: &Self) -> bool {
        self.gains(other, [|e| e.error; 2], MARGIN, SIGNIFICANCE)
    }

    /// Whether this picture's squared error, without any fit, is significantly smaller than that of `other` after
    /// fitting brightness and contrast.
    pub(in crate::evaluate) fn is_nearer_than_exposed(&self, other: &Self) -> bool {
        self.gains(
            other,
            [|e| e.error, |e| e.residual],
            MARGIN / 2.0,
            SIGNIFICANCE,
        )
    }

    /// Whether this picture's squared error, without any fit, is at most slightly larger than that of `other` after
    /// fitting brightness and contrast.
    pub(in crate::evaluate) fn is_as_near_as_exposed(&self, other: &Self) -> bool {
        self.error() <= MAX_ABOUT_EQUAL * Errors::of(other.total).residual
    }

    /// Whether `errors[0]` of this picture is smaller than `errors[1]` of `other`, by at least `margin` dB and
    /// `significance` standard errors.
    fn gains(
        &self,
        other: &Self,
        errors: [fn(Errors) -> f64; 2],
        margin: f64,
        significance: f64,
    ) -> bool {
        if self.blocks.len() != other.blocks.len() {
            return false;
        }
        let gain = |own: [Sums; 3], others: [Sums; 3]| {
            let [own, others] = [errors[0](Errors::of(own)), errors[1](Errors::of(others))];
            10.0 * (others / own).log10()
        };
        let whole = gain(self.total, other.total);
        // Jackknife: how much the gain depends on each block.
        let without = |fit: &Self, block: usize| {
            std::array::from_fn(|c| fit.total[c].plus(fit.blocks[block][c], -1.0))
        };
        let n = self.blocks.len();
        let each = (0..n).map(|block| gain(without(self, block), without(other, block)));
        let each: Vec<f64> = each.collect();
        let mean = each.iter().sum::<f64>() / n as f64;
        let squares = each.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>();
        let standard_error = (squares * (n as f64 - 1.0) / n as f64).sqrt();
        whole >= margin && whole >= significance * standard_error
    }

    /// Correlation of the levels about each channel's mean, over all channels, −1..1; close to 0 if there is hardly any
    /// contrast.
    pub(in crate::evaluate) fn correlation(&self) -> f64 {
        let sum = |of: fn(&Sums) -> f64| self.total.iter().map(of).sum::<f64>();
        let seen = sum(|c| c.pp - c.p * c.p / c.n + c.n * ROUNDING);
        let shown = sum(|c| c.rr - c.r * c.r / c.n + c.n * ROUNDING);
        sum(|c| c.pr - c.p * c.r / c.n) / (seen * shown).sqrt()
    }
}

/// The share of the photograph's contrast that is missing in `picture`; `None` unless `picture` is a blurred version of
/// the photograph.
pub(in crate::evaluate) fn blur(photograph: &RgbImage, picture: &RgbImage) -> Option<f64> {
    let whole = Region::whole(photograph.dimensions());
    let [seen, shown] = [photograph, picture].map(|all| contrast(all, whole) as f64);
    let coarse = |all| thumbnail(all, COARSE.0, COARSE.1);
    let fit = Likeness::of(&coarse(photograph), Region::whole(COARSE), &coarse(picture));
    let lacks = 1.0 - shown / seen.max(1.0);
    (lacks >= MIN_BLUR && fit.explains()).then_some(lacks)
}

/// The photograph moved by half a pixel to the right and down; its first row and column are repeated.
pub(super) fn between_pixels(photograph: &RgbImage) -> RgbImage {
    let (width, height) = photograph.dimensions();
    RgbImage::from_fn(width, height, |x, y| {
        let (left, above) = (x.saturating_sub(1), y.saturating_sub(1));
        let four = [(left, above), (x, above), (left, y), (x, y)];
        let four = four.map(|(x, y)| photograph.get_pixel(x, y).0);
        let mean =
            |channel: usize| (four.iter().map(|p| u32::from(p[channel])).sum::<u32>() + 2) / 4;
        Rgb([0, 1, 2].map(|channel| mean(channel) as u8))
    })
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    /// Waves with some noise.
    fn photograph(noise: u32) -> RgbImage {
        RgbImage::from_fn(64, 48, |x, y| {
            let wave =
                100.0 + 60.0 * (f64::from(x) / 3.0).sin() + 40.0 * (f64::from(y) / 5.0).cos();
            let hash = (x * 7919 + y * 104_729 + noise * 31) % 17;
            Rgb([
                wave as u8,
                (wave * 0.8) as u8 + hash as u8,
                255 - wave as u8,
            ])
        })
    }

    fn fit(picture: &RgbImage) -> Likeness {
        let photograph = photograph(0);
        Likeness::of(&photograph, Region::whole(photograph.dimensions()), picture)
    }

    #[test]
    fn a_shifted_picture_loses_and_darker_or_noisier_ones_do_not_win() {
        let right = fit(&photograph(1));
        let shifted = RgbImage::from_fn(64, 48, |x, y| *photograph(0).get_pixel((x + 1) % 64, y));
        assert!(right.is_better_than(&fit(&shifted)));
        assert!(!fit(&shifted).is_better_than(&right));
        assert!(!fit(&photograph(2)).is_better_than(&right));
        // The less dimmed picture is closer, but not better, because a difference in brightness alone does not count.
        let dimmed = |by: f64| {
            RgbImage::from_fn(64, 48, |x, y| {
                Rgb(photograph(1)
                    .get_pixel(x, y)
                    .0
                    .map(|v| (f64::from(v) * by) as u8))
            })
        };
        assert!(fit(&dimmed(0.8)).error() < fit(&dimmed(0.5)).error());
        assert!(!fit(&dimmed(0.8)).is_better_than(&fit(&dimmed(0.5))));
    }

    #[test]
    fn another_contrast_is_measured_and_another_brightness_or_noise_is_not() {
        let toned = |by: f64, level: f64| {
            let picture = photograph(1);
            let tone = |v: u8| (level + by * (f64::from(v) - level)).round() as u8;
            let pixels = RgbImage::from_fn(64, 48, |x, y| Rgb(picture.get_pixel(x, y).0.map(tone)));
            fit(&pixels).contrast()
        };
        let (contrast, fitted) = toned(0.08, 128.0).unwrap();
        assert!(
            (contrast - 0.08).abs() < 0.01 && fitted > 25.0,
            "{contrast} {fitted}"
        );
        for (by, level) in [(1.0, 0.0), (0.75, 0.0), (0.75, 255.0)] {
            assert_eq!(toned(by, level), None, "{by}");
        }
        let flat = RgbImage::from_pixel(64, 48, Rgb([120; 3]));
        assert_eq!(fit(&flat).contrast(), None);
        let aside = RgbImage::from_fn(64, 48, |x, y| *photograph(0).get_pixel((x + 9) % 64, y));
        assert_eq!(fit(&aside).contrast(), None);
    }

    #[test]
    fn what_shows_nothing_of_it_is_unrelated_and_a_flat_photograph_is_not_judged() {
        let black = RgbImage::new(64, 48);
        assert!(fit(&black).is_unrelated());
        assert!(!fit(&photograph(3)).is_unrelated());
        let flat = |level: u8| RgbImage::from_pixel(64, 48, Rgb([level; 3]));
        let near = Likeness::of(&flat(120), Region::whole((64, 48)), &flat(124));
        assert!(!near.is_unrelated());
    }

    #[test]
    fn a_blurred_photograph_is_told_from_another_one() {
        let seen = photograph(0);
        let blurred = image::imageops::fast_blur(&seen, 4.0);
        assert!(blur(&seen, &blurred).is_some_and(|lacks| lacks > 0.5));
        let aside = RgbImage::from_fn(64, 48, |x, y| *seen.get_pixel((x + 9) % 64, y));
        let grey = RgbImage::from_pixel(64, 48, Rgb([120; 3]));
        for other in [&seen, &photograph(1), &aside, &grey] {
            assert_eq!(blur(&seen, other), None);
        }
    }

    #[test]
    fn the_window_is_where_the_contrast_is() {
        let mut wide = RgbImage::from_pixel(640, 480, Rgb([90; 3]));
        for (x, y, pixel) in photograph(0).enumerate_pixels() {
            wide.put_pixel(500 + x, 300 + y, *pixel);
        }
        let Region {
            x,
            y,
            width,
            height,
        } = window(&wide);
        assert_eq!((width, height), SIDES);
        assert!(x <= 500 && x + width >= 564 && y <= 300 && y + height >= 348);
        assert_eq!(window(&photograph(0)), Region::whole((64, 48)));
        assert_eq!(window(&RgbImage::new(1, 1)), Region::whole((1, 1)));
    }
}
