//! Compares every variant with its definition, window by window.

use image::{Rgb, RgbImage};

use super::map::map_rows;
use super::spec::SsimSpec;
use super::variant::{SsimBorder, SsimCovariance};
use super::*;

fn texture(width: u32, height: u32, seed: u32) -> Picture {
    Picture::from(RgbImage::from_fn(width, height, |x, y| {
        let v = (x * 73 + y * 151 + x * y + seed).wrapping_mul(2_654_435_761) >> 20;
        Rgb([(v & 255) as u8, (x * 5 + seed) as u8, (v >> 4) as u8])
    }))
}

/// The definition, two-dimensional and window by window.
fn brute_force(form: &SsimSpec, a: &Picture, b: &Picture, x: i64, y: i64, c: usize) -> f64 {
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
        if outside && form.form.border == SsimBorder::Zero {
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
    let k = match (form.form.covariance, form.radius) {
        (SsimCovariance::Sample, 3) => 49.0 / 48.0,
        (SsimCovariance::Sample, _) => 121.0 / 120.0,
        _ => 1.0,
    };
    let (mut vp, mut vq) = (k * (m[2] - m[0] * m[0]), k * (m[3] - m[1] * m[1]));
    let mut cov = k * (m[4] - m[0] * m[1]);
    if form.form.covariance == SsimCovariance::Bounded {
        let least = 1.192_092_9e-7_f64 * 1.192_092_9e-7;
        (vp, vq) = (vp.max(least), vq.max(least));
        cov = cov.signum() * cov.abs().min((vp * vq).sqrt());
    }
    let (c1, c2) = (1e-4, 9e-4);
    let guard = if form.form.guarded { 1e-8 } else { 0.0 };
    (2.0 * m[0] * m[1] + c1) * (2.0 * cov + c2)
        / ((m[0] * m[0] + m[1] * m[1] + c1) * (vp + vq + c2) + guard)
}

#[test]
fn rows_follow_the_definition_at_every_border() {
    let (a, b) = (texture(41, 79, 3), texture(41, 79, 500));
    for variant in SsimVariant::ALL {
        let form = SsimSpec::of(variant);
        if form.form.gray || form.form.range_of_data {
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
fn the_contrast_is_what_is_left_of_the_definition_without_means() {
    let (a, b) = (texture(23, 19, 3), texture(23, 19, 500));
    let form = SsimSpec::of(SsimVariant::Gauss11Valid);
    let (mut sum, mut count) = (0.0, 0.0);
    for (y, x, c) in (5..14).flat_map(|y| (5..18).flat_map(move |x| [0, 1, 2].map(|c| (y, x, c)))) {
        let mean = |picture: &Picture| -> f64 {
            let taps = (-5..=5_i64).flat_map(|j| (-5..=5_i64).map(move |i| (i, j)));
            let weighted = taps.map(|(i, j)| {
                let weight = |d: i64| form.half[(5 - d.abs()) as usize];
                weight(i) * weight(j) * picture.value((x + i) as u32, (y + j) as u32, c)
            });
            weighted.sum()
        };
        let (p, q) = (mean(&a), mean(&b));
        let luminance = (2.0 * p * q + 1e-4) / (p * p + q * q + 1e-4);
        sum += brute_force(&form, &a, &b, x, y, c) / luminance;
        count += 1.0;
    }
    let found = ssim_contrast(&a, &b).unwrap();
    assert!((found - sum / count).abs() < 1e-12, "{found}");
    let whole = ssim(SsimVariant::Gauss11Valid, &a, &b, None).unwrap();
    assert!((found - whole).abs() > 1e-3);
}

#[test]
fn taps_are_the_published_ones() {
    let form = SsimSpec::of(SsimVariant::Gauss11Valid);
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
    let centred = SsimVariant::ALL.into_iter();
    for variant in centred.filter(|variant| !variant.form().whole_windows) {
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
    // In a valid variant, a pixel whose window extends beyond the picture has no value.
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

/// Flat pictures, in which the bound and the guard have an effect: the bound limits the rounding
/// error of a covariance (at most 1e-9), the guard lowers the value for black.
#[test]
fn flat_areas_under_a_bound_and_a_guard() {
    let flat = |level: u8| Picture::from(RgbImage::from_pixel(12, 12, Rgb([level; 3])));
    let score = |variant, a: u8, b: u8| ssim(variant, &flat(a), &flat(b), None).unwrap();
    for (a, b) in [(0, 0), (77, 77), (3, 250)] {
        let plain = score(SsimVariant::Gauss11Valid, a, b);
        let bounded = score(SsimVariant::Gauss11ValidBounded, a, b);
        assert!((bounded - plain).abs() < 1e-9, "{bounded} {plain}");
    }
    assert_eq!(score(SsimVariant::Gauss11Zero, 0, 0), 1.0);
    let guarded = score(SsimVariant::Gauss11ZeroGuarded, 0, 0);
    assert!((guarded - 0.9).abs() < 1e-12, "{guarded}");
}

#[test]
fn the_range_of_the_data_scales_both_constants() {
    // The similarity is unchanged if the contrast and the range behind the constants are both
    // halved.
    let full = |seed| texture(30, 24, seed);
    let Picture::Rgb8(image) = full(3) else {
        panic!()
    };
    let half = |image: &RgbImage| {
        Picture::from(image::Rgb32FImage::from_fn(30, 24, |x, y| {
            Rgb(image.get_pixel(x, y).0.map(|v| f32::from(v) / 510.0))
        }))
    };
    let other = RgbImage::from_fn(30, 24, |x, y| {
        Rgb([(x * 8) as u8, (y * 10) as u8, 255 * (x as u8 & 1)])
    });
    let spans = image.iter().max().unwrap() - image.iter().min().unwrap();
    assert!(spans < 255 || other.iter().max() == Some(&255));
    let variant = SsimVariant::Gauss11ValidDataRange;
    let score = |a: &Picture, b: &Picture| ssim(variant, a, b, None).unwrap();
    let other_full = Picture::from(other.clone());
    let whole = score(&full(3), &other_full);
    assert!((whole - score(&half(&image), &half(&other))).abs() < 1e-6);
    // The other picture contains black and white, so its range is 1, as in the plain variant.
    let plain = ssim(SsimVariant::Gauss11Valid, &full(3), &other_full, None).unwrap();
    assert!((whole - plain).abs() < 1e-12);
}

#[test]
fn whole_windows_are_those_without_a_pixel_outside() {
    let (a, b) = (texture(30, 24, 3), texture(30, 24, 77));
    let hole = |x: i64, y: i64| (16..18).contains(&x) && y == 20;
    let inside = (0..30 * 24).map(|i| !hole(i % 30, i / 30)).collect();
    let mask = Mask::new(30, 24, inside).unwrap();
    let ScoreMap { values, origin } = ssim_map(SsimVariant::Gauss11Valid, &a, &b).unwrap();
    let (mut sum, mut count) = (0.0, 0);
    for (x, y, value) in values.enumerate_pixels() {
        let (x, y) = (i64::from(x + origin), i64::from(y + origin));
        let touched = (-5..=5).any(|dy| (-5..=5).any(|dx| hole(x + dx, y + dy)));
        if !touched {
            sum += f64::from(value.0[0]);
            count += 1;
        }
    }
    let variant = SsimVariant::Gauss11ValidWholeWindow;
    let found = ssim(variant, &a, &b, Some(&mask)).unwrap();
    assert!((found - sum / f64::from(count)).abs() < 1e-6);
    let by_centre = ssim(SsimVariant::Gauss11Valid, &a, &b, Some(&mask)).unwrap();
    assert!((found - by_centre).abs() > 1e-4);
}
