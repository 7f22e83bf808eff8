//! Structural similarity in every variant that public code computes.
//!
//! Wang et al. 2004: (2 μₐμᵦ + C₁)(2 σₐᵦ + C₂) / ((μₐ² + μᵦ² + C₁)(σₐ² + σᵦ² + C₂)) per channel
//! with C₁ = (0.01 L)², C₂ = (0.03 L)², averaged over pixels and channels. The variants differ in
//! window, border, covariance and L. Everything is f64: in f32 the variances, a difference of
//! nearly equal numbers on flat areas, are off in the fifth decimal.

use image::{ImageBuffer, Luma};
use rayon::prelude::*;

use crate::identity::SsimVariant;
use crate::picture::{Mask, Picture};
use crate::scorer::{ScoreMap, Unavailable};
use crate::simd::with_widest_vectors;

/// What happens where the window reaches beyond the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Border {
    /// Such windows do not count: the map is smaller than the picture by a radius on each side.
    Valid,
    /// The picture goes on with zeros.
    Zero,
    /// The picture is mirrored; the edge pixel is not repeated.
    Reflect,
}

/// A variant taken apart.
struct Form {
    radius: usize,
    /// Weight of the pixels at distance `radius`, …, 1, 0 from the centre along one axis.
    half: Vec<f64>,
    border: Border,
    /// Factor that turns population into sample covariance, or 1.
    covariance: f64,
    gray: bool,
    range_of_data: bool,
}

impl Form {
    fn of(variant: SsimVariant) -> Self {
        use SsimVariant as V;
        let uniform = matches!(variant, V::Uniform7Sample | V::Uniform7Population);
        let border = match variant {
            V::Gauss11Zero => Border::Zero,
            V::Gauss11Reflect | V::Gauss11ReflectDataRange => Border::Reflect,
            _ => Border::Valid,
        };
        let covariance = match variant {
            V::Uniform7Sample => 49.0 / 48.0,
            V::Gauss11ValidSample => 121.0 / 120.0,
            _ => 1.0,
        };
        let half = if uniform {
            vec![1.0 / 7.0; 4]
        } else {
            let weights: Vec<f64> = (0..=5)
                .map(|i| (-f64::from((5 - i) * (5 - i)) / (2.0 * 1.5 * 1.5)).exp())
                .collect();
            let sum = 2.0 * weights[..5].iter().sum::<f64>() + weights[5];
            weights.iter().map(|weight| weight / sum).collect()
        };
        Self {
            radius: half.len() - 1,
            half,
            border,
            covariance,
            gray: variant == V::Gauss11ValidGray,
            range_of_data: variant == V::Gauss11ReflectDataRange,
        }
    }

    fn channels(&self) -> usize {
        if self.gray { 1 } else { 3 }
    }

    /// Width and height of the map.
    fn map_size(&self, (width, height): (u32, u32)) -> Result<(usize, usize), Unavailable> {
        let smallest = match self.border {
            Border::Valid => 2 * self.radius + 1,
            Border::Zero => 1,
            Border::Reflect => self.radius + 1,
        };
        let (w, h) = (width as usize, height as usize);
        if w.min(h) < smallest {
            return Err(Unavailable::TooSmall {
                width,
                height,
                smallest: smallest as u32,
            });
        }
        Ok(match self.border {
            Border::Valid => (w - 2 * self.radius, h - 2 * self.radius),
            Border::Zero | Border::Reflect => (w, h),
        })
    }

    /// Distance of the map's origin from the picture's, both axes: a value of the map belongs to
    /// the pixel at its window's centre.
    fn origin(&self) -> usize {
        match self.border {
            Border::Valid => self.radius,
            Border::Zero | Border::Reflect => 0,
        }
    }
}

/// The mean of the SSIM map, with a mask the mean over the window centres inside it. The pictures
/// (and the mask) are of one size.
pub(crate) fn ssim(
    variant: SsimVariant,
    prediction: &Picture,
    target: &Picture,
    mask: Option<&Mask>,
) -> Result<f64, Unavailable> {
    let form = Form::of(variant);
    let channels = form.channels();
    let origin = form.origin();
    let rows = map_rows(&form, prediction, target, |y, row| {
        let Some(mask) = mask else {
            return (sum_in_lanes(row), row.len());
        };
        let inside = &mask.row(y + origin)[origin..];
        let mut sum = 0.0;
        let mut count = 0;
        for (values, &inside) in row.chunks_exact(channels).zip(inside) {
            if inside {
                sum += values.iter().sum::<f64>();
                count += channels;
            }
        }
        (sum, count)
    })?;
    let count: usize = rows.iter().map(|(_, count)| count).sum();
    if count == 0 {
        return Err(Unavailable::EmptyMask);
    }
    Ok(rows.iter().map(|(sum, _)| sum).sum::<f64>() / count as f64)
}

