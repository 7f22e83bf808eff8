//! Adam, and clipping of the gradient's norm over all parameters.

use rayon::prelude::*;
use serde::Deserialize;

/// Values summed or updated per task; sums do not depend on the number of threads.
const CHUNK: usize = 1 << 14;

/// A parameter of the network in training.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterState {
    /// Name in the network's checkpoints.
    pub name: String,
    /// Shape in PyTorch's layout.
    pub shape: Vec<usize>,
    /// Values in C order.
    pub values: Vec<f32>,
    /// Adam's running means; `None` for a frozen parameter.
    pub moments: Option<Moments>,
}

/// Adam's running means, each with the length of the values.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    /// Running mean of the gradient.
    pub first: Vec<f32>,
    /// Running mean of the squared gradient.
    pub second: Vec<f32>,
}

impl Moments {
    pub fn zero(len: usize) -> Self {
        Self {
            first: vec![0.0; len],
            second: vec![0.0; len],
        }
    }
}

/// The gradients do not match the parameters.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OptimizerError {
    #[error("{found} gradients for {expected} trained parameters")]
    Count { expected: usize, found: usize },
    #[error("a gradient of {found} values for {name}, which has {expected}")]
    Length {
        name: String,
        expected: usize,
        found: usize,
    },
}

/// Adam (Kingma and Ba, 2015) as in torch: ε is added to the root after bias correction, and weight
/// decay is added to the gradient. The paper only names Adam; the defaults are torch's.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Adam {
    /// Decay rates of the first and second moments.
    pub betas: [f64; 2],
    pub epsilon: f64,
    /// Weight decay: this multiple of the parameter is added to its gradient.
    pub weight_decay: f64,
}

impl Default for Adam {
    fn default() -> Self {
        Self {
            betas: [0.9, 0.999],
            epsilon: 1e-8,
            weight_decay: 0.0,
        }
    }
}

impl Adam {
    /// Updates every parameter that is not frozen. `gradients` has one element for each of these
    /// parameters, in their order. `step` is the number of updates of the moments, including this
    /// one.
    ///
    /// Computed in f64 and rounded once, on the threads of the current pool.
    ///
    /// # Errors
    /// [`OptimizerError`] if the gradients do not match the parameters; nothing is changed then.
    pub fn update(
        &self,
        weights: &mut [ParameterState],
        gradients: &[Vec<f32>],
        learning_rate: f64,
        step: u64,
    ) -> Result<(), OptimizerError> {
        check(weights, gradients)?;
        let [keep1, keep2] = self.betas;
        let correction = |keep: f64| 1.0 - keep.powf(step as f64);
        let rate = learning_rate / correction(keep1);
        let root = correction(keep2).sqrt();
        let one = |value: &mut f32, first: &mut f32, second: &mut f32, gradient: f32| {
            let gradient = f64::from(gradient) + self.weight_decay * f64::from(*value);
            let mean = keep1 * f64::from(*first) + (1.0 - keep1) * gradient;
            let square = keep2 * f64::from(*second) + (1.0 - keep2) * gradient * gradient;
            let update = rate * mean / (square.sqrt() / root + self.epsilon);
            *value = (f64::from(*value) - update) as f32;
            *first = mean as f32;
            *second = square as f32;
        };
        let mut gradients = gradients.iter();
        for ParameterState {
            values, moments, ..
        } in weights
        {
            let Some(moments) = moments else { continue };
            let Some(gradient) = gradients.next() else {
                continue;
            };
            let pairs =
                (moments.first.par_chunks_mut(CHUNK)).zip(moments.second.par_chunks_mut(CHUNK));
            let values = values.par_chunks_mut(CHUNK).zip(gradient.par_chunks(CHUNK));
            values
                .zip(pairs)
                .for_each(|((values, gradient), (first, second))| {
                    for k in 0..values.len() {
                        one(&mut values[k], &mut first[k], &mut second[k], gradient[k]);
                    }
                });
        }
        Ok(())
    }
}

fn check(weights: &[ParameterState], gradients: &[Vec<f32>]) -> Result<(), OptimizerError> {
    let trained = || weights.iter().filter(|weights| weights.moments.is_some());
    let (expected, found) = (trained().count(), gradients.len());
    if expected != found {
        return Err(OptimizerError::Count { expected, found });
    }
    for (weights, gradient) in trained().zip(gradients) {
        if weights.values.len() != gradient.len() {
            return Err(OptimizerError::Length {
                name: weights.name.clone(),
                expected: weights.values.len(),
                found: gradient.len(),
            });
        }
    }
    Ok(())
}

