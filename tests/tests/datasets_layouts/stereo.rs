//! Layouts of rectified pairs.

use std::path::{Path, PathBuf};

use glam::DVec3;
use sharp::camera::RigidTransform;
use sharp_datasets::format::{FloatMap, depth_png, npy, pfm};
use sharp_datasets::lens::{Distortion, Lens};
use sharp_datasets::{DatasetSpec, Scene, View, open};

use crate::{compare_cameras, read, scene, scores, write};

const FOCAL: f64 = 86.4;
const BASELINE_M: f64 = 0.1;
/// Left and right principal point; the first pixel's centre is (0.5, 0.5).
const CX: [f64; 2] = [48.7, 53.2];
const CY: f64 = 35.25;

/// Two views of the procedural world from a rectified rig.
fn pair() -> Vec<View> {
    let scene = scene();
    [0.0, BASELINE_M]
        .iter()
        .zip(CX)
        .map(|(x, cx)| {
            let lens = Lens::new((FOCAL, FOCAL), (cx, CY), (96, 72), Distortion::None).unwrap();
            let pose = RigidTransform {
                rotation: glam::DMat3::IDENTITY,
                translation: DVec3::new(-x, 0.0, 0.0),
            };
            scene.view_through("side", lens, pose)
        })
        .collect()
}

/// The disparity map, with `unknown` where there is no disparity.
fn disparity(view: &View, unknown: f32) -> FloatMap {
    let depth = write::depth_of(view);
    FloatMap::from_fn(96, 72, |x, y| {
        let z = f64::from(depth.get_pixel(x, y).0[0]);
        image::Luma([if z > 0.0 {
            (BASELINE_M * FOCAL / z - (CX[1] - CX[0])) as f32
        } else {
            unknown
        }])
    })
}

/// Disparities must be read back as depth, also the negative ones of distant points.
fn compare_pair(found: &Scene, pair: &[View]) {
    for (a, b) in found.views.iter().zip(pair) {
        compare_cameras(a, b);
        assert_eq!(a.content.image().unwrap(), b.content.image().unwrap());
        let (z, truth) = (write::depth_of(a), write::depth_of(b));
        let map = disparity(b, 0.0);
        let mut valid = 0;
        for ((z, truth), d) in z.iter().zip(truth.iter()).zip(map.iter()) {
            if *d != 0.0 {
                // The tolerance is relative to the sum of the f32 disparity and doffs.
                assert!(
                    (z - truth).abs() <= 2e-6 * truth * (1.0 + truth),
                    "{z} {truth}"
                );
                valid += 1;
            } else {
                assert_eq!(*z, 0.0);
            }
        }
        assert!(valid > 500, "{valid}");
    }
    assert_eq!(scores(&found.views), scores(pair));
}

fn calib() -> String {
    let cam = |cx: f64| {
        format!(
            "[{FOCAL} 0 {:?}; 0 {FOCAL} {:?}; 0 0 1]",
            cx - 0.5,
            CY - 0.5
        )
    };
    format!(
        "cam0={}\ncam1={}\ndoffs={:?}\nbaseline=100\nwidth=96\nheight=72\nndisp=16\n",
        cam(CX[0]),
        cam(CX[1]),
        CX[1] - CX[0]
    )
}

#[test]
fn middlebury_in_both_layouts() {
    let pair = pair();
    for suffix in ["", "GT"] {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("Scene-perfect");
        write::text(&at, "calib.txt", &calib());
        for (i, view) in pair.iter().enumerate() {
            write::picture(&at, &format!("im{i}.png"), view);
            let map = at.join(format!("disp{i}{suffix}.pfm"));
            pfm::write(&map, &disparity(view, f32::INFINITY)).unwrap();
        }
        let found = read("middlebury", folder.path());
        compare_pair(&found, &pair);
        assert_eq!(found.cluster, "Scene");
        let text = format!(
            "middlebury={},rectification=imperfect",
            folder.path().display()
        );
        assert!(open(&DatasetSpec::parse(&text).unwrap()).is_err());
    }
}

