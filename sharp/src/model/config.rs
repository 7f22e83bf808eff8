//! Sizes of a network as data: the SHARP release is a preset; other networks are described in files.

use std::fmt::Debug;
use std::path::Path;

use serde::{Deserialize, Serialize};
use sharp_checkpoint::hash::sha256_hex;

use super::ModelError;
use crate::initializer::Grid;

/// Number of depth layers, and of layers of Gaussians.
pub const LAYERS: usize = 2;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VitConfig {
    /// Channels of the input, 3.
    pub in_chans: usize,
    /// Channels of a token.
    pub embed_dim: usize,
    pub depth: usize,
    /// Number of attention heads, each `embed_dim / num_heads` wide.
    pub num_heads: usize,
    /// Initial LayerScale in training; unused at inference.
    #[serde(default)]
    pub init_values: f64,
    /// Side of the square input in pixels.
    pub img_size: usize,
    /// Side of a token's patch in pixels.
    pub patch_size: usize,
    /// Added to the variance in every layer normalisation. The SHARP release uses 1e-6, not the 1e-5 of most
    /// transformers.
    #[serde(default = "release_norm_eps")]
    pub norm_eps: f32,
    /// Outputs of the unused classification head.
    pub num_classes: usize,
    /// Pooling of the unused classification head.
    #[serde(default)]
    pub global_pool: String,
}

impl VitConfig {
    /// Tokens along a side of the input.
    pub fn tokens_per_side(&self) -> usize {
        self.img_size / self.patch_size
    }
}

/// Predicted depth that the alignment network receives along with the known depth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlignmentInput {
    /// The first of the two layers, as in the SHARP release. The network then has two input channels.
    #[default]
    FirstLayer,
    /// Both layers, a possible interpretation of the paper. The network then has three input
    /// channels.
    BothLayers,
}

impl AlignmentInput {
    /// Number of predicted layers that the network receives.
    pub fn layers(self) -> usize {
        match self {
            Self::FirstLayer => 1,
            Self::BothLayers => LAYERS,
        }
    }

    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// SHA-256 of a configuration that is or contains a [`ModelConfig`]. A key added in a later version is included only if
/// it differs from its default, so that hashes from earlier versions remain valid.
pub fn config_sha256(config: &impl Debug) -> String {
    // Debug output of numbers, strings and lists of them is unambiguous and cannot fail.
    let text = format!("{config:?}").replace(", alignment_input: None", "");
    sha256_hex(text.replace(", alignment_input: FirstLayer", "").as_bytes())
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    pub preset: String,
    /// Configuration of both transformers: one processes patches, the other the whole image.
    pub vit: VitConfig,
    /// Patch encoder blocks (0-based) whose output is tapped; only the first two are used.
    pub hook_ids: [usize; 4],
    /// Channels of the projected maps, finest first; the first applies to both tapped maps.
    pub encoder_dims: [usize; 4],
    /// True for overlapping patches (5×5 + 3×3 + 1), false for disjoint patches (4×4 + 2×2 + 1).
    pub use_patch_overlap: bool,
    /// Channels of the depth decoder, level by level.
    pub monodepth_dims_decoder: [usize; 5],
    /// Channels of the Gaussian decoder, level by level.
    pub gaussian_dims_decoder: [usize; 5],
    /// Output channels of the texture and geometry heads.
    pub gaussian_dim_out: usize,
    /// Number of groups in the heads' normalisations.
    pub gaussian_norm_num_groups: usize,
    /// Channels of the alignment network's finest level.
    pub alignment_base_width: usize,
    /// Number of the alignment network's levels below the finest.
    pub alignment_steps: usize,
    /// Predicted depth that the alignment network receives. Weights trained with another setting
    /// are refused.
    #[serde(default, skip_serializing_if = "AlignmentInput::is_default")]
    pub alignment_input: AlignmentInput,
    /// Side to which every image is resized, four times the transformers' input.
    pub internal_resolution: usize,
    /// Side in pixels of the block that one Gaussian covers: 2 gives the paper's 2×768² Gaussians, 4 its 2×384², 8 its
    /// 2×192². The skip convolution's kernel has this size, so weights trained with another stride are refused.
    #[serde(default = "release_stride")]
    pub gaussian_stride: usize,
}

fn release_stride() -> usize {
    2
}

fn release_norm_eps() -> f32 {
    1e-6
}

impl Default for ModelConfig {
    fn default() -> Self {
        Self::release()
    }
}

impl ModelConfig {
    /// The official release: 702 305 169 parameters.
    pub fn release() -> Self {
        Self {
            preset: "release".into(),
            vit: VitConfig {
                in_chans: 3,
                embed_dim: 1024,
                depth: 24,
                num_heads: 16,
                init_values: 1e-5,
                img_size: 384,
                patch_size: 16,
                norm_eps: release_norm_eps(),
                num_classes: 21841,
                global_pool: String::new(),
            },
            hook_ids: [5, 11, 17, 23],
            encoder_dims: [256, 512, 1024, 1024],
            use_patch_overlap: true,
            monodepth_dims_decoder: [256; 5],
            gaussian_dims_decoder: [128; 5],
            gaussian_dim_out: 32,
            gaussian_norm_num_groups: 8,
            alignment_base_width: 16,
            alignment_steps: 4,
            alignment_input: AlignmentInput::FirstLayer,
            internal_resolution: 1536,
            gaussian_stride: release_stride(),
        }
    }

