//! Scenes into pairs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use sharp::camera::baseline_m;
use sharp_datasets::{Pairing, Scene, View};

use super::ProtocolError;
use super::depth::{DepthSource, GroundTruthDepth, PosedDepth, median_depth_m};
use super::options::{MissingDepth, PairOptions, PairOrder};
use super::overlap::overlap;
use super::pair_id::PairName;
use super::sampling::sample;
use super::sets::view_sets;

/// An ordered pair of views: the target is to be predicted from the source. One row of a pair list.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    /// `dataset/scene/source__target`; see [`super::pair_id`].
    pub pair_id: String,
    /// Name of the dataset instance.
    pub dataset: String,
    /// Id of the scene.
    pub scene: String,
    /// Number of the set within the scene, from 0; `None` for a stereo scene.
    pub set: Option<u32>,
    /// Id of the source view.
    pub source: String,
    /// Id of the target view.
    pub target: String,
    /// The source's photograph, relative to the dataset's folder, `/` between levels; empty for a
    /// procedural view.
    pub source_file: String,
    /// The target's photograph, likewise.
    pub target_file: String,
    /// sha256 of the source's photograph; empty if it could not be read.
    pub source_sha256: String,
    /// sha256 of the target's photograph; empty if it could not be read.
    pub target_sha256: String,
    /// Distance of the two camera centres, metres.
    pub baseline_m: f64,
    /// Angle between the two cameras, degrees.
    pub rotation_deg: f64,
    /// Median depth of the target, metres; `None` without depth.
    pub median_depth_m: Option<f64>,
    /// Share of the target's pixels that the source sees; `None` without depth.
    pub overlap: Option<f64>,
    /// Share of the source's pixels that the target sees; `None` without depth.
    pub overlap_source_to_target: Option<f64>,
    /// Whether the sampling chose it for evaluation.
    pub selected: bool,
}

/// What pair building needs besides scenes and options; nothing in it changes a pair, except for the
/// depth that overlap is measured on.
pub struct BuildContext<'a> {
    /// Depth for overlap and for the median depth.
    pub depth: &'a dyn DepthSource,
    /// Folder of each dataset instance by name, to which file names become relative.
    pub roots: BTreeMap<String, PathBuf>,
    /// Depth maps held at once take no more memory than this, as long as two of them fit.
    pub depth_memory_bytes: u64,
    /// Told after each scene: scenes done, scenes in all.
    pub progress: &'a dyn Fn(usize, usize),
}

impl Default for BuildContext<'_> {
    /// Ground-truth depth in at most 2 GiB, file names as they are, no progress.
    fn default() -> Self {
        Self {
            depth: &GroundTruthDepth,
            roots: BTreeMap::new(),
            depth_memory_bytes: 2 << 30,
            progress: &|_, _| {},
        }
    }
}

/// The pairs of some scenes, and what became of those that are not among them.
#[derive(Debug, Clone, Default)]
pub struct PairBuild {
    /// Qualified pairs, sorted bytewise by id.
    pub pairs: Vec<Pair>,
    /// Counts for each dataset, in order of their names.
    pub summaries: BTreeMap<String, PairCounts>,
    /// Files that could not be read. Stereo pairs stay; a multi-view view is treated as one without
    /// depth.
    pub problems: Vec<Problem>,
}

/// How the pairs of a dataset came to be so many.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PairCounts {
    /// Scenes given.
    pub scenes: usize,
    /// Views given.
    pub views: usize,
    /// Sets formed, a stereo scene counting as one.
    pub sets: usize,
    /// Ordered pairs within the sets.
    pub considered: usize,
    /// Of these, nearer to each other than the minimal baseline.
    pub too_near: usize,
    /// Of these, without depth in one of the views.
    pub without_depth: usize,
    /// Of these, with too little overlap.
    pub too_little_overlap: usize,
    /// Of these, qualified.
    pub qualified: usize,
    /// Of the qualified, selected for evaluation.
    pub selected: usize,
}

/// A view whose files could not be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Name of the dataset instance.
    pub dataset: String,
    /// Id of the scene.
    pub scene: String,
    /// Id of the view.
    pub view: String,
    /// Names the file and the reason.
    pub reason: String,
}

