//! Evaluation of all selected metrics for predictions and their target.

use std::sync::Arc;

use crate::engines::{Engines, Learned, Resolution};
use crate::identity::{LpipsNet, LpipsVariant, Metric, MetricKey, MetricRegion};
use crate::info::MetricInfo;
use crate::maps::ScoreMap;
use crate::options::ScorerOptions;
use crate::picture::{Mask, Picture};
use crate::selection::Selection;
use crate::unavailable::{ScoreError, Unavailable};
use crate::weights::{Backbone, Weights, WeightsError, WeightsUsed};
use crate::{dists::Similarity, lpips::Distance, psnr, ssim};

/// Computes a selection of metrics. A prediction's scores depend only on the prediction, its target
/// and the mask.
#[derive(Debug)]
pub struct Scorer {
    keys: Vec<MetricKey>,
    engines: Arc<Engines>,
    options: ScorerOptions,
}

/// Contribution of each layer to the value of a learned metric.
#[derive(Debug, Clone, PartialEq)]
pub enum Terms {
    /// Terms of LPIPS, one per layer; their sum is the value.
    Lpips {
        /// Mean weighted distance of each layer.
        layers: Vec<f64>,
    },
    /// Terms of DISTS, for the picture itself and five layers; the value is 1 minus the sum of all
    /// terms.
    Dists {
        /// Weighted similarity of means, for the picture and each layer.
        structure: [f64; 6],
        /// Weighted similarity of covariances, for the picture and each layer.
        texture: [f64; 6],
    },
}

/// Scores and their terms; see [`Scorer::examine`].
#[derive(Debug, Clone, PartialEq)]
pub struct Examined {
    pub scores: Scores,
    /// Terms of LPIPS and DISTS.
    pub terms: AllTerms,
    /// Local values of SSIM and LPIPS; empty unless requested.
    pub maps: Maps,
}

/// Scores in the order of the selection.
pub type Scores = Vec<(MetricKey, Result<f64, Unavailable>)>;
/// Maps in the order of the selection.
pub type Maps = Vec<(MetricKey, Result<ScoreMap, Unavailable>)>;
/// Terms in the order of the selection.
pub type AllTerms = Vec<(MetricKey, Result<Terms, Unavailable>)>;

impl Scorer {
    /// Prepares a selection of metrics with the available weights.
    ///
    /// # Errors
    /// [`WeightsError`] if a given weights file is needed but cannot be used. Missing weights are not an error: metrics
    /// that need them are [`Unavailable`].
    pub fn new(selection: &Selection, weights: &Weights) -> Result<Self, WeightsError> {
        Self::with_options(selection, weights, ScorerOptions::default())
    }

