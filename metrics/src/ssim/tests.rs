//! Every variant against its definition, window by window.

use image::{Rgb, RgbImage};

use super::map::map_rows;
use super::variant::{Border, SsimSpec};
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
        let form = SsimSpec::of(variant);
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
