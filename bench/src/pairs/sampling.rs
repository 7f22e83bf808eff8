//! Sampling of a dataset's qualified pairs: the paper's `min(512, #pairs)`.

use std::collections::BTreeMap;

use clap::ValueEnum;
use sharp::random::SplitMix64;

use super::pair_list::ResolvedPair;

/// Rule for drawing pairs when there are more than the limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SamplingRule {
    /// Uniformly without replacement: the list is sorted bytewise by pair id and shuffled by [`SplitMix64::shuffle`];
    /// the first entries are taken.
    Uniform,
    /// Round-robin over scenes in bytewise order, one pair each, until the limit is reached. Within a scene, pairs are
    /// drawn as for `Uniform`. All scenes draw consecutively from one generator.
    PerScene,
    /// Round-robin over ten bins of baseline, nearest first, one pair each, until the limit is reached. Bins have equal
    /// width from the smallest to the largest baseline. Within a bin, pairs are drawn as for `Uniform`. All bins draw
    /// consecutively from one generator.
    #[value(name = "stratified:baseline")]
    StratifiedBaseline,
    /// The first pairs in the order of their ids.
    First,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SamplingOptions {
    /// Maximum number of pairs per dataset; `None` for all.
    pub limit: Option<usize>,
    pub rule: SamplingRule,
    /// Seed for drawing pairs; every dataset uses the same seed.
    pub seed: u64,
}

impl Default for SamplingOptions {
    /// At most 512 pairs, drawn uniformly with seed 0.
    fn default() -> Self {
        Self {
            limit: Some(512),
            rule: SamplingRule::Uniform,
            seed: 0,
        }
    }
}

/// Draws pairs of one dataset. `pairs` contains each pair's scene and baseline in metres, sorted bytewise by pair id.
/// Returns whether each pair was drawn.
pub fn sample(pairs: &[(&str, f64)], options: &SamplingOptions) -> Vec<bool> {
    let n = pairs.len();
    let limit = options.limit.unwrap_or(n);
    if n <= limit {
        return vec![true; n];
    }
    let mut generator = SplitMix64::new(options.seed);
    let order: Vec<usize> = match options.rule {
        SamplingRule::First => (0..n).collect(),
        SamplingRule::Uniform => {
            let mut order: Vec<usize> = (0..n).collect();
            generator.shuffle(&mut order);
            order
        }
        SamplingRule::PerScene | SamplingRule::StratifiedBaseline => {
            let mut groups = match options.rule {
                SamplingRule::PerScene => grouped(pairs.iter().map(|(scene, _)| *scene)),
                _ => grouped(strata(pairs)),
            };
            for group in &mut groups {
                generator.shuffle(group);
            }
            in_turn(&groups)
        }
    };
    let mut selected = vec![false; n];
    for &i in &order[..limit] {
        selected[i] = true;
    }
    selected
}

/// Chooses at most `limit` pairs of a list, taking turns over datasets and, within a dataset, over its scenes. Scenes,
/// and the pairs of a scene, are shuffled first. The choice for a smaller limit is a subset of that for a larger one.
pub fn spread<'a>(pairs: &[ResolvedPair<'a>], limit: usize) -> Vec<ResolvedPair<'a>> {
    let names = pairs.iter().map(|p| (&*p.pair.dataset, &*p.pair.scene));
    let chosen = spread_positions(&names.collect::<Vec<_>>(), limit);
    chosen.into_iter().map(|i| pairs[i]).collect()
}

/// Ascending indices of the chosen pairs, given each pair's dataset and scene.
fn spread_positions(names: &[(&str, &str)], limit: usize) -> Vec<usize> {
    let in_dataset = |members: Vec<usize>| {
        let mut generator = SplitMix64::new(0);
        let mut by_scene = grouped(members.iter().map(|&i| names[i].1));
        generator.shuffle(&mut by_scene);
        for scene in &mut by_scene {
            generator.shuffle(scene);
        }
        in_turn(&by_scene).into_iter().map(|i| members[i]).collect()
    };
    let datasets = grouped(names.iter().map(|(dataset, _)| *dataset));
    let orders: Vec<Vec<usize>> = datasets.into_iter().map(in_dataset).collect();
    let mut chosen = in_turn(&orders);
    chosen.truncate(limit);
    chosen.sort_unstable();
    chosen
}

const STRATA: usize = 10;

/// Bin of each pair's baseline; the largest baseline is in the last bin.
fn strata<'a>(pairs: &'a [(&str, f64)]) -> impl Iterator<Item = usize> + 'a {
    let all = || pairs.iter().map(|(_, metres)| *metres);
    let least = all().fold(f64::INFINITY, f64::min);
    let span = all().fold(f64::NEG_INFINITY, f64::max) - least;
    // If all baselines are equal or NaN, the quotient is NaN, which is converted to 0, the first bin.
    let bin = move |metres: f64| ((metres - least) / span * STRATA as f64) as usize;
    all().map(move |metres| bin(metres).min(STRATA - 1))
}

