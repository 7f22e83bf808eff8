//! Open ground, streets, and thin structures.

use glam::DVec3;

use super::super::paint::Tone;
use super::draft::Draft;
use super::furnishing::{building, car, clutter, fence, table, tree};
use super::reflective;

/// Adds the ground, which ends 70 metres away.
fn lay_ground(draft: &mut Draft<'_>, below: f64) {
    let paint = draft.paint(Tone::Earth, 1.0);
    draft.panel(DVec3::new(0.0, below, 20.0), 1, (90.0, 50.0), paint);
}

/// Adds distant hills, rows of trees or houses, in most scenes.
fn close_off(draft: &mut Draft<'_>, below: f64) {
    for _ in 0..draft.count(0, 5) {
        let (x, z) = (draft.between(-35.0, 35.0), draft.between(22.0, 55.0));
        let base = DVec3::new(x, below, z);
        match draft.count(0, 3) {
            0 => {
                let paint = draft.paint(Tone::Leaf, 3.0);
                let radius = draft.between(10.0, 16.0);
                let sunk = radius * draft.between(1.3, 1.7);
                draft.ball(base + DVec3::Y * sunk, radius, paint);
            }
            1 => {
                let size = DVec3::new(
                    draft.between(5.0, 16.0),
                    draft.between(3.0, 14.0),
                    draft.between(4.0, 9.0),
                );
                let turn = draft.between(-0.3, 0.3);
                building(draft, base, size, turn);
            }
            _ => {
                let height = draft.between(4.0, 10.0);
                tree(draft, base, height);
            }
        }
    }
}

/// Adds a random outdoor object.
fn scatter(draft: &mut Draft<'_>, range: (f64, f64), below: f64) {
    let radius = draft.between(0.3, 1.0);
    let Some(spot) = draft.spot(range, radius, |_, z| z > 0.8) else {
        return;
    };
    let base = spot + DVec3::Y * below;
    match draft.count(0, 9) {
        0..=2 => {
            let height = draft.between(1.5, 6.0);
            tree(draft, base, height);
        }
        3 | 4 => {
            let paint = draft.paint(Tone::Leaf, 0.15);
            let size = DVec3::new(
                draft.between(0.8, 4.0),
                draft.between(0.4, 1.6),
                draft.between(0.4, 0.9),
            );
            let turn = draft.between(-0.8, 0.8);
            draft.stand(base, size, turn, paint);
        }
        5 => {
            let paint = draft.paint(Tone::Stone, 0.3);
            let sunk = DVec3::Y * (radius * draft.between(0.2, 1.0));
            draft.ball(base + sunk, radius, paint);
        }
        6 => {
            let size = DVec3::new(1.6 * radius, draft.between(0.4, 0.8), 0.5);
            table(draft, base, size);
        }
        7 => {
            let paint = draft.paint(Tone::Any, 0.3);
            let (height, thick) = (draft.between(2.0, 6.0), draft.between(0.02, 0.12));
            draft.column(base, height, thick, paint);
        }
        _ => clutter(draft, base, 1.3 * radius),
    }
}

/// A garden, a yard or a field, usually with a house.
pub(super) fn ground<'a>(mut draft: Draft<'a>) -> (Draft<'a>, DVec3) {
    draft.turn_frame(0.1);
    let below = draft.between(0.9, 2.4);
    lay_ground(&mut draft, below);
    close_off(&mut draft, below);
    let far = draft.between(6.0, 25.0);
    for _ in 0..draft.count(0, 2) {
        let size = DVec3::new(
            draft.between(3.0, 12.0),
            draft.between(2.2, 8.0),
            draft.between(2.0, 8.0),
        );
        let base = DVec3::new(
            draft.between(-0.6, 0.6) * far,
            below,
            far * draft.between(0.8, 1.3) + 0.5 * size.z,
        );
        let turn = draft.between(-0.4, 0.4);
        building(&mut draft, base, size, turn);
    }
    for _ in 0..draft.count(5, 14) {
        scatter(&mut draft, (1.3, far), below);
    }
    if draft.chance(35) {
        let z = draft.between(2.0, 8.0);
        let from = DVec3::new(draft.between(-6.0, -1.0), below, z);
        let to = DVec3::new(draft.between(1.0, 6.0), below, z * draft.between(0.7, 1.4));
        let height = draft.between(0.5, 1.6);
        fence(&mut draft, from, to, height);
    }
    let depth = draft.between(0.25, 0.6) * far;
    let down = draft.between(0.0, 0.5) * below;
    let target = draft.target(depth, down);
    reflective::outdoors(&mut draft, below);
    (draft, target)
}

