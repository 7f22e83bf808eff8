//! Max pooling with every second pixel as output, of rectified maps.

use super::conv::FeatureMap;
use super::layers::{Layer, Pull};
use rayon::prelude::*;

/// Maxima of `side` × `side` pixels, at most 15.
pub(super) struct MaxPool {
    pub(super) side: usize,
    /// Rows and columns around the map that never are the maximum; 0 leaves a last odd row out.
    pub(super) padding: usize,
}

impl MaxPool {
    fn out_size(&self, size: [usize; 2]) -> [usize; 2] {
        size.map(|side| (side + 2 * self.padding - self.side) / 2 + 1)
    }

    /// Where, in its window, an output pixel's place is in the input.
    fn place(&self, out: [usize; 2], tap: u8) -> [Option<usize>; 2] {
        let (dy, dx) = (usize::from(tap) / self.side, usize::from(tap) % self.side);
        [
            (2 * out[0] + dy).checked_sub(self.padding),
            (2 * out[1] + dx).checked_sub(self.padding),
        ]
    }

    /// The maxima, and which tap of its window each came from: the first of equal ones.
    fn outputs(&self, x: &FeatureMap) -> (FeatureMap, Vec<u8>) {
        let c = x.channels;
        let mut out = FeatureMap::zeros(self.out_size(x.size()), c);
        let mut taps = vec![0_u8; out.data.len()];
        let row = out.width * c;
        let rows = out.data.par_chunks_mut(row).zip(taps.par_chunks_mut(row));
        rows.enumerate().for_each(|(oy, (out, taps))| {
            let pixels = out.chunks_exact_mut(c).zip(taps.chunks_exact_mut(c));
            for (ox, (out, taps)) in pixels.enumerate() {
                out.fill(f32::NEG_INFINITY);
                for tap in 0..(self.side * self.side) as u8 {
                    let [Some(iy), Some(ix)] = self.place([oy, ox], tap) else {
                        continue;
                    };
                    if iy >= x.height || ix >= x.width {
                        continue;
                    }
                    let pixel = &x.data[(iy * x.width + ix) * c..][..c];
                    for ((max, from), v) in out.iter_mut().zip(&mut *taps).zip(pixel) {
                        let more = *v > *max;
                        *from = if more { tap } else { *from };
                        *max = if more { *v } else { *max };
                    }
                }
            }
        });
        (out, taps)
    }

    fn pull(&self, gradient: &FeatureMap, taps: &[u8], size: [usize; 2]) -> FeatureMap {
        let c = gradient.channels;
        let mut out = FeatureMap::zeros(size, c);
        // Each input row gathers from the output rows whose windows reach it.
        let rows = out.data.par_chunks_mut(size[1] * c).enumerate();
        rows.for_each(|(iy, out)| {
            let padded = iy + self.padding;
            let first = (padded + 1).saturating_sub(self.side).div_ceil(2);
            for oy in first..gradient.height.min(padded / 2 + 1) {
                let from = oy * gradient.width * c..(oy + 1) * gradient.width * c;
                let pixels = gradient.data[from.clone()].chunks_exact(c);
                for (ox, (of, taps)) in pixels.zip(taps[from].chunks_exact(c)).enumerate() {
                    for dx in 0..self.side {
                        let tap = ((padded - 2 * oy) * self.side + dx) as u8;
                        let [_, Some(ix)] = self.place([oy, ox], tap) else {
                            continue;
                        };
                        if ix < size[1] {
                            let out = out[ix * c..][..c].iter_mut().zip(of).zip(taps);
                            out.for_each(|((out, of), t)| {
                                *out += if *t == tap { *of } else { 0.0 }
                            });
                        }
                    }
                }
            }
        });
        out
    }
}

impl Layer for MaxPool {
    fn trace<'a>(&'a self, x: &FeatureMap) -> (FeatureMap, Pull<'a>) {
        let size = x.size();
        let (out, taps) = self.outputs(x);
        let pull = move |gradient: FeatureMap| self.pull(&gradient, &taps, size);
        (out, Box::new(pull))
    }
}
