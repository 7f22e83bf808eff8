//! Warnings about a method, derived from single records and from all of them together.

use std::collections::{BTreeMap, BTreeSet};

use super::gaussians::source_check::{SOURCE_BLUR, SOURCE_PSNR};
use super::picture_check::agreement::{changed_pictures, repeated_pictures};
use super::picture_check::camera::misplaced_pictures;
use super::picture_check::change::is_checked;
use super::picture_check::finding::listed;
use super::picture_check::group::{PictureGroup, all_or_scenes};
use super::picture_check::stamp::stamped_pictures;
use super::picture_check::tone::{masked_pictures, toned_pictures};
use super::record::{Record, Status};
use crate::methods::UNUSABLE;
use crate::pairs::pair_id::source_of;

/// Minimum number of sources for detecting outliers. With fewer, the source check examines most of them more closely
/// anyway.
const FEWEST_SOURCES: usize = 4;
/// Minimum difference in PSNR between outliers and the other sources, in dB. It corresponds to a fourfold squared
/// error.
const MIN_GAP: f64 = 6.0;
/// Minimum gap between the PSNR of outliers and of the other sources, as a multiple of the distance between the worst
/// and the median PSNR of the other sources. Such a gap is rare by chance.
const GAP_SIGNIFICANCE: f64 = 2.0;
/// Where sources of several scenes are compared with each other, outliers have at most this PSNR, in dB. A uniform
/// picture in the photograph's mean colour has this PSNR if the standard deviation of the photograph's levels is 45.
const UNLIKE_ANY_SCENE: f64 = 15.0;

/// Names of the extra values recorded for methods that state their training views: 1 if the pair's source (first name)
/// or target (second name) is a training view, otherwise 0.
pub(super) const TRAINED_ON: [&str; 2] = ["source_trained_on", "target_trained_on"];

/// Notes on rendering rules that were assumed because neither the Gaussian files nor the user stated them.
pub fn rule_notes<'a>(records: impl Iterator<Item = &'a Record>) -> Vec<String> {
    let notes: BTreeSet<&String> = records.filter_map(|r| r.rule_note.as_ref()).collect();
    notes.into_iter().cloned().collect()
}

/// Warnings about the Gaussians that a record's picture was rendered from, by topic.
pub fn doubts(record: &Record) -> BTreeMap<&str, String> {
    let extra = |name: &str| record.extras.get(name).copied();
    let source = &record.source;
    let mut doubts: BTreeMap<&str, String> = BTreeMap::new();
    for (name, what) in UNUSABLE {
        if let Some(count) = extra(name) {
            let text = format!("{count} of its Gaussians {what} and are not drawn ({source})");
            doubts.insert(name, text);
        }
    }
    let told = record.warnings.iter();
    doubts.extend(told.map(|(about, text)| (about.as_str(), text.clone())));
    doubts
}

