//! Which metrics these are, as a paper should say it: a paragraph of LaTeX and the references that it cites.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use sharp_metrics::weights::Published;
use sharp_metrics::{
    Backbone, LpipsNet, LpipsVariant, Metric, MetricInfo, MetricKey, MetricRegion, OwnWeights,
    SsimBorder, SsimCovariance, SsimVariant, SsimWindow, WeightsUsed,
};

use crate::io::atomic_files::{FileError, write_all_over_own};

/// References of the metrics and their networks, of the paper and its datasets, a blank line between them.
const CITATIONS: &str = include_str!("citations.bib");
/// Digits of a hash that a paper shows.
const DIGITS: usize = 12;

/// A paragraph and the references that it cites.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MethodsText {
    /// One paragraph of LaTeX.
    pub latex: String,
    /// BibTeX entries of what it cites.
    pub bibtex: String,
    /// Networks whose weights were not at hand; the paragraph has a visible gap where their hashes belong.
    pub missing: Vec<Backbone>,
}

impl MethodsText {
    /// Describes metrics as computed with these weights.
    pub fn new(keys: &[MetricKey], used: &[WeightsUsed]) -> Self {
        let infos = keys.iter().map(|key| MetricInfo::new(*key, used));
        let infos: Vec<MetricInfo> = infos.collect();
        let before = format!(
            "All metrics were computed per image with \\texttt{{sharp-bench}} {} on 8-bit sRGB images at the full \
             resolution of the ground truth and averaged over images; images are not resized unless said so.",
            env!("CARGO_PKG_VERSION")
        );
        Self::of(vec![before], &infos, Vec::new())
    }

    /// Describes metrics between other sentences of LaTeX, which may cite what `citations.bib` has.
    pub fn of(before: Vec<String>, infos: &[MetricInfo], after: Vec<String>) -> Self {
        let sentences = before.into_iter().chain(infos.iter().map(sentence));
        let sentences: Vec<String> = sentences.chain(after).collect();
        let latex = sentences.join("\n");
        let cited = |entry: &&str| {
            let key = entry.split(['{', ',']).nth(1).unwrap_or_default();
            latex.contains(&format!("\\cite{{{key}}}"))
        };
        let entries: Vec<&str> = CITATIONS.split("\n\n").filter(cited).collect();
        let mut bibtex = entries.join("\n\n");
        if !bibtex.is_empty() && !bibtex.ends_with('\n') {
            bibtex.push('\n');
        }
        let backbones = infos.iter().filter_map(|info| info.backbone.as_ref());
        let missing = backbones.filter(|backbone| backbone.features_sha256.is_none());
        let missing: BTreeSet<Backbone> = missing.map(|backbone| backbone.name).collect();
        Self {
            missing: missing.into_iter().collect(),
            latex,
            bibtex,
        }
    }
}

/// How our files begin, so that nothing else is written over.
const MARK: &str = "% Written by sharp-bench";

impl MethodsText {
    /// Writes `methods.tex`, to be `\\input`, and `methods.bib`.
    ///
    /// # Errors
    /// When one cannot be written, or the name is taken by something else; then none is written.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, FileError> {
        let tex = format!("{MARK}; references: methods.bib\n{}\n", self.latex);
        let bib = format!("{MARK}\n\n{}", self.bibtex);
        let files = [("methods.tex", tex), ("methods.bib", bib)];
        write_all_over_own(&files.map(|(name, text)| (folder.join(name), text, MARK)))
    }
}

fn sentence(info: &MetricInfo) -> String {
    let metric = info.key.metric();
    let text = match metric {
        Metric::Psnr | Metric::PsnrFloored => {
            let floor = match metric {
                Metric::PsnrFloored => " (at least $10^{-8}$)",
                _ => "",
            };
            format!(
                "PSNR is $-10\\log_{{10}}$ of the mean squared error{floor} over all pixels and channels of values in \
                 $[0,1]$, per image and not pooled"
            )
        }
        Metric::Ssim(variant) => format!("SSIM~\\cite{{wang2004image}} uses {}", ssim(variant)),
        Metric::Lpips(net, variant) => lpips(info, net, variant),
        Metric::Dists | Metric::DistsResize256 => dists(info),
    };
    let mask = match info.region {
        MetricRegion::Whole => None,
        MetricRegion::Frustum => Some("the view-frustum mask (margin 1.05)"),
        MetricRegion::Given => Some("the given mask"),
    };
    let inside = mask.map(|mask| match metric {
        Metric::Psnr | Metric::PsnrFloored => format!(", over the pixels inside {mask}"),
        Metric::Ssim(SsimVariant::Gauss11ValidWholeWindow) => {
            format!(", averaged over the windows that lie inside {mask} as a whole")
        }
        Metric::Lpips(_, LpipsVariant::BoxPaste | LpipsVariant::LayerMask) => {
            format!("; the mask is {mask}")
        }
        Metric::Ssim(_) => format!(", averaged over the window centres inside {mask}"),
        _ => format!(", averaged over the spatial map inside {mask}"),
    });
    let inside = inside.unwrap_or_default();
    format!("{text}{inside} (\\texttt{{{}}}).", info.key)
}

