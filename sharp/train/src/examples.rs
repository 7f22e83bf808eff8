//! Training examples of a stage, according to its configuration.

use std::path::Path;

use sharp_datasets::DatasetSpec;

use crate::config::{TrainingConfig, TrainingData};
use crate::data::{
    DataError, FolderPhotographs, Photograph, PosedSamples, ProceduralPhotographs,
    ProceduralSamples, Sample, Source, TrainingWorlds,
};
use crate::position::Stage;
use crate::self_supervision::SelfSupervisedSamples;

pub(crate) struct Examples {
    /// Sources of examples, used in turn.
    sources: Vec<Box<dyn Source<Sample>>>,
    /// Excluded parts of the data, each with its reason.
    pub left_out: Vec<String>,
}

impl Examples {
    /// Opens the data of a stage; `teacher` is the file of weights that generate the second stage's views.
    pub(crate) fn open(
        config: &TrainingConfig,
        stage: Stage,
        teacher: &Path,
    ) -> Result<Self, DataError> {
        let settings = config.stage(stage);
        let (seed, size) = (settings.seed, (settings.side, settings.side));
        let limit_m = settings.max_baseline_m;
        let worlds = match settings.data {
            TrainingData::Reflective => TrainingWorlds::HalfReflective,
            _ => TrainingWorlds::Varied,
        };
        let mut left_out = Vec::new();
        let mut sources: Vec<Box<dyn Source<Sample>>> = Vec::new();
        if stage == Stage::SelfSupervised {
            let photographs: Box<dyn Source<Photograph>> = match settings.data.photographs() {
                Some((folder, held_out)) => {
                    Box::new(FolderPhotographs::open(folder, held_out, seed, size)?)
                }
                None => Box::new(ProceduralPhotographs::new(seed, size, worlds)),
            };
            let network = &config.network;
            let samples = SelfSupervisedSamples::new(photographs, teacher, network, settings)?;
            sources.push(Box::new(samples));
        } else if let TrainingData::Datasets(specs) = &settings.data {
            for spec in specs {
                let spec = DatasetSpec::parse(spec)?;
                let samples = PosedSamples::open(&spec, seed, size, limit_m)?;
                let reasons = samples.left_out().iter();
                left_out.extend(reasons.map(|reason| format!("{spec}: {reason}")));
                sources.push(Box::new(samples));
            }
        } else {
            sources.push(Box::new(ProceduralSamples::new(seed, size, worlds)));
        }
        Ok(Self { sources, left_out })
    }
}

impl Source<Sample> for Examples {
    fn get(&self, k: u64) -> Result<Sample, DataError> {
        let count = self.sources.len() as u64;
        self.sources[(k % count) as usize].get(k / count)
    }
}
