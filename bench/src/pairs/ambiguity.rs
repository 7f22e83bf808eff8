//! Sensitivity of the pairs to the open choices: counts pairs with one choice changed at a time. Open choices are those
//! of [`PairOptions`] and the alternative settings of the datasets' readers.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use sharp_datasets::{Pairing, Scene};

use super::PairError;
use super::build::{BuildContext, PairBuild, build_pairs};
use super::dataset::OpenDataset;
use super::options::PairOptions;
use super::overlap_cache::OverlapCache;

/// Heading of the sampling options, the only group of choices that also applies to stereo datasets.
const SAMPLING: &str = "sampling";

/// Heading of the alternative settings of dataset readers.
const READING: &str = "dataset reading";

/// The alternatives, grouped under headings. Each text contains the changes of one group, separated by spaces;
/// [`PairOptions`] parses each change.
const ALTERNATIVES: [(&str, &str); 10] = [
    ("threshold", "threshold=0.5 threshold=0.7 at-threshold=in"),
    (
        "direction",
        "direction=source-in-target direction=min direction=mean direction=max",
    ),
    (
        "overlap test",
        "test=frustum test=consistent:0.01 test=consistent:0.03 test=consistent:0.1 test=map-anything",
    ),
    ("depth lookup", "lookup=bilinear overlap=sparse"),
    ("denominator", "denominator=all denominator=valid-other"),
    ("depth resolution", "max-side=512 max-side=256 stride=4"),
    (
        "sets",
        "sets=strided sets=random:0 size=5 size=20 remainder=drop",
    ),
    ("pair order", "order=once"),
    (
        "missing depth",
        "missing-depth=accept missing-depth=leave-out",
    ),
    (
        SAMPLING,
        "limit=all sampling=per-scene sampling=first seed=1",
    ),
];

/// Numbers of a dataset's pairs under one set of options.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Count {
    pub qualified: usize,
    pub selected: usize,
    /// Number of pairs that are selected under these options and also under the base options.
    pub shared: usize,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Alternative {
    pub about: &'static str,
    /// The change, `key=value`; empty for the base options.
    pub change: String,
    #[serde(rename = "datasets")]
    pub counts: BTreeMap<String, Count>,
    /// Why pairs cannot be counted under this choice, keyed by dataset.
    pub unavailable: BTreeMap<String, String>,
}

/// A dataset read with one setting changed.
#[derive(Debug, Clone)]
pub struct OtherReading {
    pub dataset: String,
    /// The changed setting, `key=value`.
    pub change: String,
    /// All settings of the reader, as in [`BuildContext::settings`].
    pub settings: String,
    /// The scenes found, or why the dataset cannot be opened.
    pub scenes: Result<Vec<Scene>, String>,
}

