//! Keys of metrics. Numbers that are computed in different ways have different keys.
//!
//! Under the name SSIM alone, public code computes at least eight different values. Numbers with
//! different keys never share a column.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::ssim::SsimVariant;

/// A metric family: variants of one idea whose values must not be mixed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Family {
    Psnr,
    Ssim,
    Lpips,
    Dists,
}

impl Family {
    pub const ALL: [Self; 4] = [Self::Psnr, Self::Ssim, Self::Lpips, Self::Dists];

    /// Lower-case name: `psnr`, `ssim`, `lpips`, `dists`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Psnr => "psnr",
            Self::Ssim => "ssim",
            Self::Lpips => "lpips",
            Self::Dists => "dists",
        }
    }
}

/// The network whose features an LPIPS compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LpipsNet {
    /// AlexNet, the default of most libraries.
    Alex,
    /// VGG16 without batch normalisation.
    Vgg,
    /// SqueezeNet 1.1.
    Squeeze,
}

impl LpipsNet {
    /// All networks, the default first.
    pub const ALL: [Self; 3] = [Self::Alex, Self::Vgg, Self::Squeeze];

    /// The name used in keys: `alex`, `vgg`, `squeeze`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Alex => "alex",
            Self::Vgg => "vgg",
            Self::Squeeze => "squeeze",
        }
    }
}

/// The input range and normalisation of LPIPS.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LpipsVariant {
    /// As published: pictures scaled to −1..1, ε = 1e-10 added to the norm.
    Official,
    /// Pictures left in 0..1, as in 3D Gaussian Splatting's evaluation (with VGG) and in nerfstudio's surface models
    /// (with AlexNet).
    Unscaled,
    /// ε = 1e-8 under the root, as in torchmetrics.
    TorchmetricsEps,
    /// UniSHARP's masked variant: outside the mask, the prediction is replaced by the target; the published LPIPS is
    /// then computed in the mask's bounding box.
    BoxPaste,
    /// The masked variant of ScanNet++'s toolbox: the mean of each layer covers only positions that no pixel outside
    /// the mask influences; ε = 1e-8 is added to the norm.
    LayerMask,
}

impl LpipsVariant {
    /// Suffix after the version in a key.
    fn suffix(self) -> &'static str {
        match self {
            Self::Official => "",
            Self::Unscaled => ",unscaled",
            Self::TorchmetricsEps => ",eps=tm",
            Self::BoxPaste => ",box-paste",
            Self::LayerMask => ",layer-mask",
        }
    }
}

/// A metric, without the region of pixels that it evaluates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Metric {
    /// Peak signal-to-noise ratio of one picture, in dB.
    Psnr,
    /// PSNR with a mean squared error of at least 1e-8, i.e. at most 80 dB.
    PsnrFloored,
    Ssim(SsimVariant),
    /// LPIPS with the linear weights of version 0.1.
    Lpips(LpipsNet, LpipsVariant),
    /// DISTS at full resolution.
    Dists,
    /// DISTS after reducing the shorter side to 256.
    DistsResize256,
}

impl Metric {
    /// Every metric, in unspecified order.
    fn all() -> Vec<Self> {
        use LpipsVariant::{BoxPaste, LayerMask, Official, TorchmetricsEps, Unscaled};
        let mut metrics = vec![Self::Psnr, Self::PsnrFloored];
        metrics.extend(SsimVariant::ALL.map(Self::Ssim));
        metrics.extend(LpipsNet::ALL.map(|net| Self::Lpips(net, Official)));
        metrics.extend(LpipsNet::ALL.map(|net| Self::Lpips(net, TorchmetricsEps)));
        metrics.extend([
            Self::Lpips(LpipsNet::Alex, Unscaled),
            Self::Lpips(LpipsNet::Vgg, Unscaled),
            Self::Lpips(LpipsNet::Alex, BoxPaste),
            Self::Lpips(LpipsNet::Vgg, LayerMask),
            Self::Dists,
            Self::DistsResize256,
        ]);
        metrics
    }

    /// True if the metric is only defined with a mask.
    fn needs_mask(self) -> bool {
        match self {
            Self::Ssim(variant) => variant == SsimVariant::Gauss11ValidWholeWindow,
            Self::Lpips(_, variant) => {
                matches!(variant, LpipsVariant::BoxPaste | LpipsVariant::LayerMask)
            }
            _ => false,
        }
    }
}

