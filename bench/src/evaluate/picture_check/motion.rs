//! Detects pictures whose motion differs from the target's: a multiple of the true motion, or the motion of a misread
//! pose.
//!
//! Blocks of the source's photograph are located in the target's photograph along their epipolar lines, which
//! determines their inverse depths, and then in the picture. To avoid false alarms on poor predictions, at least half
//! of the blocks must agree on one cause and contradict the true motion. In addition, `camera` requires most pictures
//! to agree.

use std::ops::RangeInclusive;

use glam::{DMat3, DVec2, DVec3};
use image::{GenericImageView, RgbImage};
use sharp::camera::{Intrinsics, RigidTransform};

use super::finding::ShownCamera;

/// Half the side of a block, rounded down, pixels of a shrunk picture.
pub(super) const HALF: i64 = 5;
/// Side of a block, in pixels of a shrunk picture.
const SIDE: usize = 2 * HALF as usize + 1;
/// Number of pixels of a block.
const AREA: usize = SIDE.pow(2);
/// Number of blocks across and down.
const GRID: [u32; 2] = [14, 10];
/// Minimum standard deviation of the blocks that are compared, in levels.
pub(super) const MIN_CONTRAST: f64 = 6.0;
/// Share of the width to which the search extends along an epipolar line.
const REACH: f64 = 0.4;
/// Conditions for finding a block in the target's photograph: the minimum of its highest correlation along the epipolar
/// line, and the minimum by which this exceeds the correlation elsewhere on the line.
const IN_TARGET: (f64, f64) = (0.8, 0.1);
/// Like [`IN_TARGET`], but for finding a block in the picture.
const IN_PICTURE: (f64, f64) = (0.7, 0.05);
/// A block contradicts the true motion if its correlation at another place exceeds its correlation at the true place by
/// at least this.
const MIN_GAIN: f64 = 0.1;
/// Motion is measured only with at least this many blocks.
const MIN_BLOCKS: usize = 8;
/// Motion is measured only if at least this share of the blocks is found in the picture.
const MIN_FOUND_SHARE: f64 = 0.4;
/// Only blocks whose true motion is at least this are compared, in pixels.
const MIN_MOTION: f64 = 3.0;
/// A multiple of the motion counts as measured only if at least this share of the blocks agree with it.
const MIN_AGREEING: f64 = 0.6;
/// A multiple of the true motion is reported only if at least this share of the blocks contradict the true motion.
const MIN_CONTRADICTING: f64 = 0.5;
/// A misread pose is reported only if at least this share of the blocks agree with it.
const MIN_POSE_SHARE: f64 = 0.5;
/// Number of misread poses that are tried, including the source's own pose.
const CANDIDATES: usize = 12;
/// A missing rotation or a reversed axis is reported only if simpler causes (a multiple of the motion, the source's
/// view) explain at most this fraction of the blocks that it explains.
const MAX_SIMPLER_SHARE: f64 = 0.75;
/// A translation in world axes explains a picture about as well as another cause if it explains at least this fraction of
/// the blocks that the other one explains.
const MIN_EQUAL_SHARE: f64 = 0.9;
/// Pictures that move by less than this percentage of the true motion are nearly still.
const STILL_PERCENT: i16 = 20;
/// Like [`MIN_AGREEING`], but for nearly still pictures. It is higher, because blends of the source with a prediction
/// partly show the source.
const MIN_AGREEING_STILL: f64 = 0.8;
/// The inverse pose is reported only if the camera turns by at least this, in degrees. Otherwise, it cannot be
/// distinguished from a negated translation.
const MIN_TURN: f64 = 0.5;
/// A translation counts as along an axis if its component along the axis is at least this share of its length.
const MIN_ALONG_AXIS: f64 = 0.97;
/// Near and far are exchanged only if, of the pairs of blocks whose true motions differ by at least [`MIN_MOTION`], at
/// least this share moved by [`MIN_LESS`] less although they should move farther.
const MIN_EXCHANGED: f64 = 0.7;
/// Minimum difference of the motions of two blocks in the picture of which one moved less, in pixels.
const MIN_LESS: f64 = 2.0;
/// Near and far are compared only with at least this many pairs of blocks.
const MIN_PAIRS: usize = 50;
/// Maximum distance from the expected place of a block that agrees with a motion, in pixels.
const MAX_OFF: f64 = 1.0;
/// Like [`MAX_OFF`], but as a share of the motion; the larger limit applies.
const MAX_OFF_SHARE: f64 = 0.1;