    /// Like [`new`](Self::new), with a choice of kernels.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn with_options(
        selection: &Selection,
        weights: &Weights,
        options: ScorerOptions,
    ) -> Result<Self, WeightsError> {
        let keys: Vec<MetricKey> = selection.keys().collect();
        let engines = Engines::new(&keys, weights, options)?;
        Ok(Self {
            keys,
            engines: Arc::new(engines),
            options,
        })
    }

    /// A scorer for some of the metrics, in this scorer's order; both share the networks.
    #[must_use]
    pub fn restricted(&self, keys: &[MetricKey]) -> Self {
        let kept = self.keys.iter().copied();
        Self {
            keys: kept.filter(|key| keys.contains(key)).collect(),
            engines: Arc::clone(&self.engines),
            options: self.options,
        }
    }

    /// LPIPS of version 0.0, which has no key; used to find out how a published number was
    /// computed. The pictures must have the same size. `None` if no selected metric uses the
    /// network `net`, or the network's weights are missing.
    ///
    /// # Errors
    /// [`Unavailable`] if these pictures have no value.
    pub fn lpips_v0(
        &self,
        net: LpipsNet,
        prediction: &Picture,
        target: &Picture,
    ) -> Option<Result<f64, Unavailable>> {
        self.engines.lpips_v0(net, prediction, target)
    }

    /// The metrics in the order of the selection.
    pub fn keys(&self) -> &[MetricKey] {
        &self.keys
    }

    /// Options of the networks' computation.
    pub fn options(&self) -> ScorerOptions {
        self.options
    }

    /// Description of each metric, with the weights in use, in the order of the selection.
    pub fn info(&self) -> Vec<MetricInfo> {
        let keys = self.keys.iter();
        keys.map(|&key| MetricInfo::new(key, &self.engines.used))
            .collect()
    }

    /// The network weights in use.
    pub fn weights(&self) -> &[WeightsUsed] {
        &self.engines.used
    }

    /// The metrics that cannot be computed for any picture because the weights of their network are
    /// missing, each with the network.
    pub fn missing_weights(&self) -> impl Iterator<Item = (MetricKey, Backbone)> + '_ {
        let used = |backbone| self.weights().iter().any(|used| used.backbone == backbone);
        let needed = self.keys.iter();
        let needed = needed.filter_map(|&key| Some((key, Backbone::of(key.metric())?)));
        needed.filter(move |&(_, backbone)| !used(backbone))
    }

    /// Scores a prediction against its target. Both are sRGB-encoded, with values in 0..1 or 8-bit levels, and of the
    /// same size. `mask` is only used by the masked keys, whose suffix identifies the kind of mask.
    ///
    /// # Errors
    /// If the pictures cannot be compared at all. A metric without a value for these pictures is an entry with the
    /// reason instead.
    pub fn score(
        &self,
        prediction: &Picture,
        target: &Picture,
        mask: Option<&Mask>,
    ) -> Result<Scores, ScoreError> {
        self.score_all(target, &[prediction], mask).swap_remove(0)
    }

    /// Scores several predictions of one target, in order. The networks process the target once: k
    /// predictions take k + 1 passes of each network instead of 2 k. Every score is bit-identical
    /// to the result of [`score`](Self::score).
    ///
    /// A prediction that cannot be compared gives an error of its own and does not affect the other scores. A target or
    /// mask that cannot be used gives an error for every prediction. Memory grows with the number of predictions; see
    /// [`memory_bytes`](Self::memory_bytes).
    pub fn score_all(
        &self,
        target: &Picture,
        predictions: &[&Picture],
        mask: Option<&Mask>,
    ) -> Vec<Result<Scores, ScoreError>> {
        let usable = target.check().map_err(ScoreError::Target);
        let check = |prediction| {
            usable
                .clone()
                .and_then(|()| check(prediction, target, mask))
        };
        let mut results: Vec<Result<Scores, ScoreError>> = predictions
            .iter()
            .map(|prediction| check(prediction).map(|()| Vec::new()))
            .collect();
        let sound: Vec<(&Picture, &mut Scores)> = predictions
            .iter()
            .zip(&mut results)
            .filter_map(|(prediction, result)| Some((*prediction, result.as_mut().ok()?)))
            .collect();
        let mut pictures = vec![target];
        pictures.extend(sound.iter().map(|(prediction, _)| *prediction));
        let learned = self.engines.run(&pictures, &self.keys, false);
        for ((prediction, scores), learned) in sound.into_iter().zip(learned) {
            *scores = self.scores_of([prediction, target], mask, &learned);
        }
        results
    }

    /// Approximate memory in bytes that [`score_all`](Self::score_all) uses for `predictions`
    /// predictions of the given size: the rows that the networks buffer for each picture, and the
    /// local distances of masked metrics. The pictures, the networks' weights and device memory are
    /// not included.
    pub fn memory_bytes(&self, size: (u32, u32), predictions: usize) -> u64 {
        self.engines.memory(size, predictions, &self.keys) as u64
    }

    /// Like [`score`](Self::score), but also returns the terms of LPIPS and DISTS and, if
    /// `with_maps`, the maps of SSIM and LPIPS, at no extra cost. Terms and maps cover the whole
    /// picture.
    ///
    /// # Errors
    /// As for [`score`](Self::score).
    pub fn examine(
        &self,
        prediction: &Picture,
        target: &Picture,
        mask: Option<&Mask>,
        with_maps: bool,
    ) -> Result<Examined, ScoreError> {
        target.check().map_err(ScoreError::Target)?;
        check(prediction, target, mask)?;
        let mut keys = self.keys.clone();
        keys.retain(|key| !key.is_masked());
        let learned = self
            .engines
            .run(&[target, prediction], &self.keys, with_maps);
        let learned = &learned[0];
        let pair = [prediction, target];
        Ok(Examined {
            scores: self.scores_of(pair, mask, learned),
            terms: terms_of(&keys, learned),
            maps: if with_maps {
                maps_of(&keys, pair, learned)
            } else {
                Vec::new()
            },
        })
    }

    fn scores_of(&self, pair: [&Picture; 2], mask: Option<&Mask>, learned: &Learned) -> Scores {
        let [prediction, target] = pair;
        let score = |key: MetricKey| {
            let mask = match (key.is_masked(), mask) {
                (false, _) => None,
                (true, Some(mask)) => Some(mask),
                (true, None) if key.region() == MetricRegion::Frustum => {
                    return Err(Unavailable::NoFrustumMask);
                }
                (true, None) => return Err(Unavailable::NoMask),
            };
            match key.metric() {
                Metric::Psnr => psnr::psnr(prediction, target, mask),
                Metric::PsnrFloored => psnr::psnr(prediction, target, mask).map(psnr::floored),
                Metric::Ssim(variant) => ssim::ssim(variant, prediction, target, mask),
                Metric::Lpips(net, LpipsVariant::BoxPaste) => {
                    let mask = mask.ok_or(Unavailable::NoMask)?;
                    self.engines.box_pasted(net, prediction, target, mask)
                }
                Metric::Lpips(net, variant) => {
                    let distance = learned.lpips(net, variant)?;
                    match mask {
                        Some(mask) if variant == LpipsVariant::LayerMask => {
                            distance.inside_layers(mask)
                        }
                        Some(mask) => learned.masked(distance, mask),
                        None => Ok(distance.layers.iter().sum()),
                    }
                }
                Metric::Dists => learned.dists(Resolution::Full).map(Similarity::score),
                Metric::DistsResize256 => learned.dists(Resolution::Side256).map(Similarity::score),
            }
        };
        self.keys.iter().map(|&key| (key, score(key))).collect()
    }
}

