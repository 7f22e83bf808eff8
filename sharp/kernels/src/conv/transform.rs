//! The transforms of Winograd's F(4×4, 3×3): 6×6 input tiles, 3×3 filters, 4×4 outputs.
//!
//! Toom–Cook over the points 0, ±5/8, ±3/2 and ∞: with slightly more multiplications, half the
//! rounding error of the usual points 0, ±1, ±2, ∞. All constants are dyadic, hence exact in f32.

use crate::gemm::micro::KC;
use crate::math::{fma, relu as rectify};
use crate::simd::per_instruction_set;
use crate::workspace::SharedOut;

/// Number of channels transformed together.
pub(super) const LANES: usize = 16;
/// Number of elements of a transformed tile.
pub(super) const PLACES: usize = 36;

const A: f64 = 5.0 / 8.0;
const B: f64 = 3.0 / 2.0;
const A1: f32 = A as f32;
const A2: f32 = (A * A) as f32;
const A3: f32 = (A * A * A) as f32;
const B1: f32 = B as f32;
const B2: f32 = (B * B) as f32;
const B3: f32 = (B * B * B) as f32;
const SUM: f32 = (A * A + B * B) as f32;
const PRODUCT: f32 = (A * A * B * B) as f32;

/// Channels processed in lockstep; aligned, because accesses that cross cache lines cost twice as much.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct ChannelLanes([f32; LANES]);

impl ChannelLanes {
    const ZERO: Self = Self([0.0; LANES]);
}

/// One dimension of a filter's transform, in f64: `G g`.
fn filter_1d(g: [f64; 3]) -> [f64; 6] {
    let at = |x: f64, scale: f64| (g[0] + g[1] * x + g[2] * x * x) / scale;
    let a = 2.0 * A * A * (A * A - B * B);
    let b = 2.0 * B * B * (B * B - A * A);
    [
        g[0] / (A * A * B * B),
        at(A, a),
        at(-A, a),
        at(B, b),
        at(-B, b),
        g[2],
    ]
}

/// `G g Gᵀ` of a 3×3 filter, rounded once.
pub(super) fn filter(g: &[f32]) -> [f32; PLACES] {
    let rows: [[f64; 6]; 3] =
        std::array::from_fn(|y| filter_1d(std::array::from_fn(|x| f64::from(g[3 * y + x]))));
    let mut out = [0.0; PLACES];
    for j in 0..6 {
        let column = filter_1d(std::array::from_fn(|y| rows[y][j]));
        for i in 0..6 {
            out[6 * i + j] = column[i] as f32;
        }
    }
    out
}

/// One dimension of an input tile's transform: `Bᵀ d`.
#[inline(always)]
fn input_1d<const FMA: bool>(d: [&ChannelLanes; 6]) -> [ChannelLanes; 6] {
    let mut out = [ChannelLanes::ZERO; 6];
    for l in 0..LANES {
        let (d0, d1, d2) = (d[0].0[l], d[1].0[l], d[2].0[l]);
        let (d3, d4, d5) = (d[3].0[l], d[4].0[l], d[5].0[l]);
        let even_a = fma::<FMA>(-B2, d2, d4);
        let odd_a = A1 * fma::<FMA>(-B2, d1, d3);
        let even_b = fma::<FMA>(-A2, d2, d4);
        let odd_b = B1 * fma::<FMA>(-A2, d1, d3);
        out[0].0[l] = fma::<FMA>(PRODUCT, d0, fma::<FMA>(-SUM, d2, d4));
        out[1].0[l] = even_a + odd_a;
        out[2].0[l] = even_a - odd_a;
        out[3].0[l] = even_b + odd_b;
        out[4].0[l] = even_b - odd_b;
        out[5].0[l] = fma::<FMA>(PRODUCT, d1, fma::<FMA>(-SUM, d3, d5));
    }
    out
}