/// Highest level that counts as black, and lowest that counts as white.
const MASKED: [u8; 2] = [3, 252];

/// A camera and its pose relative to the source's.
#[derive(Clone, Copy)]
struct Camera(Intrinsics, RigidTransform);

impl Camera {
    /// Projects the point at `inverse_depth` (1/z) on a ray of the source's camera with z = 1.
    fn place(&self, ray: DVec3, inverse_depth: f64) -> Option<DVec2> {
        self.0
            .project(self.1.rotation * ray + inverse_depth * self.1.translation)
    }
}

/// What the blocks of a picture show about its motion.
#[derive(Debug)]
pub(super) struct MeasuredMotion {
    /// A multiple of the true motion ([`ShownCamera::Moved`]) or a misread pose; `None` if it cannot be measured.
    pub(super) camera: Option<ShownCamera>,
    /// A translation in world axes, if this explains the picture about as well as `camera`.
    pub(super) in_world: Option<ShownCamera>,
    /// Of the blocks that both source and target show, the percentage where the picture is black, white or filled with
    /// one colour; `None` if there are too few blocks.
    pub(super) masked: Option<u8>,
}

/// Measures a picture's motion, and how much of it is masked. The pictures (source, target and the picture `shown`) are
/// shrunk; `intrinsics` are those of source and target at full size, `cameras_from_world` their poses, and `filled` is
/// the picture's [`filled_colour`](super::filled::filled_colour).
pub(super) fn shown_camera(
    intrinsics: [Intrinsics; 2],
    cameras_from_world: [RigidTransform; 2],
    [source, target, shown]: [&RgbImage; 3],
    filled: Option<[u8; 3]>,
) -> MeasuredMotion {
    let target_from_source = cameras_from_world[1].after(&cameras_from_world[0].inverse());
    let [from, to] = intrinsics.map(|k| k.resized(target.width(), target.height()));
    let RigidTransform {
        rotation,
        translation,
    } = target_from_source;
    let pose = |rotation, translation| RigidTransform {
        rotation,
        translation,
    };
    let axes = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let flipped = pose(axes * rotation * axes, axes * translation);
    let transposed = pose(rotation.transpose(), translation);
    let unturned = |translation| {
        (
            ShownCamera::NoRotation,
            to,
            pose(DMat3::IDENTITY, translation),
        )
    };
    let mirrored = |axis: u8| {
        let mut other = translation;
        other[usize::from(axis)] *= -1.0;
        (ShownCamera::Reversed(axis), to, pose(rotation, other))
    };
    let in_world = cameras_from_world[1].rotation.transpose() * translation;
    let unrotated = |is_reversed| {
        let translation = if is_reversed { -in_world } else { in_world };
        let cause = ShownCamera::WorldTranslation(is_reversed);
        (cause, to, pose(rotation, translation))
    };
    let misread: [_; CANDIDATES] = [
        (ShownCamera::SourceIntrinsics, from, target_from_source),
        (ShownCamera::InversePose, to, target_from_source.inverse()),
        (ShownCamera::OtherAxes, to, flipped),
        (ShownCamera::TransposedRotation, to, transposed),
        unturned(translation),
        // Also without a rotation, but with the camera at the target's actual position.
        unturned(rotation.transpose() * translation),
        unrotated(false),
        unrotated(true),
        mirrored(0),
        mirrored(1),
        mirrored(2),
        // The source's own pose is not misread, but some misread poses resemble it, so it is tried for comparison.
        (ShownCamera::Moved(0), from, RigidTransform::IDENTITY),
    ];
    let search = Search {
        source,
        target,
        shown,
        camera: intrinsics[0].resized(source.width(), source.height()),
        own: Camera(to, target_from_source),
        misread: misread.map(|(_, intrinsics, pose)| Camera(intrinsics, pose)),
        filled,
    };
    let centres = (0..GRID[0] * GRID[1]).map(|k| {
        let at = |k: u32, of: u32, size: u32| {
            let inner = size.saturating_sub(2 * HALF as u32 + 1);
            f64::from(HALF as u32 + k * inner / (of - 1)) + 0.5
        };
        let (x, y) = (k % GRID[0], k / GRID[0]);
        DVec2::new(
            at(x, GRID[0], source.width()),
            at(y, GRID[1], source.height()),
        )
    });
    let mut blocks: Vec<Block> = centres.filter_map(|centre| search.block(centre)).collect();
    let count = blocks.iter().filter(|block| block.is_masked).count();
    let masked = (blocks.len() >= MIN_BLOCKS).then(|| (100 * count / blocks.len()) as u8);
    blocks.retain(|block| block.is_moving);
    if blocks.len() < MIN_BLOCKS {
        return MeasuredMotion {
            camera: None,
            in_world: None,
            masked,
        };
    }
    let shares: [f64; CANDIDATES] = std::array::from_fn(|k| {
        let inside = blocks.iter().filter_map(|block| block.misread[k]);
        let agreeing = inside.clone().filter(|agrees| *agrees).count();
        agreeing as f64 / inside.count().max(MIN_BLOCKS) as f64
    });
    let motion = multiple(&blocks).map(|(percent, share)| (ShownCamera::Moved(percent), share));
    let simple = motion
        .map_or(0.0, |(_, share)| share)
        .max(shares[CANDIDATES - 1]);
    let is_turned = target_from_source.rotation_deg() >= MIN_TURN;
    let poses = misread
        .iter()
        .zip(shares)
        .filter(|((cause, ..), share)| match cause {
            ShownCamera::Moved(_) => false,
            // Without a rotation, inverting the pose only negates the translation.
            ShownCamera::InversePose => is_turned,
            // Pictures without a rotation, with a reversed axis or with a translation in other axes resemble the
            // source's view and multiples of the motion, so these causes count only if the simpler ones explain fewer
            // blocks. If the translation is along one axis, reversing that axis merely negates the motion.
            ShownCamera::Reversed(axis)
                if translation[usize::from(*axis)].abs()
                    >= MIN_ALONG_AXIS * translation.length() =>
            {
                false
            }
            ShownCamera::NoRotation
            | ShownCamera::Reversed(_)
            | ShownCamera::WorldTranslation(_) => simple <= MAX_SIMPLER_SHARE * share,
            _ => true,
        });
    let poses = poses.map(|((cause, ..), share)| (*cause, share));
    let causes = poses
        .filter(|(_, share)| *share >= MIN_POSE_SHARE)
        .chain(motion);
    let best = causes.max_by(|a, b| a.1.total_cmp(&b.1));
    let in_world = misread.iter().zip(shares).filter(|((cause, ..), share)| {
        let least = best.map_or(0.0, |(_, best)| MIN_EQUAL_SHARE * best);
        matches!(cause, ShownCamera::WorldTranslation(_)) && *share >= least.max(MIN_POSE_SHARE)
    });
    let in_world = in_world.max_by(|a, b| a.1.total_cmp(&b.1));
    let exchanged = || is_exchanged(&blocks).then_some(ShownCamera::NearFarExchanged);
    MeasuredMotion {
        camera: best.map(|(cause, _)| cause).or_else(exchanged),
        in_world: in_world.map(|((cause, ..), _)| *cause),
        masked,
    }
}