fn maps_of(keys: &[MetricKey], [prediction, target]: [&Picture; 2], learned: &Learned) -> Maps {
    let map = |&key: &MetricKey| match key.metric() {
        Metric::Ssim(variant) => Some((key, ssim::ssim_map(variant, prediction, target))),
        Metric::Lpips(net, variant) => {
            let distance = learned.lpips(net, variant);
            Some((key, distance.map(|distance| learned.map(distance))))
        }
        Metric::Psnr | Metric::PsnrFloored | Metric::Dists | Metric::DistsResize256 => None,
    };
    keys.iter().filter_map(map).collect()
}

fn terms_of(keys: &[MetricKey], learned: &Learned) -> AllTerms {
    let dists = |resolution| {
        learned.dists(resolution).map(|similarity| Terms::Dists {
            structure: similarity.structure,
            texture: similarity.texture,
        })
    };
    let terms = |&key: &MetricKey| match key.metric() {
        Metric::Psnr | Metric::PsnrFloored | Metric::Ssim(_) => None,
        Metric::Lpips(net, variant) => {
            let distance = learned.lpips(net, variant);
            let layers = |distance: &Distance| distance.layers.clone();
            Some((key, distance.map(|d| Terms::Lpips { layers: layers(d) })))
        }
        Metric::Dists => Some((key, dists(Resolution::Full))),
        Metric::DistsResize256 => Some((key, dists(Resolution::Side256))),
    };
    keys.iter().filter_map(terms).collect()
}

