//! Warnings about changes that a dataset's pictures share, about single pictures that are clearly altered, and about
//! pictures stored under several names.

use std::collections::{BTreeMap, BTreeSet};

use super::camera::{is_reframed, is_resized};
use super::change::UNLIKE;
use super::finding::{PictureChange, ShownTarget, listed};
use super::group::{Extent, PictureGroup, scene_of};
use super::sample::FEWEST;
use crate::evaluate::record::Record;

/// A change is reported only if at least this many of a dataset's pictures have it.
const MIN_CHANGED: usize = 3;
/// A change is reported only if at least this share of a dataset's pictures have it.
const MIN_SHARE: f64 = 0.8;
/// Like [`MIN_SHARE`], but for crops, padding and the limited range of video: unaltered pictures are rarely taken for
/// these.
const MIN_SHARE_DISTINCTIVE: f64 = 0.5;
/// Like [`MIN_SHARE`], but for stretched levels. It is lower, because stretching hardly changes pictures whose
/// photograph contains black and white.
const MIN_SHARE_STRETCHED: f64 = 0.25;
/// Like [`MIN_SHARE`], but for changes that are [visible](PictureChange::is_visible).
const MIN_SHARE_VISIBLE: f64 = 0.1;
/// Pictures with a [clear](PictureChange::is_clear) change are named if there are at least this many, even if they are
/// too few for a finding on the dataset.
const MIN_NAMED: usize = 2;
/// Pictures with a clear change are named only if they are at least this share of a dataset's pictures.
const MIN_SHARE_NAMED: f64 = 0.02;
/// Equal pictures are reported only if they have at least this many different targets, because two targets may have the
/// same source and motion.
const MIN_REPEATED: usize = 3;
/// Strips count as equally thick if their thickness differs by at most this, in thousandths of the height.
const MAX_UNEVEN: f64 = 8.0;
/// Like [`MAX_UNEVEN`], but as a share of the thickness; the larger limit applies.
const MAX_UNEVEN_SHARE: f64 = 0.1;
/// Pictures count as stretched one by one if their gains differ by at least this, in percentage points. Equal gains
/// rather indicate another exposure.
const MIN_SPREAD: i16 = 5;

/// The sentences of [`agreed_changes`]. Leaves out crops and padding if a wrong camera explains them. Also leaves out
/// copies of the source if most compared pictures are copies, because that is reported elsewhere.
pub(crate) fn changed_pictures(group: &PictureGroup<'_, &Record>) -> Vec<String> {
    let is_reframed = is_reframed(group);
    let shown = group.pictures.iter().filter_map(|record| record.shows);
    let copies = shown.clone().filter(|shown| *shown == ShownTarget::Source);
    let copies = copies.count();
    let are_copies = copies >= group.extent.fewest(FEWEST) && 2 * copies > shown.count();
    let change = |record: &&Record| {
        let is_copy = record.change == Some(PictureChange::CopiedSource);
        let is_explained = is_reframed && is_resized(record.change) || are_copies && is_copy;
        record.change.filter(|_| !is_explained)
    };
    let pictures = group.pictures.iter();
    let pictures: Vec<_> = pictures
        .map(|record| (record.pair_id.as_str(), change(record)))
        .collect();
    agreed_changes(&pictures, &format!("of {}", group.name), group.extent)
}

