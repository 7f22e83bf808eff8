//! Losses of training, the renderer's derivative and the network's operators, for the cross-check
//! against torch.
//!
//! Reads a JSON request from standard input: `seed`, `folder` and `resnet50dilated`, weights of that
//! network. Writes `<case>.safetensors` or `<case>.<number>.safetensors` into the folder, each with its inputs by
//! name, `value` (one number) and for each input that is differentiated `d <input>`.

mod operators;

use std::collections::BTreeMap;
use std::error::Error;
use std::io::stdin;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3};
use safetensors::tensor::{Dtype, TensorView};
use serde::Deserialize;
use sharp::camera::Intrinsics;
use sharp::color::srgb_from_linear;
use sharp::gaussians::Gaussians;
use sharp::model::{Algorithm, Compute};
use sharp::random::SplitMix64;
use sharp::render::{
    CpuRenderer, GaussianGradient, PictureGradient, RenderView, Renderer, backward_covariances,
    covariances,
};
use sharp_train::losses::perceptual::PerceptualMask;
use sharp_train::losses::{
    Channels, Difference, GradientNorm, InverseDepthUnits, Loss, LossOptions, MaskNormalization,
    Perceptual, PerceptualOptions, ScalePooling, SplatVariance, alpha, color, delta, depth, grad,
    grad_projected, linear_from_srgb_gradient, scale, scale_gradient, splat, tv,
};

#[derive(Deserialize)]
struct Request {
    seed: u64,
    folder: PathBuf,
    resnet50dilated: PathBuf,
}

type Done = Result<(), Box<dyn Error>>;

/// Inputs, value and gradients of one case.
#[derive(Default)]
struct Case(BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>);

impl Case {
    fn f32(mut self, name: &str, shape: &[usize], values: &[f32]) -> Self {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.0
            .insert(name.to_owned(), (Dtype::F32, shape.to_vec(), bytes));
        self
    }

    fn f64(mut self, name: &str, shape: &[usize], values: &[f64]) -> Self {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.0
            .insert(name.to_owned(), (Dtype::F64, shape.to_vec(), bytes));
        self
    }

    /// Adds a differentiated f32 input and its loss.
    fn loss(self, name: &str, shape: &[usize], values: &[f32], loss: &Loss<f32>) -> Self {
        self.f32(name, shape, values)
            .f64("value", &[1], &[loss.value])
            .f32(&format!("d {name}"), shape, &loss.gradient)
    }

    fn write(&self, folder: &Path, case: &str) -> Done {
        let views = self.0.iter().map(|(name, (dtype, shape, bytes))| {
            Ok((name, TensorView::new(*dtype, shape.clone(), bytes)?))
        });
        let views = views.collect::<Result<Vec<_>, safetensors::SafeTensorError>>()?;
        let file = folder.join(format!("{case}.safetensors"));
        Ok(safetensors::serialize_to_file(views, None, &file)?)
    }
}

/// Generates the values of one case after another.
struct Values(SplitMix64);

impl Values {
    fn between(&mut self, low: f64, high: f64, count: usize) -> Vec<f32> {
        (0..count)
            .map(|_| self.0.between(low, high) as f32)
            .collect()
    }

    fn three(&mut self, low: f64, high: f64, count: usize) -> Vec<[f32; 3]> {
        self.between(low, high, 3 * count).as_chunks().0.to_vec()
    }

    fn mask(&mut self, count: usize) -> Vec<bool> {
        (0..count).map(|_| self.0.below(4) > 0).collect()
    }
}

fn as_floats(mask: &[bool]) -> Vec<f32> {
    mask.iter().map(|m| f32::from(u8::from(*m))).collect()
}

fn colour(loss: Loss<[f32; 3]>) -> Loss<f32> {
    Loss {
        value: loss.value,
        gradient: loss.gradient.into_flattened(),
    }
}

