//! Chooses some pictures of each dataset, and some of each scene, and the other targets that they are compared with.

use std::collections::{BTreeMap, BTreeSet};

use super::finding::ShownTarget;
use super::group::scenes;
use crate::pairs::pair_list::ResolvedPair;

/// Number of pairs per dataset whose pictures are compared, evenly spaced.
const SAMPLED: usize = 8;
/// Number of pairs per dataset whose pictures' shift is measured, evenly spaced. No picture shows a shift along its
/// epipolar lines, and the lines of fewer pairs may all have one direction.
const SHIFTS_MEASURED: usize = 24;
/// Number of pairs per scene whose pictures are compared in addition, evenly spaced.
const SAMPLED_IN_SCENE: usize = 6;
/// Maximum number of scenes per dataset that are sampled in addition, evenly spaced. Saves time.
const MAX_SCENES: usize = 32;
/// Number of other targets with which each sampled picture is compared.
const OTHERS: usize = 12;
/// Minimum number of pictures for a comparison, and of affected pictures for a finding.
pub(super) const FEWEST: usize = 3;

/// The pairs whose pictures are compared with more than their own target, by id.
#[derive(Default)]
pub(crate) struct PictureSample<'a> {
    /// For each of these pairs, the other pairs whose targets its picture is compared with.
    pub(super) others: BTreeMap<String, Vec<(ShownTarget, ResolvedPair<'a>)>>,
    /// Pairs whose pictures' shift is measured, chosen independently of `others`.
    pub(super) shifts: BTreeSet<String>,
}

/// Chooses the pairs whose pictures are compared. `pairs` must be all pairs of the plan, so that all shards choose the
/// same pictures.
pub(crate) fn compared_pairs<'a>(pairs: &[ResolvedPair<'a>]) -> PictureSample<'a> {
    let mut datasets: BTreeMap<&str, Vec<ResolvedPair<'a>>> = BTreeMap::new();
    for planned in pairs {
        let of_dataset = datasets.entry(&planned.scene.dataset).or_default();
        of_dataset.push(*planned);
    }
    let mut sample = PictureSample::default();
    for all in datasets.into_values() {
        let id = |at: usize| all[at].pair.pair_id.clone();
        let names = all.iter().map(|of| [&*of.scene.id, &*of.target.id]);
        for (at, others) in compared_pictures(&names.collect::<Vec<_>>()) {
            let others = others.into_iter().map(|(place, k)| (place, all[k]));
            sample.others.insert(id(at), others.collect());
        }
        if all.len() >= FEWEST {
            let measured = spread(all.len(), SHIFTS_MEASURED).map(id);
            sample.shifts.extend(measured);
        }
    }
    sample
}

/// For each picture to compare, by index, the indices of the pictures whose targets it is compared with. `targets`
/// lists the scene and the target of each picture.
pub(crate) fn compared_pictures(
    targets: &[[&str; 2]],
) -> BTreeMap<usize, Vec<(ShownTarget, usize)>> {
    let count = targets.len();
    if count < FEWEST {
        return BTreeMap::new();
    }
    let mut distinct = BTreeMap::new();
    for (at, target) in targets.iter().enumerate() {
        distinct.entry(target).or_insert(at);
    }
    let others = |at: usize| {
        let neighbours = [
            (ShownTarget::Previous, (at + count - 1) % count),
            (ShownTarget::Next, (at + 1) % count),
        ];
        let is_near = |other: &usize| targets[*other][0] == targets[at][0];
        let (near, far): (Vec<usize>, Vec<usize>) = distinct.values().partition(|k| is_near(k));
        let far_ones = OTHERS.saturating_sub(near.len());
        let near = spread(near.len(), OTHERS).map(|k| near[k]);
        let elsewhere = near.chain(spread(far.len(), far_ones).map(|k| far[k]));
        let elsewhere = elsewhere.map(|other| (ShownTarget::Other, other));
        let all = neighbours.into_iter().chain(elsewhere);
        all.filter(|(_, other)| *other != at).collect()
    };
    let sampled = sampled(targets.iter().map(|[scene, _]| *scene));
    sampled.into_iter().map(|at| (at, others(at))).collect()
}

/// Indices of the pictures to compare, given the scene of each picture.
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

/// At most `most` of `count` indices, about evenly spaced. The spacing varies, because equal steps through the pairs
/// could always reach the same target.
fn spread(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let n = count.min(most);
    (0..n).map(move |k| k * count / n + k % (count / n).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_sampled_and_compared_with_itself_first() {
        let names: Vec<String> = (0..30).map(|k| k.to_string()).collect();
        let scenes = ["a", "b", "c"];
        let targets = names.iter().enumerate();
        let targets: Vec<[&str; 2]> = targets.map(|(k, name)| [scenes[k / 10], name]).collect();
        let compared = compared_pictures(&targets);
        for scene in 0..3 {
            let of_scene = compared.keys().filter(|at| *at / 10 == scene);
            assert!(of_scene.count() >= SAMPLED_IN_SCENE, "{scene}");
        }
        for (at, others) in &compared {
            assert!(others.iter().all(|(_, other)| other != at));
            let near = others.iter().filter(|(_, other)| other / 10 == at / 10);
            let near: BTreeSet<usize> = near.map(|(_, other)| *other).collect();
            assert_eq!(near.len(), 9, "{at}");
        }
        // Two pairs with one target are compared with it once.
        let [one, other] = [["a", "0"], ["a", "1"]];
        let repeated = compared_pictures(&[one, one, one, one, other]);
        let elsewhere = repeated[&0]
            .iter()
            .filter(|(place, _)| *place == ShownTarget::Other);
        assert_eq!(elsewhere.collect::<Vec<_>>(), [&(ShownTarget::Other, 4)]);
    }
}
