//! The modules of the network.

use super::ModelConfig;
use super::alignment::DepthAlignment;
use super::config::LAYERS;
use super::gaussian_decoder::{GaussianDecoder, PredictionHead};
use super::monodepth::Monodepth;
use super::params::Params;

/// Every module with parameters, named as in the checkpoint.
pub(super) struct SharpNetwork {
    pub(super) monodepth: Monodepth,
    pub(super) feature_model: GaussianDecoder,
    pub(super) prediction_head: PredictionHead,
    pub(super) depth_alignment: DepthAlignment,
}

impl SharpNetwork {
    pub(super) fn new(config: &ModelConfig, p: &Params<'_>) -> Self {
        let monodepth = p.pp("monodepth_model").pp("monodepth_predictor");
        let alignment = p.pp("depth_alignment").pp("scale_map_estimator");
        Self {
            monodepth: Monodepth::new(&monodepth, config, LAYERS),
            feature_model: GaussianDecoder::new(&p.pp("feature_model"), config),
            prediction_head: PredictionHead::new(&p.pp("prediction_head"), config),
            depth_alignment: DepthAlignment::new(&alignment, config),
        }
    }
}