/// Options that all differ from the defaults; torch must be given the same ones.
fn others() -> LossOptions {
    LossOptions {
        color_channels: Channels::Sum,
        depth_units: InverseDepthUnits::Normalized,
        mask_normalization: MaskNormalization::MaskedPixels,
        grad_stops_at_depth: false,
        grad_difference: Difference::Central,
        grad_norm: GradientNorm::Euclidean,
        grad_units: InverseDepthUnits::Metric,
        splat_variance: SplatVariance::Mean,
        scale_pooling: ScalePooling::First,
        scale_norm: GradientNorm::Euclidean,
        scale_per_full_pixel: true,
        ..LossOptions::default()
    }
}

fn losses(values: &mut Values, folder: &Path) -> Done {
    const HEIGHT: usize = 21;
    const WIDTH: usize = 34;
    let (size, count) = ([HEIGHT, WIDTH], HEIGHT * WIDTH);
    for (suffix, options) in [("", LossOptions::default()), (" other", others())] {
        let (x, y) = (values.three(0.0, 1.0, count), values.three(0.0, 1.0, count));
        let mask = values.mask(count);
        let shape = [HEIGHT, WIDTH, 3];
        let loss = colour(color(&x, &y, Some(&mask), &options));
        Case::default()
            .loss("predicted", &shape, x.as_flattened(), &loss)
            .f32("target", &shape, y.as_flattened())
            .f32("mask", &size, &as_floats(&mask))
            .write(folder, &format!("color{suffix}"))?;

        let mut a = values.between(0.001, 0.9999, count);
        a[5] = 0.0;
        Case::default()
            .loss("alpha", &size, &a, &alpha(&a, Some(&mask), &options))
            .f32("mask", &size, &as_floats(&mask))
            .write(folder, &format!("alpha{suffix}"))?;

        let predicted = values.between(0.5, 20.0, count);
        let mut truth = values.between(0.5, 20.0, count);
        (truth[3], truth[8]) = (0.0, f32::INFINITY);
        Case::default()
            .loss(
                "predicted",
                &size,
                &predicted,
                &depth(&predicted, &truth, 0.5, &options),
            )
            .f32("truth", &size, &truth)
            .write(folder, &format!("depth{suffix}"))?;

        let (shape, columns) = ([2, HEIGHT, WIDTH], HEIGHT * WIDTH);
        let opacity = values.between(0.0, 1.0, 2 * columns);
        // The steps are on both sides of the margin, in either unit.
        let inverse = values.between(0.01, 0.05, 2 * columns);
        let found = grad(&opacity, &inverse, size, 0.5, &options);
        let mut case = Case::default()
            .loss("opacity", &shape, &opacity, &found.opacity)
            .f32("inverse", &shape, &inverse);
        if let Some(of_depth) = &found.map {
            case = case.f32("d inverse", &shape, of_depth);
        }
        case.write(folder, &format!("grad{suffix}"))?;

        // Two layers of 12×12 Gaussians over 24×24 pixels.
        let opacity = values.between(0.0, 1.0, 2 * 12 * 12);
        let metres = values.between(10.0, 50.0, 2 * 24 * 24);
        let found = grad_projected(&opacity, &metres, [12, 24], 0.5, &options);
        let (shape, fine) = ([2, 12, 12], [2, 24, 24]);
        let mut case = Case::default()
            .loss("opacity", &shape, &opacity, &found.opacity)
            .f32("depth", &fine, &metres);
        if let Some(of_depth) = &found.map {
            case = case.f32("d depth", &fine, of_depth);
        }
        case.write(folder, &format!("grad projected{suffix}"))?;

        // Variances from below 0.1 to above 100 px² for 1536 columns, in a picture of 96 columns.
        let shapes = values.between(-0.012, 0.012, 3 * 300);
        let widths = values.between(0.001, 0.9, 300);
        let (three, _) = shapes.as_chunks::<3>();
        let covariance = |([a, b, c], w): (&[f32; 3], &f32)| {
            let [a, b, c] = [a + 0.02 * w, b + 0.0, c + w * w].map(f64::from);
            [a * a, a * b, b * b + c * c]
        };
        let given: Vec<[f64; 3]> = three.iter().zip(&widths).map(covariance).collect();
        let loss = splat(&given, 96, &options);
        Case::default()
            .f64("covariances", &[300, 3], given.as_flattened())
            .f64("value", &[1], &[loss.value])
            .f64("d covariances", &[300, 3], loss.gradient.as_flattened())
            .write(folder, &format!("splat{suffix}"))?;

        let (height, width) = (70, 135);
        let s = values.between(0.5, 1.5, height * width);
        Case::default()
            .loss(
                "scale",
                &[height, width],
                &s,
                &scale_gradient(&s, width, &options),
            )
            .write(folder, &format!("scale gradient{suffix}"))?;
    }

    let d = values.between(0.5, 20.0, count);
    let case = Case::default().loss("depth", &size, &d, &tv(&d, WIDTH));
    case.write(folder, "tv")?;
    let raw = values.between(-900.0, 900.0, 2 * count);
    let case = Case::default().loss("raw", &[2, HEIGHT, WIDTH], &raw, &delta(&raw));
    case.write(folder, "delta")?;
    let s = values.between(0.5, 1.5, count);
    let case = Case::default().loss("scale", &size, &s, &scale(&s));
    case.write(folder, "scale")?;

    let (linear, upstream) = (
        values.three(-0.1, 1.3, count),
        values.three(-1.0, 1.0, count),
    );
    let encoded = linear
        .as_flattened()
        .iter()
        .map(|x| f64::from(srgb_from_linear(*x)));
    let weighted = encoded
        .zip(upstream.as_flattened())
        .map(|(e, u)| e * f64::from(*u));
    let loss = colour(Loss {
        value: weighted.sum(),
        gradient: linear_from_srgb_gradient(&linear, &upstream),
    });
    Case::default()
        .loss("linear", &[HEIGHT, WIDTH, 3], linear.as_flattened(), &loss)
        .f32("upstream", &[HEIGHT, WIDTH, 3], upstream.as_flattened())
        .write(folder, "srgb")
}

