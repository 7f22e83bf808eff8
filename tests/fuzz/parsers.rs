// Every parser of untrusted bytes, by name. Shared by the fuzz targets and by the test that
// mutates the fixtures. A parser may refuse; it must not panic, hang, or allocate without bound.

mod catalogue;

use std::path::Path;

use sharp::image_file::{AlphaRule, PictureRules};
use sharp::model::preprocess::{PhotoOptions, load_photo};
use sharp_bench::export::camera_file::CameraFile;
use sharp_bench::pairs::PairList;
use sharp_checkpoint::Checkpoint;
use sharp_datasets::format;
use sharp_datasets::lens::Lens;

pub(crate) use catalogue::FILES as DATASET_FILES;

/// A parser, with the endings of its seed files.
pub(crate) struct Parser {
    pub name: &'static str,
    pub run: fn(&[u8]),
    /// Files of `tests/fixtures/edge` and `gaussian_formats` with one of these endings, separated by spaces, are its
    /// seeds.
    pub seeds: &'static str,
}

pub(crate) const PARSERS: &[Parser] = &[
    parser("pfm", pfm, ".pfm"),
    parser("npy", npy, ".npy .npz"),
    parser("picture", picture, ".png .jpg .jpeg orient6.JPG"),
    parser("depth_png", depth_png, "gray16_depth_mm.png"),
    parser("raw_floats", raw_floats, "6x4.JPG"),
    parser("exr_depth", exr_depth, ".exr"),
    parser("ply_points", ply_points, ".ply"),
    parser("calib", calib, "calib_crlf.txt calib_bom_spaces.txt"),
    parser("opencv_xml", opencv_xml, ".xml"),
    parser("transforms", transforms, ".json"),
    parser("trajectory", trajectory, ".log cam_poses_gap.txt"),
    parser(
        "colmap_text",
        colmap_text,
        "images_spaces.txt images_exponent.txt",
    ),
    parser("colmap_binary", colmap_binary, ".bin"),
    parser("catalogue", catalogue::catalogue, ""),
    parser("gaussian_ply", gaussian_ply, ""),
    parser(
        "gaussian_files",
        gaussian_files,
        ".spz .sog .splat .compressed.ply",
    ),
    parser("checkpoint", checkpoint, ""),
    parser("pair_list", pair_list, ""),
    parser("photo", photo, ".png .jpg .jpeg orient6.JPG"),
    parser("prediction", prediction, ".png .jpg .exr .npy"),
    parser("scene_arrays", scene_arrays, ""),
    parser("camera_file", camera_file, ""),
];

const fn parser(name: &'static str, run: fn(&[u8]), seeds: &'static str) -> Parser {
    Parser { name, run, seeds }
}

fn pfm(bytes: &[u8]) {
    let _ = format::pfm::parse(bytes);
}

fn npy(bytes: &[u8]) {
    let _ = format::npy::parse(bytes).and_then(format::npy::NpyArray::into_map);
}

fn picture(bytes: &[u8]) {
    let rules = PictureRules {
        alpha: AlphaRule::White,
        ..PictureRules::default()
    };
    let _ = sharp::image_file::read_rgb8(bytes, &rules, None);
}

fn depth_png(bytes: &[u8]) {
    let _ = format::depth_png::parse(bytes);
}

fn raw_floats(bytes: &[u8]) {
    let _ = format::raw_floats::parse(bytes, (6, 4));
}

fn exr_depth(bytes: &[u8]) {
    let _ = format::exr_depth::parse(bytes);
}

fn ply_points(bytes: &[u8]) {
    let _ = format::ply_points::parse(bytes);
}

fn calib(bytes: &[u8]) {
    let _ = format::calib::parse(&String::from_utf8_lossy(bytes));
}

fn opencv_xml(bytes: &[u8]) {
    let _ = format::opencv_xml::parse(&String::from_utf8_lossy(bytes));
}

fn transforms(bytes: &[u8]) {
    if let Ok(file) = format::transforms::parse(&String::from_utf8_lossy(bytes)) {
        for frame in file.frames.iter().chain(&file.test_frames).take(16) {
            let size = frame.size().ok().flatten().unwrap_or((64, 48));
            if let Ok(lens) = frame.lens(size) {
                through(&lens);
            }
        }
    }
}

fn trajectory(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let _ = format::trajectory::parse_log(&text);
    let _ = format::trajectory::parse_rows(&text);
}

