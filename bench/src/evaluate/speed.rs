//! Measures the times of inference and rendering separately.

use std::collections::BTreeSet;
use std::time::Instant;

use serde::Serialize;
use sharp::render::{RenderError, RenderOutput};

use super::error::EvaluateError;
use super::gaussians::footprint::covered_tiles;
use super::gaussians::render::placed;
use super::prepare::Evaluation;
use crate::io::machine::{peak_bytes, reset_peak};
use crate::io::observer::Observer;
use crate::methods::{
    Approach, GaussianPrediction, Method, MethodError, SourceView, TargetCamera, TrueDepth,
};
use crate::pairs::PosedCamera;
use crate::pairs::pair_id::source_of;
use crate::pairs::pair_list::ResolvedPair;

/// Numbers of warm-up and counted rounds of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct SpeedOptions {
    /// Uncounted rounds on the first pair of each method and dataset.
    pub warmup: usize,
    /// Counted rounds per pair.
    pub repeat: usize,
}

/// Times of a method on a dataset.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Speed {
    pub dataset: String,
    pub method: String,
    /// Widths and heights of the targets, in pixels.
    pub sizes: BTreeSet<(u32, u32)>,
    pub pairs: usize,
    /// Seconds per round from the source picture in memory to the Gaussians in memory, or to the picture for methods
    /// that make pictures. Empty for methods that read external files.
    pub inference_secs: Vec<f64>,
    /// Seconds from Gaussians in memory until the renderer is ready (the upload on a GPU).
    pub load_secs: Vec<f64>,
    /// Seconds from a ready renderer to the 8-bit picture in memory. Empty for methods that make
    /// pictures.
    pub render_secs: Vec<f64>,
    /// Seconds of drawing on a GPU without copying the picture to the host, which is what papers usually measure; empty
    /// on the CPU.
    pub device_secs: Vec<f64>,
    /// For each pair, numbers that explain its rendering time.
    pub splats: Vec<Splats>,
    /// Peak resident size of the process during measurement, bytes; `None` if the system does not report it.
    pub peak_bytes: Option<u64>,
    /// One line, `pair: reason`, for each pair that could not be measured.
    pub failures: Vec<String>,
}

/// Counts of a prediction's Gaussians in a target's view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Splats {
    pub count: u64,
    /// Number of Gaussians that reach the picture.
    pub visible: u64,
    /// Number of 16 × 16 pixel tiles that a visible Gaussian touches, summed over Gaussians. The time of sorting and
    /// blending depends on it.
    pub tiles: u64,
    pub picture_tiles: u64,
}

/// One measured round on a pair.
enum Round {
    Picture,
    Gaussians(Box<GaussianPrediction>),
}

impl Evaluation {
    /// Measures every method on the pairs of each dataset. Skips the method `target` and the scale sweep: neither
    /// predicts anything itself.
    ///
    /// # Errors
    /// If the renderer's device fails. Other failures are listed in [`Speed::failures`], and the measurement continues.
    pub fn speed(
        &self,
        options: SpeedOptions,
        observer: &dyn Observer,
    ) -> Result<Vec<Speed>, EvaluateError> {
        let pairs = self.pairs()?;
        let folder = std::env::temp_dir();
        let methods = self.methods.iter().filter(|method| {
            matches!(
                method.approach(),
                Approach::Pictures(_) | Approach::Gaussians(_)
            )
        });
        let methods: Vec<&dyn Method> = methods.map(AsRef::as_ref).collect();
        for method in &methods {
            method.begin(&folder, &folder);
        }
        observer.begin("measuring", pairs.len() * methods.len(), "pairs");
        let mut measured = Vec::new();
        for pairs in pairs.chunk_by(|a, b| a.pair.dataset == b.pair.dataset) {
            for method in &methods {
                measured.push(self.speed_of(*method, pairs, options, observer)?);
            }
        }
        observer.end();
        Ok(measured)
    }

