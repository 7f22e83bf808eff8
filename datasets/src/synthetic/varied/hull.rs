//! The shell of a room: walls, floor and ceiling, and the objects that hang on the walls.

use glam::DVec3;

use super::super::paint::{Paint, Tone};
use super::draft::Draft;

/// An empty room around the cameras: x and z of its walls, y of floor and ceiling.
pub(super) struct Hull {
    pub(super) left: f64,
    pub(super) right: f64,
    pub(super) behind: f64,
    pub(super) ahead: f64,
    pub(super) floor: f64,
    pub(super) ceiling: f64,
}

impl Hull {
    pub(super) fn holds(&self, x: f64, z: f64, margin: f64) -> bool {
        x > self.left + margin
            && x < self.right - margin
            && z > self.behind + margin
            && z < self.ahead - margin
    }

    pub(super) fn center(&self) -> DVec3 {
        DVec3::new(
            0.5 * (self.left + self.right),
            0.5 * (self.floor + self.ceiling),
            0.5 * (self.behind + self.ahead),
        )
    }

    pub(super) fn put(&self, draft: &mut Draft<'_>) {
        let center = self.center();
        let half = DVec3::new(self.right, self.floor, self.ahead) - center;
        let tone = draft.one_of(Tone::Wood, Tone::Any);
        let floor = draft.paint(tone, 0.35);
        draft.panel(center.with_y(self.floor), 1, (half.x, half.z), floor);
        let mut ceiling = draft.paint(Tone::Wall, 0.6);
        if draft.chance(70) {
            ceiling.make_plain();
        }
        draft.panel(center.with_y(self.ceiling), 1, (half.x, half.z), ceiling);
        let wall = draft.paint(Tone::Wall, 0.4);
        for (x, z) in [
            (self.left, 0.0),
            (self.right, 0.0),
            (0.0, self.ahead),
            (0.0, self.behind),
        ] {
            // Often one wall has a different paint.
            let paint = if draft.chance(25) {
                draft.paint(Tone::Any, 0.5)
            } else {
                wall.clone()
            };
            if x != 0.0 {
                draft.panel(center.with_x(x), 0, (half.z, half.y), paint)
            } else {
                draft.panel(center.with_z(z), 2, (half.x, half.y), paint)
            }
        }
    }

    /// Adds doors, windows and pictures to the walls ahead and to the sides.
    pub(super) fn hang(&self, draft: &mut Draft<'_>, count: u64) {
        for _ in 0..count {
            let (wide, high) = (draft.between(0.3, 1.6), draft.between(0.3, 1.3));
            let shining = draft.chance(20);
            let paint = if shining {
                Paint::shining(draft.random)
            } else {
                draft.paint(Tone::Any, 0.25)
            };
            let door = draft.chance(25);
            let (high, y) = if door {
                (2.05, self.floor - 1.025)
            } else {
                (high, draft.between(self.ceiling + 0.8, self.floor - 1.0))
            };
            let wall = draft.count(0, 2);
            let z = draft.between(0.3 * self.ahead, self.ahead - 0.5);
            let x = draft.between(self.left + 0.5, self.right - 0.5);
            let (place, size) = match wall {
                0 => (DVec3::new(self.left, y, z), DVec3::new(0.06, high, wide)),
                1 => (DVec3::new(self.right, y, z), DVec3::new(0.06, high, wide)),
                _ => (DVec3::new(x, y, self.ahead), DVec3::new(wide, high, 0.06)),
            };
            let base = place + DVec3::Y * (0.5 * high);
            draft.stand(base, size, 0.0, paint);
        }
    }
}
