//! Samples from posed pictures with depth, read by `sharp-datasets`.

use sharp::camera::baseline_m;
use sharp_datasets::found_scenes::Why;
use sharp_datasets::required_files::FileRole;
use sharp_datasets::synthetic::{TRAINING_SEEDS, seeds_of};
use sharp_datasets::{DatasetSpec, Scene, View, open_each};

use super::procedural::pair;
use super::{DataError, Sample, Source, draws};

/// Pairs of views of a dataset's scenes.
///
/// The source of sample k is drawn uniformly from all views that have a partner. The target is one
/// of its partners at random: a view of the same scene, within the maximum baseline and with a
/// different pose. Views without depth are never used.
#[derive(Debug)]
pub struct PosedSamples {
    seed: u64,
    size: (u32, u32),
    max_baseline_m: f64,
    scenes: Vec<Scene>,
    /// Scene and view index of every possible source.
    sources: Vec<(usize, usize)>,
    left_out: Vec<String>,
}

impl PosedSamples {
    /// Opens a dataset, reading its cameras but no pixels; pictures are resized to `size` (width, height) in pixels. A
    /// scene that cannot be read does not affect the others.
    ///
    /// # Errors
    /// [`DataError::Dataset`] if the dataset cannot be read; [`DataError::HeldOut`] for procedural scenes outside the
    /// training seeds; [`DataError::NoPair`] if no two views form a pair.
    pub fn open(
        spec: &DatasetSpec,
        seed: u64,
        size: (u32, u32),
        max_baseline_m: f64,
    ) -> Result<Self, DataError> {
        let of_training = |seed: &u64| TRAINING_SEEDS.contains(seed);
        if seeds_of(spec)?.is_some_and(|s| !of_training(s.start()) || !of_training(s.end())) {
            let dataset = spec.to_string();
            return Err(DataError::HeldOut { dataset });
        }
        let found = open_each(spec)?;
        let faults = found.left_out.iter().filter_map(|scene| match &scene.why {
            Why::Fault(error) => Some(format!("scene '{}' is left out: {error}", scene.id)),
            Why::Choice(_) => None,
        });
        let mut left_out: Vec<String> = faults.collect();
        // If errors leave no scene, report the errors.
        let mut scenes = if found.scenes.is_empty() {
            found.all()?
        } else {
            found.scenes
        };
        let views = |scenes: &[Scene]| scenes.iter().map(|s| s.views.len()).sum::<usize>();
        let all = views(&scenes);
        for scene in &mut scenes {
            scene.views.retain(has_depth);
        }
        let without = all - views(&scenes);
        if without > 0 {
            left_out.push(format!(
                "{without} of {all} views have no depth and are left out"
            ));
        }
        let mut samples = Self {
            seed,
            size,
            max_baseline_m,
            scenes,
            sources: Vec::new(),
            left_out,
        };
        let scenes = samples.scenes.iter().enumerate();
        let views = scenes.flat_map(|(i, scene)| (0..scene.views.len()).map(move |v| (i, v)));
        let paired =
            views.filter(|&(i, v)| samples.partners(&samples.scenes[i], v).next().is_some());
        samples.sources = paired.collect();
        if samples.sources.is_empty() {
            Err(DataError::NoPair {
                dataset: spec.to_string(),
                limit_m: max_baseline_m,
                left_out: samples.left_out,
            })
        } else {
            Ok(samples)
        }
    }

    /// Excluded parts of the dataset, each with its reason.
    pub fn left_out(&self) -> &[String] {
        &self.left_out
    }

    /// Possible targets for a source.
    fn partners<'a>(&self, scene: &'a Scene, view: usize) -> impl Iterator<Item = &'a View> {
        let limit_m = self.max_baseline_m;
        let source = scene.views[view].camera_from_world;
        scene.views.iter().filter(move |other| {
            let pose = other.camera_from_world;
            pose != source && baseline_m(&source, &pose) <= limit_m
        })
    }
}

/// True if the view has a depth file or is procedural.
fn has_depth(view: &View) -> bool {
    let mut files = view.content.files_by_role().into_iter();
    view.content.image_file().is_none() || files.any(|(role, _)| role == FileRole::Depth)
}

impl Source<Sample> for PosedSamples {
    fn get(&self, k: u64) -> Result<Sample, DataError> {
        let mut random = draws(self.seed, k);
        let (scene, view) = self.sources[random.below(self.sources.len() as u64) as usize];
        let scene = &self.scenes[scene];
        let partners: Vec<&View> = self.partners(scene, view).collect();
        let target = partners[random.below(partners.len() as u64) as usize];
        pair(&scene.id, &scene.views[view], target, self.size)
    }
}
