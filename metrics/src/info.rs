//! Description of a metric column, shared by tables, manifests, help and papers.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::identity::{Family, LpipsNet, LpipsVariant, Metric, MetricKey, MetricRegion};
use crate::ssim::SsimVariant;
use crate::weights::{Backbone, WeightsSource, WeightsUsed};

/// All properties of one metric column as separate fields, so that none has to be parsed from a sentence.
///
/// In JSON, fields are in this order. `backbone` and `own_weights` are absent for PSNR and SSIM; each field of the
/// backbone except its name is absent if unknown:
/// ```json
/// {
///   "key": "lpips[vgg,v0.1]@mask",
///   "alias": "lpips-vgg@mask",
///   "family": "lpips",
///   "region": "mask",
///   "label": "LPIPS vgg in mask",
///   "unit": "",
///   "direction": "lower",
///   "decimals": 3,
///   "convention": "Learned perceptual distance, version 0.1: …",
///   "input_range": "-1..1",
///   "resize": "none",
///   "precision": "features f32, everything after them f64",
///   "backbone": {
///     "name": "vgg16",
///     "features_sha256": "…",
///     "file_sha256": "…",
///     "deterministic": "…"
///   },
///   "own_weights": {
///     "package": "lpips 0.1.4",
///     "file": "weights/v0.1/vgg.pth",
///     "sha256": "a78928a0…"
///   }
/// }
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct MetricInfo {
    /// Key of the metric; columns with equal keys contain comparable numbers.
    #[schemars(with = "String")]
    pub key: MetricKey,
    /// Key without brackets; see [`MetricKey::alias`].
    pub alias: String,
    #[schemars(with = "String")]
    pub family: Family,
    /// The pixels that are evaluated.
    #[schemars(with = "String")]
    pub region: MetricRegion,
    /// Short name for tables and plots; see [`MetricKey::label`].
    pub label: String,
    /// Unit: `dB` for PSNR, empty for the other metrics.
    pub unit: String,
    pub direction: Direction,
    /// Number of decimals shown in tables.
    pub decimals: usize,
    /// A few sentences on how the number is computed, and on public code that computes the same.
    pub convention: String,
    /// Range of values on which the metric operates.
    pub input_range: String,
    /// Resizing applied to the pictures.
    pub resize: String,
    pub precision: String,
    /// The network whose features the metric compares.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backbone: Option<BackboneInfo>,
    /// The metric's own learned weights, which are included in the crate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_weights: Option<OwnWeights>,
}

/// Which values of a metric are better: `higher` or `lower` in JSON.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    Higher,
    Lower,
}

/// The network behind a learned metric, and its weights if available.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct BackboneInfo {
    #[schemars(with = "String")]
    pub name: Backbone,
    /// SHA-256 over the convolutions' names and values: the same for a full file and a features-only copy. `None`
    /// without weights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub features_sha256: Option<String>,
    /// SHA-256 of the file in which the weights were published.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file_sha256: Option<String>,
    /// Salt of weights that are not read from a file; see [`Weights::deterministic`](crate::Weights::deterministic).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deterministic: Option<String>,
}

/// Learned weights of the metric itself, as published by its authors.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct OwnWeights {
    /// Package on the Python Package Index, with its version.
    pub package: String,
    /// File in the package.
    pub file: String,
    /// SHA-256 of the published file; this crate contains the same values.
    pub sha256: String,
}

impl MetricInfo {
    /// Describes the metric of a key; includes the weights of its network if `used` contains them.
    pub fn new(key: MetricKey, used: &[WeightsUsed]) -> Self {
        const NETWORK: &str = "features f32, everything after them f64";
        let metric = key.metric();
        let (input_range, precision) = match metric {
            Metric::Psnr | Metric::PsnrFloored => {
                ("0..1", "exact integers for 8-bit pictures, else f64")
            }
            Metric::Ssim(variant) if variant.form().range_of_data => {
                ("0..1, constants scaled by the pictures' own range", "f64")
            }
            Metric::Ssim(_) => ("0..1", "f64"),
            Metric::Lpips(_, LpipsVariant::Unscaled) => {
                ("0..1, passed on as if it were -1..1", NETWORK)
            }
            Metric::Lpips(..) => ("-1..1", NETWORK),
            Metric::Dists | Metric::DistsResize256 => ("0..1", NETWORK),
        };
        let resize = match metric {
            Metric::DistsResize256 => {
                "shorter side reduced to 256 where it is larger (bilinear with antialiasing on 8 bit, as PIL)"
            }
            _ => "none",
        };
        let (unit, direction, decimals) = match key.family() {
            Family::Psnr => ("dB", Direction::Higher, 2),
            Family::Ssim => ("", Direction::Higher, 3),
            Family::Lpips | Family::Dists => ("", Direction::Lower, 3),
        };
        let backbone = Backbone::of(metric).map(|name| BackboneInfo::new(name, used));
        let unpublished = backbone.as_ref().is_some_and(BackboneInfo::is_unpublished);
        Self {
            key,
            alias: key.alias(),
            family: key.family(),
            region: key.region(),
            label: key.label(),
            unit: unit.to_owned(),
            direction,
            decimals,
            convention: convention(key, unpublished),
            input_range: input_range.to_owned(),
            resize: resize.to_owned(),
            precision: precision.to_owned(),
            backbone,
            own_weights: own_weights(metric),
        }
    }
}