/// A sentence on each change that enough of the named `pictures` share. In a dataset, a smaller share suffices for
/// clear and visible changes. `photographs` says which photographs the pictures were compared with, as in "of DATASET";
/// it follows "the photographs" in the sentence.
pub(crate) fn agreed_changes(
    pictures: &[(&str, Option<PictureChange>)],
    photographs: &str,
    extent: Extent,
) -> Vec<String> {
    let changes = pictures.iter().filter_map(|(_, change)| *change);
    let kinds: BTreeSet<PictureChange> = changes.clone().map(PictureChange::kind).collect();
    let all = pictures.len() as f64;
    let sentence = |kind: PictureChange| {
        let of_kind: Vec<_> = changes
            .clone()
            .filter(|change| change.kind() == kind)
            .collect();
        let count = agreeing(&of_kind);
        let share = match kind {
            PictureChange::LimitedRange | PictureChange::Padded | PictureChange::Cropped => {
                MIN_SHARE_DISTINCTIVE
            }
            PictureChange::Stretched(_) => MIN_SHARE_STRETCHED,
            kind if kind.is_visible() => MIN_SHARE_VISIBLE,
            _ => MIN_SHARE,
        };
        let reaches =
            |least: usize, least_share: f64| count >= least && count as f64 >= least_share * all;
        if reaches(extent.fewest(MIN_CHANGED), extent.share(share)) {
            return Some(sentence_on(kind, count, pictures.len(), photographs));
        }
        let names = named(pictures, kind);
        let is_named = extent == Extent::Dataset && kind.is_clear();
        (is_named && reaches(MIN_NAMED, MIN_SHARE_NAMED)).then(|| {
            format!(
                "{count} of its {} pictures {} (compared with the photographs {photographs}): {names}",
                pictures.len(),
                kind.text()
            )
        })
    };
    kinds.into_iter().filter_map(sentence).collect()
}

/// Number of the `changes`, all of one kind, whose measured numbers agree.
fn agreeing(changes: &[PictureChange]) -> usize {
    let strips: Vec<[i16; 2]> = changes
        .iter()
        .filter_map(|change| match change {
            PictureChange::Strip(thickness) => Some(*thickness),
            _ => None,
        })
        .collect();
    if !strips.is_empty() {
        let middle: [f64; 2] = std::array::from_fn(|side| {
            let mut of_side: Vec<i16> = strips.iter().map(|strip| strip[side]).collect();
            of_side.sort_unstable();
            f64::from(of_side[of_side.len() / 2])
        });
        let is_equal = |strip: &&[i16; 2]| {
            let mut sides = strip.iter().zip(middle);
            sides.all(|(own, middle)| {
                (f64::from(*own) - middle).abs() <= MAX_UNEVEN.max(MAX_UNEVEN_SHARE * middle)
            })
        };
        return strips.iter().filter(is_equal).count();
    }
    let gains = changes.iter().filter_map(|change| match change {
        PictureChange::Stretched(gain) => Some(*gain),
        _ => None,
    });
    match (gains.clone().min(), gains.max()) {
        (Some(least), Some(most)) if most - least < MIN_SPREAD => 0,
        _ => changes.len(),
    }
}

fn sentence_on(change: PictureChange, count: usize, all: usize, photographs: &str) -> String {
    let counted = format!("{count} of {all}");
    match change {
        PictureChange::Photograph => {
            format!(
                "its pictures {} ({counted} are equal to those {photographs}); perhaps the photographs were stored in place \
                 of the predictions",
                change.text()
            )
        }
        PictureChange::Unlike => format!(
            "its pictures {} ({counted} have a correlation below {UNLIKE} with those {photographs}); perhaps they show \
             another scene or pose, or the files are unfinished or in another byte order",
            change.text()
        ),
        PictureChange::LimitedRange => format!(
            "its pictures look as if they have the limited range of video, 16 to 235, but were read as 0 to 255: in \
             {counted}, levels are about 16 where the photographs {photographs} are black and about 235 where those are \
             white; store them with the full range"
        ),
        change
            if change.is_visible()
                || matches!(
                    change,
                    PictureChange::Grey
                        | PictureChange::CopiedSource
                        | PictureChange::RepeatedRow
                        | PictureChange::Strip(_)
                ) =>
        {
            format!(
                "{count} of its {all} pictures {} (compared with the photographs {photographs})",
                change.text()
            )
        }
        PictureChange::NormalisedAndStretched => format!(
            "its pictures look as if they {}; {counted} have the brightness and contrast per channel that the \
             photographs {photographs} have after this normalisation",
            change.text()
        ),
        PictureChange::Stretched(_) => format!(
            "its pictures look as if they {}; {counted} have more contrast than the photographs {photographs}, each by \
             a different factor",
            change.text()
        ),
        change => format!(
            "its pictures look as if they {}; {counted} are significantly closer to the photographs {photographs} when \
             this is undone",
            change.text()
        ),
    }
}

