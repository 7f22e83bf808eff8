//! Finite differences of a map, and their adjoint for gradients.

use super::{Difference, GradientNorm, sign};

/// Grid of a map in row-major order; several layers may follow one another.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) difference: Difference,
}

impl Grid {
    /// Grid of a map of `len` values in rows of `width`, with forward differences.
    pub(super) fn forward(len: usize, width: usize) -> Self {
        assert!(
            width > 0 && len.is_multiple_of(width),
            "{len} values in rows of {width}"
        );
        Self {
            width,
            height: len / width,
            difference: Difference::Forward,
        }
    }

    /// For x and y: the index along this axis within the layer, the distance to the next value
    /// along the axis in memory, and the axis's length.
    fn axes(&self, index: usize) -> [(usize, usize, usize); 2] {
        let (x, y) = (index % self.width, index / self.width % self.height);
        [(x, 1, self.width), (y, self.width, self.height)]
    }

    /// The difference stencil of the pixel at `at` along a side: distance to the previous
    /// neighbour, distance to the next neighbour, and the factor of the two neighbours' difference.
    fn reach(&self, at: usize, side: usize) -> (usize, usize, f64) {
        let on = usize::from(at + 1 < side);
        match self.difference {
            Difference::Forward => (0, on, 1.0),
            Difference::Central => (usize::from(at > 0), on, 0.5),
        }
    }

    /// ∂x and ∂y of a map at one index.
    pub(super) fn at(&self, map: impl Fn(usize) -> f64, index: usize) -> [f64; 2] {
        self.axes(index).map(|(at, step, side)| {
            let (back, on, factor) = self.reach(at, side);
            factor * (map(index + on * step) - map(index - back * step))
        })
    }

    /// Gradient with respect to the map's value at `index`, given the gradient with respect to [`at`](Self::at) at
    /// every index.
    pub(super) fn pull(&self, of: impl Fn(usize) -> [f64; 2], index: usize) -> f64 {
        let mut sum = 0.0;
        for (axis, (at, step, side)) in self.axes(index).into_iter().enumerate() {
            // Visit this pixel and its two neighbours, if their differences depend on this pixel.
            for from in at.saturating_sub(1)..side.min(at + 2) {
                let (back, on, factor) = self.reach(from, side);
                let sign = f64::from(i8::from(from + on == at) - i8::from(from - back == at));
                if sign != 0.0 {
                    sum += sign * factor * of(index + from * step - at * step)[axis];
                }
            }
        }
        sum
    }
}

impl GradientNorm {
    /// The norm of a gradient vector, and the derivative of that norm.
    pub(super) fn of(self, [x, y]: [f64; 2]) -> (f64, [f64; 2]) {
        match self {
            Self::Absolute => (x.abs() + y.abs(), [sign(x), sign(y)]),
            Self::Euclidean => {
                let norm = x.hypot(y);
                let direction = if norm > 0.0 {
                    [x / norm, y / norm]
                } else {
                    [0.0; 2]
                };
                (norm, direction)
            }
        }
    }
}