/// Convention, ranges and weights as sentences.
impl fmt::Display for MetricInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (range, resize) = (&self.input_range, &self.resize);
        write!(
            f,
            "{} Input range {range}; resizing: {resize}; {}.",
            self.convention, self.precision
        )?;
        if let Some(own) = &self.own_weights {
            write!(f, " {} {} sha256 {}.", own.package, own.file, own.sha256)?;
        }
        match &self.backbone {
            Some(backbone) => write!(f, " Weights: {backbone}."),
            None => Ok(()),
        }
    }
}

impl BackboneInfo {
    fn new(name: Backbone, used: &[WeightsUsed]) -> Self {
        let used = used.iter().find(|used| used.backbone == name);
        let salt = |used: &WeightsUsed| match &used.source {
            WeightsSource::Deterministic(salt) => Some(salt.clone()),
            WeightsSource::File(_) | WeightsSource::BuiltIn => None,
        };
        Self {
            name,
            features_sha256: used.map(|used| used.features_sha256.clone()),
            file_sha256: used.and_then(|used| used.original_sha256.clone()),
            deterministic: used.and_then(salt),
        }
    }

    /// True if the features differ from the published ones, so that values are not comparable with published numbers;
    /// false without weights.
    pub fn is_unpublished(&self) -> bool {
        let found = self.features_sha256.as_deref();
        found.is_some_and(|sha256| sha256 != self.name.published_features())
    }
}

/// `vgg16=<features_sha256>`, or `vgg16=absent` without weights.
impl fmt::Display for BackboneInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hash = self.features_sha256.as_deref().unwrap_or("absent");
        write!(f, "{}={hash}", self.name)
    }
}

fn own_weights(metric: Metric) -> Option<OwnWeights> {
    let (package, file, sha256) = match metric {
        Metric::Psnr | Metric::PsnrFloored | Metric::Ssim(_) => return None,
        Metric::Lpips(LpipsNet::Alex, _) => (
            "lpips 0.1.4",
            "weights/v0.1/alex.pth",
            "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0",
        ),
        Metric::Lpips(LpipsNet::Vgg, _) => (
            "lpips 0.1.4",
            "weights/v0.1/vgg.pth",
            "a78928a0af1e5f0fcb1f3b9e8f8c3a2a5a3de244d830ad5c1feddc79b8432868",
        ),
        Metric::Lpips(LpipsNet::Squeeze, _) => (
            "lpips 0.1.4",
            "weights/v0.1/squeeze.pth",
            "4a5350f23600cb79923ce65bb07cbf57dca461329894153e05a1346bd531cf76",
        ),
        Metric::Dists | Metric::DistsResize256 => (
            "DISTS-pytorch 0.1",
            "weights.pt",
            "f5e65c96230b7f6ca995691647d482237e4cab8a50c5c4a5784f219ef0748218",
        ),
    };
    Some(OwnWeights {
        package: package.to_owned(),
        file: file.to_owned(),
        sha256: sha256.to_owned(),
    })
}