/// The SSIM map, mean over channels.
pub(crate) fn ssim_map(
    variant: SsimVariant,
    prediction: &Picture,
    target: &Picture,
) -> Result<ScoreMap, Unavailable> {
    let form = Form::of(variant);
    let channels = form.channels();
    let rows = map_rows(&form, prediction, target, |_, row| {
        row.chunks_exact(channels)
            .map(|values| (values.iter().sum::<f64>() / channels as f64) as f32)
            .collect::<Vec<_>>()
    })?;
    let width = rows.first().map_or(0, Vec::len) as u32;
    let values = ImageBuffer::from_fn(width, rows.len() as u32, |x, y| {
        Luma([rows[y as usize][x as usize]])
    });
    Ok(ScoreMap {
        values,
        origin: form.origin() as u32,
    })
}

/// Rows of the map that one task computes; each task filters 2 × radius rows more than that.
const ROWS_PER_TASK: usize = 64;
/// Elements that the inner loops take at once; row buffers are padded to a multiple of it.
const BLOCK: usize = 32;
/// Filtered quantities: a, b, a² + b², a b.
const QUANTITIES: usize = 4;

/// Applies `each` to every row of the map (interleaved channels); results in row order.
fn map_rows<T: Send>(
    form: &Form,
    prediction: &Picture,
    target: &Picture,
    each: impl Fn(usize, &[f64]) -> T + Sync,
) -> Result<Vec<T>, Unavailable> {
    let (map_width, map_height) = form.map_size(prediction.dimensions())?;
    let range = if form.range_of_data {
        let range = data_range(prediction).max(data_range(target));
        if range == 0.0 {
            let [a, b] = [prediction, target].map(|picture| picture.value(0, 0, 0));
            if (a == 0.0) == (b == 0.0) {
                return Err(Unavailable::NoRange);
            }
            // Contrast and structure are 0 / 0, but at most 1; the luminance before them is 0.
            let zeros = vec![0.0; map_width * form.channels()];
            return Ok((0..map_height).map(|y| each(y, &zeros)).collect());
        }
        range
    } else {
        1.0
    };
    let constants = Constants {
        c1: (0.01 * range) * (0.01 * range),
        c2: (0.03 * range) * (0.03 * range),
        covariance: form.covariance,
    };
    let tasks: Vec<usize> = (0..map_height).step_by(ROWS_PER_TASK).collect();
    let results: Vec<Vec<T>> = tasks
        .into_par_iter()
        .map(|first| {
            let end = (first + ROWS_PER_TASK).min(map_height);
            let mut strip = Strip::new(form, prediction, target, map_width);
            let mut row = vec![0.0; padded(map_width * form.channels())];
            for y in 0..2 * form.radius {
                strip.push(first + y);
            }
            (first..end)
                .map(|y| {
                    strip.push(y + 2 * form.radius);
                    strip.map_row(y, constants, &mut row);
                    each(y, &row[..map_width * form.channels()])
                })
                .collect()
        })
        .collect();
    Ok(results.into_iter().flatten().collect())
}

/// Maximum minus minimum over all pixels and channels.
fn data_range(picture: &Picture) -> f64 {
    let (width, height) = picture.dimensions();
    let mut row = vec![0.0; 3 * width as usize];
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for y in 0..height as usize {
        picture.row_f64(y, &mut row);
        for &value in &row {
            low = low.min(value);
            high = high.max(value);
        }
    }
    high - low
}

#[derive(Clone, Copy)]
struct Constants {
    c1: f64,
    c2: f64,
    covariance: f64,
}

fn padded(n: usize) -> usize {
    n.next_multiple_of(BLOCK)
}

/// The last 2 × radius + 1 rows, filtered along x, as one task walks down the picture.
///
/// Rows are counted as of the picture continued by a radius above: row 0 is the first that the
/// map's first row needs.
struct Strip<'a> {
    form: &'a Form,
    pictures: [&'a Picture; 2],
    width: usize,
    height: usize,
    /// Length of a filtered row: padded map width × channels.
    length: usize,
    /// 2 × radius + 1 slots of `QUANTITIES` rows.
    ring: Vec<f64>,
    /// The four quantities of one row before filtering, border included.
    quantities: [Vec<f64>; QUANTITIES],
    /// A row as it comes from the picture.
    rgb: Vec<f64>,
}

