//! Multi-head self-attention with exact softmax; the full score matrix is never stored.

use std::ops::Range;

use crate::gemm::Epilogue;
use crate::gemm::block::ProductBlock;
use crate::gemm::micro::{KC, MicroTile, stride_for};
use crate::gemm::packed::{PackedView, pack_rows, pack_transposed};
use crate::math::exp;
use crate::simd::{Simd, per_instruction_set};
use crate::workspace::{SharedOut, run_tasks};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AttentionShape {
    /// Number of independent sequences.
    pub batch: usize,
    pub tokens: usize,
    pub heads: usize,
    pub head_dim: usize,
}

impl AttentionShape {
    /// Channels of a token, over all heads.
    pub fn dim(&self) -> usize {
        self.heads * self.head_dim
    }
}

/// Number of row tiles processed at a time, chosen so that their scores fit in the L2 cache.
const TILES: usize = 3;

/// Number of partial sums or maxima of a reduction over a row; the same for every instruction set.
const LANES: usize = 16;

/// `softmax(scale · Q Kᵀ) V` for every sequence and head.
///
/// `qkv` is `[batch][tokens][3][heads][head_dim]` (queries, keys and values side by side, as one linear layer produces
/// them), `out` is `[batch][tokens][heads][head_dim]`.
///
/// # Panics
/// If a length is wrong.
pub fn attention(simd: Simd, qkv: &[f32], out: &mut [f32], shape: AttentionShape, scale: f32) {
    let AttentionShape {
        batch,
        tokens,
        heads,
        head_dim,
    } = shape;
    let dim = shape.dim();
    assert_eq!(
        qkv.len(),
        batch * tokens * 3 * dim,
        "queries, keys and values"
    );
    assert_eq!(out.len(), batch * tokens * dim, "output");
    if out.is_empty() {
        return;
    }
    let tile = MicroTile::of(simd);
    let parts = Parts::new(&tile, tokens, head_dim);
    let shared = SharedOut::new(out);
    run_tasks(batch * heads, parts.len(), |task, scratch| {
        let (sequence, head) = (task / heads, task % heads);
        let first = sequence * tokens;
        // Offset of a token's channels in `qkv`; `which` is 0 for queries, 1 for keys, 2 for values.
        let at = |which: usize, t: usize| (first + t) * 3 * dim + which * dim + head * head_dim;
        let mut split = parts.split(scratch);
        split.keys.fill(0.0);
        pack_transposed(split.keys, tile.nr, tokens, |t| {
            &qkv[at(1, t)..][..head_dim]
        });
        split.values.fill(0.0);
        pack_rows(split.values, tile.nr, tokens, head_dim, |t| {
            &qkv[at(2, t)..][..head_dim]
        });
        split.zeros.fill(0.0);
        for row in (0..tokens).step_by(parts.rows) {
            let rows = row..tokens.min(row + parts.rows);
            let query = |t: usize| &qkv[at(0, t)..][..head_dim];
            let offset = |t: usize| (first + t) * dim + head * head_dim;
            // SAFETY: each task writes the channels of one head of one sequence.
            unsafe { split.rows(simd, &parts, rows, scale, &query, shared, dim, &offset) };
        }
    });
}

/// Buffer sizes of a task.
struct Parts {
    tokens: usize,
    head_dim: usize,
    /// Number of tokens, padded to whole panels.
    columns: usize,
    /// Number of rows processed at a time.
    rows: usize,
    /// Distance between query rows, in elements.
    query_stride: usize,
    /// Distance between weight rows within each run of k, in elements.
    weight_stride: usize,
    keys: usize,
    values: usize,
    zeros: usize,
}

/// Scratch buffers of a task.
struct Split<'a> {
    keys: &'a mut [f32],
    values: &'a mut [f32],
    zeros: &'a mut [f32],
    queries: &'a mut [f32],
    scores: &'a mut [f32],
    weights: &'a mut [f32],
}

impl Parts {
    fn new(tile: &MicroTile, tokens: usize, head_dim: usize) -> Self {
        let columns = tokens.next_multiple_of(tile.nr);
        let padded_dim = head_dim.next_multiple_of(tile.nr);
        Self {
            tokens,
            head_dim,
            columns,
            rows: TILES * tile.mr,
            query_stride: stride_for(head_dim.min(KC)),
            weight_stride: stride_for(tokens.min(KC)),
            keys: head_dim * columns,
            values: tokens * padded_dim,
            zeros: columns.max(padded_dim),
        }
    }

    fn runs(&self, k: usize) -> usize {
        k.div_ceil(KC)
    }

