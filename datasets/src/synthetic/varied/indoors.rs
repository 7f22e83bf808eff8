//! Rooms, tables seen from close by, and corridors.

use glam::DVec3;

use super::super::paint::{Paint, Tone};
use super::draft::Draft;
use super::furnishing::{chair, clutter, shelf, table};
use super::hull::Hull;
use super::reflective;

pub(super) fn room<'a>(mut draft: Draft<'a>) -> (Draft<'a>, DVec3) {
    draft.turn_frame(0.13);
    let floor = draft.between(0.9, 1.8);
    let hull = Hull {
        left: -draft.between(1.3, 4.5),
        right: draft.between(1.3, 4.5),
        behind: -draft.between(1.0, 3.0),
        ahead: draft.between(2.6, 9.0),
        floor,
        ceiling: (floor - draft.between(2.3, 3.6)).min(-0.6),
    };
    hull.put(&mut draft);
    let hung = draft.count(1, 6);
    hull.hang(&mut draft, hung);
    furnish(&mut draft, &hull);
    light_up(&mut draft, &hull);
    let depth = draft.between(0.35, 0.8) * hull.ahead;
    let below = draft.between(-0.1, 0.5) * floor;
    let target = draft.target(depth, below);
    reflective::indoors(&mut draft, &hull);
    (draft, target)
}

fn furnish(draft: &mut Draft<'_>, hull: &Hull) {
    for _ in 0..draft.count(5, 14) {
        let radius = draft.between(0.3, 0.8);
        let range = (0.8, hull.ahead + 1.5);
        let Some(spot) = draft.spot(range, 0.8 * radius, |x, z| hull.holds(x, z, 0.7 * radius))
        else {
            continue;
        };
        let base = spot + DVec3::Y * hull.floor;
        let long = draft.between(0.7, 1.6) * radius;
        match draft.count(0, 9) {
            0 | 1 => {
                let size = DVec3::new(1.4 * radius, draft.between(0.4, 0.95), long);
                table(draft, base, size);
            }
            2 | 3 => chair(draft, base),
            4 => {
                let size = DVec3::new(1.4 * radius, draft.between(0.7, 2.0), 0.35);
                shelf(draft, base, size);
            }
            // A cupboard or a bed.
            5 | 6 => {
                let size = DVec3::new(1.3 * radius, draft.between(0.4, 1.9), long);
                let tone = draft.one_of(Tone::Wood, Tone::Any);
                let turn = draft.between(-0.2, 0.2);
                let paint = draft.paint(tone, 0.25);
                draft.stand(base, size, turn, paint);
                clutter(draft, base - DVec3::Y * size.y, 0.3);
            }
            // A floor lamp that is off, or a pillar.
            7 => {
                let paint = draft.paint(Tone::Any, 0.2);
                let (height, thick) = (draft.between(1.2, 2.0), draft.between(0.012, 0.05));
                draft.column(base, height, thick, paint);
                let shade = draft.paint(Tone::Wall, 0.1);
                draft.column(base - DVec3::Y * height, 0.3, 0.2, shade);
            }
            _ => clutter(draft, base, radius),
        }
    }
}

/// Adds one to three lamps under the ceiling, some hanging from a wire.
fn light_up(draft: &mut Draft<'_>, hull: &Hull) {
    let lamps = draft.count(1, 2);
    for _ in 0..lamps {
        let drop = draft.between(0.12, 0.7);
        let place = DVec3::new(
            draft.between(hull.left + 0.5, hull.right - 0.5),
            hull.ceiling + drop,
            draft.between(0.3 * hull.ahead, hull.ahead - 0.5),
        );
        let height = hull.floor - hull.ceiling - drop;
        let power = draft.between(0.4, 1.6) * height * height / lamps as f64;
        draft.lamp(place, draft_radius(drop), power);
        let wire = draft.paint(Tone::Any, 1.0);
        draft.bar(place - DVec3::Y * drop, place - DVec3::Y * 0.1, 0.006, wire);
    }
}

fn draft_radius(drop: f64) -> f64 {
    (0.5 * drop).min(0.12)
}

