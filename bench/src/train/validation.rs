//! Validates weights on held-out pairs in the same way as a run evaluates a method.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use sharp::files::read_text;
use sharp::model::{ModelConfig, NetworkSpec};
use sharp_datasets::View;
use sharp_train::config::{TrainingConfig, TrainingData};
use sharp_train::data::{held_out_entries, shares_training_seeds};
use sharp_train::trainer::TrainingError;

use super::{TrainError, TrainingFolder};
use crate::evaluate::record::Status;
use crate::evaluate::{Request, Results, RunOptions, prepare};
use crate::io::atomic_files::FileError;
use crate::io::observer::Observer;
use crate::methods::sharp::Sharp;
use crate::methods::{Method, TrueDepth};
use crate::pairs::dataset::scenes_of;
use crate::pairs::sampling::spread;
use crate::pairs::{DatasetConfig, OpenDataset, PairError, PairList, PairOrigin, PairRecipe};
use crate::report::board::Board;
use crate::report::statistics::of_metric;
use crate::scoring::{Scoring, ScoringRules};

/// The data for validating weights.
pub struct ValidationRequest {
    pub datasets: Vec<DatasetConfig>,
    /// Maximum number of pairs, spread over datasets and scenes.
    pub pairs: usize,
    pub scoring: Scoring,
}

impl ValidationRequest {
    /// Default dataset: eight procedural scenes.
    pub const DATASET: &'static str =
        "Validation:synthetic=world=varied,seed=900000,scenes=8,size=256x256";
    /// Default number of pairs: one from each scene of [`Self::DATASET`].
    pub const PAIRS: usize = 8;
}

/// Label of the validated method.
const LABEL: &str = "sharp";

/// A validation that can be repeated during training.
pub(super) struct Validation {
    datasets: Vec<OpenDataset>,
    scoring: Scoring,
    pairs: PathBuf,
    folder: PathBuf,
}

