//! Seeded scenes for property tests.

use glam::{DAffine3, DMat3, DVec3};
use sharp::camera::Intrinsics;
use sharp::gaussians::Gaussians;
use sharp::render::RenderView;

/// splitmix64, with numbers in ranges.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        low + (high - low) * ((z >> 11) as f64 / (1_u64 << 53) as f64)
    }

    fn vector<const D: usize>(&mut self, low: f64, high: f64) -> [f32; D] {
        std::array::from_fn(|_| self.between(low, high) as f32)
    }
}

/// Settings for a random scene.
#[derive(Clone, Copy)]
pub(crate) struct Recipe {
    pub(crate) count: usize,
    /// Range of the standard deviations, in metres at depths of 1 to 4; drawn on a logarithmic
    /// scale.
    pub(crate) scales: (f64, f64),
    pub(crate) opacities: (f64, f64),
}

/// Gaussians in front of the camera, a few of them outside its view.
pub(crate) fn scene(random: &mut Random, recipe: Recipe) -> Gaussians {
    let mut scene = Gaussians::default();
    for _ in 0..recipe.count {
        let z = random.between(1.0, 4.0);
        let at = |random: &mut Random| random.between(-0.9, 0.9) * z;
        scene
            .means
            .push([at(random) as f32, at(random) as f32, z as f32]);
        scene.quaternions.push(random.vector(-1.0, 1.0));
        let (low, high) = (recipe.scales.0.ln(), recipe.scales.1.ln());
        scene
            .scales
            .push(random.vector::<3>(low, high).map(f32::exp));
        let (low, high) = recipe.opacities;
        scene.opacities.push(random.between(low, high) as f32);
        scene.colors.push(random.vector(0.0, 1.0));
    }
    scene
}

/// Gives each Gaussian an extreme number in one attribute. Colours may be any finite number; they stay small so that
/// sums stay finite.
pub(crate) fn make_extreme(scene: &mut Gaussians) {
    let extremes = [
        0.0,
        -0.0,
        f32::MIN_POSITIVE,
        1e-45,
        1e-20,
        1.0,
        1e20,
        f32::MAX,
        -1e20,
        f32::MIN,
        f32::NAN,
        f32::INFINITY,
    ];
    for k in 0..scene.len() {
        let extreme = extremes[k / 14 % extremes.len()];
        match k % 14 {
            d @ 0..3 => scene.means[k][d] = extreme,
            d @ 3..7 => scene.quaternions[k][d - 3] = extreme,
            d @ 7..10 => scene.scales[k][d - 7] = extreme,
            10 => scene.opacities[k] = extreme,
            _ => (),
        }
    }
}

/// A camera at the origin with a field of view of about 80 degrees.
pub(crate) fn view(width: u32, height: u32) -> RenderView {
    let focal = 0.6 * f64::from(width.max(height));
    let center = (f64::from(width) / 2.0 + 0.3, f64::from(height) / 2.0 - 0.2);
    let intrinsics = Intrinsics::new((focal, focal * 1.03), center, (width, height)).unwrap();
    RenderView::new(DAffine3::IDENTITY, intrinsics)
}

/// A rigid movement of a few centimetres and degrees.
pub(crate) fn movement(random: &mut Random) -> DAffine3 {
    let axis: [f32; 3] = random.vector(-1.0, 1.0);
    let axis = DVec3::from_array(axis.map(f64::from)).normalize();
    let angle = random.between(-0.2, 0.2);
    let offset: [f32; 3] = random.vector(-0.2, 0.2);
    DAffine3::from_mat3_translation(
        DMat3::from_axis_angle(axis, angle),
        DVec3::from_array(offset.map(f64::from)),
    )
}
