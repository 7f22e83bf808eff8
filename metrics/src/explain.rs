//! What each key means, in words, and which public code computes the same value.

use crate::identity::{LpipsNet, LpipsVariant, Metric, MetricKey, Region, SsimVariant};

impl MetricKey {
    /// What the key means, in a few sentences, and which public code computes the same value.
    pub fn explain(self) -> String {
        explain(self)
    }
}

fn explain(key: MetricKey) -> String {
    let base = match key.metric() {
        Metric::Psnr => PSNR.to_owned(),
        Metric::Ssim(variant) => format!("{SSIM} {}", ssim(variant)),
        Metric::Lpips(net, variant) => {
            format!("{LPIPS} {} {}", lpips_net(net), lpips_variant(variant))
        }
        Metric::Dists => format!("{DISTS} {DISTS_FULL}"),
        Metric::DistsResize256 => format!("{DISTS} {DISTS_256}"),
    };
    let mask = match key.region() {
        Region::Whole => return base,
        Region::Frustum => "the view-frustum mask",
        Region::Given => "the mask that was handed in (levels of 128 and more)",
    };
    let masked = match key.metric() {
        Metric::Psnr => format!("Only pixels inside {mask} enter the mean squared error."),
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

fn lpips_variant(variant: LpipsVariant) -> &'static str {
    match variant {
        LpipsVariant::Official => {
            "Pictures scaled to -1..1, 1e-10 added to the norm. Same as lpips.LPIPS(version='0.1') \
             on tensors in -1..1, pyiqa, and torchmetrics up to version 1.1 with normalize=True \
             for pictures in 0..1."
        }
        LpipsVariant::Unscaled => {
            "Pictures in 0..1 are passed to a network that expects -1..1, which makes differences \
             look smaller. Same as the metrics script of 3D Gaussian Splatting and torchmetrics \
             with net_type='vgg' and normalize=False on pictures in 0..1, as gsplat calls it."
        }
        LpipsVariant::TorchmetricsEps => {
            "Pictures scaled to -1..1, 1e-8 added to the squared norm before the root. Same as \
             torchmetrics since version 1.2 with normalize=True on pictures in 0..1."
        }
    }
}

const DISTS: &str = "Deep image structure and texture similarity on torchvision's VGG16 with L2 \
     pooling, pictures in 0..1: per channel, means (structure) and covariance (texture) over the \
     whole picture, weighted and subtracted from 1. Not clamped, so identical pictures may give a \
     tiny negative number.";
const DISTS_FULL: &str = "No resizing. Same as DISTS-pytorch's forward and its resize=False, \
     pyiqa and torchmetrics. Not the same as piq, which always shrinks inside.";
const DISTS_256: &str = "Pictures whose shorter side exceeds 256 are first reduced so that it is \
     256 (bilinear with antialiasing on 8-bit values, as PIL does). Same as the reference script's \
     prepare_image with resize=True.";