/// Counts pairs under the base options (the first result), under each alternative option that applies, and under other
/// readings of the datasets. Stereo datasets are counted only under choices that apply to them. Overlaps are measured
/// once per set of measuring options, and kept in the context's cache or, without one, in memory. Calls `advance(done,
/// all)` after each count.
pub fn alternatives(
    scenes: &[Scene],
    base: &PairOptions,
    readings: &[OtherReading],
    context: &BuildContext,
    advance: &dyn Fn(usize, usize),
) -> Result<Vec<Alternative>, PairError> {
    let memory = OverlapCache::in_memory();
    let context = BuildContext {
        cache: context.cache.or(Some(&memory)),
        hash_photographs: false,
        progress: &|_, _| {},
        ..context.clone()
    };
    let multi_view: BTreeSet<&str> = scenes
        .iter()
        .filter(|scene| scene.pairing == Pairing::MultiView)
        .map(|scene| scene.dataset.as_str())
        .collect();
    let of_multi_view: Vec<Scene> = scenes
        .iter()
        .filter(|scene| multi_view.contains(scene.dataset.as_str()))
        .cloned()
        .collect();
    let changed = ALTERNATIVES
        .iter()
        .flat_map(|(about, changes)| changes.split(' ').map(move |change| (*about, change)));
    let options: Vec<(&str, &str, PairOptions)> = changed
        .filter(|(about, _)| *about == SAMPLING || !of_multi_view.is_empty())
        .filter_map(|(about, change)| Some((about, change, base.with(change).ok()?)))
        // Vary `overlap=` only if the base uses the dataset's own depth: other sources of depth need files that may not
        // exist.
        .filter(|(_, change, options)| {
            options != base && (!change.starts_with("overlap=") || base.depth.is_ground_truth())
        })
        .collect();
    let all = options.len() + readings.len() + 1;
    let of_base = build_pairs(scenes, base, &context)?;
    let selected: BTreeSet<&str> = selected_ids(&of_base).collect();
    advance(1, all);
    let mut rows = vec![Alternative {
        about: "base",
        change: String::new(),
        counts: counts(&of_base, &selected),
        unavailable: BTreeMap::new(),
    }];
    for (about, change, options) in options {
        let concerned = if about == SAMPLING {
            scenes
        } else {
            &of_multi_view
        };
        let build = build_pairs(concerned, &options, &context)?;
        rows.push(Alternative {
            about,
            change: change.to_owned(),
            counts: counts(&build, &selected),
            unavailable: BTreeMap::new(),
        });
        advance(rows.len(), all);
    }
    for reading in readings {
        let mut row = Alternative {
            about: READING,
            change: reading.change.clone(),
            counts: BTreeMap::new(),
            unavailable: BTreeMap::new(),
        };
        match counts_of_reading(reading, base, &context, &selected) {
            Ok(found) => row.counts = found,
            Err(reason) => {
                row.unavailable.insert(reading.dataset.clone(), reason);
            }
        }
        rows.push(row);
        advance(rows.len(), all);
    }
    Ok(rows)
}