    /// Reads `FILE` or `FILE#NAME`: a JSON object with the fields of this type, or an object of named configurations.
    /// `NAME` selects one of these; it may be omitted if there is only one.
    ///
    /// # Errors
    /// [`ModelError::File`] if the file cannot be read or does not contain the requested
    /// configuration; [`ModelError::Config`] if the configuration describes an impossible network.
    pub fn load(file_and_name: &str) -> Result<Self, ModelError> {
        let (file, name) = match file_and_name.rsplit_once('#') {
            Some((file, name)) => (file, Some(name)),
            None => (file_and_name, None),
        };
        let path = Path::new(file);
        let text = crate::files::read_text(path).map_err(|e| ModelError::file(path, e))?;
        let config = Self::parse(&text, name).map_err(|reason| ModelError::file(path, reason))?;
        config.validate()?;
        Ok(config)
    }

    /// All configurations in a file that [`Self::load`] accepts, with their names (an unnamed
    /// configuration has an empty name). Empty for any other file.
    pub fn all_of(path: &Path) -> Vec<(String, Self)> {
        let Ok(text) = crate::files::read_text(path) else {
            return Vec::new();
        };
        let Ok(serde_json::Value::Object(entries)) = serde_json::from_str(&text) else {
            return Vec::new();
        };
        let names: Vec<Option<&str>> = if entries.contains_key("vit") {
            vec![None]
        } else {
            entries.keys().map(|name| Some(name.as_str())).collect()
        };
        let read = |name: Option<&str>| {
            let config = Self::parse(&text, name).ok()?;
            config.validate().ok()?;
            Some((name.unwrap_or_default().to_owned(), config))
        };
        names.into_iter().filter_map(read).collect()
    }

    fn parse(text: &str, name: Option<&str>) -> Result<Self, String> {
        use serde_json::Value;
        let whole: Value = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let Value::Object(entries) = &whole else {
            return Err("not a JSON object".into());
        };
        let chosen = match name {
            Some(name) => entries.get(name),
            None if entries.contains_key("vit") => Some(&whole),
            None if entries.len() == 1 => entries.values().next(),
            None => None,
        };
        let chosen = chosen.ok_or_else(|| {
            let names: Vec<&str> = entries.keys().map(String::as_str).collect();
            match name {
                Some(name) => format!("no configuration `{name}`, only {}", names.join(", ")),
                None => format!("several configurations; select one: {}", names.join(", ")),
            }
        })?;
        serde_json::from_value(chosen.clone()).map_err(|e| e.to_string())
    }

    /// Checks that the sizes are consistent.
    ///
    /// # Errors
    /// [`ModelError::Config`] with the first inconsistency.
    pub fn validate(&self) -> Result<(), ModelError> {
        let vit = &self.vit;
        let sizes = [
            vit.embed_dim,
            vit.depth,
            vit.num_heads,
            vit.img_size,
            vit.patch_size,
            vit.num_classes,
            self.gaussian_dim_out,
            self.gaussian_norm_num_groups,
            self.alignment_base_width,
            self.alignment_steps,
            self.internal_resolution,
            self.gaussian_stride,
        ];
        let lists = [
            &self.encoder_dims[..],
            &self.monodepth_dims_decoder,
            &self.gaussian_dims_decoder,
        ];
        let every = [&sizes[..], &lists.concat()].concat();
        let groups = self.gaussian_norm_num_groups.max(1);
        let heads_width = self.gaussian_dims_decoder[0];
        let resolution = self.internal_resolution;
        let checks = [
            (
                every.iter().all(|v| (1..=1 << 16).contains(v)),
                "a size is 0 or beyond 65536",
            ),
            (vit.in_chans == 3, "`vit.in_chans` is not 3"),
            (
                vit.norm_eps > 0.0 && vit.norm_eps <= 1.0,
                "`vit.norm_eps` is not a small positive number",
            ),
            (
                vit.depth <= 256 && self.alignment_steps <= 8,
                "too many blocks or steps",
            ),
            (
                vit.embed_dim.is_multiple_of(vit.num_heads),
                "`vit.embed_dim` is not a multiple of `vit.num_heads`",
            ),
            (
                vit.img_size.is_multiple_of(vit.patch_size),
                "`vit.img_size` is not a multiple of `vit.patch_size`",
            ),
            (
                resolution == 4 * vit.img_size,
                "`internal_resolution` is not four times `vit.img_size`",
            ),
            (
                self.hook_ids.iter().all(|&k| k < vit.depth) && self.hook_ids.is_sorted(),
                "`hook_ids` are not ascending block numbers",
            ),
            (
                !self.use_patch_overlap || vit.tokens_per_side().is_multiple_of(8),
                "overlapping patches need a token grid divisible by eight",
            ),
            (
                self.monodepth_dims_decoder
                    .iter()
                    .all(|d| *d == self.monodepth_dims_decoder[0])
                    && self.gaussian_dims_decoder.iter().all(|d| *d == heads_width),
                "a decoder's levels differ in width",
            ),
            (
                self.monodepth_dims_decoder[0].is_multiple_of(2),
                "`monodepth_dims_decoder` is odd",
            ),
            (
                heads_width.is_multiple_of(2 * groups),
                "`gaussian_norm_num_groups` does not divide half of `gaussian_dims_decoder`",
            ),
            (
                (self.alignment_base_width / 2).is_multiple_of(4)
                    && resolution.is_multiple_of(1 << self.alignment_steps.min(16)),
                "`alignment_base_width` is not a multiple of 8, or there are too many \
                 `alignment_steps` for the resolution",
            ),
            (
                [2, 4, 8].contains(&self.gaussian_stride)
                    && resolution.is_multiple_of(self.gaussian_stride),
                "`gaussian_stride` is not 2, 4 or 8",
            ),
        ];
        match checks.iter().find(|(holds, _)| !holds) {
            Some((_, reason)) => Err(ModelError::Config(format!("`{}`: {reason}", self.preset))),
            None => Ok(()),
        }
    }

