//! Cases of datasets.

use sharp_tests::rows;

use super::{Case, case, untried};

use crate::support::Said;

/// Fails unless the command printed the text.
fn says(said: &Said, text: &str) {
    let all = said.out.clone() + &said.err;
    assert!(all.contains(text), "{text}: {all}");
}

/// Fails unless the command ended with this code and printed the text.
fn ends(said: &Said, code: i32, text: &str) {
    assert_eq!(said.code, code, "{}{}", said.out, said.err);
    says(said, text);
}

fn psnr_of(case: &Case, run: &str) -> Vec<f64> {
    let column = case.scores(run, "psnr");
    column.iter().map(|value| value.parse().unwrap()).collect()
}

fn is_near(value: f64, expected: f64) -> bool {
    (value - expected).abs() < 5e-4
}

#[test]
fn images_with_one_line_each_are_all_read() {
    let case = case("A01-images-one-line");
    ends(&case.said[0], 0, "1 scene, 8 views");
    ends(&case.said[1], 0, "");
    assert_eq!(psnr_of(&case, "r").len(), 56);
}

#[test]
fn a_camera_file_of_another_kind_is_named_and_not_read() {
    let case = case("A02-stale-cameras-bin");
    let note = "read the text model and ignored cameras.bin next to it, which states other cameras";
    ends(&case.said[0], 0, note);
    ends(&case.said[1], 0, "");
    case.is_said_everywhere("r", note);
    let psnr = psnr_of(&case, "r");
    assert!(is_near(psnr[1], 16.295), "{psnr:?}");
    std::fs::remove_file(case.path("c/sparse/0/cameras.bin")).unwrap();
    let check = case.run("sharp-bench datasets check colmap=c");
    ends(&check, 0, "");
    assert!(!check.out.contains("note"), "{}", check.out);
}

#[test]
fn pictures_that_we_undistort_are_said_to_be() {
    let case = case("A08-radial-undistorted");
    ends(&case.said[1], 0, "");
    case.is_said_everywhere("r", "pictures: 8 of 8 undistorted by sharp-bench");
    says(&case.said[1], "undistorted by sharp-bench");
}

#[test]
fn camera_models_of_colmap_4_are_read() {
    for name in ["A16-FOV", "A16-SIMPLE_DIVISION"] {
        let case = case(name);
        says(&case.said[0], "1 scene, 8 views");
        says(
            &case.said[0],
            &format!(
                "undistorted by sharp-bench, bilinearly, from {}",
                name.trim_start_matches("A16-")
                    .trim_start_matches("SIMPLE_")
            ),
        );
    }
    let case = case("A16-mixed-one-FOV");
    says(&case.said[0], "1 scene, 8 views");
    says(&case.said[0], "1 of 8 undistorted by sharp-bench");
}

/// A spherical camera has no pinhole view that covers its whole picture: only its pictures are left
/// out, not the scene.
#[test]
fn a_camera_that_is_not_read_costs_its_pictures() {
    let case = untried("A01-images-one-line");
    let path = case.path("c/sparse/0/cameras.txt");
    let cameras = std::fs::read_to_string(&path).unwrap() + "\n77 EQUIRECTANGULAR 64 48 64 48\n";
    std::fs::write(path, cameras).unwrap();
    let path = case.path("c/sparse/0/images.txt");
    let images = std::fs::read_to_string(&path).unwrap();
    let images = images
        .lines()
        .map(|line| match line.strip_suffix("1 view_03.png") {
            Some(pose) => format!("{pose}77 view_03.png\n"),
            None => format!("{line}\n"),
        });
    std::fs::write(&path, images.collect::<String>()).unwrap();
    let check = case.run("sharp-bench datasets check colmap=c");
    ends(&check, 0, "1 scene, 7 views");
    says(
        &check,
        "1 frame(s) left out (view_03.png): camera 77 of cameras.txt: camera model 'EQUIRECTANGULAR' is not supported; make \
         pinhole pictures with `colmap image_undistorter`",
    );
}

