//! Detects pictures that frame the target differently: zoomed, rolled or shifted.
//!
//! Wrong depths move the content of a picture only along epipolar lines. Displacements across them are evidence of a
//! wrong camera or a crop, however poor the prediction is.

use glam::{DMat4, DVec2, DVec3, DVec4};
use image::RgbImage;
use image::imageops::thumbnail;
use sharp::camera::Intrinsics;

use super::finding::Framing;
use super::picture_motion::{HALF, LEAST_CONTRAST, correlation, patch};

/// Number of blocks across and down.
const GRID: [u32; 2] = [12, 8];
/// Minimum distance of their centres from the edges, pixels: blocks are as large in pictures of half size.
const INSET: f64 = 2.0 * HALF as f64 + 1.0;
/// Radius of the search for a block: first around its own place in the picture of half size, as a share of the width,
/// then around the place found there, in pixels of the shrunk picture.
const REACH: f64 = 0.15;
const REFINED: i32 = 2;
/// Minimum correlation of a block with its place in the picture, and how much lower it must be elsewhere.
const FOUND: (f64, f64) = (0.7, 0.05);
/// Minimum number of blocks found, and their minimum share.
const LEAST_FOUND: (usize, f64) = (12, 0.15);
/// Number of reweighted least-squares steps.
const STEPS: usize = 12;
/// Weight of the prior for an unchanged framing, in blocks.
const PRIOR: f64 = 0.05;
/// Maximum distance from the fit of a block that agrees with it, pixels, and the share of the blocks that must agree.
const AGREEING: (f64, f64) = (1.0, 0.6);
/// The mean distance from the lines must fall by this many pixels, and to this share.
const GAIN: (f64, f64) = (0.3, 0.5);
/// Larger distances count as this one, pixels.
const MOST: f64 = 3.0;

/// Measures how a picture frames its target; `None` if the framing is correct or cannot be measured. Picture and
/// target's photograph are shrunk to the same size; `intrinsics` are the target's at full size, and `translation` is
/// that of the pose that maps from the source's camera to the target's.
pub(super) fn shown_framing(
    intrinsics: Intrinsics,
    translation: DVec3,
    [target, shown]: [&RgbImage; 2],
) -> Option<Framing> {
    let (width, height) = target.dimensions();
    let camera = intrinsics.resized(width, height);
    let focal = DVec2::new(camera.fx, camera.fy);
    let middle = DVec2::new(camera.cx, camera.cy);
    let coarse = [target, shown].map(|p| thumbnail(p, width.div_ceil(2), height.div_ceil(2)));
    let across = |k: u32, of: u32, size: u32| {
        let inner = f64::from(size) - 2.0 * INSET;
        INSET + (f64::from(k) + 0.5) * inner / f64::from(of)
    };
    let centres = (0..GRID[0] * GRID[1]).map(|k| {
        DVec2::new(
            across(k % GRID[0], GRID[0], width),
            across(k / GRID[0], GRID[1], height),
        )
    });
    let blocks = centres.filter_map(|centre| {
        let has_contrast = patch(target, centre)?.1 >= LEAST_CONTRAST;
        has_contrast.then_some(centre)
    });
    let blocks: Vec<DVec2> = blocks.collect();
    let reach = (REACH * f64::from(width) / 2.0) as i32;
    let half = f64::from(width) / 2.0;
    let lines = blocks.iter().filter_map(|centre| {
        // Another depth moves the block's content along this direction.
        let from_middle = *centre - middle;
        let along = focal * translation.truncate() - from_middle * translation.z;
        let beside = along.perp().try_normalize()?;
        let near = locate([&coarse[0], &coarse[1]], *centre / 2.0, DVec2::ZERO, reach)?;
        let off = locate([target, shown], *centre, 2.0 * near, REFINED)?;
        let at = from_middle / half;
        let row = DVec4::new(beside.dot(at), beside.dot(at.perp()), beside.x, beside.y);
        Some((row, beside.dot(off)))
    });
    let lines: Vec<(DVec4, f64)> = lines.collect();
    if lines.len() < LEAST_FOUND.0 || (lines.len() as f64) < LEAST_FOUND.1 * blocks.len() as f64 {
        return None;
    }
    let fit = fitted(&lines)?;
    let mean = |fit: DVec4| {
        let off = lines
            .iter()
            .map(|(row, off)| (off - row.dot(fit)).abs().min(MOST));
        off.sum::<f64>() / lines.len() as f64
    };
    let agreeing = lines
        .iter()
        .filter(|(row, off)| (off - row.dot(fit)).abs() <= AGREEING.0);
    let [before, after] = [DVec4::ZERO, fit].map(mean);
    let is_clear = agreeing.count() as f64 >= AGREEING.1 * lines.len() as f64
        && before - after >= GAIN.0
        && after <= GAIN.1 * before;
    let thousandths = |v: f64| (1000.0 * v).round() as i16;
    let framing = Framing {
        zoom: thousandths(1.0 + fit.x / half),
        roll: thousandths((fit.y / half).atan().to_degrees()),
        shift: [fit.z, fit.w].map(|v| thousandths(v / f64::from(width))),
    };
    (is_clear && framing.is_wrong()).then_some(framing)
}

