//! Resampling of planar f32 images: bilinear as in the network, and nearest for depth.
//!
//! An image is a slice of `channels` planes, each row by row: `[channels, height, width]`.

/// One output coordinate of a linear resize: two source positions and the weight of the second.
#[derive(Debug, Clone, Copy)]
struct Tap {
    low: usize,
    high: usize,
    weight: f32,
}

/// Source positions with the centres of the corner pixels aligned, `src = dst · (in − 1) / (out − 1)`. Scale and
/// position are f32 as in the SHARP release; f64 would change results by up to 1e-5.
fn align_corners_taps(input: usize, output: usize) -> Vec<Tap> {
    let scale = if output > 1 {
        (input - 1) as f32 / (output - 1) as f32
    } else {
        0.0
    };
    taps(input, output, |dst| scale * dst)
}

/// Source positions with pixel centres at halves, `src = (dst + ½) · in / out − ½`, at least 0; in f32 as in PyTorch.
fn half_pixel_taps(input: usize, output: usize) -> Vec<Tap> {
    let scale = input as f32 / output as f32;
    taps(input, output, |dst| (scale * (dst + 0.5) - 0.5).max(0.0))
}

/// Taps at the source positions that `position` gives for the output's coordinates.
fn taps(input: usize, output: usize, position: impl Fn(f32) -> f32) -> Vec<Tap> {
    (0..output)
        .map(|dst| {
            let src = position(dst as f32);
            let low = (src as usize).min(input - 1);
            Tap {
                low,
                high: (low + 1).min(input - 1),
                weight: (src - low as f32).clamp(0.0, 1.0),
            }
        })
        .collect()
}

/// Bilinear resize with aligned corners and without antialiasing, as the SHARP release applies it to photographs before
/// the network, for both upscaling and downscaling.
///
/// `planes` is `[channels, height, width]`; the result is `[channels, out_height, out_width]`.
///
/// # Panics
/// If the length of `planes` is not a multiple of `height × width`, or either side is 0.
pub fn bilinear_align_corners(
    planes: &[f32],
    size: (usize, usize),
    out_size: (usize, usize),
) -> Vec<f32> {
    bilinear(planes, size, out_size, align_corners_taps)
}

/// Bilinear resize by pixel centres and without antialiasing, as Depth Pro applies it to photographs and depth.
///
/// Shapes and panics are as for [`bilinear_align_corners`].
pub fn bilinear_half_pixel(
    planes: &[f32],
    size: (usize, usize),
    out_size: (usize, usize),
) -> Vec<f32> {
    bilinear(planes, size, out_size, half_pixel_taps)
}

fn bilinear(
    planes: &[f32],
    (width, height): (usize, usize),
    (out_width, out_height): (usize, usize),
    taps: impl Fn(usize, usize) -> Vec<Tap>,
) -> Vec<f32> {
    let plane = width * height;
    assert!(
        plane > 0 && planes.len().is_multiple_of(plane),
        "planes of {width}x{height} expected"
    );
    let (columns, rows) = (taps(width, out_width), taps(height, out_height));
    let mut out = Vec::with_capacity(planes.len() / plane * out_width * out_height);
    for image in planes.chunks_exact(plane) {
        for row in &rows {
            let top = &image[row.low * width..][..width];
            let bottom = &image[row.high * width..][..width];
            let (upper, lower) = (1.0 - row.weight, row.weight);
            out.extend(columns.iter().map(|column| {
                let (left, right) = (1.0 - column.weight, column.weight);
                upper * (left * top[column.low] + right * top[column.high])
                    + lower * (left * bottom[column.low] + right * bottom[column.high])
            }));
        }
    }
    out
}

/// Nearest resize of one plane `[height, width]`: each output pixel takes the value of the source
/// pixel that contains its centre, `floor((dst + ½) · in / out)` in integers. Used for depth,
/// because the mean of two depths lies on neither surface.
///
/// # Panics
/// If the length of `plane` is not `height × width`, or either side is 0.
pub fn nearest<T: Copy>(
    plane: &[T],
    (width, height): (usize, usize),
    (out_width, out_height): (usize, usize),
) -> Vec<T> {
    assert!(
        width > 0 && height > 0 && plane.len() == width * height,
        "a plane of {width}x{height} expected"
    );
    let source = |dst: usize, input: usize, output: usize| (2 * dst + 1) * input / (2 * output);
    let columns: Vec<usize> = (0..out_width)
        .map(|x| source(x, width, out_width))
        .collect();
    let mut out = Vec::with_capacity(out_width * out_height);
    for y in 0..out_height {
        let row = &plane[source(y, height, out_height) * width..][..width];
        out.extend(columns.iter().map(|&x| row[x]));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_stay_and_the_middle_is_interpolated() {
        let out = bilinear_align_corners(&[0.0, 1.0, 2.0, 3.0], (2, 2), (3, 3));
        assert_eq!(out, [0.0, 0.5, 1.0, 1.0, 1.5, 2.0, 2.0, 2.5, 3.0]);
    }

    #[test]
    fn the_same_size_is_the_identity_and_planes_do_not_mix() {
        let planes: Vec<f32> = (0..24).map(|k| (k * 7 % 11) as f32).collect();
        assert_eq!(bilinear_align_corners(&planes, (4, 3), (4, 3)), planes);
        let both = bilinear_align_corners(&planes, (4, 3), (5, 5));
        assert_eq!(
            both[25..],
            bilinear_align_corners(&planes[12..], (4, 3), (5, 5))
        );
    }

    #[test]
    fn downscaling_samples_without_a_filter() {
        // Five pixels to three: positions 0, 2, 4 exactly.
        let out = bilinear_align_corners(&[5.0, 9.0, 7.0, 9.0, 6.0], (5, 1), (3, 1));
        assert_eq!(out, [5.0, 7.0, 6.0]);
    }

    #[test]
    fn pixel_centres_are_at_halves() {
        // Doubled: positions −0.25 (taken as 0), 0.25, 0.75, 1.25 (beyond the last pixel's centre).
        let out = bilinear_half_pixel(&[0.0, 4.0], (2, 1), (4, 1));
        assert_eq!(out, [0.0, 1.0, 3.0, 4.0]);
        assert_eq!(
            bilinear_half_pixel(&[2.0, 4.0, 6.0, 8.0], (4, 1), (2, 1)),
            [3.0, 7.0]
        );
    }

    #[test]
    fn one_pixel_fills_everything() {
        assert_eq!(bilinear_align_corners(&[3.0], (1, 1), (2, 2)), [3.0; 4]);
    }

    #[test]
    fn nearest_takes_the_pixel_under_the_centre() {
        assert_eq!(nearest(&[1, 2], (2, 1), (4, 1)), [1, 1, 2, 2]);
        assert_eq!(nearest(&[1, 2, 3], (3, 1), (2, 1)), [1, 3]);
        assert_eq!(nearest(&[1, 2, 3, 4], (2, 2), (2, 2)), [1, 2, 3, 4]);
    }
}
