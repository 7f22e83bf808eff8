//! Training data: pairs of views with depth, and photographs without.
//!
//! Sample k depends only on the seed of the training run and on k, so that a resumed run continues with the same
//! samples.
//!
//! * [`Sample`], [`TrainingView`], [`Photograph`], [`Source`]: the interface to training.
//! * [`ProceduralSamples`], [`TrainingWorlds`]: scenes generated on the fly from seeds.
//! * [`PosedSamples`]: posed pictures with depth, read by `sharp-datasets`.
//! * [`FolderPhotographs`], [`ProceduralPhotographs`], [`held_out_entries`]: pictures without depth.
//! * [`Prefetcher`]: samples prepared in the background, in order.
//! * [`DataError`]: errors of training data.

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
pub use photographs::{FolderPhotographs, ProceduralPhotographs, held_out_entries};
pub use posed::PosedSamples;
pub use prefetch::Prefetcher;
pub use procedural::{ProceduralSamples, TrainingWorlds, shares_training_seeds};
pub use view::TrainingView;

/// Two views of a scene. The network receives the source's picture; the predicted Gaussians are
/// compared with both views.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Id, `SCENE/SOURCE__TARGET`.
    pub id: String,
    pub source: TrainingView,
    pub target: TrainingView,
}

/// A picture without depth or other views.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// Id: `SCENE/VIEW`, or the file's name.
    pub id: String,
    /// Picture, sRGB-encoded.
    pub image: RgbImage,
    pub intrinsics: Intrinsics,
}

/// An infinite sequence of samples.
pub trait Source<T>: Send {
    /// Returns sample k, which is the same on every call.
    ///
    /// # Errors
    /// [`DataError::Sample`], with the sample's index.
    fn get(&self, k: u64) -> Result<T, DataError>;
}

impl<T, S: Source<T> + ?Sized> Source<T> for Box<S> {
    fn get(&self, k: u64) -> Result<T, DataError> {
        (**self).get(k)
    }
}

/// Random generator for sample k.
pub(crate) fn draws(seed: u64, k: u64) -> SplitMix64 {
    SplitMix64::new(mix(mix(seed).wrapping_add(k)))
}
