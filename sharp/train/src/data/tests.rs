use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec2;
use image::{GrayImage, Luma, Rgb, RgbImage};
use sharp::camera::baseline_m;
use sharp_datasets::synthetic::TRAINING_SEEDS;
use sharp_datasets::{DatasetError, DatasetSpec, DepthMap, View, ViewContent, bundled};

use super::procedural::{cameras, training_seed};
use super::*;

const SIZE: (u32, u32) = (64, 48);

fn spec(text: &str) -> DatasetSpec {
    DatasetSpec::parse(text).unwrap()
}

fn posed(text: &str, size: (u32, u32), limit_m: f64) -> Result<PosedSamples, DataError> {
    PosedSamples::open(&spec(text), 3, size, limit_m)
}

#[test]
fn a_sample_follows_from_seed_and_number() {
    let samples = ProceduralSamples::new(5, SIZE, TrainingWorlds::Varied);
    let first: Vec<Sample> = (0..4).map(|k| samples.get(k).unwrap()).collect();
    for k in [2, 0, 3, 1] {
        assert_eq!(samples.get(k).unwrap(), first[k as usize]);
    }
    for (a, b) in [(0, 1), (1, 2), (2, 3)] {
        assert_ne!(first[a].source.image, first[b].source.image);
    }
    let other = ProceduralSamples::new(6, SIZE, TrainingWorlds::Varied)
        .get(0)
        .unwrap();
    assert_ne!(other.id, first[0].id);
    for sample in &first {
        for view in [&sample.source, &sample.target] {
            assert_eq!(view.image.dimensions(), SIZE);
            assert_eq!(view.depth.dimensions(), SIZE);
            assert_eq!((view.intrinsics.width, view.intrinsics.height), SIZE);
            assert!(view.depth.iter().all(|z| *z > 0.3), "{}", sample.id);
        }
    }
}

#[test]
fn no_held_out_seed_is_drawn_and_all_others_may_be() {
    let seeds = (0..200_000).map(|k| training_seed(&mut draws(9, k)));
    let (mut low, mut high) = (u64::MAX, 0);
    for seed in seeds {
        (low, high) = (low.min(seed), high.max(seed));
    }
    // The smallest and largest of 200,000 draws are within 40 mean distances of the range's ends.
    assert!(TRAINING_SEEDS.contains(&low) && low < 1_200, "{low}");
    assert!(TRAINING_SEEDS.contains(&high) && high > 899_800, "{high}");
    for (text, shared) in [
        ("synthetic", false),
        ("synthetic=seed=999", false),
        ("synthetic=seed=999,scenes=2", true),
        ("synthetic=seed=1000,world=varied", true),
        ("synthetic=seed=899999", true),
        ("synthetic=seed=900000,scenes=1000,world=varied", false),
        ("middlebury=/nowhere", false),
    ] {
        assert_eq!(
            shares_training_seeds(&spec(text)).unwrap(),
            shared,
            "{text}"
        );
    }
    assert!(shares_training_seeds(&spec("synthetic=seed=x")).is_err());
    for text in [
        "synthetic=seed=7",
        "synthetic=seed=899999,scenes=2,world=varied",
    ] {
        let error = posed(text, SIZE, 0.6).unwrap_err();
        assert!(matches!(error, DataError::HeldOut { .. }), "{error}");
    }
}

#[test]
fn the_central_camera_is_the_source_half_of_the_time() {
    let pairs = (0..20_000).map(|k| cameras(&mut draws(1, k), 11));
    let (mut central, mut reached) = (0, [0_u32; 11]);
    for (source, target) in pairs {
        assert!(source != target && source < 11);
        central += u32::from(source == 0);
        reached[target as usize] += 1;
    }
    // Half of the samples, and an eleventh of the other half; five standard deviations are 350.
    assert!(central.abs_diff(10_909) < 350, "{central}");
    assert!(reached.iter().all(|count| *count > 700), "{reached:?}");
}

