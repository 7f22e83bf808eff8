//! Measures overlaps within a set of views, with a bound on the depth maps in memory.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;
use sharp::camera::baseline_m;
use sharp_datasets::{Scene, View};

use super::BuildContext;
use crate::pairs::PairError;
use crate::pairs::depth::{PosedDepth, median_depth_m};
use crate::pairs::options::PairOptions;
use crate::pairs::overlap::{OverlapOptions, overlap};
use crate::pairs::overlap_cache::{DepthFacts, Overlaps, SceneOverlaps};
use crate::pairs::valid_depth::density;

/// Peak memory while reading a view's depth, as a multiple of the map's own size: twice for the unpacked file with
/// 64-bit numbers, and once for the resulting map. Later steps need only twice the size. Excludes a scan that all views
/// share and, for predicted depth, the prediction and its ratios to sparse depth.
const COPIES_WHILE_READING: u64 = 3;

/// Index of a view whose depth could not be read, and the error.
pub(super) type DepthFailure = (usize, PairError);

type HeldDepths = BTreeMap<usize, PosedDepth>;

/// Measures those overlaps of a scene that are not known yet.
pub(super) struct Measuring<'a> {
    scene: &'a Scene,
    options: &'a PairOptions,
    context: &'a BuildContext<'a>,
    how: OverlapOptions,
    learnt: Cell<bool>,
}