/// The pixels that are scored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MetricRegion {
    Whole,
    /// Pixels inside the view-frustum mask of a pair of views: suffix `@frustum`.
    Frustum,
    /// Pixels inside a mask given by the caller, or by a run's dataset or protocol: suffix `@mask`.
    #[serde(rename = "mask")]
    Given,
}

impl MetricRegion {
    pub const ALL: [Self; 3] = [Self::Whole, Self::Frustum, Self::Given];

    /// Suffix of keys: empty, `@frustum` or `@mask`.
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Whole => "",
            Self::Frustum => "@frustum",
            Self::Given => "@mask",
        }
    }

    /// Splits off a region's suffix; returns the text before it and the region.
    pub(crate) fn split(text: &str) -> (&str, Self) {
        for region in [Self::Frustum, Self::Given] {
            if let Some(base) = text.strip_suffix(region.suffix()) {
                return (base, region);
            }
        }
        (text, Self::Whole)
    }
}

/// Identifies one number: a metric with everything that affects its value.
///
/// `Display` gives the canonical key, such as `ssim[gauss11,valid]` or
/// `lpips[vgg,v0.1,unscaled]@frustum`; `FromStr` accepts the canonical key and the
/// [`alias`](Self::alias). Ordered by region, then as in the table of keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct MetricKey {
    region: MetricRegion,
    metric: Metric,
}

/// Errors of parsing a key.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum IdentityError {
    #[error(
        "unknown metric '{name}'; {}known keys (lpips-vgg is short for lpips[vgg,v0.1]): {}; only with a mask: {}",
        meant(name), listed(&MetricKey::all()), listed(&MetricKey::with_mask_only())
    )]
    Unknown { name: String },
    #[error(
        "'{name}': LPIPS v0.0 is refused; it leaves out the channel scaling of the input and was \
         withdrawn by its authors in favour of v0.1, so no published value can be compared with it"
    )]
    LpipsVersion0 { name: String },
    #[error("'{name}' requires a mask; use '{name}@mask' or '{name}@frustum'")]
    NeedsMask { name: String },
    #[error(
        "'{name}' is the same as 'psnr': pictures are already in 0..1 when scored, so clipping has \
         no effect"
    )]
    ClippedPsnr { name: String },
    #[error(
        "'{name}' is refused: LPIPS under autocast to bfloat16 keeps 8 bits of each feature and depends on which \
         layers the framework's version casts, so its values cannot be reproduced; compare with 'lpips[vgg,v0.1]' \
         and expect differences in the third decimal"
    )]
    Bfloat16 { name: String },
    #[error(
        "'{name}': DISTS has no masked form; it compares moments over the whole picture, not a \
         map of local values"
    )]
    MaskedDists { name: String },
}

/// The suggestion `did you mean …?` for a mistyped key; empty if no known key is similar.
fn meant(name: &str) -> String {
    let families = Family::ALL.map(|family| family.name().to_owned());
    let keys = MetricKey::all().into_iter();
    let names = keys
        .flat_map(|key| [key.to_string(), key.alias()])
        .chain(families);
    let near = names.map(|known| (strsim::jaro_winkler(name, &known), known));
    let near = near.filter(|(similarity, _)| *similarity > 0.8);
    let nearest = near.max_by(|one, other| one.0.total_cmp(&other.0));
    nearest.map_or_else(String::new, |(_, known)| {
        format!("did you mean '{known}'? ")
    })
}

fn listed(keys: &[MetricKey]) -> String {
    let names: Vec<_> = keys.iter().map(ToString::to_string).collect();
    names.join(" ")
}

impl MetricKey {
    /// PSNR over the whole picture.
    pub const PSNR: Self = Self::whole(Metric::Psnr);
    /// The default SSIM, `ssim[gauss11,valid]`.
    pub const SSIM: Self = Self::whole(Metric::Ssim(SsimVariant::Gauss11Valid));
    /// The default LPIPS, `lpips[alex,v0.1]`.
    pub const LPIPS: Self = Self::whole(Metric::Lpips(LpipsNet::Alex, LpipsVariant::Official));
    /// DISTS at full resolution.
    pub const DISTS: Self = Self::whole(Metric::Dists);

    /// The key of a metric over the whole picture.
    pub const fn whole(metric: Metric) -> Self {
        Self {
            region: MetricRegion::Whole,
            metric,
        }
    }

    /// The same metric over a region; `None` if the metric is undefined there: DISTS over a mask,
    /// or a mask-only metric over the whole picture.
    pub fn inside(self, region: MetricRegion) -> Option<Self> {
        let exists = match region {
            MetricRegion::Whole => !self.metric.needs_mask(),
            _ => self.family() != Family::Dists,
        };
        exists.then_some(Self {
            region,
            metric: self.metric,
        })
    }

