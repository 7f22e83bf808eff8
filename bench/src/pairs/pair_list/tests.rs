use super::super::build::{BuildContext, build_pairs};
use super::super::test_scene::{Depth, row};
use super::*;

fn scene() -> Scene {
    row("d,x", "s \"1\"", 0.1, &[Depth::Wall(2.0); 3]).scene
}

fn list() -> PairList {
    let options = "limit=4".parse().unwrap();
    let mut build = build_pairs(&[scene()], &options, &BuildContext::default()).unwrap();
    // Numbers that are easy to read.
    for (i, pair) in build.pairs.iter_mut().enumerate() {
        pair.baseline_m = 0.25 + i as f64;
    }
    PairList::new("pairs.csv", build.pairs)
}

fn text(list: &PairList) -> String {
    String::from_utf8(list.bytes().to_vec()).unwrap()
}

#[test]
fn a_list_survives_its_file_bit_by_bit() {
    let mut pairs = list().pairs;
    pairs[0].baseline_m = 0.1 + 0.2;
    pairs[1].rotation_deg = 1e-300;
    pairs[2].median_depth_m = None;
    pairs[2].overlap = None;
    pairs[3].set = None;
    let list = PairList::new("pairs.csv", pairs);
    let back = PairList::parse(Path::new("pairs.csv"), list.bytes()).unwrap();
    assert_eq!(back, list);
    assert_eq!(list.pairs.iter().filter(|p| p.selected).count(), 4);
    assert!(text(&list).contains("0.30000000000000004"));
}

#[test]
fn the_file_looks_as_documented() {
    let mut pairs = list().pairs;
    pairs.truncate(1);
    pairs[0].overlap = Some(0.95);
    pairs[0].overlap_source_to_target = Some(1.0);
    pairs[0].selected = false;
    let list = PairList::new("pairs.csv", pairs);
    assert_eq!(
        text(&list),
        "pair_id,dataset,scene,set,source,target,source_file,target_file,source_sha256,target_sha256,\
         baseline_m,rotation_deg,median_depth_m,overlap,overlap_source_to_target,selected\n\
         d%2Cx/s%20%221%22/v0__v1,\"d,x\",\"s \"\"1\"\"\",0,v0,v1,\"root/d,x/s \"\"1\"\"/v0.png\",\
         \"root/d,x/s \"\"1\"\"/v1.png\",\
         0000000000000000000000000000000000000000000000000000000000000021,\
         0000000000000000000000000000000000000000000000000000000000000021,0.25,0,2,0.95,1,false\n"
    );
}

#[test]
fn views_that_are_absent_are_named_with_file_and_line() {
    let list = list();
    let resolved = list.resolve(&[]).unwrap_err().to_string();
    assert_eq!(
        resolved,
        "pairs.csv:2: dataset 'd,x' is not given (given: none)"
    );
    let mut renamed = scene();
    renamed.id = "other".into();
    let error = list.resolve(&[renamed]).unwrap_err().to_string();
    assert_eq!(
        error,
        "pairs.csv:2: scene 's \"1\"' is not in dataset 'd,x'"
    );
    let mut shorter = scene();
    shorter.views.pop();
    let error = list.resolve(&[shorter]).unwrap_err().to_string();
    assert_eq!(
        error,
        "pairs.csv:3: view 'v2' is not in scene 's \"1\"' of dataset 'd,x'"
    );
    let scenes = [scene()];
    let resolved = list.resolve(&scenes).unwrap();
    assert_eq!(resolved.len(), 6);
    assert_eq!(resolved[5].source.id, "v2");
    assert_eq!(resolved[5].target.id, "v1");
}

#[test]
fn photographs_and_cameras_are_verified() {
    let build = |pairs: Vec<Pair>| PairList::new("pairs.csv", pairs);
    let pairs = || {
        let options = "limit=4".parse().unwrap();
        build_pairs(&[scene()], &options, &BuildContext::default())
            .unwrap()
            .pairs
    };
    let scenes = [scene()];
    let good = build(pairs()).verify(&scenes);
    assert!(good.is_good());
    assert_eq!((good.photographs, good.equal), (3, 3));

    let mut other = pairs();
    other[0].source_sha256 = "f".repeat(64);
    other[1].target_sha256 = String::new();
    let found = build(other).verify(&scenes);
    assert!(!found.is_good());
    assert_eq!(found.different.len(), 1);
    assert_eq!(found.different[0].view, "v0");
    assert_eq!(found.different[0].expected, "f".repeat(64));
    assert_eq!((found.photographs, found.equal), (3, 2));

    let mut unhashed = pairs();
    for pair in &mut unhashed {
        pair.source_sha256.clear();
        pair.target_sha256.clear();
    }
    let found = build(unhashed).verify(&scenes);
    assert!(found.is_good());
    assert_eq!((found.unhashed, found.equal), (3, 0));

    let mut moved = pairs();
    moved[2].baseline_m += 1e-6;
    let found = build(moved.clone()).verify(&scenes);
    assert_eq!(found.moved.len(), 1);
    assert_eq!(found.moved[0].pair_id, moved[2].pair_id);
    assert_eq!(found.moved[0].line, 4);

    let mut shorter = scene();
    shorter.views.pop();
    let found = build(pairs()).verify(&[shorter]);
    assert_eq!(
        found.absent,
        ["view 'v2' is not in scene 's \"1\"' of dataset 'd,x'"]
    );
    assert_eq!(found.photographs, 2);
    let nowhere = build(pairs()).verify(&[]);
    assert_eq!(nowhere.absent, ["dataset 'd,x' is not given (given: none)"]);
}

