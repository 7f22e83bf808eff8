//! Chooses the pictures that are compared with other targets than their own, and these targets: some of each dataset, and
//! some of each of its scenes.

use std::collections::{BTreeMap, BTreeSet};

use super::finding::ShownTarget;
use super::picture_group::scenes;
use crate::pairs::pair_list::ResolvedPair;

/// Number of pairs per dataset whose pictures are compared, evenly spaced.
const SAMPLED: usize = 8;
/// Number of pairs per scene whose pictures are compared in addition, evenly spaced.
const SAMPLED_IN_SCENE: usize = 6;
/// Only at most this many scenes of a dataset are sampled in addition, evenly spaced, to save time.
const MAX_SCENES: usize = 32;
/// Number of other targets that each of these pictures is compared with.
const OTHERS: usize = 12;
/// Nothing is compared among fewer pictures than this, and no finding that fewer have is reported.
pub(super) const FEWEST: usize = 3;

/// For each pair, the other pairs whose targets its picture is compared with.
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
        for at in sampled(all.iter().map(|planned| planned.scene.id.as_str())) {
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

/// Which pictures are compared, given the scene of each.
fn sampled<'a>(scene_of: impl ExactSizeIterator<Item = &'a str>) -> BTreeSet<usize> {
    let all = spread(scene_of.len(), SAMPLED);
    let scenes = scenes(scene_of.zip(0..));
    let scenes: Vec<&Vec<usize>> = scenes.values().collect();
    let in_scenes = spread(scenes.len(), MAX_SCENES).flat_map(|scene| {
        let pictures = scenes[scene];
        spread(pictures.len(), SAMPLED_IN_SCENE).map(|k| pictures[k])
    });
    all.chain(in_scenes).collect()
}

/// At most `most` of `count` indices, about evenly spaced. The distances vary, because with equal ones all pictures
/// could have the same target.
fn spread(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let n = count.min(most);
    (0..n).map(move |k| k * count / n + k % (count / n).max(1))
}

/// Which pictures of a folder are compared, and with whose targets, as in [`compared_pairs`]. `scene_of` lists the
/// scene of each picture.
pub(crate) fn compared_pictures(scene_of: &[&str]) -> BTreeMap<usize, Vec<(ShownTarget, usize)>> {
    let count = scene_of.len();
    if count < FEWEST {
        return BTreeMap::new();
    }
    let others = |at: usize| {
        let neighbours = [
            (ShownTarget::Previous, (at + count - 1) % count),
            (ShownTarget::Next, (at + 1) % count),
        ];
        let is_near = |other: &usize| scene_of[*other] == scene_of[at];
        let (near, far): (Vec<usize>, Vec<usize>) = (0..count).partition(is_near);
        let elsewhere = spread(near.len(), OTHERS).map(|k| near[k]);
        let far = spread(far.len(), OTHERS.saturating_sub(near.len())).map(|k| far[k]);
        let elsewhere = elsewhere
            .chain(far)
            .map(|other| (ShownTarget::Other, other));
        let all = neighbours.into_iter().chain(elsewhere);
        all.filter(|(_, other)| *other != at).collect()
    };
    let sampled = sampled(scene_of.iter().copied()).into_iter();
    sampled.map(|at| (at, others(at))).collect()
}
