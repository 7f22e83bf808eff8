//! The learned metrics of a selection. Each network runs once on each picture.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::Arc;

use image::ImageBuffer;

use crate::backbone::{Extractor, Kernels};
use crate::dists::{Dists, Similarity};
use crate::identity::{LpipsNet, LpipsVariant, Metric, MetricKey};
use crate::lpips::{Distance, Epsilon, InputRange, Lpips};
use crate::maps::{ScoreMap, summed_rows};
use crate::options::ScorerOptions;
use crate::picture::{Mask, Picture};
use crate::resize::to_shorter_side_256;
use crate::unavailable::Unavailable;
use crate::weights::{
    Backbone, Weights, WeightsError, WeightsUsed, dists_weights, linear_weights, linear_weights_v0,
};

/// The networks that a selection needs and for which weights are available.
#[derive(Debug)]
pub(crate) struct Engines {
    lpips: BTreeMap<LpipsNet, Lpips>,
    dists: Option<Dists>,
    pub(crate) used: Vec<WeightsUsed>,
    /// Number of picture rows processed at once; `None` for the default.
    strip: Option<usize>,
}

/// Input range and ε of a variant. Each input range needs its own pass of the network.
fn convention(variant: LpipsVariant) -> (InputRange, Epsilon) {
    match variant {
        LpipsVariant::Official | LpipsVariant::BoxPaste => (InputRange::Signed, Epsilon::Outside),
        LpipsVariant::LayerMask => (InputRange::Signed, Epsilon::LargerOutside),
        LpipsVariant::Unscaled => (InputRange::Unit, Epsilon::Outside),
        LpipsVariant::TorchmetricsEps => (InputRange::Signed, Epsilon::Inside),
    }
}

impl Engines {
    pub(crate) fn new(
        keys: &[MetricKey],
        weights: &Weights,
        options: ScorerOptions,
    ) -> Result<Self, WeightsError> {
        let kernels = Kernels {
            simd: options.simd,
            algorithm: options.algorithm,
        };
        let mut engines = Self {
            lpips: BTreeMap::new(),
            dists: None,
            used: Vec::new(),
            strip: options.strip_rows.map(NonZeroUsize::get),
        };
        for backbone in Backbone::ALL {
            let needed = |key: &MetricKey| Backbone::of(key.metric()) == Some(backbone);
            if !keys.iter().any(needed) {
                continue;
            }
            let Some(loaded) = weights.load(backbone)? else {
                continue;
            };
            let network = Extractor::new(backbone, &loaded.tensors, options.device, kernels)?;
            let network = Arc::new(network);
            engines.used.push(loaded.used);
            for net in LpipsNet::ALL {
                let wanted =
                    |key: &MetricKey| matches!(key.metric(), Metric::Lpips(n, _) if n == net);
                if Backbone::of_lpips(net) == backbone && keys.iter().any(wanted) {
                    let lpips = Lpips::new(network.clone(), &linear_weights(net)?);
                    engines.lpips.insert(net, lpips);
                }
            }
            let wanted =
                |key: &MetricKey| matches!(key.metric(), Metric::Dists | Metric::DistsResize256);
            if backbone == Backbone::Vgg16 && keys.iter().any(wanted) {
                let [alpha, beta] = dists_weights()?;
                let network = Arc::new(network.with_l2_pooling()?);
                engines.dists = Some(Dists::new(network, &alpha, &beta));
            }
        }
        Ok(engines)
    }

    /// Published LPIPS in the bounding box of a mask, with the prediction replaced by the target outside the mask.
    pub(crate) fn box_pasted(
        &self,
        net: LpipsNet,
        prediction: &Picture,
        target: &Picture,
        mask: &Mask,
    ) -> Result<f64, Unavailable> {
        let bounds = mask.bounds().ok_or(Unavailable::EmptyMask)?;
        let pasted = prediction.pasted(target, mask, bounds);
        let target = target.pasted(target, mask, bounds);
        let official = MetricKey::whole(Metric::Lpips(net, LpipsVariant::Official));
        let learned = self.run(&[&target, &pasted], &[official], false);
        let learned = learned.first().ok_or(Unavailable::EmptyMask)?;
        let distance = learned.lpips(net, LpipsVariant::Official)?;
        Ok(distance.layers.iter().sum())
    }