/// Objects on a table seen from close by, in a room or outdoors.
pub(super) fn table_top<'a>(mut draft: Draft<'a>) -> (Draft<'a>, DVec3) {
    draft.turn_frame(0.1);
    let top = draft.between(0.3, 0.65);
    let floor = top + draft.between(0.5, 0.9);
    let indoors = draft.light.haze_m.is_infinite();
    let mut hull = None;
    if indoors {
        let hull = hull.insert(Hull {
            left: -draft.between(1.3, 3.0),
            right: draft.between(1.3, 3.0),
            behind: -draft.between(1.0, 2.5),
            ahead: draft.between(1.8, 5.0),
            floor,
            ceiling: -draft.between(0.7, 1.8),
        });
        hull.put(&mut draft);
        let hung = draft.count(1, 4);
        hull.hang(&mut draft, hung);
        light_up(&mut draft, hull);
    } else {
        let ground = draft.paint(Tone::Earth, 0.5);
        draft.panel(DVec3::new(0.0, floor, 20.0), 1, (50.0, 50.0), ground);
    }
    let (deep, wide) = (draft.between(0.8, 1.8), draft.between(1.0, 2.4));
    let tone = draft.one_of(Tone::Wood, Tone::Any);
    let wood = draft.paint(tone, 0.15);
    let middle = 0.25 + 0.5 * deep;
    let under = DVec3::new(0.0, top + 0.05, middle);
    draft.stand(under, DVec3::new(wide, 0.05, deep), 0.0, wood);
    let near = 0.55;
    for _ in 0..draft.count(4, 14) {
        let size = draft.between(0.06, 0.32);
        let spot = draft.spot((near, deep + 0.2), 0.5 * size, |x, z| {
            x.abs() < 0.48 * wide && (z - middle).abs() < 0.48 * deep
        });
        if let Some(spot) = spot {
            clutter(&mut draft, spot + DVec3::Y * top, size);
        }
    }
    // Objects behind the table.
    for _ in 0..draft.count(1, 5) {
        let size = draft.between(0.4, 1.2);
        let range = if indoors { (1.5, 4.0) } else { (2.5, 12.0) };
        if let Some(spot) = draft.spot(range, 0.6 * size, |_, z| z > deep + 0.5) {
            clutter(&mut draft, spot + DVec3::Y * floor, size);
        }
    }
    let depth = draft.between(0.6, 1.0) * (0.4 + 0.6 * deep);
    let below = draft.between(0.5, 1.0) * top;
    let target = draft.target(depth, below);
    reflective::on_table(&mut draft, top, middle, (0.48 * wide, 0.48 * deep));
    if let Some(hull) = &hull {
        reflective::indoors(&mut draft, hull);
    }
    (draft, target)
}

/// A corridor, or a hall with two rows of columns.
pub(super) fn corridor<'a>(mut draft: Draft<'a>) -> (Draft<'a>, DVec3) {
    draft.turn_frame(0.04);
    let hall = draft.chance(40);
    let floor = draft.between(1.1, 1.8);
    let (narrow, wide) = if hall { (2.2, 5.0) } else { (0.8, 1.6) };
    let hull = Hull {
        left: -draft.between(narrow, wide),
        right: draft.between(narrow, wide),
        behind: -2.0,
        ahead: draft.between(6.0, if hall { 45.0 } else { 28.0 }),
        floor,
        ceiling: (floor - draft.between(2.3, if hall { 5.0 } else { 3.0 })).min(-0.6),
    };
    hull.put(&mut draft);
    let hung = draft.count(4, 10);
    hull.hang(&mut draft, hung);
    let stone = draft.paint(Tone::Stone, 0.4);
    let (spacing, radius) = (draft.between(1.5, 4.0), draft.between(0.06, 0.3));
    let inset = draft.between(0.3, 0.5);
    for pair in 0..if hall { 12 } else { 0 } {
        let z = 1.5 + spacing * f64::from(pair);
        for x in [hull.left * (1.0 - inset), hull.right * (1.0 - inset)] {
            if z < hull.ahead {
                let base = DVec3::new(x, floor, z);
                draft.column(base, floor - hull.ceiling, radius, stone.clone());
            }
        }
    }
    for _ in 0..draft.count(2, 8) {
        let size = draft.between(0.25, 0.7);
        let far = hull.ahead.min(14.0);
        if let Some(spot) = draft.spot((1.2, far), 0.6 * size, |x, z| hull.holds(x, z, 0.5 * size))
        {
            clutter(&mut draft, spot + DVec3::Y * floor, size);
        }
    }
    // Glowing panels under the ceiling, two of which emit light.
    let step = draft.between(2.0, 4.5);
    for panel in 0..8 {
        let z = 1.5 + step * f64::from(panel);
        if z < hull.ahead {
            let paint = Paint::shining(draft.random);
            draft.panel(
                DVec3::new(0.0, hull.ceiling + 0.01, z),
                1,
                (0.3, 0.3),
                paint,
            );
        }
    }
    let height = floor - hull.ceiling;
    for part in [0.25, 0.7] {
        let place = DVec3::new(
            0.0,
            hull.ceiling + 0.25,
            (part * hull.ahead).min(9.0 + 4.0 * part),
        );
        let power = draft.between(0.5, 1.5) * height * height;
        draft.lamp(place, 0.08, power);
    }
    let depth = draft.between(3.0, 6.0);
    let below = draft.between(-0.3, 0.6);
    let target = draft.target(depth, below);
    reflective::indoors(&mut draft, &hull);
    (draft, target)
}
