//! Examples of the second stage (paper, self-supervised fine-tuning): a photograph without depth
//! serves as the novel view of a picture that the network itself generated from it.
//!
//! The teacher is the network at the end of the first stage. It predicts the Gaussians of a
//! photograph, which are rendered from a nearby camera. That rendering becomes the input. The
//! photograph, whose pixels are real, becomes the ground truth for the novel view.
//!
//! Choices that the paper leaves open: cameras are distributed over a disc around the photograph's
//! camera, with the configured radius but at most a fraction of the median depth. They look at a point
//! at that depth near the photograph's axis. Pixels of the rendering with a low alpha are excluded from
//! all losses ([`PseudoViews`] has the values). The input's depth is the rendering's expected depth; the
//! photograph's depth is the teacher's first layer.

use std::path::Path;

use glam::DVec3;
use image::{ImageBuffer, Luma};
use sharp::camera::{RigidTransform, target_camera_from_source_ndc};
use sharp::color::Quantization;
use sharp::model::inventory::CheckpointSource;
use sharp::model::{Algorithm, Compute, ModelConfig, ModelError, Predictor};
use sharp::random::SplitMix64;
use sharp::render::{Background, CpuRenderer, RenderView, Renderer};
use sharp::resize::nearest;
use sharp::trajectory::looking;

use crate::config::StageConfig;
use crate::data::{DataError, Photograph, Sample, Source, TrainingView, draws};
use crate::pseudo_views::PseudoViews;

/// Examples generated from photographs.
pub(crate) struct SelfSupervisedSamples {
    photographs: Box<dyn Source<Photograph>>,
    teacher: Predictor,
    seed: u64,
    max_baseline_m: f64,
    views: PseudoViews,
}

impl SelfSupervisedSamples {
    /// Creates the source of examples; `teacher` is the file of weights at the end of the first stage.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(crate) fn new(
        photographs: Box<dyn Source<Photograph>>,
        teacher: &Path,
        config: &ModelConfig,
        settings: &StageConfig,
    ) -> Result<Self, ModelError> {
        let weights = CheckpointSource::open(teacher)?;
        weights.check(config, &[])?;
        let compute = Compute::cpu(Algorithm::Winograd);
        Ok(Self {
            photographs,
            teacher: Predictor::from_source(config, weights, compute)?,
            seed: settings.seed,
            max_baseline_m: settings.max_baseline_m,
            views: settings.pseudo_views.clone(),
        })
    }
}

impl Source<Sample> for SelfSupervisedSamples {
    fn get(&self, k: u64) -> Result<Sample, DataError> {
        let Photograph {
            id,
            image,
            intrinsics,
        } = self.photographs.get(k)?;
        let factor = intrinsics.fx / f64::from(intrinsics.width);
        let output = self.teacher.predict_rgb8(&image, factor as f32);
        let output = output.map_err(|error| DataError::from(error).of_sample(&id))?;
        let side = output.resolution;
        let size = (image.width() as usize, image.height() as usize);
        let depth = nearest(output.first_layer(), (side, side), size);
        let mut sorted = depth.clone();
        sorted.sort_unstable_by(f32::total_cmp);
        let distance = f64::from(sorted[sorted.len() / 2]);
        let mut random = draws(self.seed ^ CAMERA_SEED, k);
        let PseudoViews {
            part_of_distance,
            part_aside,
            covered,
        } = self.views;
        let farthest = self.max_baseline_m.min(part_of_distance * distance);
        let eye = eye(&mut random, farthest);
        let mut aside = || distance * random.between(-part_aside, part_aside);
        let camera_from_world = looking(eye, DVec3::new(aside(), aside(), distance));
        let placed = target_camera_from_source_ndc(&intrinsics, &camera_from_world);
        let view = RenderView::new(placed, intrinsics);
        let rendered = CpuRenderer::new().render(&output.gaussians, &view);
        let rendered = rendered.map_err(|error| DataError::from(error).of_sample(&id))?;
        let covered: Vec<bool> = rendered.alpha.iter().map(|a| *a >= covered).collect();
        let mut seen_depth = rendered.expected_depth();
        for (depth, covered) in seen_depth.iter_mut().zip(&covered) {
            if !covered {
                *depth = 0.0;
            }
        }
        let source = TrainingView {
            image: rendered.srgb8(Background::Black, Quantization::Round),
            intrinsics,
            camera_from_world,
            depth: seen_depth,
            valid: Some(covered),
        };
        let target = TrainingView {
            depth: in_shape(image.width(), image.height(), depth),
            image,
            intrinsics,
            camera_from_world: RigidTransform::IDENTITY,
            valid: None,
        };
        Ok(Sample { id, source, target })
    }
}

/// Combined with the seed, so that the random cameras are independent of the random choice of photographs.
const CAMERA_SEED: u64 = 0x5353_4654;

/// A point uniformly distributed in a disc of `radius` around the photograph's camera.
fn eye(random: &mut SplitMix64, radius: f64) -> DVec3 {
    loop {
        let (x, y) = (random.between(-1.0, 1.0), random.between(-1.0, 1.0));
        if x * x + y * y <= 1.0 {
            return DVec3::new(radius * x, radius * y, 0.0);
        }
    }
}

