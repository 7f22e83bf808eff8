//! Mirrors, windows, panes of glass, polished floors and water, which are added to varied scenes.

use glam::{DMat3, DVec3};

use super::super::finish::Finish;
use super::super::paint::{Paint, Tone};
use super::super::shapes::{SurfaceShape, turned};
use super::draft::Draft;
use super::hull::Hull;

/// Distance in metres between a surface and a mirror or pane in front of it, so that they do not coincide.
const GAP_M: f64 = 0.004;
/// Distance of a hung mirror or window from its wall in metres, so that it is in front of doors and pictures.
const HUNG_M: f64 = 0.05;
/// Maximum thickness of the wall around a window in metres, including objects that hang on it.
const OPENING_M: f64 = 0.3;

/// An upright rectangle. `turn` is the tangent of half its angle of rotation about the vertical; without rotation, its
/// front faces the cameras.
struct Panel {
    center: DVec3,
    size: (f64, f64),
    turn: f64,
}

impl Panel {
    fn axes(&self) -> DMat3 {
        turned(0.0, self.turn, 0.0, 1.0)
    }

    fn smaller(&self) -> f64 {
        self.size.0.min(self.size.1)
    }

    fn put(&self, draft: &mut Draft<'_>, finish: Finish) {
        let shape = SurfaceShape::Rectangle {
            center: self.center,
            axes: self.axes(),
            half: (0.5 * self.size.0, 0.5 * self.size.1),
        };
        draft.put_finish(shape, finish);
    }

    /// Adds a box around `center`, both in the panel's axes.
    fn put_box(&self, draft: &mut Draft<'_>, center: DVec3, size: DVec3, paint: Paint) {
        let axes = self.axes();
        draft.put(
            SurfaceShape::Box {
                center: self.center + axes * center,
                axes,
                half: size * 0.5,
            },
            paint,
        );
    }

    /// Adds a mirror on a slightly larger wooden board.
    fn put_mirror(&self, draft: &mut Draft<'_>) {
        let silver = draft.between(0.75, 0.96);
        let tint = DVec3::new(draft.between(0.94, 1.0), 1.0, draft.between(0.92, 1.0));
        let margin = draft.between(0.02, 0.1) * self.smaller();
        let paint = draft.paint(Tone::Wood, 0.1);
        let size = DVec3::new(self.size.0 + margin, self.size.1 + margin, 0.03);
        self.put_box(draft, DVec3::Z * (GAP_M + 0.015), size, paint);
        let reflectance = tint * silver;
        self.put(draft, Finish::Mirror { reflectance });
    }

    /// A pane of glass between bars; with a mullion if it is wide.
    fn put_pane(&self, draft: &mut Draft<'_>, opening_m: f64) {
        let glass = glass(draft, opening_m);
        let thick = draft.between(0.02, 0.06) * self.smaller().min(1.0);
        let mut paint = draft.paint(Tone::Any, 0.3);
        paint.make_plain();
        let (wide, high) = self.size;
        let mullion = wide > 1.1 && draft.chance(60);
        for (place, size) in [
            (DVec3::X * (-0.5 * wide), DVec3::new(thick, high, thick)),
            (DVec3::X * (0.5 * wide), DVec3::new(thick, high, thick)),
            (DVec3::Y * (-0.5 * high), DVec3::new(wide, thick, thick)),
            (DVec3::Y * (0.5 * high), DVec3::new(wide, thick, thick)),
            (DVec3::ZERO, DVec3::new(thick, high, thick)),
        ] {
            if place != DVec3::ZERO || mullion {
                self.put_box(draft, place, size, paint.clone());
            }
        }
        self.put(draft, glass);
    }
}

fn glass(draft: &mut Draft<'_>, opening_m: f64) -> Finish {
    let dark = if draft.chance(25) {
        draft.between(0.3, 0.8)
    } else {
        1.0
    };
    let tint = DVec3::new(draft.between(0.85, 1.0), 0.98, draft.between(0.88, 1.0));
    Finish::Glass {
        index: draft.between(1.45, 1.7),
        thickness_m: draft.between(0.003, 0.02),
        tint: tint * dark,
        opening_m,
    }
}

/// Adds a level sheet of glass or water `GAP_M` above the surface at `center`.
fn lay(draft: &mut Draft<'_>, center: DVec3, half: (f64, f64), index: f64) {
    let tint = DVec3::splat(draft.between(0.6, 1.0));
    let shape = SurfaceShape::Rectangle {
        center: center - DVec3::Y * GAP_M,
        axes: DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
        half,
    };
    let finish = Finish::Glass {
        index,
        thickness_m: 0.5 * GAP_M,
        tint,
        opening_m: 0.0,
    };
    draft.put_finish(shape, finish);
}

