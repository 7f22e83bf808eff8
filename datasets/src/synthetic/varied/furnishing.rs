//! Objects made of a few simple shapes.

use glam::DVec3;

use super::super::paint::Tone;
use super::draft::Draft;

/// Adds boxes, balls and cylinders of similar size, side by side or stacked, on a surface around `base`.
pub(super) fn clutter(draft: &mut Draft<'_>, base: DVec3, size: f64) {
    let tone = Tone::Any;
    let (width, height) = (
        size * draft.between(0.5, 1.3),
        size * draft.between(0.3, 1.6),
    );
    match draft.count(0, 4) {
        0 | 1 => {
            let paint = draft.paint(tone, 0.3 * size);
            let (deep, turn) = (size * draft.between(0.4, 1.2), draft.between(-0.6, 0.6));
            draft.stand(base, DVec3::new(width, height, deep), turn, paint);
            if draft.chance(40) {
                let top = base - DVec3::Y * height;
                let paint = draft.paint(tone, 0.3 * size);
                draft.ball(top, 0.3 * width.min(deep), paint);
            }
        }
        2 => {
            let paint = draft.paint(tone, 0.3 * size);
            draft.ball(base, 0.45 * width, paint);
        }
        3 => {
            let paint = draft.paint(tone, 0.3 * size);
            draft.column(base, height, 0.3 * width, paint);
            // The neck of a bottle.
            if draft.chance(40) {
                let paint = draft.paint(tone, 0.3 * size);
                draft.column(base - DVec3::Y * height, 0.5 * height, 0.1 * width, paint);
            }
        }
        _ => {
            let mut top = base;
            for _ in 0..draft.count(2, 5) {
                let thick = size * draft.between(0.08, 0.3);
                let paint = draft.paint(tone, 0.3 * size);
                let (scale, turn) = (draft.between(0.7, 1.0), draft.between(-0.4, 0.4));
                let sides = DVec3::new(width * scale, thick, 0.7 * width * scale);
                draft.stand(top, sides, turn, paint);
                top.y -= thick;
            }
        }
    }
}

/// A table with four legs and a few objects on it.
pub(super) fn table(draft: &mut Draft<'_>, base: DVec3, size: DVec3) {
    let wood = draft.paint(Tone::Wood, 0.15);
    let leg = draft.between(0.015, 0.04);
    for (x, z) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let foot = DVec3::new(
            x * (0.5 * size.x - leg - 0.02),
            0.0,
            z * (0.5 * size.z - leg - 0.02),
        );
        draft.column(base + foot, size.y - 0.04, leg, wood.clone());
    }
    let under = base - DVec3::Y * (size.y - 0.04);
    draft.stand(under, DVec3::new(size.x, 0.04, size.z), 0.0, wood);
    for _ in 0..draft.count(0, 4) {
        let place = DVec3::new(
            draft.between(-0.4, 0.4) * size.x,
            -size.y,
            draft.between(-0.4, 0.4) * size.z,
        );
        let size = draft.between(0.1, 0.3);
        clutter(draft, base + place, size);
    }
}

/// A seat with a back and four legs.
pub(super) fn chair(draft: &mut Draft<'_>, base: DVec3) {
    let paint = draft.paint(Tone::Wood, 0.1);
    let (half, seat) = (draft.between(0.18, 0.24), draft.between(0.4, 0.5));
    for (x, z) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let foot = DVec3::new(x, 0.0, z) * (half - 0.02);
        draft.column(base + foot, seat, 0.018, paint.clone());
    }
    let cloth = draft.paint(Tone::Any, 0.08);
    let top = base - DVec3::Y * seat;
    draft.stand(
        top,
        DVec3::new(2.0 * half, 0.05, 2.0 * half),
        0.0,
        cloth.clone(),
    );
    let side = if draft.chance(50) { 1.0 } else { -1.0 };
    let back = if draft.chance(50) {
        (
            DVec3::new(side * half, 0.0, 0.0),
            DVec3::new(0.04, 0.5, 2.0 * half),
        )
    } else {
        (
            DVec3::new(0.0, 0.0, side * half),
            DVec3::new(2.0 * half, 0.5, 0.04),
        )
    };
    draft.stand(top + back.0, back.1, 0.0, cloth);
}