/// Makes the pairs of all scenes.
///
/// A file that cannot be read is a [`Problem`], not an error: the rest of the scenes go on.
///
/// # Errors
/// [`ProtocolError::Options`]; [`ProtocolError::DuplicatePair`] if two scenes share dataset and id, or
/// two views of a scene their id.
pub fn build_pairs(
    scenes: &[Scene],
    options: &PairOptions,
    context: &BuildContext,
) -> Result<PairBuild, ProtocolError> {
    options.validate()?;
    let mut build = PairBuild::default();
    for (done, scene) in scenes.iter().enumerate() {
        let mut work = SceneWork {
            scene,
            options,
            context,
            build: &mut build,
        };
        match scene.pairing {
            Pairing::Stereo { source, target } => work.stereo(source, target),
            Pairing::MultiView => work.multi_view(),
        }
        (context.progress)(done + 1, scenes.len());
    }
    build.pairs.sort_by(|a, b| a.pair_id.cmp(&b.pair_id));
    if let Some(twice) = build
        .pairs
        .windows(2)
        .find(|p| p[0].pair_id == p[1].pair_id)
    {
        return Err(ProtocolError::DuplicatePair(twice[0].pair_id.clone()));
    }
    select(&mut build, options);
    Ok(build)
}

fn select(build: &mut PairBuild, options: &PairOptions) {
    for (dataset, counts) in &mut build.summaries {
        let members: Vec<usize> = (0..build.pairs.len())
            .filter(|&i| build.pairs[i].dataset == *dataset)
            .collect();
        let scenes: Vec<&str> = members
            .iter()
            .map(|&i| build.pairs[i].scene.as_str())
            .collect();
        let selected = sample(&scenes, &options.sampling);
        for (&i, &selected) in members.iter().zip(&selected) {
            build.pairs[i].selected = selected;
        }
        counts.qualified = members.len();
        counts.selected = selected.iter().filter(|s| **s).count();
    }
}

/// The two overlaps of two views: how much of `a` is seen by `b`, and of `b` by `a`.
#[derive(Debug, Clone, Copy)]
struct Overlaps {
    a_in_b: f64,
    b_in_a: f64,
}

/// What depth told about a set of views, by index into the scene.
#[derive(Default)]
struct Measured {
    median_m: BTreeMap<usize, f64>,
    overlaps: BTreeMap<(usize, usize), Overlaps>,
}

struct SceneWork<'a> {
    scene: &'a Scene,
    options: &'a PairOptions,
    context: &'a BuildContext<'a>,
    build: &'a mut PairBuild,
}

