//! Overlaps within a set of views, holding no more depth maps than memory allows.

use std::collections::BTreeMap;

use rayon::prelude::*;
use sharp::camera::baseline_m;
use sharp_datasets::Scene;

use super::BuildContext;
use crate::protocol::ProtocolError;
use crate::protocol::depth::{PosedDepth, median_depth_m};
use crate::protocol::options::PairOptions;
use crate::protocol::overlap::overlap;

/// What depth told about a set of views, all by index into the scene.
#[derive(Default)]
pub(super) struct Measured {
    /// Median depth of the views that have depth, metres.
    pub(super) median_m: BTreeMap<usize, f64>,
    /// Views whose depth could not be read.
    pub(super) errors: Vec<(usize, ProtocolError)>,
    overlaps: BTreeMap<(usize, usize), Overlaps>,
}

/// The two overlaps of views a < b.
#[derive(Debug, Clone, Copy)]
struct Overlaps {
    a_in_b: f64,
    b_in_a: f64,
}

impl Measured {
    /// The share of the target that the source sees, and of the source that the target sees.
    pub(super) fn overlaps(&self, source: usize, target: usize) -> Option<(f64, f64)> {
        let key = (source.min(target), source.max(target));
        let found = self.overlaps.get(&key)?;
        Some(if target < source {
            (found.a_in_b, found.b_in_a)
        } else {
            (found.b_in_a, found.a_in_b)
        })
    }
}

/// Measures every two views of a set that are at least the minimal baseline apart. Depth is loaded in
/// blocks of which two fit into memory; usually that is one block.
pub(super) fn measure(
    scene: &Scene,
    set: &[usize],
    options: &PairOptions,
    context: &BuildContext,
) -> Measured {
    let work = Measuring {
        scene,
        options,
        context,
    };
    let mut measured = Measured::default();
    let block = work.views_in_memory(set) / 2;
    let blocks: Vec<&[usize]> = if set.len() <= 2 * block {
        vec![set]
    } else {
        set.chunks(block).collect()
    };
    for (k, first) in blocks.iter().enumerate() {
        let first = work.load(first, &mut measured);
        work.between(&first, &first, &mut measured);
        for second in &blocks[k + 1..] {
            let second = work.load(second, &mut measured);
            work.between(&first, &second, &mut measured);
        }
    }
    measured
}

struct Measuring<'a> {
    scene: &'a Scene,
    options: &'a PairOptions,
    context: &'a BuildContext<'a>,
}

impl Measuring<'_> {
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

    /// Depth of the views that have any, reduced as the options say; records medians and errors.
    fn load(&self, views: &[usize], measured: &mut Measured) -> Vec<(usize, PosedDepth)> {
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
                Err(error) => measured.errors.push((i, error)),
            }
        }
        found
    }

    /// Measures each of `first` with each later one of `second`.
    fn between(
        &self,
        first: &[(usize, PosedDepth)],
        second: &[(usize, PosedDepth)],
        measured: &mut Measured,
    ) {
        let mut couples = Vec::new();
        for (a, posed_a) in first {
            for (b, posed_b) in second {
                let apart = baseline_m(posed_a.camera_from_world(), posed_b.camera_from_world());
                if a < b && apart >= self.options.min_baseline_m {
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
}