/// Offset at which a block of the first picture is found in the second one: `start`, or at most `reach` pixels from it
/// in x and y.
fn locate([of, shown]: [&RgbImage; 2], centre: DVec2, start: DVec2, reach: i32) -> Option<DVec2> {
    let (block, _) = patch(of, centre)?;
    let places = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y)));
    let all = places.filter_map(|(x, y)| {
        let off = start + DVec2::new(x.into(), y.into());
        Some((off, correlation(&block, shown, centre + off)?))
    });
    let all: Vec<(DVec2, f64)> = all.collect();
    let best = all.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let elsewhere = all.iter().filter(|(off, _)| off.distance(best.0) > 2.9);
    let elsewhere = elsewhere.map(|(_, like)| *like).fold(-1.0, f64::max);
    (best.1 >= FOUND.0 && elsewhere <= best.1 - FOUND.1).then_some(best.0)
}

/// Fits zoom, roll and shift to distances from the lines by least absolute deviation. Zoom and roll are given as
/// displacements at half a width from the principal point; all are in pixels.
fn fitted(lines: &[(DVec4, f64)]) -> Option<DVec4> {
    let mut fit = DVec4::ZERO;
    for _ in 0..STEPS {
        let mut normal = DMat4::from_diagonal(DVec4::splat(PRIOR));
        let mut sums = DVec4::ZERO;
        for (row, off) in lines {
            let weight = (off - row.dot(fit)).abs().max(0.3).recip();
            normal +=
                DMat4::from_cols(row.x * *row, row.y * *row, row.z * *row, row.w * *row) * weight;
            sums += weight * *off * *row;
        }
        fit = normal.inverse() * sums;
    }
    fit.is_finite().then_some(fit)
}

#[cfg(test)]
mod tests {
    use image::imageops::fast_blur;
    use sharp::camera::RigidTransform;

    use super::super::picture_motion::tests::{PLANE, camera, pose, view};
    use super::*;

    /// How pictures by another camera, turned by `roll` radians, frame two targets: one of a stereo pair, one of a turned
    /// camera. `plane` is the predicted depth.
    fn told(intrinsics: Intrinsics, roll: f64, plane: DVec3) -> [Option<Framing>; 2] {
        let stereo = pose(0.0, [-0.15, 0.0, 0.0]);
        let turned = pose(0.03, [0.12, 0.06, 0.02]);
        [stereo, turned].map(|own| {
            let target = view(camera(80.0), own, PLANE);
            let rotation = glam::DMat3::from_rotation_z(roll);
            let rolled = RigidTransform {
                rotation: rotation * own.rotation,
                translation: rotation * own.translation,
            };
            let shown = fast_blur(&view(intrinsics, rolled, plane), 0.5);
            shown_framing(camera(80.0), own.translation, [&target, &shown])
        })
    }

    #[test]
    fn other_cameras_are_measured() {
        let right = camera(80.0);
        let with = |zoom: f64, [x, y]: [f64; 2]| Intrinsics {
            fx: zoom * right.fx,
            fy: zoom * right.fy,
            cx: right.cx + x,
            cy: right.cy + y,
            ..right
        };
        for (zoom, roll, shift) in [
            (0.8, 0.0, [0.0; 2]),
            (1.25, 0.0, [0.0; 2]),
            (1.06, 0.0, [0.0, 2.0]),
            (1.0, 0.03, [0.0; 2]),
            (1.0, 0.0, [0.0, -3.0]),
            (1.0, 0.0, [2.0, 4.0]),
        ] {
            let [_, found] = told(with(zoom, shift), roll, PLANE);
            let found = found.unwrap_or_else(|| panic!("{zoom} {roll} {shift:?}"));
            // Along the lines, a shift cannot be distinguished from wrong depth.
            let (off, along) = (
                DVec2::from(shift) / 0.16,
                DVec2::new(0.12, 0.06).normalize(),
            );
            let off = (off - along * off.dot(along)).to_array();
            assert!(
                (f64::from(found.zoom) - 1000.0 * zoom).abs() < 15.0,
                "{zoom}: {found:?}"
            );
            assert!(
                (f64::from(found.roll) - 1000.0 * roll.to_degrees()).abs() < 500.0,
                "{roll}: {found:?}"
            );
            for (by, off) in found.shift.into_iter().zip(off) {
                assert!(
                    (f64::from(by) - off).abs() < if zoom == 1.0 { 5.0 } else { 15.0 },
                    "{shift:?}: {found:?}"
                );
            }
        }
    }

    #[test]
    fn shifts_along_a_baseline_cannot_be_told_from_wrong_depth() {
        let right = camera(80.0);
        let shifted = |x: f64, y: f64| Intrinsics {
            cx: right.cx + x,
            cy: right.cy + y,
            ..right
        };
        assert_eq!(told(shifted(4.0, 0.0), 0.0, PLANE)[0], None);
        assert!(told(shifted(0.0, 4.0), 0.0, PLANE)[0].unwrap().shift[1] > 20);
    }

    #[test]
    fn right_cameras_are_not_told() {
        let right = camera(80.0);
        for plane in [
            PLANE,
            DVec3::new(0.06, 0.12, 0.4),
            DVec3::new(-0.2, 0.5, 0.4),
            DVec3::new(0.0, 0.0, 0.45),
        ] {
            assert_eq!(told(right, 0.0, plane), [None; 2]);
            let slightly = Intrinsics {
                cy: right.cy + 0.25,
                fy: 1.004 * right.fy,
                ..right
            };
            assert_eq!(told(slightly, 0.0, plane), [None; 2]);
        }
    }
}
