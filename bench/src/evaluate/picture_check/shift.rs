//! Detects pictures that are all shifted alike, by half a pixel or more.
//!
//! Wrong depths move the content of a picture only along epipolar lines. So only edges that run along these lines are
//! compared: wrong depths hardly displace them, but shifts across the lines do. Displacements follow from the
//! differences in brightness (Lucas and Kanade 1981) at full resolution, which is far more exact than the framing of
//! shrunk pictures.

use glam::{DMat2, DVec2, DVec3};
use image::imageops::grayscale;
use image::{GrayImage, ImageBuffer, Luma, RgbImage};
use sharp::camera::Intrinsics;

use super::group::{Extent, PictureGroup};
use super::measures::ShiftEquations;
use crate::evaluate::record::Record;

/// Minimum magnitude of the larger component of a reported shift, in pixels. Conventions of pixel centres differ by
/// half a pixel.
const MIN_SHIFT: f64 = 0.35;
/// Maximum magnitude of either component of a reported shift that was measured in edges, in pixels.
const MAX_SHIFT: f64 = 1.5;
/// Minimum magnitude of the larger component of a reported shift that was measured in blocks, in thousandths of the
/// width.
const MIN_FAR_SHIFT: f64 = 15.0;
/// Minimum number of pictures that agree on a reported shift.
const MIN_PICTURES: usize = 3;
/// A shift is reported only if the shares that it explains (see [`MIN_EXPLAINED`]), summed over the pictures that
/// agree, are at least this. Three pictures that show it clearly count as much as six that hardly do.
const MIN_SUM_OF_SHARES: f64 = 0.5;
/// A shift is reported only if at least this share of the pictures that could show it agree on it.
const MIN_SHARE: f64 = 0.65;
/// A picture agrees with a shift if the shift explains at least this share of the squared displacements of its edges.
/// Pictures that would not reach this share even with exactly this shift are left out. In good predictions, a shift by
/// half a pixel explains a third or more. Without a shift, the best fit explains a few hundredths.
const MIN_EXPLAINED: f64 = 0.08;
/// This and the next constant are like [`MIN_EXPLAINED`] and [`MIN_SHARE`], but for shifts measured in blocks. Such a
/// shift explains nearly all displacements, but poor predictions have large displacements, too.
const MIN_EXPLAINED_BY_FAR: f64 = 0.6;
const MIN_SHARE_OF_FAR: f64 = 0.75;
/// A shift is measured along a direction only if at least this share of the evidence (the trace of the matrix) is along
/// it.
const MIN_EVIDENCE: f64 = 0.1;
/// Minimum gradient of an edge, in levels per pixel.
const MIN_GRADIENT: f64 = 4.0;
/// An edge runs along an epipolar line if the sine of the angle between its gradient and the line's normal is at most
/// this.
const MAX_SINE: f64 = 0.15;
/// Maximum displacement of an edge, in pixels. Edges that seem to have moved farther probably show other content.
const MAX_MOVED: f64 = 3.0;
/// Number of parts across and down. Within a part, depths are assumed to be equally wrong.
const PARTS: u32 = 12;
/// A picture is measured only if, after its own best shift, the mean squared displacement of its edges is at most this,
/// in pixels squared. In poor predictions, edges match other edges.
const MAX_MEAN_SQUARE: f64 = 1.0;
/// A picture is measured only if it has at least this many edges along epipolar lines.
const MIN_EDGES: u32 = 500;

