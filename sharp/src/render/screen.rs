//! Screen on which the SHARP release renders a photograph's scene.

use crate::camera::Intrinsics;

/// Photographs higher than this, in pixels, are halved.
const MAX_HEIGHT: u32 = 3000;

/// Intrinsics with which the SHARP release's `sharp render` shows a scene predicted from a photograph.
///
/// The photograph's principal point is ignored and replaced by ((W − 1) / 2, (H − 1) / 2). The
/// release's own prediction uses (W / 2, H / 2), which is half a pixel away. A photograph higher
/// than 3000 pixels is halved in both directions; then odd sides grow by one pixel, as the
/// release's video encoder requires. Focal lengths and principal point are scaled accordingly.
pub fn release_screen(photo: &Intrinsics) -> Intrinsics {
    let halve = photo.height > MAX_HEIGHT;
    let [width, height] = [photo.width, photo.height].map(|side| {
        let side = if halve { side / 2 } else { side };
        side + side % 2
    });
    let shifted = Intrinsics {
        cx: f64::from(photo.width - 1) / 2.0,
        cy: f64::from(photo.height - 1) / 2.0,
        ..*photo
    };
    shifted.resized(width, height)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn screen(width: u32, height: u32) -> Intrinsics {
        let center = (f64::from(width) / 2.0, f64::from(height) / 2.0);
        release_screen(&Intrinsics::new((500.0, 500.0), center, (width, height)).unwrap())
    }

    #[test]
    fn the_releases_sizes_and_half_pixel() {
        let even = screen(640, 480);
        assert_eq!((even.width, even.height), (640, 480));
        assert_eq!((even.fx, even.cx, even.cy), (500.0, 319.5, 239.5));

        let odd = screen(641, 480);
        assert_eq!((odd.width, odd.height), (642, 480));
        assert!((odd.cx - 320.0 * 642.0 / 641.0).abs() < 1e-12);
        assert!((odd.fx - 500.0 * 642.0 / 641.0).abs() < 1e-12 && odd.fy == 500.0);

        let high = screen(2000, 3001);
        assert_eq!((high.width, high.height), (1000, 1500));
        assert!((high.cx - 999.5 / 2.0).abs() < 1e-12);
        assert!((high.cy - 1500.0 * 1500.0 / 3001.0).abs() < 1e-12);
        assert_eq!(screen(4000, 3000).width, 4000);
    }
}
