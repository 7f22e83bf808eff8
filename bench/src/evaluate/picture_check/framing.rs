//! Detects pictures that frame the target differently: zoomed, rolled, shifted or distorted by a lens.
//!
//! Wrong depths move the content of a picture only along epipolar lines. Displacements across these lines are therefore
//! evidence of a wrong camera or a crop, however poor the prediction is.

use glam::{DMat2, DMat4, DVec2, DVec3, DVec4};
use image::imageops::{sample_bilinear, thumbnail};
use image::{Rgb, RgbImage};
use sharp::camera::Intrinsics;

use super::finding::Framing;
use super::measures::ShiftEquations;
use super::motion::{HALF, MIN_CONTRAST, correlation, patch};

/// Number of blocks across and down.
const GRID: [u32; 2] = [12, 8];
/// Minimum distance of block centres from the edges, in pixels. Twice the space that a block needs, because blocks keep
/// their size when pictures are halved.
const INSET: f64 = 2.0 * HALF as f64 + 1.0;
/// Radius of the first search for a block around its place in the target, as a share of the width. Target and picture
/// are at half size.
const REACH: f64 = 0.15;
/// Radius of the second search, around the place found by the first, in pixels at the shrunk size.
const REFINED_REACH: i32 = 2;
/// Minimum correlation at the place where a block is found.
const MIN_CORRELATION: f64 = 0.7;
/// A block is found only if its correlation exceeds the correlations at other places by at least this.
const MIN_DISTINCTION: f64 = 0.05;
/// A framing is measured only if at least this many blocks are found.
const MIN_FOUND: usize = 12;
/// A framing is measured only if at least this share of the blocks is found.
const MIN_FOUND_SHARE: f64 = 0.15;
/// Number of steps of a fit by reweighted least squares.
const STEPS: usize = 12;
/// Weight of the prior for an unchanged framing, relative to one block.
const PRIOR: f64 = 0.05;
/// Maximum residual of a block that agrees with a fit, in pixels.
const MAX_OFF_FIT: f64 = 1.0;
/// A fit is accepted only if at least this share of the blocks agree with it.
const MIN_AGREEING: f64 = 0.6;
/// Conditions for accepting a fit: the minimum decrease of the mean distance from the epipolar lines, in pixels, and
/// the maximum remaining distance, as a fraction of the distance without the fit.
const GAIN: (f64, f64) = (0.3, 0.5);
/// Like [`GAIN`], but for a lens's distortion, which hardly moves the middle of the picture.
const GAIN_OF_LENS: (f64, f64) = (0.1, 0.6);
/// If a measured zoom differs from 1 by at least this, it is undone and the blocks are searched again.
const MIN_RESAMPLED_ZOOM: f64 = 0.01;
/// Maximum number of searches with a zoom undone.
const MAX_RESAMPLINGS: usize = 4;
/// Zooms that are tried if too few blocks are found in the picture as it is.
const PRESETS: [f64; 6] = [0.75, 0.8, 0.87, 1.15, 1.25, 1.33];
/// Distances from the epipolar lines are limited to this, in pixels, so that outliers do not dominate.
const MAX_DISTANCE: f64 = 3.0;

/// The places in a picture at which the blocks of its target are found.
pub(super) struct DisplacedBlocks<'a> {
    view: FramedTarget<'a>,
    shown: &'a RgbImage,
    as_read: Measured,
}