/// Warps the target's surface points into the source's picture. Of those that fall inside it,
/// returns two shares: points on a surface that the source sees (to 5 % of depth, among the nine
/// pixels around), and points in front of everything that the source sees there.
pub(crate) fn warped(sample: &Sample) -> (f64, f64) {
    let (source, target) = (&sample.source, &sample.target);
    let pose = source.camera_from_world;
    let source_from_target = pose.after(&target.camera_from_world.inverse());
    let (mut inside, mut there, mut before) = (0, 0, 0);
    for (x, y, z) in target.depth.enumerate_pixels() {
        let z = f64::from(z.0[0]);
        if !z.is_finite() || z == 0.0 {
            continue;
        }
        let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let point = source_from_target.apply(target.intrinsics.unproject(center, z));
        let Some(pixel) = source.intrinsics.project(point) else {
            continue;
        };
        let (width, height) = source.depth.dimensions();
        let (column, row) = (pixel.x.floor() as i64, pixel.y.floor() as i64);
        if !(1..i64::from(width) - 1).contains(&column)
            || !(1..i64::from(height) - 1).contains(&row)
        {
            continue;
        }
        let around = (-1..=1).flat_map(|j| (-1..=1).map(move |i| (column + i, row + j)));
        let around =
            around.map(|(x, y)| f64::from(source.depth.get_pixel(x as u32, y as u32).0[0]));
        let around: Vec<f64> = around.filter(|z| *z > 0.0).collect();
        if around.is_empty() {
            continue;
        }
        let low = around.iter().copied().fold(f64::INFINITY, f64::min);
        let high = around.iter().copied().fold(0.0, f64::max);
        inside += 1;
        there += u32::from((0.95 * low..=1.05 * high).contains(&point.z));
        before += u32::from(point.z < 0.95 * low);
    }
    let share = |count| f64::from(count) / f64::from(inside.max(1));
    assert!(inside > 0, "{}", sample.id);
    (share(there), share(before))
}

#[test]
fn poses_and_depth_of_a_sample_agree() {
    let samples = ProceduralSamples::new(2, (96, 96), TrainingWorlds::Varied);
    let mut mean_when_swapped = 0.0;
    for k in 0..24 {
        let mut sample = samples.get(k).unwrap();
        let (there, before) = warped(&sample);
        assert!(
            there > 0.7 && before < 0.01,
            "{}: {there} {before}",
            sample.id
        );
        std::mem::swap(
            &mut sample.source.camera_from_world,
            &mut sample.target.camera_from_world,
        );
        mean_when_swapped += warped(&sample).1 / 24.0;
    }
    assert!(mean_when_swapped > 0.03, "{mean_when_swapped}");
}

#[test]
fn every_other_sample_may_be_reflective() {
    let [varied, half] = [TrainingWorlds::Varied, TrainingWorlds::HalfReflective]
        .map(|worlds| ProceduralSamples::new(5, SIZE, worlds));
    let photographs = ProceduralPhotographs::new(5, SIZE, TrainingWorlds::HalfReflective);
    for k in 0..6 {
        let [a, b] = [&varied, &half].map(|samples| samples.get(k).unwrap());
        assert_eq!((a.id == b.id, a == b), (true, k % 2 == 0), "{}", a.id);
        assert_eq!(photographs.get(k).unwrap().image.dimensions(), SIZE);
    }
}

#[test]
fn posed_pairs_keep_to_the_limit() {
    let text = "synthetic=seed=1000,scenes=6,size=144x108,views=8,world=varied";
    let size = (96, 72);
    let samples = posed(text, size, 0.25).unwrap();
    let mut scenes = std::collections::BTreeSet::new();
    for k in 0..40 {
        let sample = samples.get(k).unwrap();
        let poses = [&sample.source, &sample.target].map(|view| view.camera_from_world);
        let metres = baseline_m(&poses[0], &poses[1]);
        assert!(metres > 0.0 && metres <= 0.25, "{}: {metres}", sample.id);
        assert_eq!(sample.source.image.dimensions(), size);
        let (there, before) = warped(&sample);
        assert!(
            there > 0.6 && before < 0.02,
            "{}: {there} {before}",
            sample.id
        );
        assert_eq!(samples.get(k).unwrap(), sample);
        scenes.insert(sample.id[..8].to_owned());
    }
    assert_eq!(scenes.len(), 6);
    let error = posed(text, size, 1e-6).unwrap_err();
    assert!(matches!(error, DataError::NoPair { .. }), "{error}");
}

#[test]
fn views_without_depth_and_broken_scenes_are_left_out_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = bundled::extract(folder.path()).unwrap();
    let text = format!("middlebury={}", path.display());
    let error = posed(&text, SIZE, 0.6).unwrap_err().to_string();
    assert!(error.contains("; 1 of 2 views have no depth"), "{error}");
    // The left view's map is used as the right view's.
    let scene = path.join("Motorcycle-quarter");
    for other in ["Broken", "Half"] {
        std::fs::create_dir(path.join(other)).unwrap();
        for entry in std::fs::read_dir(&scene).unwrap() {
            let file = entry.unwrap();
            std::fs::copy(file.path(), path.join(other).join(file.file_name())).unwrap();
        }
    }
    std::fs::write(path.join("Broken/calib.txt"), "cam0=").unwrap();
    std::fs::copy(scene.join("disp0.pfm"), scene.join("disp1.pfm")).unwrap();
    let samples = posed(&text, SIZE, 0.6).unwrap();
    let [broken, without] = samples.left_out() else {
        panic!("{:?}", samples.left_out());
    };
    assert!(
        broken.contains("'Broken'") && broken.contains("calib.txt"),
        "{broken}"
    );
    assert!(
        without.ends_with("1 of 4 views have no depth and are left out"),
        "{without}"
    );
    for k in 0..20 {
        assert!(samples.get(k).unwrap().id.starts_with("Motorcycle"));
    }
    let sample = samples.get(0).unwrap();
    let known = sample.source.depth.iter().filter(|z| **z > 0.0).count();
    let unknown = sample.source.depth.iter().filter(|z| **z == 0.0).count();
    assert!(known > 2000 && unknown > 0, "{known} {unknown}");
    assert!(sample.source.depth.iter().all(|z| z.is_finite()));
    let k = sample.source.intrinsics;
    assert!(k.fx / f64::from(k.width) > 1.0 && k.cx < 64.0 && k.cy < 48.0);
}