/// If the Euclidean norm over all gradients exceeds `limit`, scales them by `limit / (norm +
/// 1e-6)`, as in torch. Returns the norm before scaling. If the norm is not finite, the gradients
/// are left unchanged and must not be used.
pub fn clip_norm(gradients: &mut [Vec<f32>], limit: f64) -> f64 {
    let square = |chunk: &[f32]| chunk.iter().map(|&g| f64::from(g).powi(2)).sum::<f64>();
    let mut total = 0.0;
    for gradient in &*gradients {
        let sums: Vec<f64> = gradient.par_chunks(CHUNK).map(square).collect();
        total += sums.iter().sum::<f64>();
    }
    let norm = total.sqrt();
    let factor = limit / (norm + 1e-6);
    if norm.is_finite() && factor < 1.0 {
        for gradient in gradients {
            let scale = |g: &mut f32| *g = (f64::from(*g) * factor) as f32;
            gradient.par_iter_mut().with_min_len(CHUNK).for_each(scale);
        }
    }
    norm
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(name: &str, values: &[f32]) -> ParameterState {
        ParameterState {
            name: name.to_owned(),
            shape: vec![values.len()],
            values: values.to_vec(),
            moments: Some(Moments::zero(values.len())),
        }
    }

    fn frozen(name: &str, values: &[f32]) -> ParameterState {
        ParameterState {
            moments: None,
            ..weights(name, values)
        }
    }

    fn close(found: f32, expected: f64) {
        let expected = expected as f32;
        assert!(
            (found - expected).abs() <= 1e-6 * expected.abs(),
            "{found} {expected}"
        );
    }

    /// Computed by hand. Step 1: the corrected moments are g and g², so the step equals the learning rate. Step 2 with
    /// g = −1 after g = 2: first moment 0.9·0.2 − 0.1 = 0.08 over 0.19, second 0.999·0.004 + 0.001 = 0.004996 over
    /// 0.001999.
    #[test]
    fn two_steps_are_those_computed_by_hand() {
        let mut all = [frozen("f", &[7.0]), weights("w", &[1.0, -3.0])];
        let adam = Adam::default();
        adam.update(&mut all, &[vec![2.0, 0.0]], 0.1, 1).unwrap();
        close(all[1].values[0], 1.0 - 0.1 * 2.0 / (2.0 + 1e-8));
        assert_eq!(all[1].values[1], -3.0);
        let moments = all[1].moments.clone().unwrap();
        close(moments.first[0], 0.2);
        close(moments.second[0], 0.004);

        let before = f64::from(all[1].values[0]);
        adam.update(&mut all, &[vec![-1.0, 0.0]], 0.05, 2).unwrap();
        let step = 0.05 * (0.08 / 0.19) / (0.004_996_f64 / 0.001_999).sqrt();
        close(all[1].values[0], before - step);
        let moments = all[1].moments.clone().unwrap();
        close(moments.first[0], 0.08);
        close(moments.second[0], 0.004_996);
        assert_eq!(all[0], frozen("f", &[7.0]));
    }

    /// Weight decay alone gives a gradient of 0.5 · 4 = 2. With ε = 2, the first step is half the
    /// learning rate.
    #[test]
    fn weight_decay_is_part_of_the_gradient() {
        let mut all = [weights("w", &[4.0])];
        let adam = Adam {
            weight_decay: 0.5,
            epsilon: 2.0,
            ..Adam::default()
        };
        adam.update(&mut all, &[vec![0.0]], 0.2, 1).unwrap();
        close(all[0].values[0], 4.0 - 0.2 * 2.0 / (2.0 + 2.0));
    }

    #[test]
    fn the_norm_is_over_all_gradients_and_clips_only_above_its_limit() {
        let mut gradients = [vec![3.0, 0.0], vec![4.0]];
        assert_eq!(clip_norm(&mut gradients, 5.1), 5.0);
        assert_eq!(gradients, [vec![3.0, 0.0], vec![4.0]]);
        assert_eq!(clip_norm(&mut gradients, 2.0), 5.0);
        close(gradients[0][0], 3.0 * 2.0 / (5.0 + 1e-6));
        close(gradients[1][0], 4.0 * 2.0 / (5.0 + 1e-6));
        let mut broken = [vec![1e9, f32::NAN]];
        assert!(clip_norm(&mut broken, 1.0).is_nan());
        assert_eq!(broken[0][0], 1e9);
        let mut huge = [vec![f32::MAX; 2]];
        assert!(clip_norm(&mut huge, 1.0).is_finite());
        assert!((huge[0][0] - 0.5_f32.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bytes() {
        let n = 3 * CHUNK + 17;
        let values: Vec<f32> = (0..n).map(|k| (k as f32 * 0.37).sin()).collect();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            pool.build().unwrap().install(|| {
                let mut all = [weights("w", &values)];
                let mut gradients = [values.iter().map(|v| v * v - 0.3).collect()];
                let norm = clip_norm(&mut gradients, 0.5);
                Adam::default()
                    .update(&mut all, &gradients, 1e-3, 1)
                    .unwrap();
                (norm.to_bits(), all)
            })
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn gradients_that_do_not_fit_change_nothing() {
        let mut all = [
            weights("a", &[1.0]),
            frozen("f", &[1.0]),
            weights("b", &[1.0, 2.0]),
        ];
        let before = all.clone();
        let adam = Adam::default();
        let found = adam.update(&mut all, &[vec![1.0]], 1.0, 1).unwrap_err();
        let (expected, one) = (2, 1);
        assert_eq!(
            found,
            OptimizerError::Count {
                expected,
                found: one
            }
        );
        let found = adam.update(&mut all, &[vec![1.0], vec![1.0]], 1.0, 1);
        let message = "a gradient of 1 values for b, which has 2";
        assert_eq!(found.unwrap_err().to_string(), message);
        assert_eq!(all, before);
    }
}
