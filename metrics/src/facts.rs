//! What decides a number besides its key: for the record of a run, and for papers.

use crate::identity::{LpipsNet, LpipsVariant, Metric, MetricKey, SsimVariant};
use crate::weights::Backbone;

/// The learned weights of a metric itself, which ship with the crate, as their authors published them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OwnWeights {
    /// Package of the Python Package Index, with its version.
    pub package: &'static str,
    /// File in the package.
    pub file: &'static str,
    /// sha256 of that file; the values here are the same.
    pub sha256: &'static str,
}

/// How a metric takes its pictures and what it is computed with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Facts {
    /// What a picture's levels become before the metric proper.
    pub input_range: &'static str,
    /// What happens to the pictures' resolution.
    pub resize: &'static str,
    /// Precision of the arithmetic.
    pub precision: &'static str,
    /// The metric's own learned weights.
    pub own_weights: Option<OwnWeights>,
    /// The network whose features it compares.
    pub backbone: Option<Backbone>,
}

const NETWORK: &str = "features f32, everything after them f64";

impl Facts {
    /// The facts of a key.
    pub fn of(key: MetricKey) -> Self {
        let metric = key.metric();
        let (input_range, precision) = match metric {
            Metric::Psnr => ("0..1", "exact integers for 8-bit pictures, else f64"),
            Metric::Ssim(SsimVariant::Gauss11ReflectDataRange) => {
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
        Self {
            input_range,
            resize,
            precision,
            own_weights: own_weights(metric),
            backbone: Backbone::of(metric),
        }
    }
}

fn own_weights(metric: Metric) -> Option<OwnWeights> {
    let (package, file, sha256) = match metric {
        Metric::Psnr | Metric::Ssim(_) => return None,
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
        package,
        file,
        sha256,
    })
}

/// Names of the parts that [`Scorer::terms`](crate::Scorer::terms) splits a metric into, in their order: layers of the
/// network, for DISTS the picture itself before them. Empty for metrics that are not split.
pub fn term_names(metric: Metric) -> &'static [&'static str] {
    match metric {
        Metric::Psnr | Metric::Ssim(_) => &[],
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

    #[test]
    fn every_learned_metric_names_its_weights_and_all_its_layers() {
        for key in MetricKey::all() {
            let facts = Facts::of(key);
            assert_eq!(
                facts.backbone.is_some(),
                facts.own_weights.is_some(),
                "{key}"
            );
            let names = term_names(key.metric());
            match facts.backbone {
                None => assert!(names.is_empty()),
                Some(backbone) => {
                    let taps = tap_channels(backbone).len();
                    let pictures = usize::from(names[0] == "picture");
                    assert_eq!(names.len(), taps + pictures, "{key}");
                    assert_eq!(facts.own_weights.unwrap().sha256.len(), 64);
                }
            }
        }
    }
}