    /// LPIPS of version 0.0, using the network of version 0.1; `None` if that network is not
    /// loaded.
    pub(crate) fn lpips_v0(
        &self,
        net: LpipsNet,
        prediction: &Picture,
        target: &Picture,
    ) -> Option<Result<f64, Unavailable>> {
        let network = Arc::clone(self.lpips.get(&net)?.network());
        let engine = Lpips::new(network, &linear_weights_v0(net).ok()?);
        let pictures = [target, prediction];
        let found = engine.distances(
            &pictures,
            InputRange::Raw,
            &[Epsilon::Outside],
            false,
            self.strip,
        );
        Some(found.map(|found| found[0][0].layers.iter().sum()))
    }

    /// Approximate memory in bytes that [`run`](Self::run) uses in addition to pictures and networks.
    pub(crate) fn memory(&self, size: (u32, u32), predictions: usize, keys: &[MetricKey]) -> usize {
        let size = (size.0 as usize, size.1 as usize);
        let of = |network: &Extractor| network.memory(size, predictions + 1, self.strip);
        let lpips = self.lpips.values().map(|engine| of(engine.network()));
        let dists = self.dists.iter().map(|engine| of(engine.network()));
        let rows = lpips.chain(dists).max().unwrap_or(0);
        // Local distances of masked keys: at most one tap at full resolution, and each further tap
        // at half the resolution of the one before.
        let maps = keys.iter().filter(|key| {
            key.is_masked() && matches!(key.metric(), Metric::Lpips(_, variant) if variant != LpipsVariant::BoxPaste)
        });
        let map = size.0 * size.1 * size_of::<f32>() * 4 / 3;
        rows + maps.count() * predictions * map
    }

    /// Runs the learned metrics among `keys` that apply to whole pictures; returns the results of
    /// each prediction. The target is the first of `pictures`, which must all have the same size.
    /// Maps are kept for masked keys, and for all keys if requested.
    pub(crate) fn run(
        &self,
        pictures: &[&Picture],
        keys: &[MetricKey],
        with_maps: bool,
    ) -> Vec<Learned> {
        let [target, predictions @ ..] = pictures else {
            return Vec::new();
        };
        let nothing = Learned {
            size: target.dimensions(),
            lpips: BTreeMap::new(),
            dists: BTreeMap::new(),
        };
        let mut learned = vec![nothing; predictions.len()];
        if predictions.is_empty() {
            return learned;
        }
        for (&net, engine) in &self.lpips {
            for range in [InputRange::Signed, InputRange::Unit] {
                let mut variants = BTreeMap::new();
                for key in keys {
                    if let Metric::Lpips(n, variant) = key.metric()
                        && n == net
                        && variant != LpipsVariant::BoxPaste
                        && convention(variant).0 == range
                    {
                        *variants.entry(variant).or_insert(with_maps) |= key.is_masked();
                    }
                }
                if variants.is_empty() {
                    continue;
                }
                let epsilons: Vec<Epsilon> = variants.keys().map(|&v| convention(v).1).collect();
                let keep = variants.values().any(|&keep| keep);
                let found = engine.distances(pictures, range, &epsilons, keep, self.strip);
                for (learned, found) in learned.iter_mut().zip(spread(found, predictions.len())) {
                    let distances = spread(found, variants.len());
                    for (&variant, distance) in variants.keys().zip(distances) {
                        learned.lpips.insert((net, variant), distance);
                    }
                }
            }
        }
        let Some(engine) = &self.dists else {
            return learned;
        };
        let wanted = |metric| keys.iter().any(|key| key.metric() == metric);
        if wanted(Metric::Dists) {
            let found = engine.compare(pictures, self.strip);
            for (learned, found) in learned.iter_mut().zip(spread(found, predictions.len())) {
                learned.dists.insert(Resolution::Full, found);
            }
        }
        if wanted(Metric::DistsResize256) {
            let resized: Vec<Cow<Picture>> =
                pictures.iter().map(|p| to_shorter_side_256(p)).collect();
            let unchanged = matches!(resized[0], Cow::Borrowed(_));
            if unchanged && wanted(Metric::Dists) {
                // The pictures are too small to be reduced, so `dists` and `dists[resize256]` have
                // the same value.
                for learned in &mut learned {
                    if let Some(full) = learned.dists.get(&Resolution::Full).cloned() {
                        learned.dists.insert(Resolution::Side256, full);
                    }
                }
            } else {
                let resized: Vec<&Picture> = resized.iter().map(|picture| &**picture).collect();
                let found = engine.compare(&resized, self.strip);
                for (learned, found) in learned.iter_mut().zip(spread(found, predictions.len())) {
                    learned.dists.insert(Resolution::Side256, found);
                }
            }
        }
        learned
    }
}

