//! Controlled sweeps: one source camera is paired with targets along which a single quantity increases step by step.
//! This quantity is the camera's translation, its rotation, or the number of posts in front of both cameras.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use sharp::camera::RigidTransform;

use super::arithmetic::unit_circle;
use super::world::World;
use super::{SyntheticScene, classic, view_of};
use crate::{DatasetError, DatasetSpec, Pairing, Scene};

/// Offset of an occlusion sweep's target camera to the right of the source, in metres.
const OCCLUSION_BASELINE_M: f64 = 0.1;
/// Maximum translation, metres; beyond it, hardly anything of the source remains visible.
const FARTHEST_MOVE: f64 = 10.0;
/// Maximum rotation, degrees; beyond it, hardly anything of the source remains visible.
const FARTHEST_TURN: f64 = 90.0;
/// Maximum number of posts; more would overlap.
const MAX_POSTS: f64 = 15.0;

/// The quantity that increases, and its step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum SweepKind {
    TranslationM(f64),
    RotationDeg(f64),
    Posts(usize),
}

impl SweepKind {
    /// The sweep that `spec` requests; `None` for rings of cameras.
    ///
    /// # Errors
    /// [`DatasetError::Spec`] for an invalid step.
    pub(super) fn of(spec: &DatasetSpec) -> Result<Option<Self>, DatasetError> {
        let text = spec.setting("step");
        let wrong = |reason: &str| spec.refused(format!("'step' cannot be '{text}': {reason}"));
        let given = if text == "auto" {
            None
        } else {
            let step: Option<f64> = text
                .parse()
                .ok()
                .filter(|s: &f64| s.is_finite() && *s > 0.0);
            Some(step.ok_or_else(|| wrong("it must be a number above zero"))?)
        };
        Ok(Some(match spec.setting("sweep") {
            "translation" => Self::TranslationM(given.unwrap_or(0.05)),
            "rotation" => Self::RotationDeg(given.unwrap_or(2.0)),
            "occlusion" => match given.unwrap_or(1.0) {
                posts if posts.fract() == 0.0 && posts <= MAX_POSTS => Self::Posts(posts as usize),
                _ => {
                    return Err(wrong(&format!(
                        "it must be a whole number of posts up to {MAX_POSTS}"
                    )));
                }
            },
            _ if given.is_some() => return Err(wrong("only sweeps have steps")),
            _ => return Ok(None),
        }))
    }

    /// One scene that pairs the first camera with each of the others; with posts, one scene per
    /// step, because each step has its own posts. All scenes are in the seed's cluster.
    pub(super) fn scenes(
        self,
        rings: &SyntheticScene,
        dataset: &str,
    ) -> Result<Vec<Scene>, DatasetError> {
        let refuse = |reason: String| DatasetError::Spec {
            text: super::ENTRY.format.to_owned(),
            reason,
        };
        let options = rings.options;
        let lens = rings.lens;
        let source = rings.views[0].camera_from_world;
        let cluster = rings.scene(dataset).cluster;
        let (step, most, unit) = match self {
            Self::TranslationM(step) => (step, FARTHEST_MOVE, "m"),
            Self::RotationDeg(step) => (step, FARTHEST_TURN, "degrees"),
            Self::Posts(step) => (step as f64, MAX_POSTS, "posts"),
        };
        let count = options.views - 1;
        if step * count as f64 > most {
            return Err(refuse(format!(
                "a sweep of {count} steps of that size goes beyond {most} {unit}; use fewer views or a smaller step"
            )));
        }
        let view = |world: &Arc<World>, step: usize, pose| {
            view_of(
                world,
                format!("view_{step:02}"),
                lens,
                pose,
                options.samples,
            )
        };
        let target = |step: usize| {
            let n = step as f64;
            match self {
                Self::TranslationM(metres) => moved(source, DVec3::X * (metres * n)),
                Self::RotationDeg(degrees) => turned(source, degrees * n / 360.0),
                Self::Posts(_) => moved(source, DVec3::X * OCCLUSION_BASELINE_M),
            }
        };
        let scene = |id: String, views| Scene {
            cluster: cluster.clone(),
            ..Scene::new(dataset, id, views, Pairing::Star { source: 0 })
        };
        let steps = 1..options.views;
        Ok(match self {
            Self::Posts(posts) => steps
                .map(|step| {
                    let world = Arc::new(classic::world(options.seed, posts * step));
                    let views = vec![view(&world, 0, source), view(&world, step, target(step))];
                    scene(format!("{cluster}/{:02}-posts", posts * step), views)
                })
                .collect(),
            _ => {
                let targets = steps.map(|step| view(&rings.world, step, target(step)));
                let first = std::iter::once(rings.views[0].clone());
                vec![scene(cluster.clone(), first.chain(targets).collect())]
            }
        })
    }
}