/// Warns about sources whose Gaussians reproduce the photograph much worse than those of other sources. Compares the
/// sources of each scene first. If no scene has outliers, compares all sources of each dataset and reports only
/// renderings that are worse than a uniform picture. This finds files of wrong sources even among sources for which the
/// source check tries no other settings of the file reader.
fn outlying_sources<'a>(
    records: impl Iterator<Item = &'a Record> + Clone,
    kind: &str,
) -> Option<String> {
    // These methods derive their Gaussians from the photograph itself.
    if ["sharp", "depth-splat"].contains(&kind) {
        return None;
    }
    // A blurred rendering has a low PSNR even if it shows the right photograph.
    let blurred = records
        .clone()
        .filter(|r| r.extras.contains_key(SOURCE_BLUR));
    let blurred: BTreeSet<&str> = blurred.map(|r| source_of(&r.pair_id)).collect();
    let file = |r: &'a Record| Some(r.files.as_ref()?.gaussians.as_ref()?.hash.as_str());
    let files: BTreeMap<&str, Option<&str>> = records
        .clone()
        .map(|r| (source_of(&r.pair_id), file(r)))
        .collect();
    // If all sources share one file, no source can have the file of another one.
    let is_shared = |group: &BTreeMap<&str, f64>| {
        let mut files = group.keys().map(|name| files[name]);
        let first = files.next().flatten();
        first.is_some() && files.all(|file| file == first)
    };
    let scopes = [(true, f64::INFINITY), (false, UNLIKE_ANY_SCENE)];
    let found = scopes.into_iter().find_map(|(by_scene, most)| {
        let mut groups: BTreeMap<_, BTreeMap<&str, f64>> = BTreeMap::new();
        for record in records.clone() {
            if let Some(psnr) = record.extras.get(SOURCE_PSNR) {
                let scene = by_scene.then_some(&record.scene);
                let group = groups.entry((&record.dataset, scene)).or_default();
                group.insert(source_of(&record.pair_id), *psnr);
            }
        }
        let groups = groups.values().filter(|group| !is_shared(group));
        let apart = groups.filter_map(|group| {
            let [mut worse, others] = apart(group, most)?;
            worse.retain(|(name, _)| !blurred.contains(name));
            (!worse.is_empty()).then_some([worse, others])
        });
        apart.reduce(|all, more| [0, 1].map(|part| [&all[part][..], &more[part]].concat()))
    });
    let [mut worse, mut others] = found?;
    let count = worse.len() + others.len();
    let range = |part: &mut Vec<(&str, f64)>| {
        part.sort_by(|a, b| a.1.total_cmp(&b.1));
        format!("{:.1} to {:.1}", part[0].1, part[part.len() - 1].1)
    };
    let (of_worse, of_others) = (range(&mut worse), range(&mut others));
    Some(format!(
        "the Gaussians of {} of {count} sources ({}) reproduce the source's photograph at only {of_worse} dB, those of the \
         remaining sources at {of_others} dB; perhaps the files of the named sources belong to other \
         sources (`gaussians info FILE` describes a file)",
        worse.len(),
        listed(worse.iter().map(|(name, _)| *name).collect())
    ))
}

/// Splits sources, given with their PSNR, into outliers (at most half of them, each with a PSNR of at most `most`) and
/// the others. `None` if no gap separates them.
fn apart<'a>(group: &BTreeMap<&'a str, f64>, most: f64) -> Option<[Vec<(&'a str, f64)>; 2]> {
    let mut sources: Vec<(&str, f64)> = group.iter().map(|(name, v)| (*name, *v)).collect();
    sources.sort_by(|a, b| a.1.total_cmp(&b.1));
    let n = sources.len();
    let psnr = |at: usize| sources[at].1;
    let gap = |at: usize| psnr(at) - psnr(at - 1);
    let at = (1..=n / 2).max_by(|a, b| gap(*a).total_cmp(&gap(*b)))?;
    let below_middle = psnr(at + (n - at) / 2) - psnr(at);
    let is_apart = gap(at) >= MIN_GAP.max(GAP_SIGNIFICANCE * below_middle);
    (n >= FEWEST_SOURCES && is_apart && psnr(at - 1) <= most).then(|| {
        let others = sources.split_off(at);
        [sources, others]
    })
}

/// A check of a group of pictures; returns its findings as sentences.
type Check = fn(&PictureGroup<'_, &Record>) -> Vec<String>;

/// Warnings that need all records of a method, one sentence each.
pub(super) fn joint_doubts<'a>(
    records: impl Iterator<Item = &'a Record> + Clone,
    kind: &str,
) -> Vec<String> {
    let mut found = Vec::new();
    if is_checked(kind) {
        let checks: [Check; 6] = [
            changed_pictures,
            |group| misplaced_pictures(group).into_iter().collect(),
            |group| stamped_pictures(group).into_iter().collect(),
            |group| toned_pictures(group).into_iter().collect(),
            |group| masked_pictures(group).into_iter().collect(),
            |group| repeated_pictures(group).into_iter().collect(),
        ];
        let mut datasets: BTreeMap<&str, Vec<(String, &Record)>> = BTreeMap::new();
        for record in records.clone().filter(|r| r.status == Status::Ok) {
            let scene = format!("{}/{}", record.dataset, record.scene);
            let pictures = datasets.entry(&record.dataset).or_default();
            pictures.push((scene, record));
        }
        for check in checks {
            let of_datasets = datasets.iter();
            found.extend(of_datasets.flat_map(|(name, of)| all_or_scenes(name, of, check)));
        }
    }
    found.extend(trained_targets(records.clone()));
    found.extend(outlying_sources(records, kind));
    found
}

/// Names the targets that a method was trained on. If none of its stated training views is a source or target of the
/// records, says so instead.
fn trained_targets<'a>(records: impl Iterator<Item = &'a Record>) -> Option<String> {
    let of_views = |record: &'a Record| {
        let [source, target] = TRAINED_ON.map(|name| record.extras.get(name).map(|v| *v > 0.0));
        Some((source?, target?, record.target.as_str()))
    };
    let views: Vec<(bool, bool, &str)> = records.filter_map(of_views).collect();
    let known: Vec<&str> = views.iter().filter(|v| v.1).map(|v| v.2).collect();
    if views.iter().any(|(source, target, _)| *source || *target) {
        let names: BTreeSet<&str> = known.iter().copied().collect();
        return (!known.is_empty()).then(|| {
            format!(
                "{} of {} targets are views that the method was trained on ({}), so they are not novel views",
                known.len(),
                views.len(),
                listed(names)
            )
        });
    }
    (!views.is_empty()).then(|| {
        "train= names none of the views of these pairs; a name must be VIEW, SCENE/VIEW or DATASET/SCENE/VIEW".to_owned()
    })
}

