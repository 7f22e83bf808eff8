//! Varied scenes: many kinds of scenes, lights and common lenses.
//!
//! * `draft`: a scene under construction; keeps objects clear of the cameras and of each other.
//! * `furnishing`: tables, shelves, trees, fences and buildings made of simple shapes.
//! * `indoors`, `outdoors`: the families of scenes.
//! * `reflective`: mirrors, glass and water, for `world=reflective`.

mod draft;
mod furnishing;
mod hull;
mod indoors;
mod outdoors;
mod reflective;
#[cfg(test)]
mod tests;

use glam::DVec3;
use sharp::random::SplitMix64;

use super::classic;
use super::light::Light;
use super::paint::derived;
use super::rig::Rig;
use super::world::World;
use draft::Draft;

/// The kinds of scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Family {
    /// The scene of `world=classic`, including its cameras.
    Classic,
    Room,
    TableTop,
    Corridor,
    Outdoors,
    Street,
    /// Fences, railings, poles and wires.
    Thin,
}

/// All elements are equally likely, so a family's probability is proportional to how often it is
/// listed here.
const FAMILIES: [Family; 16] = [
    Family::Classic,
    Family::Classic,
    Family::Room,
    Family::Room,
    Family::Room,
    Family::Room,
    Family::TableTop,
    Family::TableTop,
    Family::TableTop,
    Family::Corridor,
    Family::Outdoors,
    Family::Outdoors,
    Family::Outdoors,
    Family::Street,
    Family::Street,
    Family::Thin,
];

/// Maximum number of drafts for a seed. If all are rejected, the classic scene is used.
const DRAFTS: u64 = 32;

fn family(seed: u64) -> Family {
    FAMILIES[(derived(seed, 0) % FAMILIES.len() as u64) as usize]
}

/// The world of a seed and its cameras.
pub(super) fn scene(seed: u64) -> (World, Rig) {
    scene_of(family(seed), seed, false)
}

/// Like [`scene`], with mirrors, glass and water, and lit by the sky. The rest of the world is
/// usually the same; rooms replace classic scenes.
pub(super) fn reflective_scene(seed: u64) -> (World, Rig) {
    let family = match family(seed) {
        Family::Classic => Family::Room,
        other => other,
    };
    scene_of(family, seed, true)
}

fn scene_of(family: Family, seed: u64, reflective: bool) -> (World, Rig) {
    let drafts = match family {
        Family::Classic => 0,
        _ => DRAFTS,
    };
    (1..=drafts)
        .find_map(|number| {
            let mut random = SplitMix64::new(derived(seed, number));
            drafted(family, &mut random, reflective)
        })
        .unwrap_or_else(|| (classic::world(seed, 0), Rig::CLASSIC))
}

/// A random scene of a family; `None` if too little is visible.
fn drafted(family: Family, random: &mut SplitMix64, reflective: bool) -> Option<(World, Rig)> {
    let mut light = match family {
        Family::Room | Family::Corridor => Light::indoors(random),
        // The table is in a room or on a terrace, with equal probability.
        Family::TableTop if random.below(2) == 0 => Light::indoors(random),
        _ => Light::outdoors(random),
    };
    if reflective {
        light = light.lit_by_sky();
    }
    let draft = Draft::new(random, light, reflective);
    let (draft, target) = match family {
        Family::Classic => return None,
        Family::Room => indoors::room(draft),
        Family::TableTop => indoors::table_top(draft),
        Family::Corridor => indoors::corridor(draft),
        Family::Outdoors => outdoors::ground(draft),
        Family::Street => outdoors::street(draft),
        Family::Thin => outdoors::thin(draft),
    };
    let mut rig = draft.rig;
    rig.target = target;
    // The cameras are closer together if they look at close objects.
    rig.outer_radius_m = Rig::WIDEST_RADIUS_M.min(0.26 * target.length());
    let brightness = draft.brightness;
    let mut world = draft.finish();
    exposed(&mut world, &rig, brightness).then_some((world, rig))
}

/// Sets a world's exposure so that the mean of its central picture has the given radiance. Returns whether that picture
/// is acceptable: not mostly sky, not a single wall, and nothing directly in front of the lens.
fn exposed(world: &mut World, rig: &Rig, brightness: f64) -> bool {
    const SIDE: u32 = 24;
    let lens = rig.intrinsics(SIDE, SIDE);
    let forward = rig.target.normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let down = forward.cross(right);
    let candidates = world.candidates(DVec3::ZERO, forward, None);
    let (mut sum, mut reflected) = (0.0, 0.0);
    let (mut depths, mut objects) = (Vec::new(), Vec::new());
    for place in 0..SIDE * SIDE {
        let x = (f64::from(place % SIDE) + 0.5 - lens.cx) / lens.fx;
        let y = (f64::from(place / SIDE) + 0.5 - lens.cy) / lens.fy;
        let direction = right * x + down * y + forward;
        let sight = world.sight(&candidates, DVec3::ZERO, direction);
        let seen = world.radiance(&sight, 1.0 / lens.fx);
        // Lamps and sky may be saturated.
        let seen = ((seen.x + seen.y + seen.z) / 3.0).min(1.0);
        sum += seen;
        if let Some((object, distance)) = sight.object() {
            reflected += seen;
            depths.push(distance);
            objects.push(object);
        }
    }
    let rays = f64::from(SIDE * SIDE);
    // A compromise between exposing the whole picture and exposing only the surfaces, so that a bright sky neither
    // makes the ground black nor is entirely white.
    let mean = (sum / rays * reflected / (depths.len() as f64).max(1.0)).sqrt();
    world.expose((brightness / mean.max(1e-6)).clamp(0.2, 5.0));
    depths.sort_unstable_by(f64::total_cmp);
    objects.sort_unstable();
    let largest = objects.chunk_by(|a, b| a == b).map(<[usize]>::len).max();
    let (Some(largest), Some(&nearest)) = (largest, depths.first()) else {
        return false;
    };
    let [low, high] = [0.1, 0.9].map(|part| depths[(part * depths.len() as f64) as usize]);
    depths.len() as f64 > 0.45 * rays
        && largest as f64 <= 0.6 * rays
        && nearest > 0.3
        && high > 1.5 * low
}
