//! Detects pictures stored under the names of other pairs, by comparing some of them with those pairs' targets, and
//! pictures that are the source's photograph.
//!
//! Poor predictions must not raise false alarms, nor pictures with too little motion: a picture has to show another
//! target significantly better than its own, and better than the source's photograph does, for most of the compared
//! pictures. Scores do not depend on this check.

use std::collections::{BTreeMap, BTreeSet};

use image::RgbImage;
use image::imageops::thumbnail;
use sharp_datasets::View;

use super::finding::ShownTarget;
use super::gaussians::likeness::Likeness;
use super::picture_check::shrunk;
use super::picture_motion::shown_motion;
use super::record::Record;
use crate::pairs::pair_list::ResolvedPair;
use crate::scoring::Region;

/// Share of the pictures with a measured motion that must agree, and how far factors of motion may differ: percentage
/// points, or, if larger, a share of the factor.
const AGREEING: f64 = 0.8;
const UNEVEN: (f64, f64) = (8.0, 0.12);
/// Number of pairs per dataset whose pictures are compared, evenly spaced, and number of other targets for each.
const SAMPLED: usize = 8;
const OTHERS: usize = 12;
/// Minimum number of pictures in a dataset that must show other targets.
const FEWEST: usize = 3;
/// Minimum gain of another target, dB.
const LEAST_GAIN: f64 = 2.0;
/// Minimum PSNR of the source's photograph stored as JPEG, dB, and minimum gain over the target. Only copies reach both.
const COPY: (f64, f64) = (40.0, 10.0);

/// Minimum gain of the source's photograph over the target's if a prediction shows the source's view, dB.
const SOURCE_VIEW: f64 = 3.0;
/// Minimum squared error of such a prediction against the target, relative to that of the source's photograph. A
/// prediction that moves is below.
const AS_FAR: f64 = 0.7;

/// For each pair, the other pairs with whose targets its picture is compared.
pub(super) type OtherPairs<'a> = BTreeMap<String, Vec<(ShownTarget, ResolvedPair<'a>)>>;

/// Chooses the pairs whose pictures are compared. `pairs` must be all pairs of the plan, so that all shards choose the
/// same.
pub(super) fn compared_pairs<'a>(pairs: &[ResolvedPair<'a>]) -> OtherPairs<'a> {
    let mut datasets: BTreeMap<&str, Vec<ResolvedPair<'a>>> = BTreeMap::new();
    for planned in pairs {
        let of_dataset = datasets.entry(&planned.scene.dataset).or_default();
        of_dataset.push(*planned);
    }
    let mut compared = OtherPairs::new();
    for all in datasets.values().filter(|all| all.len() >= FEWEST) {
        let n = all.len();
        let mut targets = BTreeMap::new();
        for planned in all {
            let view = (&planned.scene.id, &planned.target.id);
            targets.entry(view).or_insert(*planned);
        }
        for at in spread(n, SAMPLED) {
            let own = &all[at];
            let (near, far): (Vec<_>, Vec<_>) = targets
                .values()
                .partition(|other| other.scene.id == own.scene.id);
            let near: Vec<_> = spread(near.len(), OTHERS).map(|k| near[k]).collect();
            let far = spread(far.len(), OTHERS - near.len()).map(|k| far[k]);
            let elsewhere = near.into_iter().chain(far);
            let others = [
                (ShownTarget::Previous, all[(at + n - 1) % n]),
                (ShownTarget::Next, all[(at + 1) % n]),
            ];
            let others = others
                .into_iter()
                .chain(elsewhere.map(|other| (ShownTarget::Other, other)));
            compared.insert(own.pair.pair_id.clone(), others.collect());
        }
    }
    compared
}

/// At most `most` of `count` indices, evenly spaced.
fn spread(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let n = count.min(most);
    (0..n).map(move |k| k * count / n)
}