/// One dimension of an output tile's transform: `Aᵀ m`.
#[inline(always)]
fn output_1d<const FMA: bool>(m: [&[f32; LANES]; 6]) -> [ChannelLanes; 4] {
    let mut out = [ChannelLanes::ZERO; 4];
    for l in 0..LANES {
        let (sum_a, difference_a) = (m[1][l] + m[2][l], m[1][l] - m[2][l]);
        let (sum_b, difference_b) = (m[3][l] + m[4][l], m[3][l] - m[4][l]);
        out[0].0[l] = m[0][l] + sum_a + sum_b;
        out[1].0[l] = fma::<FMA>(A1, difference_a, B1 * difference_b);
        out[2].0[l] = fma::<FMA>(A2, sum_a, B2 * sum_b);
        out[3].0[l] = fma::<FMA>(A3, difference_a, fma::<FMA>(B3, difference_b, m[5][l]));
    }
    out
}

/// Memory layout of a task's transformed tiles: the 36 places of a tile are outermost, then come runs of [`KC`]
/// channels, then tiles.
#[derive(Debug, Clone, Copy)]
pub(super) struct InputLayout {
    /// Distance between tiles, in elements.
    pub(super) tile: usize,
    /// Distance between runs, in elements.
    pub(super) run: usize,
    /// Distance between places, in elements.
    pub(super) place: usize,
}

per_instruction_set! {
    /// Transforms one input tile: 36 pixels, row by row, each with the same number of channels (a multiple of
    /// [`LANES`]). `index` is the tile's index in `out`.
    pub(super) fn input(
        pixels: &[&[f32]; PLACES],
        relu: bool,
        out: &mut [f32],
        layout: InputLayout,
        index: usize,
    ) = input_body
}

#[inline(always)]
fn input_body<const FMA: bool>(
    pixels: &[&[f32]; PLACES],
    relu: bool,
    out: &mut [f32],
    layout: InputLayout,
    index: usize,
) {
    let chunks = pixels[0].len() / LANES;
    let mut half = [ChannelLanes::ZERO; PLACES];
    for chunk in 0..chunks {
        let channel = chunk * LANES;
        let start = index * layout.tile + channel / KC * layout.run + channel % KC;
        for x in 0..6 {
            let mut column = [ChannelLanes::ZERO; 6];
            for y in 0..6 {
                column[y]
                    .0
                    .copy_from_slice(&pixels[6 * y + x][channel..channel + LANES]);
                if relu {
                    for v in &mut column[y].0 {
                        *v = rectify(*v);
                    }
                }
            }
            let column = input_1d::<FMA>(column.each_ref());
            for y in 0..6 {
                half[6 * y + x] = column[y];
            }
        }
        for y in 0..6 {
            let h = &half[6 * y..6 * y + 6];
            let row = input_1d::<FMA>([&h[0], &h[1], &h[2], &h[3], &h[4], &h[5]]);
            for x in 0..6 {
                let at = start + (6 * y + x) * layout.place;
                out[at..at + LANES].copy_from_slice(&row[x].0);
            }
        }
    }
}

/// Destination of one tile, and the operations that the output transform applies before writing it.
pub(super) struct OutputTile<'a> {
    /// Bias of each output channel, padded to a multiple of [`LANES`].
    pub(super) bias: &'a [f32],
    pub(super) channels: usize,
    /// Offset in the output of each pixel of the 4×4 block; [`OUTSIDE`] for pixels beyond the output.
    pub(super) at: [usize; 16],
    pub(super) residual: Option<&'a [f32]>,
    pub(super) relu: bool,
    pub(super) out: SharedOut<'a>,
}

/// Marks a pixel outside the output.
pub(super) const OUTSIDE: usize = usize::MAX;

per_instruction_set! {
    /// Transforms the products of one tile, which start at `start` in `products` with places `place` apart, and writes
    /// its pixels. No other thread may access those pixels.
    pub(super) fn output(
        products: &[f32],
        start: usize,
        place: usize,
        tile: &OutputTile<'_>,
    ) = output_body
}

