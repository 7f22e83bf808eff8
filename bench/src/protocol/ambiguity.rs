//! How far the paper's open choices move the pairs: each choice changed by itself, everything else left as it is.

use std::collections::{BTreeMap, BTreeSet};

use sharp_datasets::Scene;

use super::ProtocolError;
use super::options::PairOptions;
use super::overlap_cache::OverlapCache;
use super::pairs::{BuildContext, PairBuild, build_pairs};

/// What is changed, in the form of [`PairOptions`], by what it is about.
const ALTERNATIVES: [(&str, &[&str]); 10] = [
    (
        "threshold",
        &["threshold=0.5", "threshold=0.7", "at-threshold=in"],
    ),
    (
        "direction",
        &[
            "direction=source-in-target",
            "direction=min",
            "direction=mean",
            "direction=max",
        ],
    ),
    (
        "overlap test",
        &[
            "test=frustum",
            "test=consistent:0.01",
            "test=consistent:0.03",
            "test=consistent:0.1",
            "test=map-anything",
        ],
    ),
    ("depth lookup", &["lookup=bilinear", "overlap=sparse"]),
    (
        "denominator",
        &["denominator=all", "denominator=valid-other"],
    ),
    (
        "depth resolution",
        &["max-side=512", "max-side=256", "stride=4"],
    ),
    (
        "sets",
        &[
            "sets=strided",
            "sets=random:0",
            "size=5",
            "size=20",
            "remainder=drop",
        ],
    ),
    ("pair order", &["order=once"]),
    (
        "missing depth",
        &["missing-depth=accept", "missing-depth=leave-out"],
    ),
    (
        "sampling",
        &[
            "limit=all",
            "sampling=per-scene",
            "sampling=first",
            "seed=1",
        ],
    ),
];

/// Pairs of a dataset under some options.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Count {
    /// That qualify.
    pub qualified: usize,
    /// That are evaluated.
    pub selected: usize,
    /// Of these, evaluated under the base options too.
    pub shared: usize,
}

/// One choice, changed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Alternative {
    /// What the choice is about.
    pub about: &'static str,
    /// The change, `key=value`; empty for the base itself.
    pub change: &'static str,
    /// By dataset.
    pub counts: BTreeMap<String, Count>,
}

/// Counts pairs under the base options (the first answer) and under each alternative that differs from them and makes
/// sense with them. Overlaps are measured once for each way of measuring: with the context's cache, or in memory.
/// `advance(done, all)` is told after each.
///
/// # Errors
/// As [`build_pairs`].
pub fn alternatives(
    scenes: &[Scene],
    base: &PairOptions,
    context: &BuildContext,
    advance: &dyn Fn(usize, usize),
) -> Result<Vec<Alternative>, ProtocolError> {
    let memory = OverlapCache::in_memory();
    let context = BuildContext {
        depth: context.depth,
        roots: BTreeMap::new(),
        depth_memory_bytes: context.depth_memory_bytes,
        cache: context.cache.or(Some(&memory)),
        settings: context.settings.clone(),
        hash_photographs: false,
        progress: &|_, _| {},
    };
    let changed = ALTERNATIVES
        .iter()
        .flat_map(|(about, changes)| changes.iter().map(move |change| (*about, *change)));
    let options: Vec<(&str, &str, PairOptions)> = changed
        .filter_map(|(about, change)| Some((about, change, base.with(change).ok()?)))
        // Another source of depth needs other files.
        .filter(|(_, change, options)| {
            options != base && (!change.starts_with("overlap=") || base.depth.is_ground_truth())
        })
        .collect();
    let all = options.len() + 1;
    let of_base = build_pairs(scenes, base, &context)?;
    let selected: BTreeSet<&str> = selected_ids(&of_base).collect();
    advance(1, all);
    let mut rows = vec![Alternative {
        about: "base",
        change: "",
        counts: counts(&of_base, &selected),
    }];
    for (done, (about, change, options)) in options.into_iter().enumerate() {
        let build = build_pairs(scenes, &options, &context)?;
        rows.push(Alternative {
            about,
            change,
            counts: counts(&build, &selected),
        });
        advance(done + 2, all);
    }
    Ok(rows)
}

fn selected_ids(build: &PairBuild) -> impl Iterator<Item = &str> {
    let selected = build.pairs.iter().filter(|pair| pair.selected);
    selected.map(|pair| pair.pair_id.as_str())
}

fn counts(build: &PairBuild, base: &BTreeSet<&str>) -> BTreeMap<String, Count> {
    let mut counts: BTreeMap<String, Count> = build
        .summaries
        .iter()
        .map(|(dataset, summary)| {
            let count = Count {
                qualified: summary.qualified,
                selected: summary.selected,
                shared: 0,
            };
            (dataset.clone(), count)
        })
        .collect();
    for pair in build.pairs.iter().filter(|pair| pair.selected) {
        if base.contains(pair.pair_id.as_str())
            && let Some(count) = counts.get_mut(&pair.dataset)
        {
            count.shared += 1;
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::*;
    use crate::protocol::test_scene::{Depth, row, with_files};

    #[test]
    fn each_choice_moves_the_count_as_it_does_by_itself() {
        let views = row("d", "s", 0.3, &[Depth::Wall(2.0); 12]);
        let scenes = std::slice::from_ref(&views.scene);
        let base: PairOptions = "limit=20".parse().unwrap();
        let context = BuildContext::default();
        let rows = alternatives(scenes, &base, &context, &|_, _| {}).unwrap();
        assert_eq!(rows[0].change, "");
        for row in &rows {
            let text = format!("limit=20,{}", row.change);
            let options: PairOptions = match row.change {
                change if change.starts_with("limit=") => change.parse().unwrap(),
                _ => text.parse().unwrap(),
            };
            let direct = build_pairs(scenes, &options, &context).unwrap();
            let count = row.counts["d"];
            assert_eq!(count.qualified, direct.pairs.len(), "{}", row.change);
            let selected = direct.pairs.iter().filter(|p| p.selected).count();
            assert_eq!(count.selected, selected, "{}", row.change);
            assert!(count.shared <= count.selected);
        }
        let by = |change: &str| rows.iter().find(|r| r.change == change).unwrap().counts["d"];
        assert_eq!(by("").shared, 20);
        assert!(by("threshold=0.5").qualified > by("threshold=0.7").qualified);
        assert_eq!(by("order=once").qualified * 2, by("").qualified);
        assert_ne!(by("seed=1").shared, 20);
        assert_eq!(by("limit=all").shared, 20);
    }

    #[test]
    fn depth_is_read_once_for_each_way_of_measuring() {
        // Files that are there: a scene that cannot be hashed is never kept.
        let dir = tempfile::tempdir().unwrap();
        let views = row("d", "s", 0.3, &[Depth::Wall(2.0); 10]);
        for view in &views.scene.views {
            std::fs::write(dir.path().join(&view.id), "x").unwrap();
        }
        let views = with_files(views, dir.path());
        let scenes = std::slice::from_ref(&views.scene);
        let base = PairOptions::default();
        let rows = alternatives(scenes, &base, &BuildContext::default(), &|_, _| {}).unwrap();
        assert!(rows.len() > 25);
        // The base, five tests, two lookups, two denominators, a stride and two resolutions.
        assert_eq!(views.reads.load(Ordering::Relaxed), 13 * 10);
    }
}