/// Reduced photographs by dataset, scene and view.
#[derive(Default)]
pub(super) struct Thumbnails(BTreeMap<[String; 3], Option<RgbImage>>);

impl Thumbnails {
    /// A view's photograph, shrunk; `None` if it cannot be read.
    pub(super) fn of(&mut self, planned: &ResolvedPair<'_>, view: &View) -> Option<RgbImage> {
        let scene = planned.scene;
        let name = [&scene.dataset, &scene.id, &view.id].map(Clone::clone);
        let read = || Some(shrunk(&view.content.image().ok()?));
        self.0.entry(name).or_insert_with(read).clone()
    }
}

/// Sets the [`Record::shows`] if the picture is in the sample and covers the whole target.
pub(super) fn note_order(
    record: &mut Record,
    planned: &ResolvedPair<'_>,
    others: &OtherPairs<'_>,
    (photograph, picture): (&RgbImage, &RgbImage),
    read: &mut Thumbnails,
) {
    record.shows = None;
    let others = others.get(&record.pair_id);
    let (Some(others), None) = (others, record.crop) else {
        return;
    };
    let [seen, shown] = [photograph, picture].map(shrunk);
    let Some(source) = read.of(planned, planned.source) else {
        return;
    };
    let is_other = |other: &ResolvedPair<'_>| {
        let is_own_scene = other.scene.id == planned.scene.id;
        !(is_own_scene && [&planned.source.id, &planned.target.id].contains(&&other.target.id))
    };
    let others = others.iter().filter(|(_, other)| is_other(other));
    let others = others.filter_map(|(place, other)| Some((*place, read.of(other, other.target)?)));
    let views = [planned.source, planned.target];
    let [from, to] = views.map(|view| view.camera_from_world);
    let motion = shown_motion(
        views.map(|view| view.intrinsics),
        to.after(&from.inverse()),
        [&source, &seen, &shown],
    );
    use ShownTarget::{Motion, Own, Source, SourceView};
    let shows = shown_target(&seen, &shown, Some(&source), others);
    record.shows = match (shows, motion) {
        (Some(Source), _) | (Some(SourceView), Some(Motion(-5..=5))) => shows,
        // A picture of poor depth may be closer to the source, although it moved.
        (Some(Own), Some(motion)) | (Some(SourceView), Some(motion @ Motion(20..))) => Some(motion),
        (Some(_), Some(motion)) if motion.is_misplaced() => Some(motion),
        _ => shows,
    };
}

/// The target that a picture shows best: its own (`seen`) unless one of `others` is significantly better, or unless it
/// is the source's photograph. `None` if it does not have its own target's size. All are [`shrunk`].
pub(crate) fn shown_target(
    seen: &RgbImage,
    shown: &RgbImage,
    source: Option<&RgbImage>,
    others: impl Iterator<Item = (ShownTarget, RgbImage)>,
) -> Option<ShownTarget> {
    // Pictures of other targets may have been resized.
    let fit = |seen: &RgbImage, shown: &RgbImage| {
        let size = shown.dimensions();
        let resized = (seen.dimensions() != size).then(|| thumbnail(seen, size.0, size.1));
        Likeness::of(resized.as_ref().unwrap_or(seen), Region::whole(size), shown)
    };
    if seen.dimensions() != shown.dimensions() {
        return None;
    }
    let own = fit(seen, shown);
    let is_copy =
        |copied: Likeness| copied.psnr() >= COPY.0 && copied.psnr() - own.psnr() >= COPY.1;
    if source.is_some_and(|source| is_copy(fit(source, shown))) {
        return Some(ShownTarget::Source);
    }
    // A prediction that moves is closer to the target than the source is.
    if let Some(source) = source
        && let (shows, copied) = (fit(source, shown), fit(seen, source))
        && shows.is_better_than(&own)
        && shows.gain_over(&own) >= SOURCE_VIEW
        && own.error() >= AS_FAR * copied.error()
    {
        return Some(ShownTarget::SourceView);
    }
    let mut best: Option<(ShownTarget, Likeness)> = None;
    for (place, seen) in others {
        let other = fit(&seen, shown);
        if other.is_better_than(&own)
            && other.gain_over(&own) >= LEAST_GAIN
            && source.is_none_or(|source| other.is_closer_than(&fit(&seen, source)))
            && best.as_ref().is_none_or(|(_, b)| other.error() < b.error())
        {
            best = Some((place, other));
        }
    }
    Some(best.map_or(ShownTarget::Own, |(place, _)| place))
}