fn in_shape(width: u32, height: u32, depth: Vec<f32>) -> ImageBuffer<Luma<f32>, Vec<f32>> {
    ImageBuffer::from_raw(width, height, depth).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use sharp::camera::baseline_m;
    use sharp::model::bundled;

    use super::*;
    use crate::config::TrainingConfig;
    use crate::data::tests::warped;
    use crate::data::{ProceduralPhotographs, TrainingWorlds};

    const SIZE: (u32, u32) = (96, 96);
    const COUNT: u64 = 8;

    fn samples(max_baseline_m: f64) -> SelfSupervisedSamples {
        samples_with(max_baseline_m, PseudoViews::default())
    }

    fn samples_with(max_baseline_m: f64, pseudo_views: PseudoViews) -> SelfSupervisedSamples {
        let teacher = bundled::source_folder().join(bundled::FILE);
        let config = bundled::config().unwrap();
        let photographs = Box::new(ProceduralPhotographs::new(4, SIZE, TrainingWorlds::Varied));
        let stage = StageConfig {
            seed: 7,
            max_baseline_m,
            pseudo_views,
            ..TrainingConfig::default().stage2
        };
        SelfSupervisedSamples::new(photographs, &teacher, &config, &stage).unwrap()
    }

    #[test]
    fn a_photograph_is_the_novel_view_of_what_the_teacher_makes_of_it() {
        let photographs = ProceduralPhotographs::new(4, SIZE, TrainingWorlds::Varied);
        let samples = samples(0.6);
        let mut before_when_swapped = 0.0;
        for k in 0..COUNT {
            let mut sample = samples.get(k).unwrap();
            let photograph = photographs.get(k).unwrap();
            let Sample { source, target, .. } = &sample;
            assert_eq!(target.image, photograph.image);
            assert_eq!(target.camera_from_world, RigidTransform::IDENTITY);
            assert_eq!(
                (source.intrinsics, target.intrinsics),
                (photograph.intrinsics, photograph.intrinsics)
            );
            assert_ne!(source.image, target.image);
            // Colours are used only at pixels that the rendering covers; depth is known only there.
            let covered = source.valid.as_ref().unwrap();
            assert!(
                covered
                    .iter()
                    .zip(&*source.depth)
                    .all(|(covered, z)| *covered == (*z > 0.0))
            );
            assert!(covered.iter().filter(|covered| **covered).count() > covered.len() / 2);
            let (there, before) = warped(&sample);
            assert!(
                there > 0.7 && before < 0.02,
                "{}: {there} {before}",
                sample.id
            );
            std::mem::swap(
                &mut sample.source.camera_from_world,
                &mut sample.target.camera_from_world,
            );
            before_when_swapped += warped(&sample).1 / COUNT as f64;
        }
        assert!(before_when_swapped > 0.01, "{before_when_swapped}");
    }

    #[test]
    fn how_far_and_how_covered_pseudo_novel_views_are_is_set() {
        let near = PseudoViews {
            part_of_distance: 1e-3,
            part_aside: 0.0,
            covered: 0.5,
        };
        for k in 0..COUNT {
            let [usual, near] = [PseudoViews::default(), near.clone()]
                .map(|views| samples_with(0.6, views).get(k).unwrap().source);
            let metres = |view: &TrainingView| {
                baseline_m(&view.camera_from_world, &RigidTransform::IDENTITY)
            };
            assert!(metres(&near) < 0.05 * metres(&usual));
            let used =
                |view: &TrainingView| view.valid.iter().flatten().filter(|used| **used).count();
            assert!(used(&near) > used(&usual));
        }
    }

    #[test]
    fn pseudo_novel_cameras_are_near_and_look_where_the_photograph_does() {
        for limit_m in [0.6, 0.05] {
            let samples = samples(limit_m);
            let mut farthest = 0.0_f64;
            for k in 0..COUNT {
                let Sample { source, target, .. } = samples.get(k).unwrap();
                let mut depths: Vec<f32> = target.depth.iter().copied().collect();
                depths.sort_unstable_by(f32::total_cmp);
                let distance = f64::from(depths[depths.len() / 2]);
                let metres = baseline_m(&source.camera_from_world, &target.camera_from_world);
                assert!(
                    metres <= limit_m.min(0.26 * distance) + 1e-9,
                    "{metres} {distance}"
                );
                farthest = farthest.max(metres);
                let world_from_camera = source.camera_from_world.inverse();
                let (eye, ahead) = (
                    world_from_camera.apply(DVec3::ZERO),
                    world_from_camera.apply(DVec3::Z),
                );
                assert!(eye.z.abs() < 1e-9);
                let aimed = eye + (ahead - eye) * (distance / (ahead.z - eye.z));
                assert!(
                    aimed.x.abs().max(aimed.y.abs()) <= 0.1 * distance + 1e-9,
                    "{aimed}"
                );
            }
            assert!(farthest > 0.03, "{farthest}");
        }
    }
}
