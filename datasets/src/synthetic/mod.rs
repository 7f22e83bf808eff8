//! A procedural scene, ray-cast in f64: photographs, exact depth and exact visibility.
//!
//! The scene consists of textured planes, boxes, spheres, thin poles and wires, an occluder close to the cameras, and a
//! sky without depth. It is seen by concentric rings of cameras; no two cameras are more than 60 cm apart (the rig of
//! the paper's synthetic data). A seed determines everything.
//!
//! Only additions, multiplications, divisions, square roots and integer hashes are used. Their results are exactly
//! defined (for floating point, by IEEE 754), so pictures and depths are the same on every machine and for any number
//! of threads.
//!
//! * `arithmetic`: replacements for the few libm functions needed.
//! * `shapes`: rectangles, boxes, spheres, cylinders, and their intersections with rays.
//! * `texture`: colours from integer noise.
//! * `world`: objects and lights, and the radiance along a ray.
//! * `classic`: the objects of the classic scene.
//! * `candidates`: the objects that a bundle of rays can hit.
//! * `varied`: training scenes of many kinds; `paint`, `finish` and `light`: their colours, their mirrors and panes, and
//!   their light.
//! * `rig`: the cameras.
//! * `sweep`: sweeps of a single motion, step by step.
//! * `content`: pictures and depth of views.

mod arithmetic;
mod candidates;
mod classic;
mod content;
mod finish;
mod light;
mod paint;
#[cfg(test)]
mod reflection_tests;
mod rig;
mod shapes;
mod sweep;
mod texture;
mod varied;
mod world;

use std::ops::RangeInclusive;
use std::sync::Arc;

use glam::DVec2;
use sharp::camera::{CameraError, RigidTransform};

use crate::DatasetEntry;
use crate::found_scenes::FoundScenes;
use crate::lens::{Distortion, Lens};
use crate::setting::{Setting, choice};
use crate::{DatasetError, DatasetSpec, Pairing, Scene, View};
use content::ProceduralContent;
use rig::Rig;
use sweep::SweepKind;
use world::World;

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "synthetic",
    display_name: "synthetic",
    title: "a procedural multi-view scene with exact depth and visibility",
    terms: "part of sharp-bench",
    size: "computed",
    layout: "takes no folder; write `synthetic` or `synthetic=seed=7,size=320x240,views=24`",
    caveat: "no photograph",
    settings: &[
        Setting::free("seed", "seed of the random scene", "0"),
        Setting::free(
            "size",
            "size of the pictures in pixels, WIDTHxHEIGHT",
            "320x240",
        ),
        Setting::free(
            "views",
            "number of cameras, at least 2 (auto: 24; 11 in a varied or reflective world)",
            "auto",
        ),
        Setting::free(
            "scenes",
            "number of scenes, 1 to 1000: one for this seed and one for each following seed",
            "1",
        ),
        Setting::choice(
            "world",
            "kind of world",
            &[
                choice(
                    "classic",
                    "a fixed layout; the seed determines the positions and colours of the objects",
                ),
                choice(
                    "varied",
                    "the seed determines everything: rooms, tables, corridors, gardens, streets, their light and the \
                     lens; one scene in eight is classic",
                ),
                choice(
                    "reflective",
                    "like varied, but with light from the sky, no classic scenes, and with mirrors, panes of glass \
                     and water, whose depth is that of their surface",
                ),
            ],
        ),
        Setting::choice(
            "sweep",
            "which quantity increases from target to target, while the source camera stays the same",
            &[
                choice(
                    "none",
                    "cameras on rings around the first one; all pairs with enough overlap",
                ),
                choice("translation", "the target's camera moves to the right"),
                choice(
                    "rotation",
                    "the target's camera turns to the right in place",
                ),
                choice(
                    "occlusion",
                    "the target's camera is 10 cm to the right, and the number of posts in front \
                     of both increases",
                ),
            ],
        ),
        Setting::free(
            "step",
            "size of each step of a sweep, which has one step fewer than views: in metres (auto: 0.05; at most 10 in \
             total), degrees (auto: 2; at most 90 in total) or posts (auto: 1; at most 15 in total)",
            "auto",
        ),
    ],
    open,
    ..DatasetEntry::OWN
};

/// Seeds on which networks may be trained. All other seeds are held out, so that measurements with
/// them use unseen scenes.
pub const TRAINING_SEEDS: RangeInclusive<u64> = 1_000..=899_999;

/// Kind of world, which determines what a seed randomises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WorldKind {
    /// Positions and colours of the objects in a fixed layout.
    #[default]
    Classic,
    /// Everything: the kind of scene, its light and the lens.
    Varied,
    /// A varied scene with mirrors, panes of glass and water, lit by its sky.
    Reflective,
}

