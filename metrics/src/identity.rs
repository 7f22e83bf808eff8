//! Keys of metrics: one for every number that must not be confused with another.
//!
//! Public code computes at least eight different values under the name SSIM alone. Two numbers of
//! different keys never share a column.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

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

    /// The lower-case name: `psnr`, `ssim`, `lpips`, `dists`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Psnr => "psnr",
            Self::Ssim => "ssim",
            Self::Lpips => "lpips",
            Self::Dists => "dists",
        }
    }
}

/// Window, border and covariance of an SSIM.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SsimVariant {
    /// Gaussian 11 taps, σ 1.5, only windows inside the picture, population covariance.
    Gauss11Valid,
    /// The same window over a picture continued by five zeros on each side.
    Gauss11Zero,
    /// The same window over a picture mirrored at its border without repeating the edge.
    Gauss11Reflect,
    /// 7×7 box, only windows inside the picture, sample covariance (factor 49/48).
    Uniform7Sample,
    /// 7×7 box, only windows inside the picture, population covariance.
    Uniform7Population,
    /// As [`Self::Gauss11Valid`] with sample covariance (factor 121/120).
    Gauss11ValidSample,
    /// As [`Self::Gauss11Valid`] on luma 0.299 R + 0.587 G + 0.114 B.
    Gauss11ValidGray,
    /// As [`Self::Gauss11Reflect`] with the data range taken from the pictures themselves.
    Gauss11ReflectDataRange,
}

impl SsimVariant {
    /// All variants, the default first.
    pub const ALL: [Self; 8] = [
        Self::Gauss11Valid,
        Self::Gauss11Zero,
        Self::Gauss11Reflect,
        Self::Uniform7Sample,
        Self::Uniform7Population,
        Self::Gauss11ValidSample,
        Self::Gauss11ValidGray,
        Self::Gauss11ReflectDataRange,
    ];

    /// What stands between the brackets of the key.
    fn text(self) -> &'static str {
        match self {
            Self::Gauss11Valid => "gauss11,valid",
            Self::Gauss11Zero => "gauss11,zero",
            Self::Gauss11Reflect => "gauss11,reflect",
            Self::Uniform7Sample => "uniform7,sample",
            Self::Uniform7Population => "uniform7,population",
            Self::Gauss11ValidSample => "gauss11,valid,sample",
            Self::Gauss11ValidGray => "gauss11,valid,gray",
            Self::Gauss11ReflectDataRange => "gauss11,reflect,range=data",
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

/// How an LPIPS treats its input and its normalisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LpipsVariant {
    /// As published: pictures scaled to −1..1, ε = 1e-10 added to the norm.
    Official,
    /// Pictures left in 0..1, as 3D Gaussian Splatting's evaluation does (with VGG only).
    Unscaled,
    /// ε = 1e-8 under the root, as torchmetrics does.
    TorchmetricsEps,
}

/// A metric, before the choice of the pixels that count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Metric {
    /// Peak signal-to-noise ratio of one picture, dB.
    Psnr,
    Ssim(SsimVariant),
    /// LPIPS with the linear weights of version 0.1.
    Lpips(LpipsNet, LpipsVariant),
    /// DISTS at the pictures' own resolution.
    Dists,
    /// DISTS after the shorter side was reduced to 256.
    DistsResize256,
}

/// Which pixels count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MetricRegion {
    Whole,
    /// Those inside the view-frustum mask of a pair of views: suffix `@frustum`.
    Frustum,
    /// Those inside a mask that was handed in: suffix `@mask`.
    #[serde(rename = "mask")]
    Given,
}

impl MetricRegion {
    pub const ALL: [Self; 3] = [Self::Whole, Self::Frustum, Self::Given];

    /// What keys end in: nothing, `@frustum` or `@mask`.
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Whole => "",
            Self::Frustum => "@frustum",
            Self::Given => "@mask",
        }
    }

    /// The text before a region's suffix, and the region.
    pub(crate) fn split(text: &str) -> (&str, Self) {
        for region in [Self::Frustum, Self::Given] {
            if let Some(base) = text.strip_suffix(region.suffix()) {
                return (base, region);
            }
        }
        (text, Self::Whole)
    }
}

/// Names one number: a metric with everything that changes its value.
///
/// `Display` gives the canonical key, such as `ssim[gauss11,valid]` or
/// `lpips[vgg,v0.1,unscaled]@frustum`; `FromStr` takes that and the [`alias`](Self::alias).
/// Ordered by region, then as in the table of keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct MetricKey {
    region: MetricRegion,
    metric: Metric,
}