/// A view of a file whose left half is excluded.
#[derive(Debug)]
struct Masked;

const MASKED: (u32, u32) = (100, 30);

impl ViewContent for Masked {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        Ok(RgbImage::new(MASKED.0, MASKED.1))
    }

    fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError> {
        let level = |x, _| Luma([if x < 50 { 0 } else { 255 }]);
        Ok(Some(GrayImage::from_fn(MASKED.0, MASKED.1, level)))
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        Ok(Some(DepthMap::new(MASKED.0, MASKED.1)))
    }

    fn image_file(&self) -> Option<&Path> {
        Some(Path::new("masked.png"))
    }
}

/// Pixels that a dataset has painted black must not be learnt.
#[test]
fn excluded_pixels_do_not_count() {
    let scene = sharp_datasets::open(&spec("synthetic=size=100x30,views=2")).unwrap();
    let plain = &scene[0].views[0];
    assert_eq!(TrainingView::read(plain, (20, 10)).unwrap().valid, None);
    let masked = View {
        content: Arc::new(Masked),
        ..plain.clone()
    };
    for (width, columns) in [
        (20, 10..20),
        (100, 50..100),
        (10, 5..10),
        (8, 4..8),
        (3, 2..3),
    ] {
        let view = TrainingView::read(&masked, (width, 10)).unwrap();
        let valid = view.valid.unwrap();
        assert_eq!(valid.len(), width as usize * 10);
        for (k, valid) in valid.iter().enumerate() {
            let column = k as u32 % width;
            assert_eq!(*valid, columns.contains(&column), "{width}: {column}");
        }
    }
}

fn gradient(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| Rgb([x as u8 * 5, y as u8 * 7, 90]))
}

#[test]
fn photographs_of_a_folder_keep_pixels_and_have_a_focal_length() {
    let folder = tempfile::tempdir().unwrap();
    let open = |size| FolderPhotographs::open(folder.path(), None, 1, size);
    assert!(matches!(open(SIZE), Err(DataError::NoPicture { .. })));
    std::fs::write(folder.path().join("notes.txt"), "no picture").unwrap();
    gradient(40, 30)
        .save(folder.path().join("one.png"))
        .unwrap();
    std::fs::create_dir(folder.path().join("more")).unwrap();
    gradient(30, 40)
        .save(folder.path().join("more/two.PNG"))
        .unwrap();
    let same = open((40, 30)).unwrap();
    let mut seen = std::collections::BTreeSet::new();
    for k in 0..20 {
        let photograph = same.get(k).unwrap();
        assert_eq!(same.get(k).unwrap(), photograph);
        if photograph.id == "one.png" {
            assert_eq!(photograph.image, gradient(40, 30));
        }
        seen.insert(photograph.id);
    }
    assert_eq!(
        seen.into_iter().collect::<Vec<_>>(),
        ["more/two.PNG", "one.png"]
    );
    let square = open((24, 24)).unwrap();
    let photograph = square.get(0).unwrap();
    assert_eq!(photograph.image.dimensions(), (24, 24));
    // 30 mm measured by the diagonal: 50 pixels and 43.2666 mm.
    let focal = 30.0 * 50.0 / 43.266_615_305_567_87;
    let k = photograph.intrinsics;
    let (w, h) = match photograph.id.as_str() {
        "one.png" => (40.0, 30.0),
        _ => (30.0, 40.0),
    };
    assert!((k.fx - focal * 24.0 / w).abs() < 1e-9 && (k.fy - focal * 24.0 / h).abs() < 1e-9);
    assert_eq!((k.cx, k.cy), (12.0, 12.0));

    std::fs::write(folder.path().join("one.png"), b"\x89PNG\r\n\x1a\nbroken").unwrap();
    let errors = (0..20).filter_map(|k| square.get(k).err());
    let errors: Vec<String> = errors.map(|error| error.to_string()).collect();
    assert!(!errors.is_empty());
    assert!(
        errors.iter().all(|error| error.contains("sample one.png")),
        "{errors:?}"
    );
    let nowhere = FolderPhotographs::open(Path::new("/nowhere"), None, 1, SIZE);
    assert!(nowhere.unwrap_err().to_string().contains("/nowhere"));
}