/// A block of the source's photograph that was found in the target's photograph. Places are in steps along the block's
/// epipolar line, from infinite depth.
struct Block {
    /// Place in the target's photograph.
    own: f64,
    /// Whether the true motion is large enough to be compared.
    is_moving: bool,
    /// Place in the picture, and whether it contradicts the true motion; `None` if the block is not found there.
    found: Option<(f64, bool)>,
    /// Place in the source's photograph; `None` if it is not on the line.
    home: Option<f64>,
    /// For each misread pose, whether it explains the picture while the true pose does not; `None` if it projects the
    /// block outside the picture.
    misread: [Option<bool>; CANDIDATES],
    /// Whether the picture is black, white or filled where the block should be.
    is_masked: bool,
}

struct Search<'a> {
    source: &'a RgbImage,
    target: &'a RgbImage,
    shown: &'a RgbImage,
    /// Intrinsics of the source's camera.
    camera: Intrinsics,
    own: Camera,
    misread: [Camera; CANDIDATES],
    filled: Option<[u8; 3]>,
}

impl Search<'_> {
    fn block(&self, centre: DVec2) -> Option<Block> {
        let (block, contrast) = patch(self.source, centre)?;
        let ray = self.camera.unproject(centre, 1.0);
        let infinity = self.own.place(ray, 0.0)?;
        let tiny = 1e-4 / self.own.1.translation.length();
        let velocity = (self.own.place(ray, tiny)? - infinity) / tiny;
        // At infinite depth, a step is one pixel long.
        let step = velocity.length().recip();
        if contrast < MIN_CONTRAST || !step.is_finite() {
            return None;
        }
        let likeness = |picture: &RgbImage, place: DVec2| correlation(&block, picture, place);
        let along = |k: i32| self.own.place(ray, f64::from(k) * step);
        let best = |picture: &RgbImage, steps: RangeInclusive<i32>, (least, margin): (f64, f64)| {
            let all = steps.filter_map(|k| Some((k, likeness(picture, along(k)?)?)));
            let all: Vec<(i32, f64)> = all.collect();
            let best = all.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
            let elsewhere = all.iter().filter(|(k, _)| (k - best.0).abs() > 2);
            let elsewhere = elsewhere.map(|(_, other)| *other).fold(-1.0, f64::max);
            (best.1 >= least && elsewhere <= best.1 - margin).then_some(best)
        };
        let reach = (REACH * f64::from(self.target.width())) as i32;
        let (at, _) = best(self.target, 0..=reach, IN_TARGET)?;
        let nearby = |place: DVec2| {
            let around = (0..9).map(|k| DVec2::new(f64::from(k % 3 - 1), f64::from(k / 3 - 1)));
            let all = around.filter_map(|by| likeness(self.shown, place + by));
            all.reduce(f64::max)
        };
        let as_true = along(at).and_then(nearby).unwrap_or(-1.0);
        let found = best(self.shown, -reach..=reach, IN_PICTURE);
        let sizes =
            [self.target, self.source].map(|p| DVec2::new(p.width().into(), p.height().into()));
        let home = centre * sizes[0] / sizes[1] - infinity;
        let direction = velocity * step;
        Some(Block {
            own: f64::from(at),
            is_moving: f64::from(at) >= MIN_MOTION,
            found: found.map(|(k, like)| (f64::from(k), like - as_true >= MIN_GAIN)),
            home: (home.perp_dot(direction).abs() <= 1.5).then(|| home.dot(direction)),
            is_masked: along(at).is_some_and(|place| is_masked(self.shown, place, self.filled)),
            misread: self.misread.map(|camera| {
                let like = nearby(camera.place(ray, f64::from(at) * step)?)?;
                Some(like >= IN_PICTURE.0 && like - as_true >= MIN_GAIN)
            }),
        })
    }
}