fn colmap_text(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    if let Ok(cameras) = format::colmap_text::cameras(&text) {
        for camera in cameras.values().take(16) {
            if let Ok(lens) = camera.lens() {
                through(&lens);
            }
        }
    }
    let _ = format::colmap_text::images(&text);
    let _ = format::colmap_text::points(&text);
}

fn colmap_binary(bytes: &[u8]) {
    if let Ok(cameras) = format::colmap_binary::cameras(bytes) {
        for camera in cameras.values().take(16) {
            if let Ok(lens) = camera.lens() {
                through(&lens);
            }
        }
    }
    let _ = format::colmap_binary::images(bytes);
    let _ = format::colmap_binary::points(bytes);
}

fn gaussian_ply(bytes: &[u8]) {
    let _ = sharp::ply::from_bytes(bytes, Some(sharp::ply::ColorSpace::Srgb));
}

/// Gaussians in any format; one format is recognised only by its name.
fn gaussian_files(bytes: &[u8]) {
    let form = sharp::ply::StoredForm {
        blending: sharp::ply::ColorSpace::Srgb,
        ..sharp::ply::StoredForm::default()
    };
    let _ = sharp::gaussian_files::from_bytes(bytes, "scene.splat", form);
}

/// A file for readers that require a certain extension.
fn file_of(bytes: &[u8], extension: &str) -> tempfile::NamedTempFile {
    let file = tempfile::Builder::new().suffix(extension).tempfile();
    let file = file.expect("a temporary file");
    std::fs::write(file.path(), bytes).expect("a temporary file");
    file
}

/// A photograph for the network, with its EXIF.
fn photo(bytes: &[u8]) {
    let options = PhotoOptions {
        max_pixels: 1 << 20,
        ..PhotoOptions::default()
    };
    let file = file_of(bytes, "");
    if let Ok(photo) = load_photo(file.path(), &options) {
        assert!(photo.focal_px > 0.0 && photo.focal_px.is_finite());
    }
}

/// A picture to be scored; its extension determines the format.
fn prediction(bytes: &[u8]) {
    let extension = match bytes {
        [0x76, 0x2F, 0x31, 0x01, ..] => ".exr",
        [0x93, b'N', ..] => ".npy",
        _ => ".png",
    };
    let file = file_of(bytes, extension);
    if let Ok(picture) = sharp_bench::io::pictures::read(file.path()) {
        assert!(picture.check().is_ok());
    }
}

/// Gaussians as arrays.
fn scene_arrays(bytes: &[u8]) {
    let _ =
        sharp_bench::io::gaussian_files::read(file_of(bytes, ".safetensors").path(), None, None);
}

/// `.pt` in both forms and `.safetensors`; the reader maps files, so the bytes must be written to
/// one.
fn checkpoint(bytes: &[u8]) {
    let file = file_of(bytes, "");
    if let Ok(checkpoint) = Checkpoint::open(file.path()) {
        for name in checkpoint.names().take(16) {
            let _ = checkpoint.tensor_f32(name);
        }
    }
}

fn pair_list(bytes: &[u8]) {
    if let Ok(list) = PairList::parse(Path::new("pairs.csv"), bytes) {
        // A list that was read can be written and read again.
        let own = PairList::new("pairs.csv", list.pairs.clone());
        let again = PairList::parse(Path::new("pairs.csv"), own.bytes());
        assert_eq!(again.expect("its own form").pairs, own.pairs);
    }
}

fn camera_file(bytes: &[u8]) {
    if let Ok((intrinsics, camera_from_world)) = CameraFile::parse(&String::from_utf8_lossy(bytes))
    {
        let numbers = camera_from_world.to_cols_array();
        assert!(numbers.iter().all(|number| number.is_finite()));
        let centre = glam::DVec2::new(0.5, 0.5);
        let point = camera_from_world.transform_point3(intrinsics.unproject(centre, 1.0));
        let _ = intrinsics.project(point);
    }
}

/// A lens with any parameters must give a result or refuse.
fn through(lens: &Lens) {
    let k = lens.intrinsics();
    let corner = glam::DVec2::new(f64::from(k.width), f64::from(k.height));
    for share in [0.0, 0.3, 0.5, 1.0] {
        if let Some(ray) = lens.unproject(corner * share) {
            let _ = lens.project_unfolded(ray);
        }
    }
}