/// Rejects a prediction or mask that cannot be compared with a valid target.
fn check(prediction: &Picture, target: &Picture, mask: Option<&Mask>) -> Result<(), ScoreError> {
    prediction.check().map_err(ScoreError::Prediction)?;
    let (prediction, target) = (prediction.dimensions(), target.dimensions());
    if prediction != target {
        return Err(ScoreError::SizeMismatch { prediction, target });
    }
    match mask.map(Mask::dimensions) {
        Some(mask) if mask != target => Err(ScoreError::MaskSizeMismatch { mask, target }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    use image::{Rgb, Rgb32FImage, RgbImage};
    use sharp_kernels::{Algorithm, Simd};

    use super::*;
    use crate::identity::Family;
    use crate::options::Device;
    use crate::weights::Backbone;

    fn scorer(list: &str) -> Scorer {
        Scorer::new(&Selection::parse(list).unwrap(), &Weights::none()).unwrap()
    }

    #[test]
    fn unequal_sizes_and_bad_pixels_are_errors() {
        let scorer = scorer("psnr");
        let a = Picture::from(RgbImage::new(4, 3));
        let b = Picture::from(RgbImage::new(3, 4));
        let error = scorer.score(&a, &b, None).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the prediction is 4x3 but the target is 3x4"
        );
        let nan = Picture::from(Rgb32FImage::from_pixel(4, 3, Rgb([0.0, f32::NAN, 0.0])));
        let error = scorer.score(&nan, &a, None).unwrap_err().to_string();
        assert!(error.starts_with("prediction: NaN at x 0, y 0, channel 1"));
        let error = scorer.score(&a, &nan, None).unwrap_err().to_string();
        assert!(error.starts_with("target: NaN"));
        let mask = Mask::new(2, 2, vec![true; 4]).unwrap();
        assert!(matches!(
            scorer.score(&a, &a, Some(&mask)),
            Err(ScoreError::MaskSizeMismatch { .. })
        ));
    }

    #[test]
    fn missing_weights_and_masks_are_reasons_not_numbers() {
        let a = Picture::from(RgbImage::new(40, 30));
        let scores = scorer("paper,psnr@frustum").score(&a, &a, None).unwrap();
        let text = |i: usize| scores[i].1.clone().unwrap_err().to_string();
        assert_eq!(scores[0].0, MetricKey::DISTS);
        assert!(text(0).contains("--weights vgg16=FILE"));
        assert!(text(1).contains("sharp-bench weights fetch "));
        assert_eq!(scores[2].1, Ok(f64::INFINITY));
        assert_eq!(scores[3].1, Ok(1.0));
        assert_eq!(scores[4].1, Err(Unavailable::NoFrustumMask));
    }

    fn texture(seed: u32) -> Picture {
        Picture::from(RgbImage::from_fn(50, 40, |x, y| {
            let v = (x * 73 + y * 151 + x * y + seed).wrapping_mul(2_654_435_761) >> 20;
            Rgb([(v & 255) as u8, (x * 5 + seed) as u8, (v >> 4) as u8])
        }))
    }

    #[test]
    fn masked_lpips_is_the_mean_of_the_map_inside() {
        let selection = Selection::parse("lpips-alex,lpips-alex@frustum").unwrap();
        let scorer = Scorer::new(&selection, &Weights::deterministic("")).unwrap();
        let (a, b) = (texture(1), texture(90));
        let maps = scorer.examine(&a, &b, None, true).unwrap().maps;
        let map = maps[0].1.clone().unwrap().values;
        let inside: Vec<bool> = (0..50 * 40).map(|i| i % 50 > 20 && i / 50 < 9).collect();
        let values = map
            .as_raw()
            .iter()
            .zip(&inside)
            .filter(|(_, inside)| **inside);
        let sum: f64 = values.map(|(&v, _)| f64::from(v)).sum();
        let expected = sum / inside.iter().filter(|&&inside| inside).count() as f64;
        let mask = Mask::new(50, 40, inside).unwrap();
        let scores = scorer.score(&a, &b, Some(&mask)).unwrap();
        assert!((scores[1].1.clone().unwrap() - expected).abs() < 1e-7);
        assert_ne!(scores[0].1, scores[1].1);
        let empty = Mask::new(50, 40, vec![false; 2000]).unwrap();
        let scores = scorer.score(&a, &b, Some(&empty)).unwrap();
        assert_eq!(scores[1].1, Err(Unavailable::EmptyMask));
    }

    #[test]
    fn box_and_paste_is_lpips_of_the_box_with_the_target_around_the_mask() {
        let selection = Selection::parse("lpips-alex-box-paste@mask,lpips-alex,psnr@mask").unwrap();
        let scorer = Scorer::new(&selection, &Weights::deterministic("")).unwrap();
        let (a, b) = (texture(1), texture(90));
        // A corner of the box is outside the mask.
        let is_inside =
            |x: u32, y: u32| (3..45).contains(&x) && (2..38).contains(&y) && (x > 20 || y > 9);
        let inside = (0..50 * 40).map(|i| is_inside(i % 50, i / 50)).collect();
        let mask = Mask::new(50, 40, inside).unwrap();
        let boxed = |picture: &Picture, outside: &Picture| {
            Picture::from(RgbImage::from_fn(42, 36, |x, y| {
                let from = if is_inside(x + 3, y + 2) {
                    picture
                } else {
                    outside
                };
                Rgb([0, 1, 2].map(|c| (from.value(x + 3, y + 2, c) * 255.0).round() as u8))
            }))
        };
        let expected = scorer.restricted(&[MetricKey::LPIPS]);
        let expected = expected
            .score(&boxed(&a, &b), &boxed(&b, &b), None)
            .unwrap();
        let found = scorer.score(&a, &b, Some(&mask)).unwrap();
        assert_eq!(found[0].1, expected[0].1);
        assert_ne!(found[0].1, found[1].1);
        let small = Mask::new(50, 40, (0..2000).map(|i| i == 77).collect()).unwrap();
        let found = scorer.score(&a, &b, Some(&small)).unwrap();
        assert!(matches!(found[0].1, Err(Unavailable::TooSmall { .. })));
        assert!(found[2].1.is_ok());
    }

    #[test]
    fn a_full_layer_mask_is_none_and_a_hole_spreads_by_the_reach_of_each_layer() {
        let selection = Selection::parse("lpips-vgg,lpips-vgg-layer-mask@mask").unwrap();
        let scorer = Scorer::new(&selection, &Weights::deterministic("")).unwrap();
        let noise = |seed: u32| {
            Picture::from(RgbImage::from_fn(128, 128, |x, y| {
                let v = (x * 73 + y * 151 + x * y + seed).wrapping_mul(2_654_435_761) >> 20;
                Rgb([(v & 255) as u8, (x * 5 + seed) as u8, (v >> 4) as u8])
            }))
        };
        let (a, b) = (noise(1), noise(90));
        let masked = |inside: &dyn Fn(i64, i64) -> bool| {
            let inside = (0..128 * 128).map(|i| inside(i % 128, i / 128)).collect();
            let mask = Mask::new(128, 128, inside).unwrap();
            let scores = scorer.score(&a, &b, Some(&mask)).unwrap();
            (scores[0].1.clone().unwrap(), scores[1].1.clone())
        };
        let (whole, full) = masked(&|_, _| true);
        assert!((whole - full.unwrap()).abs() < 1e-6);
        // Columns 0 and 1 are outside the mask. They influence 4 columns of the first layer.
        // Halving makes these 2, and the second layer's reach of 2 makes them 4; then 2 + 3, 3 + 3
        // and 3 + 3 of 32, 16 and 8 columns.
        let engine = scorer
            .engines
            .run(&[&b, &a], &[MetricKey::LPIPS, scorer.keys()[0]], true);
        let maps = &engine[0]
            .lpips(crate::LpipsNet::Vgg, LpipsVariant::Official)
            .unwrap()
            .maps;
        let reached = [4, 4, 5, 6, 6];
        let expected: f64 = maps
            .iter()
            .zip(reached)
            .map(|(map, reached)| {
                let rows = map
                    .values
                    .chunks_exact(map.width)
                    .flat_map(|row| &row[reached..]);
                let (sum, count) = rows.fold((0.0, 0), |(s, n), v| (s + f64::from(*v), n + 1));
                sum / f64::from(count)
            })
            .sum();
        let (_, found) = masked(&|x, _| x > 1);
        let found = found.unwrap();
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        // With less than half of the picture inside, no position of the last layers remains.
        let (_, nothing) = masked(&|x, _| x > 100);
        assert_eq!(nothing, Err(Unavailable::EmptyMask));
    }

    #[test]
    fn values_do_not_depend_on_what_else_is_computed_or_on_strips() {
        let weights = Weights::deterministic("");
        let (a, b) = (texture(1), texture(90));
        let scores = |list: &str, strip: Option<usize>| {
            let options = ScorerOptions {
                strip_rows: strip.and_then(NonZeroUsize::new),
                ..ScorerOptions::default()
            };
            let selection = Selection::parse(list).unwrap();
            let scorer = Scorer::with_options(&selection, &weights, options).unwrap();
            scorer.score(&a, &b, None).unwrap()
        };
        let together = "psnr,lpips-alex,lpips-alex-eps-tm,lpips-squeeze,dists";
        let all = scores(together, None);
        assert_eq!(all, scores(together, Some(5)));
        for (key, score) in all {
            let (_, alone) = scores(&key.to_string(), None).swap_remove(0);
            assert_eq!(alone, score, "{key}");
        }
    }

    #[test]
    fn identical_pictures_have_no_distance() {
        let selection = Selection::parse("lpips-alex,lpips-squeeze-eps-tm,dists").unwrap();
        let scorer = Scorer::new(&selection, &Weights::deterministic("")).unwrap();
        let picture = texture(4);
        for (key, score) in scorer.score(&picture, &picture, None).unwrap() {
            let score = score.unwrap();
            let tolerance = if key.family() == Family::Dists {
                2e-6
            } else {
                0.0
            };
            assert!(score.abs() <= tolerance, "{key} {score}");
        }
        let terms = scorer
            .examine(&picture, &picture, None, false)
            .unwrap()
            .terms;
        let Ok(Terms::Lpips { layers }) = &terms[0].1 else {
            panic!("LPIPS has layers");
        };
        assert_eq!(layers, &[0.0; 5]);
    }

    #[test]
    fn one_examination_gives_what_three_calls_give() {
        let selection =
            Selection::parse("psnr,ssim-all,lpips-alex,lpips-alex@mask,lpips-squeeze,dists")
                .unwrap();
        let scorer = Scorer::new(&selection, &Weights::deterministic("")).unwrap();
        let (a, b) = (texture(1), texture(90));
        let mask = Mask::new(50, 40, (0..2000).map(|i| i % 3 == 0).collect()).unwrap();
        let all = scorer.examine(&a, &b, Some(&mask), true).unwrap();
        assert_eq!(all.scores, scorer.score(&a, &b, Some(&mask)).unwrap());
        let without = scorer.examine(&a, &b, Some(&mask), false).unwrap();
        assert_eq!(without.scores, all.scores);
        assert!(without.maps.is_empty());
    }

    #[test]
    fn the_weights_in_use_are_told() {
        let selection = Selection::parse("psnr,lpips-squeeze,dists").unwrap();
        let scorer = Scorer::new(&selection, &Weights::deterministic("x")).unwrap();
        let used: Vec<_> = scorer.weights().iter().map(|w| w.backbone).collect();
        assert_eq!(used, [Backbone::Vgg16, Backbone::SqueezeNet1_1]);
        assert_eq!(scorer.weights()[0].source.to_string(), "deterministic:x");
        assert_eq!(scorer.weights()[0].features_sha256.len(), 64);
    }

    #[test]
    fn together_as_alone() {
        let list = "psnr,ssim-all,psnr@mask,lpips-alex,lpips-alex@mask,lpips-vgg-unscaled,\
                    lpips-squeeze-eps-tm,dists,dists-resize256";
        let selection = Selection::parse(list).unwrap();
        let weights = Weights::deterministic("");
        let (width, height) = (50, 40);
        let mask = Mask::new(width, height, (0..2000).map(|i| i % 3 == 0).collect()).unwrap();
        let target = texture(1);
        let mut broken = Rgb32FImage::from_pixel(width, height, Rgb([0.5; 3]));
        broken.get_pixel_mut(3, 2).0[1] = f32::NAN;
        let mut predictions: Vec<Picture> = (2..5).map(|seed| texture(90 * seed)).collect();
        predictions.insert(1, Picture::from(broken));
        predictions.insert(4, Picture::from(RgbImage::new(height, width)));
        let fastest = Simd::detect();
        let mut options: Vec<_> = Simd::available()
            .into_iter()
            .map(|simd| (simd, Algorithm::Winograd, None))
            .collect();
        for rows in [7, 40] {
            options.push((fastest, Algorithm::Direct, NonZeroUsize::new(rows)));
        }
        for (simd, algorithm, strip_rows) in options {
            let options = ScorerOptions {
                simd,
                algorithm,
                strip_rows,
                ..ScorerOptions::default()
            };
            let scorer = Scorer::with_options(&selection, &weights, options).unwrap();
            assert_as_alone(&scorer, &target, &predictions, &mask);
        }
        if Device::CandleCpu.is_built() {
            let options = ScorerOptions {
                device: Device::CandleCpu,
                ..ScorerOptions::default()
            };
            let scorer = Scorer::with_options(&selection, &weights, options).unwrap();
            assert_as_alone(&scorer, &target, &predictions, &mask);
        }
    }

    /// Scores one prediction and all of them together, and compares the bits with those of the predictions scored one by
    /// one.
    fn assert_as_alone(scorer: &Scorer, target: &Picture, predictions: &[Picture], mask: &Mask) {
        let bits = |scores: Result<Scores, ScoreError>| {
            let scores = scores.map(|scores| {
                let bits = scores
                    .into_iter()
                    .map(|(key, v)| (key, v.map(f64::to_bits)));
                bits.collect::<Vec<_>>()
            });
            // NaN is not equal to itself, so errors are compared by their text.
            scores.map_err(|error| error.to_string())
        };
        for mask in [None, Some(mask)] {
            let alone: Vec<_> = predictions
                .iter()
                .map(|prediction| bits(scorer.score(prediction, target, mask)))
                .collect();
            for k in [1, predictions.len()] {
                let predictions: Vec<&Picture> = predictions[..k].iter().collect();
                let together = scorer.score_all(target, &predictions, mask);
                let together: Vec<_> = together.into_iter().map(bits).collect();
                assert_eq!(
                    together,
                    alone[..k],
                    "{} of {k}",
                    scorer.options().arithmetic()
                );
            }
        }
    }

    #[test]
    fn reduced_targets_are_shared_too() {
        let large = |seed: u32| {
            Picture::from(RgbImage::from_fn(270, 280, |x, y| {
                Rgb([x as u8, (y * seed) as u8, (x * y) as u8])
            }))
        };
        let selection = Selection::parse("dists-resize256").unwrap();
        let scorer = Scorer::new(&selection, &Weights::deterministic("")).unwrap();
        let predictions = [large(2), large(3)];
        let target = large(1);
        let together = scorer.score_all(&target, &[&predictions[0], &predictions[1]], None);
        let alone = predictions.map(|prediction| scorer.score(&prediction, &target, None));
        assert_eq!(together, alone);
    }

    #[test]
    fn a_bad_target_or_mask_is_everyones_error() {
        let scorer = scorer("psnr");
        let picture = texture(1);
        let nan = Picture::from(Rgb32FImage::from_pixel(50, 40, Rgb([f32::NAN; 3])));
        for result in scorer.score_all(&nan, &[&picture, &picture], None) {
            assert!(matches!(result, Err(ScoreError::Target(_))));
        }
        let mask = Mask::new(2, 2, vec![true; 4]).unwrap();
        for result in scorer.score_all(&picture, &[&picture, &picture], Some(&mask)) {
            assert!(matches!(result, Err(ScoreError::MaskSizeMismatch { .. })));
        }
        assert!(scorer.score_all(&picture, &[], None).is_empty());
    }
}