/// Sentences on how a metric is computed. Equivalent public code is only mentioned for the published features.
fn convention(key: MetricKey, unpublished: bool) -> String {
    let same = |text: &'static str| if unpublished { UNPUBLISHED } else { text };
    let base = match key.metric() {
        Metric::Psnr => PSNR.to_owned(),
        Metric::PsnrFloored => format!("{PSNR} {PSNR_FLOOR}"),
        Metric::Ssim(variant) => format!("{SSIM} {}", ssim(variant)),
        Metric::Lpips(net, variant) => {
            let (how, as_whom) = lpips_variant(variant);
            format!("{LPIPS} {} {how} {}", lpips_net(net), same(as_whom))
        }
        Metric::Dists => format!("{DISTS} {DISTS_FULL} {}", same(DISTS_FULL_SAME)),
        Metric::DistsResize256 => format!("{DISTS} {DISTS_256} {}", same(DISTS_256_SAME)),
    };
    let mask = match key.region() {
        MetricRegion::Whole => return base,
        MetricRegion::Frustum => "the view-frustum mask",
        MetricRegion::Given => {
            "the mask that was handed in (levels of 128 and more); in a run, the protocol's or \
             that of the pixels which the dataset does not exclude"
        }
    };
    let masked = match key.metric() {
        Metric::Psnr | Metric::PsnrFloored => {
            format!("Only pixels inside {mask} enter the mean squared error.")
        }
        Metric::Ssim(SsimVariant::Gauss11ValidWholeWindow) => {
            format!("The mean of the SSIM map over the windows that lie inside {mask} as a whole.")
        }
        Metric::Lpips(_, LpipsVariant::BoxPaste | LpipsVariant::LayerMask) => {
            format!("The mask is {mask}.")
        }
        Metric::Ssim(_) => format!(
            "The mean of the SSIM map over the window centres inside {mask}; windows may reach out \
             of the mask."
        ),
        _ => format!(
            "The mean of the spatial map (each layer's distances brought to the picture's size \
             bilinearly, then added) over the pixels inside {mask}; features see beyond its \
             border. Over a full mask this is close to, but not equal to, the unmasked value."
        ),
    };
    format!("{base} {masked}")
}

const PSNR: &str = "-10 log10 of the mean squared error over all pixels and channels of one \
     picture with values in 0..1, in dB; identical pictures give inf. Averages are means over \
     pictures. Same as scikit-image's peak_signal_noise_ratio on 8-bit pictures, the 3D Gaussian \
     Splatting and nerfbaselines evaluations, and OpenCV's PSNR. Not the same as torchmetrics' \
     PeakSignalNoiseRatio object, which pools the squared error over pictures.";

const PSNR_FLOOR: &str = "The mean squared error is at least 1e-8, so that the value is at most \
     80 dB and that of identical pictures too: what UniSHARP's evaluation computes.";

const SSIM: &str = "Mean structural similarity with K1 0.01 and K2 0.03, in f64, averaged over \
     pixels and channels.";

fn ssim(variant: SsimVariant) -> &'static str {
    match variant {
        SsimVariant::Gauss11Valid => {
            "Gaussian window of 11 taps (sigma 1.5), only windows that lie inside the picture, \
             population covariance, range 1. Same as scikit-image with gaussian_weights=True, \
             sigma=1.5, use_sample_covariance=False, pytorch-msssim, kornia with padding='valid', \
             fused-ssim with padding='valid', torchmetrics before September 2024, and dm_pix as \
             used by mip-NeRF and nerfbaselines."
        }
        SsimVariant::Gauss11Zero => {
            "Gaussian window of 11 taps (sigma 1.5), the picture continued by zeros so that every \
             pixel counts, population covariance, range 1. Same as the loss and the metrics \
             script of 3D Gaussian Splatting and of most work derived from it."
        }
        SsimVariant::Gauss11Reflect => {
            "Gaussian window of 11 taps (sigma 1.5), the picture mirrored without repeating its \
             edge so that every pixel counts, population covariance, range 1. Same as kornia's \
             default, OpenCV's quality module, and torchmetrics since September 2024 with \
             data_range=1."
        }
        SsimVariant::Uniform7Sample => {
            "Box window of 7x7, only windows that lie inside the picture, sample covariance \
             (49/48), range 1. Same as scikit-image's default with channel_axis and data_range \
             given, which classic NeRF repositories use."
        }
        SsimVariant::Uniform7Population => {
            "Box window of 7x7, only windows that lie inside the picture, population covariance, \
             range 1. Same as scikit-image with use_sample_covariance=False."
        }
        SsimVariant::Gauss11ValidSample => {
            "Gaussian window of 11 taps (sigma 1.5), only windows that lie inside the picture, \
             sample covariance (121/120), range 1. Same as scikit-image with \
             gaussian_weights=True, sigma=1.5 and the covariance left at its default."
        }
        SsimVariant::Gauss11ValidGray => {
            "On luma 0.299 R + 0.587 G + 0.114 B in floating point: Gaussian window of 11 taps \
             (sigma 1.5), only windows that lie inside the picture, population covariance, \
             range 1. Same as scikit-image on such a gray picture with gaussian_weights=True, \
             sigma=1.5, use_sample_covariance=False."
        }
        SsimVariant::Gauss11ReflectDataRange => {
            "As ssim[gauss11,reflect], but the range is the larger of the two pictures' maximum \
             minus minimum. Same as torchmetrics since September 2024 without data_range, which \
             is how nerfstudio calls it. Undefined for two constant pictures."
        }
        SsimVariant::Gauss11ValidDataRange => {
            "As ssim[gauss11,valid], but the range is the larger of the two pictures' maximum \
             minus minimum. Same as torchmetrics before September 2024 without data_range, which \
             is how nerfstudio called it. Undefined for two constant pictures."
        }
        SsimVariant::Gauss11ValidBounded => {
            "As ssim[gauss11,valid], with variances of at least 1.4e-14 and covariances of at most \
             the geometric mean of the variances. Same as dm_pix, multinerf and nerfbaselines. In \
             exact arithmetic the bound never acts, and here the value lies within 1e-9 of that of \
             ssim[gauss11,valid]; dm_pix in f32 may lie further off."
        }
        SsimVariant::Gauss11ZeroGuarded => {
            "As ssim[gauss11,zero], with 1e-8 added to the denominator, which is 9e-8 where both \
             pictures are black: such areas have 0.9 even if equal. Same as UniSHARP's evaluation."
        }
        SsimVariant::Gauss11ValidWholeWindow => {
            "As ssim[gauss11,valid], inside a mask only. Same as the masked form of ScanNet++'s \
             toolbox."
        }
    }
}