/// Measures the shift of the picture `shown` across its epipolar lines. `None` if its size differs from its target's,
/// if it has too few edges along the lines, or if the edges match badly. `intrinsics` are the target's, and
/// `translation` belongs to the pose that maps the source's camera to the target's.
pub(super) fn shift_equations(
    intrinsics: Intrinsics,
    translation: DVec3,
    [target, shown]: [&RgbImage; 2],
) -> Option<ShiftEquations> {
    if target.dimensions() != shown.dimensions() {
        return None;
    }
    let [target, shown] = [target, shown].map(|of| smoothed(&grayscale(of)));
    let (width, height) = target.dimensions();
    let focal = DVec2::new(intrinsics.fx, intrinsics.fy);
    let middle = DVec2::new(intrinsics.cx, intrinsics.cy);
    let mut parts = vec![PartSums::default(); (PARTS * PARTS) as usize];
    let mut edges = 0;
    for (y, x) in (1..height.saturating_sub(1)).flat_map(|y| (1..width - 1).map(move |x| (y, x))) {
        let [seen, own] = [&target, &shown].map(|of| {
            let level = |x: u32, y: u32| f64::from(of.get_pixel(x, y).0[0]);
            let slopes = [
                level(x + 1, y) - level(x - 1, y),
                level(x, y + 1) - level(x, y - 1),
            ];
            (level(x, y), DVec2::from(slopes) / 2.0)
        });
        let gradient = (seen.1 + own.1) / 2.0;
        let steepness = gradient.length();
        if steepness < MIN_GRADIENT {
            continue;
        }
        let from_middle = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - middle;
        // A wrong depth moves the content along this direction.
        let along = focal * translation.truncate() - from_middle * translation.z;
        let Some(along) = along.try_normalize() else {
            continue;
        };
        let moved = (seen.0 - own.0) / steepness;
        if gradient.dot(along).abs() <= MAX_SINE * steepness && moved.abs() <= MAX_MOVED {
            // The unit normal of the edge, across the epipolar line.
            let across = gradient / steepness;
            let part = y * PARTS / height * PARTS + x * PARTS / width;
            parts[part as usize].add(across, across.dot(along), moved);
            edges += 1;
        }
    }
    let sums = parts.iter().map(PartSums::equations).fold([0.0; 6], added);
    let means = sums.map(|v| v / f64::from(edges.max(1)));
    let left = means[5] - explained(&means, solved(means));
    (edges >= MIN_EDGES && left <= MAX_MEAN_SQUARE).then(|| means.map(|v| v as f32))
}

fn added(all: [f64; 6], more: [f64; 6]) -> [f64; 6] {
    std::array::from_fn(|k| all[k] + more[k])
}

/// Sums over the edges in one part of a picture. Wrong depths are assumed to move all content of a part equally along
/// the epipolar lines (the part's own motion).
#[derive(Debug, Clone, Copy, Default)]
struct PartSums {
    /// Columns of the matrix for the shift.
    normal: [DVec2; 2],
    sum: DVec2,
    /// Coefficients of the part's own motion in the equations of the shift.
    mixed: DVec2,
    /// Coefficient and right-hand side of the equation of the part's own motion.
    own: [f64; 2],
    /// Sum of squared displacements.
    squares: f64,
}

impl PartSums {
    /// Adds an edge that was displaced by `moved` pixels along its unit normal `across`; `along` is the component of
    /// the normal along the epipolar line.
    fn add(&mut self, across: DVec2, along: f64, moved: f64) {
        self.normal[0] += across.x * across;
        self.normal[1] += across.y * across;
        self.sum += moved * across;
        self.mixed += along * across;
        self.own[0] += along * along;
        self.own[1] += moved * along;
        self.squares += moved * moved;
    }

    /// The [`ShiftEquations`], not divided by the number of edges, after eliminating the part's own motion.
    fn equations(&self) -> [f64; 6] {
        let [along, moved] = self.own;
        let along = along.max(1e-9);
        let share = self.mixed / along;
        let x = self.normal[0] - share.x * self.mixed;
        let y = self.normal[1] - share.y * self.mixed;
        let sum = self.sum - share * moved;
        let squares = self.squares - moved * moved / along;
        [x.x, x.y, y.y, sum.x, sum.y, squares]
    }
}

/// Levels smoothed over 3 x 3 pixels.
fn smoothed(of: &GrayImage) -> ImageBuffer<Luma<f32>, Vec<f32>> {
    let (width, height) = of.dimensions();
    let mean = |before: f32, own: f32, after: f32| (before + 2.0 * own + after) / 4.0;
    let rows = ImageBuffer::from_fn(width, height, |x, y| {
        let level = |x: u32| f32::from(of.get_pixel(x, y).0[0]);
        let after = level((x + 1).min(width - 1));
        Luma([mean(level(x.saturating_sub(1)), level(x), after)])
    });
    ImageBuffer::from_fn(width, height, |x, y| {
        let level = |y: u32| -> f32 { rows.get_pixel(x, y).0[0] };
        let after = level((y + 1).min(height - 1));
        Luma([mean(level(y.saturating_sub(1)), level(y), after)])
    })
}

/// A shift and, for each picture that can show it, the share of that picture's squared displacements that it explains.
struct Agreement {
    shift: DVec2,
    shares: Vec<f64>,
}