#[test]
fn differences_are_found_whatever_the_order() {
    let a = list();
    let mut pairs = a.pairs.clone();
    pairs.reverse();
    let mut b = a.clone();
    b.pairs = pairs;
    assert!(a.diff(&b).is_empty());
    assert_eq!(a.diff(&b).equal, 6);
    b.pairs[0].overlap = Some(0.5);
    let gone = b.pairs.pop().unwrap();
    let diff = a.diff(&b);
    assert_eq!(diff.only_first, [gone.pair_id]);
    assert!(diff.only_second.is_empty());
    assert_eq!(diff.changed.len(), 1);
    assert_eq!(diff.changed[0].columns["overlap"][1], "0.5");
    assert!(!diff.is_empty());
}

#[test]
fn malformed_lists_name_the_line_and_the_field() {
    let good = text(&list());
    let line = |n: usize| good.lines().nth(n).unwrap().to_owned();
    let with = |from: &str, to: &str| good.replacen(from, to, 1);
    let overlap = |value: &str| {
        let mut fields: Vec<&str> = good.lines().nth(1).unwrap().rsplitn(4, ',').collect();
        fields[2] = value;
        fields.reverse();
        good.replacen(good.lines().nth(1).unwrap(), &fields.join(","), 1)
    };
    let cases = [
        (String::new(), 1, "columns"),
        (with("pair_id,", "id,"), 1, "columns"),
        (with(",0,v0", ",zero,v0"), 2, "set is 'zero'"),
        (with(",0.25,", ",nan,"), 2, "baseline_m is 'nan'"),
        (with(",0.25,", ",-1,"), 2, "baseline_m is '-1'"),
        (with(",0.25,", ",inf,"), 2, "baseline_m is 'inf'"),
        (with(",0.25,0,2,", ",0.25,181,2,"), 2, "from 0 to 180"),
        (with(",0.25,0,2,", ",0.25,0,0,"), 2, "a number above 0"),
        (
            overlap("1.5"),
            2,
            "overlap is '1.5', not a number from 0 to 1",
        ),
        (overlap("-0.1"), 2, "overlap is '-0.1'"),
        (with("0000021", "000002Z"), 2, "source_sha256"),
        (with("v0__v1", "v0__v2"), 2, "disagrees"),
        (with("d%2Cx", "d,x"), 2, ""),
        (with("v0__v1", "v0_v1"), 2, "no '__'"),
        (with(",true", ",yes"), 0, "selected is 'yes'"),
        (format!("{good}{}\n", line(1)), 8, "given twice"),
        (format!("{good}short,row\n"), 8, ""),
    ];
    for (text, expected, part) in cases {
        let error = PairList::parse(Path::new("p.csv"), text.as_bytes()).unwrap_err();
        let PairError::List { line, reason, .. } = &error else {
            panic!("{error}");
        };
        assert!(expected == 0 || *line == expected, "{error}");
        assert!(reason.contains(part), "{error}");
    }
    let mut bytes = good.into_bytes();
    bytes.extend(b"\xff");
    let error = PairList::parse(Path::new("p.csv"), &bytes).unwrap_err();
    assert!(error.to_string().starts_with("p.csv:8: "), "{error}");
}

#[test]
fn lists_that_a_spreadsheet_changed_are_told() {
    let mut pairs = list().pairs;
    let pair = &mut pairs[0];
    (pair.source, pair.target) = ("0003".into(), "0014".into());
    pair.pair_id = pair.pair_id.replace("v0__v1", "0003__0014");
    let good = text(&PairList::new("pairs.csv", pairs));
    let told = |text: String| {
        let error = PairList::parse(Path::new("p.csv"), text.as_bytes()).unwrap_err();
        let text = error.to_string();
        (
            text.contains("a spreadsheet probably changed this file"),
            text,
        )
    };
    for (changed, part) in [
        (good.replace(",0003,0014,", ",3,14,"), "leading zeros"),
        (good.replace(",true", ",TRUE"), "in small letters"),
        (good.replace(',', ";"), "semicolons separate them"),
        (good.replace(',', "\t"), "tabs separate them"),
    ] {
        let (is_told, text) = told(changed);
        assert!(is_told && text.contains(part), "{text}");
    }
    // Other mistakes.
    for changed in [
        good.replace(",0003,0014,", ",0003,0015,"),
        good.replace(",true", ",yes"),
        good.replace("pair_id,", "id;"),
    ] {
        let (is_told, text) = told(changed);
        assert!(!is_told, "{text}");
    }
    assert!(PairList::parse(Path::new("p.csv"), good.as_bytes()).is_ok());
}

#[test]
fn a_written_list_is_read_back_with_the_hash_of_its_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("lists/pairs.csv");
    let list = PairList::new(&path, list().pairs);
    list.write().unwrap();
    assert_eq!(PairList::read(&path).unwrap(), list);
    assert_eq!(crate::io::hash::file_sha256(&path).unwrap(), list.sha256);
}

#[test]
fn an_absent_file_is_named() {
    let error = PairList::read(Path::new("no/such.csv")).unwrap_err();
    assert!(
        error.to_string().starts_with("no/such.csv: cannot read"),
        "{error}"
    );
}