    fn lens(&self) -> [usize; 6] {
        [
            self.keys,
            self.values,
            self.zeros,
            self.runs(self.head_dim) * self.rows * self.query_stride,
            self.rows * self.columns,
            self.runs(self.tokens) * self.rows * self.weight_stride,
        ]
        .map(|len| len.next_multiple_of(LANES))
    }

    fn len(&self) -> usize {
        self.lens().iter().sum()
    }

    fn split<'a>(&self, scratch: &'a mut [f32]) -> Split<'a> {
        let [keys, values, zeros, queries, scores, weights] = self.lens();
        let (keys, rest) = scratch.split_at_mut(keys);
        let (values, rest) = rest.split_at_mut(values);
        let (zeros, rest) = rest.split_at_mut(zeros);
        let (queries, rest) = rest.split_at_mut(queries);
        let (scores, rest) = rest.split_at_mut(scores);
        Split {
            keys: &mut keys[..self.keys],
            values: &mut values[..self.values],
            zeros,
            queries,
            scores,
            weights: &mut rest[..weights],
        }
    }
}

impl Split<'_> {
    /// Computes the output for the tokens `rows`.
    ///
    /// # Safety
    /// No other thread may access the `head_dim` elements at `offset(row)` in `out`.
    #[allow(clippy::too_many_arguments, reason = "the inputs of a kernel")]
    unsafe fn rows<'q>(
        &mut self,
        simd: Simd,
        parts: &Parts,
        rows: Range<usize>,
        scale: f32,
        query: &impl Fn(usize) -> &'q [f32],
        out: SharedOut<'_>,
        out_stride: usize,
        offset: &impl Fn(usize) -> usize,
    ) {
        let nr = MicroTile::of(simd).nr;
        let run = parts.rows * parts.query_stride;
        for (i, t) in rows.clone().enumerate() {
            for (k, part) in query(t).chunks(KC).enumerate() {
                self.queries[k * run + i * parts.query_stride..][..part.len()]
                    .copy_from_slice(part);
            }
        }
        let scores = ProductBlock {
            b: PackedView {
                simd,
                k: parts.head_dim,
                n: parts.columns,
                data: self.keys,
                bias: self.zeros,
            },
            rows: 0..rows.len(),
            panels: 0..parts.columns / nr,
            epilogue: Epilogue::None,
            out: SharedOut::new(self.scores),
            out_stride: parts.columns,
        };
        for (k, queries) in self.queries.chunks_exact(run).enumerate() {
            // SAFETY: the scores belong to this task only.
            unsafe { scores.multiply(queries, k * KC, &|row| row * parts.columns) };
        }
        softmax(
            simd,
            self.scores,
            parts.columns,
            parts.tokens,
            rows.len(),
            scale,
            self.weights,
            parts.weight_stride,
            parts.rows * parts.weight_stride,
        );
        let run = parts.rows * parts.weight_stride;
        let block = ProductBlock {
            b: PackedView {
                simd,
                k: parts.tokens,
                n: parts.head_dim,
                data: self.values,
                bias: self.zeros,
            },
            rows,
            panels: 0..parts.head_dim.div_ceil(nr),
            epilogue: Epilogue::None,
            out,
            out_stride,
        };
        for (k, weights) in self.weights.chunks_exact(run).enumerate() {
            // SAFETY: the caller upholds this function's contract.
            unsafe { block.multiply(weights, k * KC, offset) };
        }
    }
}

per_instruction_set! {
    /// Softmax of `scale` times each row of scores: `rows` rows of `tokens` elements, `stride` apart. The weights are
    /// written in runs of [`KC`] columns, the layout of a product's left operand: rows are `out_stride` apart, runs are
    /// `run` apart.
    fn softmax(
        scores: &mut [f32],
        stride: usize,
        tokens: usize,
        rows: usize,
        scale: f32,
        out: &mut [f32],
        out_stride: usize,
        run: usize,
    ) = softmax_body
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "the inputs of a kernel")]
fn softmax_body<const FMA: bool>(
    scores: &mut [f32],
    stride: usize,
    tokens: usize,
    rows: usize,
    scale: f32,
    out: &mut [f32],
    out_stride: usize,
    run: usize,
) {
    for row in 0..rows {
        let scores = &mut scores[row * stride..][..tokens];
        let (whole, rest) = scores.as_chunks::<LANES>();
        let mut max = [f32::NEG_INFINITY; LANES];
        for chunk in whole {
            for l in 0..LANES {
                max[l] = if chunk[l] > max[l] { chunk[l] } else { max[l] };
            }
        }
        let mut top = f32::NEG_INFINITY;
        for &s in max.iter().chain(rest) {
            top = top.max(s);
        }
        let (whole, rest) = scores.as_chunks_mut::<LANES>();
        let mut sums = [0.0; LANES];
        for chunk in whole {
            for l in 0..LANES {
                chunk[l] = weight::<FMA>(chunk[l], top, scale);
                sums[l] += chunk[l];
            }
        }
        let mut sum = 0.0;
        for s in sums {
            sum += s;
        }
        for s in rest {
            *s = weight::<FMA>(*s, top, scale);
            sum += *s;
        }
        let factor = 1.0 / sum;
        for (k, part) in scores.chunks(KC).enumerate() {
            let out = &mut out[k * run + row * out_stride..][..part.len()];
            for (out, s) in out.iter_mut().zip(part) {
                *out = s * factor;
            }
        }
    }
}