/// A camera translated along its own axes.
fn moved(camera_from_world: RigidTransform, by: DVec3) -> RigidTransform {
    RigidTransform {
        translation: camera_from_world.translation - by,
        ..camera_from_world
    }
}

/// A camera rotated to the right about its own centre, by a fraction of a full turn.
fn turned(camera_from_world: RigidTransform, turns: f64) -> RigidTransform {
    let (c, s) = unit_circle(turns);
    // A point that was straight ahead is now to the left.
    let turn = DMat3::from_cols(DVec3::new(c, 0.0, s), DVec3::Y, DVec3::new(-s, 0.0, c));
    RigidTransform {
        rotation: turn * camera_from_world.rotation,
        translation: turn * camera_from_world.translation,
    }
}

#[cfg(test)]
mod tests {
    use sharp::camera::baseline_m;

    use super::*;

    fn scenes(settings: &str) -> Vec<Scene> {
        let text = format!("synthetic=size=96x72,views=6,{settings}");
        crate::open(&DatasetSpec::parse(&text).unwrap()).unwrap()
    }

    /// Baseline in metres and rotation in degrees of each view except the first.
    fn motions(scene: &Scene) -> Vec<(f64, f64)> {
        let poses = scene.views.iter().map(|view| view.camera_from_world);
        let first = scene.views[0].camera_from_world;
        let of = |b: RigidTransform| {
            (
                baseline_m(&first, &b),
                b.after(&first.inverse()).rotation_deg(),
            )
        };
        poses.skip(1).map(of).collect()
    }

    #[test]
    fn one_thing_grows_and_the_others_stay() {
        let translation = scenes("sweep=translation,step=0.1");
        assert_eq!((translation.len(), translation[0].views.len()), (1, 6));
        for (step, (metres, degrees)) in (1..).zip(motions(&translation[0])) {
            assert!((metres - 0.1 * f64::from(step)).abs() < 1e-12);
            assert!(degrees < 1e-6, "{degrees}");
        }
        for (step, (metres, degrees)) in (1..).zip(motions(&scenes("sweep=rotation")[0])) {
            assert!(metres < 1e-12 && (degrees - 2.0 * f64::from(step)).abs() < 1e-6);
        }
        let steps = scenes("sweep=occlusion");
        assert_eq!((steps.len(), steps[4].id.as_str()), (5, "seed0/05-posts"));
        for scene in &steps {
            assert_eq!(scene.views.len(), 2);
            assert!((motions(scene)[0].0 - 0.1).abs() < 1e-12);
            assert_eq!(scene.cluster, "seed0");
        }
    }

    #[test]
    fn what_goes_too_far_is_refused() {
        for (settings, reason) in [
            ("sweep=translation,step=1e9", "5 steps"),
            ("sweep=translation,step=2.1", "beyond 10 m"),
            ("sweep=rotation,step=18.1", "beyond 90 degrees"),
            ("sweep=occlusion,step=4", "beyond 15 posts"),
            ("sweep=occlusion,step=16", "whole number of posts up to 15"),
            ("sweep=translation,step=0", "above zero"),
        ] {
            let text = format!("synthetic=size=96x72,views=6,{settings}");
            let error = crate::open(&DatasetSpec::parse(&text).unwrap()).unwrap_err();
            assert!(error.to_string().contains(reason), "{settings}: {error}");
        }
        assert_eq!(scenes("sweep=translation,step=2").len(), 1);
    }

    #[test]
    fn a_camera_turned_to_the_right_sees_what_was_ahead_on_its_left() {
        let scene = &scenes("sweep=rotation,step=10")[0];
        let [a, b] = [0, 1].map(|i| scene.views[i].camera_from_world);
        let ahead = a.inverse().apply(DVec3::Z);
        let seen = b.apply(ahead);
        // sin and cos of ten degrees.
        assert!((seen.x + 0.173_648_177_666_930_35).abs() < 1e-12, "{seen}");
        assert!((seen.z - 0.984_807_753_012_208).abs() < 1e-12);
    }

    #[test]
    fn posts_hide_more_from_step_to_step_and_stay_where_they_were() {
        let steps = scenes("sweep=occlusion");
        let near = |scene: &Scene| {
            let depth = scene.views[0].content.depth().unwrap().unwrap();
            let posts = depth.iter().map(|z| (0.97..1.01).contains(z));
            posts.collect::<Vec<bool>>()
        };
        let maps: Vec<Vec<bool>> = steps.iter().map(near).collect();
        for two in maps.windows(2) {
            assert!(
                two[0]
                    .iter()
                    .zip(&two[1])
                    .all(|(before, now)| !before || *now)
            );
            let count = |map: &[bool]| map.iter().filter(|is| **is).count();
            // A post is 3 cm wide, and a picture is 111 cm wide at a distance of one metre.
            let share = (count(&two[1]) - count(&two[0])) as f64 / (96.0 * 72.0);
            assert!((0.01..0.05).contains(&share), "{share}");
        }
    }
}
