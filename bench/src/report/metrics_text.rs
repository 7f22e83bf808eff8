//! Describes a run's metrics for a paper's methods section: a paragraph of LaTeX with its references.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use sharp_metrics::weights::Published;
use sharp_metrics::{Backbone, Family, MetricInfo, MetricKey, OwnWeights, WeightsUsed};

use super::tables::latex::escape;
use crate::io::atomic_files::{FileError, write_all_over_own};

/// References for the metrics and their networks, the paper and its datasets, separated by blank lines.
const CITATIONS: &str = include_str!("citations.bib");
/// Number of hash digits shown in a paper.
const DIGITS: usize = 12;

/// First line of the files that this program writes; other files are not overwritten.
const MARK: &str = "% Written by sharp-bench";

/// A paragraph and the references that it cites.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MethodsText {
    /// One paragraph of LaTeX.
    pub latex: String,
    /// BibTeX entries of the cited references.
    pub bibtex: String,
    /// Networks whose weights are missing. The paragraph has a visible gap in place of their hashes.
    pub missing: Vec<Backbone>,
}

impl MethodsText {
    /// Describes the metrics `keys` as computed with the weights `used`.
    pub fn new(keys: &[MetricKey], used: &[WeightsUsed]) -> Self {
        let infos: Vec<MetricInfo> = keys.iter().map(|key| MetricInfo::new(*key, used)).collect();
        let before = format!(
            "All metrics were computed per image with \\texttt{{sharp-bench}} {} on 8-bit sRGB images at the full \
             resolution of the ground truth and averaged over images; images are not resized unless stated otherwise.",
            env!("CARGO_PKG_VERSION")
        );
        Self::of(vec![before], &infos, Vec::new())
    }

    /// Describes metrics as one paragraph of LaTeX, between the sentences `before` and `after`, which may cite entries
    /// of `citations.bib`.
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

    /// Writes `methods.tex`, for `\\input`, and `methods.bib`.
    ///
    /// # Errors
    /// If a file cannot be written, or exists and was not written by this program. In the second case, nothing is
    /// written.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, FileError> {
        let tex = format!("{MARK}; references: methods.bib\n{}\n", self.latex);
        let bib = format!("{MARK}\n\n{}", self.bibtex);
        let files = [("methods.tex", tex), ("methods.bib", bib)];
        write_all_over_own(&files.map(|(name, text)| (folder.join(name), text, MARK)))
    }
}

/// The metric's sentence from `metrics --explain`, with its network and the hash of the weights, but without the public
/// code that computes the same values.
fn sentence(info: &MetricInfo) -> String {
    const COMPARED: [&str; 3] = ["Same as", "Not the same as", "With VGG16 the same as"];
    let name = match info.family {
        Family::Psnr => "PSNR",
        Family::Ssim => "SSIM~\\cite{wang2004image}",
        Family::Lpips => "LPIPS~\\cite{zhang2018unreasonable}",
        Family::Dists => "DISTS~\\cite{ding2022image}",
    };
    let convention = info.convention.trim_end_matches('.').split(". ");
    let said = convention.filter(|text| !COMPARED.iter().any(|start| text.starts_with(start)));
    let said = escape(&said.collect::<Vec<_>>().join(". "));
    let weights = info.backbone.as_ref().map_or_else(String::new, |known| {
        let network = match known.name {
            Backbone::AlexNet => "AlexNet~\\cite{krizhevsky2014one}",
            Backbone::Vgg16 => "VGG16~\\cite{simonyan2015very}",
            Backbone::SqueezeNet1_1 => "SqueezeNet 1.1~\\cite{iandola2016squeezenet}",
        };
        let (features, own) = (backbone(info), own_weights(info));
        format!(" Features of {network}: {features}; weights of {own}.")
    });
    format!("{name} (\\texttt{{{}}}): {said}.{weights}", info.key)
}

/// Names the network's weights by their hash. Torchvision's features are named by torchvision's file.
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
    format!("{name}{file}, sha256 of the convolutions' weights \\texttt{{{features}}}")
}

/// The first digits of a hash. Drops other characters, because files may state any text as their hash.
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
    use sharp_tests::holds;

    fn text(list: &str, weights: &Weights) -> MethodsText {
        let scorer = Scorer::new(&Selection::parse(list).unwrap(), weights).unwrap();
        MethodsText::new(scorer.keys(), scorer.weights())
    }

    #[test]
    fn lpips_says_version_network_hashes_range_and_resolution() {
        let weights = Weights::deterministic("");
        let text = text("lpips-alex", &weights);
        for part in [
            "version 0.1",
            "AlexNet",
            "scaled to -1..1",
            "df73285e35b2",
            "at the picture's own resolution",
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
            holds(&text.latex, &[&format!("\\texttt{{{key}}}")]);
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
        holds(&text.latex, &["\\textbf{[hash of the weights]}"]);
    }
}