impl SceneWork<'_> {
    fn counts(&mut self) -> &mut PairCounts {
        self.build
            .summaries
            .entry(self.scene.dataset.clone())
            .or_default()
    }

    fn stereo(&mut self, source: usize, target: usize) {
        let views = self.scene.views.len();
        let counts = self.counts();
        counts.scenes += 1;
        counts.views += views;
        counts.sets += 1;
        counts.considered += 1;
        if self.baseline(source, target) < self.options.min_baseline_m {
            self.counts().too_near += 1;
            return;
        }
        let (a, b) = (source.min(target), source.max(target));
        let measured = self.measure(&[a, b]);
        self.add(&[(source, target, None)], &measured);
    }

    fn multi_view(&mut self) {
        let scene = self.scene;
        let views = self.views_in_sets();
        let sets = view_sets(views.len(), &self.options.sets);
        let counts = self.counts();
        counts.scenes += 1;
        counts.views += scene.views.len();
        counts.sets += sets.len();
        for (number, set) in sets.iter().enumerate() {
            let set: Vec<usize> = set.iter().map(|&i| views[i]).collect();
            let measured = self.measure(&set);
            let mut qualified = Vec::new();
            for &source in &set {
                for &target in &set {
                    let ordered = match self.options.order {
                        PairOrder::Both => source != target,
                        PairOrder::Once => source < target,
                    };
                    if ordered && self.qualifies(source, target, &measured) {
                        qualified.push((source, target, u32::try_from(number).ok()));
                    }
                }
            }
            self.add(&qualified, &measured);
        }
    }

    /// Views that take part in forming sets.
    fn views_in_sets(&mut self) -> Vec<usize> {
        let all: Vec<usize> = (0..self.scene.views.len()).collect();
        if self.options.missing_depth != MissingDepth::LeaveOut {
            return all;
        }
        let has_depth: Vec<_> = all
            .par_iter()
            .map(|&i| {
                let depth = self.context.depth.depth(&self.scene.views[i])?;
                Ok(depth.is_some_and(|d| median_depth_m(&d).is_some()))
            })
            .collect();
        let mut kept = Vec::new();
        for (i, found) in has_depth.into_iter().enumerate() {
            match found {
                Ok(true) => kept.push(i),
                Ok(false) => {}
                Err(error) => self.problem(i, &error),
            }
        }
        kept
    }

    fn qualifies(&mut self, source: usize, target: usize, measured: &Measured) -> bool {
        self.counts().considered += 1;
        if self.baseline(source, target) < self.options.min_baseline_m {
            self.counts().too_near += 1;
            return false;
        }
        let Some((overlap, source_to_target)) = ordered_overlap(measured, source, target) else {
            self.counts().without_depth += 1;
            return self.options.missing_depth == MissingDepth::Accept;
        };
        let enough = self.options.overlap_qualifies(overlap, source_to_target);
        if !enough {
            self.counts().too_little_overlap += 1;
        }
        enough
    }

    fn baseline(&self, a: usize, b: usize) -> f64 {
        let pose = |i: usize| &self.scene.views[i].camera_from_world;
        baseline_m(pose(a), pose(b))
    }

    /// Loads the depth of a set, in blocks of which two fit into memory, and measures every two views
    /// that are far enough apart.
    fn measure(&mut self, set: &[usize]) -> Measured {
        let mut measured = Measured::default();
        let block = self.views_in_memory(set) / 2;
        let blocks: Vec<&[usize]> = if set.len() <= 2 * block {
            vec![set]
        } else {
            set.chunks(block).collect()
        };
        for (k, first) in blocks.iter().enumerate() {
            let first = self.load(first, &mut measured);
            self.measure_between(&first, &first, &mut measured);
            for second in &blocks[k + 1..] {
                let second = self.load(second, &mut measured);
                self.measure_between(&first, &second, &mut measured);
            }
        }
        measured
    }

    /// How many depth maps of a set may be held at once; at least two.
    fn views_in_memory(&self, set: &[usize]) -> usize {
        let bytes = |i: &usize| {
            let k = &self.scene.views[*i].intrinsics;
            let longer = u64::from(k.width.max(k.height));
            let side = self.options.overlap.max_side.map_or(longer, u64::from);
            let reduction = (side as f64 / longer as f64).min(1.0);
            let pixels = u64::from(k.width) * u64::from(k.height);
            (pixels as f64 * reduction * reduction) as u64 * size_of::<f32>() as u64
        };
        let largest = set.iter().map(bytes).max().unwrap_or(0).max(1);
        usize::try_from(self.context.depth_memory_bytes / largest)
            .unwrap_or(usize::MAX)
            .max(2)
    }

    /// Depth of the views that have any, reduced as the options say; records medians and problems.
    fn load(&mut self, views: &[usize], measured: &mut Measured) -> Vec<(usize, PosedDepth)> {
        let load_one = |&i: &usize| -> Result<Option<(f64, PosedDepth)>, ProtocolError> {
            let view = &self.scene.views[i];
            let Some(depth) = self.context.depth.depth(view)? else {
                return Ok(None);
            };
            let Some(median) = median_depth_m(&depth) else {
                return Ok(None);
            };
            let mut posed = PosedDepth::of_view(view, depth)?;
            if let Some(side) = self.options.overlap.max_side {
                posed = posed.reduced(side);
            }
            Ok(Some((median, posed)))
        };
        let loaded: Vec<_> = views.par_iter().map(load_one).collect();
        let mut found = Vec::with_capacity(views.len());
        for (&i, result) in views.iter().zip(loaded) {
            match result {
                Ok(Some((median, posed))) => {
                    measured.median_m.insert(i, median);
                    found.push((i, posed));
                }
                Ok(None) => {}
                Err(error) => self.problem(i, &error),
            }
        }
        found
    }

    /// Measures each of `first` with each later one of `second`.
    fn measure_between(
        &self,
        first: &[(usize, PosedDepth)],
        second: &[(usize, PosedDepth)],
        measured: &mut Measured,
    ) {
        let mut couples = Vec::new();
        for (a, posed_a) in first {
            for (b, posed_b) in second {
                if a < b && self.baseline(*a, *b) >= self.options.min_baseline_m {
                    couples.push(((*a, *b), posed_a, posed_b));
                }
            }
        }
        let how = &self.options.overlap;
        let shares: Vec<_> = couples
            .par_iter()
            .map(|(key, a, b)| {
                let a_in_b = overlap(a, b, how).share(how.denominator)?;
                let b_in_a = overlap(b, a, how).share(how.denominator)?;
                Some((*key, Overlaps { a_in_b, b_in_a }))
            })
            .collect();
        measured.overlaps.extend(shares.into_iter().flatten());
    }

    /// Turns qualified `(source, target, set)` into rows.
    fn add(&mut self, qualified: &[(usize, usize, Option<u32>)], measured: &Measured) {
        let used: BTreeSet<usize> = qualified.iter().flat_map(|&(s, t, _)| [s, t]).collect();
        let hashes: Vec<_> = used
            .par_iter()
            .map(|&i| (i, self.scene.views[i].content.image_sha256()))
            .collect();
        let mut sha256 = BTreeMap::new();
        for (i, hash) in hashes {
            match hash {
                Ok(hash) => {
                    sha256.insert(i, hash);
                }
                Err(error) => self.problem(i, &error.into()),
            }
        }
        let root = self.context.roots.get(&self.scene.dataset);
        for &(source, target, set) in qualified {
            let (s, t) = (&self.scene.views[source], &self.scene.views[target]);
            let name = PairName {
                dataset: self.scene.dataset.clone(),
                scene: self.scene.id.clone(),
                source: s.id.clone(),
                target: t.id.clone(),
            };
            let overlaps = ordered_overlap(measured, source, target);
            let hash = |i| sha256.get(&i).cloned().unwrap_or_default();
            let pair = Pair {
                pair_id: name.encode(),
                dataset: name.dataset,
                scene: name.scene,
                set,
                source: name.source,
                target: name.target,
                source_file: relative_file(s, root),
                target_file: relative_file(t, root),
                source_sha256: hash(source),
                target_sha256: hash(target),
                baseline_m: self.baseline(source, target),
                rotation_deg: t
                    .camera_from_world
                    .after(&s.camera_from_world.inverse())
                    .rotation_deg(),
                median_depth_m: measured.median_m.get(&target).copied(),
                overlap: overlaps.map(|(overlap, _)| overlap),
                overlap_source_to_target: overlaps.map(|(_, reverse)| reverse),
                selected: false,
            };
            self.build.pairs.push(pair);
        }
    }

    fn problem(&mut self, view: usize, error: &ProtocolError) {
        let problem = Problem {
            dataset: self.scene.dataset.clone(),
            scene: self.scene.id.clone(),
            view: self.scene.views[view].id.clone(),
            reason: error.to_string(),
        };
        if !self.build.problems.contains(&problem) {
            self.build.problems.push(problem);
        }
    }
}

/// (target in source, source in target).
fn ordered_overlap(measured: &Measured, source: usize, target: usize) -> Option<(f64, f64)> {
    let key = (source.min(target), source.max(target));
    let found = measured.overlaps.get(&key)?;
    Some(if target < source {
        (found.a_in_b, found.b_in_a)
    } else {
        (found.b_in_a, found.a_in_b)
    })
}

/// The photograph's file relative to the dataset's folder, with `/` between levels.
fn relative_file(view: &View, root: Option<&PathBuf>) -> String {
    let Some(file) = view.content.image_file() else {
        return String::new();
    };
    let inside = root.and_then(|root| file.strip_prefix(root).ok());
    let parts: Vec<_> = inside
        .unwrap_or(file)
        .components()
        .map(|part| Path::new(part.as_os_str()).to_string_lossy())
        .collect();
    parts.join("/").replacen("//", "/", 1)
}

#[cfg(test)]
mod tests;
