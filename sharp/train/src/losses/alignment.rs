//! Losses of the scale map of depth alignment, which replace the C-VAE's KL term (paper).

use super::map::Grid;
use super::{Loss, LossOptions, ScalePooling, sign, sum_over};

/// Number of levels of ∇scale; level k, from 1, reduces the map by a factor of 2^k.
const LEVELS: i32 = 6;

/// E_p |S − 1|, the mean over all pixels of the `scale` map S; gradient with respect to S.
pub fn scale(scale: &[f32]) -> Loss<f32> {
    let share = 1.0 / scale.len().max(1) as f64;
    sum_over(scale.len(), |p| {
        let d = f64::from(scale[p]) - 1.0;
        (d.abs() * share, (sign(d) * share) as f32)
    })
}

/// Σ_k E_p |∇ S↓k| over k = 1..6, where S↓k is S reduced by 2^k; `scale` is in rows of `width`. Levels without pixels
/// contribute nothing.
///
/// # Panics
/// If the length of `scale` is not a multiple of `width`.
pub fn scale_gradient(scale: &[f32], width: usize, options: &LossOptions) -> Loss<f32> {
    let full = Grid::forward(scale.len(), width);
    let mut levels: Vec<(Grid, Loss<f64>)> = Vec::new();
    let mut map: Vec<f64> = scale.iter().map(|s| f64::from(*s)).collect();
    let mut finer = full;
    for k in 1..=LEVELS {
        let grid = Grid {
            width: finer.width / 2,
            height: finer.height / 2,
            ..finer
        };
        if grid.width * grid.height == 0 {
            break;
        }
        map = reduced(&map, finer, grid, options.scale_pooling);
        let per = if options.scale_per_full_pixel { k } else { 0 };
        let share = 0.5_f64.powi(per) / map.len() as f64;
        let norm = |p: usize| options.scale_norm.of(grid.at(|q| map[q], p));
        let each = |p: usize| (norm(p).0 * share, grid.pull(|q| norm(q).1, p) * share);
        levels.push((grid, sum_over(map.len(), each)));
        finer = grid;
    }
    let value = levels.iter().map(|(_, level)| level.value).sum();
    // The loop visits the coarsest level first; `coarser` is the gradient accumulated so far, at
    // the next coarser level.
    let mut coarser: Option<(Grid, Vec<f64>)> = None;
    for (grid, mut level) in levels.into_iter().rev() {
        if let Some((above, of)) = &coarser {
            let pulled = |p| pulled(of, *above, grid, p, options.scale_pooling);
            let each = level.gradient.iter_mut().enumerate();
            each.for_each(|(p, own)| *own += pulled(p));
        }
        coarser = Some((grid, level.gradient));
    }
    let gradient = sum_over(scale.len(), |p| match &coarser {
        Some((above, of)) => (
            0.0,
            pulled(of, *above, full, p, options.scale_pooling) as f32,
        ),
        None => (0.0, 0.0),
    });
    Loss { value, ..gradient }
}

fn reduced(map: &[f64], finer: Grid, grid: Grid, pooling: ScalePooling) -> Vec<f64> {
    let one = |p: usize| {
        let first = 2 * (p / grid.width) * finer.width + 2 * (p % grid.width);
        match pooling {
            ScalePooling::First => map[first],
            ScalePooling::Average => {
                let below = first + finer.width;
                0.25 * (map[first] + map[first + 1] + map[below] + map[below + 1])
            }
        }
    };
    sum_over(grid.width * grid.height, |p| (0.0, one(p))).gradient
}

/// Gradient with respect to pixel `p` of the `finer` map, given `of`, the gradient with respect to the reduced map
/// `above`.
fn pulled(of: &[f64], above: Grid, finer: Grid, p: usize, pooling: ScalePooling) -> f64 {
    let (x, y) = (p % finer.width, p / finer.width);
    if x / 2 >= above.width || y / 2 >= above.height {
        return 0.0;
    }
    let share = match pooling {
        ScalePooling::Average => 0.25,
        ScalePooling::First => f64::from(u8::from(x % 2 == 0 && y % 2 == 0)),
    };
    share * of[y / 2 * above.width + x / 2]
}

#[cfg(test)]
mod tests {
    use super::super::GradientNorm;
    use super::super::testing::{check, noise};
    use super::*;

    #[test]
    fn hand_cases() {
        let loss = scale(&[1.0, 1.5, 0.5, 1.0]);
        assert_eq!(
            (loss.value, loss.gradient),
            (0.25, vec![0.0, 0.25, -0.25, 0.0])
        );
        // Means 1, 3 over 1, 3: in each of two rows, one step of 2. The next level is a single
        // pixel without a step.
        let s = [1.0, 1.0, 3.0, 3.0].repeat(4);
        let loss = scale_gradient(&s, 4, &LossOptions::default());
        assert_eq!(loss.value, 1.0);
        let eighth = 0.25 / 4.0;
        assert_eq!(loss.gradient[..4], [-eighth, -eighth, eighth, eighth]);
        let per = LossOptions {
            scale_per_full_pixel: true,
            ..LossOptions::default()
        };
        assert_eq!(scale_gradient(&s, 4, &per).value, 0.5);
        assert_eq!(scale_gradient(&[2.0, 3.0], 2, &per).gradient, [0.0; 2]);
    }

    #[test]
    fn gradients_are_those_of_the_definitions() {
        let x = noise(1, 35 * 38);
        let of = |x: &[f64]| x.iter().map(|s| (s - 1.0).abs()).sum::<f64>() / x.len() as f64;
        let loss = scale(&x);
        check(&x, loss.value, &loss.gradient, of);

        // Compares with means over blocks of 2^k, without repeated halving; 38 columns and 35 rows
        // leave remainders.
        for pooling in [ScalePooling::Average, ScalePooling::First] {
            for norm in [GradientNorm::Absolute, GradientNorm::Euclidean] {
                let options = LossOptions {
                    scale_pooling: pooling,
                    scale_norm: norm,
                    ..LossOptions::default()
                };
                let loss = scale_gradient(&x, 38, &options);
                check(&x, loss.value, &loss.gradient, |x| {
                    let mut sum = 0.0;
                    for k in 1..=5 {
                        let side = 1 << k;
                        let (w, h) = (38 / side, 35 / side);
                        let at = |r: usize, c: usize| {
                            let block = if pooling == ScalePooling::First {
                                1
                            } else {
                                side
                            };
                            let inside = (0..block).flat_map(|i| (0..block).map(move |j| (i, j)));
                            let all = inside.map(|(i, j)| x[(r * side + i) * 38 + c * side + j]);
                            all.sum::<f64>() / (block * block) as f64
                        };
                        for (r, c) in (0..h).flat_map(|r| (0..w).map(move |c| (r, c))) {
                            let dx = at(r, (c + 1).min(w - 1)) - at(r, c);
                            let dy = at((r + 1).min(h - 1), c) - at(r, c);
                            let norm = match norm {
                                GradientNorm::Absolute => dx.abs() + dy.abs(),
                                GradientNorm::Euclidean => dx.hypot(dy),
                            };
                            sum += norm / (w * h) as f64;
                        }
                    }
                    sum
                });
            }
        }
    }
}
