//! Explains why a dataset has no pairs to evaluate, reports views that were left out, warns about depth that is too
//! sparse to choose pairs by, and suggests settings.

use sharp_datasets::DatasetSpec;

use crate::io::counts::counted;
use crate::pairs::PairOptions;
use crate::pairs::build::{PairCounts, Problem, SPARSE_DENSITY};

/// Suggested settings for datasets with sparse depth.
const DENSE: &str = "overlap=given with --overlap-depth DIR (dense depth of your own, scaled to the dataset's as in \
                     the paper), overlap=depth-pro or overlap=sharp-release (dense depth predicted by the \
                     checkpoint of that name, scaled in the same way), or overlap=sparse:8 (the dataset's depth, which \
                     must agree within 8 pixels)";

/// One line with the counts of a dataset's pairs.
pub fn counted_pairs(dataset: &str, counts: &PairCounts) -> String {
    format!(
        "{dataset}: {}, {}, {}, {}; without depth {}, too little overlap {}, too near {}, too far {}; {} qualify, {} selected",
        counted(counts.scenes, "scene"),
        counted(counts.views, "view"),
        counted(counts.sets, "set"),
        counted(counts.considered, "ordered pair"),
        counts.without_depth,
        counts.too_little_overlap,
        counts.too_near,
        counts.too_far,
        counts.qualified,
        counts.selected
    )
}

/// Advice for one dataset: on views that were left out (`broken`), on why no pair was selected, or on depth that is too
/// sparse for the options. Empty if there is nothing to say.
pub(super) fn advice(
    dataset: &DatasetSpec,
    counts: &PairCounts,
    broken: &[&Problem],
    options: &PairOptions,
) -> Vec<String> {
    let left_out = left_out(&dataset.name, counts, broken);
    // If every view is broken, changing the options cannot help.
    let is_all = counts.selected == 0 && counts.with_depth == 0 && left_out.is_some();
    let pairs = if is_all {
        None
    } else {
        of_pairs(dataset, counts, options)
    };
    left_out.into_iter().chain(pairs).collect()
}

fn of_pairs(dataset: &DatasetSpec, counts: &PairCounts, options: &PairOptions) -> Option<String> {
    let name = &dataset.name;
    if counts.selected > 0 {
        return sparse_pairs(counts, options).map(|note| format!("{name}: {note}"));
    }
    let sparse = counts.is_sparse() && options.depth.is_ground_truth();
    let why = if counts.qualified > 0 {
        format!(
            "limit={} selects no pair",
            options.sampling.limit.unwrap_or(0)
        )
    } else if counts.views > 0 && counts.with_depth == 0 && counts.too_near + counts.too_far == 0 {
        without_depth(dataset, options)
    } else if counts.considered == 0 {
        "no set has two views (the pair options sets=, size= and remainder= define the sets)"
            .to_owned()
    } else if counts.too_near + counts.too_far == counts.considered {
        let farthest = options.max_baseline_m.map_or_else(String::new, |most| {
            format!(" or farther apart than max-baseline={most}")
        });
        format!(
            "the cameras of all its pairs are closer than min-baseline={}{farthest}",
            options.min_baseline_m
        )
    } else if sparse {
        format!(
            "{}; choose one of these --pair-options: {DENSE}",
            sparseness(counts)
        )
    } else {
        format!(
            "no pair has an overlap above threshold={}; pixels without depth count as not overlapping, unless \
             overlap=sparse:8 finds depth near them; `pairs --ambiguity` counts the pairs under different options",
            options.threshold
        )
    };
    Some(format!("{}: {why}", counted_pairs(name, counts)))
}

/// Reports the views that were left out because their files cannot be read, and the number of pairs lost with them;
/// `None` if there are no such views.
fn left_out(name: &str, counts: &PairCounts, broken: &[&Problem]) -> Option<String> {
    let first =
        |problem: &&Problem| format!("{}/{} ({})", problem.scene, problem.view, problem.reason);
    let named: Vec<String> = broken.iter().take(NAMED).map(first).collect();
    let others = match broken.len() - named.len() {
        0 => String::new(),
        more => format!("; and {more} more"),
    };
    let pairs = match counts.unreadable {
        0 => format!("{} of {}", broken.len(), counted(counts.views, "view")),
        pairs => format!("{pairs} of {}", counted(counts.considered, "pair")),
    };
    (!broken.is_empty()).then(|| {
        let named = named.join("; ");
        format!("{name}: {pairs} are left out because views cannot be read: {named}{others}")
    })
}

/// Maximum number of left-out views listed by name.
const NAMED: usize = 3;

/// Warns if depth is so sparse that overlaps depend on few pixels.
pub(super) fn sparse_pairs(counts: &PairCounts, options: &PairOptions) -> Option<String> {
    let is_sparse = counts.is_sparse() && options.depth.is_ground_truth();
    is_sparse.then(|| {
        format!(
            "{}; better choices of --pair-options are {DENSE}",
            sparseness(counts)
        )
    })
}

fn sparseness(counts: &PairCounts) -> String {
    format!(
        "its depth is sparse (in {1} of {2} with depth, fewer than {0} % of the measured pixels have a measured \
         neighbour), but overlap=ground-truth needs depth at exactly the pixel where a point lands",
        100.0 * SPARSE_DENSITY,
        counts.with_sparse_depth,
        counted(counts.with_depth, "view")
    )
}