/// Names of the pictures with a kind of change, or the scene's name if all of its pictures have it.
fn named(pictures: &[(&str, Option<PictureChange>)], kind: PictureChange) -> String {
    let mut by_scene: BTreeMap<&str, [Vec<&str>; 2]> = BTreeMap::new();
    for (name, change) in pictures {
        let scene = scene_of(name);
        let has = change.map(PictureChange::kind) == Some(kind);
        by_scene.entry(scene).or_default()[usize::from(has)].push(name);
    }
    let names = by_scene.into_iter().flat_map(|(scene, [others, changed])| {
        if others.is_empty() && changed.len() > 1 && !scene.is_empty() {
            vec![format!("all of {scene}")]
        } else {
            changed.into_iter().map(str::to_owned).collect()
        }
    });
    let names: Vec<String> = names.collect();
    listed(names.iter().map(String::as_str).collect())
}

/// Warns if several targets have the same predicted file, unless that file is the source's photograph, which is
/// reported elsewhere.
pub(crate) fn repeated_pictures(group: &PictureGroup<'_, &Record>) -> Option<String> {
    let records = || group.pictures.iter();
    if records().any(|record| record.shows == Some(ShownTarget::Source)) {
        return None;
    }
    let others = records().filter(|record| record.change != Some(PictureChange::CopiedSource));
    let files = others.filter_map(|record| {
        let files = record.files.as_ref()?;
        let picture = files.pictures.as_ref()?;
        Some((record.pair_id.as_str(), [picture, &files.target]))
    });
    repeated(&files.collect::<Vec<_>>())
}