/// Percentage of the true motion by which the blocks moved, and the share of the blocks that agree; `None` if it cannot
/// be measured. Motion is measured from the place at infinite depth (scaled translations) or from the place in the
/// source (scaled warps), whichever fits better. The two differ if the camera is turned or has another principal point.
fn multiple(blocks: &[Block]) -> Option<(i16, f64)> {
    let found = blocks
        .iter()
        .filter_map(|block| Some((block, block.found?)));
    let found: Vec<(&Block, (f64, bool))> = found.collect();
    let all = found.len() as f64;
    if found.len() < MIN_BLOCKS || all < MIN_FOUND_SHARE * blocks.len() as f64 {
        return None;
    }
    let from = |start: fn(&Block) -> Option<f64>| {
        let moves = found.iter().filter_map(|(block, (at, _))| {
            let start = start(block)?;
            Some([block.own - start, at - start])
        });
        let moves: Vec<[f64; 2]> = moves.filter(|[own, _]| own.abs() >= MIN_MOTION).collect();
        let mut factors: Vec<f64> = moves.iter().map(|[own, shown]| shown / own).collect();
        factors.sort_by(f64::total_cmp);
        let factor = *factors
            .get(factors.len() / 2)
            .filter(|_| factors.len() >= MIN_BLOCKS)?;
        let off = moves
            .iter()
            .map(|[own, shown]| ((shown - factor * own).abs(), (factor * own).abs()));
        let agreeing = off
            .clone()
            .filter(|(off, motion)| *off <= MAX_OFF.max(MAX_OFF_SHARE * motion));
        let agreeing = agreeing.count() as f64 / all;
        let missing = all - moves.len() as f64;
        let error = off.map(|(off, _)| off.min(3.0)).sum::<f64>() + 3.0 * missing;
        Some((factor, agreeing, error / all))
    };
    let ways = [from(|_| Some(0.0)), from(|block| block.home)];
    let (factor, agreeing, _) = ways.into_iter().flatten().reduce(|infinity, home| {
        if home.2 < infinity.2 - 0.02 {
            home
        } else {
            infinity
        }
    })?;
    let contradicting = found.iter().filter(|(_, (_, is_other))| *is_other).count() as f64;
    let percent = (100.0 * factor).round() as i16;
    let is_right =
        !ShownCamera::Moved(percent).is_wrong() || contradicting >= MIN_CONTRADICTING * all;
    let least = if percent.abs() < STILL_PERCENT {
        MIN_AGREEING_STILL
    } else {
        MIN_AGREEING
    };
    (agreeing >= least && is_right).then_some((percent, agreeing))
}