    /// Every key over the whole picture, in order.
    pub fn all() -> Vec<Self> {
        Self::all_inside(MetricRegion::Whole)
    }

    /// Every key for a region, in order.
    pub fn all_inside(region: MetricRegion) -> Vec<Self> {
        let keys = Metric::all().into_iter().map(Self::whole);
        let mut keys: Vec<_> = keys.filter_map(|key| key.inside(region)).collect();
        keys.sort();
        keys
    }

    /// Every key that is possible with a given mask, including keys that exist only with a mask.
    fn with_mask_only() -> Vec<Self> {
        let mut keys = Self::all_inside(MetricRegion::Given);
        keys.retain(|key| key.metric.needs_mask());
        keys
    }

    pub fn metric(self) -> Metric {
        self.metric
    }

    /// The pixels that are evaluated.
    pub fn region(self) -> MetricRegion {
        self.region
    }

    /// True if only pixels inside a mask are evaluated.
    pub fn is_masked(self) -> bool {
        self.region != MetricRegion::Whole
    }

    pub fn family(self) -> Family {
        match self.metric {
            Metric::Psnr | Metric::PsnrFloored => Family::Psnr,
            Metric::Ssim(_) => Family::Ssim,
            Metric::Lpips(..) => Family::Lpips,
            Metric::Dists | Metric::DistsResize256 => Family::Dists,
        }
    }

    /// Short column heading that still distinguishes variants: `PSNR`, `SSIM gauss11 valid`, `LPIPS alex`, `DISTS`.
    pub fn label(self) -> String {
        let base = match self.metric {
            Metric::Psnr => "PSNR".to_owned(),
            Metric::PsnrFloored => "PSNR floor 1e-8".to_owned(),
            Metric::Ssim(variant) => format!("SSIM {}", variant.text().replace(',', " ")),
            Metric::Lpips(net, variant) => {
                format!("LPIPS {}{}", net.name(), variant.suffix().replace(',', " "))
            }
            Metric::Dists => "DISTS".to_owned(),
            Metric::DistsResize256 => "DISTS resize256".to_owned(),
        };
        let suffix = match self.region {
            MetricRegion::Whole => "",
            MetricRegion::Frustum => " in frustum",
            MetricRegion::Given => " in mask",
        };
        base + suffix
    }

    /// Key without brackets, for command lines and file names: `ssim-gauss11-valid`, `lpips-alex`, `lpips-vgg-eps-tm`,
    /// `dists-resize256`, `psnr@frustum`.
    pub fn alias(self) -> String {
        let base = self
            .canonical_base()
            .replace(",v0.1", "")
            .replace(['[', ',', '='], "-")
            .replace(']', "");
        base + self.region.suffix()
    }

    fn canonical_base(self) -> String {
        match self.metric {
            Metric::Psnr => "psnr".to_owned(),
            Metric::PsnrFloored => "psnr[floor=1e-8]".to_owned(),
            Metric::Ssim(variant) => format!("ssim[{}]", variant.text()),
            Metric::Lpips(net, variant) => {
                format!("lpips[{},v0.1{}]", net.name(), variant.suffix())
            }
            Metric::Dists => "dists".to_owned(),
            Metric::DistsResize256 => "dists[resize256]".to_owned(),
        }
    }
}

impl fmt::Display for MetricKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&(self.canonical_base() + self.region.suffix()))
    }
}

impl From<MetricKey> for String {
    fn from(key: MetricKey) -> Self {
        key.to_string()
    }
}

impl TryFrom<String> for MetricKey {
    type Error = IdentityError;

    fn try_from(text: String) -> Result<Self, IdentityError> {
        text.parse()
    }
}

impl FromStr for MetricKey {
    type Err = IdentityError;