impl<'a> DisplacedBlocks<'a> {
    /// Finds the target's blocks in the picture `shown`. Both are shrunk to the same size. `intrinsics` are the
    /// target's at full size. `translation` belongs to the pose that maps the source's camera to the target's.
    pub(super) fn of(
        intrinsics: Intrinsics,
        translation: DVec3,
        [target, shown]: [&'a RgbImage; 2],
    ) -> Self {
        let (width, height) = target.dimensions();
        let camera = intrinsics.resized(width, height);
        let view = FramedTarget {
            focal: DVec2::new(camera.fx, camera.fy),
            middle: DVec2::new(camera.cx, camera.cy),
            half: f64::from(width) / 2.0,
            translation,
            blocks: blocks_of(target),
            target,
        };
        let as_read = view.measured(shown, 1.0);
        Self {
            view,
            shown,
            as_read,
        }
    }

    /// The equations of the picture's shift in thousandths of its width; `None` if too few blocks are found.
    pub(super) fn shift(&self) -> Option<ShiftEquations> {
        self.as_read.fit?;
        let scale = 1000.0 / (2.0 * self.view.half);
        let lines = &self.as_read.lines;
        let sums = lines.iter().fold([0.0; 6], |sums, (row, off)| {
            let (x, y, off) = (row.z, row.w, scale * off);
            let own = [x * x, x * y, y * y, off * x, off * y, off * off];
            std::array::from_fn(|k| sums[k] + own[k])
        });
        Some(sums.map(|sum| (sum / lines.len() as f64) as f32))
    }

    /// How the picture frames its target; `None` if the framing is correct or cannot be measured. If the content moves
    /// as in the target (`is_moving`), large zooms, at which hardly any block is found, are not tried.
    pub(super) fn framing(self, is_moving: bool) -> Option<Framing> {
        let Self {
            view,
            shown,
            as_read: mut best,
        } = self;
        let as_read = best.fit.filter(|fit| view.is_clear(&best.lines, *fit));
        if let Some(k1) = view.lens(&best, as_read) {
            let framing = Framing {
                zoom: 1000,
                roll: 0,
                shift: [0; 2],
                lens: (1000.0 * k1).round() as i16,
            };
            return framing.is_wrong().then_some(framing);
        }
        match as_read {
            Some(_) => {}
            None if is_moving || view.agrees(&best.lines, DVec4::ZERO) => return None,
            None => {
                let found = PRESETS.map(|zoom| view.measured(shown, zoom));
                best = found.into_iter().max_by_key(|found| found.lines.len())?;
            }
        }
        // Blocks of another size are hard to find, so undo the measured zoom and search again.
        for _ in 0..MAX_RESAMPLINGS {
            let zoom = best.zoom * (1.0 + best.fit?.x / view.half);
            if (zoom / best.zoom - 1.0).abs() < MIN_RESAMPLED_ZOOM {
                break;
            }
            let again = view.measured(shown, zoom);
            if again.fit.is_none() || again.lines.len() < best.lines.len() {
                break;
            }
            best = again;
        }
        let fit = best.fit.filter(|fit| view.agrees(&best.lines, *fit))?;
        // Displacements were measured in the resampled picture; multiplying by the zoom gives the displacements in the
        // picture itself.
        let fit = DVec4::new(fit.x + view.half, fit.y, fit.z, fit.w) * best.zoom;
        view.framing(fit - DVec4::X * view.half)
    }
}

/// A target and its camera at the shrunk size.
struct FramedTarget<'a> {
    focal: DVec2,
    middle: DVec2,
    /// Half the width of the shrunk target, in pixels.
    half: f64,
    translation: DVec3,
    /// Centres of the blocks with contrast.
    blocks: Vec<DVec2>,
    target: &'a RgbImage,
}

/// One block's equation: the coefficients of zoom, roll and shift (see [`fitted`]), and the block's displacement across
/// its epipolar line, in pixels.
type Line = (DVec4, f64);

/// Blocks found in a picture after undoing a zoom, and their fit.
struct Measured {
    zoom: f64,
    lines: Vec<Line>,
    /// Fit of zoom, roll and shift (see [`fitted`]); `None` if too few blocks were found.
    fit: Option<DVec4>,
}

fn blocks_of(target: &RgbImage) -> Vec<DVec2> {
    let (width, height) = target.dimensions();
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
        let has_contrast = patch(target, centre)?.1 >= MIN_CONTRAST;
        has_contrast.then_some(centre)
    });
    blocks.collect()
}