impl Agreement {
    fn of(measured: impl Iterator<Item = ShiftEquations>) -> Self {
        let measured: Vec<[f64; 6]> = measured.map(|of| of.map(f64::from)).collect();
        let shift = solved(measured.iter().copied().fold([0.0; 6], added));
        // Leave out pictures that cannot show the shift: their epipolar lines are along it, or they are too poor.
        let seen = measured
            .iter()
            .filter(|of| shift.dot(matrix(of) * shift) >= MIN_EXPLAINED * of[5]);
        let shares = seen.map(|of| explained(of, shift) / of[5]).collect();
        Self { shift, shares }
    }

    /// Number of pictures in which the shift explains at least the share `min_explained`. `None` if these are too few,
    /// less than `min_share` of all, or explain less than [`MIN_SUM_OF_SHARES`] in sum.
    fn count(&self, extent: Extent, min_explained: f64, min_share: f64) -> Option<usize> {
        let agreeing = self.shares.iter().filter(|share| **share >= min_explained);
        let count = agreeing.clone().count();
        let is_found = count >= extent.fewest(MIN_PICTURES)
            && count as f64 >= extent.share(min_share) * self.shares.len() as f64
            && agreeing.sum::<f64>() >= MIN_SUM_OF_SHARES;
        is_found.then_some(count)
    }

    /// The shift, rounded to tenths, without "-0.0".
    fn rounded(&self) -> [f64; 2] {
        self.shift
            .to_array()
            .map(|v| (10.0 * v).round() / 10.0 + 0.0)
    }
}

/// Warns if the pictures agree on a shift by at most [`MAX_SHIFT`].
pub(super) fn shifted_pictures(group: &PictureGroup<'_, &Record>) -> Option<String> {
    let found = Agreement::of(group.pictures.iter().filter_map(|record| record.shift));
    let count = found.count(group.extent, MIN_EXPLAINED, MIN_SHARE)?;
    let ([x, y], all) = (found.rounded(), found.shares.len());
    let is_found = (MIN_SHIFT..=MAX_SHIFT).contains(&found.shift.abs().max_element());
    is_found.then(|| {
        format!(
            "its pictures are shifted by about ({x:.1}, {y:.1}) pixels (x to the right, y down) from their targets, \
             measured only across epipolar lines ({count} of the {all} compared pairs of {} agree); typical causes are \
             pixel centres at whole numbers instead of halves, or a resampling that keeps the corners; render them with \
             the dataset's principal point",
            group.name
        )
    })
}

/// Warns if the pictures agree on a shift by at least [`MIN_FAR_SHIFT`].
pub(super) fn far_shifted_pictures(group: &PictureGroup<'_, &Record>) -> Option<String> {
    let found = Agreement::of(group.pictures.iter().filter_map(|record| record.far_shift));
    let count = found.count(group.extent, MIN_EXPLAINED_BY_FAR, MIN_SHARE_OF_FAR)?;
    let all = found.shares.len();
    let [x, y] = found.rounded().map(|by| by / 10.0);
    (found.shift.abs().max_element() >= MIN_FAR_SHIFT).then(|| {
        format!(
            "its pictures are shifted by about ({x:.1} %, {y:.1} %) of the width (x to the right, y down) from their \
             targets, measured only across epipolar lines ({count} of the {all} compared pairs of {} agree), as with a \
             wrong principal point or a crop; render them with the dataset's principal point",
            group.name
        )
    })
}

/// How much a shift reduces the sum of squared displacements.
fn explained(of: &[f64; 6], shift: DVec2) -> f64 {
    shift.dot(2.0 * DVec2::new(of[3], of[4]) - matrix(of) * shift)
}

fn matrix([xx, xy, yy, ..]: &[f64; 6]) -> DMat2 {
    DMat2::from_cols_array(&[*xx, *xy, *xy, *yy])
}

/// The shift that solves the equations; zero along directions without evidence.
fn solved([xx, xy, yy, x, y, _]: [f64; 6]) -> DVec2 {
    // Eigenvalues of the symmetric matrix.
    let (mean, half) = ((xx + yy) / 2.0, (xx - yy) / 2.0);
    let radius = half.hypot(xy);
    let major = DVec2::from_angle(0.5 * xy.atan2(half));
    let sum = DVec2::new(x, y);
    let part = |direction: DVec2, eigenvalue: f64| {
        if eigenvalue >= MIN_EVIDENCE * (xx + yy) {
            direction * sum.dot(direction) / eigenvalue
        } else {
            DVec2::ZERO
        }
    };
    part(major, mean + radius) + part(major.perp(), mean - radius)
}

