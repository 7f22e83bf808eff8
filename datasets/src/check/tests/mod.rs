//! Views in memory, and how tests change them.

mod depth;
mod pairs;
mod proper;
mod spoiled;
mod still;

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use image::{GrayImage, RgbImage};

use super::advice::Units;
use super::{Effort, check, look};
use crate::processing::Processing;
use crate::synthetic::{SyntheticOptions, SyntheticScene};
use crate::view::evenly_spaced;
use crate::{DatasetError, DatasetSpec, DepthMap, Pairing, Scene, View, ViewContent};

/// A view's pixels.
#[derive(Debug, Clone)]
pub(super) struct Pixels {
    pub(super) picture: RgbImage,
    pub(super) depth: Option<DepthMap>,
    pub(super) valid: Option<GrayImage>,
}

impl Pixels {
    pub(super) fn of(view: &View) -> Self {
        Self {
            picture: view.content.image().unwrap(),
            depth: view.content.depth().unwrap(),
            valid: view.content.valid_pixels().unwrap(),
        }
    }

    pub(super) fn turn(&mut self, turn: impl Fn(&RgbImage) -> RgbImage) {
        self.picture = turn(&self.picture);
    }

    pub(super) fn change(&mut self, change: impl Fn(&DepthMap) -> DepthMap) {
        self.depth = self.depth.as_ref().map(change);
    }

    /// Changes the values of the depth map where there is depth.
    pub(super) fn each(&mut self, change: impl Fn(f32) -> f32) {
        let values = self.depth.iter_mut().flat_map(|depth| depth.iter_mut());
        values.filter(|z| **z > 0.0).for_each(|z| *z = change(*z));
    }
}

impl ViewContent for Pixels {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        Ok(self.picture.clone())
    }

    fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError> {
        Ok(self.valid.clone())
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        let mut depth = self.depth.clone();
        if let (Some(depth), Some(valid)) = (&mut depth, &self.valid) {
            let excluded = depth.iter_mut().zip(valid.iter());
            let excluded = excluded.filter(|(_, keep)| **keep == 0);
            excluded.for_each(|(z, _)| *z = 0.0);
        }
        Ok(depth)
    }

    fn stored_depth(&self) -> Result<Option<(PathBuf, DepthMap)>, DatasetError> {
        Ok(self.depth.clone().map(|depth| (PathBuf::new(), depth)))
    }

    fn processing(&self) -> Processing {
        Processing {
            masked: self.valid.is_some(),
            ..Processing::default()
        }
    }
}

pub(super) fn change(views: &mut [View], change: impl Fn(&mut Pixels)) {
    for view in views {
        let mut content = Pixels::of(view);
        change(&mut content);
        view.content = Arc::new(content);
    }
}

/// Nine views of the classic world.
pub(super) fn views(seed: u64, (width, height): (u32, u32)) -> Vec<View> {
    views_of(SyntheticOptions {
        seed,
        width,
        height,
        views: 9,
        samples: 1,
        ..SyntheticOptions::default()
    })
}

/// True if tests look at all their worlds, as in `.ci/full`. Otherwise they look at some, because each takes seconds.
fn all_worlds() -> bool {
    std::env::var_os("SHARP_BENCH_ALL_WORLDS").is_some()
}

/// Whether a test tries a case in a world: each case in one of the worlds 0 and 1, or in both.
pub(super) fn is_tried(case: usize, world: u64) -> bool {
    all_worlds() || case as u64 % 2 == world
}

/// Seeds of the worlds at which a test looks: all of them, or the first `few`.
pub(super) fn worlds(seeds: Range<u64>, few: usize) -> impl Iterator<Item = u64> {
    seeds.take(if all_worlds() { usize::MAX } else { few })
}

pub(super) fn views_of(options: SyntheticOptions) -> Vec<View> {
    let mut views = SyntheticScene::new(options).unwrap().views().to_vec();
    change(&mut views, |_| {});
    views
}

/// Contradictions that the check finds in the views of a scene.
pub(super) fn found(views: &[View], effort: Effort) -> Vec<String> {
    look(&scene(views.to_vec()), Units::default(), effort).contradictions
}

pub(super) fn scene(views: Vec<View>) -> Scene {
    Scene::new("d", "s", views, Pairing::MultiView)
}

#[test]
fn indices_are_evenly_spaced() {
    assert_eq!(evenly_spaced(10, 3), [0, 3, 6]);
    assert_eq!(evenly_spaced(2, 10), [0, 1]);
    assert!(evenly_spaced(0, 10).is_empty());
}

#[test]
fn a_sound_dataset_has_no_problems() {
    let spec = DatasetSpec::parse("synthetic=size=64x48,views=6").unwrap();
    let report = check(&spec, 10, &|_, _| {}).unwrap();
    assert_eq!(report.problems, 0, "{:?}", report.scenes[0].problems);
    let scene = &report.scenes[0];
    assert_eq!((scene.views, scene.decoded, scene.with_depth), (6, 6, 6));
    assert_eq!(scene.sizes, ["64x48"]);
    assert!(scene.depth_coverage.unwrap() > 0.5);
    assert!(scene.consistency.as_ref().unwrap().as_read.depth > 0.7);
}