    fn from_str(text: &str) -> Result<Self, IdentityError> {
        let name = || text.to_owned();
        let (base, region) = MetricRegion::split(text);
        if base.starts_with("lpips") && base.contains("v0.0") {
            return Err(IdentityError::LpipsVersion0 { name: name() });
        }
        if base.starts_with("lpips") && base.contains("bf16") {
            return Err(IdentityError::Bfloat16 { name: name() });
        }
        if ["psnr[clip]", "psnr-clip"].contains(&base) {
            return Err(IdentityError::ClippedPsnr { name: name() });
        }
        let default = match base {
            "ssim" => Some(Self::SSIM),
            "lpips" => Some(Self::LPIPS),
            _ => None,
        };
        let named = |key: &Self| key.canonical_base() == base || key.alias() == base;
        let all = || Metric::all().into_iter().map(Self::whole);
        let key = default
            .or_else(|| all().find(named))
            .ok_or_else(|| IdentityError::Unknown { name: name() })?;
        key.inside(region).ok_or_else(|| match region {
            MetricRegion::Whole => IdentityError::NeedsMask { name: name() },
            _ => IdentityError::MaskedDists { name: name() },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_those_of_the_table() {
        let keys: Vec<_> = MetricKey::all().iter().map(ToString::to_string).collect();
        assert_eq!(
            keys,
            [
                "psnr",
                "psnr[floor=1e-8]",
                "ssim[gauss11,valid]",
                "ssim[gauss11,zero]",
                "ssim[gauss11,reflect]",
                "ssim[uniform7,sample]",
                "ssim[uniform7,population]",
                "ssim[gauss11,valid,sample]",
                "ssim[gauss11,valid,gray]",
                "ssim[gauss11,reflect,range=data]",
                "ssim[gauss11,valid,range=data]",
                "ssim[gauss11,valid,cov=bounded]",
                "ssim[gauss11,zero,eps=1e-8]",
                "lpips[alex,v0.1]",
                "lpips[alex,v0.1,unscaled]",
                "lpips[alex,v0.1,eps=tm]",
                "lpips[vgg,v0.1]",
                "lpips[vgg,v0.1,unscaled]",
                "lpips[vgg,v0.1,eps=tm]",
                "lpips[squeeze,v0.1]",
                "lpips[squeeze,v0.1,eps=tm]",
                "dists",
                "dists[resize256]",
            ]
        );
    }

    #[test]
    fn every_name_reads_back_and_is_unique() {
        let mut names = std::collections::BTreeSet::new();
        for key in MetricRegion::ALL
            .into_iter()
            .flat_map(MetricKey::all_inside)
        {
            assert_eq!(key.to_string().parse::<MetricKey>(), Ok(key));
            assert_eq!(key.alias().parse::<MetricKey>(), Ok(key));
            assert!(names.insert(key.alias()), "{key}");
            assert!(!key.alias().contains(['[', ']', ',', '=']));
        }
        let masked: Vec<_> = MetricKey::with_mask_only()
            .iter()
            .map(|k| k.to_string())
            .collect();
        assert_eq!(
            masked,
            [
                "ssim[gauss11,valid,mask=window]@mask",
                "lpips[alex,v0.1,box-paste]@mask",
                "lpips[vgg,v0.1,layer-mask]@mask",
            ]
        );
        assert_eq!(MetricKey::LPIPS.alias(), "lpips-alex");
        assert_eq!(MetricKey::SSIM.alias(), "ssim-gauss11-valid");
        let inside = |region| MetricKey::PSNR.inside(region).unwrap().to_string();
        assert_eq!(inside(MetricRegion::Frustum), "psnr@frustum");
        assert_eq!(inside(MetricRegion::Given), "psnr@mask");
    }

    #[test]
    fn refusals_say_why() {
        let error = |text: &str| text.parse::<MetricKey>().unwrap_err().to_string();
        assert!(error("lpips[alex,v0.0]").contains("v0.0 is refused"));
        assert!(error("lpips-vgg-v0.0").contains("v0.0 is refused"));
        assert!(error("dists@frustum").contains("no masked form"));
        assert!(error("dists[resize256]@frustum").contains("no masked form"));
        assert!(error("dists@mask").contains("no masked form"));
        assert!(error("msssim").contains("unknown metric 'msssim'"));
        assert!(error("lpips[vgg,v0.1,bf16]").contains("autocast to bfloat16"));
        assert!(error("psnr[clip]").contains("is the same as 'psnr'"));
        for name in [
            "lpips[alex,v0.1,box-paste]",
            "lpips-vgg-layer-mask",
            "ssim[gauss11,valid,mask=window]",
        ] {
            assert!(error(name).contains(&format!("'{name}@mask'")), "{name}");
        }
    }

    #[test]
    fn headings_tell_variants_apart() {
        let labels: std::collections::BTreeSet<_> =
            MetricKey::all().into_iter().map(MetricKey::label).collect();
        assert_eq!(labels.len(), MetricKey::all().len());
        assert_eq!(MetricKey::PSNR.label(), "PSNR");
        assert_eq!(MetricKey::SSIM.label(), "SSIM gauss11 valid");
    }
}