/// Window, constants, covariance, border and channels.
fn ssim(variant: SsimVariant) -> String {
    let form = variant.form();
    let window = match form.window {
        SsimWindow::Uniform7 => "a $7\\times7$ uniform window",
        SsimWindow::Gauss11 => "an $11\\times11$ Gaussian window ($\\sigma=1.5$)",
    };
    let range = match form.range_of_data {
        true => " scaled by the larger data range of the two images",
        false => "",
    };
    let covariance = match form.covariance {
        SsimCovariance::Sample => "sample covariance",
        SsimCovariance::Population => "population covariance",
        SsimCovariance::Bounded => {
            "population covariance bounded by the geometric mean of the variances"
        }
    };
    let border = match form.border {
        SsimBorder::Zero => "zero padding",
        SsimBorder::Reflect => "reflected borders",
        SsimBorder::Valid => "only windows inside the image",
    };
    let guard = match form.guarded {
        true => " and $10^{-8}$ added to the denominator",
        false => "",
    };
    let channels = match variant {
        _ if form.gray => "on luma $0.299R+0.587G+0.114B$",
        SsimVariant::Gauss11Zero => {
            "averaged over the RGB channels, as in the evaluation of 3D Gaussian Splatting"
        }
        SsimVariant::Uniform7Sample => {
            "averaged over the RGB channels (the defaults of scikit-image)"
        }
        _ => "averaged over the RGB channels",
    };
    format!("{window}, $K_1=0.01$, $K_2=0.03${range}, {covariance} and {border}{guard}, {channels}")
}

fn lpips(info: &MetricInfo, net: LpipsNet, variant: LpipsVariant) -> String {
    let network = match net {
        LpipsNet::Alex => "AlexNet~\\cite{krizhevsky2014one}",
        LpipsNet::Vgg => "VGG16~\\cite{simonyan2015very}",
        LpipsNet::Squeeze => "SqueezeNet 1.1~\\cite{iandola2016squeezenet}",
    };
    let input = match variant {
        LpipsVariant::Official => {
            "on inputs scaled to $[-1,1]$ without resizing, with $10^{-10}$ added to feature norms"
        }
        LpipsVariant::Unscaled => {
            "on inputs left in $[0,1]$ where the network expects $[-1,1]$, without resizing, as in the evaluation of \
             3D Gaussian Splatting"
        }
        LpipsVariant::BoxPaste => {
            "on inputs scaled to $[-1,1]$ without resizing, with $10^{-10}$ added to feature norms, on the box around \
             the mask with the prediction replaced by the ground truth outside the mask"
        }
        LpipsVariant::LayerMask => {
            "on inputs scaled to $[-1,1]$ without resizing, with $10^{-8}$ added to feature norms, each layer averaged \
             over the positions that no pixel outside the mask has reached"
        }
        LpipsVariant::TorchmetricsEps => {
            "on inputs scaled to $[-1,1]$ without resizing, with $10^{-8}$ added to squared feature norms as \
             torchmetrics does"
        }
    };
    format!(
        "LPIPS~\\cite{{zhang2018unreasonable}} is version 0.1 with {network} features ({}) and the linear weights of {} \
         {input}",
        backbone(info),
        own_weights(info),
    )
}

