//! Weights measured on pairs that no training sees, as any run measures a method.

use std::fs;
use std::path::{Path, PathBuf};

use sharp::model::{ModelConfig, NetworkSpec};
use sharp_datasets::DatasetSpec;
use sharp_train::data::shares_training_seeds;

use super::{TrainError, TrainingFolder};
use crate::evaluate::record::Status;
use crate::evaluate::{PairOrigin, Request, Results, RunOptions, prepare};
use crate::io::atomic_files::FileError;
use crate::io::observer::Observer;
use crate::methods::sharp::Sharp;
use crate::methods::{Method, Privilege};
use crate::pairs::dataset::scenes_of;
use crate::pairs::sampling::spread;
use crate::pairs::{OpenDataset, PairError, PairList, PairRecipe};
use crate::report::NoPictures;
use crate::report::PublishedNumbers;
use crate::report::assemble::input;
use crate::report::board::Board;
use crate::report::statistics::of_metric;
use crate::scoring::{Scoring, ScoringRules};

/// What weights are validated on.
pub struct ValidationRequest {
    /// Each `[NAME:]FORMAT=PATH[,key=value…]`.
    pub datasets: Vec<String>,
    /// Pairs at most, spread over datasets and scenes.
    pub pairs: usize,
    pub scoring: Scoring,
}

impl ValidationRequest {
    /// Eight procedural scenes, of which one pair each is taken with [`Self::PAIRS`] pairs.
    pub const DATASET: &'static str =
        "Validation:synthetic=world=varied,seed=900000,scenes=8,size=256x256";
    pub const PAIRS: usize = 8;
}

/// The label of the weights.
const LABEL: &str = "sharp";

/// A validation that can be repeated.
pub(super) struct Validation {
    datasets: Vec<OpenDataset>,
    scoring: Scoring,
    pairs: PathBuf,
    folder: PathBuf,
}

impl Validation {
    /// Chooses the pairs, by the paper's rules, and writes them into the training's folder.
    ///
    /// # Errors
    /// [`TrainError::NotHeldOut`]; [`TrainError::OtherFolder`] for pairs other than those that this training was
    /// validated on before; [`TrainError::Pairs`].
    pub(super) fn new(
        request: ValidationRequest,
        folder: &TrainingFolder,
        observer: &dyn Observer,
    ) -> Result<Self, TrainError> {
        for text in &request.datasets {
            if shares_training_seeds(&DatasetSpec::parse(text)?)? {
                return Err(TrainError::NotHeldOut { spec: text.clone() });
            }
        }
        let datasets = OpenDataset::open_all(&request.datasets, None)?;
        let built = PairRecipe::default().build(&datasets, None, observer)?;
        let all = built.list("");
        let scenes = scenes_of(&datasets);
        let mut resolved = all.resolve(&scenes)?;
        resolved.retain(|pair| pair.pair.selected);
        let chosen = spread(&resolved, request.pairs);
        if chosen.is_empty() {
            return Err(PairError::NoPair(built.advice.join("; ")).into());
        }
        let path = folder.root().join("validation-pairs.csv");
        let list = PairList::new(&path, chosen.iter().map(|pair| pair.pair.clone()).collect());
        if path.exists() && PairList::read(&path)?.sha256 != list.sha256 {
            return Err(TrainError::OtherFolder {
                folder: folder.root().to_owned(),
                reason: "its training was validated on other pairs (validation-pairs.csv), and curves would mix them; \
                         name the same datasets and as many pairs, or take another folder"
                    .to_owned(),
            });
        }
        list.write()?;
        Ok(Self {
            datasets,
            scoring: request.scoring,
            pairs: path,
            folder: folder.validation(),
        })
    }

    /// The mean of every metric, by its key; with the dataset's name before it where there are several.
    ///
    /// # Errors
    /// When a pair cannot be predicted, and as a run.
    pub(super) fn measure(
        &self,
        weights: &Path,
        config: &ModelConfig,
        observer: &dyn Observer,
    ) -> Result<Vec<(String, f64)>, TrainError> {
        let network = NetworkSpec {
            config: config.clone(),
            ..NetworkSpec::release(weights)
        };
        let method: Box<dyn Method> = Box::new(Sharp::new(LABEL, network, Privilege::None)?);
        let request = Request {
            pairs: PairOrigin::Given(self.pairs.clone()),
            ..Request::new(
                self.datasets.clone(),
                vec![method],
                self.scoring.under(ScoringRules::default()),
            )
        };
        // Only the last one is kept: the curves are in the log.
        if self.folder.exists() {
            let removed = fs::remove_dir_all(&self.folder);
            removed.map_err(FileError::new(&self.folder, "replace"))?;
        }
        let finished = prepare(request, &Unstopped(observer))?.run(
            &self.folder,
            RunOptions::default(),
            &Unstopped(observer),
        )?;
        means(&finished.results)
    }
}

fn means(results: &Results) -> Result<Vec<(String, f64)>, TrainError> {
    for record in &results.records {
        if let Status::Failed { reason } = &record.status {
            return Err(TrainError::Unpredicted {
                pair: record.pair_id.clone(),
                reason: reason.clone(),
            });
        }
    }
    let input = input(results, &NoPictures, PublishedNumbers::Never);
    let board = Board::new(input.records, &input.datasets, &input.methods)?;
    let several = board.datasets.len() > 1;
    let mut means = Vec::new();
    for dataset in &board.datasets {
        for metric in &input.metrics {
            let name = match several {
                true => format!("{} {}", dataset.dataset.name, metric.key),
                false => metric.key.clone(),
            };
            let mean = of_metric(dataset, 0, &metric.key).mean;
            means.extend(mean.map(|mean| (name, mean)));
        }
    }
    Ok(means)
}

/// Lets a validation end, which is short, whatever its observer asks: the step that it belongs to is then checkpointed.
struct Unstopped<'a>(&'a dyn Observer);

impl Observer for Unstopped<'_> {
    fn warn(&self, text: &str) {
        self.0.warn(text);
    }

    fn begin(&self, _: &str, steps: usize, unit: &'static str) {
        self.0.begin("validation", steps, unit);
    }

    fn progress(&self, done: usize, _: &str) {
        self.0.progress(done, "");
    }

    fn step(&self) {
        self.0.step();
    }

    fn end(&self) {
        self.0.end();
    }
}