/// Why a text is not a key.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum IdentityError {
    #[error(
        "unknown metric '{name}'; keys, each also without brackets (lpips-vgg): {}",
        MetricKey::all().iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
    )]
    Unknown { name: String },
    #[error(
        "'{name}': LPIPS v0.0 is refused; it leaves out the channel scaling of the input and was \
         withdrawn by its authors in favour of v0.1, so no published value can be compared with it"
    )]
    LpipsVersion0 { name: String },
    #[error(
        "'{name}': DISTS has no masked form; it compares moments over the whole picture, not a \
         map of local values"
    )]
    MaskedDists { name: String },
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

    /// The same metric over a region; `None` for DISTS, which has no masked form.
    pub fn inside(self, region: MetricRegion) -> Option<Self> {
        let whole = region == MetricRegion::Whole;
        (whole || self.family() != Family::Dists).then_some(Self {
            region,
            metric: self.metric,
        })
    }

    /// Every key over the whole picture, in order.
    pub fn all() -> Vec<Self> {
        let mut metrics = vec![Metric::Psnr];
        metrics.extend(SsimVariant::ALL.map(Metric::Ssim));
        metrics.extend(LpipsNet::ALL.map(|net| Metric::Lpips(net, LpipsVariant::Official)));
        metrics.push(Metric::Lpips(LpipsNet::Vgg, LpipsVariant::Unscaled));
        metrics.extend(LpipsNet::ALL.map(|net| Metric::Lpips(net, LpipsVariant::TorchmetricsEps)));
        metrics.extend([Metric::Dists, Metric::DistsResize256]);
        let mut keys: Vec<_> = metrics.into_iter().map(Self::whole).collect();
        keys.sort();
        keys
    }

    pub fn metric(self) -> Metric {
        self.metric
    }

    /// Which pixels count.
    pub fn region(self) -> MetricRegion {
        self.region
    }

    /// Whether only pixels inside a mask count.
    pub fn is_masked(self) -> bool {
        self.region != MetricRegion::Whole
    }

    pub fn family(self) -> Family {
        match self.metric {
            Metric::Psnr => Family::Psnr,
            Metric::Ssim(_) => Family::Ssim,
            Metric::Lpips(..) => Family::Lpips,
            Metric::Dists | Metric::DistsResize256 => Family::Dists,
        }
    }

    /// A short column heading that still tells variants apart: `PSNR`,
    /// `SSIM gauss11 valid`, `LPIPS alex`, `DISTS`.
    pub fn label(self) -> String {
        let base = match self.metric {
            Metric::Psnr => "PSNR".to_owned(),
            Metric::Ssim(variant) => format!("SSIM {}", variant.text().replace(',', " ")),
            Metric::Lpips(net, variant) => {
                let suffix = match variant {
                    LpipsVariant::Official => "",
                    LpipsVariant::Unscaled => " unscaled",
                    LpipsVariant::TorchmetricsEps => " eps=tm",
                };
                format!("LPIPS {}{suffix}", net.name())
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

    /// The key without brackets, for command lines and file names: `ssim-gauss11-valid`,
    /// `lpips-alex`, `lpips-vgg-eps-tm`, `dists-resize256`, `psnr@frustum`.
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
            Metric::Ssim(variant) => format!("ssim[{}]", variant.text()),
            Metric::Lpips(net, variant) => {
                let suffix = match variant {
                    LpipsVariant::Official => "",
                    LpipsVariant::Unscaled => ",unscaled",
                    LpipsVariant::TorchmetricsEps => ",eps=tm",
                };
                format!("lpips[{},v0.1{suffix}]", net.name())
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
        let default = match base {
            "ssim" => Some(Self::SSIM),
            "lpips" => Some(Self::LPIPS),
            _ => None,
        };
        let named = |key: &Self| key.canonical_base() == base || key.alias() == base;
        let key = default
            .or_else(|| Self::all().into_iter().find(named))
            .ok_or_else(|| IdentityError::Unknown { name: name() })?;
        key.inside(region)
            .ok_or_else(|| IdentityError::MaskedDists { name: name() })
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
                "ssim[gauss11,valid]",
                "ssim[gauss11,zero]",
                "ssim[gauss11,reflect]",
                "ssim[uniform7,sample]",
                "ssim[uniform7,population]",
                "ssim[gauss11,valid,sample]",
                "ssim[gauss11,valid,gray]",
                "ssim[gauss11,reflect,range=data]",
                "lpips[alex,v0.1]",
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
        for key in MetricKey::all() {
            for key in MetricRegion::ALL.into_iter().filter_map(|r| key.inside(r)) {
                assert_eq!(key.to_string().parse::<MetricKey>(), Ok(key));
                assert_eq!(key.alias().parse::<MetricKey>(), Ok(key));
                assert!(names.insert(key.alias()), "{key}");
                assert!(!key.alias().contains(['[', ']', ',', '=']));
            }
        }
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