    /// Dimensions of the grids of image, depth and Gaussians.
    pub fn grid(&self) -> Grid {
        Grid {
            layers: LAYERS,
            width: self.internal_resolution,
            height: self.internal_resolution,
            stride: self.gaussian_stride,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/golden/model/tiny_config.json"
    );

    #[test]
    fn presets_are_valid() {
        ModelConfig::release().validate().unwrap();
        let tiny = ModelConfig::load(&format!("{FILE}#tiny")).unwrap();
        assert_eq!(tiny.internal_resolution, 192);
        assert_eq!((tiny.gaussian_stride, tiny.vit.norm_eps), (2, 1e-6));
        assert!(
            ModelConfig::load(&format!("{FILE}#narrow"))
                .unwrap()
                .use_patch_overlap
        );
    }

    #[test]
    fn names_are_asked_for_and_checked() {
        let message = ModelConfig::load(FILE).unwrap_err().to_string();
        assert!(message.contains("tiny, narrow"), "{message}");
        let message = ModelConfig::load(&format!("{FILE}#huge"))
            .unwrap_err()
            .to_string();
        assert!(message.contains("no configuration `huge`"), "{message}");
        assert!(
            ModelConfig::load("absent.json#x")
                .unwrap_err()
                .to_string()
                .contains("absent.json")
        );
    }

    #[test]
    fn impossible_networks_are_named() {
        type Change = fn(&mut ModelConfig);
        let broken: [(Change, &str); 8] = [
            (|c| c.vit.norm_eps = 0.0, "norm_eps"),
            (|c| c.vit.norm_eps = f32::NAN, "norm_eps"),
            (|c| c.vit.num_heads = 0, "a size is 0"),
            (|c| c.vit.num_heads = 7, "num_heads"),
            (|c| c.internal_resolution = 1024, "internal_resolution"),
            (|c| c.gaussian_stride = 3, "gaussian_stride"),
            (|c| c.hook_ids = [5, 11, 17, 24], "hook_ids"),
            (|c| c.encoder_dims[1] = usize::MAX, "beyond 65536"),
        ];
        for (change, expected) in broken {
            let mut config = ModelConfig::release();
            change(&mut config);
            let message = config.validate().unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn a_single_configuration_survives_a_round_trip() {
        let text = serde_json::to_string(&ModelConfig::release()).unwrap();
        assert_eq!(
            ModelConfig::parse(&text, None).unwrap(),
            ModelConfig::release()
        );
    }

    #[test]
    fn a_later_key_leaves_files_and_hashes_of_earlier_programs_as_they_are() {
        let mut config = ModelConfig::release();
        let text = serde_json::to_string(&config).unwrap();
        assert!(!text.contains("alignment_input"), "{text}");
        assert_eq!(
            config_sha256(&config),
            "b489d9c32a980fce380c87860d67a7d9b4e22d6be65916c2d53bd2549dcd5611"
        );
        config.alignment_input = AlignmentInput::BothLayers;
        let both = serde_json::to_string(&config).unwrap();
        assert!(
            both.contains(r#""alignment_input":"both_layers""#),
            "{both}"
        );
        assert_eq!(ModelConfig::parse(&both, None).unwrap(), config);
        assert_ne!(
            config_sha256(&config),
            config_sha256(&ModelConfig::release())
        );
    }
}
