//! Pair lists as published by other projects, and their contents. They may not be part of this
//! repository; without the folder given by `SHARP_BENCH_SHARED`, the tests are reported as ignored.

use libtest_mimic::{Arguments, Trial};
use sharp_bench::pairs::foreign::{ForeignCounts, ForeignList, ListForm};
use sharp_tests::rows;

/// Files, then entries, entries with pairs, targets, and targets that are also inputs.
const LISTS: &str = "\
pixelsplat/evaluation_index_re10k.json | 7194 | 6474 | 19422 | 583
pixelsplat/evaluation_index_acid.json | 1848 | 1595 | 4785 | 135
mvsplat/evaluation_index_dtu_nctx2.json | 64 | 64 | 64 | 0
mvsplat/evaluation_index_dtu_nctx3.json | 64 | 64 | 64 | 0
depthsplat/dl3dv_start_0_distance_10_ctx_2v_tgt_4v.json | 140 | 140 | 560 | 0
depthsplat/dl3dv_start_0_distance_50_ctx_2v_video_0_50.json | 140 | 140 | 7000 | 280
depthsplat/dl3dv_start_0_distance_100_ctx_12v_video.json | 140 | 140 | 13734 | 1680
mine/input_pipelines__realestate10k__test_data_jsons__validation_pairs.json | 250 | 250 | 750 | 9";

fn main() {
    let folder = sharp_tests::shared_data().join("samples/peer-index");
    let trials = rows(LISTS).map(|[name, counts @ ..]: [&str; 5]| {
        let form = if name.starts_with("mine/") {
            ListForm::Mine
        } else {
            ListForm::Index
        };
        let path = folder.join(name);
        let absent = !path.is_file();
        let check = move || {
            let list = ForeignList::read(&path, form)?;
            let ForeignCounts {
                entries,
                with_pairs,
                targets,
                targets_that_are_inputs,
            } = list.counts();
            let found = [entries, with_pairs, targets, targets_that_are_inputs];
            assert_eq!(found.map(|count| count.to_string()), counts);
            Ok(())
        };
        Trial::test(name, check).with_ignored_flag(absent)
    });
    libtest_mimic::run(&Arguments::from_args(), trials.collect()).exit();
}