/// Whether blocks that should move farther than others moved less. To exclude wrong poses, only blocks that moved in the
/// direction of the true motion are compared.
fn is_exchanged(blocks: &[Block]) -> bool {
    let found = blocks
        .iter()
        .filter_map(|block| Some((block.own, block.found?)));
    let found: Vec<(f64, (f64, bool))> = found.collect();
    let contradicting = found.iter().filter(|(_, (_, is_other))| *is_other).count() as f64;
    let ahead = found.iter().filter(|(_, (at, _))| *at > 0.0);
    let ahead: Vec<[f64; 2]> = ahead.map(|(own, (at, _))| [*own, *at]).collect();
    let pairs = ahead.iter().flat_map(|near| {
        let farther = ahead.iter().filter(|far| near[0] - far[0] >= MIN_MOTION);
        farther.map(|far| far[1] - near[1] >= MIN_LESS)
    });
    let (count, less) = (pairs.clone().count(), pairs.filter(|is| *is).count());
    ahead.len() >= MIN_BLOCKS
        && ahead.len() as f64 >= MIN_FOUND_SHARE * blocks.len() as f64
        && contradicting >= MIN_CONTRADICTING * found.len() as f64
        && count >= MIN_PAIRS
        && less as f64 >= MIN_EXCHANGED * count as f64
}

/// Whether all pixels around a place are black, or all are white, or all are `filled`.
fn is_masked(picture: &RgbImage, place: DVec2, filled: Option<[u8; 3]>) -> bool {
    corner(picture, place).is_some_and(|[left, top]| {
        let [left, top, side] = [left, top, SIDE].map(|v| v as u32);
        let block = picture.view(left, top, side, side);
        let is_all = |is: fn(u8) -> bool| {
            block
                .pixels()
                .all(|(.., pixel)| pixel.0.into_iter().all(is))
        };
        let is_filled = || block.pixels().all(|(.., pixel)| Some(pixel.0) == filled);
        is_all(|level| level <= MASKED[0]) || is_all(|level| level >= MASKED[1]) || is_filled()
    })
}

/// Column and row of the first pixel of the block around a place; `None` if the block extends beyond the picture.
fn corner(picture: &RgbImage, place: DVec2) -> Option<[usize; 2]> {
    let (width, height) = picture.dimensions();
    let along = |place: f64, size: u32| {
        let first = usize::try_from(place.floor() as i64 - HALF).ok()?;
        (first + SIDE <= size as usize).then_some(first)
    };
    Some([along(place.x, width)?, along(place.y, height)?])
}

/// Correlation of a block with the block around a place, −1..1; `None` if the latter extends beyond the picture.
pub(super) fn correlation(block: &[f64; AREA], picture: &RgbImage, place: DVec2) -> Option<f64> {
    let [left, top] = corner(picture, place)?;
    let (levels, width) = (picture.as_raw().as_slice(), picture.width() as usize);
    let (mut product, mut sum, mut squares) = (0.0, 0, 0);
    // This runs up to a million times per picture, in a crate whose iterators are not inlined (see Cargo.toml).
    let mut k = 0;
    while k < AREA {
        let (x, y) = (left + k % SIDE, top + k / SIDE);
        let level = levels[3 * (y * width + x) + 1] as u32;
        product += block[k] * level as f64;
        sum += level;
        squares += level * level;
        k += 1;
    }
    Some(product / norm(sum, squares).max(1.0))
}