#[test]
fn held_out_entries_of_a_folder_are_never_training_data() {
    let folder = tempfile::tempdir().unwrap();
    // In natural order: 1.png, 2, 3.png, 10, 11.png; a folder without pictures does not count.
    for name in ["1.png", "2/a.png", "2/b.png", "3.png", "10/a.png", "11.png"] {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        gradient(8, 8).save(path).unwrap();
    }
    std::fs::create_dir(folder.path().join("0")).unwrap();
    let kept = |every| {
        let photographs = FolderPhotographs::open(folder.path(), Some(every), 1, (8, 8)).unwrap();
        let ids = (0..100).map(|k| photographs.get(k).unwrap().id);
        ids.collect::<std::collections::BTreeSet<_>>()
    };
    let held_out = |every: usize| {
        let paths = held_out_entries(folder.path(), every).unwrap();
        let names = paths.iter().map(|path| path.strip_prefix(folder.path()));
        let names = names.map(|name| name.unwrap().display().to_string());
        names.collect::<Vec<_>>()
    };
    assert_eq!(held_out(2), ["2", "10"]);
    assert_eq!(
        kept(2).into_iter().collect::<Vec<_>>(),
        ["1.png", "11.png", "3.png"]
    );
    assert_eq!(held_out(5), ["11.png"]);
    assert_eq!(kept(5).len(), 5);
    let error = FolderPhotographs::open(folder.path(), Some(6), 1, SIZE).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("too few files and subfolders with pictures (5)"),
        "{error}"
    );
}

#[test]
fn procedural_photographs_are_of_training_scenes() {
    let photographs = ProceduralPhotographs::new(4, SIZE, TrainingWorlds::Varied);
    let taken: Vec<Photograph> = (0..6).map(|k| photographs.get(k).unwrap()).collect();
    assert_eq!(photographs.get(3).unwrap(), taken[3]);
    for photograph in &taken {
        let seed = photograph.id.strip_prefix("seed").unwrap();
        let (seed, _) = seed.split_once('/').unwrap();
        assert!(TRAINING_SEEDS.contains(&seed.parse().unwrap()));
        assert_eq!(photograph.image.dimensions(), SIZE);
    }
    assert!(taken.windows(2).all(|two| two[0].image != two[1].image));
}

/// Counts how often it is called; sample 13 is an error, sample 21 a panic.
struct Numbers(Arc<AtomicU64>);

impl Source<u64> for Numbers {
    fn get(&self, k: u64) -> Result<u64, DataError> {
        self.0.fetch_add(1, Ordering::SeqCst);
        assert_ne!(k, 21);
        match k {
            13 => Err(DataError::Stopped.of_sample("thirteen")),
            _ => Ok(k),
        }
    }
}

#[test]
fn a_prefetcher_keeps_the_order_and_hands_errors_on() {
    let made = Arc::new(AtomicU64::new(0));
    let mut samples = Prefetcher::start(Numbers(Arc::clone(&made)), 10, 3).unwrap();
    for k in [10, 11, 12] {
        assert_eq!(samples.fetch().unwrap(), k);
    }
    let error = samples.fetch().unwrap_err().to_string();
    assert!(error.starts_with("sample thirteen"), "{error}");
    assert_eq!(samples.fetch().unwrap(), 14);
    drop(samples);
    // Five were fetched, three are waiting, one is being prepared.
    let at_the_end = made.load(Ordering::SeqCst);
    assert!((5..=9).contains(&at_the_end), "{at_the_end}");
    std::thread::sleep(std::time::Duration::from_millis(20));
    assert_eq!(made.load(Ordering::SeqCst), at_the_end);

    let mut samples = Prefetcher::start(Numbers(made), 20, 2).unwrap();
    assert_eq!(samples.fetch().unwrap(), 20);
    assert!(matches!(samples.fetch(), Err(DataError::Stopped)));
}

#[test]
fn prefetched_samples_are_those_of_the_source() {
    let samples = ProceduralSamples::new(8, (32, 32), TrainingWorlds::Varied);
    let chosen: Box<dyn Source<Sample>> = Box::new(samples.clone());
    let mut ahead = Prefetcher::start(chosen, 2, 2).unwrap();
    for k in 2..6 {
        assert_eq!(ahead.fetch().unwrap(), samples.get(k).unwrap());
    }
}
