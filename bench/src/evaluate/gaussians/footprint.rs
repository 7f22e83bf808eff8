//! Coverage of a picture by Gaussians, which determines the cost of sorting and blending them.

use glam::{DMat3, DQuat, DVec3};
use image::RgbImage;
use rayon::prelude::*;
use sharp::gaussians::Gaussians;
use sharp::render::{Background, RenderView};

use crate::rendering::shared::HOLE_ALPHA;

/// Holes are reported only if at least this share of the pixels is empty.
pub(in crate::evaluate) const MIN_HOLES: f64 = 0.02;
/// [`other_background`] advises white (or black) only if at least this share of the holes' pixels has that colour in
/// the photograph.
const MIN_PLAIN: f64 = 0.9;
/// Side of a tile, pixels, as in gsplat.
const TILE: f64 = 16.0;
/// Minimum alpha at which Gaussians are blended.
const MIN_ALPHA: f64 = 1.0 / 255.0;
/// Centres farther outside the picture than this fraction of its sides are moved to this distance before the projection
/// is linearised.
const MARGIN: f64 = 0.15;

/// Numbers of columns and rows of the grid of parts in which [`missing_share`] looks for empty ones.
const PARTS: (u32, u32) = (8, 6);
/// A part counts as empty if at most this share of it is covered.
const MAX_COVERED: f64 = 0.02;
/// A part of the file may be missing if at least this share of the picture is empty.
const MIN_MISSING: f64 = 0.15;
/// A part of the file may be missing if the empty parts contain at least this share of the photograph's detail. Skies
/// and plain backgrounds, where Gaussians may be left out on purpose, have hardly any detail.
const MIN_DETAIL: f64 = 0.2;

/// The share of the picture that is not covered, given the rendering's `alpha`. `None` if the share is below
/// [`MIN_MISSING`], or if empty parts contain less than [`MIN_DETAIL`] of the photograph's detail.
pub(in crate::evaluate) fn missing_share(photograph: &RgbImage, alpha: &[f32]) -> Option<f64> {
    let (width, height) = photograph.dimensions();
    let mut parts = [(0.0, 0.0, 0.0); (PARTS.0 * PARTS.1) as usize];
    let level = |x: u32, y: u32| photograph.get_pixel(x, y).0[1];
    let is_covered = |at: usize| alpha.get(at).is_some_and(|alpha| *alpha >= HOLE_ALPHA);
    for at in 0..alpha.len() {
        let (x, y) = (at as u32 % width, at as u32 / width);
        let part = (y * PARTS.1 / height) * PARTS.0 + x * PARTS.0 / width;
        let (pixels, covered, detail) = parts.get_mut(part as usize)?;
        *pixels += 1.0;
        *covered += f64::from(u8::from(is_covered(at)));
        // Steps are limited, so that a single sharp edge is not decisive. The outline of the covered area does not
        // count as detail.
        for (right, below) in [(x + 1, y), (x, y + 1)] {
            let next = (below * width + right) as usize;
            if right < width && below < height && is_covered(next) == is_covered(at) {
                let step = level(x, y).abs_diff(level(right, below)).min(32);
                *detail += f64::from(step).powi(2);
            }
        }
    }
    let empty = |part: &&(f64, f64, f64)| part.1 <= MAX_COVERED * part.0;
    let detail: f64 = parts.iter().map(|part| part.2).sum();
    let lost: f64 = parts.iter().filter(empty).map(|part| part.2).sum();
    let covered: f64 = parts.iter().map(|part| part.1).sum();
    let missing = 1.0 - covered / alpha.len().max(1) as f64;
    (missing >= MIN_MISSING && detail > 0.0 && lost >= MIN_DETAIL * detail).then_some(missing)
}

/// Advises another background if the photograph is white, or black, wherever `alpha` has holes, and the rendering's
/// background has another colour.
pub(super) fn other_background(
    photograph: &RgbImage,
    alpha: &[f32],
    background: Background,
) -> Option<String> {
    let holes = photograph.pixels().zip(alpha);
    let holes = holes.filter(|(_, alpha)| **alpha < HOLE_ALPHA);
    let holes: Vec<[u8; 3]> = holes.map(|(pixel, _)| pixel.0).collect();
    let share = holes.len() as f64 / alpha.len().max(1) as f64;
    let mostly = |is: fn(&u8) -> bool| {
        let count = holes.iter().filter(|pixel| pixel.iter().all(is)).count();
        count as f64 >= MIN_PLAIN * holes.len() as f64
    };
    let other = if background != Background::White && mostly(|level| *level >= 250) {
        "white"
    } else if background != Background::Black && mostly(|level| *level <= 5) {
        "black"
    } else {
        return None;
    };
    (share >= MIN_HOLES).then(|| {
        format!(
            "its Gaussians leave {:.0} % of their source's photograph empty, where the photograph is \
             {other}, but the rendering has another background; set --background {other}",
            100.0 * share
        )
    })
}

