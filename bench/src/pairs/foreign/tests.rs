//! Made-up lists in every format.

use super::*;

const INDEX: &str = r#"{"apple": {"context": [4, 0], "target": [1, 2, 4]}, "b/cup": null}"#;
const FLASH3D: &str = "apple 1 4 5 3\ncup 0 2 2 2\n";
const MANIFEST: &str = "S/apple|view_002|view_000,view_004\n/x/c.torch|apple|1|3\n";
const SPLIT: &str = r#"{"train_ids": [3], "test_ids": [0, 1]}"#;

fn list(text: &str, form: ListForm) -> Result<ForeignList, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("list");
    std::fs::write(&path, text).unwrap();
    let shown = format!("{}:", path.display());
    let list = ForeignList::read(&path, form);
    list.map_err(|error| error.to_string().replace(&shown, ""))
}

fn mine(stamp: u32) -> String {
    let frame = |stamp: u32| {
        format!(
            r#"{{"sequence_id": "apple", "camera_intrinsics": [0.5, 0.9, 0.5, 0.5], "camera_pose": [1.0, 0.0, -2.5e-05, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], "frame_ts": "{stamp}"}}"#
        )
    };
    let names = [
        "src_img_obj",
        "tgt_img_obj_5_frames",
        "tgt_img_obj_10_frames",
        "tgt_img_obj_random",
    ];
    let frames = (stamp..)
        .zip(names)
        .map(|(stamp, name)| format!(r#""{name}": {}"#, frame(stamp)));
    let frames: Vec<String> = frames.collect();
    format!("{{\"sequence_id\": \"apple\", {}}}\n", frames.join(", "))
}

#[test]
fn every_form_is_read_and_counted() {
    for (text, form, counts) in [
        (INDEX.to_owned(), ListForm::Index, [2, 1, 3, 1]),
        (FLASH3D.to_owned(), ListForm::Flash3d, [2, 2, 6, 0]),
        (MANIFEST.to_owned(), ListForm::Unisharp, [2, 2, 3, 0]),
        (SPLIT.to_owned(), ListForm::Seva, [1, 1, 2, 0]),
        (
            r#"{"a": {"context": [0], "target": []}}"#.to_owned(),
            ListForm::Index,
            [1, 0, 0, 0],
        ),
        (mine(0) + &mine(1), ListForm::Mine, [2, 2, 6, 0]),
    ] {
        let list = list(&text, form).unwrap();
        let ForeignCounts {
            entries,
            with_pairs,
            targets,
            targets_that_are_inputs,
        } = list.counts();
        assert_eq!(
            [entries, with_pairs, targets, targets_that_are_inputs],
            counts,
            "{form:?}"
        );
    }
}

/// A scene of six views, from `view_000` on, whose id ends with the key used in the lists.
fn dataset() -> OpenDataset {
    let config = "S:synthetic=size=24x18,views=6,scenes=1".parse().unwrap();
    let mut dataset = OpenDataset::open_recorded(&config, &[], None).unwrap();
    dataset.scenes[0].id = "S/apple".to_owned();
    for (i, view) in dataset.scenes[0].views.iter_mut().enumerate() {
        view.id = format!("view_{i:03}");
    }
    dataset
}

#[test]
fn lists_become_pairs_of_the_dataset() {
    let dataset = dataset();
    let pairs = |text: &str, form: ListForm, context: Context, slot: TargetSlot| -> Vec<String> {
        let imported = list(text, form).unwrap();
        let imported = imported
            .import(context, slot, std::slice::from_ref(&dataset))
            .unwrap();
        let numbers = imported.pairs.iter().map(|pair| {
            assert!(pair.selected && pair.source_sha256.len() == 64);
            format!("{}{}", &pair.source[7..], &pair.target[7..])
        });
        numbers.collect()
    };
    let index = |context| pairs(INDEX, ListForm::Index, context, TargetSlot::Five);
    assert_eq!(index(Context::First), ["41", "42", "44"]);
    assert_eq!(index(Context::Second), ["01", "02", "04"]);
    // 2 is equally close to 4 and 0, so the first context view is chosen.
    assert_eq!(index(Context::Nearest), ["01", "42", "44"]);
    let flash3d = |slot| pairs(FLASH3D, ListForm::Flash3d, Context::First, slot);
    assert_eq!(
        [
            flash3d(TargetSlot::Five),
            flash3d(TargetSlot::Ten),
            flash3d(TargetSlot::Random)
        ],
        [["14"], ["15"], ["13"]]
    );
    let manifest = pairs(
        MANIFEST,
        ListForm::Unisharp,
        Context::First,
        TargetSlot::Five,
    );
    assert_eq!(manifest, ["13", "20", "24"]);
    assert_eq!(
        pairs(SPLIT, ListForm::Seva, Context::First, TargetSlot::Five),
        ["30", "31"]
    );
    assert_eq!(
        pairs(&mine(2), ListForm::Mine, Context::First, TargetSlot::Random),
        ["25"]
    );
    let all = list(FLASH3D, ListForm::Flash3d).unwrap();
    let all = all
        .import(
            Context::First,
            TargetSlot::Five,
            std::slice::from_ref(&dataset),
        )
        .unwrap();
    assert_eq!((all.absent, all.repeated), (vec!["cup".to_owned()], 0));
    let import = |text: &str, form| {
        let datasets = std::slice::from_ref(&dataset);
        let list = list(text, form).unwrap();
        list.import(Context::First, TargetSlot::Five, datasets)
    };
    let again = r#"{"apple": {"context": [4], "target": [1, 2, 1, 1]}}"#;
    let again = import(again, ListForm::Index).unwrap();
    assert_eq!((again.pairs.len(), again.repeated), (2, 2));
    for (text, reason) in [
        (
            r#"{"apple": {"context": [4], "target": []}, "b": null}"#,
            "no target",
        ),
        (
            r#"{"b": {"context": [4], "target": [1]}}"#,
            "none of its scenes",
        ),
        // Only the second context view shows that the list counts from 1.
        (
            r#"{"apple": {"context": [1, 6], "target": [2]}}"#,
            "position 6 is beyond the last of 6 views, counted from 0",
        ),
    ] {
        let error = import(text, ListForm::Index).unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
    }
    let beyond = list("apple 6 1 1 1", ListForm::Flash3d).unwrap();
    let error = beyond
        .import(Context::First, TargetSlot::Five, &[dataset])
        .unwrap_err();
    assert!(
        error
            .to_string()
            .contains("position 6 is beyond the last of 6 views"),
        "{error}"
    );
}

#[test]
fn hostile_lists_are_one_clear_error() {
    let table = r#"{"a": {"context": [0, 99999999999999999999], "target": []}} => 1:
{"a": {"context": [0, -1], "target": []}} => u32
{"a": {"context": [0.5], "target": []}} => u32
{"a": {"context": [], "target": [1]}} => no context view
{"a": {"context": "0", "target": []}} => sequence
{"/etc": null} => not the name of a scene
{"C:\\x": null} => not the name of a scene
{"a/../b": null} => not the name of a scene
{"a": {"context": [0], "target": null}} => null instead of a list
[1] => object of scenes
{} => empty"#;
    for line in table.lines() {
        let (text, reason) = line.split_once(" => ").unwrap();
        is_refused(ListForm::Index, text, reason);
    }
    let twice = "{\"a\": null,\n\"a\": null}";
    let no_list = r#"{"train_ids": null, "test_ids": []}"#;
    for (form, text, reason) in [
        (ListForm::Index, twice, "2: scene 'a' is given twice"),
        (ListForm::Index, "", "EOF"),
        (ListForm::Seva, r#"{"train_ids": [1]}"#, "test_ids"),
        (ListForm::Seva, no_list, "null instead of a list"),
        (
            ListForm::Flash3d,
            "ok 1 2 3 4\nkey 1 2 3",
            "2: expected 'key source",
        ),
        (ListForm::Flash3d, "key 1 2 3 -4", "positions"),
        (
            ListForm::Flash3d,
            "../key 1 2 3 4",
            "not the name of a scene",
        ),
        (ListForm::Unisharp, "a|1", "2 fields"),
        (ListForm::Unisharp, "a|b|c|1|2", "5 fields"),
        (ListForm::Unisharp, "/data/a|1|2", "not the name of a scene"),
        (ListForm::Unisharp, "a|1|../../2", "not the name of a view"),
        (ListForm::Unisharp, "a|1|2,,3", "not the name of a view"),
        (ListForm::Unisharp, "a|1|", "no target"),
        (ListForm::Mine, r#"{"sequence_id": 5}"#, "string"),
        (ListForm::Mine, "{\"sequence_id\": \"a\"\u{1}}", "1: "),
    ] {
        is_refused(form, text, reason);
    }
}

fn is_refused(form: ListForm, text: &str, reason: &str) {
    let error = list(text, form).unwrap_err();
    assert!(
        error.contains(reason) && !error.contains('\n'),
        "{text}: {error}"
    );
}
