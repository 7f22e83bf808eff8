//! Rectified pairs with the calibration of another scene, or with numbers that are not disparities.

use std::path::Path;

use super::change;
use super::spoiled::{BASELINE_M, FOCAL, of_pair, pair, pair_of};
use crate::check::advice::{Units, sentence};
use crate::check::change::{Change, Focal};
use crate::check::{QUICK, THOROUGH, check, copied_calibrations, look};
use crate::registry::{ENTRIES, open};
use crate::setting::PICTURES;
use crate::{DatasetSpec, DepthMap};

/// Problems of the only scenes in a folder.
fn problems(folder: &Path) -> Vec<String> {
    let spec = DatasetSpec::parse(&format!("middlebury={}", folder.display())).unwrap();
    for scene in open(&spec).unwrap() {
        let found = look(&scene, Units::of(&spec), QUICK).contradictions;
        let thorough = look(&scene, Units::of(&spec), THOROUGH).contradictions;
        assert_eq!(found, thorough);
    }
    let report = check(&spec, 2, &|_, _| {}).unwrap();
    let problems = report.scenes.into_iter().flat_map(|scene| scene.problems);
    problems.collect()
}

fn edit(scene: &Path, edit: impl Fn(String) -> String) {
    let file = scene.join("calib.txt");
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, edit(text)).unwrap();
}

#[test]
fn calibrations_of_other_scenes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = crate::bundled::extract(folder.path()).unwrap();
    let own = dataset.join("Motorcycle-quarter");
    assert_eq!(problems(&dataset), [""; 0]);
    // A range that is slightly too narrow, missing, or still that of the larger picture is accepted.
    let original = std::fs::read_to_string(own.join("calib.txt")).unwrap();
    for stated in ["vmin=9\nvmax=57", "", "vmin=28\nvmax=240"] {
        edit(&own, |text| text.replace("vmin=7\nvmax=60", stated));
        assert_eq!(problems(&dataset), [""; 0], "{stated}");
        edit(&own, |_| original.clone());
    }
    edit(&own, |text| text.replace("vmax=60", "vmax=25"));
    let said = problems(&dataset);
    assert!(
        said.len() == 1 && said[0].contains("outside the range from 7 to 25 pixels"),
        "{said:?}"
    );
    edit(&own, |text| text.replace("vmax=25", "vmax=60"));
    // The same scene once more, and cropped at the bottom, as a scene of another size with the same cameras.
    let other = dataset.join("Other");
    std::fs::create_dir(&other).unwrap();
    for name in ["im0.png", "im1.png", "disp0.pfm", "calib.txt"] {
        std::fs::copy(own.join(name), other.join(name)).unwrap();
    }
    assert_eq!(problems(&dataset), [""; 0]);
    for name in ["im0.png", "im1.png"] {
        let picture = image::open(other.join(name)).unwrap();
        picture
            .crop_imm(0, 0, 741, 480)
            .save(other.join(name))
            .unwrap();
    }
    std::fs::remove_file(other.join("disp0.pfm")).unwrap();
    edit(&other, |text| text.replace("height=500", "height=480"));
    let said = problems(&dataset);
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(
        said[1].contains("Other: the cameras are the same as those of Motorcycle-quarter, whose pictures are 741x500"),
        "{said:?}"
    );
    // With another principal point, it is a different camera.
    edit(&other, |text| text.replace("254.87675", "244.87675"));
    assert_eq!(problems(&dataset), [""; 0]);
    assert_eq!(copied_calibrations(&[]), []);
}

/// Disparities in sixteenths of pixels, with which few places land in the right picture, and depths in place of
/// disparities where principal points differ much.
#[test]
fn other_numbers_than_disparities_are_named_where_few_places_land() {
    const OFFSET: f64 = 30.0;
    let camera = (8.0 * BASELINE_M, 79.5 + OFFSET);
    let product = (8.0 * BASELINE_M * FOCAL) as f32;
    for seed in 0..4 {
        let proper = pair_of(seed, 1, camera);
        assert_eq!(of_pair(proper.clone()).0, "", "{seed}");
        let mut wrong = proper;
        change(&mut wrong, |pixels| {
            pixels.each(|z| product / (z + OFFSET as f32))
        });
        let (said, _) = of_pair(wrong);
        assert!(
            said.contains("the disparity map holds depth, "),
            "{seed}: {said}"
        );
        let mut wrong = pair(seed);
        let product = (BASELINE_M * FOCAL) as f32;
        change(&mut wrong, |pixels| {
            pixels.each(|z| product / (16.0 * (product / z - 2.5) + 2.5))
        });
        let (said, _) = of_pair(wrong);
        assert!(
            said.contains("should be multiplied by 0.06"),
            "{seed}: {said}"
        );
    }
}

/// Disparities from other parts of the map, in the same range, are reported; another exposure is not.
#[test]
fn disparities_of_another_scene_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = crate::bundled::extract(folder.path()).unwrap();
    let spec = DatasetSpec::parse(&format!("middlebury={}", dataset.display())).unwrap();
    let proper = open(&spec).unwrap().remove(0).views;
    let mut darker = proper.clone();
    change(&mut darker[1..], |pixels| {
        pixels.picture.iter_mut().for_each(|level| *level /= 2)
    });
    assert_eq!(of_pair(darker).0, "");
    for (across, down) in [(0, 250), (370, 250)] {
        let mut wrong = proper.clone();
        change(&mut wrong[..1], |pixels| {
            pixels.change(|depth| {
                let (w, h) = depth.dimensions();
                DepthMap::from_fn(w, h, |x, y| {
                    *depth.get_pixel((x + across) % w, (y + down) % h)
                })
            })
        });
        let (said, _) = of_pair(wrong);
        assert!(
            said.contains("match each other, but not at the disparities"),
            "{said}"
        );
    }
}

/// Advice names settings that the dataset's reader has, with values that it accepts.
#[test]
fn advised_settings_exist_in_every_reader() {
    let views = pair(0);
    let changes = [
        Change::Scale(0.5),
        Change::Scale(1e-6),
        Change::Inverse(2.0),
        Change::Buffer(0.1),
        Change::InverseBetween(1.0, 10.0),
        Change::RayLength,
        Change::NoRayLength,
        Change::Focal(Focal::Both, 0.25),
        Change::CentreSwapped,
        Change::Short(0.1),
        Change::Bent(0.1),
        Change::Turned("orientation=upright"),
        Change::Unlisted,
    ];
    let mut named = 0;
    for entry in ENTRIES {
        let spec = DatasetSpec::parse(&format!("{}=x", entry.format));
        let spec = spec.or_else(|_| DatasetSpec::parse(entry.format)).unwrap();
        let units = Units::of(&spec);
        let mut texts: Vec<String> = changes
            .iter()
            .map(|change| sentence(change, "", units, 1.0, &views))
            .collect();
        texts.push(units.where_to_set().to_owned());
        texts.push(units.inverted_masks(0.9));
        for text in texts {
            let words = text.split([' ', ',', ';', ':', '(', ')']);
            for (key, value) in words.filter_map(|word| word.split_once('=')) {
                let settings = entry.settings.iter().chain(&PICTURES);
                let mut settings = settings.filter(|setting| setting.key == key);
                let mut allows = |value: &str| settings.any(|setting| setting.allows(key, value));
                named += 1;
                assert!(
                    key.is_empty() || allows(value),
                    "{}: {key}={value}: {text}",
                    entry.format
                );
            }
        }
    }
    assert!(named > 20, "{named}");
}
