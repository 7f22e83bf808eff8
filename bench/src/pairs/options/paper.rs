//! Values that are known to differ from the paper's. Choices that the paper leaves open are not
//! listed.
//!
//! The paper states: sets of ten views; depth overlap above 60 %; predicted depth, scaled to the dataset's depth where
//! that is sparse; min(512, all) pairs; and for stereo datasets, the pair from every left frame to the right frame.

pub use sharp_datasets::spec::PaperOverlap;

use super::{MissingDepth, OverlapDepth, PairOptions};
use crate::pairs::sets::Grouping;

/// Mark shown with all settings that are known to differ from the paper.
pub const PROXY: &str = "proxy: differs from the paper";

fn is_papers(kind: PaperOverlap, depth: OverlapDepth) -> bool {
    match kind {
        PaperOverlap::Stereo => true,
        PaperOverlap::Dense => depth.is_ground_truth(),
        PaperOverlap::Sparse => matches!(depth, OverlapDepth::Given | OverlapDepth::DepthPro),
    }
}

/// The paper's maximum number of pairs per dataset.
const LIMIT: usize = 512;

/// Keys whose values are known to differ from the paper's for at least one kind of dataset in `kinds`, in the order of
/// the text form. `pairs` is the number of selected pairs.
fn differing(options: &PairOptions, kinds: &[PaperOverlap], pairs: usize) -> Vec<&'static str> {
    let stereo = kinds.iter().all(|kind| *kind == PaperOverlap::Stereo);
    // A limit that excludes no pair has the same effect as the paper's.
    let cut_otherwise = match options.sampling.limit {
        Some(limit) if limit < LIMIT => pairs >= limit,
        Some(LIMIT) => false,
        _ => !stereo && pairs > LIMIT,
    };
    let of_multi_view = [
        ("sets", options.sets.grouping == Grouping::Whole),
        ("size", options.sets.size != 10),
        (
            "missing-depth",
            options.missing_depth == MissingDepth::Accept,
        ),
        (
            "overlap",
            !kinds.iter().any(|kind| is_papers(*kind, options.depth)),
        ),
        ("threshold", options.threshold != 0.6),
        ("at-threshold", options.threshold_qualifies),
    ];
    let of_all = [
        ("min-baseline", options.min_baseline_m > 0.0),
        ("max-baseline", options.max_baseline_m.is_some()),
        ("limit", cut_otherwise),
    ];
    let all = of_multi_view.into_iter().filter(|_| !stereo).chain(of_all);
    all.filter(|(_, differs)| *differs)
        .map(|(key, _)| key)
        .collect()
}

impl PairOptions {
    /// The values that are known to differ from the paper's for datasets of one kind, as `key=value`. `pairs` is the
    /// number of selected pairs.
    pub fn proxies_on(&self, kind: PaperOverlap, pairs: usize) -> Vec<String> {
        self.named(&differing(self, &[kind], pairs))
    }

    /// The values that are known to differ from the paper's for any of its multi-view datasets, as `key=value`.
    pub fn proxies(&self) -> Vec<String> {
        self.named(&differing(
            self,
            &[PaperOverlap::Dense, PaperOverlap::Sparse],
            usize::MAX,
        ))
    }

    fn named(&self, keys: &[&str]) -> Vec<String> {
        let entries = self.entries().into_iter();
        let kept = entries.filter(|(key, _)| keys.contains(key));
        kept.map(|(key, value)| format!("{key}={value}")).collect()
    }
}

#[cfg(test)]
mod tests {
    use sharp_datasets::registry::entry;

    use super::*;

    fn proxies(text: &str) -> String {
        text.parse::<PairOptions>().unwrap().proxies().join(",")
    }

    #[test]
    fn what_the_paper_states_is_a_proxy_when_changed_and_what_it_leaves_open_is_not() {
        for stated in [
            "size=5",
            "sets=whole",
            "missing-depth=accept",
            "overlap=sparse:8",
            "overlap=sharp-release",
            "overlap=given-metric",
            "threshold=0.5",
            "at-threshold=in",
            "min-baseline=0.1",
            "max-baseline=2",
            "limit=all",
            "limit=100",
        ] {
            assert_eq!(proxies(stated), stated);
        }
        for open in [
            "",
            "sets=strided,remainder=drop,max-sets=3,order=once,missing-depth=leave-out",
            "overlap=given,test=frustum,denominator=all,stride=4,max-side=512,direction=min",
            "overlap=ground-truth,lookup=bilinear,sampling=per-scene,seed=3",
        ] {
            assert_eq!(proxies(open), "");
        }
    }

    #[test]
    fn kinds_of_datasets_differ() {
        let on = |text: &str, format: &str| {
            let options: PairOptions = text.parse().unwrap();
            options
                .proxies_on(entry(format).unwrap().paper_overlap, 24)
                .join(",")
        };
        assert_eq!(on("", "eth3d"), "overlap=auto");
        assert_eq!(on("overlap=ground-truth", "eth3d"), "overlap=ground-truth");
        assert_eq!(on("overlap=given", "tanks-and-temples"), "");
        assert_eq!(on("overlap=depth-pro", "eth3d"), "");
        assert_eq!(on("overlap=depth-pro", "scannetpp"), "overlap=depth-pro");
        assert_eq!(on("", "scannetpp"), "");
        assert_eq!(on("overlap=given", "wildrgbd"), "overlap=given");
        assert_eq!(on("size=5,overlap=sparse,limit=all", "middlebury"), "");
        assert_eq!(
            on("limit=20,min-baseline=1", "booster"),
            "min-baseline=1,limit=20"
        );
        // No pair was excluded.
        assert_eq!(on("limit=25", "booster"), "");
        assert_eq!(on("limit=all", "scannetpp"), "");
        assert_eq!(on("limit=24", "scannetpp"), "limit=24");
    }
}
