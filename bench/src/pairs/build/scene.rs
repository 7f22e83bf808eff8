//! Builds the pairs of one scene.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rayon::prelude::*;
use sharp::camera::baseline_m;
use sharp_datasets::{Pairing, Scene, View};

use super::measure::{DepthFailure, Measuring};
use super::{BuildContext, PairBuild, PairCounts, Problem, SPARSE_DENSITY};
use crate::pairs::options::{MissingDepth, PairOptions, PairOrder};
use crate::pairs::overlap_cache::SceneOverlaps;
use crate::pairs::pair_id::PairName;
use crate::pairs::sets::view_sets;
use crate::pairs::{Pair, PairError};

/// Builds the pairs of one scene and adds them, with their counts and problems, to a [`PairBuild`].
pub(super) struct SceneWork<'a> {
    scene: &'a Scene,
    options: &'a PairOptions,
    context: &'a BuildContext<'a>,
    build: &'a mut PairBuild,
    known: SceneOverlaps,
    key: Option<String>,
    /// Whether something was measured since the cache was last written.
    is_dirty: bool,
    /// When the cache was last written.
    last_saved: Instant,
    /// Reported problems, by view index and text, so that each is reported once.
    noted: BTreeSet<(usize, String)>,
}

/// Interval between cache writes; a killed process loses at most this much work.
const KEEP_EVERY: Duration = Duration::from_secs(5);

impl<'a> SceneWork<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        options: &'a PairOptions,
        context: &'a BuildContext<'a>,
        build: &'a mut PairBuild,
    ) -> Self {
        let settings = context.settings.get(&scene.dataset);
        let settings = settings.map_or("", String::as_str);
        let key = context
            .cache
            .and_then(|cache| cache.key(scene, settings, context.depth, &options.measuring()));
        let known = match (context.cache, &key) {
            (Some(cache), Some(key)) => cache.load(key, scene.views.len()),
            _ => SceneOverlaps::default(),
        };
        Self {
            scene,
            options,
            context,
            build,
            known,
            key,
            is_dirty: false,
            last_saved: Instant::now(),
            noted: BTreeSet::new(),
        }
    }

    /// Runs `work`, which measures missing depth facts and overlaps, and reports depth that it could not read.
    fn measuring(&mut self, work: impl Fn(&Measuring, &mut SceneOverlaps) -> Vec<DepthFailure>) {
        let measuring = Measuring::new(self.scene, self.options, self.context);
        let needed = self.scene.pairing == Pairing::MultiView
            && self.options.missing_depth != MissingDepth::Accept;
        for (view, error) in work(&measuring, &mut self.known) {
            self.problem(view, &error, needed);
        }
        self.is_dirty |= measuring.has_learnt();
        // Limit the rate: the table is written as a whole, so writing it after every set would take quadratic time in a
        // long scene.
        if self.last_saved.elapsed() > KEEP_EVERY {
            self.keep();
        }
    }

    /// Writes new measurements to the cache.
    pub(super) fn keep(&mut self) {
        if let (Some(cache), Some(key), true) = (self.context.cache, &self.key, self.is_dirty) {
            cache.store(key, &self.known);
        }
        self.is_dirty = false;
        self.last_saved = Instant::now();
    }

    fn counts(&mut self) -> &mut PairCounts {
        self.build
            .summaries
            .entry(self.scene.dataset.clone())
            .or_default()
    }

    /// Builds the pairs from one view to each of the `targets`, regardless of overlap.
    pub(super) fn one_to_others(&mut self, source: usize, targets: &[usize]) {
        let views = self.scene.views.len();
        let counts = self.counts();
        counts.scenes += 1;
        counts.views += views;
        counts.sets += 1;
        counts.considered += targets.len();
        for &target in targets {
            if (self.context.stop)() {
                return;
            }
            if self.is_in_range(source, target) {
                let (a, b) = (source.min(target), source.max(target));
                self.measuring(|work, known| work.measure(&[a, b], known));
                self.add(&[(source, target, None)]);
            }
        }
    }

    /// Builds the pairs of a multi-view scene. Both views of a pair are in one set.
    pub(super) fn multi_view(&mut self) {
        let scene = self.scene;
        let views = self.views_in_sets();
        let sets = view_sets(views.len(), &self.options.sets);
        let counts = self.counts();
        counts.scenes += 1;
        counts.views += scene.views.len();
        counts.sets += sets.len();
        for (number, set) in sets.iter().enumerate() {
            if (self.context.stop)() {
                return;
            }
            let set: Vec<usize> = set.iter().map(|&i| views[i]).collect();
            self.measuring(|work, known| work.measure(&set, known));
            let mut qualified = Vec::new();
            for &source in &set {
                for &target in &set {
                    let ordered = match self.options.order {
                        PairOrder::Both => source != target,
                        PairOrder::Once => source < target,
                    };
                    if ordered && self.qualifies(source, target) {
                        qualified.push((source, target, u32::try_from(number).ok()));
                    }
                }
            }
            self.add(&qualified);
        }
        self.count_depth();
    }

    /// Counts the views with depth and with sparse depth.
    fn count_depth(&mut self) {
        let known: Vec<f64> = (0..self.scene.views.len())
            .filter_map(|i| Some(self.known.depths.get(&i)?.as_ref()?.density))
            .collect();
        let counts = self.counts();
        counts.with_depth += known.len();
        counts.with_sparse_depth += known.iter().filter(|c| **c < SPARSE_DENSITY).count();
    }

    /// Indices of the views that sets are formed from.
    fn views_in_sets(&mut self) -> Vec<usize> {
        let all: Vec<usize> = (0..self.scene.views.len()).collect();
        if self.options.missing_depth != MissingDepth::LeaveOut {
            return all;
        }
        self.measuring(|work, known| work.find_depth(&all, known));
        let kept = all.into_iter();
        kept.filter(|i| matches!(self.known.depths.get(i), Some(Some(_))))
            .collect()
    }

    fn qualifies(&mut self, source: usize, target: usize) -> bool {
        self.counts().considered += 1;
        if !self.is_in_range(source, target) {
            return false;
        }
        let Some((overlap, source_to_target)) = self.known.overlaps(source, target) else {
            self.counts().without_depth += 1;
            let is_broken = [source, target]
                .iter()
                .any(|i| self.known.failed.contains(i));
            let accepted = self.options.missing_depth == MissingDepth::Accept;
            self.counts().unreadable += usize::from(is_broken && !accepted);
            return accepted;
        };
        let enough = self.options.overlap_qualifies(overlap, source_to_target);
        if !enough {
            self.counts().too_little_overlap += 1;
        }
        enough
    }

    /// Whether the distance between two views is in the requested range. If not, counts the pair as too near or too
    /// far.
    fn is_in_range(&mut self, source: usize, target: usize) -> bool {
        let metres = self.baseline(source, target);
        let options = self.options;
        if metres < options.min_baseline_m {
            self.counts().too_near += 1;
        } else if !options.baseline_qualifies(metres) {
            self.counts().too_far += 1;
        }
        options.baseline_qualifies(metres)
    }

    fn baseline(&self, a: usize, b: usize) -> f64 {
        let pose = |i: usize| &self.scene.views[i].camera_from_world;
        baseline_m(pose(a), pose(b))
    }

    /// Adds rows for the qualified pairs, given as `(source, target, set)`, except those with an unreadable photograph.
    fn add(&mut self, qualified: &[(usize, usize, Option<u32>)]) {
        let mut used: BTreeSet<usize> = qualified.iter().flat_map(|&(s, t, _)| [s, t]).collect();
        used.retain(|_| self.context.hash_photographs);
        let (scene, stop) = (self.scene, self.context.stop);
        let hashes: Vec<_> = used
            .par_iter()
            .filter(|_| !stop())
            .map(|&i| (i, scene.views[i].content.image_sha256()))
            .collect();
        let mut sha256 = BTreeMap::new();
        let mut broken = BTreeSet::new();
        for (i, hash) in hashes {
            match hash {
                Ok(hash) => {
                    sha256.insert(i, hash);
                }
                Err(error) => {
                    self.problem(i, &error.into(), true);
                    broken.insert(i);
                }
            }
        }
        let root = self
            .context
            .roots
            .get(&self.scene.dataset)
            .map(PathBuf::as_path);
        for &(source, target, set) in qualified {
            if broken.contains(&source) || broken.contains(&target) {
                self.counts().unreadable += 1;
                continue;
            }
            let overlaps = self.known.overlaps(source, target);
            let depth_of = |i| self.known.depths.get(&i).copied().flatten();
            let depth = match self.scene.pairing {
                Pairing::Stereo { .. } => depth_of(target).or_else(|| depth_of(source)),
                Pairing::Star { .. } | Pairing::MultiView => depth_of(target),
            };
            let hash = |i| sha256.get(&i).cloned().unwrap_or_default();
            let pair = Pair {
                set,
                source_sha256: hash(source),
                target_sha256: hash(target),
                median_depth_m: depth.map(|depth| depth.median_m),
                overlap: overlaps.map(|(overlap, _)| overlap),
                overlap_source_to_target: overlaps.map(|(_, reverse)| reverse),
                ..row(self.scene, source, target, root)
            };
            self.build.pairs.push(pair);
        }
    }

    fn problem(&mut self, view: usize, error: &PairError, is_left_out: bool) {
        let problem = Problem {
            dataset: self.scene.dataset.clone(),
            scene: self.scene.id.clone(),
            view: self.scene.views[view].id.clone(),
            reason: error.to_string(),
            is_left_out,
        };
        if self.noted.insert((view, problem.reason.clone())) {
            self.build.problems.push(problem);
        }
    }
}

