//! Depth maps that contain the values of a renderer's z-buffer.

use super::change::Change;
use super::compare::mean_loss;
use super::explained::{DepthIs, Explained, Reading};
use super::neighbours::Neighbours;

/// Smallest value at infinite depth that is tried, as a relative excess over the largest stored value. The true value
/// is unknown, but exceeds every stored one.
const MIN_BEYOND: f64 = 0.001;
/// Number of excesses that are tried, each twice the previous one.
const DOUBLED: u32 = 9;
/// Initial factor of the poses' translations, which corresponds to a near plane at 1 / `SCALE` metres.
const SCALE: f64 = 30.0;
/// Number of steps in the search for the factor of the translations, then the ratio between
/// consecutive factors.
const SCALES: (i32, f64) = (15, 1.2589);
/// Number of steps and ratio between consecutive values, for refining the excess and then the
/// factor.
const REFINED: [(i32, f64); 2] = [(4, 1.15), (4, 1.1)];
/// Number of times that the excess and the factor are refined.
const REFINEMENTS: usize = 3;

impl Neighbours<'_> {
    /// The best-fitting z-buffer, with depths in units of the near plane's distance.
    pub(super) fn z_buffer(&self) -> (Change, Vec<Explained>) {
        let all = self.small.values().flat_map(|(_, samples)| samples);
        let most = all.map(|sample| sample.depth).fold(0.0, f64::max);
        let with = |beyond: f64, scale: f64| Reading {
            scale,
            depth: DepthIs::Buffer(most * (1.0 + beyond)),
            ..Reading::AS_READ
        };
        let explained = |beyond: f64, scale: f64| self.explained(&with(beyond, scale), self.stride);
        let fitted = (0..DOUBLED).map(|i| {
            let beyond = MIN_BEYOND * f64::from(1 << i);
            let to = |factor: f64| with(beyond, SCALE * factor);
            let scale = SCALE * self.fit(SCALES.0, SCALES.1, &to);
            (mean_loss(&explained(beyond, scale)), beyond, scale)
        });
        let best = fitted.min_by(|a, b| a.0.total_cmp(&b.0));
        let (_, mut beyond, mut scale) = best.unwrap_or((1.0, MIN_BEYOND, SCALE));
        let [by_beyond, by_scale] = REFINED;
        for _ in 0..REFINEMENTS {
            beyond *= self.fit(by_beyond.0, by_beyond.1, &|by| with(beyond * by, scale));
            scale *= self.fit(by_scale.0, by_scale.1, &|by| with(beyond, scale * by));
        }
        (Change::Buffer(1.0 / scale), explained(beyond, scale))
    }
}