impl FramedTarget<'_> {
    /// The equations of the target's blocks that are found in a picture.
    fn lines(&self, shown: &RgbImage) -> Vec<Line> {
        let (width, height) = self.target.dimensions();
        let [target, coarse] =
            [self.target, shown].map(|p| thumbnail(p, width.div_ceil(2), height.div_ceil(2)));
        let reach = (REACH * f64::from(width) / 2.0) as i32;
        let lines = self.blocks.iter().filter_map(|centre| {
            // A wrong depth moves the block's content along this direction.
            let from_middle = *centre - self.middle;
            let along = self.focal * self.translation.truncate() - from_middle * self.translation.z;
            let beside = along.perp().try_normalize()?;
            let near = locate([&target, &coarse], *centre / 2.0, DVec2::ZERO, reach)?;
            let off = locate(
                [self.target, shown],
                *centre,
                (2.0 * near).round(),
                REFINED_REACH,
            )?;
            let at = from_middle / self.half;
            let row = DVec4::new(beside.dot(at), beside.dot(at.perp()), beside.x, beside.y);
            Some((row, beside.dot(off)))
        });
        lines.collect()
    }

    /// Measures a picture after undoing a zoom.
    fn measured(&self, shown: &RgbImage, zoom: f64) -> Measured {
        let lines = match zoom {
            1.0 => self.lines(shown),
            _ => self.lines(&self.resampled(shown, zoom)),
        };
        let has_enough = lines.len() >= MIN_FOUND
            && lines.len() as f64 >= MIN_FOUND_SHARE * self.blocks.len() as f64;
        let fit = has_enough.then(|| fitted(&lines)).flatten();
        Measured { zoom, lines, fit }
    }

    /// Whether at least [`MIN_AGREEING`] of the blocks agree with a fit.
    fn agrees(&self, lines: &[Line], fit: DVec4) -> bool {
        let near = |(row, off): &&Line| (off - row.dot(fit)).abs() <= MAX_OFF_FIT;
        lines.iter().filter(near).count() as f64 >= MIN_AGREEING * lines.len() as f64
    }

    /// Whether most blocks agree with a fit, and it explains them clearly better than the target's own framing.
    fn is_clear(&self, lines: &[Line], fit: DVec4) -> bool {
        let [before, after] = [DVec4::ZERO, fit].map(|fit| off(lines, |row| row.dot(fit)));
        self.agrees(lines, fit) && is_gain(before, after, GAIN)
    }

    /// The radial distortion (OpenCV's k1) that explains the blocks clearly better than the target's own camera does,
    /// and no worse than the fit `framing`. `None` if no distortion does.
    fn lens(&self, measured: &Measured, framing: Option<DVec4>) -> Option<f64> {
        measured.fit?;
        let lines = &measured.lines;
        // A lens displaces a block by the zoom's displacement (the row's first component) times the squared distance
        // from the middle. The row's direction and its first two components determine the block's place.
        let by_lens = |row: &DVec4, k1: f64| {
            let at = DMat2::from_cols(DVec2::new(row.z, row.w), DVec2::new(-row.w, row.z))
                * DVec2::new(row.x, -row.y)
                * self.half;
            k1 * row.x * self.half * (at / self.focal).length_squared()
        };
        let mut ratios: Vec<(f64, f64)> = lines
            .iter()
            .map(|(row, off)| (off, by_lens(row, 1.0)))
            .map(|(off, unit)| (off / unit, unit.abs()))
            .filter(|(ratio, _)| ratio.is_finite())
            .collect();
        ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
        // The weighted median has the least absolute deviation.
        let half = ratios.iter().map(|(_, weight)| weight).sum::<f64>() / 2.0;
        let mut sum = 0.0;
        let (k1, _) = ratios.into_iter().find(|(_, weight)| {
            sum += weight;
            sum >= half
        })?;
        let before = off(lines, |_| 0.0);
        let after = off(lines, |row| by_lens(row, k1));
        let near = |(row, off): &&Line| (off - by_lens(row, k1)).abs() <= MAX_OFF_FIT;
        let agreeing = lines.iter().filter(near).count() as f64;
        let is_simpler = framing.is_none_or(|fit| after <= off(lines, |row| row.dot(fit)));
        let is_found =
            agreeing >= MIN_AGREEING * lines.len() as f64 && is_gain(before, after, GAIN_OF_LENS);
        (is_found && is_simpler).then_some(k1)
    }

    fn framing(&self, fit: DVec4) -> Option<Framing> {
        let thousandths = |v: f64| (1000.0 * v).round() as i16;
        let framing = Framing {
            zoom: thousandths(1.0 + fit.x / self.half),
            roll: thousandths((fit.y / (self.half + fit.x)).atan().to_degrees()),
            shift: [fit.z, fit.w].map(|v| thousandths(v / (2.0 * self.half))),
            lens: 0,
        };
        framing.is_wrong().then_some(framing)
    }

    /// Resamples a picture whose focal length is `zoom` times the target's to the target's focal length; black outside
    /// the picture.
    fn resampled(&self, shown: &RgbImage, zoom: f64) -> RgbImage {
        let (width, height) = shown.dimensions();
        RgbImage::from_fn(width, height, |x, y| {
            let at = DVec2::new(f64::from(x), f64::from(y)) + 0.5 - self.middle;
            let at = self.middle + zoom * at;
            let place = (at / DVec2::new(width.into(), height.into())).as_vec2();
            sample_bilinear(shown, place.x, place.y).unwrap_or(Rgb([0; 3]))
        })
    }
}

