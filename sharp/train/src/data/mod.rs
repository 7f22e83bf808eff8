//! Training data: pairs of views with depth, and photographs without.
//!
//! Sample k of a training follows from the training's seed and k alone, so that a resumed training
//! continues with the same samples.
//!
//! * [`Sample`], [`TrainingView`], [`Photograph`], [`Source`]: the interface to training.
//! * [`ProceduralSamples`]: scenes made on the fly from seeds.
//! * [`PosedSamples`]: anyone's posed pictures with depth, by the readers of `sharp-datasets`.
//! * [`FolderPhotographs`], [`ProceduralPhotographs`]: pictures alone.
//! * [`Prefetcher`]: samples made in the background, in order.
//! * [`DataError`]: why data cannot be used.

mod error;
mod photographs;
mod posed;
mod prefetch;
mod procedural;
#[cfg(test)]
pub(crate) mod tests;
mod view;

use image::RgbImage;
use sharp::camera::Intrinsics;
use sharp::random::{SplitMix64, mix};

pub use error::DataError;
pub use photographs::{FolderPhotographs, ProceduralPhotographs};
pub use posed::PosedSamples;
pub use prefetch::Prefetcher;
pub use procedural::{ProceduralSamples, shares_training_seeds};
pub use view::TrainingView;

/// A pair of views of one scene: the network is given the source's picture, its Gaussians are
/// compared with both.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// `SCENE/SOURCE__TARGET`.
    pub id: String,
    pub source: TrainingView,
    pub target: TrainingView,
}

/// A picture of which neither depth nor another view is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// `SCENE/VIEW`, or the file's name.
    pub id: String,
    /// sRGB.
    pub image: RgbImage,
    pub intrinsics: Intrinsics,
}

/// An endless row of samples.
pub trait Source<T>: Send {
    /// Sample k: the same one whenever it is asked for.
    ///
    /// # Errors
    /// [`DataError::Sample`], which names the sample.
    fn get(&self, k: u64) -> Result<T, DataError>;
}

impl<T, S: Source<T> + ?Sized> Source<T> for Box<S> {
    fn get(&self, k: u64) -> Result<T, DataError> {
        (**self).get(k)
    }
}

/// The random numbers that sample k is drawn with.
pub(crate) fn draws(seed: u64, k: u64) -> SplitMix64 {
    SplitMix64::new(mix(mix(seed).wrapping_add(k)))
}