const LPIPS: &str = "Learned perceptual distance, version 0.1: features normalised over channels \
     at each position, squared differences weighted per channel, mean over positions, sum over \
     layers, at the picture's own resolution.";

fn lpips_net(net: LpipsNet) -> &'static str {
    match net {
        LpipsNet::Alex => "Features of torchvision's AlexNet, five layers; sides of 31 or more.",
        LpipsNet::Vgg => {
            "Features of torchvision's VGG16 without batch normalisation, five layers; sides of \
             16 or more."
        }
        LpipsNet::Squeeze => {
            "Features of torchvision's SqueezeNet 1.1, seven layers; sides of 17 or more."
        }
    }
}

/// Description of a variant, and public code that computes the same.
fn lpips_variant(variant: LpipsVariant) -> (&'static str, &'static str) {
    match variant {
        LpipsVariant::Official => (
            "Pictures scaled to -1..1, 1e-10 added to the norm.",
            "Same as lpips.LPIPS(version='0.1') on tensors in -1..1, pyiqa, and torchmetrics up to \
             version 1.1 with normalize=True for pictures in 0..1.",
        ),
        LpipsVariant::Unscaled => (
            "Pictures in 0..1 are passed to a network that expects -1..1, which makes differences \
             look smaller.",
            "With VGG16 the same as the metrics script of 3D Gaussian Splatting and torchmetrics \
             with net_type='vgg' and normalize=False on pictures in 0..1, as gsplat calls it; with \
             AlexNet up to torchmetrics' place of epsilon what nerfstudio's surface models report.",
        ),
        LpipsVariant::BoxPaste => (
            "Computed over the smallest box around the mask, in which the prediction is replaced \
             by the target wherever the mask is not; pictures scaled to -1..1, 1e-10 added to the \
             norm.",
            "Same as UniSHARP's masked evaluation where it has the package lpips.",
        ),
        LpipsVariant::LayerMask => (
            "At each layer the mean over the positions that no pixel outside the mask has reached: \
             squares of 5, 5, 7, 7 and 7 positions have to lie inside, and four positions make one \
             of the next layer only together; beyond the picture's border all is inside. Pictures \
             scaled to -1..1, 1e-8 added to the norm.",
            "Same as the masked form of ScanNet++'s toolbox.",
        ),
        LpipsVariant::TorchmetricsEps => (
            "Pictures scaled to -1..1, 1e-8 added to the squared norm before the root.",
            "Same as torchmetrics since version 1.2 with normalize=True on pictures in 0..1.",
        ),
    }
}

const UNPUBLISHED: &str = "Computed on features that are not those torchvision published: comparable \
     only with values on the same weights.";