impl<'a> Strip<'a> {
    fn new(form: &'a Form, a: &'a Picture, b: &'a Picture, map_width: usize) -> Self {
        let (width, height) = a.dimensions();
        let channels = form.channels();
        let length = padded(map_width * channels);
        let unfiltered = length + 2 * form.radius * channels;
        Self {
            form,
            pictures: [a, b],
            width: width as usize,
            height: height as usize,
            length,
            ring: vec![0.0; (2 * form.radius + 1) * QUANTITIES * length],
            quantities: std::array::from_fn(|_| vec![0.0; unfiltered]),
            rgb: vec![0.0; 3 * width as usize],
        }
    }

    fn slot(&self, row: usize) -> std::ops::Range<usize> {
        let size = QUANTITIES * self.length;
        let slot = row % (2 * self.form.radius + 1);
        slot * size..(slot + 1) * size
    }

    /// Filters row `row` along x into its slot.
    fn push(&mut self, row: usize) {
        let slot = self.slot(row);
        let margin = match self.form.border {
            Border::Valid => 0,
            Border::Zero | Border::Reflect => self.form.radius,
        };
        let source = match (row.checked_sub(margin), self.form.border) {
            (Some(y), _) if y < self.height => y,
            (_, Border::Zero) => {
                self.ring[slot].fill(0.0);
                return;
            }
            (Some(y), _) => 2 * (self.height - 1) - y,
            (None, _) => margin - row,
        };
        let channels = self.form.channels();
        for i in 0..2 {
            self.pictures[i].row_f64(source, &mut self.rgb);
            let inner = &mut self.quantities[i][margin * channels..][..self.width * channels];
            if self.form.gray {
                for (gray, rgb) in inner.iter_mut().zip(self.rgb.chunks_exact(3)) {
                    *gray = 0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2];
                }
            } else {
                inner.copy_from_slice(&self.rgb);
            }
            if self.form.border == Border::Reflect {
                for x in 1..=margin {
                    for c in 0..channels {
                        let at = |x: usize| x * channels + c;
                        let row = &mut self.quantities[i];
                        row[at(margin - x)] = row[at(margin + x)];
                        let last = margin + self.width - 1;
                        row[at(last + x)] = row[at(last - x)];
                    }
                }
            }
        }
        let [a, b, squares, products] = &mut self.quantities;
        for (((a, b), square), product) in a.iter().zip(b.iter()).zip(squares).zip(products) {
            *square = a * a + b * b;
            *product = a * b;
        }
        let slot = &mut self.ring[slot];
        for (quantity, out) in self
            .quantities
            .iter()
            .zip(slot.chunks_exact_mut(self.length))
        {
            filter_along_x(quantity, &self.form.half, channels, out);
        }
    }

    /// Filters along y and forms the map's row `y`; rows `y` to `y + 2 radius` have been pushed.
    fn map_row(&self, y: usize, constants: Constants, out: &mut [f64]) {
        let taps = 2 * self.form.radius + 1;
        let rows: Vec<&[f64]> = (0..taps).map(|k| &self.ring[self.slot(y + k)]).collect();
        filter_along_y(&rows, &self.form.half, constants, out);
    }
}

fn filter_along_x(input: &[f64], half: &[f64], channels: usize, out: &mut [f64]) {
    with_widest_vectors!(filter_along_x_body(input, half, channels, out):
        fn(input: &[f64], half: &[f64], channels: usize, out: &mut [f64]));
}

#[inline(always)]
fn filter_along_x_body(input: &[f64], half: &[f64], channels: usize, out: &mut [f64]) {
    let radius = half.len() - 1;
    for (block, out) in out.chunks_exact_mut(BLOCK).enumerate() {
        let tap = |k: usize| &input[block * BLOCK + k * channels..][..BLOCK];
        let mut sum = [0.0; BLOCK];
        for k in 0..radius {
            add_pair(&mut sum, half[k], tap(k), tap(2 * radius - k));
        }
        add_single(&mut sum, half[radius], tap(radius));
        out.copy_from_slice(&sum);
    }
}

fn filter_along_y(rows: &[&[f64]], half: &[f64], constants: Constants, out: &mut [f64]) {
    with_widest_vectors!(filter_along_y_body(rows, half, constants, out):
        fn(rows: &[&[f64]], half: &[f64], constants: Constants, out: &mut [f64]));
}

