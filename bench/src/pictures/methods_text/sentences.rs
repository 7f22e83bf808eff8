//! A sentence for each metric.

use sharp_metrics::{
    Backbone, LpipsNet, LpipsVariant, Metric, MetricInfo, MetricKey, MetricRegion, SsimVariant,
    WeightsUsed,
};

use sharp_metrics::weights::Published;

use super::citations::Citation;

/// Digits of a hash that a paper shows.
const DIGITS: usize = 12;

/// The sentence, and what it cites.
pub(super) fn sentence(key: MetricKey, used: &[WeightsUsed]) -> (String, Vec<Citation>) {
    let (mut text, cites) = match key.metric() {
        Metric::Psnr => (
            "PSNR is $-10\\log_{10}$ of the mean squared error over all pixels and channels of values in $[0,1]$, \
             per image and not pooled"
                .to_owned(),
            vec![],
        ),
        Metric::Ssim(variant) => (
            format!("SSIM~{} uses {}", cite(Citation::Ssim), ssim(variant)),
            vec![Citation::Ssim],
        ),
        Metric::Lpips(net, variant) => lpips(key, net, variant, used),
        Metric::Dists | Metric::DistsResize256 => dists(key, used),
    };
    let inside = match key.region() {
        MetricRegion::Whole => None,
        MetricRegion::Frustum => Some("the view-frustum mask (margin 1.05)"),
        MetricRegion::Given => Some("the given mask"),
    };
    if let Some(mask) = inside {
        text += &match key.metric() {
            Metric::Psnr => format!(", over the pixels inside {mask}"),
            Metric::Ssim(_) => format!(", averaged over the window centres inside {mask}"),
            _ => format!(", averaged over the spatial map inside {mask}"),
        };
    }
    (format!("{text} (\\texttt{{{key}}})."), cites)
}

fn cite(citation: Citation) -> String {
    format!("\\cite{{{}}}", citation.key())
}

fn ssim(variant: SsimVariant) -> &'static str {
    match variant {
        SsimVariant::Gauss11Valid => {
            "an $11\\times11$ Gaussian window ($\\sigma=1.5$), $K_1=0.01$, $K_2=0.03$, population covariance and only \
             windows inside the image, averaged over the RGB channels"
        }
        SsimVariant::Gauss11Zero => {
            "an $11\\times11$ Gaussian window ($\\sigma=1.5$), $K_1=0.01$, $K_2=0.03$, population covariance and zero \
             padding, averaged over the RGB channels, as in the evaluation of 3D Gaussian Splatting"
        }
        SsimVariant::Gauss11Reflect => {
            "an $11\\times11$ Gaussian window ($\\sigma=1.5$), $K_1=0.01$, $K_2=0.03$, population covariance and \
             reflected borders, averaged over the RGB channels"
        }
        SsimVariant::Uniform7Sample => {
            "a $7\\times7$ uniform window, $K_1=0.01$, $K_2=0.03$, sample covariance and only windows inside the \
             image, averaged over the RGB channels (the defaults of scikit-image)"
        }
        SsimVariant::Uniform7Population => {
            "a $7\\times7$ uniform window, $K_1=0.01$, $K_2=0.03$, population covariance and only windows inside the \
             image, averaged over the RGB channels"
        }
        SsimVariant::Gauss11ValidSample => {
            "an $11\\times11$ Gaussian window ($\\sigma=1.5$), $K_1=0.01$, $K_2=0.03$, sample covariance and only \
             windows inside the image, averaged over the RGB channels"
        }
        SsimVariant::Gauss11ValidGray => {
            "an $11\\times11$ Gaussian window ($\\sigma=1.5$), $K_1=0.01$, $K_2=0.03$, population covariance and only \
             windows inside the image, on luma $0.299R+0.587G+0.114B$"
        }
        SsimVariant::Gauss11ReflectDataRange => {
            "an $11\\times11$ Gaussian window ($\\sigma=1.5$), $K_1=0.01$, $K_2=0.03$ scaled by the larger data range \
             of the two images, population covariance and reflected borders, averaged over the RGB channels"
        }
    }
}

