//! Cameras and files that would use all memory are rejected based on the sizes that they declare.

use std::path::Path;

use image::GrayImage;
use sharp_datasets::format::exr_depth;
use sharp_datasets::{DatasetError, DepthMap, open_each};

use crate::multi_view::folder;
use crate::small::twice;
use crate::spec;

#[test]
fn a_camera_beyond_all_photographs_is_refused_before_anything_is_allocated() {
    let json = "\"w\": 12, \"h\": 8";
    for (format, file, from) in [
        ("middlebury", "calib.txt", "width=12\nheight=8"),
        ("scannetpp", "dslr/nerfstudio/transforms.json", json),
        ("wildrgbd", "metadata", json),
        ("tanks-and-temples", "cameras.txt", "12 8"),
        ("eth3d", "dslr_calibration_jpg/cameras.txt", "12 8"),
        ("nerfstudio", "transforms.json", json),
        ("colmap", "sparse/0/cameras.txt", "12 8"),
    ] {
        let (folder, second) = twice(format);
        let path = second.join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{format}: {text}");
        let to = from.replace("12", "60000").replace('8', "20000");
        std::fs::write(&path, text.replace(from, &to)).unwrap();
        let found = open_each(&spec(format, folder.path())).unwrap();
        assert_eq!(found.scenes.len(), 1, "{format}");
        let why = found.left_out[0].why.to_string();
        let name = path.file_name().unwrap().to_str().unwrap();
        for part in [name, "60000x20000", "268435456"] {
            assert!(why.contains(part), "{format}: {why}");
        }
    }
}

/// Decoding such a picture, mask or map reveals that its end is missing; comparing its header with
/// the camera fails before that.
#[test]
fn headers_are_compared_with_the_camera_before_pixels_are_decoded() {
    let files = folder();
    let (png, exr) = (files.path().join("a.png"), files.path().join("a.exr"));
    GrayImage::new(3000, 2000).save(&png).unwrap();
    exr_depth::write(&exr, &DepthMap::new(3000, 2000)).unwrap();
    for file in [&png, &exr] {
        let bytes = std::fs::read(file).unwrap();
        std::fs::write(file, &bytes[..bytes.len() - 100]).unwrap();
    }
    for (format, file, large) in [
        ("middlebury", "im0.png", &png),
        ("middlebury", "disp0.pfm", &png),
        ("stereo", "disparity_left.pfm", &exr),
        ("scannetpp", "dslr/resized_anon_masks/0.png", &png),
        ("scannetpp", "dslr/render_depth/0.png", &exr),
        ("wildrgbd", "rgb/00000.png", &png),
        ("wildrgbd", "depth/00000.png", &exr),
        ("nerfstudio", "images/0.png", &png),
        ("colmap", "depth/0.png", &png),
    ] {
        let (folder, second) = twice(format);
        std::fs::copy(large, second.join(file)).unwrap();
        let scenes = open_each(&spec(format, folder.path())).unwrap().scenes;
        let content = &scenes[1].views[0].content;
        let errors = [content.image().err(), content.depth().err()];
        let errors: Vec<DatasetError> = errors.into_iter().flatten().collect();
        assert!(!errors.is_empty(), "{format} {file}");
        let name = Path::new(file).file_name().unwrap().to_str().unwrap();
        for error in errors {
            let error = error.to_string();
            let parts = [name, "is 3000x2000, but its camera is for 12x8"];
            let says = parts.iter().all(|part| error.contains(part));
            assert!(says, "{format} {file}: {error}");
        }
    }
}