#[inline(always)]
fn output_body<const FMA: bool>(
    products: &[f32],
    start: usize,
    place: usize,
    tile: &OutputTile<'_>,
) {
    let mut half = [ChannelLanes::ZERO; 24];
    for channel in (0..tile.channels).step_by(LANES) {
        let mut bias = [0.0; LANES];
        bias.copy_from_slice(&tile.bias[channel..channel + LANES]);
        for x in 0..6 {
            let at = start + x * place + channel;
            let column = output_1d::<FMA>([
                lanes_at(products, at),
                lanes_at(products, at + 6 * place),
                lanes_at(products, at + 12 * place),
                lanes_at(products, at + 18 * place),
                lanes_at(products, at + 24 * place),
                lanes_at(products, at + 30 * place),
            ]);
            for y in 0..4 {
                half[6 * y + x] = column[y];
            }
        }
        for y in 0..4 {
            let h = &half[6 * y..6 * y + 6];
            let row = output_1d::<FMA>([&h[0].0, &h[1].0, &h[2].0, &h[3].0, &h[4].0, &h[5].0]);
            for x in 0..4 {
                let at = tile.at[4 * y + x];
                if at == OUTSIDE {
                    continue;
                }
                let len = (tile.channels - channel).min(LANES);
                let mut lanes = row[x].0;
                for l in 0..LANES {
                    lanes[l] += bias[l];
                }
                if let Some(residual) = tile.residual {
                    for (v, r) in lanes.iter_mut().zip(&residual[at + channel..][..len]) {
                        *v += r;
                    }
                }
                if tile.relu {
                    for v in &mut lanes {
                        *v = rectify(*v);
                    }
                }
                if len == LANES {
                    // SAFETY: the caller owns the pixels of its tile.
                    let out = unsafe { tile.out.slice(at + channel, LANES) };
                    out.copy_from_slice(&lanes);
                } else {
                    // SAFETY: the caller owns the pixels of its tile.
                    let out = unsafe { tile.out.slice(at + channel, len) };
                    for (out, v) in out.iter_mut().zip(lanes) {
                        *out = v;
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn lanes_at(products: &[f32], at: usize) -> &[f32; LANES] {
    match products[at..].first_chunk() {
        Some(lanes) => lanes,
        // An index out of bounds is a bug in the caller's layout.
        None => unreachable!("products end at {}", products.len()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::noise;

    /// The three transforms together compute a correlation. The inputs are small integers scaled by
    /// powers of two, so the test's arithmetic is exact.
    #[test]
    fn the_transforms_are_a_correlation() {
        let d = noise(1, 36);
        let g = noise(2, 9);
        let splat = |v: f32| [v; LANES];
        let mut v = vec![0.0; PLACES * LANES];
        let pixels: Vec<[f32; LANES]> = d.iter().map(|&v| splat(v)).collect();
        let refs: [&[f32]; PLACES] = std::array::from_fn(|p| &pixels[p][..]);
        let layout = InputLayout {
            tile: LANES,
            run: LANES,
            place: LANES,
        };
        input_body::<false>(&refs, false, &mut v, layout, 0);
        let u = filter(&g);
        for (v, u) in v.chunks_exact_mut(LANES).zip(u) {
            v.iter_mut().for_each(|v| *v *= u);
        }
        let mut out = vec![0.0; 16 * LANES];
        let tile = OutputTile {
            bias: &splat(0.0),
            channels: LANES,
            at: std::array::from_fn(|i| i * LANES),
            residual: None,
            relu: false,
            out: SharedOut::new(&mut out),
        };
        output_body::<false>(&v, 0, LANES, &tile);
        for y in 0..4 {
            for x in 0..4 {
                let exact: f64 = (0..9)
                    .map(|i| f64::from(d[6 * (y + i / 3) + x + i % 3]) * f64::from(g[i]))
                    .sum();
                let found = f64::from(out[(4 * y + x) * LANES]);
                assert!((found - exact).abs() < 2e-5, "({y}, {x}): {found} {exact}");
            }
        }
    }
}