/// The green levels around a place, normalised to mean 0 and norm 1, and their standard deviation.
pub(super) fn patch(picture: &RgbImage, place: DVec2) -> Option<([f64; AREA], f64)> {
    let [left, top] = corner(picture, place)?;
    let levels: [u32; AREA] = std::array::from_fn(|k| {
        let (x, y) = (left + k % SIDE, top + k / SIDE);
        picture.get_pixel(x as u32, y as u32).0[1].into()
    });
    let sum: u32 = levels.iter().sum();
    let norm = norm(sum, levels.iter().map(|level| level * level).sum());
    let mean = f64::from(sum) / AREA as f64;
    let block = levels.map(|level| (f64::from(level) - mean) / norm.max(1.0));
    Some((block, norm / (AREA as f64).sqrt()))
}

/// Norm of a block's levels after subtracting their mean, from their sum and the sum of their squares.
fn norm(sum: u32, squares: u32) -> f64 {
    let [sum, squares] = [sum, squares].map(f64::from);
    (squares - sum * sum / AREA as f64).max(0.0).sqrt()
}

#[cfg(test)]
pub(super) mod tests {
    use image::Rgb;
    use image::imageops::fast_blur;

    use super::*;

    const SIZE: (u32, u32) = (160, 120);
    /// A slanted plane: its inverse depth along a ray (z = 1) of the source is the dot product with that ray.
    pub(in crate::evaluate) const PLANE: DVec3 = DVec3::new(0.12, 0.25, 0.4);

    pub(in crate::evaluate) fn camera(cx: f64) -> Intrinsics {
        Intrinsics::new((150.0, 150.0), (cx, 60.0), SIZE).unwrap()
    }

    pub(in crate::evaluate) fn pose(turn: f64, translation: [f64; 3]) -> RigidTransform {
        let rotation = DMat3::from_rotation_z(turn) * DMat3::from_rotation_y(turn);
        RigidTransform::new(rotation, translation.into()).unwrap()
    }

    /// Interpolated random levels.
    fn texture(x: f64, y: f64) -> f64 {
        let level = |x: f64, y: f64| {
            let hash = (x as i64 * 7919 + y as i64 * 104_729) as u32;
            let hash = (hash ^ (hash >> 15)).wrapping_mul(2_246_822_519);
            f64::from((hash ^ (hash >> 13)) >> 8 & 255)
        };
        let (left, top) = (x.floor(), y.floor());
        let row = |y: f64| level(left, y) + (x - left) * (level(left + 1.0, y) - level(left, y));
        row(top) + (y - top) * (row(top + 1.0) - row(top))
    }

