//! Lists of the objects that a bundle of rays can hit. With these lists, all other objects can be
//! skipped without changing any result.

use glam::DVec3;

use super::shapes::SurfaceShape;

/// Distance in metres by which a shape may miss a bundle and still count as touching it. Rounding errors are far
/// smaller.
const SLACK_M: f64 = 1e-7;
/// Number of cells along each side of the grid that lists the objects between a point and the sun.
const SUN_CELLS: usize = 40;
/// Number of cells along each edge of a lamp's cube.
const LAMP_CELLS: usize = 12;

/// A bundle of rays from one point, between four planes.
pub(super) struct Wedge {
    apex: DVec3,
    /// Unit normals of the four planes, pointing inwards.
    normals: [DVec3; 4],
}

impl Wedge {
    /// Creates the bundle of rays between four directions, given in order around the bundle.
    pub(super) fn between(apex: DVec3, corners: [DVec3; 4]) -> Self {
        let middle = corners[0] + corners[1] + corners[2] + corners[3];
        let normals = [0, 1, 2, 3].map(|i| {
            let normal = corners[i].cross(corners[(i + 1) % 4]).normalize();
            if normal.dot(middle) < 0.0 {
                -normal
            } else {
                normal
            }
        });
        Self { apex, normals }
    }

    /// False only if no ray of the bundle hits the shape; its bounding sphere is tested first.
    pub(super) fn may_meet(&self, shape: &SurfaceShape, (center, square): (DVec3, f64)) -> bool {
        let to_center = center - self.apex;
        self.normals.iter().all(|normal| {
            let inside = normal.dot(to_center);
            inside > 0.0 || inside * inside < square
        }) && self.normals.iter().all(|normal| {
            let inwards = shape.reach(*normal) - normal.dot(self.apex);
            inwards > -SLACK_M
        })
    }
}

/// Objects that may block the sun from a point: a grid perpendicular to the sun's direction, with the objects in front
/// of each cell.
#[derive(Debug)]
pub(super) struct SunGrid {
    across: [DVec3; 2],
    low: [f64; 2],
    cells_per_m: [f64; 2],
    cells: Vec<Vec<u32>>,
}

impl SunGrid {
    /// Builds the grid from the shapes that cast shadows, each with its index.
    pub(super) fn new<'a>(
        to_sun: DVec3,
        shapes: impl Iterator<Item = (u32, &'a SurfaceShape)> + Clone,
    ) -> Self {
        let first = to_sun.any_orthonormal_vector();
        let across = [first, to_sun.cross(first)];
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        let span = |shape: &SurfaceShape, i: usize| {
            let low = -shape.reach(-across[i]) - SLACK_M;
            (low, shape.reach(across[i]) + SLACK_M)
        };
        for (_, shape) in shapes.clone() {
            for i in 0..2 {
                let (from, to) = span(shape, i);
                (low[i], high[i]) = (low[i].min(from), high[i].max(to));
            }
        }
        let cells_per_m = [0, 1].map(|i| SUN_CELLS as f64 / (high[i] - low[i]));
        let mut grid = Self {
            across,
            low,
            cells_per_m,
            cells: vec![Vec::new(); SUN_CELLS * SUN_CELLS],
        };
        for (index, shape) in shapes {
            let ranges = [0, 1].map(|i| {
                let (from, to) = span(shape, i);
                let at = |value| (grid.place(value, i).max(0.0) as usize).min(SUN_CELLS - 1);
                at(from)..=at(to)
            });
            for row in ranges[1].clone() {
                for column in ranges[0].clone() {
                    grid.cells[row * SUN_CELLS + column].push(index);
                }
            }
        }
        grid
    }

    /// Objects that may block the sun from a point.
    pub(super) fn before(&self, point: DVec3) -> &[u32] {
        let [column, row] = [0, 1].map(|i| self.place(point.dot(self.across[i]), i));
        let inside = |place: f64| (0.0..SUN_CELLS as f64).contains(&place);
        if !inside(column) || !inside(row) {
            return &[];
        }
        &self.cells[row as usize * SUN_CELLS + column as usize]
    }

    fn place(&self, value: f64, i: usize) -> f64 {
        (value - self.low[i]) * self.cells_per_m[i]
    }
}

/// Objects that may block the light of a lamp from a point, listed by the direction from the lamp on a cube around it.
#[derive(Debug)]
pub(super) struct LampCube {
    lamp: DVec3,
    cells: Vec<Vec<u32>>,
}

impl LampCube {
    /// Builds the cube from the shapes that cast shadows, each with its index.
    pub(super) fn new<'a>(
        lamp: DVec3,
        shapes: impl Iterator<Item = (u32, &'a SurfaceShape)> + Clone,
    ) -> Self {
        let mut cells = Vec::with_capacity(6 * LAMP_CELLS * LAMP_CELLS);
        for side in 0..6 {
            for cell in 0..LAMP_CELLS * LAMP_CELLS {
                let edge = |place: usize| 2.0 * place as f64 / LAMP_CELLS as f64 - 1.0;
                let (row, column) = (cell / LAMP_CELLS, cell % LAMP_CELLS);
                let corner = |i, j| cube_direction(side, edge(column + i), edge(row + j));
                let corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                let wedge = Wedge::between(lamp, corners);
                let met = shapes
                    .clone()
                    .filter(|(_, shape)| wedge.may_meet(shape, shape.bounds()));
                cells.push(met.map(|(index, _)| index).collect());
            }
        }
        Self { lamp, cells }
    }

    /// Objects that may block the lamp's light from a point.
    pub(super) fn before(&self, point: DVec3) -> &[u32] {
        let d = point - self.lamp;
        let size = d.abs();
        let axis = match (size.x >= size.y && size.x >= size.z, size.y >= size.z) {
            (true, _) => 0,
            (_, true) => 1,
            _ => 2,
        };
        let side = 2 * axis + usize::from(d[axis] < 0.0);
        let at = |value: f64| {
            let place = (value / size[axis] + 1.0) * (0.5 * LAMP_CELLS as f64);
            (place as usize).min(LAMP_CELLS - 1)
        };
        let (column, row) = (at(d[(axis + 1) % 3]), at(d[(axis + 2) % 3]));
        &self.cells[(side * LAMP_CELLS + row) * LAMP_CELLS + column]
    }
}

/// Direction through a point on one side of the cube. Sides are in pairs, one along each axis and one against it.
fn cube_direction(side: usize, u: f64, v: f64) -> DVec3 {
    let axis = side / 2;
    let mut direction = DVec3::ZERO;
    direction[axis] = if side.is_multiple_of(2) { 1.0 } else { -1.0 };
    direction[(axis + 1) % 3] = u;
    direction[(axis + 2) % 3] = v;
    direction
}