#[cfg(test)]
mod tests {
    use image::Rgb;
    use image::imageops::{fast_blur, sample_bilinear};

    use super::super::framing::DisplacedBlocks;
    use super::super::group::tests::of_dataset;
    use super::super::motion::tests::{PLANE, camera, pose, view};
    use super::*;
    use crate::evaluate::record::Status;
    use crate::evaluate::record::tests::record;

    /// What is said of twelve predictions of the plane `seen_as`, shifted by these pixels, with cameras that move in
    /// several directions, or as in stereo.
    fn told(is_stereo: bool, seen_as: DVec3, by: impl Fn(usize) -> [f64; 2]) -> Option<String> {
        let records: Vec<Record> = (0..12)
            .map(|k| {
                let (sin, cos) = (k as f64 + 0.3).sin_cos();
                let own = if is_stereo {
                    pose(0.0, [-0.1 - 0.01 * k as f64, 0.0, 0.0])
                } else {
                    pose(0.02 * sin, [0.12 * cos, 0.12 * sin, 0.02])
                };
                let target = view(camera(80.0), own, PLANE);
                let shown = fast_blur(&view(camera(80.0), own, seen_as), 0.5);
                let (size, [x, y]) = (DVec2::new(160.0, 120.0), by(k));
                let shown = RgbImage::from_fn(160, 120, |u, v| {
                    let place = DVec2::new(f64::from(u) + 0.5 - x, f64::from(v) + 0.5 - y) / size;
                    sample_bilinear(&shown, place.x as f32, place.y as f32).unwrap_or(Rgb([0; 3]))
                });
                let both = [&target, &shown];
                let blocks = || DisplacedBlocks::of(camera(80.0), own.translation, both).shift();
                Record {
                    shift: shift_equations(camera(80.0), own.translation, both),
                    far_shift: blocks(),
                    status: Status::Ok,
                    ..record()
                }
            })
            .collect();
        of_dataset(&records, |group| {
            far_shifted_pictures(group).or_else(|| shifted_pictures(group))
        })
    }

    const NEAR_PLANE: DVec3 = DVec3::new(0.11, 0.26, 0.4);

    #[test]
    fn shifts_of_half_a_pixel_are_told() {
        for by in [
            [0.5, 0.5],
            [-0.5, 0.5],
            [0.0, -0.6],
            [1.0, 1.0],
            [1.0, -1.0],
            [6.0, 5.0],
            [-4.0, 8.0],
        ] {
            let told = told(false, PLANE, |_| by).unwrap_or_else(|| panic!("{by:?}"));
            let (_, numbers) = told.split_once('(').unwrap();
            let (numbers, _) = numbers.split_once(')').unwrap();
            // The texture has few upright edges, so the shift to the right is hardly measured.
            let (_, down) = numbers.split_once(", ").unwrap();
            // 1 % of the width is 1.6 pixels.
            let down: f64 = match down.strip_suffix(" %") {
                Some(percent) => 1.6 * percent.parse::<f64>().unwrap(),
                None => down.parse().unwrap(),
            };
            let allowed = 0.16_f64.max(0.1 * by[1].abs());
            assert!((down - by[1]).abs() < allowed, "{by:?}: {told}");
        }
        // Along the lines, a shift cannot be distinguished from wrong depth.
        assert!(
            told(true, PLANE, |_| [0.5, 0.5])
                .unwrap()
                .contains("(0.0, 0.")
        );
    }

    #[test]
    fn proper_pictures_and_shifts_along_the_lines_are_not() {
        for is_stereo in [false, true] {
            for plane in [
                PLANE,
                NEAR_PLANE,
                DVec3::new(0.06, 0.12, 0.4),
                DVec3::new(-0.2, 0.5, 0.4),
            ] {
                assert_eq!(
                    told(is_stereo, plane, |_| [0.0; 2]),
                    None,
                    "{is_stereo} {plane}"
                );
                let alternating = |k: usize| [0.0, if k.is_multiple_of(2) { 0.6 } else { -0.6 }];
                assert_eq!(told(is_stereo, plane, alternating), None);
                assert_eq!(told(is_stereo, plane, |_| [0.1, 0.2]), None);
            }
        }
        assert_eq!(told(true, PLANE, |_| [0.8, 0.0]), None);
    }
}