/// `exp(scale · (score - top))`, but at least `exp(-80)`: smaller weights are negligible, and arithmetic on subnormal
/// numbers is slow. Uses a comparison rather than `max` so that NaN propagates.
#[inline(always)]
fn weight<const FMA: bool>(score: f32, top: f32, scale: f32) -> f32 {
    let x = scale * (score - top);
    exp::<FMA>(if x < -80.0 { -80.0 } else { x })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{noise, relative_error, with_threads};

    fn exact(qkv: &[f32], shape: AttentionShape, scale: f64) -> Vec<f64> {
        let AttentionShape {
            batch,
            tokens,
            heads,
            head_dim,
        } = shape;
        let dim = shape.dim();
        let at = |b: usize, t: usize, which: usize, h: usize, c: usize| {
            f64::from(qkv[(b * tokens + t) * 3 * dim + which * dim + h * head_dim + c])
        };
        let mut out = vec![0.0; batch * tokens * dim];
        for (b, h) in (0..batch).flat_map(|b| (0..heads).map(move |h| (b, h))) {
            for t in 0..tokens {
                let scores: Vec<f64> = (0..tokens)
                    .map(|u| {
                        let dot: f64 = (0..head_dim)
                            .map(|c| at(b, t, 0, h, c) * at(b, u, 1, h, c))
                            .sum();
                        scale * dot
                    })
                    .collect();
                let max = scores.iter().copied().fold(f64::MIN, f64::max);
                let sum: f64 = scores.iter().map(|s| (s - max).exp()).sum();
                for c in 0..head_dim {
                    let mean: f64 = (0..tokens)
                        .map(|u| (scores[u] - max).exp() / sum * at(b, u, 2, h, c))
                        .sum();
                    out[(b * tokens + t) * dim + h * head_dim + c] = mean;
                }
            }
        }
        out
    }

    #[test]
    fn attention_matches_its_definition_at_every_level_and_thread_count() {
        for (batch, tokens, heads, head_dim) in [
            (2, 145, 2, 16),
            (1, 577, 2, 64),
            (1, 1, 1, 8),
            (3, 37, 3, 5),
            (1, 20, 1, 300),
        ] {
            let shape = AttentionShape {
                batch,
                tokens,
                heads,
                head_dim,
            };
            let qkv = noise(1, batch * tokens * 3 * shape.dim());
            let scale = (head_dim as f32).sqrt().recip();
            let exact = exact(&qkv, shape, f64::from(scale));
            for simd in Simd::available() {
                let run = |threads| {
                    let mut out = vec![f32::NAN; exact.len()];
                    with_threads(threads, || {
                        attention(simd, &qkv, &mut out, shape, scale);
                    });
                    out
                };
                let one = run(1);
                let error = relative_error(&one, &exact);
                assert!(error < 1e-6, "{simd:?} {shape:?}: {error}");
                assert_eq!(one, run(3));
            }
        }
    }

    #[test]
    fn large_scores_neither_overflow_nor_lose_the_winner() {
        let shape = AttentionShape {
            batch: 1,
            tokens: 2,
            heads: 1,
            head_dim: 1,
        };
        // Token 0: query 100, key 100, value 1; token 1: query 100, key -100, value 5.
        let qkv = [100.0, 100.0, 1.0, 100.0, -100.0, 5.0];
        for simd in Simd::available() {
            let mut out = [0.0; 2];
            attention(simd, &qkv, &mut out, shape, 1.0);
            assert_eq!(out, [1.0, 1.0]);
        }
    }

    #[test]
    fn nan_is_not_lost() {
        let shape = AttentionShape {
            batch: 1,
            tokens: 2,
            heads: 1,
            head_dim: 1,
        };
        let mut out = [0.0; 2];
        let qkv = [f32::NAN, 1.0, 1.0, 1.0, 1.0, 1.0];
        attention(Simd::detect(), &qkv, &mut out, shape, 1.0);
        assert!(out[0].is_nan());
    }
}
