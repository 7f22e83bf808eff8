//! Gradient of self-attention: scores are made again, head by head.

use rayon::prelude::*;

use super::AttentionShape;

/// Gradient of `qkv` from that of the output of [`attention`](super::attention()), in its layout
/// `[batch][tokens][3][heads][head_dim]`. Plain loops: for the short sequences of small networks.
///
/// With P the weights and O = P V: ∂V = Pᵀ∂O, ∂P = ∂O Vᵀ, and of the scores S
/// ∂S = P ∘ (∂P − rowsum(P ∘ ∂P)); ∂Q = scale ∂S K, ∂K = scale ∂Sᵀ Q.
///
/// # Panics
/// When a length is wrong.
pub fn attention_gradient(
    qkv: &[f32],
    upstream: &[f32],
    shape: AttentionShape,
    scale: f32,
) -> Vec<f32> {
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
    assert_eq!(upstream.len(), batch * tokens * dim, "upstream");
    let mut out = vec![0.0; qkv.len()];
    if out.is_empty() {
        return out;
    }
    let sequences = qkv
        .par_chunks(tokens * 3 * dim)
        .zip(upstream.par_chunks(tokens * dim));
    let each = out.par_chunks_mut(tokens * 3 * dim).zip(sequences);
    each.for_each(|(out, (qkv, upstream))| {
        for head in 0..heads {
            let rows =
                |which: usize| gathered(qkv, 3 * dim, which * dim + head * head_dim, head_dim);
            let [q, k, v] = [rows(0), rows(1), rows(2)];
            let of_output = gathered(upstream, dim, head * head_dim, head_dim);
            let [mut dq, mut dk, mut dv] = [0; 3].map(|_| vec![0.0; tokens * head_dim]);
            let (mut weights, mut slopes) = (vec![0.0; tokens], vec![0.0; tokens]);
            for t in 0..tokens {
                let at = |rows: &[f32], t: usize| -> std::ops::Range<usize> {
                    debug_assert_eq!(rows.len(), tokens * head_dim);
                    t * head_dim..(t + 1) * head_dim
                };
                let (query, g) = (&q[at(&q, t)], &of_output[at(&of_output, t)]);
                for s in 0..tokens {
                    weights[s] = scale * dot(query, &k[at(&k, s)]);
                    slopes[s] = dot(g, &v[at(&v, s)]);
                }
                softmax(&mut weights);
                let mean = dot(&weights, &slopes);
                for s in 0..tokens {
                    let of_score = scale * weights[s] * (slopes[s] - mean);
                    let place = at(&k, s);
                    add(&mut dv[place.clone()], g, weights[s]);
                    add(&mut dk[place.clone()], query, of_score);
                    add(&mut dq[at(&q, t)], &k[place], of_score);
                }
            }
            for (which, rows) in [dq, dk, dv].iter().enumerate() {
                let first = which * dim + head * head_dim;
                for (t, row) in rows.chunks_exact(head_dim).enumerate() {
                    out[t * 3 * dim + first..][..head_dim].copy_from_slice(row);
                }
            }
        }
    });
    out
}

/// Columns `first..first + width` of rows of `stride`.
fn gathered(rows: &[f32], stride: usize, first: usize, width: usize) -> Vec<f32> {
    let part = |row: &[f32]| row[first..first + width].to_vec();
    rows.chunks_exact(stride).flat_map(part).collect()
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    /// Partial sums, so that the loop has vectors to work with.
    const LANES: usize = 16;
    let mut sums = [0.0; LANES];
    let (a_chunks, b_chunks) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let (a_rest, b_rest) = (a_chunks.remainder(), b_chunks.remainder());
    for (a, b) in a_chunks.zip(b_chunks) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    for (lane, (a, b)) in a_rest.iter().zip(b_rest).enumerate() {
        sums[lane] += a * b;
    }
    sums.iter().sum()
}

fn add(sum: &mut [f32], row: &[f32], factor: f32) {
    for (sum, v) in sum.iter_mut().zip(row) {
        *sum += factor * v;
    }
}

fn softmax(scores: &mut [f32]) {
    let largest = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let mut sum = 0.0;
    for score in scores.iter_mut() {
        *score = (*score - largest).exp();
        sum += *score;
    }
    scores.iter_mut().for_each(|score| *score /= sum);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{noise, relative_error, with_threads};

    const SHAPE: AttentionShape = AttentionShape {
        batch: 2,
        tokens: 5,
        heads: 3,
        head_dim: 18,
    };

    /// Σ upstream · attention, in f64.
    fn loss(qkv: &[f64], upstream: &[f32], scale: f64) -> f64 {
        let AttentionShape {
            batch,
            tokens,
            heads,
            head_dim,
        } = SHAPE;
        let dim = SHAPE.dim();
        let mut sum = 0.0;
        for (b, h, t) in (0..batch)
            .flat_map(|b| (0..heads).flat_map(move |h| (0..tokens).map(move |t| (b, h, t))))
        {
            let at = |which: usize, t: usize, c: usize| {
                qkv[(b * tokens + t) * 3 * dim + which * dim + h * head_dim + c]
            };
            let score = |s: usize| {
                let products = (0..head_dim).map(|c| at(0, t, c) * at(1, s, c));
                (scale * products.sum::<f64>()).exp()
            };
            let total: f64 = (0..tokens).map(score).sum();
            for c in 0..head_dim {
                let mixed: f64 = (0..tokens).map(|s| score(s) / total * at(2, s, c)).sum();
                let place = (b * tokens + t) * dim + h * head_dim + c;
                sum += f64::from(upstream[place]) * mixed;
            }
        }
        sum
    }

    #[test]
    fn gradients_are_those_of_central_differences() {
        let qkv = noise(1, SHAPE.batch * SHAPE.tokens * 3 * SHAPE.dim());
        let upstream = noise(2, qkv.len() / 3);
        let found = attention_gradient(&qkv, &upstream, SHAPE, 0.3);
        let wide: Vec<f64> = qkv.iter().map(|v| f64::from(*v)).collect();
        let exact: Vec<f64> = (0..qkv.len())
            .map(|k| {
                let at = |step: f64| {
                    let mut moved = wide.clone();
                    moved[k] += step;
                    loss(&moved, &upstream, 0.3)
                };
                (at(1e-5) - at(-1e-5)) / 2e-5
            })
            .collect();
        assert!(relative_error(&found, &exact) < 2e-6);
        let again = with_threads(3, || attention_gradient(&qkv, &upstream, SHAPE, 0.3));
        assert_eq!(found, again);
    }
}