/// A shelf along x: boards between two sides, with objects on the boards.
pub(super) fn shelf(draft: &mut Draft<'_>, base: DVec3, size: DVec3) {
    let paint = draft.paint(Tone::Wood, 0.2);
    for side in [-0.5, 0.5] {
        let foot = base + DVec3::X * (side * size.x);
        draft.stand(foot, DVec3::new(0.03, size.y, size.z), 0.0, paint.clone());
    }
    let boards = draft.count(2, 5);
    for board in 0..=boards {
        let height = size.y * board as f64 / boards as f64;
        let place = base - DVec3::Y * height;
        draft.stand(place, DVec3::new(size.x, 0.03, size.z), 0.0, paint.clone());
        let room = size.y / boards as f64;
        for _ in 0..draft.count(0, 3) {
            let x = draft.between(-0.42, 0.42) * size.x;
            let place = place + DVec3::new(x, -0.03, 0.0);
            clutter(draft, place, (0.55 * room).min(0.3));
        }
    }
}

/// A tree: a trunk and a crown of balls.
pub(super) fn tree(draft: &mut Draft<'_>, base: DVec3, height: f64) {
    let (bark, leaves) = (
        draft.paint(Tone::Wood, 0.1),
        draft.paint(Tone::Leaf, 0.12 * height.min(3.0)),
    );
    let trunk = height * draft.between(0.3, 0.6);
    let thick = height * draft.between(0.015, 0.035);
    draft.column(base, trunk + 0.1 * height, thick, bark);
    for _ in 0..draft.count(2, 6) {
        let radius = height * draft.between(0.12, 0.26);
        let spread = 0.16 * height;
        let place = DVec3::new(
            draft.between(-spread, spread),
            -trunk - draft.between(0.0, 0.35) * height,
            draft.between(-spread, spread),
        );
        draft.ball(base + place, radius, leaves.clone());
    }
}

/// A fence of posts and rails between two points on the ground.
pub(super) fn fence(draft: &mut Draft<'_>, from: DVec3, to: DVec3, height: f64) {
    let tone = draft.one_of(Tone::Wood, Tone::Any);
    let paint = draft.paint(tone, 0.2);
    let along = to - from;
    let spacing = draft.between(0.1, 0.7);
    let posts = ((along.length() / spacing) as u64).clamp(2, 36);
    let radius = draft.between(0.008, 0.03);
    for post in 0..=posts {
        let foot = from + along * (post as f64 / posts as f64);
        draft.column(foot, height, radius, paint.clone());
    }
    let rails = draft.count(1, 4);
    for rail in 0..rails {
        let up = DVec3::Y * (-height * (1.0 - rail as f64 / rails as f64));
        draft.bar(from + up, to + up, 0.8 * radius, paint.clone());
    }
}

/// A building: a block with a base and a roof of another colour.
pub(super) fn building(draft: &mut Draft<'_>, base: DVec3, size: DVec3, turn: f64) {
    let storey = draft.between(1.2, 2.6);
    let paint = draft.paint(Tone::Stone, storey);
    draft.stand(base, size, turn, paint);
    if draft.chance(60) {
        let paint = draft.paint(Tone::Any, 0.5);
        let ledge = DVec3::new(size.x + 0.5, draft.between(0.2, 0.8), size.z + 0.5);
        draft.stand(base - DVec3::Y * size.y, ledge, turn, paint);
    }
    if draft.chance(50) {
        let paint = draft.paint(Tone::Any, 0.4);
        let plinth = DVec3::new(size.x + 0.15, draft.between(0.4, 1.2), size.z + 0.15);
        draft.stand(base, plinth, turn, paint);
    }
}

/// A car along z: body, cabin and four wheels.
pub(super) fn car(draft: &mut Draft<'_>, base: DVec3) {
    let (mut body, mut glass) = (draft.paint(Tone::Any, 3.0), draft.paint(Tone::Stone, 0.7));
    body.make_plain();
    glass.make_plain();
    let (length, height) = (draft.between(3.4, 4.8), draft.between(1.3, 1.9));
    let under = base - DVec3::Y * 0.25;
    draft.stand(under, DVec3::new(1.75, 0.45 * height, length), 0.0, body);
    let cabin = DVec3::new(1.5, 0.42 * height, 0.55 * length);
    draft.stand(under - DVec3::Y * (0.45 * height), cabin, 0.0, glass);
    let rubber = draft.paint(Tone::Earth, 0.3);
    for (x, z) in [(-0.8, -0.32), (-0.8, 0.32), (0.8, -0.32), (0.8, 0.32)] {
        let hub = base + DVec3::new(x, -0.32, z * length);
        let across = DVec3::X * 0.1;
        draft.bar(hub - across, hub + across, 0.32, rubber.clone());
    }
}