/// Which of `count` pictures in one folder are compared, and with whose targets, as in [`compared_pairs`].
pub(crate) fn compared_pictures(count: usize) -> BTreeMap<usize, Vec<(ShownTarget, usize)>> {
    let sampled = spread(count, SAMPLED).filter(|_| count >= FEWEST);
    let others = |at: usize| {
        let near = [
            (ShownTarget::Previous, (at + count - 1) % count),
            (ShownTarget::Next, (at + 1) % count),
        ];
        let elsewhere = spread(count, OTHERS).map(|other| (ShownTarget::Other, other));
        let all = near.into_iter().chain(elsewhere);
        all.filter(|(_, other)| *other != at).collect()
    };
    sampled.map(|at| (at, others(at))).collect()
}

/// A sentence for each dataset in which most compared pictures show other targets.
pub(super) fn misplaced_pictures<'a>(records: impl Iterator<Item = &'a Record>) -> Vec<String> {
    let mut by_dataset: BTreeMap<&str, BTreeMap<ShownTarget, usize>> = BTreeMap::new();
    let mut sources = BTreeSet::new();
    for record in records {
        // Pictures predicted from one source share its scale, so positive factors count once per source.
        let source = (&record.dataset, &record.scene, &record.source);
        let is_repeated =
            matches!(record.shows, Some(ShownTarget::Motion(1..))) && !sources.insert(source);
        if let (Some(found), false) = (record.shows, is_repeated) {
            let of_dataset = by_dataset.entry(&record.dataset).or_default();
            *of_dataset.entry(found).or_default() += 1;
        }
    }
    let told = by_dataset.into_iter();
    told.filter_map(|(dataset, found)| misplaced(&found, &format!("pairs of {dataset}")))
        .collect()
}

/// A sentence if most compared pictures show other targets than their own; `found` counts what they show. `pairs` is
/// what the names belong to.
pub(crate) fn misplaced(found: &BTreeMap<ShownTarget, usize>, pairs: &str) -> Option<String> {
    use ShownTarget::{Next, Other, Previous, Source, SourceView};
    let count = |places: &[ShownTarget]| -> usize {
        places.iter().filter_map(|place| found.get(place)).sum()
    };
    let all: usize = found.values().sum();
    let is_most = |count: usize| count >= FEWEST && 2 * count > all;
    let copies = count(&[Source]);
    if is_most(copies) {
        return Some(format!(
            "its pictures are {}, as the baseline `copy` gives: {copies} of the {all} compared in {pairs}; if this is \
             not intended, store the predictions",
            Source.text()
        ));
    }
    if let Some(moved) = moved(found, pairs) {
        return Some(moved);
    }
    let views = count(&[Source, SourceView]);
    // If a quarter moved clearly, the others only have poor depth.
    let moving = found
        .iter()
        .filter(|(shows, _)| matches!(shows, ShownTarget::Motion(20..)));
    let moving: usize = moving.map(|(_, count)| count).sum();
    if is_most(views) && 4 * moving < all {
        return Some(format!(
            "its pictures show {} rather than the target's: {views} of the {all} compared in {pairs} are significantly \
             closer to the source's photograph, as if they were rendered with the source's pose, or with poses of \
             another unit or axes",
            SourceView.text()
        ));
    }
    let shifts = [Previous, Next].map(|place| (place, count(&[place])));
    let (shift, shifted) = shifts.into_iter().max_by_key(|(_, count)| *count)?;
    let (what, count) = match is_most(shifted) {
        true => (shift, shifted),
        false => (Other, count(&[Previous, Next, Other])),
    };
    is_most(count).then(|| {
        format!(
            "its pictures look as if they had the names of other {pairs}: {count} of the {all} compared show {} \
             significantly better than their own; correct the file names",
            what.text()
        )
    })
}

