//! Samples of procedural scenes, rendered on demand.

use sharp::random::SplitMix64;
use sharp_datasets::synthetic::{
    SyntheticOptions, SyntheticScene, TRAINING_SEEDS, WorldKind, seeds_of,
};
use sharp_datasets::{DatasetError, DatasetSpec, View};

use super::view::TrainingView;
use super::{DataError, Sample, Source, draws};

/// Pairs of views of varied procedural scenes.
///
/// Sample k uses a random training seed. With probability one half, the source is the central
/// camera of eleven, otherwise any of the eleven. The target is any other camera. (The paper
/// renders eleven views per scene without stating which are paired; this gives both interpretations
/// equal weight.) Only these two views are rendered.
#[derive(Debug, Clone)]
pub struct ProceduralSamples {
    seed: u64,
    size: (u32, u32),
    worlds: TrainingWorlds,
}

/// The worlds from which training scenes are taken. The choice does not affect a sample's seed and cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrainingWorlds {
    Varied,
    /// Every other sample is from a reflective world.
    HalfReflective,
}

impl TrainingWorlds {
    pub(super) fn of(self, k: u64) -> WorldKind {
        match self {
            Self::HalfReflective if k % 2 == 1 => WorldKind::Reflective,
            _ => WorldKind::Varied,
        }
    }
}

impl ProceduralSamples {
    /// Creates a source from a seed, with pictures of `size` (width, height) in pixels.
    pub fn new(seed: u64, size: (u32, u32), worlds: TrainingWorlds) -> Self {
        Self { seed, size, worlds }
    }
}

impl Source<Sample> for ProceduralSamples {
    fn get(&self, k: u64) -> Result<Sample, DataError> {
        let mut random = draws(self.seed, k);
        let (id, views) = scene(&mut random, self.size, self.worlds.of(k))?;
        let (source, target) = cameras(&mut random, views.len() as u64);
        pair(
            &id,
            &views[source as usize],
            &views[target as usize],
            self.size,
        )
    }
}

/// Source and target among `count` cameras, of which the first is the central one.
pub(super) fn cameras(random: &mut SplitMix64, count: u64) -> (u64, u64) {
    let source = match random.below(2) {
        0 => 0,
        _ => random.below(count),
    };
    (source, (source + 1 + random.below(count - 1)) % count)
}

pub(super) fn training_seed(random: &mut SplitMix64) -> u64 {
    let (first, last) = TRAINING_SEEDS.into_inner();
    first + random.below(last - first + 1)
}

/// A random training scene: its name, and its views with the central one first.
pub(super) fn scene(
    random: &mut SplitMix64,
    (width, height): (u32, u32),
    world: WorldKind,
) -> Result<(String, Vec<View>), DataError> {
    let seed = training_seed(random);
    let id = format!("seed{seed}");
    let options = SyntheticOptions {
        width,
        height,
        world,
        ..SyntheticOptions::varied(seed)
    };
    let scene = SyntheticScene::new(options).map_err(|e| DataError::from(e).of_sample(&id))?;
    Ok((id, scene.views().to_vec()))
}

/// Reads two views of a scene at the picture size of the training data.
pub(super) fn pair(
    scene: &str,
    source: &View,
    target: &View,
    size: (u32, u32),
) -> Result<Sample, DataError> {
    let id = format!("{scene}/{}__{}", source.id, target.id);
    let read = |view| TrainingView::read(view, size).map_err(|e| e.of_sample(&id));
    let (source, target) = (read(source)?, read(target)?);
    Ok(Sample { id, source, target })
}

/// True if a dataset contains a procedural scene whose seed is used for training, i.e. is not held out.
///
/// # Errors
/// [`DatasetError::Spec`] if the dataset is procedural but its seeds are invalid.
pub fn shares_training_seeds(spec: &DatasetSpec) -> Result<bool, DatasetError> {
    let seeds = seeds_of(spec)?;
    Ok(seeds.is_some_and(|seeds| {
        seeds.start() <= TRAINING_SEEDS.end() && seeds.end() >= TRAINING_SEEDS.start()
    }))
}