/// Mean distance from the epipolar lines, in pixels, after subtracting the displacements `moved`.
fn off(lines: &[Line], moved: impl Fn(&DVec4) -> f64) -> f64 {
    let all = lines
        .iter()
        .map(|(row, off)| (off - moved(row)).abs().min(MAX_DISTANCE));
    all.sum::<f64>() / lines.len() as f64
}

fn is_gain(before: f64, after: f64, (least, share): (f64, f64)) -> bool {
    before - after >= least && after <= share * before
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
    let like = |by: DVec2| {
        let near = all.iter().find(|(off, _)| *off == best.0 + by);
        near.map_or(best.1, |(_, like)| *like)
    };
    // Refine by the vertex of the parabola through the correlations at the neighbours.
    let between = [DVec2::X, DVec2::Y].map(|axis| {
        let [before, after] = [like(-axis), like(axis)];
        let curvature = (2.0 * best.1 - before - after).max(1e-6);
        ((after - before) / (2.0 * curvature)).clamp(-0.5, 0.5)
    });
    let is_found = best.1 >= MIN_CORRELATION && elsewhere <= best.1 - MIN_DISTINCTION;
    is_found.then_some(best.0 + DVec2::from(between))
}

/// Fits zoom, roll and shift to displacements across epipolar lines by least absolute deviation, in pixels. Zoom and
/// roll are given as the displacement at half a width from the principal point.
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

    use super::super::motion::tests::{PLANE, camera, pose, view};
    use super::*;

    /// How pictures by another camera, turned by `roll` radians, frame two targets: one of a stereo pair, one of a
    /// turned camera. `plane` is the predicted depth.
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
            DisplacedBlocks::of(camera(80.0), own.translation, [&target, &shown]).framing(false)
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
            (0.75, 0.0, [0.0; 2]),
            (0.8, 0.0, [0.0; 2]),
            (1.25, 0.0, [0.0; 2]),
            (1.33, 0.0, [0.0; 2]),
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
    fn a_distortion_left_in_is_measured() {
        let own = pose(0.03, [0.12, 0.06, 0.02]);
        let target = view(camera(80.0), own, PLANE);
        let middle = DVec2::new(80.0, 60.0);
        for k1 in [-0.2, -0.12, 0.12, 0.2] {
            let (width, height) = target.dimensions();
            let distorted = RgbImage::from_fn(width, height, |x, y| {
                let at = (DVec2::new(x.into(), y.into()) + 0.5 - middle) / 150.0;
                // Fixed-point iteration of the inverse.
                let straight = (0..20).fold(at, |off, _| at / (1.0 + k1 * off.length_squared()));
                let [u, v] = (middle + 150.0 * straight).to_array();
                let place = [u / f64::from(width), v / f64::from(height)].map(|v| v as f32);
                sample_bilinear(&target, place[0], place[1]).unwrap_or(Rgb([0; 3]))
            });
            let both = [&target, &distorted];
            let found = DisplacedBlocks::of(camera(80.0), own.translation, both).framing(true);
            let found = found.unwrap_or_else(|| panic!("{k1}"));
            assert_eq!((found.zoom, found.roll, found.shift), (1000, 0, [0; 2]));
            let off = f64::from(found.lens) / 1000.0 - k1;
            assert!(off.abs() < 0.02, "{k1}: {found:?}");
        }
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