fn counts_of_reading(
    reading: &OtherReading,
    base: &PairOptions,
    context: &BuildContext,
    selected: &BTreeSet<&str>,
) -> Result<BTreeMap<String, Count>, String> {
    let scenes = reading.scenes.as_ref().map_err(Clone::clone)?;
    let context = BuildContext {
        settings: BTreeMap::from([(reading.dataset.clone(), reading.settings.clone())]),
        ..context.clone()
    };
    let build = build_pairs(scenes, base, &context).map_err(|error| error.to_string())?;
    let mut counts = counts(&build, selected);
    // A dataset without scenes gets an entry with zero pairs.
    counts.entry(reading.dataset.clone()).or_default();
    Ok(counts)
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

/// Reader settings that are not varied, because they do not change how the paper is interpreted: permission to open
/// files outside the folder, and what to do if a picture's size differs from its camera's.
const NO_READINGS: [&str; 2] = ["outside", "camera-size"];

/// Reads each dataset under every alternative setting of its reader. If the dataset cannot be opened under a setting,
/// records the reason.
pub fn other_readings(
    datasets: &[OpenDataset],
    only_scenes: Option<&str>,
) -> Result<Vec<OtherReading>, PairError> {
    let mut readings = Vec::new();
    for dataset in datasets {
        let spec = &dataset.config.spec;
        let settings = spec.entry.settings.iter();
        let of_paper = settings.filter(|s| !NO_READINGS.contains(&s.key));
        for setting in of_paper {
            let others = setting.choices.iter().map(|choice| choice.value);
            for value in others.filter(|value| *value != spec.setting(setting.key)) {
                let mut config = dataset.config.clone();
                config.spec.settings.insert(setting.key, value.to_owned());
                let opened = OpenDataset::open_all(std::slice::from_ref(&config), only_scenes);
                let opened = opened.map(|mut opened| opened.pop());
                readings.push(OtherReading {
                    dataset: dataset.name.clone(),
                    change: format!("{}={value}", setting.key),
                    settings: format!("{} {:?}", spec.entry.format, config.spec.settings),
                    scenes: match opened {
                        Ok(opened) => Ok(opened.map_or_else(Vec::new, |found| found.scenes)),
                        Err(error) => Err(error.to_string()),
                    },
                });
            }
        }
    }
    Ok(readings)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::*;
    use crate::pairs::test_scene::{Depth, row, with_files};

    #[test]
    fn each_choice_moves_the_count_as_it_does_by_itself() {
        let views = row("d", "s", 0.3, &[Depth::Wall(2.0); 12]);
        let scenes = std::slice::from_ref(&views.scene);
        let base: PairOptions = "limit=20".parse().unwrap();
        let context = BuildContext::default();
        let rows = alternatives(scenes, &base, &[], &context, &|_, _| {}).unwrap();
        assert_eq!(rows[0].change, "");
        for row in &rows {
            let text = format!("limit=20,{}", row.change);
            let options: PairOptions = match row.change.as_str() {
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
    fn other_readings_are_counted_or_said_to_be_out_of_reach() {
        let views = row("d", "s", 0.3, &[Depth::Wall(2.0); 6]);
        let fewer = row("d", "s", 0.3, &[Depth::Wall(2.0); 4]);
        let reading = |change: &str, scenes| OtherReading {
            dataset: "d".to_owned(),
            change: change.to_owned(),
            settings: change.to_owned(),
            scenes,
        };
        let readings = [
            reading("frames=few", Ok(vec![fewer.scene])),
            reading("frames=none", Ok(Vec::new())),
            reading("split=other", Err("x/splits: not there".to_owned())),
        ];
        let scenes = std::slice::from_ref(&views.scene);
        let (base, context) = (PairOptions::default(), BuildContext::default());
        let rows = alternatives(scenes, &base, &readings, &context, &|_, _| {}).unwrap();
        let by = |change: &str| rows.iter().find(|r| r.change == change).unwrap();
        let few = by("frames=few").counts["d"];
        assert!(few.selected > 0 && few.selected < by("").counts["d"].selected);
        assert_eq!(few.shared, few.selected);
        assert_eq!(by("frames=none").counts["d"], Count::default());
        assert!(by("split=other").counts.is_empty());
        assert_eq!(by("split=other").unavailable["d"], "x/splits: not there");
    }

    #[test]
    fn stereo_datasets_have_no_sets_and_no_threshold() {
        let mut views = row("d", "s", 0.3, &[Depth::Wall(2.0); 2]);
        views.scene.pairing = Pairing::Stereo {
            source: 0,
            target: 1,
        };
        let scenes = std::slice::from_ref(&views.scene);
        let (base, context) = (PairOptions::default(), BuildContext::default());
        let rows = alternatives(scenes, &base, &[], &context, &|_, _| {}).unwrap();
        let about: BTreeSet<&str> = rows.iter().map(|row| row.about).collect();
        assert_eq!(about, BTreeSet::from(["base", SAMPLING]));
        assert!(rows.iter().all(|row| row.counts["d"].selected == 1));
    }

    #[test]
    fn depth_is_read_once_for_each_way_of_measuring() {
        // Use files that exist, because a scene that cannot be hashed is not cached.
        let dir = tempfile::tempdir().unwrap();
        let views = row("d", "s", 0.3, &[Depth::Wall(2.0); 10]);
        for view in &views.scene.views {
            std::fs::write(dir.path().join(&view.id), "x").unwrap();
        }
        let views = with_files(views, dir.path());
        let scenes = std::slice::from_ref(&views.scene);
        let base = PairOptions::default();
        let rows = alternatives(scenes, &base, &[], &BuildContext::default(), &|_, _| {}).unwrap();
        assert!(rows.len() > 25);
        // The base, five tests, two lookups, two denominators, one stride and two resolutions.
        assert_eq!(views.reads.load(Ordering::Relaxed), 13 * 10);
    }
}