/// A sentence if nearly all pictures with a measured motion moved by the same wrong multiple, or as the same misread pose.
fn moved(found: &BTreeMap<ShownTarget, usize>, pairs: &str) -> Option<String> {
    use ShownTarget::Motion;
    let measured = found
        .iter()
        .filter(|(shows, _)| matches!(shows, Motion(_)) || shows.is_misplaced());
    let all: usize = measured.clone().map(|(_, count)| count).sum();
    let wrong = measured.filter(|(shows, _)| shows.is_misplaced());
    let sorted: Vec<ShownTarget> = wrong
        .flat_map(|(shows, count)| std::iter::repeat_n(*shows, *count))
        .collect();
    let middle = *sorted.get(sorted.len() / 2)?;
    let agrees = |shows: &&ShownTarget| match (shows, middle) {
        (Motion(factor), Motion(middle)) => {
            let middle = f64::from(middle);
            (f64::from(*factor) - middle).abs() <= UNEVEN.0.max(UNEVEN.1 * middle.abs())
        }
        (shows, middle) => **shows == middle,
    };
    let count = sorted.iter().filter(agrees).count();
    if count < FEWEST || (count as f64) < AGREEING * all as f64 {
        return None;
    }
    let counted = format!("{count} of the {all} whose motion could be measured in {pairs}");
    Some(match middle {
        Motion(percent) => format!(
            "its pictures move by {:.2} times the target's motion from the source's view: {counted} agree; {}",
            f64::from(percent) / 100.0,
            match percent < 0 {
                true => "check the sign of the translation, and whether the pose is inverted",
                false => "check the unit of the translation and the scale of the depths",
            }
        ),
        pose => format!("its pictures show {} ({counted})", pose.text()),
    })
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::super::record::tests::record;
    use super::*;

    /// Waves of another direction for each `view`, with some noise.
    fn view(view: usize, noise: u32) -> RgbImage {
        RgbImage::from_fn(96, 72, |x, y| {
            let (u, v) = (f64::from(x) / 7.0, f64::from(y) / 9.0);
            let wave = 120.0 + 90.0 * (u * (view as f64 * 0.7).cos() + v + view as f64).sin();
            let hash = f64::from((x * 7919 + y * 104_729) % 17) - 8.0;
            Rgb([(wave + hash * f64::from(noise)).clamp(0.0, 255.0) as u8; 3])
        })
    }

    /// What the sentence is if the picture of `from(k)` has the name of k, for 9 pictures.
    fn told(from: impl Fn(usize) -> usize) -> Option<String> {
        let mut found = BTreeMap::new();
        for (at, others) in compared_pictures(9) {
            let others = others.into_iter().map(|(place, k)| (place, view(k, 0)));
            let shown = view(from(at), 1);
            *found
                .entry(shown_target(&view(at, 0), &shown, None, others)?)
                .or_insert(0) += 1;
        }
        misplaced(&found, "pictures")
    }

    #[test]
    fn pictures_of_a_folder_under_the_names_of_others_are_told() {
        let before = told(|k| (k + 8) % 9).unwrap();
        assert!(
            before.contains("show the target of the pair before theirs"),
            "{before}"
        );
        let after = told(|k| (k + 1) % 9).unwrap();
        assert!(
            after.contains("show the target of the pair after theirs"),
            "{after}"
        );
        assert!(
            told(|k| (k * 4 + 3) % 9)
                .unwrap()
                .contains("the target of another pair")
        );
        assert_eq!(told(|k| k), None);
        assert_eq!(compared_pictures(2), BTreeMap::new());
    }

    #[test]
    fn copies_of_the_source_are_told_from_predictions_near_it() {
        let shown = |shown: &RgbImage, target| {
            shown_target(
                &view(target, 0),
                shown,
                Some(&view(0, 0)),
                std::iter::empty(),
            )
        };
        assert_eq!(shown(&view(0, 0), 1), Some(ShownTarget::Source));
        assert_eq!(shown(&view(0, 1), 1), Some(ShownTarget::SourceView));
        assert_eq!(shown(&view(1, 4), 1), Some(ShownTarget::Own));
        let between = |x: u32, y: u32| {
            let [a, b] = [0, 1].map(|k| view(k, 0).get_pixel(x, y).0[0] / 2);
            Rgb([a + b; 3])
        };
        let blend = RgbImage::from_fn(96, 72, between);
        assert_eq!(shown(&blend, 1), Some(ShownTarget::Own));
        // A target equal to its source.
        assert_eq!(shown(&view(0, 0), 0), Some(ShownTarget::Own));
        let said = misplaced(&BTreeMap::from([(ShownTarget::Source, 3)]), "pairs of d").unwrap();
        assert!(said.contains("are the source's photograph, "), "{said}");
        let said = BTreeMap::from([(ShownTarget::Source, 1), (ShownTarget::SourceView, 3)]);
        let said = misplaced(&said, "pairs of d").unwrap();
        assert!(
            said.contains("show the source's view rather than the target's: 4 of the 4"),
            "{said}"
        );
    }

    #[test]
    fn nearly_all_measured_motions_have_to_agree() {
        use ShownTarget::{InversePose, Motion, Own};
        let told = |found: &[(ShownTarget, usize)]| {
            misplaced(&found.iter().copied().collect(), "pairs of d")
        };
        let said = told(&[(Motion(-104), 2), (Motion(-98), 2), (Own, 4)]).unwrap();
        assert!(
            said.contains("move by -0.98 times") && said.contains("4 of the 4"),
            "{said}"
        );
        assert!(said.contains("check the sign"), "{said}");
        let said = told(&[(Motion(47), 1), (Motion(50), 5), (Motion(100), 1)]).unwrap();
        assert!(
            said.contains("by 0.50") && said.contains("6 of the 7"),
            "{said}"
        );
        assert!(
            told(&[(InversePose, 3)])
                .unwrap()
                .contains("the inverse of the target's pose")
        );
        for proper in [
            told(&[(Motion(50), 2), (Own, 6)]),
            told(&[(Motion(50), 3), (Motion(100), 3)]),
            told(&[(Motion(30), 2), (Motion(45), 2), (Motion(170), 2)]),
            told(&[(Motion(100), 8)]),
            told(&[(ShownTarget::SourceView, 6), (Motion(60), 2)]),
            told(&[(Motion(70), 8)]),
        ] {
            assert_eq!(proper, None);
        }
    }

    #[test]
    fn pictures_of_one_source_are_one_measurement_of_its_scale() {
        let told = |of: fn(usize) -> String| {
            let records: Vec<Record> = (0..4)
                .map(|k| Record {
                    source: of(k),
                    shows: Some(ShownTarget::Motion(50)),
                    ..record()
                })
                .collect();
            misplaced_pictures(records.iter())
        };
        assert_eq!(told(|_| "a".to_owned()), Vec::<String>::new());
        assert!(told(|k| k.to_string())[0].contains("4 of the 4"));
    }

    #[test]
    fn pictures_of_other_targets_are_told_at_other_sizes() {
        let resized = thumbnail(&view(1, 1), 120, 60);
        let own = thumbnail(&view(0, 0), 120, 60);
        let other = [(ShownTarget::Next, view(1, 0))].into_iter();
        assert_eq!(
            shown_target(&own, &resized, None, other),
            Some(ShownTarget::Next)
        );
    }
}