#[inline(always)]
fn filter_along_y_body(rows: &[&[f64]], half: &[f64], constants: Constants, out: &mut [f64]) {
    let radius = half.len() - 1;
    let length = out.len();
    for (block, out) in out.chunks_exact_mut(BLOCK).enumerate() {
        let mut filtered = [[0.0; BLOCK]; QUANTITIES];
        for (quantity, sum) in filtered.iter_mut().enumerate() {
            let tap = |k: usize| &rows[k][quantity * length + block * BLOCK..][..BLOCK];
            for k in 0..radius {
                add_pair(sum, half[k], tap(k), tap(2 * radius - k));
            }
            add_single(sum, half[radius], tap(radius));
        }
        let [mean_a, mean_b, squares, products] = &filtered;
        for i in 0..BLOCK {
            let (a, b) = (mean_a[i], mean_b[i]);
            let (ab, aa_bb) = (a * b, a * a + b * b);
            let variances = constants.covariance * (squares[i] - aa_bb);
            let covariance = constants.covariance * (products[i] - ab);
            out[i] = (2.0 * ab + constants.c1) * (2.0 * covariance + constants.c2)
                / ((aa_bb + constants.c1) * (variances + constants.c2));
        }
    }
}

#[inline(always)]
fn add_pair(sum: &mut [f64; BLOCK], weight: f64, a: &[f64], b: &[f64]) {
    for ((sum, a), b) in sum.iter_mut().zip(a).zip(b) {
        *sum += weight * (a + b);
    }
}

#[inline(always)]
fn add_single(sum: &mut [f64; BLOCK], weight: f64, a: &[f64]) {
    for (sum, a) in sum.iter_mut().zip(a) {
        *sum += weight * a;
    }
}

