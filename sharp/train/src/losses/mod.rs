//! The paper's losses with their analytic derivatives, as pure functions of slices.
//!
//! Means are over all pixels of a picture or all Gaussians. Sums are f64, over fixed chunks added in order, so that
//! results are bit-identical for any number of threads. At a kink, the derivative is 0. A slice of the wrong length
//! panics.
//!
//! # Contents
//! * [`LossWeights`], [`LossOptions`]: the published weights, and choices that the paper leaves open.
//! * `pictures`: [`color`], [`alpha`], [`depth`]; [`linear_from_srgb_gradient`].
//! * `regularizers`: [`tv`], [`grad_projected`], [`grad`], [`delta`], [`splat`].
//! * `alignment`: [`scale`], [`scale_gradient`].
//! * [`perceptual`]: features of a frozen network, and the paper's graph surgery.
//!
//! Private: `map` (finite differences and their adjoint).

mod alignment;
mod map;
mod options;
pub mod perceptual;
mod pictures;
mod regularizers;
#[cfg(test)]
mod testing;

pub use alignment::{scale, scale_gradient};
pub use options::{
    AlphaViews, Channels, Difference, GradAt, GradientNorm, InverseDepthUnits, LossOptions,
    LossWeights, MaskNormalization, MaskSky, ScalePooling, SplatVariance, SplatView, TERMS,
};
pub use perceptual::{Perceptual, PerceptualOptions};
pub use pictures::{alpha, color, depth, linear_from_srgb_gradient};
pub use regularizers::{GradOutput, delta, grad, grad_projected, splat, tv};

use rayon::prelude::*;

/// A loss and its gradient with respect to one of its arguments, without the weight λ.
#[derive(Debug, Clone, PartialEq)]
pub struct Loss<G> {
    pub value: f64,
    /// Gradient, one element per element of the argument.
    pub gradient: Vec<G>,
}

/// Elements per task. A constant, so that results do not depend on the number of threads.
const CHUNK: usize = 8192;

/// Sums over `0..count`; `each(index)` returns the index's summand and its element of the gradient.
fn sum_over<G: Clone + Default + Send>(
    count: usize,
    each: impl Fn(usize) -> (f64, G) + Sync,
) -> Loss<G> {
    let mut gradient = vec![G::default(); count];
    let sums: Vec<f64> = gradient
        .par_chunks_mut(CHUNK)
        .enumerate()
        .map(|(chunk, out)| {
            let mut sum = 0.0;
            for (i, out) in out.iter_mut().enumerate() {
                let value;
                (value, *out) = each(chunk * CHUNK + i);
                sum += value;
            }
            sum
        })
        .collect();
    Loss {
        value: sums.iter().sum(),
        gradient,
    }
}

/// Derivative of |x|, with 0 at 0.
fn sign(x: f64) -> f64 {
    f64::from(i8::from(x > 0.0) - i8::from(x < 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_weights_are_the_published_and_files_may_name_some() {
        let all = serde_json::to_value(LossWeights::default()).unwrap();
        let published = serde_json::json!({
            "color": 1.0, "alpha": 1.0, "percep": 3.0, "depth": 0.2, "tv": 1.0,
            "grad": 0.5, "delta": 1.0, "splat": 1.0, "scale": 0.1, "scale_gradient": 5.0,
        });
        assert_eq!(all, published);
        let some: LossWeights = toml::from_str("percep = 0.0").unwrap();
        assert_eq!((some.percep, some.scale_gradient), (0.0, 5.0));
        assert!(toml::from_str::<LossWeights>("perceptual = 1.0").is_err());
    }

    #[test]
    fn options_read_back_and_unknown_ones_are_refused() {
        let text = serde_json::to_string(&LossOptions::default()).unwrap();
        let read: LossOptions = serde_json::from_str(&text).unwrap();
        assert_eq!(read, LossOptions::default());
        let some: LossOptions =
            toml::from_str("alpha_views = \"input\"\npercep = { crop = 64 }").unwrap();
        assert_eq!(some.alpha_views, AlphaViews::Input);
        assert_eq!(some.percep.crop, Some(64));
        assert!(toml::from_str::<LossOptions>("percep = { gramm = 1.0 }").is_err());
    }

    #[test]
    fn sums_do_not_depend_on_threads() {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let each = |i: usize| ((i as f64).sqrt(), i as f32);
            pool.build().unwrap().install(|| sum_over(100_000, each))
        };
        assert_eq!(with(1), with(3));
    }
}