const DISTS: &str = "Deep image structure and texture similarity on torchvision's VGG16 with L2 \
     pooling, pictures in 0..1: per channel, means (structure) and covariance (texture) over the \
     whole picture, weighted and subtracted from 1. Not clamped, so identical pictures may give a \
     tiny negative number.";
const DISTS_FULL: &str = "No resizing.";
const DISTS_FULL_SAME: &str = "Same as DISTS-pytorch's forward and its resize=False, pyiqa and \
     torchmetrics. Not the same as piq, which always shrinks inside.";
const DISTS_256: &str = "Pictures whose shorter side exceeds 256 are first reduced so that it is \
     256 (bilinear with antialiasing on 8-bit values, as PIL does).";
const DISTS_256_SAME: &str = "Same as the reference script's prepare_image with resize=True.";

/// Names of the terms into which [`Scorer::examine`](crate::Scorer::examine) splits a metric, in
/// order: the layers of the network, and for DISTS before them the picture itself. Empty for
/// metrics that are not split.
pub fn term_names(metric: Metric) -> &'static [&'static str] {
    match metric {
        Metric::Psnr | Metric::PsnrFloored | Metric::Ssim(_) => &[],
        Metric::Lpips(LpipsNet::Alex, _) => &["relu1", "relu2", "relu3", "relu4", "relu5"],
        Metric::Lpips(LpipsNet::Vgg, _) => &["relu1_2", "relu2_2", "relu3_3", "relu4_3", "relu5_3"],
        Metric::Lpips(LpipsNet::Squeeze, _) => &[
            "relu1", "fire3", "fire5", "fire6", "fire7", "fire8", "fire9",
        ],
        Metric::Dists | Metric::DistsResize256 => &[
            "picture", "relu1_2", "relu2_2", "relu3_3", "relu4_3", "relu5_3",
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backbone::architecture::tap_channels;
    use crate::{Scorer, Selection, Weights};

    #[test]
    fn every_learned_metric_names_its_weights_and_all_its_layers() {
        let regions = [MetricRegion::Whole, MetricRegion::Given];
        for key in regions.into_iter().flat_map(MetricKey::all_inside) {
            let info = MetricInfo::new(key, &[]);
            assert!(info.convention.len() > 80, "{key}");
            let names = term_names(key.metric());
            let Some(backbone) = info.backbone else {
                assert!(names.is_empty() && info.own_weights.is_none());
                continue;
            };
            let taps = tap_channels(backbone.name).len();
            let pictures = usize::from(names[0] == "picture");
            assert_eq!(names.len(), taps + pictures, "{key}");
            assert_eq!(info.own_weights.unwrap().sha256.len(), 64);
            assert_eq!(backbone.to_string(), format!("{}=absent", backbone.name));
        }
    }

    #[test]
    fn json_has_the_documented_shape_and_reads_back() {
        let selection = Selection::parse("psnr@frustum,lpips-squeeze,dists").unwrap();
        let scorer = Scorer::new(&selection, &Weights::deterministic("x")).unwrap();
        let infos = scorer.info();
        let json = serde_json::to_string(&infos).unwrap();
        assert_eq!(
            serde_json::from_str::<Vec<MetricInfo>>(&json).unwrap(),
            infos
        );
        let MetricInfo { convention, .. } = &infos[0];
        let psnr = format!(
            r#"[{{"key":"psnr@frustum","alias":"psnr@frustum","family":"psnr","region":"frustum","label":"PSNR in frustum","unit":"dB","direction":"higher","decimals":2,"convention":"{convention}","input_range":"0..1","resize":"none","precision":"exact integers for 8-bit pictures, else f64"}},"#
        );
        assert!(json.starts_with(&psnr), "{json}");
        let squeeze = infos[1].backbone.as_ref().unwrap();
        let hash = squeeze.features_sha256.as_deref().unwrap();
        let backbone = format!(
            r#""backbone":{{"name":"squeezenet1_1","features_sha256":"{hash}","deterministic":"x"}},"own_weights":{{"package":"lpips 0.1.4","file":"weights/v0.1/squeeze.pth","sha256":"4a5350f2"#
        );
        assert!(json.contains(&backbone), "{json}");
        let words = infos[1].to_string();
        assert!(
            words.ends_with(&format!("Weights: squeezenet1_1={hash}.")),
            "{words}"
        );
        assert!(json.contains(r#""direction":"lower","decimals":3"#));
    }
}