/// Advice for a dataset without depth: where depth could be obtained, or how to do without it.
fn without_depth(dataset: &DatasetSpec, options: &PairOptions) -> String {
    let (format, split) = (dataset.entry.format, dataset.setting("split"));
    if options.depth.is_ground_truth() && format == "scannetpp" && split.starts_with("nvs_test") {
        return format!(
            "no view has depth, because split={split} has no meshes (its targets are not public either); use \
             split=nvs_sem_val, which has both, or depth=points, which is sparse and needs one of these \
             --pair-options: {DENSE}"
        );
    }
    let scaled = if options.depth.is_ground_truth() {
        ""
    } else {
        ", which is needed, because depth from elsewhere is scaled to it (except with overlap=given-metric)"
    };
    format!(
        "no view has depth{scaled}; `datasets check` lists the missing files; if you cannot get them, use depth \
         maps of your own in metres (--pair-options overlap=given-metric with --overlap-depth DIR), or select pairs \
         without an overlap (--pair-options missing-depth=accept)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Advice for a dataset of 90 pairs from 10 views, given its counts of views with depth and
    /// with sparse depth.
    fn said(spec: &str, options: &str, counts: PairCounts) -> Option<String> {
        let counts = PairCounts {
            scenes: 1,
            views: 10,
            sets: 1,
            considered: 90,
            ..counts
        };
        let dataset = DatasetSpec::parse(&format!("D:{spec}")).unwrap();
        of_pairs(&dataset, &counts, &options.parse().unwrap())
    }

    #[test]
    fn views_that_are_left_out_are_named_and_nothing_else_is_advised_where_none_is_left() {
        let problem = |i: usize| Problem {
            dataset: "D".to_owned(),
            scene: "s".to_owned(),
            view: format!("v{i}"),
            reason: format!("{i}.png: truncated"),
            is_left_out: true,
        };
        let broken: Vec<Problem> = (0..10).map(problem).collect();
        let dataset = DatasetSpec::parse("D:colmap=/x").unwrap();
        let said = |broken: &[Problem], with_depth: usize, unreadable: usize| {
            let counts = PairCounts {
                views: 10,
                considered: 90,
                unreadable,
                without_depth: unreadable,
                ..depth(with_depth, 0)
            };
            let broken: Vec<&Problem> = broken.iter().collect();
            advice(&dataset, &counts, &broken, &PairOptions::default())
        };
        let all = said(&broken, 0, 90);
        assert_eq!(
            all,
            [
                "D: 90 of 90 pairs are left out because views cannot be read: s/v0 (0.png: truncated); s/v1 (1.png: \
                 truncated); s/v2 (2.png: truncated); and 7 more"
            ]
        );
        let one = said(&broken[..1], 9, 0);
        assert_eq!(
            one[0],
            "D: 1 of 10 views are left out because views cannot be read: s/v0 (0.png: truncated)"
        );
        assert!(one[1].contains("above threshold="), "{one:?}");
    }

    fn depth(with_depth: usize, with_sparse_depth: usize) -> PairCounts {
        PairCounts {
            with_depth,
            with_sparse_depth,
            ..PairCounts::default()
        }
    }

    #[test]
    fn sparse_depth_is_told_from_little_overlap() {
        let eth3d = said("eth3d=/x", "", depth(10, 9)).unwrap();
        for part in [
            "in 9 of 10 views with depth, fewer than 30 % of the measured pixels",
            "overlap=given with --overlap-depth",
            "sharp-release",
            "sparse:8",
        ] {
            assert!(eth3d.contains(part), "{eth3d}");
        }
        let dense = said("eth3d=/x", "threshold=0.9", depth(10, 5)).unwrap();
        assert!(dense.contains("above threshold=0.9"), "{dense}");
        let chosen = said("eth3d=/x", "overlap=sparse", depth(10, 10)).unwrap();
        assert!(chosen.contains("above threshold"), "{chosen}");
    }

    #[test]
    fn pairs_that_were_found_are_warned_of_only_where_depth_is_sparse() {
        let found = |counts: PairCounts| PairCounts {
            qualified: 5,
            selected: 5,
            ..counts
        };
        let sparse = said("eth3d=/x", "", found(depth(10, 10))).unwrap();
        assert!(sparse.contains("better choices"), "{sparse}");
        assert_eq!(
            said("eth3d=/x", "overlap=sparse", found(depth(10, 10))),
            None
        );
        assert_eq!(said("eth3d=/x", "", found(depth(10, 0))), None);
        // A stereo pair needs no depth.
        assert_eq!(said("middlebury=/x", "", found(depth(0, 0))), None);
    }

    #[test]
    fn every_other_reason_has_its_sentence() {
        let test = said("scannetpp=/x", "", depth(0, 0)).unwrap();
        assert!(test.contains("split=nvs_sem_val"), "{test}");
        assert!(test.contains("depth=points"), "{test}");
        let other = said("scannetpp=/x,split=nvs_sem_val", "", depth(0, 0)).unwrap();
        assert!(other.contains("given-metric"), "{other}");
        let scaled = said("eth3d=/x", "overlap=sharp-release", depth(0, 0)).unwrap();
        assert!(scaled.contains("is scaled to it"), "{scaled}");
        let near = PairCounts {
            too_near: 90,
            ..depth(0, 0)
        };
        let near = said("eth3d=/x", "min-baseline=3", near).unwrap();
        assert!(near.contains("closer than min-baseline=3"), "{near}");
        let limited = PairCounts {
            qualified: 5,
            ..depth(10, 0)
        };
        let limited = said("eth3d=/x", "limit=0", limited).unwrap();
        assert!(limited.contains("limit=0 selects no pair"), "{limited}");
        let no_set = PairCounts {
            views: 1,
            ..depth(1, 0)
        };
        let eth3d = DatasetSpec::parse("D:eth3d=/x").unwrap();
        let no_set = of_pairs(&eth3d, &no_set, &PairOptions::default()).unwrap();
        assert!(no_set.contains("no set has two views"), "{no_set}");
    }
}
