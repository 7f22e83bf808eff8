//! Detects pictures stored under the names of other pairs, by comparing some of them with those pairs' targets.
//!
//! Poor predictions must not raise false alarms, nor pictures with too little motion: a picture has to show another
//! target significantly better than its own, and better than the source's photograph does, for most of the compared
//! pictures. Scores do not depend on this check.

use std::collections::BTreeMap;

use image::RgbImage;
use sharp_datasets::View;

use super::finding::ShownTarget;
use super::gaussians::likeness::Likeness;
use super::picture_check::shrunk;
use super::record::Record;
use crate::pairs::pair_list::ResolvedPair;
use crate::scoring::Region;

/// Number of pairs per dataset whose pictures are compared, evenly spaced, and number of other targets for each.
const SAMPLED: usize = 8;
const OTHERS: usize = 12;
/// Minimum number of pictures in a dataset that must show other targets.
const FEWEST: usize = 3;
/// Minimum gain of another target, dB.
const LEAST_GAIN: f64 = 2.0;

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
    let fit = |seen: &RgbImage, shown: &RgbImage| {
        let is_same_size = seen.dimensions() == shown.dimensions();
        is_same_size.then(|| Likeness::of(seen, Region::whole(seen.dimensions()), shown))
    };
    let Some(own) = fit(&seen, &shown) else {
        return;
    };
    let is_other = |other: &ResolvedPair<'_>| {
        let is_own_scene = other.scene.id == planned.scene.id;
        !(is_own_scene && [&planned.source.id, &planned.target.id].contains(&&other.target.id))
    };
    let mut best: Option<(ShownTarget, Likeness)> = None;
    for (place, other) in others.iter().filter(|(_, other)| is_other(other)) {
        let Some(seen) = read.of(other, other.target) else {
            continue;
        };
        if let Some(other) = fit(&seen, &shown)
            && other.is_better_than(&own)
            && other.gain_over(&own) >= LEAST_GAIN
            && fit(&seen, &source).is_none_or(|copied| other.is_closer_than(&copied))
            && best.as_ref().is_none_or(|(_, b)| other.error() < b.error())
        {
            best = Some((*place, other));
        }
    }
    let found = best.map_or(ShownTarget::Own, |(place, _)| place);
    record.shows = Some(found);
}

/// A sentence for each dataset in which most compared pictures show other targets.
pub(super) fn misplaced_pictures<'a>(records: impl Iterator<Item = &'a Record>) -> Vec<String> {
    let mut by_dataset: BTreeMap<&str, BTreeMap<ShownTarget, usize>> = BTreeMap::new();
    for record in records {
        if let Some(found) = record.shows {
            let of_dataset = by_dataset.entry(&record.dataset).or_default();
            *of_dataset.entry(found).or_default() += 1;
        }
    }
    let told = by_dataset.into_iter().filter_map(|(dataset, found)| {
        let count = |places: &[ShownTarget]| -> usize {
            places.iter().filter_map(|place| found.get(place)).sum()
        };
        let (all, others) = (
            count(&[ShownTarget::Own, ShownTarget::Previous, ShownTarget::Next, ShownTarget::Other]),
            count(&[ShownTarget::Previous, ShownTarget::Next, ShownTarget::Other]),
        );
        let (shift, shifted) = [ShownTarget::Previous, ShownTarget::Next]
            .map(|place| (place, count(&[place])))
            .into_iter()
            .max_by_key(|(_, count)| *count)?;
        let is_most = |count: usize| count >= FEWEST && 2 * count > all;
        let (what, count) = match is_most(shifted) {
            true => (shift, shifted),
            false => (ShownTarget::Other, others),
        };
        is_most(count).then(|| {
            format!(
                "its pictures look as if they had the names of other pairs of {dataset}: {count} of the {all} \
                 compared show {} significantly better than their own; correct the file names",
                what.text()
            )
        })
    });
    told.collect()
}