#[test]
fn booster_in_its_layout() {
    let pair = pair();
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().join("train/balanced/Glass");
    let matrix = |name: &str, cx: f64, fourth: f64| {
        format!(
            "<{name} type_id=\"opencv-matrix\"><rows>3</rows><cols>4</cols><dt>d</dt><data>\n \
             {FOCAL:?} 0. {:?} {fourth:?} 0. {FOCAL:?}\n {:?} 0. 0. 0. 1. 0.</data></{name}>",
            cx - 0.5,
            CY - 0.5
        )
    };
    let xml = format!(
        "<?xml version=\"1.0\"?><opencv_storage>{}{}<baselineLR>1.0e+02</baselineLR></opencv_storage>",
        matrix("proj_matL", CX[0], 0.0),
        matrix("proj_matR", CX[1], -100.0 * FOCAL)
    );
    write::text(&at, "calib_00-02.xml", &xml);
    for (number, view) in ["00", "02"].iter().zip(&pair) {
        write::picture(&at, &format!("camera_{number}/im0.png"), view);
        npy::write(
            &at.join(format!("disp_{number}.npy")),
            &disparity(view, 0.0),
        )
        .unwrap();
    }
    compare_pair(&read("booster", folder.path()), &pair);
}

#[test]
fn a_plain_pair_with_disparity_in_several_formats() {
    let pair = pair();
    let rig = format!(
        "fx={FOCAL}\ncx_left={}\ncx_right={}\ncy={CY}\nbaseline_m={BASELINE_M}\n",
        CX[0], CX[1]
    );
    for extension in ["pfm", "npy"] {
        let folder = tempfile::tempdir().unwrap();
        write::text(folder.path(), "rig.txt", &rig);
        for (side, view) in ["left", "right"].iter().zip(&pair) {
            write::picture(folder.path(), &format!("{side}.png"), view);
            let path = folder.path().join(format!("disparity_{side}.{extension}"));
            let map = disparity(view, f32::INFINITY);
            if extension == "pfm" {
                pfm::write(&path, &map).unwrap();
            } else {
                npy::write(&path, &map).unwrap();
            }
        }
        compare_pair(&read("stereo", folder.path()), &pair);
    }
    // KITTI's form: 256ths of a pixel in a 16-bit PNG.
    let folder = tempfile::tempdir().unwrap();
    write::text(
        folder.path(),
        "rig.txt",
        &format!("{rig}disparity_unit=0.00390625\n"),
    );
    for (side, view) in ["left", "right"].iter().zip(&pair) {
        write::picture(folder.path(), &format!("{side}.png"), view);
    }
    let mut map = FloatMap::new(96, 72);
    map.put_pixel(3, 4, image::Luma([512.0]));
    depth_png::write(&folder.path().join("disparity_left.png"), &map).unwrap();
    let depth = write::depth_of(&read("stereo", folder.path()).views[0]);
    let expected = BASELINE_M * FOCAL / (2.0 + CX[1] - CX[0]);
    assert!((f64::from(depth.get_pixel(3, 4).0[0]) - expected).abs() < 1e-6);
    assert_eq!(depth.iter().filter(|z| **z > 0.0).count(), 1);
}

/// Motorcycle's pixels in Booster's layout: two illuminations of a scene form one cluster; the test
/// split has no depth.
#[test]
fn booster_fixture() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/booster");
    let read = |settings: &str| {
        let text = format!("booster={}{settings}", folder.display());
        open(&DatasetSpec::parse(&text).unwrap()).unwrap()
    };
    let scenes = read("");
    let ids: Vec<_> = scenes.iter().map(|s| s.id.as_str()).collect();
    assert_eq!(
        ids,
        [
            "train/balanced/Motorcycle/im0",
            "train/balanced/Motorcycle/im1"
        ]
    );
    assert!(scenes.iter().all(|s| s.cluster == "Motorcycle"));
    assert_eq!(read(",illuminations=first").len(), 1);
    let test = read(",split=test");
    assert_eq!(test.len(), 1);
    assert!(test[0].views[0].content.depth().unwrap().is_none());
    assert!(test[0].notes[0].contains("no depth"));
    let files: Vec<PathBuf> = scenes[0].views[0].content.files();
    assert_eq!(files.len(), 3);
}