/// Parameters that determine a procedural scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SyntheticOptions {
    pub seed: u64,
    pub width: u32,
    pub height: u32,
    /// Number of cameras, from the centre outwards.
    pub views: usize,
    pub world: WorldKind,
    /// Number of rays per pixel along each axis over which colour is averaged, 1 to 16.
    pub samples: u32,
}

const CLASSIC_VIEWS: usize = 24;
const VARIED_VIEWS: usize = 11;

impl Default for SyntheticOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            width: 320,
            height: 240,
            views: CLASSIC_VIEWS,
            world: WorldKind::Classic,
            samples: 3,
        }
    }
}

impl SyntheticOptions {
    /// A varied scene as used for training: 256×256 pixels, one central camera and ten around it, 2×2 rays per pixel.
    pub fn varied(seed: u64) -> Self {
        Self {
            seed,
            width: 256,
            height: 256,
            views: VARIED_VIEWS,
            world: WorldKind::Varied,
            samples: 2,
        }
    }

    fn lens(&self, rig: &Rig) -> Result<Lens, CameraError> {
        let k = rig.intrinsics(self.width, self.height);
        let size = (k.width, k.height);
        Lens::new((k.fx, k.fy), (k.cx, k.cy), size, Distortion::None)
    }
}

/// A procedural scene with exact visibility. For a lens without distortion, its depth is 0 at
/// exactly the pixels that show the sky.
#[derive(Debug, Clone)]
pub struct SyntheticScene {
    world: Arc<World>,
    lens: Lens,
    views: Vec<View>,
    options: SyntheticOptions,
}

impl SyntheticScene {
    /// Builds the scene; pictures are computed on demand.
    ///
    /// # Errors
    /// [`DatasetError::Spec`] for a picture with no pixels or more than 2²⁸, and for fewer than 2 or more than 10,000
    /// views.
    pub fn new(options: SyntheticOptions) -> Result<Self, DatasetError> {
        let refuse = |reason: String| DatasetError::Spec {
            text: ENTRY.format.to_owned(),
            reason,
        };
        let pixels = u64::from(options.width) * u64::from(options.height);
        if pixels == 0 || pixels > 1 << 28 {
            return Err(refuse(format!(
                "cannot make pictures of {}x{} pixels",
                options.width, options.height
            )));
        }
        if !(2..=10_000).contains(&options.views) {
            return Err(refuse(format!(
                "cannot place {} views; 2 to 10000 are possible",
                options.views
            )));
        }
        if !(1..=16).contains(&options.samples) {
            return Err(refuse(format!(
                "cannot take {0}x{0} samples per pixel; 1 to 16 per side are possible",
                options.samples
            )));
        }
        let (world, rig) = match options.world {
            WorldKind::Classic => (classic::world(options.seed, 0), Rig::CLASSIC),
            WorldKind::Varied => varied::scene(options.seed),
            WorldKind::Reflective => varied::reflective_scene(options.seed),
        };
        let lens = options.lens(&rig).map_err(|e| refuse(e.to_string()))?;
        let mut scene = Self {
            world: Arc::new(world),
            lens,
            views: Vec::new(),
            options,
        };
        let poses = rig.poses(options.views).into_iter().enumerate();
        scene.views = poses
            .map(|(i, pose)| scene.view_through(&format!("view_{i:02}"), lens, pose))
            .collect();
        Ok(scene)
    }

    /// The cameras, with their pictures and depth.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// A view of the same world through any camera. If the lens distorts, picture and depth are
    /// those of the lens, not of the pinhole that the view's intrinsics describe.
    pub fn view_through(&self, id: &str, lens: Lens, camera_from_world: RigidTransform) -> View {
        let samples = self.options.samples;
        view_of(&self.world, id.to_owned(), lens, camera_from_world, samples)
    }

    /// The views as a scene of a dataset.
    pub fn scene(&self, dataset: &str) -> Scene {
        let id = format!("seed{}", self.options.seed);
        Scene::new(dataset, id, self.views.clone(), Pairing::MultiView)
    }

    /// True if the surface point at the centre of `pixel` in view `seen_in` is also visible in view `from`: inside that
    /// view's picture and not occluded. `None` if the pixel shows the sky. Exact, because it is determined by casting
    /// rays rather than comparing depth maps.
    ///
    /// # Panics
    /// If a view's index is out of range.
    pub fn visible(&self, seen_in: usize, pixel: (u32, u32), from: usize) -> Option<bool> {
        let (a, b) = (&self.views[seen_in], &self.views[from]);
        let center = DVec2::new(f64::from(pixel.0) + 0.5, f64::from(pixel.1) + 0.5);
        let world_from_a = a.camera_from_world.inverse();
        let direction = world_from_a.rotation * a.intrinsics.unproject(center, 1.0);
        let hit = self.world.first_hit(world_from_a.translation, direction)?;
        let point = world_from_a.translation + direction * hit.distance;
        let inside = b
            .intrinsics
            .project(b.camera_from_world.apply(point))
            .is_some_and(|p| b.intrinsics.contains(p));
        if !inside {
            return Some(false);
        }
        let eye = b.camera_from_world.camera_center();
        // The surface itself is at distance 1, up to rounding.
        let blocked = self
            .world
            .first_hit(eye, point - eye)
            .is_some_and(|other| other.distance < 1.0 - 1e-9);
        Some(!blocked)
    }