/// Turns one result for all predictions into one result per prediction; an error is repeated for each of `count`
/// predictions.
fn spread<T: Clone>(
    found: Result<Vec<T>, Unavailable>,
    count: usize,
) -> Vec<Result<T, Unavailable>> {
    match found {
        Ok(found) => found.into_iter().map(Ok).collect(),
        Err(reason) => vec![Err(reason); count],
    }
}

/// Results of the learned metrics for a prediction; metrics without weights are absent.
#[derive(Clone)]
pub(crate) struct Learned {
    size: (u32, u32),
    lpips: BTreeMap<(LpipsNet, LpipsVariant), Result<Distance, Unavailable>>,
    dists: BTreeMap<Resolution, Result<Similarity, Unavailable>>,
}

/// Resolution at which DISTS compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Resolution {
    Full,
    /// Reduced to a shorter side of at most 256.
    Side256,
}

impl Learned {
    pub(crate) fn lpips(
        &self,
        net: LpipsNet,
        variant: LpipsVariant,
    ) -> Result<&Distance, Unavailable> {
        found(self.lpips.get(&(net, variant)), Backbone::of_lpips(net))
    }

    pub(crate) fn dists(&self, resolution: Resolution) -> Result<&Similarity, Unavailable> {
        found(self.dists.get(&resolution), Backbone::Vgg16)
    }

    /// Mean of an LPIPS's spatial map inside a mask; `distance` must have been computed with maps.
    pub(crate) fn masked(&self, distance: &Distance, mask: &Mask) -> Result<f64, Unavailable> {
        let count = mask.count();
        if count == 0 {
            return Err(Unavailable::EmptyMask);
        }
        let size = (self.size.0 as usize, self.size.1 as usize);
        let rows = summed_rows(&distance.maps, size, |y, row| {
            let inside = row.iter().zip(mask.row(y)).filter(|(_, inside)| **inside);
            inside.map(|(value, _)| value).sum::<f64>()
        });
        Ok(rows.iter().sum::<f64>() / count as f64)
    }

    /// Spatial map of an LPIPS; `distance` must have been computed with maps.
    pub(crate) fn map(&self, distance: &Distance) -> ScoreMap {
        let (width, height) = self.size;
        let mut values = ImageBuffer::new(width, height);
        let size = (width as usize, height as usize);
        let rows = summed_rows(&distance.maps, size, |_, row| {
            row.iter().map(|&v| v as f32).collect::<Vec<_>>()
        });
        for (out, row) in values.chunks_exact_mut(width as usize).zip(rows) {
            out.copy_from_slice(&row);
        }
        ScoreMap { values, origin: 0 }
    }
}

fn found<T>(
    result: Option<&Result<T, Unavailable>>,
    backbone: Backbone,
) -> Result<&T, Unavailable> {
    match result {
        Some(result) => result.as_ref().map_err(Clone::clone),
        None => Err(Unavailable::NoWeights { backbone }),
    }
}
