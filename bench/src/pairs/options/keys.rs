//! The keys of the text form: reading, writing and help are driven by this table.

use super::PairOptions;
use super::text::{
    AT_THRESHOLD, DENOMINATORS, DEPTHS, DIRECTIONS, GROUPINGS, LOOKUPS, MISSING_DEPTHS, ORDERS,
    REMAINDERS, SAMPLINGS, TESTS, expected, name_of, names, number, number_unless, or, parse_depth,
    parse_test, test_text, word,
};
use crate::pairs::PairError;
use crate::pairs::overlap::DepthLookup;
use crate::pairs::sets::Grouping;

/// One choice.
pub(super) struct Key {
    /// As written before `=`.
    pub(super) name: &'static str,
    /// The values that it takes, in words.
    pub(super) values: fn() -> String,
    /// What it decides.
    pub(super) meaning: &'static str,
    /// The value in force, as text.
    pub(super) get: fn(&PairOptions) -> String,
    /// Takes `(options, key, value)`.
    pub(super) set: fn(&mut PairOptions, &str, &str) -> Result<(), PairError>,
}

/// In the order of the text form.
pub(super) const KEYS: [Key; 19] = [
    Key {
        name: "sets",
        values: || format!("{}, random:SEED", names(&GROUPINGS)),
        meaning: "which views of a scene share a set; pairs are formed within sets",
        get: |o| match o.sets.grouping {
            Grouping::Random { seed } => format!("random:{seed}"),
            other => name_of(&GROUPINGS, &other),
        },
        set: |o, key, text| {
            o.sets.grouping = match text.split_once(':') {
                Some(("random", seed)) => Grouping::Random {
                    seed: number(key, seed)?,
                },
                _ => word(key, text, &GROUPINGS).map_err(|_| {
                    let values = format!("one of {}, random:SEED", names(&GROUPINGS));
                    expected(key, text, &values)
                })?,
            };
            Ok(())
        },
    },
    Key {
        name: "size",
        values: || "a number from 2".to_owned(),
        meaning: "views in a set",
        get: |o| o.sets.size.to_string(),
        set: |o, key, text| number(key, text).map(|v| o.sets.size = v),
    },
    Key {
        name: "remainder",
        values: || names(&REMAINDERS),
        meaning: "a last set with fewer views than the others",
        get: |o| name_of(&REMAINDERS, &o.sets.remainder),
        set: |o, key, text| word(key, text, &REMAINDERS).map(|v| o.sets.remainder = v),
    },
    Key {
        name: "max-sets",
        values: || "all or a number".to_owned(),
        meaning: "sets of a scene that are used, the first ones",
        get: |o| or(o.sets.max_sets, "all"),
        set: |o, key, text| number_unless(key, text, "all").map(|v| o.sets.max_sets = v),
    },
    Key {
        name: "order",
        values: || names(&ORDERS),
        meaning: "both directions between two views, or only from the earlier to the later one",
        get: |o| name_of(&ORDERS, &o.order),
        set: |o, key, text| word(key, text, &ORDERS).map(|v| o.order = v),
    },
    Key {
        name: "missing-depth",
        values: || names(&MISSING_DEPTHS),
        meaning: "views without depth: join no pair, join pairs without an overlap, or leave before sets are formed",
        get: |o| name_of(&MISSING_DEPTHS, &o.missing_depth),
        set: |o, key, text| word(key, text, &MISSING_DEPTHS).map(|v| o.missing_depth = v),
    },
    Key {
        name: "overlap",
        values: || DEPTHS.to_owned(),
        meaning: "whose depth decides overlap; sparse alone is sparse:8",
        get: |o| o.depth.to_string(),
        set: |o, key, text| parse_depth(key, text).map(|v| o.depth = v),
    },
    Key {
        name: "test",
        values: || TESTS.to_owned(),
        meaning: "when a projected pixel counts as seen: depth within a share of z, inside the picture, or within metres and a share",
        get: |o| test_text(&o.overlap.test),
        set: |o, key, text| parse_test(key, text).map(|v| o.overlap.test = v),
    },
    Key {
        name: "lookup",
        values: || format!("{}, window:PIXELS", names(&LOOKUPS)),
        meaning: "how the other view's depth is read where a pixel lands",
        get: |o| match o.overlap.lookup {
            DepthLookup::Window { radius } => format!("window:{radius}"),
            other => name_of(&LOOKUPS, &other),
        },
        set: |o, key, text| {
            o.overlap.lookup = match text.split_once(':') {
                Some(("window", radius)) => DepthLookup::Window {
                    radius: number(key, radius)?,
                },
                _ => word(key, text, &LOOKUPS)?,
            };
            Ok(())
        },
    },
    Key {
        name: "denominator",
        values: || names(&DENOMINATORS),
        meaning: "what seen pixels are divided by: those with depth, all, or those with depth of the other view",
        get: |o| name_of(&DENOMINATORS, &o.overlap.denominator),
        set: |o, key, text| word(key, text, &DENOMINATORS).map(|v| o.overlap.denominator = v),
    },
    Key {
        name: "stride",
        values: || "a number from 1".to_owned(),
        meaning: "every so many pixels and rows are projected",
        get: |o| o.overlap.stride.to_string(),
        set: |o, key, text| number(key, text).map(|v| o.overlap.stride = v),
    },
    Key {
        name: "max-side",
        values: || "full or a number".to_owned(),
        meaning: "longer side that depth maps are reduced to first, pixels",
        get: |o| or(o.overlap.max_side, "full"),
        set: |o, key, text| number_unless(key, text, "full").map(|v| o.overlap.max_side = v),
    },
    Key {
        name: "direction",
        values: || names(&DIRECTIONS),
        meaning: "which of a pair's two overlaps the threshold looks at",
        get: |o| name_of(&DIRECTIONS, &o.direction),
        set: |o, key, text| word(key, text, &DIRECTIONS).map(|v| o.direction = v),
    },
    Key {
        name: "threshold",
        values: || "a number from 0".to_owned(),
        meaning: "least overlap",
        get: |o| o.threshold.to_string(),
        set: |o, key, text| number(key, text).map(|v| o.threshold = v),
    },
    Key {
        name: "at-threshold",
        values: || names(&AT_THRESHOLD),
        meaning: "whether an overlap equal to the threshold qualifies",
        get: |o| name_of(&AT_THRESHOLD, &o.threshold_qualifies),
        set: |o, key, text| word(key, text, &AT_THRESHOLD).map(|v| o.threshold_qualifies = v),
    },
    Key {
        name: "min-baseline",
        values: || "a number from 0".to_owned(),
        meaning: "least distance of the two cameras, metres; equal qualifies",
        get: |o| o.min_baseline_m.to_string(),
        set: |o, key, text| number(key, text).map(|v| o.min_baseline_m = v),
    },
    Key {
        name: "limit",
        values: || "all or a number".to_owned(),
        meaning: "pairs of a dataset that are evaluated",
        get: |o| or(o.sampling.limit, "all"),
        set: |o, key, text| number_unless(key, text, "all").map(|v| o.sampling.limit = v),
    },
    Key {
        name: "sampling",
        values: || names(&SAMPLINGS),
        meaning: "how they are drawn: from all, from each scene in turn, or the first ones by id",
        get: |o| name_of(&SAMPLINGS, &o.sampling.rule),
        set: |o, key, text| word(key, text, &SAMPLINGS).map(|v| o.sampling.rule = v),
    },
    Key {
        name: "seed",
        values: || "a number".to_owned(),
        meaning: "of the draw",
        get: |o| o.sampling.seed.to_string(),
        set: |o, key, text| number(key, text).map(|v| o.sampling.seed = v),
    },
];
