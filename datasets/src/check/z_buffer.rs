//! Depth maps that contain the values of a renderer's z-buffer, or normalised reciprocals of depth.

use super::change::Change;
use super::compare::mean_loss;
use super::explained::{DepthIs, Explained, Reading};
use super::neighbours::Neighbours;

/// What is searched for a z-buffer. The value at infinite depth is unknown, but exceeds every stored one: its excess,
/// relative to the largest stored value, is the offset.
const BUFFER: SearchStart = SearchStart {
    least_offset: 0.001,
    scale: 30.0,
};
/// What is searched for reciprocals of depth that were normalised between near and far: the offset is
/// near / (far - near).
const INVERSE: SearchStart = SearchStart {
    least_offset: 0.01,
    scale: 0.3,
};
/// Number of offsets that are tried, each twice the previous one.
const DOUBLED: u32 = 9;
/// Number of steps in the search for the factor of the translations, then the ratio between
/// consecutive factors.
const SCALES: (i32, f64) = (15, 1.2589);
/// For refining the offset, then the factor: the number of steps, and the ratio between consecutive values.
const REFINED: [(i32, f64); 2] = [(4, 1.15), (4, 1.1)];
/// Number of times that the offset and the factor are refined.
const REFINEMENTS: usize = 3;

/// Where the search for an offset and a factor of the poses' translations begins.
struct SearchStart {
    least_offset: f64,
    /// Initial factor, which corresponds to a near distance of 1 / `scale` metres.
    scale: f64,
}

impl Neighbours<'_> {
    /// The best-fitting z-buffer, with depths in units of the near plane's distance.
    pub(super) fn z_buffer(&self) -> (Change, Vec<Explained>) {
        let (_, scale, explained) = self.fit_offset(&BUFFER, &|most, beyond| {
            DepthIs::Buffer(most * (1.0 + beyond))
        });
        (Change::Buffer(1.0 / scale), explained)
    }

    /// The near and far distance, in metres, between which reciprocals of depth were normalised if they fit best.
    pub(super) fn inverse_between(&self) -> (Change, Vec<Explained>) {
        let of = |most: f64, offset: f64| DepthIs::InverseBetween(most, most * offset);
        let (offset, scale, explained) = self.fit_offset(&INVERSE, &of);
        let near = 1.0 / scale;
        let far = near * (1.0 + offset) / offset;
        (Change::InverseBetween(near, far), explained)
    }

    /// The offset and factor of the translations that explain the views best. `of` gives the depth for the largest stored
    /// value and an offset.
    fn fit_offset(
        &self,
        start: &SearchStart,
        of: &dyn Fn(f64, f64) -> DepthIs,
    ) -> (f64, f64, Vec<Explained>) {
        let all = self.small.values().flat_map(|(_, samples)| samples);
        let most = all.map(|sample| sample.depth).fold(0.0, f64::max);
        let with = |offset: f64, scale: f64| Reading {
            scale,
            depth: of(most, offset),
            ..Reading::AS_READ
        };
        let explained = |offset: f64, scale: f64| self.explained(&with(offset, scale), self.stride);
        let fitted = (0..DOUBLED).map(|i| {
            let offset = start.least_offset * f64::from(1 << i);
            let to = |factor: f64| with(offset, start.scale * factor);
            let scale = start.scale * self.fit(SCALES.0, SCALES.1, &to);
            (mean_loss(&explained(offset, scale)), offset, scale)
        });
        let best = fitted.min_by(|a, b| a.0.total_cmp(&b.0));
        let (_, mut offset, mut scale) = best.unwrap_or((1.0, start.least_offset, start.scale));
        let [by_offset, by_scale] = REFINED;
        for _ in 0..REFINEMENTS {
            offset *= self.fit(by_offset.0, by_offset.1, &|by| with(offset * by, scale));
            scale *= self.fit(by_scale.0, by_scale.1, &|by| with(offset, scale * by));
        }
        (offset, scale, explained(offset, scale))
    }
}
