//! Options to text and back.

use super::*;

#[test]
fn the_defaults_read_as_documented() {
    assert_eq!(
        PairOptions::default().to_string(),
        "sets=consecutive,size=10,remainder=keep,max-sets=all,order=both,missing-depth=reject,\
         overlap=auto,test=consistent:0.05,lookup=nearest,denominator=valid,stride=1,max-side=full,\
         direction=target-in-source,threshold=0.6,at-threshold=out,min-baseline=0,max-baseline=none,limit=512,\
         sampling=uniform,seed=0"
    );
    assert_eq!("".parse::<PairOptions>().unwrap(), PairOptions::default());
}

#[test]
fn every_value_survives_the_text_form() {
    for text in [
        "sets=strided,size=7,remainder=drop,max-sets=3,order=once",
        "sets=random:18446744073709551615,missing-depth=accept,test=frustum",
        "sets=whole,missing-depth=leave-out,test=map-anything,lookup=bilinear",
        "test=absolute:0.25:0.01:0,denominator=all,stride=4,max-side=512",
        "test=consistent:0.1,denominator=valid-other,direction=source-in-target",
        "overlap=sparse,test=consistent:0.1",
        "overlap=sparse:3,max-side=100",
        "overlap=given,lookup=window:4",
        "overlap=given-metric",
        "overlap=sharp-release",
        "overlap=depth-pro",
        "direction=min,threshold=0.333333333333333314829616256247",
        "direction=mean,at-threshold=in,min-baseline=1e-9,limit=all,sampling=per-scene",
        "direction=max,sampling=first,seed=12,limit=0",
        "max-baseline=0.5,min-baseline=0.5,sampling=stratified:baseline",
    ] {
        let options: PairOptions = text.parse().unwrap();
        assert_ne!(options, PairOptions::default());
        let back: PairOptions = options.to_string().parse().unwrap();
        assert_eq!(back, options, "{text}");
        let json = serde_json::to_string(&options).unwrap();
        assert_eq!(serde_json::from_str::<PairOptions>(&json).unwrap(), options);
    }
}

#[test]
fn nonsense_is_refused_with_the_key() {
    for (text, part) in [
        ("size=1", "size"),
        ("size", "key=value"),
        ("sise=3", "known: sets, size"),
        ("sets=random", "consecutive, strided, whole"),
        ("threshold=NaN", "threshold"),
        ("threshold=-0.1", "threshold"),
        ("test=consistent:inf", "test"),
        ("test=consistent", "consistent:RELATIVE"),
        ("overlap=monodepth", "sharp-release"),
        ("overlap=sparse:x", "overlap"),
        ("overlap=sparse,lookup=bilinear", "lookup"),
        ("stride=0", "stride"),
        ("max-baseline=0.1,min-baseline=0.2", "max-baseline"),
        ("max-baseline=inf", "max-baseline"),
        ("sampling=stratified", "stratified:baseline"),
        ("max-side=0", "max-side"),
        ("limit=-1", "limit"),
        ("seed=0,seed=1", "twice"),
    ] {
        let error = text.parse::<PairOptions>().unwrap_err().to_string();
        assert!(error.contains(part), "{text}: {error}");
    }
}

#[test]
fn the_threshold_is_strict_unless_told() {
    let strict = PairOptions::default();
    assert!(!strict.overlap_qualifies(0.6, 1.0));
    assert!(strict.overlap_qualifies(0.600_000_1, 0.0));
    let inclusive: PairOptions = "at-threshold=in,direction=min".parse().unwrap();
    assert!(inclusive.overlap_qualifies(0.6, 0.7));
    assert!(!inclusive.overlap_qualifies(0.7, 0.59));
}

#[test]
fn directions() {
    let all = OverlapDirection::value_variants()
        .iter()
        .map(|d| d.of(0.25, 0.75))
        .collect::<Vec<_>>();
    assert_eq!(all, [0.25, 0.75, 0.25, 0.5, 0.75]);
}

#[test]
fn help_names_every_key_with_values_and_default() {
    let help = PairOptions::help();
    for (key, default) in PairOptions::default().entries() {
        let mut lines = help.lines();
        let line = lines.find(|line| line.split_whitespace().next() == Some(key));
        assert!(line.is_some(), "{key} is not in\n{help}");
        let next = lines.next().unwrap_or_default();
        assert!(next.contains(&format!("default {default}; ")), "{next}");
    }
    for words in [
        "consecutive, strided, whole, random:SEED",
        "all or a number",
        "reject, accept, leave-out",
    ] {
        assert!(help.contains(words), "{help}");
    }
}