/// Adds up to `count` mirrors and panes that stand on the surface `below` the central camera.
fn stand(
    draft: &mut Draft<'_>,
    count: u64,
    range: (f64, f64),
    below: f64,
    (low, high): (f64, f64),
    allowed: impl Fn(f64, f64) -> bool,
) {
    for _ in 0..count {
        let size = (draft.between(0.6 * low, high), draft.between(low, high));
        let turn = draft.between(-0.35, 0.35);
        let Some(spot) = draft.spot(range, 0.35 * size.0, &allowed) else {
            continue;
        };
        let mut panel = Panel {
            center: spot,
            size,
            turn,
        };
        let is_mirror = draft.chance(50);
        // Raises the panel by at most half of its frame's margin or thickness.
        let raised = if is_mirror { 0.05 } else { 0.02 } * panel.smaller();
        panel.center.y = below - 0.5 * size.1 - raised;
        if is_mirror {
            panel.put_mirror(draft)
        } else {
            panel.put_pane(draft, 0.0)
        }
    }
}

/// Adds mirrors and windows to the walls of a room, glass on its floor, and panes that stand on it.
pub(super) fn indoors(draft: &mut Draft<'_>, hull: &Hull) {
    if !draft.reflective {
        return;
    }
    let height = hull.floor - hull.ceiling;
    let far = hull.ahead.min(9.0);
    let first = draft.count(0, 2);
    for wall in first..first + draft.count(1, 3) {
        let along = match wall % 3 {
            2 => hull.right - hull.left,
            _ => 0.7 * far,
        };
        let wide = draft.between(0.6, 2.4).min(0.8 * along);
        let high = draft.between(0.6, 2.0).min(0.8 * height);
        let y = draft.between(hull.ceiling + 0.55 * high, hull.floor - 0.55 * high);
        let z = draft.between(0.3 * far + 0.5 * wide, (far - 0.5 * wide).max(0.4 * far));
        let x = draft.between(
            hull.left + 0.1 + 0.5 * wide,
            (hull.right - 0.1 - 0.5 * wide).max(hull.left + 0.2),
        );
        let (center, turn, outwards) = match wall % 3 {
            0 => (DVec3::new(hull.left + HUNG_M, y, z), -1.0, DVec3::NEG_X),
            1 => (DVec3::new(hull.right - HUNG_M, y, z), 1.0, DVec3::X),
            _ => (DVec3::new(x, y, hull.ahead - HUNG_M), 0.0, DVec3::Z),
        };
        let size = (wide, high);
        let panel = Panel { center, size, turn };
        if draft.chance(50) {
            panel.put_mirror(draft)
        } else {
            panel.put_pane(draft, OPENING_M);
            draft.admit(outwards, wide * high);
        }
    }
    if draft.chance(35) {
        let half = (
            0.5 * (hull.right - hull.left),
            0.5 * (hull.ahead - hull.behind),
        );
        let index = draft.between(1.3, 1.7);
        lay(draft, hull.center().with_y(hull.floor), half, index);
    }
    let count = draft.count(0, 1);
    let range = (1.2, far.min(5.0));
    stand(draft, count, range, hull.floor, (0.8, 2.0), |x, z| {
        hull.holds(x, z, 0.5)
    });
}

/// Adds small mirrors and panes to a table, and sometimes a sheet of glass on all of it.
pub(super) fn on_table(draft: &mut Draft<'_>, top: f64, middle: f64, half: (f64, f64)) {
    if !draft.reflective {
        return;
    }
    if draft.chance(40) {
        let index = draft.between(1.4, 1.7);
        lay(draft, DVec3::new(0.0, top, middle), half, index);
    }
    let count = draft.count(1, 2);
    let range = (0.6, middle + half.1);
    stand(draft, count, range, top, (0.2, 0.6), |x, z| {
        x.abs() < half.0 && (z - middle).abs() < half.1
    });
}

/// Adds mirrors, panes and water to open ground.
pub(super) fn outdoors(draft: &mut Draft<'_>, below: f64) {
    if !draft.reflective {
        return;
    }
    let count = draft.count(1, 3);
    stand(draft, count, (1.2, 7.0), below, (0.8, 2.4), |_, z| z > 0.8);
    if draft.chance(40) {
        let half = (draft.between(1.0, 6.0), draft.between(0.8, 4.0));
        let z = draft.between(2.0, 6.0) + half.1;
        let center = DVec3::new(draft.between(-0.3, 0.3) * z, below, z);
        lay(draft, center, half, 1.33);
    }
}
