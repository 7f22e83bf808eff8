//! Small datasets in every layout, with one damaged file.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{LazyLock, Mutex};

use sharp_tests::{files_below, words};

use super::case::{Case, Verdict};
use super::oracle::{Known, judge_run, psnr_of_files, rows};
use super::spoil;

/// Formats, with settings for which pictures are scored unchanged.
const FORMATS: [&str; 9] = [
    "booster",
    "colmap",
    "eth3d,images=undistorted",
    "middlebury",
    "nerfstudio",
    "scannetpp",
    "stereo",
    "tanks-and-temples",
    "wildrgbd",
];

/// Endings of file names, by role.
const METADATA: [&str; 7] = [".txt", ".xml", ".json", ".log", "metadata", "split", ".csv"];
const DEPTH_FOLDERS: [&str; 4] = ["depth", "disp", "ground_truth_depth", "render_depth"];

pub(crate) fn metadata(case: &mut Case) -> Result<Verdict, String> {
    attack(
        case,
        |name| METADATA.iter().any(|end| name.ends_with(end)),
        spoil::text,
    )
}

pub(crate) fn pictures(case: &mut Case) -> Result<Verdict, String> {
    attack(
        case,
        |name| is_picture(name) && !is_depth(name),
        spoil::binary,
    )
}

pub(crate) fn depth(case: &mut Case) -> Result<Verdict, String> {
    attack(
        case,
        |name| is_depth(name) || name.ends_with(".ply"),
        spoil::binary,
    )
}

fn is_picture(name: &str) -> bool {
    [".png", ".jpg", ".JPG"]
        .iter()
        .any(|end| name.ends_with(end))
}

fn is_depth(name: &str) -> bool {
    !name.ends_with(".txt") && DEPTH_FOLDERS.iter().any(|part| name.contains(part))
}

/// Copies the dataset of a format into a case, without lens distortion and masks.
fn put(case: &Case, format: &str) -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/fuzz/datasets")
        .join(format);
    let mut names = Vec::new();
    for path in files_below(&root).unwrap() {
        let name = path.strip_prefix(&root).unwrap().display().to_string();
        if name.contains("masks") {
            continue;
        }
        let mut bytes = std::fs::read(&path).unwrap();
        if name.ends_with("transforms.json") {
            let text = String::from_utf8(bytes).unwrap();
            let text = text
                .replace("OPENCV_FISHEYE", "PINHOLE")
                .replace("\"k1\": -0.05", "\"k1\": 0");
            bytes = text.replace("\"k1\": -0.03", "\"k1\": 0").into_bytes();
        }
        case.write(&format!("data/{name}"), bytes);
        names.push(format!("data/{name}"));
    }
    names
}

fn evaluate(case: &mut Case, format: &str) -> Result<super::case::Said, String> {
    let (format, settings) = format.split_once(',').unwrap_or((format, ""));
    let comma = if settings.is_empty() { "" } else { "," };
    let spec = format!("D:{format}=data{comma}{settings}");
    case.run(&words(&format!(
        "run --dataset {spec} --method copy --method depth-splat:resolution=64 --metrics psnr \
         --pair-options missing-depth=accept,threshold=0,at-threshold=in --no-cache --limit 2 \
         --threads 1 --out r",
    )))
}

/// Scores of the undamaged datasets.
static UNHARMED: LazyLock<Mutex<BTreeMap<String, String>>> = LazyLock::new(Mutex::default);

fn unharmed(format: &str) -> Result<String, String> {
    let mut known = UNHARMED.lock().unwrap();
    if let Some(scores) = known.get(format) {
        return Ok(scores.clone());
    }
    let mut case = Case::new("unharmed", 0);
    put(&case, format.split(',').next().unwrap());
    let said = evaluate(&mut case, format)?;
    if said.code != 0 {
        return Err(format!("the unharmed {format}: {}", said.err));
    }
    let scores = case.read("r/scores.csv");
    known.insert(format.to_owned(), scores.clone());
    Ok(scores)
}

fn attack(
    case: &mut Case,
    is_wanted: impl Fn(&str) -> bool,
    spoil: fn(&[u8], &mut sharp_tests::mutants::Random) -> spoil::Spoiled,
) -> Result<Verdict, String> {
    let (format, names) = loop {
        let format = *case.random.pick(&FORMATS);
        let names = put(case, format.split(',').next().unwrap());
        let names: Vec<String> = names.into_iter().filter(|name| is_wanted(name)).collect();
        if !names.is_empty() {
            break (format, names);
        }
        std::fs::remove_dir_all(case.path("data")).unwrap();
    };
    let name = case.random.pick(&names).clone();
    let harmless = spoil::file(case, &name, spoil);
    // Instead of the damaged file, a message may name the dataset, its scene, or another file.
    for word in ["data", "D/", "D:"] {
        case.may_name(word);
    }
    let said = evaluate(case, format)?;
    if harmless && said.code == 0 && case.read("r/scores.csv") != unharmed(format)? {
        return Err("another score, although the file's meaning is unchanged".to_owned());
    }
    let pairs = match said.code {
        0 | 4 => rows(&case.path("r/pairs.csv"))?,
        _ => Vec::new(),
    };
    let data = case.path("data");
    judge_run(case, &said, "r", &|row| {
        let pair = pairs.iter().find(|pair| pair["pair_id"] == row["pair_id"]);
        match pair {
            Some(pair) if row["method"] == "copy" => psnr_of_files(
                &data.join(&pair["source_file"]),
                &data.join(&pair["target_file"]),
            ),
            _ => Known::Nothing,
        }
    })
}