/// Warns if some pictures are equal although their targets are not. Each picture is given as its name and two contents:
/// its own and its target's.
pub(crate) fn repeated<T: Ord>(pictures: &[(&str, [T; 2])]) -> Option<String> {
    let mut targets: BTreeMap<&T, BTreeSet<&T>> = BTreeMap::new();
    for (_, [picture, target]) in pictures {
        targets.entry(picture).or_default().insert(target);
    }
    let repeated = pictures
        .iter()
        .filter(|(_, [picture, _])| targets[picture].len() >= MIN_REPEATED);
    let names: BTreeSet<&str> = repeated.map(|(name, _)| *name).collect();
    (!names.is_empty()).then(|| {
        format!(
            "{} of its {} pictures are equal to another picture, although the targets differ (perhaps one file was \
             stored under several names): {}",
            names.len(),
            pictures.len(),
            listed(names)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::super::group::tests::of_dataset;
    use super::*;
    use crate::evaluate::record::tests::record;
    use crate::evaluate::record::{PairFiles, Status};

    fn records(all: usize, of: impl Fn(usize, &mut Record)) -> Vec<Record> {
        let one = |at: usize| {
            let mut record = record();
            record.status = Status::Ok;
            record.pair_id = format!("m/scene{}/a__{at}", at / 4);
            of(at, &mut record);
            record
        };
        (0..all).map(one).collect()
    }

    /// What is said if the first of `all` pictures have these changes.
    fn told(changes: &[PictureChange], all: usize) -> Vec<String> {
        let of = |at: usize, record: &mut Record| record.change = changes.get(at).copied();
        of_dataset(&records(all, of), changed_pictures)
    }

    #[test]
    fn nearly_all_pictures_of_a_dataset_have_to_agree() {
        let sentences =
            |change: PictureChange, changed: usize, all: usize| told(&vec![change; changed], all);
        let (linear, wrapped) = (PictureChange::Linear, PictureChange::Wrapped);
        for few in [
            (linear, 2, 2),
            (linear, 3, 8),
            (wrapped, 2, 8),
            (wrapped, 3, 40),
        ] {
            assert_eq!(sentences(few.0, few.1, few.2), Vec::<String>::new());
        }
        let bgr = PictureChange::Bgr;
        assert!(sentences(bgr, 7, 8)[0].contains("red and blue swapped; 7 of 8 "));
        assert!(sentences(wrapped, 3, 8)[0].starts_with("3 of its 8 pictures have very bright"));
        assert_eq!(sentences(PictureChange::Padded, 4, 8).len(), 1);
        // Few pictures repeat a row where a vertical motion leaves a hole.
        let row = PictureChange::RepeatedRow;
        assert_eq!(sentences(row, 4, 8), Vec::<String>::new());
        assert!(sentences(row, 8, 8)[0].starts_with("8 of its 8 pictures repeat one row"));
    }

    #[test]
    fn a_few_clearly_changed_pictures_are_named() {
        let (bgr, noise) = (PictureChange::Bgr, PictureChange::Noise);
        let said = told(&[bgr, bgr, noise, noise], 7);
        let named = |what: &str, names: &str| {
            let end = format!("of m): {names}");
            said.iter()
                .any(|said| said.contains(what) && said.ends_with(&end))
        };
        assert!(named(
            "2 of its 7 pictures have red and blue swapped",
            "m/scene0/a__0, m/scene0/a__1"
        ));
        assert!(named(
            "2 of its 7 pictures are noise",
            "m/scene0/a__2, m/scene0/a__3"
        ));
        // A whole scene.
        assert!(told(&[bgr; 4], 8)[0].ends_with(": all of m/scene0"));
        // Single pictures, too few pictures, and changes that unaltered pictures resemble are not reported.
        for silent in [
            told(&[bgr], 7),
            told(&[bgr; 2], 200),
            told(&[PictureChange::Linear; 4], 8),
        ] {
            assert_eq!(silent, Vec::<String>::new());
        }
    }

    #[test]
    fn copies_of_sources_are_named_unless_most_pictures_are_copies() {
        let told = |copies: usize, compared: usize| {
            let of = |at: usize, record: &mut Record| {
                let is_copy = at < copies;
                record.change = is_copy.then_some(PictureChange::CopiedSource);
                let shows = [ShownTarget::Own, ShownTarget::Source][usize::from(is_copy)];
                record.shows = (at % 3 < compared).then_some(shows);
            };
            of_dataset(&records(16, of), changed_pictures)
        };
        let start = "3 of its 16 pictures are copies of the source's photograph";
        for compared in [0, 1, 3] {
            let said = told(3, compared);
            assert!(said.len() == 1 && said[0].starts_with(start), "{said:?}");
        }
        let said = told(16, 0);
        assert!(
            said[0].starts_with("16 of its 16 pictures are copies"),
            "{said:?}"
        );
        assert_eq!(told(16, 3), Vec::<String>::new());
        assert_eq!(told(1, 3), Vec::<String>::new());
    }

    #[test]
    fn strips_are_equally_thick_and_stretched_levels_have_other_gains() {
        let strip = |top: i16| PictureChange::Strip([top, 0]);
        let equal = told(&[strip(60), strip(60), strip(63)], 3);
        assert!(
            equal[0].starts_with("3 of its 3 pictures have a strip of one colour"),
            "{equal:?}"
        );
        let stretched = |gain: i16| PictureChange::Stretched(gain);
        let said = told(&[stretched(110), stretched(120), stretched(140)], 6);
        assert!(
            said[0].contains("were stretched separately") && said[0].contains("3 of 6"),
            "{said:?}"
        );
        for proper in [[strip(60), strip(20), strip(90)], [stretched(120); 3]] {
            assert_eq!(told(&proper, 3), Vec::<String>::new());
        }
    }

    #[test]
    fn one_file_for_several_targets_is_named() {
        let files = |of: fn(usize) -> usize| {
            move |at: usize, record: &mut Record| {
                record.files = Some(PairFiles {
                    source: String::new(),
                    target: at.to_string(),
                    pictures: Some(of(at).to_string()),
                    gaussians: None,
                });
            }
        };
        let records_of = records(5, files(|at| at.min(2)));
        let said = of_dataset(&records_of, repeated_pictures).unwrap();
        assert!(
            said.starts_with("3 of its 5 pictures are equal to another picture"),
            "{said:?}"
        );
        assert!(
            said.ends_with(": m/scene0/a__2, m/scene0/a__3, m/scene1/a__4"),
            "{said:?}"
        );
        let of_source = |at: usize, record: &mut Record| {
            files(|_| 0)(at, record);
            record.shows = Some(ShownTarget::Source);
        };
        for proper in [
            records(5, files(|at| at)),
            records(5, files(|at| at / 2)),
            records(5, of_source),
        ] {
            assert_eq!(of_dataset(&proper, repeated_pictures), None);
        }
        // Repeated photographs have equal predictions.
        assert_eq!(repeated(&["a", "b", "c"].map(|name| (name, [1, 2]))), None);
    }
}