fn dists(info: &MetricInfo) -> String {
    let resize = match info.key.metric() {
        Metric::DistsResize256 => {
            "after reducing the shorter side to 256 pixels where it is larger (bilinear with antialiasing, 8 bit)"
        }
        _ => "at full resolution, without resizing",
    };
    format!(
        "DISTS~\\cite{{ding2022image}} compares VGG16~\\cite{{simonyan2015very}} features with L2 pooling ({}) with the \
         weights of {}, on inputs in $[0,1]$ {resize}",
        backbone(info),
        own_weights(info),
    )
}

/// The network's weights by hash; torchvision's file by name where these are its features.
fn backbone(info: &MetricInfo) -> String {
    let known = info.backbone.as_ref();
    let known = known.and_then(|b| Some((b, b.features_sha256.as_deref()?)));
    let Some((backbone, features)) = known else {
        return "torchvision weights, sha256 \\textbf{[hash of the weights]}".to_owned();
    };
    let published = Published::of(backbone.name);
    let file = backbone.file_sha256.as_ref();
    let (name, file) = match &backbone.deterministic {
        Some(_) => ("untrained weights".to_owned(), None),
        None if backbone.is_unpublished() => ("weights from a file".to_owned(), file),
        None => {
            let name = published.file.replace('_', "\\_");
            let torchs = file.filter(|sha256| sha256.starts_with(&*published.sha256_prefix));
            (format!("torchvision's \\texttt{{{name}}}"), torchs)
        }
    };
    let file = file.map_or_else(String::new, |sha256| {
        format!(", sha256 \\texttt{{{}}}", short(sha256))
    });
    let features = short(features);
    format!("{name}{file}, sha256 of the features \\texttt{{{features}}}")
}

/// The first digits of a hash; a hash that a file states about itself may be anything.
pub(crate) fn short(hash: &str) -> String {
    let digits = hash.chars().filter(char::is_ascii_hexdigit);
    digits.take(DIGITS).collect()
}

fn own_weights(info: &MetricInfo) -> String {
    let Some(OwnWeights {
        package,
        file,
        sha256,
    }) = &info.own_weights
    else {
        return String::new();
    };
    let (name, version) = package.split_once(' ').unwrap_or((package, ""));
    format!(
        "\\texttt{{{name}}} {version} (\\texttt{{{file}}}, sha256 \\texttt{{{}}})",
        short(sha256)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp_metrics::{MetricRegion, Scorer, Selection, Weights};

    fn text(list: &str, weights: &Weights) -> MethodsText {
        let scorer = Scorer::new(&Selection::parse(list).unwrap(), weights).unwrap();
        MethodsText::new(scorer.keys(), scorer.weights())
    }

    #[test]
    fn lpips_says_version_network_hashes_range_and_resize_rule() {
        let weights = Weights::deterministic("");
        let text = text("lpips-alex", &weights);
        for part in [
            "version 0.1",
            "AlexNet",
            "$[-1,1]$",
            "df73285e35b2",
            "without resizing",
            "\\texttt{lpips} 0.1.4",
            "\\cite{zhang2018unreasonable}",
        ] {
            assert!(text.latex.contains(part), "{part}: {}", text.latex);
        }
        let scorer = Scorer::new(&Selection::parse("lpips-alex").unwrap(), &weights).unwrap();
        let hash = &scorer.weights()[0].features_sha256[..12];
        assert!(text.latex.contains(hash), "{}", text.latex);
        assert!(text.missing.is_empty());
    }

    #[test]
    fn every_key_has_a_sentence_and_everything_cited_has_an_entry() {
        for key in MetricRegion::ALL
            .into_iter()
            .flat_map(MetricKey::all_inside)
        {
            let text = MethodsText::new(&[key], &[]);
            let key = key.to_string();
            assert!(
                text.latex.contains(&format!("\\texttt{{{key}}}")),
                "{}",
                text.latex
            );
            for cite in text.latex.split("\\cite{").skip(1) {
                let name = cite.split('}').next().unwrap();
                assert!(text.bibtex.contains(&format!("{{{name},")), "{name}");
            }
            let opened = text.latex.matches('{').count();
            assert_eq!(opened, text.latex.matches('}').count(), "{}", text.latex);
        }
    }

    #[test]
    fn absent_weights_leave_a_visible_gap() {
        let text = text("dists,lpips-vgg", &Weights::none());
        assert_eq!(text.missing, [Backbone::Vgg16]);
        assert!(
            text.latex.contains("\\textbf{[hash of the weights]}"),
            "{}",
            text.latex
        );
    }
}