/// The first warning per topic among a method's records, followed by `joint_doubts`.
pub fn doubts_of<'a>(records: impl Iterator<Item = &'a Record> + Clone, kind: &str) -> Vec<String> {
    let joint = joint_doubts(records.clone(), kind);
    let mut first: BTreeMap<&str, String> = BTreeMap::new();
    for record in records {
        for (about, text) in doubts(record) {
            first.entry(about).or_insert(text);
        }
    }
    first.into_values().chain(joint).collect()
}

#[cfg(test)]
mod tests {
    use super::super::record::tests::record;
    use super::*;

    #[test]
    fn blurred_sources_are_not_others() {
        let mut records = records(&[
            ("s/a", 30.0),
            ("s/b", 18.0),
            ("s/c", 31.0),
            ("s/d", 29.0),
            ("s/e", 30.0),
        ]);
        assert!(outlying_sources(records.iter(), "gaussians").is_some());
        records[1].extras.insert(SOURCE_BLUR.to_owned(), 0.6);
        assert_eq!(outlying_sources(records.iter(), "gaussians"), None);
    }

    /// One record per source; names are `SCENE/VIEW`.
    fn records(sources: &[(&str, f64)]) -> Vec<Record> {
        sources
            .iter()
            .map(|(name, psnr)| {
                let mut record = record();
                record.dataset = "d".to_owned();
                record.scene = name.split('/').next().unwrap_or_default().to_owned();
                record.pair_id = format!("d/{name}__t");
                record.extras = BTreeMap::from([(SOURCE_PSNR.to_owned(), *psnr)]);
                record
            })
            .collect()
    }

    fn shown(sources: &[(&str, f64)]) -> Option<String> {
        let records = records(sources);
        let found = outlying_sources(records.iter(), "gaussians");
        // Not for methods that derive Gaussians from the photograph; independent of order.
        assert_eq!(outlying_sources(records.iter(), "depth-splat"), None);
        assert_eq!(outlying_sources(records.iter().rev(), "gaussians"), found);
        found
    }