    fn speed_of(
        &self,
        method: &dyn Method,
        pairs: &[ResolvedPair<'_>],
        options: SpeedOptions,
        observer: &dyn Observer,
    ) -> Result<Speed, EvaluateError> {
        let mut speed = Speed {
            dataset: pairs
                .first()
                .map_or_else(String::new, |p| p.pair.dataset.clone()),
            method: method.label().to_owned(),
            sizes: BTreeSet::new(),
            pairs: 0,
            inference_secs: Vec::new(),
            load_secs: Vec::new(),
            render_secs: Vec::new(),
            device_secs: Vec::new(),
            splats: Vec::new(),
            peak_bytes: None,
            failures: Vec::new(),
        };
        let is_reset = reset_peak();
        for planned in pairs {
            let warmup = match speed.pairs {
                0 => options.warmup,
                _ => 0,
            };
            let id = &planned.pair.pair_id;
            let done = infer(method, planned, warmup, options.repeat, &mut speed);
            let done = match done {
                Err(error) => Err(error.to_string()),
                Ok(Round::Picture) => Ok(()),
                Ok(Round::Gaussians(prediction)) => {
                    let rendered = self.rendered(&prediction, planned, warmup, options, &mut speed);
                    match rendered {
                        Err(error) if error.is_device_fault() => {
                            return Err(EvaluateError::Device {
                                pair_id: id.clone(),
                                method: method.label().to_owned(),
                                reason: error.to_string(),
                            });
                        }
                        rendered => rendered.map_err(|error| error.to_string()),
                    }
                }
            };
            match done {
                Err(reason) => speed.failures.push(format!("{id}: {reason}")),
                Ok(()) => {
                    speed.pairs += 1;
                    speed.sizes.insert(PosedCamera::from(planned.target).size());
                }
            }
            observer.step();
        }
        speed.peak_bytes = peak_bytes().filter(|_| is_reset);
        Ok(speed)
    }

    /// Renders a prediction into the target, and counts the drawn Gaussians.
    fn rendered(
        &self,
        prediction: &GaussianPrediction,
        planned: &ResolvedPair<'_>,
        warmup: usize,
        options: SpeedOptions,
        speed: &mut Speed,
    ) -> Result<(), RenderError> {
        let (source, target) = (planned.source.into(), PosedCamera::from(planned.target));
        let placed = placed(prediction.space, &source, &target);
        let view = self
            .renderer
            .view(placed, target.intrinsics, prediction.rule);
        let mut last: Option<RenderOutput> = None;
        for round in 0..warmup + options.repeat {
            let started = Instant::now();
            let (loaded, secs, on_device, output) =
                self.renderer.with_loaded(&prediction.gaussians, |scene| {
                    let loaded = started.elapsed().as_secs_f64();
                    let started = Instant::now();
                    let output = scene.render(&view)?;
                    let picture = self.renderer.picture(&output);
                    let secs = started.elapsed().as_secs_f64();
                    std::hint::black_box(picture);
                    let started = Instant::now();
                    let is_drawn = scene.draw_on_device(&view)?;
                    let on_device = is_drawn.then(|| started.elapsed().as_secs_f64());
                    Ok((loaded, secs, on_device, output))
                })?;
            if round >= warmup {
                speed.device_secs.extend(on_device);
                speed.load_secs.push(loaded);
                speed.render_secs.push(secs);
            }
            last = Some(output);
        }
        if let Some(output) = last {
            let (tiles, picture_tiles) = covered_tiles(&prediction.gaussians, &view);
            speed.splats.push(Splats {
                count: prediction.gaussians.len() as u64,
                visible: output.drawn,
                tiles,
                picture_tiles,
            });
        }
        Ok(())
    }
}

/// Predicts a pair repeatedly. Reading its files is not timed.
fn infer(
    method: &dyn Method,
    planned: &ResolvedPair<'_>,
    warmup: usize,
    repeat: usize,
    speed: &mut Speed,
) -> Result<Round, MethodError> {
    let (source, target): (PosedCamera, PosedCamera) =
        (planned.source.into(), planned.target.into());
    let pair_id = &planned.pair.pair_id;
    let photograph = planned.source.content.image()?;
    let depth = match method.privilege().depth {
        TrueDepth::SourceDepth => planned.source.content.depth()?,
        _ => None,
    };
    let source = SourceView::new(source_of(pair_id), &source, &photograph, depth.as_ref());
    let target = TargetCamera::new(pair_id, &target);
    let is_read = matches!(method.identity().kind.as_str(), "imported" | "gaussians");
    let rounds = if is_read { 1 } else { warmup + repeat };
    let mut last = Round::Picture;
    for round in 0..rounds {
        let started = Instant::now();
        last = match method.approach() {
            Approach::Gaussians(gaussians) => Round::Gaussians(Box::new(
                gaussians.predict(&source, gaussians.needs_target().then_some(&target))?,
            )),
            Approach::Pictures(pictures) => {
                std::hint::black_box(pictures.predict(&source, &target)?);
                Round::Picture
            }
            Approach::Target | Approach::Scales(_) => Round::Picture,
        };
        if round >= warmup && !is_read {
            speed.inference_secs.push(started.elapsed().as_secs_f64());
        }
    }
    Ok(last)
}