/// Share of the pixels whose value in `alpha` is below [`HOLE_ALPHA`].
pub(in crate::evaluate) fn hole_share(alpha: &[f32]) -> f64 {
    let holes = alpha.iter().filter(|alpha| **alpha < HOLE_ALPHA).count();
    holes as f64 / alpha.len().max(1) as f64
}

/// The number of 16 × 16 pixel tiles that each Gaussian's bounding box touches, summed over Gaussians, and the number
/// of tiles in the picture. A Gaussian's box bounds the pixels where its alpha can reach 1/255, under the projection of
/// SHARP's rule, in f64.
pub(in crate::evaluate) fn covered_tiles(gaussians: &Gaussians, view: &RenderView) -> (u64, u64) {
    let (width, height) = (view.intrinsics.width, view.intrinsics.height);
    let tiles = [width, height].map(|side| f64::from(side.div_ceil(TILE as u32)));
    let covered = (0..gaussians.len()).into_par_iter().map(|at| {
        let Some([x, y]) = reach(gaussians, at, view) else {
            return 0;
        };
        let touched = [x, y].into_iter().zip(tiles).map(|((low, high), tiles)| {
            let (first, last) = (
                (low / TILE).floor().max(0.0),
                (high / TILE).ceil().min(tiles),
            );
            (last - first).max(0.0)
        });
        touched.product::<f64>() as u64
    });
    (covered.sum(), (tiles[0] * tiles[1]) as u64)
}

/// Extent of a Gaussian in x and y, pixels; `None` if it is not drawn.
fn reach(gaussians: &Gaussians, at: usize, view: &RenderView) -> Option<[(f64, f64); 2]> {
    let opacity = f64::from(gaussians.opacities[at]);
    if opacity < MIN_ALPHA {
        return None;
    }
    let Projected { centre, rows } = projected(gaussians, at, view)?;
    let sigmas = (2.0 * (opacity / MIN_ALPHA).ln()).sqrt();
    let low_pass = f64::from(view.rule.low_pass);
    let reach = rows.into_iter().zip(centre).map(|(row, centre)| {
        let reach = sigmas * (row.length_squared() + low_pass).sqrt();
        (centre - reach, centre + reach)
    });
    let reach: Vec<(f64, f64)> = reach.collect();
    let is_finite = reach
        .iter()
        .all(|(low, high)| low.is_finite() && high.is_finite());
    is_finite.then(|| [reach[0], reach[1]])
}

/// Mean area of the Gaussians in front of the camera, in squared pixels. A Gaussian's area is the product of the
/// standard deviations of its projected ellipse.
pub(in crate::evaluate) fn mean_area(gaussians: &Gaussians, view: &RenderView) -> f64 {
    let low_pass = f64::from(view.rule.low_pass);
    let all = (0..gaussians.len()).filter_map(|at| projected(gaussians, at, view));
    let (sum, n) = all.fold((0.0, 0), |(sum, n), Projected { rows: [x, y], .. }| {
        let [xx, yy] = [x, y].map(|row| row.length_squared() + low_pass);
        (sum + (xx * yy - x.dot(y).powi(2)).max(0.0).sqrt(), n + 1)
    });
    sum / f64::from(n.max(1))
}

/// A Gaussian's projection, in pixels.
struct Projected {
    centre: [f64; 2],
    /// Rows of the projection's Jacobian in the Gaussian's own axes: how many pixels the projection moves to the right,
    /// and how many down, per standard deviation along each axis.
    rows: [DVec3; 2],
}