/// Smooth waves with noise, so that there are features of all sizes.
fn picture(values: &mut Values, [height, width]: [usize; 2]) -> Vec<[f32; 3]> {
    let waves = values.three(0.1, 1.0, 3);
    let noise = values.three(-0.1, 0.1, height * width);
    let pixel = |p: usize| {
        let (y, x) = ((p / width) as f32, (p % width) as f32);
        let wave = |c: usize| {
            let phase = waves[0][c] * x + waves[1][c] * y + 6.0 * waves[2][c];
            (0.5 + 0.4 * phase.sin() + noise[p][c]).clamp(0.0, 1.0)
        };
        [0, 1, 2].map(wave)
    };
    (0..height * width).map(pixel).collect()
}

fn perceptual(values: &mut Values, folder: &Path, resnet50dilated: &Path) -> Done {
    let resnet = PerceptualOptions {
        resnet50dilated: Some(resnet50dilated.to_owned()),
        ..PerceptualOptions::default()
    };
    let on_features = PerceptualOptions {
        mask: PerceptualMask::Features,
        ..PerceptualOptions::default()
    };
    // A unit that is nearly 0 may be active here but not in torch; torch reports which pictures
    // have none.
    for (name, options, size, pictures) in [
        ("vgg16", PerceptualOptions::default(), [16, 25], 12),
        ("vgg16 features", on_features, [19, 24], 12),
        ("resnet50dilated", resnet, [37, 46], 6),
    ] {
        let loss = Perceptual::new(options, Compute::cpu(Algorithm::Winograd))?;
        for number in 0..pictures {
            let (x, y) = (picture(values, size), picture(values, size));
            let mask = values.mask(x.len());
            let found = colour(loss.compare(&x, &y, size[1], Some(&mask), 0)?);
            let shape = [size[0], size[1], 3];
            Case::default()
                .loss("predicted", &shape, x.as_flattened(), &found)
                .f32("target", &shape, y.as_flattened())
                .f32("mask", &size, &as_floats(&mask))
                .write(folder, &format!("perceptual {name}.{number}"))?;
        }
    }
    Ok(())
}