fn lpips(
    key: MetricKey,
    net: LpipsNet,
    variant: LpipsVariant,
    used: &[WeightsUsed],
) -> (String, Vec<Citation>) {
    let (network, citation) = match net {
        LpipsNet::Alex => ("AlexNet", Citation::AlexNet),
        LpipsNet::Vgg => ("VGG16", Citation::Vgg),
        LpipsNet::Squeeze => ("SqueezeNet 1.1", Citation::SqueezeNet),
    };
    let input = match variant {
        LpipsVariant::Official => {
            "on inputs scaled to $[-1,1]$ without resizing, with $10^{-10}$ added to feature norms"
        }
        LpipsVariant::Unscaled => {
            "on inputs left in $[0,1]$ where the network expects $[-1,1]$, without resizing, as in the evaluation of \
             3D Gaussian Splatting"
        }
        LpipsVariant::TorchmetricsEps => {
            "on inputs scaled to $[-1,1]$ without resizing, with $10^{-8}$ added to squared feature norms as \
             torchmetrics does"
        }
    };
    let text = format!(
        "LPIPS~{} is version 0.1 with {network}~{} features ({}) and the linear weights of {} {input}",
        cite(Citation::Lpips),
        cite(citation),
        backbone(key, used),
        own_weights(key),
    );
    (text, vec![Citation::Lpips, citation])
}

fn dists(key: MetricKey, used: &[WeightsUsed]) -> (String, Vec<Citation>) {
    let resize = match key.metric() {
        Metric::DistsResize256 => {
            "after reducing the shorter side to 256 pixels where it is larger (bilinear with antialiasing, 8 bit)"
        }
        _ => "at full resolution, without resizing",
    };
    let text = format!(
        "DISTS~{} compares VGG16~{} features with L2 pooling ({}) with the weights of {}, on inputs in $[0,1]$ {resize}",
        cite(Citation::Dists),
        cite(Citation::Vgg),
        backbone(key, used),
        own_weights(key),
    );
    (text, vec![Citation::Dists, Citation::Vgg])
}

/// The network's weights by hash; torchvision's file by name where the hash says that it is that file.
fn backbone(key: MetricKey, used: &[WeightsUsed]) -> String {
    let wanted = Backbone::of(key.metric());
    let Some(found) = used.iter().find(|used| Some(used.backbone) == wanted) else {
        return "torchvision weights, sha256 \\textbf{[hash of the weights]}".to_owned();
    };
    let features = short(&found.features_sha256);
    let Some(file) = &found.original_sha256 else {
        let source = found.source.to_string().replace('_', "\\_");
        return format!("weights {source}, sha256 of the features \\texttt{{{features}}}");
    };
    let published = Published::of(found.backbone);
    let name = if file.starts_with(&*published.sha256_prefix) {
        format!(
            "torchvision's \\texttt{{{}}}",
            published.file.replace('_', "\\_")
        )
    } else {
        "weights from a file".to_owned()
    };
    let file = short(file);
    format!("{name}, sha256 \\texttt{{{file}}}, of the features \\texttt{{{features}}}")
}

/// The first digits of a hash; a hash that a file states about itself may be anything.
fn short(hash: &str) -> String {
    let digits = hash.chars().filter(char::is_ascii_hexdigit);
    digits.take(DIGITS).collect()
}

fn own_weights(key: MetricKey) -> String {
    let Some(own) = MetricInfo::new(key, &[]).own_weights else {
        return String::new();
    };
    let (name, version) = own.package.split_once(' ').unwrap_or((&own.package, ""));
    format!(
        "\\texttt{{{name}}} {version} (\\texttt{{{}}}, sha256 \\texttt{{{}}})",
        own.file,
        short(&own.sha256)
    )
}