    #[test]
    fn sources_far_below_the_others_are_named() {
        let half = [
            ("s/view_00", 24.2),
            ("s/view_01", 31.0),
            ("s/view_02", 27.5),
            ("s/view_03", 9.13),
            ("s/view_04", 11.98),
            ("s/view_05", 26.0),
            ("s/view_06", 10.0),
            ("s/view_07", 11.0),
        ];
        let said = shown(&half).unwrap();
        let start = "the Gaussians of 4 of 8 sources (d/s/view_03, d/s/view_04, d/s/view_06, d/s/view_07) reproduce the \
                     source's photograph at only 9.1 to 12.0 dB, those of the remaining sources at 24.2 to 31.0 dB; ";
        assert!(said.starts_with(start), "{said}");
        assert!(said.contains("`gaussians info FILE`"), "{said}");
        // The file of a neighbouring view.
        let one = [33.9, 33.1, 20.4, 34.0, 33.5];
        let names = ["s/a", "s/b", "s/c", "s/d", "s/e"];
        let one: Vec<(&str, f64)> = names.into_iter().zip(one).collect();
        let said = shown(&one).unwrap();
        assert!(
            said.starts_with("the Gaussians of 1 of 5 sources (d/s/c) "),
            "{said}"
        );
        // With one source per scene, only those worse than a uniform picture count.
        let mut scenes = [("a/v", 22.0), ("b/v", 24.0), ("c/v", 9.0), ("e/v", 27.0)];
        assert!(shown(&scenes).unwrap().contains(" (d/c/v) "));
        scenes[2].1 = 15.5;
        assert_eq!(shown(&scenes), None);
        // In several scenes at once.
        let other = half.map(|(name, psnr)| (name.replace("s/", "t/"), psnr));
        let both = half
            .into_iter()
            .chain(other.iter().map(|(n, p)| (n.as_str(), *p)));
        let said = shown(&both.collect::<Vec<_>>()).unwrap();
        assert!(
            said.starts_with("the Gaussians of 8 of 16") && said.contains(" (d/s/view_03, "),
            "{said}"
        );
        assert!(said.contains("d/t/view_07) "), "{said}");
    }

    /// Measured values: the small network and `depth-splat` on the procedural scene, the network on held-out scenes,
    /// and plausible values of other correct Gaussians.
    #[test]
    fn sources_that_differ_by_nature_are_not() {
        let of = |values: &[f64]| {
            let names: Vec<String> = (0..values.len()).map(|i| format!("s/{i}")).collect();
            let named = names.iter().map(String::as_str).zip(values.iter().copied());
            shown(&named.collect::<Vec<_>>())
        };
        for values in [
            &[
                27.03, 27.06, 27.09, 27.23, 27.3, 27.42, 27.5, 27.54, 27.7, 27.85,
            ][..],
            &[
                10.13, 10.14, 10.58, 11.04, 11.24, 11.6, 12.4, 13.3, 13.5, 15.02,
            ],
            &[
                21.93, 22.49, 23.0, 24.1, 24.8, 25.9, 27.0, 28.1, 29.3, 31.21,
            ],
            // One easy, flat view, and a gradual decline.
            &[24.0, 24.5, 25.0, 25.5, 40.0],
            &[8.0, 12.0, 16.0, 20.0, 24.0, 28.0],
            // Too few sources to decide.
            &[9.0, 25.0, 26.0],
            // Most are low, so it is unclear which are right.
            &[9.0, 9.5, 10.0, 25.0],
        ] {
            assert_eq!(of(values), None, "{values:?}");
        }
        // A scene of leaves next to one of walls.
        let names = ["a/0", "a/1", "a/2", "a/3", "b/0", "b/1", "b/2", "b/3"];
        let values = [31.0, 31.5, 32.0, 32.2, 22.0, 22.1, 22.6, 23.0];
        let two: Vec<(&str, f64)> = names.into_iter().zip(values).collect();
        assert_eq!(shown(&two), None);
    }

    #[test]
    fn one_file_of_a_scene_has_no_other_source() {
        use super::super::record::{GaussiansRead, PairFiles};
        let mut records = records(&[("s/a", 30.0), ("s/b", 17.0), ("s/c", 31.0), ("s/d", 29.0)]);
        let of = |file: &str| {
            Some(PairFiles {
                source: String::new(),
                target: String::new(),
                pictures: None,
                gaussians: Some(GaussiansRead {
                    file: file.to_owned(),
                    hash: file.to_owned(),
                }),
            })
        };
        records.iter_mut().for_each(|record| record.files = of("s"));
        assert_eq!(outlying_sources(records.iter(), "gaussians"), None);
        // The file of a under the names of a and b.
        records[2].files = of("c");
        assert!(outlying_sources(records.iter(), "gaussians").is_some());
    }

    #[test]
    fn unusable_gaussians_are_counted() {
        let mut record = record();
        assert!(doubts(&record).is_empty());
        record.extras.insert("zero_quaternions".to_owned(), 3.0);
        let said = &doubts(&record)["zero_quaternions"];
        assert!(
            said.contains("3 of its Gaussians have a quaternion of zero"),
            "{said}"
        );
    }
}