/// Gaussians in front of a camera: some far outside its picture, some large, needles, opaque and
/// faint ones.
fn scene(values: &mut Values, count: usize) -> Gaussians {
    let random = &mut values.0;
    let mut scene = Gaussians::default();
    for k in 0..count {
        let z = random.between(0.8, 4.0);
        let reach = if k % 7 == 0 { 1.6 } else { 0.6 };
        let mut at = || random.between(-reach, reach) * z;
        scene.means.push([at() as f32, at() as f32, z as f32]);
        scene
            .quaternions
            .push([0; 4].map(|_| random.between(-1.5, 1.5) as f32));
        let size = if k % 7 == 0 { 1.0 } else { 0.15 };
        scene
            .scales
            .push([0; 3].map(|_| (size * random.between(0.05, 1.0)) as f32));
        let opacity = if k % 5 == 0 {
            1.0
        } else {
            random.between(0.02, 0.95)
        };
        scene.opacities.push(opacity as f32);
        scene
            .colors
            .push([0; 3].map(|_| random.between(0.0, 1.0) as f32));
    }
    scene
}

/// A camera that is not rigid, like the paper's own camera for the normalised space.
fn view(values: &mut Values, camera: Intrinsics, eps2d: f32) -> RenderView {
    let entries = values.between(-0.1, 0.1, 12);
    let mut affine = DAffine3 {
        matrix3: DMat3::IDENTITY,
        translation: DVec3::new(entries[9].into(), entries[10].into(), entries[11].into()),
    };
    for (i, entry) in entries[..9].iter().enumerate() {
        affine.matrix3.col_mut(i / 3)[i % 3] += f64::from(*entry);
    }
    RenderView::new(affine, camera).with_low_pass(eps2d)
}

/// Scene and view, with gradients of everything that determines a Gaussian's position and shape.
fn seen(scene: &Gaussians, view: &RenderView, gradient: &[GaussianGradient]) -> Case {
    let n = scene.len();
    let part = |take: fn(&GaussianGradient) -> &[f32]| gradient.iter().flat_map(take).copied();
    let part = |take| part(take).collect::<Vec<f32>>();
    let (affine, camera) = (&view.camera_from_scene, &view.intrinsics);
    let rows: Vec<f64> = (0..3)
        .flat_map(|row| {
            let linear = affine.matrix3.row(row).to_array();
            [linear[0], linear[1], linear[2], affine.translation[row]]
        })
        .collect();
    let numbers = [
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        f64::from(camera.width),
        f64::from(camera.height),
        f64::from(view.rule.low_pass),
    ];
    Case::default()
        .f64("camera_from_scene", &[3, 4], &rows)
        .f64("view", &[7], &numbers)
        .f32("means", &[n, 3], scene.means.as_flattened())
        .f32("quaternions", &[n, 4], scene.quaternions.as_flattened())
        .f32("scales", &[n, 3], scene.scales.as_flattened())
        .f32("d means", &[n, 3], &part(|g| &g.mean))
        .f32("d quaternions", &[n, 4], &part(|g| &g.quaternion))
        .f32("d scales", &[n, 3], &part(|g| &g.scales))
}

/// Like [`seen`], with the colours and opacities.
fn painted(scene: &Gaussians, view: &RenderView, gradient: &[GaussianGradient]) -> Case {
    let n = scene.len();
    let opacities: Vec<f32> = gradient.iter().map(|g| g.opacity).collect();
    let colors: Vec<f32> = gradient.iter().flat_map(|g| g.color).collect();
    seen(scene, view, gradient)
        .f32("opacities", &[n], &scene.opacities)
        .f32("d opacities", &[n], &opacities)
        .f32("colors", &[n, 3], scene.colors.as_flattened())
        .f32("d colors", &[n, 3], &colors)
}