impl Validation {
    /// Selects the pairs by the paper's rules and writes them into the folder of the training run.
    ///
    /// # Errors
    /// [`TrainError::NotHeldOut`] if a dataset is also trained on; [`TrainError::OtherFolder`] if the pairs differ from
    /// those of earlier validations; [`TrainError::Pairs`] if the pairs cannot be built.
    pub(super) fn new(
        request: ValidationRequest,
        config: &TrainingConfig,
        folder: &TrainingFolder,
        observer: &dyn Observer,
    ) -> Result<Self, TrainError> {
        for dataset in &request.datasets {
            if shares_training_seeds(&dataset.spec)? {
                return Err(TrainError::NotHeldOut {
                    spec: dataset.to_string(),
                    reason:
                        "networks are trained on these seeds; use seeds below 1000, or 900000 and above"
                            .to_owned(),
                });
            }
        }
        let datasets = OpenDataset::open_all(&request.datasets, None)?;
        held_out(&datasets, config)?;
        let built = PairRecipe::default().build(&datasets, None, observer)?;
        let all = built.list("");
        let scenes = scenes_of(&datasets);
        let mut resolved = all.resolve(&scenes)?;
        let split = SplitPhotographs::of(config)?;
        let fresh = |view: &View| split.as_ref().is_none_or(|split| split.allows(view));
        resolved.retain(|pair| pair.pair.selected && fresh(pair.source) && fresh(pair.target));
        let chosen = spread(&resolved, request.pairs);
        if chosen.is_empty() {
            let split = split.map(|_| {
                "both photographs of a pair must be held out (`stage2.data.split`)".to_owned()
            });
            let advice: Vec<String> = built.advice.into_iter().chain(split).collect();
            return Err(PairError::NoPair(advice.join("; ")).into());
        }
        let path = folder.root().join("validation-pairs.csv");
        let list = PairList::new(&path, chosen.iter().map(|pair| pair.pair.clone()).collect());
        // Before the first measurement there is no curve, so other pairs are allowed.
        let curve = read_text(&folder.root().join("validation.csv")).unwrap_or_default();
        if curve.lines().count() > 1 && PairList::read(&path)?.sha256 != list.sha256 {
            return Err(TrainError::OtherFolder {
                folder: folder.root().to_owned(),
                reason:
                    "this training run was validated on other pairs before (validation-pairs.csv), and a \
                         curve must not mix different pairs; use the same datasets and number of \
                         pairs, or another folder"
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

    /// The mean of every metric, with the metric's key. If there are several datasets, the key is preceded by the
    /// dataset's name.
    ///
    /// # Errors
    /// If a pair cannot be predicted, or the run fails.
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
        let method: Box<dyn Method> = Box::new(Sharp::new(LABEL, network, TrueDepth::None)?);
        let request = Request {
            pairs: PairOrigin::Given(self.pairs.clone()),
            ..Request::new(
                self.datasets.clone(),
                vec![method],
                self.scoring.under(ScoringRules::default()),
            )
        };
        // Only the last validation is kept; the curves are in the log.
        if self.folder.exists() {
            fs::remove_dir_all(&self.folder).map_err(FileError::new(&self.folder, "replace"))?;
        }
        let finished = prepare(request, &Unstopped(observer))?.run(
            &self.folder,
            RunOptions::default(),
            &Unstopped(observer),
        )?;
        means(&finished.results)
    }
}

/// A folder of photographs, of which the second stage uses only a part.
struct SplitPhotographs {
    folder: PathBuf,
    held_out: Vec<PathBuf>,
}

impl SplitPhotographs {
    /// Reads the split from a configuration; `None` if the configuration splits no folder.
    fn of(config: &TrainingConfig) -> Result<Option<Self>, TrainError> {
        let (1.., TrainingData::Split(split)) = (config.stage2.steps, &config.stage2.data) else {
            return Ok(None);
        };
        let folder = split.photographs.canonicalize();
        let folder = folder.map_err(FileError::new(&split.photographs, "read"))?;
        let held_out = held_out_entries(&folder, split.held_out).map_err(TrainingError::from)?;
        Ok(Some(Self { folder, held_out }))
    }

    /// True if the view's picture is held out or outside the folder.
    fn allows(&self, view: &View) -> bool {
        let file = view.content.image_file().map(Path::canonicalize);
        let Some(Ok(file)) = file else {
            return true;
        };
        !file.starts_with(&self.folder) || self.held_out.iter().any(|entry| file.starts_with(entry))
    }
}

/// Checks that no stage trains on the scenes of `datasets`.
fn held_out(datasets: &[OpenDataset], config: &TrainingConfig) -> Result<(), TrainError> {
    let refused = |dataset: &OpenDataset, what: String| TrainError::NotHeldOut {
        spec: dataset.config.to_string(),
        reason: format!("this training run uses {what}; validate on data that it does not use"),
    };
    let root = |dataset: &OpenDataset| dataset.root()?.canonicalize().ok();
    if let (1.., TrainingData::Datasets(specs)) = (config.stage1.steps, &config.stage1.data) {
        let mut seen = HashSet::new();
        for spec in specs {
            let dataset = OpenDataset::open_recorded(&spec.parse()?, &[], None)?;
            let root = root(&dataset);
            seen.extend(
                dataset
                    .scenes
                    .into_iter()
                    .map(|s| (root.clone(), s.cluster)),
            );
        }
        for dataset in datasets.iter().filter(|dataset| dataset.root().is_some()) {
            let root = root(dataset);
            let mut clusters = dataset.scenes.iter().map(|scene| &scene.cluster);
            if let Some(scene) = clusters.find(|c| seen.contains(&(root.clone(), (*c).clone()))) {
                return Err(refused(dataset, format!("scene '{scene}' of this dataset")));
            }
        }
    }
    if let (1.., TrainingData::Photographs(folder)) = (config.stage2.steps, &config.stage2.data)
        && let Ok(folder) = folder.canonicalize()
    {
        let holds = |root: PathBuf| root.starts_with(&folder) || folder.starts_with(&root);
        if let Some(dataset) = datasets
            .iter()
            .find(|dataset| root(dataset).is_some_and(holds))
        {
            return Err(refused(
                dataset,
                format!("the photographs of {}", folder.display()),
            ));
        }
    }
    Ok(())
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
    let board = Board::of(results)?;
    let several = board.datasets.len() > 1;
    let mut means = Vec::new();
    for dataset in &board.datasets {
        for metric in &board.metrics {
            let name = if several {
                format!("{} {}", dataset.dataset.name, metric.key)
            } else {
                metric.key.clone()
            };
            let mean = of_metric(dataset, 0, &metric.key).mean;
            means.extend(mean.map(|mean| (name, mean)));
        }
    }
    Ok(means)
}

/// Ignores stop requests during a validation. A validation is short, and the checkpoint of the
/// validated step is written only afterwards.
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