    /// Fraction of the pixels with depth in view `seen_in` whose surface points are also visible in view `from`; `None`
    /// if no pixel has depth. An overlap estimated from depth maps should be close to this.
    ///
    /// # Panics
    /// If a view's index is out of range.
    pub fn visible_share(&self, seen_in: usize, from: usize) -> Option<f64> {
        let (mut with_depth, mut seen) = (0_u64, 0_u64);
        for y in 0..self.options.height {
            for x in 0..self.options.width {
                if let Some(visible) = self.visible(seen_in, (x, y), from) {
                    with_depth += 1;
                    seen += u64::from(visible);
                }
            }
        }
        (with_depth > 0).then(|| seen as f64 / with_depth as f64)
    }
}

fn view_of(
    world: &Arc<World>,
    id: String,
    lens: Lens,
    camera_from_world: RigidTransform,
    samples: u32,
) -> View {
    View {
        id,
        intrinsics: lens.intrinsics(),
        camera_from_world,
        content: Arc::new(ProceduralContent::new(
            Arc::clone(world),
            lens,
            camera_from_world,
            samples,
        )),
    }
}

const MAX_SCENES: u64 = 1000;

/// Value of a setting that must be an integer.
fn number(spec: &DatasetSpec, key: &str) -> Result<u64, DatasetError> {
    let text = spec.setting(key);
    text.parse().map_err(|_| wrong(spec, key))
}

fn wrong(spec: &DatasetSpec, key: &str) -> DatasetError {
    spec.refused(format!("'{key}' cannot be '{}'", spec.setting(key)))
}

