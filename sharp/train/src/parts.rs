//! The trained parts of the network (paper, implementation details; `set_requires_grad_` in the SHARP release).

use serde::Deserialize;

/// True for each part that is trained. The default is the paper's: all but the patch encoder and the encoders'
/// normalisations, 340 M of 702 M parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainedParts {
    /// The patch transformer and the upsamplers of its features.
    pub patch_encoder: bool,
    /// The whole-image transformer, and the layers that upsample and fuse its features.
    pub image_encoder: bool,
    /// The LayerNorms of the trained encoders. LayerNorms of an encoder that is not trained are
    /// always frozen.
    pub encoder_norms: bool,
    /// Decoder and head of the disparity.
    pub depth_decoder: bool,
    /// Decoder and heads of the Gaussians' deltas.
    pub gaussian_decoder: bool,
    pub alignment: bool,
}

impl Default for TrainedParts {
    fn default() -> Self {
        Self {
            patch_encoder: false,
            image_encoder: true,
            encoder_norms: false,
            depth_decoder: true,
            gaussian_decoder: true,
            alignment: true,
        }
    }
}

impl TrainedParts {
    /// True if the parameter called `name` is trained. False for names that are not parameters, and for the
    /// transformers' unused classification heads.
    pub fn contain(&self, name: &str) -> bool {
        let mut path = name.split('.');
        let mut next = || path.next().unwrap_or_default();
        match next() {
            "depth_alignment" => self.alignment,
            "feature_model" | "prediction_head" => self.gaussian_decoder,
            "monodepth_model" if next() == "monodepth_predictor" => match (next(), next()) {
                ("decoder" | "head", _) => self.depth_decoder,
                ("encoder", module) => self.contain_encoder(module, path),
                _ => false,
            },
            _ => false,
        }
    }

    fn contain_encoder<'a>(&self, module: &str, mut within: impl Iterator<Item = &'a str>) -> bool {
        let learns = match module {
            "patch_encoder" | "upsample_latent0" | "upsample_latent1" | "upsample0"
            | "upsample1" | "upsample2" => self.patch_encoder,
            "image_encoder" | "upsample_lowres" | "fuse_lowres" => self.image_encoder,
            _ => false,
        };
        let is_excluded = |module: &str| match module {
            "head" => true,
            "norm" | "norm1" | "norm2" => !self.encoder_norms,
            _ => false,
        };
        learns && !within.any(is_excluded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp::model::ModelConfig;
    use sharp::model::inventory::inventory;
    use sharp::model::params::Parameter;

    const ALL: TrainedParts = TrainedParts {
        patch_encoder: true,
        image_encoder: true,
        encoder_norms: true,
        depth_decoder: true,
        gaussian_decoder: true,
        alignment: true,
    };

    fn trained(parts: TrainedParts) -> usize {
        let all = inventory(&ModelConfig::release()).unwrap();
        let trained = all.iter().filter(|p| parts.contain(&p.name));
        trained.map(Parameter::len).sum()
    }

    #[test]
    fn the_papers_parts_are_its_340_million() {
        let millions = trained(TrainedParts::default()) as f64 / 1e6;
        assert!((millions - 339.8).abs() < 0.05, "{millions}");
    }

    #[test]
    fn every_parameter_that_is_used_belongs_to_a_part() {
        for parameter in inventory(&ModelConfig::release()).unwrap() {
            let belongs = ALL.contain(&parameter.name);
            assert!(belongs || !parameter.used, "{}", parameter.name);
        }
        let head = "monodepth_model.monodepth_predictor.encoder.image_encoder.head.weight";
        assert!(!ALL.contain(head));
        assert!(!ALL.contain("something.else") && !ALL.contain(""));
    }

    #[test]
    fn each_part_is_switched_alone() {
        let off = |change: fn(&mut TrainedParts)| {
            let mut parts = ALL;
            change(&mut parts);
            trained(parts)
        };
        let counts = [
            off(|p| p.patch_encoder = false),
            off(|p| p.image_encoder = false),
            off(|p| p.encoder_norms = false),
            off(|p| p.depth_decoder = false),
            off(|p| p.gaussian_decoder = false),
            off(|p| p.alignment = false),
        ];
        // Norms are inside the encoders. All other parts are disjoint, and together they are the
        // whole network.
        let all = trained(ALL);
        let lost: usize = [0, 1, 3, 4, 5].iter().map(|&k| all - counts[k]).sum();
        assert_eq!(lost, all);
        // Two LayerNorms in each of 24 blocks and one after the last, for both encoders; 1024
        // channels each.
        assert_eq!(all - counts[2], 2 * 49 * 2 * 1024);
    }
}