/// An unselected row of the pair list for two views of a scene. Measures no overlap and reads no photograph.
pub(in crate::pairs) fn row(
    scene: &Scene,
    source: usize,
    target: usize,
    root: Option<&Path>,
) -> Pair {
    let (s, t) = (&scene.views[source], &scene.views[target]);
    let (from, to) = (&s.camera_from_world, &t.camera_from_world);
    let name = PairName {
        dataset: scene.dataset.clone(),
        scene: scene.id.clone(),
        source: s.id.clone(),
        target: t.id.clone(),
    };
    Pair {
        pair_id: name.encode(),
        dataset: name.dataset,
        scene: name.scene,
        set: None,
        source: name.source,
        target: name.target,
        source_file: relative_file(s, root),
        target_file: relative_file(t, root),
        source_sha256: String::new(),
        target_sha256: String::new(),
        baseline_m: baseline_m(from, to),
        rotation_deg: to.after(&from.inverse()).rotation_deg(),
        median_depth_m: None,
        overlap: None,
        overlap_source_to_target: None,
        selected: false,
    }
}

/// File of the photograph relative to the dataset's folder, with `/` as separator.
fn relative_file(view: &View, root: Option<&Path>) -> String {
    let Some(file) = view.content.image_file() else {
        return String::new();
    };
    let inside = root.and_then(|root| file.strip_prefix(root).ok());
    let parts: Vec<_> = inside
        .unwrap_or(file)
        .components()
        .map(|part| part.as_os_str().to_string_lossy())
        .collect();
    parts.join("/").replacen("//", "/", 1)
}