/// Seeds of a dataset's scenes; `None` if the dataset is not procedural.
///
/// # Errors
/// [`DatasetError::Spec`] for an invalid seed or number of scenes.
pub fn seeds_of(spec: &DatasetSpec) -> Result<Option<RangeInclusive<u64>>, DatasetError> {
    if spec.entry.format != ENTRY.format {
        return Ok(None);
    }
    let (seed, scenes) = (number(spec, "seed")?, number(spec, "scenes")?);
    let allowed = (1..=MAX_SCENES).contains(&scenes);
    // The end of the range must not overflow.
    match seed.checked_add(scenes).filter(|_| allowed) {
        Some(end) => Ok(Some(seed..=end - 1)),
        None => Err(wrong(spec, "scenes")),
    }
}

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let size = spec.setting("size");
    let (width, height) = size
        .split_once('x')
        .and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)))
        .ok_or_else(|| wrong(spec, "size"))?;
    let world = match spec.setting("world") {
        "varied" => WorldKind::Varied,
        "reflective" => WorldKind::Reflective,
        _ => WorldKind::Classic,
    };
    let views = match (spec.setting("views"), world) {
        ("auto", WorldKind::Classic) => CLASSIC_VIEWS,
        ("auto", _) => VARIED_VIEWS,
        _ => usize::try_from(number(spec, "views")?).unwrap_or(usize::MAX),
    };
    let kind = SweepKind::of(spec)?;
    if kind.is_some() && world != WorldKind::Classic {
        return Err(spec.refused("sweeps are only available with world=classic".to_owned()));
    }
    let mut scenes = Vec::new();
    for seed in seeds_of(spec)?.into_iter().flatten() {
        let options = SyntheticOptions {
            seed,
            width,
            height,
            views,
            world,
            ..SyntheticOptions::default()
        };
        let rings = SyntheticScene::new(options)?;
        match kind {
            None => scenes.push(rings.scene(&spec.name)),
            Some(kind) => scenes.extend(kind.scenes(&rings, &spec.name)?),
        }
    }
    Ok(FoundScenes {
        scenes,
        left_out: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp::camera::baseline_m;

    fn small() -> SyntheticScene {
        SyntheticScene::new(SyntheticOptions {
            width: 96,
            height: 72,
            ..SyntheticOptions::default()
        })
        .unwrap()
    }

    #[test]
    fn no_two_cameras_are_further_apart_than_the_papers() {
        let scene = small();
        let mut widest: f64 = 0.0;
        for a in scene.views() {
            for b in scene.views() {
                widest = widest.max(baseline_m(&a.camera_from_world, &b.camera_from_world));
            }
        }
        assert!((0.55..=0.6).contains(&widest), "{widest}");
        assert_eq!(scene.views().len(), 24);
    }

    #[test]
    fn every_view_sees_ground_objects_and_sky() {
        for view in small().views() {
            let depth = view.content.depth().unwrap().unwrap();
            let valid: Vec<f32> = depth.iter().copied().filter(|d| *d > 0.0).collect();
            let share = valid.len() as f64 / (96.0 * 72.0);
            assert!((0.5..0.97).contains(&share), "{}: {share}", view.id);
            let nearest = valid.iter().copied().fold(f32::MAX, f32::min);
            let farthest = valid.iter().copied().fold(0.0, f32::max);
            assert!((0.6..1.6).contains(&nearest), "{}: {nearest}", view.id);
            assert!(farthest > 6.0, "{}: {farthest}", view.id);
        }
    }

    #[test]
    fn a_view_sees_its_own_surfaces_and_the_occluder_hides_some_of_another_view() {
        let scene = small();
        assert_eq!(scene.visible_share(3, 3), Some(1.0));
        let share = scene.visible_share(0, 23).unwrap();
        assert!((0.5..0.98).contains(&share), "{share}");
        let (mut sky, mut hidden_inside) = (0, 0);
        let (a, b) = (&scene.views()[0], &scene.views()[23]);
        let depth = a.content.depth().unwrap().unwrap();
        let b_from_a = b.camera_from_world.after(&a.camera_from_world.inverse());
        for (x, y, value) in depth.enumerate_pixels() {
            let visible = scene.visible(0, (x, y), 23);
            assert_eq!(visible.is_none(), value.0[0] == 0.0);
            let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let point = b_from_a.apply(a.intrinsics.unproject(center, f64::from(value.0[0])));
            let inside = b
                .intrinsics
                .project(point)
                .is_some_and(|p| b.intrinsics.contains(p));
            sky += u32::from(visible.is_none());
            hidden_inside += u32::from(visible == Some(false) && inside);
        }
        assert!(sky > 100, "{sky}");
        assert!(hidden_inside > 50, "{hidden_inside}");
    }

    #[test]
    fn seeds_make_different_scenes_and_the_same_seed_the_same() {
        let hash = |seed| {
            let options = SyntheticOptions {
                seed,
                width: 40,
                height: 30,
                views: 2,
                ..SyntheticOptions::default()
            };
            let scene = SyntheticScene::new(options).unwrap();
            scene.views()[1].content.image_sha256().unwrap()
        };
        assert_eq!(hash(5), hash(5));
        assert_ne!(hash(5), hash(6));
    }

    /// The hash was recorded once. It changes only with the scene itself, never with the machine or
    /// the number of threads.
    #[test]
    fn pictures_are_the_same_on_every_machine() {
        let options = SyntheticOptions {
            seed: 7,
            width: 64,
            height: 48,
            views: 2,
            ..SyntheticOptions::default()
        };
        let scene = SyntheticScene::new(options).unwrap();
        assert_eq!(
            scene.views()[1].content.image_sha256().unwrap(),
            "cf082fc3b0a4b3fafca12d6935973b0cb9da2eaa9e95b67ce686ef53d1aecf98"
        );
    }

    #[test]
    fn several_scenes_are_those_of_consecutive_seeds() {
        let ids = |text: &str| -> Vec<String> {
            let found = crate::open(&DatasetSpec::parse(text).unwrap()).unwrap();
            found.into_iter().map(|scene| scene.id).collect()
        };
        assert_eq!(
            ids("synthetic=seed=7,scenes=2,size=8x6,views=2"),
            ["seed7", "seed8"]
        );
        assert_eq!(ids("synthetic=size=8x6,views=2"), ["seed0"]);
    }

    #[test]
    fn impossible_options_are_refused() {
        for text in [
            "synthetic=size=0x240",
            "synthetic=size=320",
            "synthetic=size=99999x99999",
            "synthetic=views=1",
            "synthetic=views=99999999999999999999",
            "synthetic=seed=-1",
            "synthetic=scenes=0",
            "synthetic=scenes=1001",
            "synthetic=world=other",
            "synthetic=world=varied,sweep=translation",
            "synthetic=world=reflective,sweep=translation",
            "synthetic=seed=18446744073709551615,scenes=2",
            "synthetic=sweep=zoom",
            "synthetic=step=0.1",
            "synthetic=sweep=translation,step=0",
            "synthetic=sweep=rotation,step=5",
            "synthetic=sweep=occlusion,step=0.5",
        ] {
            let found = DatasetSpec::parse(text).and_then(|spec| crate::open(&spec));
            assert!(found.is_err(), "{text}");
        }
    }
}