#[test]
fn other_models_are_named_with_their_sizes_and_can_be_read() {
    let case = case("A33-sparse-0-and-1");
    let note = "the first of several models was read (2 pictures), not sparse/1 with 8 pictures (model=sparse/1 would read it)";
    ends(&case.said[0], 0, note);
    let chosen = case.run("sharp-bench datasets check colmap=c,model=sparse/1");
    ends(&chosen, 0, "1 scene, 8 views");
    assert!(!chosen.out.contains("note"), "{}", chosen.out);
    let run =
        case.run("sharp-bench run -q --dataset colmap=c --method copy --metrics psnr --out r");
    ends(&run, 0, note);
    case.is_said_everywhere("r", note);
    let missing = case.run("sharp-bench datasets check colmap=c,model=sparse/7");
    ends(&missing, 4, "no complete model in sparse/7");
}

#[test]
fn pictures_of_one_stem_are_told_apart_by_extension() {
    let case = case("X49-duplicate-stems");
    ends(&case.said[0], 0, "");
    ends(&case.said[1], 0, "");
    let pairs = case.scores("r", "pair_id");
    assert_eq!(pairs.len(), 56);
    assert_eq!(pairs[0], "colmap/c/view_00.jpg__view_00.png");
}

#[cfg(unix)]
#[test]
fn a_refused_link_names_the_setting_that_allows_it() {
    let case = untried("X53-symlink-images");
    let link = case.path("ns/images");
    if !link.is_symlink() {
        if link.is_dir() {
            std::fs::remove_dir_all(&link).unwrap();
        } else if link.exists() {
            std::fs::remove_file(&link).unwrap();
        }
        std::os::unix::fs::symlink("../elsewhere", &link).unwrap();
    }
    for line in std::fs::read_to_string(case.path("cmd")).unwrap().lines() {
        let said = case.run(line);
        assert_ne!(said.code, 0);
        says(&said, "outside=allow");
    }
    let allowed = case.run("sharp-bench datasets check nerfstudio=ns,outside=allow");
    ends(&allowed, 0, "1 scene, 8 views");
}