impl<'a> Measuring<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        options: &'a PairOptions,
        context: &'a BuildContext<'a>,
    ) -> Self {
        Self {
            scene,
            options,
            context,
            how: options.measuring(),
            learnt: Cell::new(false),
        }
    }

    /// Whether anything was measured.
    pub(super) fn has_learnt(&self) -> bool {
        self.learnt.get()
    }

    /// Measures the unknown overlaps of all pairs in a set of views whose baseline is in the requested range. If the
    /// set's depth does not fit into memory, it is loaded in blocks of views, two at a time; otherwise each view is
    /// read once.
    pub(super) fn measure(&self, set: &[usize], known: &mut SceneOverlaps) -> Vec<DepthFailure> {
        let mut failures = Vec::new();
        let block = self.views_in_memory(set) / 2;
        let blocks: Vec<&[usize]> = if set.len() <= 2 * block {
            vec![set]
        } else {
            set.chunks(block).collect()
        };
        for (k, first) in blocks.iter().enumerate() {
            let mut held = HeldDepths::new();
            for (n, second) in blocks.iter().enumerate().skip(k) {
                let couples = self.unknown_couples(first, second, known);
                let mut needed: BTreeSet<usize> =
                    couples.iter().flat_map(|&(a, b)| [a, b]).collect();
                if n == k {
                    needed.extend(first.iter().filter(|i| !known.depths.contains_key(*i)));
                }
                let (of_first, of_second) = needed.into_iter().partition(|i| first.contains(i));
                self.load(of_first, &mut held, known, &mut failures);
                let mut others = HeldDepths::new();
                self.load(of_second, &mut others, known, &mut failures);
                self.between(&couples, &held, &others, known);
            }
        }
        failures
    }

    /// Reads the depth of the views that are not yet known to have depth or to have none.
    pub(super) fn find_depth(
        &self,
        views: &[usize],
        known: &mut SceneOverlaps,
    ) -> Vec<DepthFailure> {
        let mut failures = Vec::new();
        for part in views.chunks(self.views_at_once(views)) {
            let unknown = part.iter().filter(|i| !known.depths.contains_key(*i));
            let unknown = unknown.copied().collect();
            self.load(unknown, &mut HeldDepths::new(), known, &mut failures);
        }
        failures
    }

    /// Pairs of views (a, b) with a < b, a in the first and b in the second block, whose overlap is unknown and whose
    /// baseline is in the requested range.
    fn unknown_couples(
        &self,
        first: &[usize],
        second: &[usize],
        known: &SceneOverlaps,
    ) -> Vec<(usize, usize)> {
        let pose = |i: usize| &self.scene.views[i].camera_from_world;
        let couples = first
            .iter()
            .flat_map(|&a| second.iter().map(move |&b| (a, b)));
        couples
            .filter(|&(a, b)| a < b && !known.knows(a, b))
            .filter(|&(a, b)| {
                self.options
                    .baseline_qualifies(baseline_m(pose(a), pose(b)))
            })
            .collect()
    }

    /// Number of reduced depth maps of the views in `set` that fit into the memory limit; at least two.
    fn views_in_memory(&self, set: &[usize]) -> usize {
        let bytes = |view: &View| {
            let longer = u64::from(view.intrinsics.width.max(view.intrinsics.height));
            let side = self.how.max_side.map_or(longer, u64::from);
            let reduction = (side as f64 / longer as f64).min(1.0);
            (full_bytes(view) as f64 * reduction * reduction) as u64
        };
        self.fitting(set, bytes).max(2)
    }

    /// Number of depth maps that may be read at the same time without exceeding the memory limit; at least one.
    fn views_at_once(&self, views: &[usize]) -> usize {
        self.fitting(views, |view| COPIES_WHILE_READING * full_bytes(view))
            .max(1)
    }

    fn fitting(&self, views: &[usize], bytes: impl Fn(&View) -> u64) -> usize {
        let views = views.iter().map(|&i| &self.scene.views[i]);
        let largest = views.map(bytes).max().unwrap_or(0).max(1);
        usize::try_from(self.context.depth_memory_bytes / largest).unwrap_or(usize::MAX)
    }

    /// Loads the depth of views into `held`, reduced as the options require; records facts about
    /// the depth, and errors.
    fn load(
        &self,
        mut views: Vec<usize>,
        held: &mut HeldDepths,
        known: &mut SceneOverlaps,
        failures: &mut Vec<DepthFailure>,
    ) {
        views.retain(|i| !held.contains_key(i) && !known.has_none(*i));
        // Copy what the closure needs: it runs on other threads, and the context's progress callback must stay on this
        // one.
        let (scene, source, max_side) = (self.scene, self.context.depth, self.how.max_side);
        let stop = self.context.stop;
        let load_one = |&i: &usize| -> Result<Option<(DepthFacts, PosedDepth)>, PairError> {
            if stop() {
                return Err(PairError::Stopped);
            }
            let view = &scene.views[i];
            let Some(depth) = source.depth(scene, view)? else {
                return Ok(None);
            };
            let Some(median_m) = median_depth_m(&depth) else {
                return Ok(None);
            };
            let density = density(&depth);
            let facts = DepthFacts { median_m, density };
            let mut posed = PosedDepth::of_view(view, depth)?;
            if let Some(side) = max_side {
                posed = posed.reduced(side);
            }
            Ok(Some((facts, posed)))
        };
        for part in views.chunks(self.views_at_once(&views)) {
            let loaded: Vec<_> = if source.in_parallel() {
                part.par_iter().map(load_one).collect()
            } else {
                part.iter().map(load_one).collect()
            };
            for (&i, result) in part.iter().zip(loaded) {
                self.learnt.set(true);
                match result {
                    Ok(Some((facts, posed))) => {
                        known.depths.insert(i, Some(facts));
                        held.insert(i, posed);
                    }
                    Ok(None) => {
                        known.depths.insert(i, None);
                    }
                    Err(error) => {
                        known.failed.insert(i);
                        failures.push((i, error));
                    }
                }
            }
        }
    }

    /// Measures the pairs of views whose depth is loaded.
    fn between(
        &self,
        couples: &[(usize, usize)],
        held: &HeldDepths,
        others: &HeldDepths,
        known: &mut SceneOverlaps,
    ) {
        let view = |i: usize| held.get(&i).or_else(|| others.get(&i));
        let couples: Vec<_> = couples
            .iter()
            .filter_map(|&(a, b)| Some(((a, b), view(a)?, view(b)?)))
            .collect();
        let (how, stop) = (&self.how, self.context.stop);
        let measured: Vec<_> = couples
            .par_iter()
            .filter(|_| !stop())
            .map(|&(couple, a, b)| {
                let share = |of, by| overlap(of, by, how).share(how.denominator);
                let overlaps = share(a, b).zip(share(b, a));
                let overlaps = overlaps.map(|(a_in_b, b_in_a)| Overlaps { a_in_b, b_in_a });
                (couple, overlaps)
            })
            .collect();
        for (couple, overlaps) in measured {
            self.learnt.set(true);
            known.insert(couple, overlaps);
        }
    }
}

fn full_bytes(view: &View) -> u64 {
    u64::from(view.intrinsics.width) * u64::from(view.intrinsics.height) * size_of::<f32>() as u64
}