/// A sum in a fixed order that vectors can follow: eight running sums, then those.
fn sum_in_lanes(values: &[f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let (chunks, rest) = values.as_chunks::<8>();
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane += value;
        }
    }
    lanes.iter().chain(rest).sum()
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    fn texture(width: u32, height: u32, seed: u32) -> Picture {
        Picture::from(RgbImage::from_fn(width, height, |x, y| {
            let v = (x * 73 + y * 151 + x * y + seed).wrapping_mul(2_654_435_761) >> 20;
            Rgb([(v & 255) as u8, (x * 5 + seed) as u8, (v >> 4) as u8])
        }))
    }

    /// The definition, two-dimensional and window by window.
    fn brute_force(form: &Form, a: &Picture, b: &Picture, x: i64, y: i64, c: usize) -> f64 {
        let (width, height) = a.dimensions();
        let r = form.radius as i64;
        let at = |picture: &Picture, x: i64, y: i64| -> f64 {
            let fold = |v: i64, n: i64| {
                if v < 0 {
                    -v
                } else if v >= n {
                    2 * n - 2 - v
                } else {
                    v
                }
            };
            let outside = x < 0 || y < 0 || x >= i64::from(width) || y >= i64::from(height);
            if outside && form.border == Border::Zero {
                return 0.0;
            }
            let (x, y) = (fold(x, width.into()) as u32, fold(y, height.into()) as u32);
            picture.value(x, y, c)
        };
        let mut m = [0.0; 5];
        for j in -r..=r {
            for i in -r..=r {
                let weight = |d: i64| form.half[(r - d.abs()) as usize];
                let w = weight(i) * weight(j);
                let (p, q) = (at(a, x + i, y + j), at(b, x + i, y + j));
                for (m, v) in m.iter_mut().zip([p, q, p * p, q * q, p * q]) {
                    *m += w * v;
                }
            }
        }
        let k = form.covariance;
        let (vp, vq) = (k * (m[2] - m[0] * m[0]), k * (m[3] - m[1] * m[1]));
        let cov = k * (m[4] - m[0] * m[1]);
        let (c1, c2) = (1e-4, 9e-4);
        (2.0 * m[0] * m[1] + c1) * (2.0 * cov + c2)
            / ((m[0] * m[0] + m[1] * m[1] + c1) * (vp + vq + c2))
    }

    #[test]
    fn rows_follow_the_definition_at_every_border() {
        let (a, b) = (texture(41, 79, 3), texture(41, 79, 500));
        for variant in SsimVariant::ALL {
            let form = Form::of(variant);
            if form.gray || form.range_of_data {
                continue;
            }
            let rows = map_rows(&form, &a, &b, |_, row| row.to_vec()).unwrap();
            let origin = form.origin() as i64;
            for (y, row) in rows.iter().enumerate() {
                for x in [0, 1, 4, 6, row.len() / 3 - 1] {
                    for c in 0..3 {
                        let (px, py) = (x as i64 + origin, y as i64 + origin);
                        let expected = brute_force(&form, &a, &b, px, py, c);
                        let error = (row[3 * x + c] - expected).abs();
                        assert!(error < 1e-12, "{variant:?} {x} {y} {c}: {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn taps_are_the_published_ones() {
        let form = Form::of(SsimVariant::Gauss11Valid);
        let published = [
            0.001_028_38,
            0.007_598_76,
            0.036_000_77,
            0.109_360_69,
            0.213_005_54,
            0.266_011_72,
        ];
        for (tap, published) in form.half.iter().zip(published) {
            assert!((tap - published).abs() < 5e-9);
        }
    }

    #[test]
    fn the_mask_selects_window_centres() {
        let (a, b) = (texture(30, 24, 3), texture(30, 24, 77));
        for variant in SsimVariant::ALL {
            let ScoreMap { values, origin } = ssim_map(variant, &a, &b).unwrap();
            let mut inside = vec![false; 30 * 24];
            inside[12 * 30 + 17] = true;
            inside[13 * 30 + 9] = true;
            let mask = Mask::new(30, 24, inside).unwrap();
            let at = |x: u32, y: u32| f64::from(values.get_pixel(x - origin, y - origin).0[0]);
            let expected = (at(17, 12) + at(9, 13)) / 2.0;
            let masked = ssim(variant, &a, &b, Some(&mask)).unwrap();
            assert!((masked - expected).abs() < 1e-6, "{variant:?}");
            let full = Mask::new(30, 24, vec![true; 30 * 24]).unwrap();
            let whole = ssim(variant, &a, &b, None).unwrap();
            assert!((ssim(variant, &a, &b, Some(&full)).unwrap() - whole).abs() < 1e-12);
        }
        // A pixel whose window leaves the picture has no value in a valid variant.
        let mut corner = vec![false; 30 * 24];
        corner[0] = true;
        let mask = Mask::new(30, 24, corner).unwrap();
        let masked = ssim(SsimVariant::Gauss11Valid, &a, &b, Some(&mask));
        assert_eq!(masked, Err(Unavailable::EmptyMask));
        assert!(ssim(SsimVariant::Gauss11Zero, &a, &b, Some(&mask)).is_ok());
    }

    #[test]
    fn small_pictures_are_refused_where_the_window_does_not_fit() {
        let smallest = |variant, side| {
            let (a, b) = (texture(side, 40, 1), texture(side, 40, 2));
            ssim(variant, &a, &b, None)
        };
        let refused = |smallest| {
            Err(Unavailable::TooSmall {
                width: smallest - 1,
                height: 40,
                smallest,
            })
        };
        assert_eq!(smallest(SsimVariant::Gauss11Valid, 10), refused(11));
        assert!(smallest(SsimVariant::Gauss11Valid, 11).is_ok());
        assert_eq!(smallest(SsimVariant::Uniform7Sample, 6), refused(7));
        assert!(smallest(SsimVariant::Uniform7Sample, 7).is_ok());
        assert_eq!(smallest(SsimVariant::Gauss11Reflect, 5), refused(6));
        assert!(smallest(SsimVariant::Gauss11Reflect, 6).is_ok());
        assert!(smallest(SsimVariant::Gauss11Zero, 1).is_ok());
    }

    #[test]
    fn the_same_bits_for_any_number_of_threads() {
        let (a, b) = (texture(130, 300, 3), texture(130, 300, 77));
        let score = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                ssim(SsimVariant::Gauss11Reflect, &a, &b, None)
                    .unwrap()
                    .to_bits()
            })
        };
        assert_eq!(score(1), score(5));
    }

    #[test]
    fn constant_pictures_have_no_data_range() {
        let black = Picture::from(RgbImage::new(20, 20));
        let score = ssim(SsimVariant::Gauss11ReflectDataRange, &black, &black, None);
        assert_eq!(score, Err(Unavailable::NoRange));
        let white = Picture::from(RgbImage::from_pixel(20, 20, Rgb([255; 3])));
        let score = ssim(SsimVariant::Gauss11ReflectDataRange, &black, &white, None);
        assert_eq!(score, Ok(0.0));
    }
}