#[test]
fn a_unit_that_fits_is_named_with_its_setting() {
    let table = "\
X43-colmap-unit-0.2 | scale=5 fits better (79.2 % of depths agree between neighbouring views instead of 54.0 %
X25-depth-metres-npy | depth-unit=1 fits better (79.2 %
X45-inverse-depth | depth-kind=inverse,depth-unit=0.001 fits better (79.1 %";
    for [name, fits] in rows(table) {
        let case = case(name);
        ends(&case.said[0], 4, fits);
        let setting = fits.split(' ').next().unwrap();
        let commands = std::fs::read_to_string(case.path("cmd")).unwrap();
        let spec = commands.lines().next().unwrap().rsplit(' ').next().unwrap();
        let mended = case.run(&format!("sharp-bench datasets check {spec},{setting}"));
        ends(&mended, 0, "problems: 0");
    }
}

/// If the wrong unit leaves no pairs, the warning of the quick check before their selection explains why.
#[test]
fn runs_and_pair_lists_warn_of_units_first() {
    let case = case("X25-depth-metres-npy");
    ends(
        &case.said[1],
        1,
        "warning: nerfstudio/ns: depth-unit=1 fits",
    );
    let other = super::case("X43-colmap-unit-0.2");
    ends(&other.said[1], 0, "warning: colmap/c: scale=5 fits");
    let run = "sharp-bench run -q --dataset colmap=c --method copy --metrics psnr --out";
    let first = other.run(&format!("{run} r"));
    ends(&first, 0, "warning: colmap/c: scale=5 fits");
    other.is_said_everywhere("r", "scale=5 fits");
    // The result is cached, and the warning is repeated.
    let again = other.run(&format!("{run} r"));
    says(&again, "warning: colmap/c: scale=5 fits");
    let unchecked = other.run(&format!("{run} r2 --no-check"));
    assert!(!unchecked.err.contains("warning"), "{}", unchecked.err);
    assert_eq!(other.scores("r", "psnr"), other.scores("r2", "psnr"));
}

#[test]
fn a_focal_length_that_fits_better_is_named() {
    let case = case("A31-focal-1.1");
    ends(&case.said[0], 4, "the focal length should be 0.9");
    says(&case.said[0], "instead of 63.36 pixels");
    ends(
        &case.said[1],
        0,
        "warning: nerfstudio/ns: the focal length should be 0.9",
    );
    case.is_said_everywhere("r", "the focal length should be 0.9");
}

#[test]
fn pictures_that_were_renumbered_are_noticed() {
    let case = case("A29-one-dropped-renumbered");
    ends(
        &case.said[0],
        4,
        "from about 000004 on, every picture fits the pose after its own",
    );
}

#[test]
fn poses_that_mirror_space_are_said_to() {
    let case = untried("X25-depth-metres-npy");
    let path = case.path("ns/transforms.json");
    let text = std::fs::read_to_string(&path).unwrap();
    let mut json: serde_json::Value = serde_json::from_str(&text).unwrap();
    for frame in json["frames"].as_array_mut().unwrap() {
        for value in frame["transform_matrix"][0].as_array_mut().unwrap() {
            *value = (-value.as_f64().unwrap()).into();
        }
    }
    std::fs::write(&path, json.to_string()).unwrap();
    let said = case.run("sharp-bench datasets check nerfstudio=ns,depth-unit=1");
    ends(&said, 4, "8 frame(s) left out (");
    says(&said, "…): the pose mirrors space");
}

#[test]
fn stereo_pairs_that_contradict_themselves_are_named() {
    let table = "\
X62-mb-disp-not-scaled | disparities should be multiplied by 0.25
X62-mb-fullsize-calib-no-wh | the principal point (311.7, 255.4) lies outside the 185x125 picture
X63-stereo-baseline-mm | the baseline of 193 m is implausible, with a median depth of 2759 m; it may be in millimetres or centimetres
X63-stereo-swapped | left and right are swapped";
    for [name, cause] in rows(table) {
        let case = case(name);
        ends(&case.said[0], 4, cause);
    }
}

#[test]
fn the_reading_of_an_orientation_that_fits_is_named() {
    use image::ImageEncoder as _;
    // Little-endian TIFF with one entry: orientation 3, turned by 180 degrees.
    let exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x03\0\0\0\0\0\0\0".to_vec();
    for (turned, fits) in [(true, "orientation=upright fits"), (false, "problems: 0")] {
        let case = untried("X25-depth-metres-npy");
        for entry in std::fs::read_dir(case.path("ns/images")).unwrap() {
            let path = entry.unwrap().path();
            let mut picture = image::open(&path).unwrap().into_rgb8();
            if turned {
                picture = image::imageops::rotate180(&picture);
            }
            let file = std::fs::File::create(path.with_extension("jpg")).unwrap();
            let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(file, 95);
            encoder.set_exif_metadata(exif.clone()).unwrap();
            picture.write_with_encoder(encoder).unwrap();
            std::fs::remove_file(path).unwrap();
        }
        case.run("sed -i 's/[.]png/.jpg/' ns/transforms.json")
            .ends_with(0);
        let said = case.run("sharp-bench datasets check nerfstudio=ns,depth-unit=1");
        assert!(said.out.contains(fits), "{}", said.out);
        if turned {
            let mended = case
                .run("sharp-bench datasets check nerfstudio=ns,depth-unit=1,orientation=upright");
            assert!(mended.out.contains("problems: 0"), "{}", mended.out);
        }
    }
}

/// If any file of a view is missing or incomplete, that view is left out and reported, and the
/// others are evaluated.
#[test]
fn a_view_without_one_of_its_files_is_left_out_and_named() {
    let run = "sharp-bench run -q --dataset nerfstudio=ns,depth-unit=1 --method copy --metrics psnr --limit 3";
    let table = "\
head -c 900 ns/images/view_03.png > x && mv x ns/images/view_03.png | truncated
rm ns/images/view_03.png | 1 view left out (view_03): ns/transforms.json: the picture does not exist
rm ns/depth/view_03.npy | 1 view left out (view_03): ns/transforms.json: the depth map does not exist
head -c 900 ns/depth/view_03.npy > x && mv x ns/depth/view_03.npy | only 772 follow";
    for [spoil, said] in rows(table) {
        let case = untried("X25-depth-metres-npy");
        case.run(spoil).ends_with(0);
        let check = case.run("sharp-bench datasets check nerfstudio=ns,depth-unit=1 --views 8");
        ends(&check, 4, "view_03");
        let ran = case.run(&format!("{run} --out r"));
        ends(&ran, 4, said);
        let named = ran.err.lines().filter(|line| line.contains("view_03"));
        assert_eq!(named.count(), 1, "{}", ran.err);
        assert_eq!(case.scores("r", "psnr").len(), 3);
        case.having(vec![ran])
            .is_said_everywhere("r", said.rsplit(": ").next().unwrap_or(said));
    }
    let case = untried("X25-depth-metres-npy");
    case.run("for f in ns/depth/*.npy; do head -c 900 $f > x && mv x $f; done");
    let ran = case.run(&format!("{run} --out r"));
    ends(
        &ran,
        1,
        "56 of 56 pairs are left out because views cannot be read: ",
    );
    assert!(!ran.err.contains("no view has depth"), "{}", ran.err);
}

/// The other views are paired, and all counts report what is missing.
#[test]
fn pairs_of_a_view_that_cannot_be_read_are_counted() {
    let case = untried("X25-depth-metres-npy");
    let run =
        "sharp-bench run -q --dataset nerfstudio=ns,depth-unit=1 --method copy --metrics psnr";
    ends(&case.run(&format!("{run} --out whole")), 0, "psnr");
    case.run("head -c 1000 ns/depth/view_03.npy > x && mv x ns/depth/view_03.npy");
    let pairs = case.run("sharp-bench pairs -q --dataset nerfstudio=ns,depth-unit=1 --out p.csv");
    ends(&pairs, 4, "list");
    for part in ["14 of 56 pairs are left out", "view_03"] {
        assert!(pairs.err.contains(part), "{}", pairs.err);
    }
    let said = case.run(&format!("{run} --out r"));
    ends(&said, 4, "psnr");
    let fewer = case.scores("whole", "psnr").len() > case.scores("r", "psnr").len();
    assert!(fewer && said.err.contains("14 of 56 pairs"), "{}", said.err);
    // Shards do not build pairs; they report the same.
    let planned = format!("{run} --out p --plan-only");
    for command in [
        &*planned,
        "sharp-bench run -q --plan p --shard 1/1",
        "sharp-bench merge p",
        "sharp-bench status p",
    ] {
        let said = case.run(command);
        assert_eq!(said.code, 4, "{command}: {}", said.err);
    }
    assert_eq!(case.scores("p", "psnr"), case.scores("r", "psnr"));
    case.having(vec![said])
        .is_said_everywhere("r", "only 872 follow the header");
}

/// If most pixels are excluded, that may be the cause of other findings.
#[test]
fn masks_that_exclude_most_pixels_are_named_with_what_else_is_found() {
    let case = untried("A06-mask-inverted");
    let said = case.run("sharp-bench datasets check nerfstudio=ns,masks=apply,depth-unit=1");
    ends(
        &said,
        4,
        "perhaps the masks are inverted, because they exclude 90 % of the pixels",
    );
}