/// Indices grouped by key, keys ascending.
fn grouped<K: Ord>(keys: impl Iterator<Item = K>) -> Vec<Vec<usize>> {
    let mut groups: BTreeMap<K, Vec<usize>> = BTreeMap::new();
    for (i, key) in keys.enumerate() {
        groups.entry(key).or_default().push(i);
    }
    groups.into_values().collect()
}

/// Interleaves groups: the first of each, then the second of each, and so on.
fn in_turn(groups: &[Vec<usize>]) -> Vec<usize> {
    let rounds = groups.iter().map(Vec::len).max().unwrap_or(0);
    let round = |round| groups.iter().filter_map(move |group| group.get(round));
    (0..rounds).flat_map(round).copied().collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn chosen(scenes: &[&str], limit: usize, rule: SamplingRule, seed: u64) -> Vec<usize> {
        let options = SamplingOptions {
            limit: Some(limit),
            rule,
            seed,
        };
        let pairs: Vec<(&str, f64)> = scenes.iter().map(|scene| (*scene, 0.1)).collect();
        let selected = sample(&pairs, &options);
        (0..scenes.len()).filter(|&i| selected[i]).collect()
    }

    #[test]
    fn every_bin_of_baseline_gets_its_share() {
        // Ninety near pairs, two half-way, one far: 0.1 m to 1.1 m, in bins of 0.1 m.
        let mut metres = vec![0.1; 90];
        metres.extend([0.65, 0.68, 1.1]);
        let pairs: Vec<(&str, f64)> = metres.iter().map(|m| ("s", *m)).collect();
        let drawn = |limit| {
            let options = SamplingOptions {
                limit: Some(limit),
                rule: SamplingRule::StratifiedBaseline,
                seed: 0,
            };
            let selected = sample(&pairs, &options);
            let near = selected[..90].iter().filter(|s| **s).count();
            let half_way = selected[90..92].iter().filter(|s| **s).count();
            (near, half_way, selected[92])
        };
        assert_eq!(drawn(1), (1, 0, false));
        assert_eq!(drawn(3), (1, 1, true));
        assert_eq!(drawn(5), (2, 2, true));
        assert_eq!(drawn(10), (7, 2, true));
    }

    #[test]
    fn no_more_than_the_limit_and_no_fewer_than_there_are() {
        let scenes = vec!["s"; 600];
        for rule in [
            SamplingRule::Uniform,
            SamplingRule::PerScene,
            SamplingRule::StratifiedBaseline,
            SamplingRule::First,
        ] {
            assert_eq!(chosen(&scenes, 512, rule, 0).len(), 512);
            assert_eq!(chosen(&scenes[..512], 512, rule, 0).len(), 512);
            assert_eq!(chosen(&scenes[..3], 512, rule, 0), [0, 1, 2]);
            assert!(chosen(&scenes, 0, rule, 0).is_empty());
        }
    }

    #[test]
    fn the_uniform_draw_is_the_documented_one() {
        // An independent implementation of the shuffle of 0..10 begins with 5, 1, 9.
        assert_eq!(chosen(&["s"; 10], 3, SamplingRule::Uniform, 0), [1, 5, 9]);
        // The same for 0..7 with seed 3: 2, 4, 6.
        assert_eq!(chosen(&["s"; 7], 3, SamplingRule::Uniform, 3), [2, 4, 6]);
    }

    #[test]
    fn a_limit_spreads_over_datasets_and_scenes_and_holds_smaller_ones() {
        let mut names = vec![("a", "large"); 50];
        names.extend([("a", "small"), ("b", "one"), ("b", "one"), ("b", "two")]);
        let chosen = |limit| spread_positions(&names, limit);
        let scenes = |limit| -> BTreeSet<_> { chosen(limit).iter().map(|&i| names[i]).collect() };
        assert_eq!(
            scenes(2).iter().map(|(d, _)| d).collect::<Vec<_>>(),
            [&"a", &"b"]
        );
        assert_eq!(scenes(4).len(), 4);
        // Pairs are shuffled, so the pair drawn from the large scene is not its first.
        assert_ne!(chosen(4)[0], 0);
        for limit in 1..names.len() {
            let (less, more) = (chosen(limit), chosen(limit + 1));
            assert_eq!((less.len(), more.len()), (limit, limit + 1));
            assert!(less.iter().all(|i| more.contains(i)), "{limit}");
        }
        assert_eq!(chosen(100).len(), names.len());
    }

    #[test]
    fn balanced_sampling_gives_small_scenes_their_share() {
        let mut scenes = vec!["large"; 100];
        scenes.extend(["small"; 4]);
        let drawn = chosen(&scenes, 10, SamplingRule::PerScene, 0);
        assert_eq!(drawn.iter().filter(|&&i| i >= 100).count(), 4);
        assert_eq!(chosen(&scenes, 3, SamplingRule::First, 0), [0, 1, 2]);
    }
}