    /// The plane as a camera sees it.
    pub(in crate::evaluate) fn view(
        intrinsics: Intrinsics,
        from_source: RigidTransform,
        plane: DVec3,
    ) -> RgbImage {
        let back = from_source.rotation.transpose();
        RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let ray = back * intrinsics.unproject(pixel, 1.0);
            let start = back * from_source.translation;
            let point = ray * ((1.0 + plane.dot(start)) / plane.dot(ray)) - start;
            Rgb([texture(12.0 * point.x, 12.0 * point.y) as u8; 3])
        })
    }

    /// What a picture shows of the motion to a target.
    fn told(
        cameras: [Intrinsics; 2],
        true_pose: RigidTransform,
        shown: &RgbImage,
    ) -> Option<ShownCamera> {
        told_in(RigidTransform::IDENTITY, cameras, true_pose, shown)
    }

    /// Like [`told`], with another pose of the source in the world.
    fn told_in(
        source_from_world: RigidTransform,
        cameras: [Intrinsics; 2],
        true_pose: RigidTransform,
        shown: &RgbImage,
    ) -> Option<ShownCamera> {
        let source = view(cameras[0], RigidTransform::IDENTITY, PLANE);
        let target = view(cameras[1], true_pose, PLANE);
        let poses = [source_from_world, true_pose.after(&source_from_world)];
        shown_camera(cameras, poses, [&source, &target, shown], None).camera
    }

    #[test]
    fn multiples_of_the_motion_are_measured() {
        let cameras = [camera(80.0); 2];
        for (turn, translation) in [(0.0, [-0.15, 0.0, 0.0]), (0.03, [0.12, 0.06, 0.02])] {
            let seen = |factor: f64| {
                view(
                    cameras[1],
                    pose(turn, translation.map(|v| factor * v)),
                    PLANE,
                )
            };
            for percent in [100_i16, -100, 50, 200, 0, 70] {
                let noisy = {
                    let mut shown = seen(f64::from(percent) / 100.0);
                    for (at, level) in shown.iter_mut().enumerate() {
                        *level = level.saturating_add((at * 7919 % 13) as u8);
                    }
                    shown
                };
                let found = told(cameras, pose(turn, translation), &noisy);
                assert!(
                    matches!(found, Some(ShownCamera::Moved(found)) if (found - percent).abs() <= i16::max(4, percent.abs() / 12)),
                    "{percent}: {found:?}"
                );
                let is_wrong = ![100, 70].contains(&percent);
                assert_eq!(found.unwrap().is_wrong(), is_wrong, "{percent}");
            }
        }
    }

    #[test]
    fn misread_poses_are_told() {
        let own = pose(0.06, [0.15, 0.05, 0.02]);
        let cameras = [camera(70.0), camera(80.0)];
        let axes = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let read = |rotation, translation| RigidTransform {
            rotation,
            translation,
        };
        for (cause, intrinsics, misread) in [
            (ShownCamera::SourceIntrinsics, cameras[0], own),
            (ShownCamera::InversePose, cameras[1], own.inverse()),
            (
                ShownCamera::OtherAxes,
                cameras[1],
                read(axes * own.rotation * axes, axes * own.translation),
            ),
            (
                ShownCamera::TransposedRotation,
                cameras[1],
                read(own.rotation.transpose(), own.translation),
            ),
            (
                ShownCamera::NoRotation,
                cameras[1],
                read(DMat3::IDENTITY, own.translation),
            ),
            (
                ShownCamera::NoRotation,
                cameras[1],
                read(DMat3::IDENTITY, own.rotation.transpose() * own.translation),
            ),
            (
                ShownCamera::Reversed(0),
                cameras[1],
                read(own.rotation, own.translation * DVec3::new(-1.0, 1.0, 1.0)),
            ),
            (
                ShownCamera::Reversed(1),
                cameras[1],
                read(own.rotation, own.translation * DVec3::new(1.0, -1.0, 1.0)),
            ),
        ] {
            assert_eq!(
                told(cameras, own, &view(intrinsics, misread, PLANE)),
                Some(cause)
            );
        }
    }

    #[test]
    fn translations_in_world_axes_are_told() {
        let cameras = [camera(80.0); 2];
        let own = pose(0.03, [0.15, 0.06, 0.02]);
        // A world whose z points up and whose x points along the view.
        let axes = DMat3::from_cols(DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y);
        let source_from_world = RigidTransform::new(axes, DVec3::new(3.0, 1.0, 2.0)).unwrap();
        let world = (own.rotation * axes).transpose() * own.translation;
        for (sign, is_reversed) in [(1.0, false), (-1.0, true)] {
            let misread = RigidTransform {
                rotation: own.rotation,
                translation: sign * world,
            };
            assert_eq!(
                told_in(
                    source_from_world,
                    cameras,
                    own,
                    &view(cameras[1], misread, PLANE)
                ),
                Some(ShownCamera::WorldTranslation(is_reversed))
            );
        }
        let right = told_in(
            source_from_world,
            cameras,
            own,
            &view(cameras[1], own, PLANE),
        );
        assert!(
            matches!(right, Some(ShownCamera::Moved(95..=105))),
            "{right:?}"
        );
    }

    #[test]
    fn near_and_far_exchanged_are_told() {
        let cameras = [camera(80.0); 2];
        let own = pose(0.0, [0.15, 0.0, 0.0]);
        // Inverse depths between 0.03 and 0.77, and what results if they are used as depths.
        let steep = DVec3::new(0.0, 0.9, 0.4);
        let source = view(cameras[0], RigidTransform::IDENTITY, steep);
        let target = view(cameras[1], own, steep);
        let told = |inverse_depth: &dyn Fn(f64) -> f64| {
            // Rows move as a whole, because the camera moves along x and the depth varies along y.
            let shown = RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
                let depth = 0.4 + 0.9 * (f64::from(y) + 0.5 - 60.0) / 150.0;
                let back = f64::from(x) - 150.0 * 0.15 * inverse_depth(depth);
                let at = |x: f64| source.get_pixel(x.clamp(0.0, 159.0) as u32, y).0[0];
                let (a, b) = (
                    f64::from(at(back.floor())),
                    f64::from(at(back.floor() + 1.0)),
                );
                Rgb([(a + (back - back.floor()) * (b - a)) as u8; 3])
            });
            let poses = [RigidTransform::IDENTITY, own];
            shown_camera(cameras, poses, [&source, &target, &shown], None).camera
        };
        assert_eq!(told(&|v| 0.8 - v), Some(ShownCamera::NearFarExchanged));
        assert_eq!(
            told(&|v| 0.1 / (v + 0.08)),
            Some(ShownCamera::NearFarExchanged)
        );
        // Right and poor depths.
        for depths in [&|v| v, &|v| 0.3 + 0.3 * v, &|v: f64| v.sqrt()] as [&dyn Fn(f64) -> f64; 3] {
            let found = told(depths);
            assert_ne!(found, Some(ShownCamera::NearFarExchanged));
        }
        assert_ne!(told(&|_| 0.4), Some(ShownCamera::NearFarExchanged));
    }

    #[test]
    fn masked_content_is_counted_and_holes_and_borders_are_not() {
        let own = pose(0.03, [0.12, 0.06, 0.02]);
        let cameras = [camera(80.0); 2];
        let right = view(cameras[1], own, PLANE);
        let source = view(cameras[0], RigidTransform::IDENTITY, PLANE);
        let masked = |level: u8, filled: Option<[u8; 3]>, is: fn(u32, u32) -> bool| {
            let shown = RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
                if is(x, y) {
                    Rgb([level; 3])
                } else {
                    *right.get_pixel(x, y)
                }
            });
            let poses = [RigidTransform::IDENTITY, own];
            shown_camera(cameras, poses, [&source, &right, &shown], filled)
                .masked
                .unwrap()
        };
        for level in [0, 255] {
            let half = masked(level, None, |_, y| y < 60);
            assert!((30..60).contains(&half), "{half}");
        }
        let half = masked(90, Some([90; 3]), |_, y| y < 60);
        assert!((30..60).contains(&half), "{half}");
        assert_eq!(masked(90, None, |_, y| y < 60), 0);
        assert_eq!(masked(90, Some([91; 3]), |_, y| y < 60), 0);
        // Holes between pixels, and a border that the source does not show.
        assert_eq!(masked(0, Some([0; 3]), |x, y| (x + y) % 3 == 0), 0);
        assert_eq!(masked(0, Some([0; 3]), |x, _| x < 6), 0);
    }

    #[test]
    fn poor_predictions_are_not() {
        let own = pose(0.03, [0.12, 0.06, 0.02]);
        let cameras = [camera(80.0), camera(75.0)];
        let right = view(cameras[1], own, PLANE);
        let source = view(cameras[0], RigidTransform::IDENTITY, PLANE);
        let copy = told(cameras, own, &source);
        assert!(
            matches!(copy, None | Some(ShownCamera::Moved(-5..=5))),
            "{copy:?}"
        );
        let blend = RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
            let [a, b] = [&source, &right].map(|p| p.get_pixel(x, y).0[1] / 2);
            Rgb([a + b; 3])
        });
        let elsewhere = RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
            Rgb([texture(f64::from(x) / 5.0 + 900.0, f64::from(y) / 5.0) as u8; 3])
        });
        for (what, shown) in [
            ("blurred", fast_blur(&right, 4.0)),
            ("blend", blend),
            (
                "one depth",
                view(cameras[1], own, DVec3::new(0.0, 0.0, 0.45)),
            ),
            (
                "flatter",
                view(cameras[1], own, DVec3::new(0.06, 0.12, 0.4)),
            ),
            ("steeper", view(cameras[1], own, DVec3::new(-0.2, 0.5, 0.4))),
            (
                "one colour",
                RgbImage::from_pixel(SIZE.0, SIZE.1, Rgb([90; 3])),
            ),
            ("elsewhere", elsewhere),
        ] {
            let found = told(cameras, own, &shown);
            assert!(
                !found.is_some_and(ShownCamera::is_wrong),
                "{what}: {found:?}"
            );
        }
        // Without motion, there is nothing to measure.
        assert_eq!(told(cameras, pose(0.0, [1e-9, 0.0, 0.0]), &right), None);
    }
}
