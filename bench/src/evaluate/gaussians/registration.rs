//! Finds the shift and the zoom that best align two pictures. The results are candidates, to be
//! confirmed by rendering.

use image::RgbImage;
use image::imageops::thumbnail;

/// Maximum shift per search step, in pixels. If the best shift is at the end of this range, another step starts from
/// it, up to `SEARCHES` steps in all.
const REACH: i32 = 3;
const SEARCHES: usize = 8;
/// Maximum picture width for the zoom search, in pixels.
const WIDTH: u32 = 160;
/// Number of zooms tried on either side of 1, in steps of a factor of exp(0.02).
const ZOOMS: i32 = 26;

/// The shift to the right and down that brings `picture` closest to the photograph, in pixels, rounded to halves.
pub(in crate::evaluate) fn shift(photograph: &RgbImage, picture: &RgbImage) -> [f64; 2] {
    let error = |by: [i32; 2]| {
        let [dx, dy] = by.map(f64::from);
        error(photograph, picture, |x, y| (x - dx, y - dy))
    };
    let mut best = [0, 0];
    for _ in 0..SEARCHES {
        let [left, top] = best.map(|middle| middle - REACH);
        let [right, bottom] = best.map(|middle| middle + REACH);
        let all = (left..=right).flat_map(|x| (top..=bottom).map(move |y| [x, y]));
        best = least(all, error);
        let is_inside = left < best[0] && best[0] < right && top < best[1] && best[1] < bottom;
        if is_inside {
            break;
        }
    }
    // For each axis, the vertex of the parabola through the errors at the best shift and its neighbours. If the best
    // two errors are equal, it lies midway between their shifts, half a pixel from either.
    [0, 1].map(|axis| {
        let [before, at, after] = [-1, 0, 1].map(|step| {
            let mut near = best;
            near[axis] += step;
            error(near)
        });
        let offset = 0.5 * (before - after) / (before - 2.0 * at + after).max(f64::MIN_POSITIVE);
        let offset = if offset.is_finite() { offset } else { 0.0 };
        ((f64::from(best[axis]) + offset.clamp(-0.5, 0.5)) * 2.0).round() / 2.0
    })
}

/// The horizontal and vertical factors by which `picture` must be enlarged about `center` (in pixels) to match the
/// photograph. They are one common factor raised to the powers `along`. `None` if both are about 1.
pub(in crate::evaluate) fn zoom(
    photograph: &RgbImage,
    picture: &RgbImage,
    center: [f64; 2],
    along: [i32; 2],
) -> Option<[f64; 2]> {
    let (width, height) = photograph.dimensions();
    let shrink = f64::from(width.min(WIDTH)) / f64::from(width);
    let small = (
        width.min(WIDTH),
        (f64::from(height) * shrink).max(1.0) as u32,
    );
    let [seen, shown] = [photograph, picture].map(|all| thumbnail(all, small.0, small.1));
    let [cx, cy] = center.map(|c| c * shrink - 0.5);
    let error = |zoom: f64| {
        let [across, down] = along.map(|power| zoom.powi(power));
        error(&seen, &shown, |x, y| {
            ((x - cx) / across + cx, (y - cy) / down + cy)
        })
    };
    let about = |center: f64, steps: i32, step: f64| {
        let all = (-steps..=steps).map(move |k| center * (f64::from(k) * step).exp());
        least(all, error)
    };
    let best = about(about(1.0, ZOOMS, 0.02), 10, 0.002);
    let is_zoom = (best - 1.0).abs() > 0.01 && error(best) < error(1.0);
    is_zoom.then(|| along.map(|power| best.powi(power)))
}

fn least<T: Copy + Default>(all: impl Iterator<Item = T>, error: impl Fn(T) -> f64) -> T {
    let all = all.map(|at| (at, error(at)));
    let best = all.min_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|(at, _)| at).unwrap_or_default()
}

/// Mean squared difference of the green channel. `from` maps the photograph's pixels to the picture's. The result is
/// infinite if at least two thirds of the photograph's pixels fall outside the picture.
fn error(photograph: &RgbImage, picture: &RgbImage, from: impl Fn(f64, f64) -> (f64, f64)) -> f64 {
    let level = |x: f64, y: f64| f64::from(picture.get_pixel(x as u32, y as u32).0[1]);
    let (right, bottom) = (
        f64::from(picture.width()) - 1.0,
        f64::from(picture.height()) - 1.0,
    );
    let (mut sum, mut count) = (0.0, 0);
    for (x, y, seen) in photograph.enumerate_pixels() {
        let (x, y) = from(f64::from(x), f64::from(y));
        if (0.0..=right).contains(&x) && (0.0..=bottom).contains(&y) {
            let (x1, y1) = (x.ceil(), y.ceil());
            let (u, v) = (x.fract(), y.fract());
            let upper = level(x, y) * (1.0 - u) + level(x1, y) * u;
            let lower = level(x, y1) * (1.0 - u) + level(x1, y1) * u;
            sum += (f64::from(seen.0[1]) - upper * (1.0 - v) - lower * v).powi(2);
            count += 1;
        }
    }
    let is_enough = 3 * count > photograph.pixels().len();
    if is_enough {
        sum / count as f64
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    /// Waves moved by `by` and enlarged by `zoom` about the centre.
    fn waves(by: [f64; 2], zoom: f64) -> RgbImage {
        RgbImage::from_fn(120, 90, |x, y| {
            let x = (f64::from(x) - by[0] - 59.5) / zoom;
            let y = (f64::from(y) - by[1] - 44.5) / zoom;
            let wave = 50.0 * (x / 4.0 + (y / 9.0).cos()).sin() + 40.0 * (y / 5.0 + x / 30.0).cos();
            Rgb([(128.0 + wave) as u8; 3])
        })
    }

    #[test]
    fn shifts_are_found_to_half_a_pixel() {
        let found = |by: [f64; 2]| shift(&waves(by, 1.0), &waves([0.0; 2], 1.0));
        for by in [
            [0.0, 0.0],
            [0.5, 0.0],
            [1.0, 1.0],
            [0.5, 0.5],
            [-2.0, 1.5],
            [9.0, -6.5],
        ] {
            assert_eq!(found(by), by);
        }
        assert_eq!(found([0.1, -0.1]), [0.0, 0.0]);
    }

    #[test]
    fn zooms_are_found_and_one_is_none() {
        let found = |by: f64| {
            zoom(
                &waves([0.0; 2], by),
                &waves([0.0; 2], 1.0),
                [60.0, 45.0],
                [1, 1],
            )
            .map(|[across, _]| across)
        };
        for by in [1.2, 0.9, 1.5] {
            assert!((found(by).unwrap() - by).abs() < 0.005, "{:?}", found(by));
        }
        assert_eq!(found(1.0), None);
        let dot = RgbImage::new(1, 1);
        assert_eq!(
            (zoom(&dot, &dot, [0.5; 2], [0, 1]), shift(&dot, &dot)),
            (None, [0.0; 2])
        );
    }
}