/// Projects a Gaussian; `None` if it lies outside the near and far planes, or its quaternion is zero.
fn projected(gaussians: &Gaussians, at: usize, view: &RenderView) -> Option<Projected> {
    let k = view.intrinsics;
    let mean = DVec3::from_array(gaussians.means[at].map(f64::from));
    let p = view.camera_from_scene.transform_point3(mean);
    if !(f64::from(view.rule.near)..=f64::from(view.rule.far)).contains(&p.z) {
        return None;
    }
    let [w, x, y, z] = gaussians.quaternions[at].map(f64::from);
    let rotation = DQuat::from_xyzw(x, y, z, w);
    if rotation.length_squared() == 0.0 {
        return None;
    }
    let scales = DVec3::from_array(gaussians.scales[at].map(f64::from));
    let axes = DMat3::from_quat(rotation.normalize()) * DMat3::from_diagonal(scales);
    let axes = view.camera_from_scene.matrix3 * axes;
    let clamped = |slope: f64, focal: f64, centre: f64, side: u32| {
        let side = f64::from(side);
        let (low, high) = (-centre - MARGIN * side, side - centre + MARGIN * side);
        slope.clamp(low / focal, high / focal)
    };
    let slope = [
        clamped(p.x / p.z, k.fx, k.cx, k.width),
        clamped(p.y / p.z, k.fy, k.cy, k.height),
    ];
    let rows = [
        DVec3::new(k.fx / p.z, 0.0, -k.fx * slope[0] / p.z),
        DVec3::new(0.0, k.fy / p.z, -k.fy * slope[1] / p.z),
    ];
    Some(Projected {
        centre: [k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy],
        rows: rows.map(|row| axes.transpose() * row),
    })
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;
    use sharp::camera::Intrinsics;

    use super::*;

    #[test]
    fn another_background_is_advised_if_all_holes_have_its_colour() {
        let photograph = |plain: u8| {
            RgbImage::from_fn(40, 30, |x, y| {
                if x < 10 {
                    image::Rgb([plain; 3])
                } else {
                    image::Rgb([(5 * x) as u8, (8 * y) as u8, 90])
                }
            })
        };
        let alpha = |holes: u32| -> Vec<f32> {
            let all = (0..1200).map(|k| if k % 40 < holes { 0.0 } else { 1.0 });
            all.collect()
        };
        let advised = |plain: u8, holes: u32, background: Background| {
            let said = other_background(&photograph(plain), &alpha(holes), background)?;
            Some(said.rsplit(' ').next().unwrap().to_owned())
        };
        let (black, white) = (Background::Black, Background::White);
        assert_eq!(advised(255, 10, black).as_deref(), Some("white"));
        assert_eq!(advised(0, 10, white).as_deref(), Some("black"));
        for (plain, holes, background) in [
            (255, 10, white),
            (0, 10, black),
            (255, 0, black),
            (255, 30, black),
            (200, 10, black),
        ] {
            assert_eq!(advised(plain, holes, background), None, "{plain} {holes}");
        }
    }

    /// A picture of 4 × 3 tiles with focal length 100. Gaussians are on its axis, 2 m away, with a
    /// standard deviation of 2 pixels, unless stated otherwise.
    #[test]
    fn tiles_are_those_that_the_box_of_a_gaussian_touches() {
        let intrinsics = Intrinsics::new((100.0, 100.0), (24.0, 24.0), (64, 48)).unwrap();
        let view = RenderView::new(DAffine3::IDENTITY, intrinsics);
        let tiles = |mean: [f32; 3], opacity: f32, scale: f32| {
            let one = Gaussians::new(
                vec![mean],
                vec![[1.0, 0.0, 0.0, 0.0]],
                vec![[scale; 3]],
                vec![opacity],
                vec![[0.5; 3]],
            );
            covered_tiles(&one.unwrap(), &view)
        };
        // An opaque Gaussian extends √(2 ln 255) = 3.33 deviations: from 17.3 to 30.7, inside one
        // tile.
        assert_eq!(tiles([0.0, 0.0, 2.0], 1.0, 0.04), (1, 12));
        // 8 pixels to the right and down, at the corner of four tiles; touches all four even if
        // nearly transparent.
        assert_eq!(tiles([0.16, 0.16, 2.0], 1.0, 0.04), (4, 12));
        assert_eq!(tiles([0.16, 0.16, 2.0], 1.1 / 255.0, 0.04), (4, 12));
        // Half outside the left edge.
        assert_eq!(tiles([-0.48, 0.0, 2.0], 1.0, 0.04), (1, 12));
        assert_eq!(tiles([0.0, 0.0, 2.0], 0.003, 0.04), (0, 12));
        assert_eq!(tiles([0.0, 0.0, -2.0], 1.0, 0.04), (0, 12));
        // Covers the whole picture.
        assert_eq!(tiles([0.0, 0.0, 2.0], 1.0, 10.0), (12, 12));
    }

    #[test]
    fn large_empty_parts_with_detail_are_missing_and_skies_and_gaps_are_not() {
        // Waves below a plain sky.
        let (width, height) = (64, 48);
        let photograph = |sky: u32| {
            RgbImage::from_fn(width, height, |x, y| {
                if y < sky {
                    image::Rgb([200, 200 + (x % 2) as u8, 220])
                } else {
                    image::Rgb([(128.0 + 60.0 * (f64::from(x + y)).sin()) as u8; 3])
                }
            })
        };
        let share = |sky: u32, covered: &dyn Fn(u32, u32) -> bool| {
            let alpha =
                (0..width * height).map(|at| f32::from(u8::from(covered(at % width, at / width))));
            missing_share(&photograph(sky), &alpha.collect::<Vec<_>>())
        };
        assert_eq!(share(0, &|_, y| y < 24), Some(0.5));
        assert_eq!(share(0, &|x, _| x >= 32), Some(0.5));
        assert_eq!(share(0, &|_, _| true), None);
        assert_eq!(share(0, &|_, y| y < 36), None);
        assert_eq!(share(24, &|_, y| y >= 24), None);
        // Sparse or thin.
        assert_eq!(share(0, &|x, y| (x + 3 * y) % 7 == 0), None);
    }
}