fn renderer(values: &mut Values, folder: &Path) -> Done {
    let (width, height) = (34_u32, 27_u32);
    for (number, eps2d) in [0.0, 0.01, 0.3].into_iter().enumerate() {
        let scene = scene(values, 60);
        let n = scene.len();
        let camera = Intrinsics::new((31.0, 29.0), (16.3, 13.9), (width, height))?;
        let view = view(values, camera, eps2d);
        let pixels = (width * height) as usize;
        let (of_rgb, of_alpha, of_depth) = (
            values.three(-1.0, 1.0, pixels),
            values.between(-1.0, 1.0, pixels),
            values.between(-1.0, 1.0, pixels),
        );
        let size = [height as usize, width as usize];

        let mut renderer = CpuRenderer::new();
        let picture = renderer.render(&scene, &view)?;
        let upstream = PictureGradient {
            width: width as usize,
            rgb_linear: &of_rgb,
            alpha: &of_alpha,
            depth_acc: &of_depth,
        };
        let gradient = renderer.backward(&scene, &view, &upstream)?;
        let weighted = |of: &[f32], by: &[f32]| -> f64 {
            of.iter()
                .zip(by)
                .map(|(a, b)| f64::from(*a) * f64::from(*b))
                .sum()
        };
        let value = weighted(picture.rgb.as_flattened(), of_rgb.as_flattened())
            + weighted(&picture.alpha, &of_alpha)
            + weighted(&picture.depth_acc, &of_depth);
        painted(&scene, &view, &gradient)
            .f32("of rgb", &[size[0], size[1], 3], of_rgb.as_flattened())
            .f32("of alpha", &size, &of_alpha)
            .f32("of depth", &size, &of_depth)
            .f64("value", &[1], &[value])
            .write(folder, &format!("renderer.{number}"))?;

        let shapes = covariances(&scene, &view)?;
        let upstream: Vec<[f64; 3]> = shapes
            .iter()
            .map(|_| [0; 3].map(|_| values.0.between(-1.0, 1.0)))
            .collect();
        let mut gradient = vec![GaussianGradient::default(); n];
        backward_covariances(&scene, &view, &upstream, &mut gradient)?;
        let products = shapes.as_flattened().iter().zip(upstream.as_flattened());
        let value = products.map(|(a, b)| a * b).sum();
        seen(&scene, &view, &gradient)
            .f64("upstream", &[n, 3], upstream.as_flattened())
            .f64("value", &[1], &[value])
            .write(folder, &format!("covariances.{number}"))?;
    }
    Ok(())
}

/// The perceptual loss of a rendering. Its gradient is passed from the picture to the renderer,
/// where torch has a single graph.
fn surgery(values: &mut Values, folder: &Path) -> Done {
    let [height, width] = [16, 22];
    let loss = Perceptual::new(
        PerceptualOptions::default(),
        Compute::cpu(Algorithm::Winograd),
    )?;
    for number in 0..8 {
        let scene = scene(values, 60);
        let camera = Intrinsics::new((20.0, 19.0), (10.6, 8.3), (width as u32, height as u32))?;
        let view = view(values, camera, RenderView::EPS2D_CONFIG);
        let target = picture(values, [height, width]);
        let mut renderer = CpuRenderer::new();
        let linear = renderer.render(&scene, &view)?.rgb;
        let encoded: Vec<_> = linear.iter().map(|p| p.map(srgb_from_linear)).collect();
        let found = loss.compare(&encoded, &target, width, None, 0)?;
        let none = vec![0.0; linear.len()];
        let upstream = PictureGradient {
            width,
            rgb_linear: &linear_from_srgb_gradient(&linear, &found.gradient),
            alpha: &none,
            depth_acc: &none,
        };
        let gradient = renderer.backward(&scene, &view, &upstream)?;
        painted(&scene, &view, &gradient)
            .f32("target", &[height, width, 3], target.as_flattened())
            .f64("value", &[1], &[found.value])
            .write(folder, &format!("surgery.{number}"))?;
    }
    Ok(())
}

fn main() -> Done {
    let request: Request = serde_json::from_reader(stdin().lock())?;
    let mut values = Values(SplitMix64::new(request.seed));
    losses(&mut values, &request.folder)?;
    perceptual(&mut values, &request.folder, &request.resnet50dilated)?;
    renderer(&mut values, &request.folder)?;
    surgery(&mut values, &request.folder)?;
    operators::operators(&mut values, &request.folder)
}