/// A road with houses on both sides, cars, trees and lamp posts.
pub(super) fn street<'a>(mut draft: Draft<'a>) -> (Draft<'a>, DVec3) {
    draft.turn_frame(0.06);
    let below = draft.between(1.3, 2.2);
    lay_ground(&mut draft, below);
    close_off(&mut draft, below);
    let road = draft.between(2.0, 5.0);
    let (pavement, poles) = (draft.paint(Tone::Stone, 0.5), draft.paint(Tone::Any, 0.4));
    let walk = draft.between(1.2, 3.5);
    for side in [-1.0, 1.0] {
        let offset = draft.between(-0.8, 0.8);
        let curb = side * road + offset;
        let middle = DVec3::new(curb + side * 0.5 * walk, below, 30.0);
        draft.stand(middle, DVec3::new(walk, 0.12, 62.0), 0.0, pavement.clone());
        let mut z = -draft.between(1.0, 4.0);
        let high = draft.between(4.0, 14.0);
        while z < 58.0 {
            let size = DVec3::new(
                draft.between(4.0, 9.0),
                high * draft.between(0.6, 1.3),
                draft.between(5.0, 14.0),
            );
            let back = draft.between(0.0, 1.0);
            let x = curb + side * (walk + back + 0.5 * size.x);
            // Leaves occasional gaps.
            if draft.chance(88) {
                building(
                    &mut draft,
                    DVec3::new(x, below, z + 0.5 * size.z),
                    size,
                    0.0,
                );
            }
            z += size.z + draft.between(0.0, 0.6);
        }
        let step = draft.between(3.0, 9.0);
        let trees = draft.chance(40);
        for post in 0..6 {
            let z = 2.0 + step * (f64::from(post) + draft.between(0.0, 0.2));
            let base = DVec3::new(curb + side * 0.3, below - 0.12, z);
            if trees {
                let height = draft.between(2.5, 5.5);
                tree(&mut draft, base, height);
            } else {
                draft.column(base, 4.0, 0.05, poles.clone())
            }
        }
        for _ in 0..draft.count(0, 4) {
            let base = DVec3::new(curb - side * 1.1, below, draft.between(4.5, 30.0));
            car(&mut draft, base);
        }
    }
    for _ in 0..draft.count(0, 5) {
        scatter(&mut draft, (1.5, 12.0), below);
    }
    let depth = draft.between(4.0, 10.0);
    let down = draft.between(-0.2, 0.8);
    let target = draft.target(depth, down);
    reflective::outdoors(&mut draft, below);
    (draft, target)
}

/// Fences, railings, poles and wires, some of them close.
pub(super) fn thin<'a>(mut draft: Draft<'a>) -> (Draft<'a>, DVec3) {
    draft.turn_frame(0.1);
    let below = draft.between(0.9, 1.8);
    lay_ground(&mut draft, below);
    close_off(&mut draft, below);
    for _ in 0..draft.count(2, 4) {
        let z = draft.between(0.8, 6.0);
        let from = DVec3::new(draft.between(-1.5, -0.3) * z, below, z);
        let to = DVec3::new(
            draft.between(0.2, 1.5) * z,
            below,
            z + draft.between(-0.3, 0.6) * z,
        );
        let height = draft.between(0.6, 1.3) * below;
        fence(&mut draft, from, to, height);
    }
    for _ in 0..draft.count(3, 8) {
        if let Some(spot) = draft.spot((1.0, 9.0), 0.2, |_, z| z > 0.6) {
            let paint = draft.paint(Tone::Any, 0.3);
            let (height, thick) = (draft.between(1.0, 5.0), draft.between(0.008, 0.06));
            draft.column(spot + DVec3::Y * below, height, thick, paint);
        }
    }
    let wire = draft.paint(Tone::Any, 1.0);
    for _ in 0..draft.count(2, 6) {
        let (y, z) = (draft.between(-2.2, 0.1), draft.between(2.0, 9.0));
        let ends = [-1.0, 1.0].map(|side| {
            let z = z * draft.between(0.8, 1.25);
            DVec3::new(side * 1.4 * z, y + draft.between(-0.3, 0.3), z)
        });
        let thick = draft.between(0.003, 0.012);
        draft.bar(ends[0], ends[1], thick, wire.clone());
    }
    for _ in 0..draft.count(4, 8) {
        scatter(&mut draft, (2.5, 14.0), below);
    }
    let depth = draft.between(2.0, 5.0);
    let down = draft.between(-0.1, 0.35) * below;
    let target = draft.target(depth, down);
    reflective::outdoors(&mut draft, below);
    (draft, target)
}
