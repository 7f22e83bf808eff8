//! The paper's tables as data, typed in from its LaTeX source.
//!
//! In a row, two numbers per dataset in the order of [`columns`](super::columns), in the order of the table's metrics.

#![expect(
    clippy::approx_constant,
    reason = "0.318 is ViewCrafter's DISTS on Booster, not 1/π"
)]

use sharp_metrics::Family;

/// A table of the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperTable {
    /// Short name, for a command line and for files.
    pub name: &'static str,
    /// LaTeX label in the paper.
    pub label: &'static str,
    /// Which `tabular` under that label, from 0.
    pub part: usize,
    /// What it shows.
    pub title: &'static str,
    /// Of its two metrics.
    pub families: [Family; 2],
    /// Method and its twelve numbers.
    pub rows: [(&'static str, [f64; 12]); 7],
}

/// All four, in the paper's order of importance.
pub const TABLES: [PaperTable; 4] = [QUANTITATIVE, PSNR_SSIM, PRIVILEGED, PRIVILEGED_PSNR_SSIM];

#[rustfmt::skip]
const QUANTITATIVE: PaperTable = PaperTable {
    name: "quantitative",
    label: "tab:quantitative",
    part: 0,
    title: "View synthesis fidelity, perceptual metrics",
    families: [Family::Dists, Family::Lpips],
    rows: [
        ("Flash3D",      [0.359, 0.581, 0.409, 0.370, 0.374, 0.572, 0.159, 0.345, 0.382, 0.683, 0.535, 0.651]),
        ("TMPI",         [0.158, 0.436, 0.232, 0.409, 0.128, 0.309, 0.114, 0.327, 0.309, 0.693, 0.396, 0.720]),
        ("LVSM",         [0.274, 0.555, 0.307, 0.404, 0.145, 0.302, 0.095, 0.257, 0.227, 0.575, 0.555, 0.664]),
        ("SVC",          [0.208, 0.629, 0.283, 0.448, 0.201, 0.596, 0.157, 0.531, 0.230, 0.733, 0.420, 0.708]),
        ("ViewCrafter",  [0.373, 0.751, 0.318, 0.523, 0.176, 0.526, 0.148, 0.386, 0.295, 0.759, 0.454, 0.748]),
        ("Gen3C",        [0.164, 0.545, 0.207, 0.384, 0.090, 0.227, 0.106, 0.285, 0.177, 0.566, 0.408, 0.734]),
        ("SHARP (ours)", [0.097, 0.358, 0.119, 0.270, 0.071, 0.154, 0.069, 0.190, 0.122, 0.421, 0.258, 0.554]),
    ],
};

#[rustfmt::skip]
const PSNR_SSIM: PaperTable = PaperTable {
    name: "psnr-ssim",
    label: "tab:quantitative-aligned-psnr-ssim",
    part: 0,
    title: "View synthesis fidelity, PSNR and SSIM",
    families: [Family::Psnr, Family::Ssim],
    rows: [
        ("Flash3D",      [15.88, 0.683, 22.40, 0.873, 18.14, 0.641, 18.09, 0.616, 15.80, 0.518, 15.21, 0.682]),
        ("TMPI",         [16.42, 0.688, 19.44, 0.833, 16.16, 0.712, 16.44, 0.559, 12.41, 0.368, 12.61, 0.540]),
        ("LVSM",         [15.53, 0.681, 20.16, 0.843, 20.25, 0.775, 18.04, 0.594, 15.95, 0.519, 16.72, 0.722]),
        ("SVC",          [12.72, 0.613, 17.65, 0.781, 11.71, 0.624, 12.20, 0.410, 11.76, 0.413, 13.36, 0.662]),
        ("ViewCrafter",  [10.33, 0.569, 14.18, 0.692, 13.30, 0.645, 14.43, 0.437, 11.49, 0.423, 11.94, 0.621]),
        ("Gen3C",        [13.89, 0.624, 20.19, 0.837, 20.82, 0.792, 16.54, 0.504, 14.83, 0.499, 13.09, 0.642]),
        ("SHARP (ours)", [17.12, 0.693, 22.19, 0.864, 22.63, 0.833, 19.57, 0.655, 16.33, 0.528, 14.51, 0.610]),
    ],
};

#[rustfmt::skip]
const PRIVILEGED: PaperTable = PaperTable {
    name: "privileged",
    label: "tab:quantitative-aligned",
    part: 0,
    title: "View synthesis fidelity with privileged depth, perceptual metrics",
    families: [Family::Dists, Family::Lpips],
    rows: [
        ("Flash3D",      [0.333, 0.510, 0.412, 0.361, 0.283, 0.395, 0.181, 0.368, 0.399, 0.666, 0.474, 0.595]),
        ("TMPI",         [0.155, 0.426, 0.232, 0.404, 0.128, 0.310, 0.108, 0.279, 0.356, 0.736, 0.345, 0.697]),
        ("LVSM",         [0.243, 0.564, 0.294, 0.428, 0.125, 0.236, 0.088, 0.229, 0.219, 0.558, 0.456, 0.668]),
        ("SVC",          [0.181, 0.518, 0.257, 0.381, 0.146, 0.459, 0.120, 0.407, 0.199, 0.653, 0.410, 0.700]),
        ("ViewCrafter",  [0.163, 0.410, 0.223, 0.310, 0.111, 0.232, 0.102, 0.159, 0.184, 0.476, 0.339, 0.594]),
        ("Gen3C",        [0.124, 0.347, 0.192, 0.291, 0.085, 0.196, 0.078, 0.118, 0.149, 0.434, 0.283, 0.568]),
        ("SHARP (ours)", [0.081, 0.262, 0.110, 0.214, 0.068, 0.137, 0.057, 0.117, 0.112, 0.374, 0.187, 0.381]),
    ],
};

#[rustfmt::skip]
const PRIVILEGED_PSNR_SSIM: PaperTable = PaperTable {
    name: "privileged-psnr-ssim",
    label: "tab:quantitative-aligned",
    part: 1,
    title: "View synthesis fidelity with privileged depth, PSNR and SSIM",
    families: [Family::Psnr, Family::Ssim],
    rows: [
        ("Flash3D",      [18.61, 0.719, 23.16, 0.879, 21.98, 0.803, 19.45, 0.679, 16.40, 0.567, 17.06, 0.674]),
        ("TMPI",         [16.70, 0.696, 19.69, 0.838, 16.11, 0.709, 17.54, 0.600, 11.85, 0.329, 13.39, 0.578]),
        ("LVSM",         [15.22, 0.672, 19.27, 0.823, 23.42, 0.826, 19.29, 0.627, 16.31, 0.529, 16.38, 0.719]),
        ("SVC",          [15.73, 0.671, 20.27, 0.841, 15.19, 0.696, 14.77, 0.483, 13.47, 0.465, 13.83, 0.671]),
        ("ViewCrafter",  [17.11, 0.703, 21.55, 0.860, 19.73, 0.788, 20.10, 0.672, 16.84, 0.566, 18.81, 0.721]),
        ("Gen3C",        [18.46, 0.720, 23.12, 0.875, 22.11, 0.822, 22.45, 0.745, 17.23, 0.557, 18.93, 0.716]),
        ("SHARP (ours)", [19.18, 0.742, 23.57, 0.880, 23.67, 0.865, 23.62, 0.780, 16.92, 0.543, 19.09, 0.715]),
    ],
};
