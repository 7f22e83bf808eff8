//! What a stage learns from, as the configuration says.

use std::path::Path;

use sharp_datasets::DatasetSpec;

use crate::config::{TrainingConfig, TrainingData};
use crate::data::{
    DEFAULT_MAX_BASELINE_M, DataError, FolderPhotographs, Photograph, PosedSamples,
    ProceduralPhotographs, ProceduralSamples, Sample, Source,
};
use crate::position::Stage;
use crate::self_supervision::{MaskedSample, SelfSupervisedSamples};

/// Either stage's examples.
pub(crate) enum AnySource {
    /// Several sources take turns.
    Plain(Vec<Box<dyn Source<Sample>>>),
    Masked(Box<SelfSupervisedSamples>),
}

impl AnySource {
    /// `teacher` are the weights that make the second stage's views.
    pub(crate) fn open(
        config: &TrainingConfig,
        stage: Stage,
        teacher: &Path,
    ) -> Result<Self, DataError> {
        let settings = config.stage(stage);
        let (seed, size) = (settings.seed, (settings.side, settings.side));
        if stage == Stage::SelfSupervised {
            let photographs: Box<dyn Source<Photograph>> = match &settings.data {
                TrainingData::Photographs(folder) => {
                    Box::new(FolderPhotographs::open(folder, seed, size)?)
                }
                _ => Box::new(ProceduralPhotographs::new(seed, size)),
            };
            let network = &config.network;
            let samples = SelfSupervisedSamples::new(photographs, teacher, network, seed)?;
            return Ok(Self::Masked(Box::new(samples)));
        }
        let TrainingData::Datasets(specs) = &settings.data else {
            let samples = ProceduralSamples::new(seed, size);
            return Ok(Self::Plain(vec![Box::new(samples)]));
        };
        let mut sources: Vec<Box<dyn Source<Sample>>> = Vec::new();
        for spec in specs {
            let spec = DatasetSpec::parse(spec)?;
            let limit = DEFAULT_MAX_BASELINE_M;
            sources.push(Box::new(PosedSamples::open(&spec, seed, size, limit)?));
        }
        Ok(Self::Plain(sources))
    }
}

impl Source<MaskedSample> for AnySource {
    fn get(&self, k: u64) -> Result<MaskedSample, DataError> {
        match self {
            Self::Plain(sources) => {
                let count = sources.len() as u64;
                let sample = sources[(k % count) as usize].get(k / count)?;
                Ok(MaskedSample {
                    sample,
                    source_mask: None,
                })
            }
            Self::Masked(samples) => samples.get(k),
        }
    }
}
