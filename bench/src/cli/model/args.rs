//! Options that select a network and its weights.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail, ensure};
use clap::Args;
use sharp::image_file::focal::FocalSource;
use sharp::image_file::{AlphaRule, ColorRule, PictureRules};
use sharp::model::depth_pro::DepthPro;
use sharp::model::preprocess::{Photo, PhotoOptions};
use sharp::model::{Algorithm, DeviceChoice, NetworkSpec, Predictor};
use sharp_datasets::files::what_lies_in;

use crate::cli::output;
use crate::io::checkpoint::{depth_pro_network, named_network};

/// Options that select a network, its weights and its device.
#[derive(Debug, Clone, Args)]
pub(crate) struct ModelArgs {
    /// Weights: .pt or .safetensors, or mini for the bundled small network [default: the release
    /// checkpoint in torch's hub folder or in sharp-bench's cache]
    #[arg(long, value_name = "FILE")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Architecture, FILE.json or FILE.json#NAME [default: a fitting .json next to the checkpoint, or the release's]
    #[arg(long, value_name = "FILE[#NAME]")]
    pub(crate) config: Option<String>,
    /// Ignore unknown tensors with this name prefix; repeatable
    #[arg(long, value_name = "PREFIX")]
    pub(crate) allow_unused: Vec<String>,
    /// Device: auto (CUDA or Metal if built in, else the CPU), cpu, candle-cpu (candle's own operations on the CPU, a
    /// slower reference), cuda (an NVIDIA GPU; needs a build with --features cuda) or metal (an Apple GPU; needs a
    /// build with --features metal; untested)
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub(crate) device: DeviceChoice,
    /// On the CPU, use direct convolution instead of Winograd convolution: slower, but with rounding errors five times
    /// smaller
    #[arg(long)]
    pub(crate) exact: bool,
}

impl ModelArgs {
    pub(crate) fn load(&self) -> anyhow::Result<Predictor> {
        ensure!(
            self.config.is_none() || self.checkpoint.is_some(),
            "--config needs --checkpoint FILE"
        );
        let named = named_network(self.checkpoint.as_deref(), self.config.as_deref())?;
        for note in &named.notes {
            output::remark(format!("note: {note}"));
        }
        Ok(Predictor::open(&self.on_device(named))?)
    }

    /// Opens Depth Pro's network instead of SHARP's.
    pub(crate) fn load_depth_pro(&self) -> anyhow::Result<DepthPro> {
        let checkpoint = self.checkpoint.as_deref();
        let checkpoint =
            checkpoint.context("--depth-only needs Depth Pro's weights: give --checkpoint FILE")?;
        let network = depth_pro_network(checkpoint, self.config.as_deref())?;
        Ok(DepthPro::open(&self.on_device(network))?)
    }

    fn on_device(&self, network: NetworkSpec) -> NetworkSpec {
        NetworkSpec {
            allow_unused: self.allow_unused.clone(),
            device: self.device,
            convolution: if self.exact {
                Algorithm::Direct
            } else {
                Algorithm::Winograd
            },
            ..network
        }
    }
}

/// Options for reading a photograph.
#[derive(Debug, Args)]
pub(crate) struct PhotoArgs {
    /// Focal length in pixels of the upright photograph [default: from the photograph's EXIF tags]
    #[arg(long, value_name = "F")]
    pub(crate) focal_px: Option<f64>,
    /// Refuse photographs with more pixels, before they are decoded
    #[arg(long, value_name = "N", default_value_t = PhotoOptions::default().max_pixels)]
    pub(crate) max_pixels: u64,
    /// How to treat the alpha channel of a photograph that is not opaque: drop (use the colours as stored, as the
    /// release does, and warn), refuse, or black or white (composite over this colour, in encoded values)
    #[arg(long, value_name = "RULE", default_value_t = AlphaRule::Drop)]
    pub(crate) alpha: AlphaRule,
    /// How to treat a photograph whose colour profile is not sRGB: convert (to sRGB) or as-stored (as the release does)
    #[arg(long, value_name = "RULE", default_value_t)]
    pub(crate) color: ColorRule,
}

impl PhotoArgs {
    /// Reads a photograph and prints its warnings.
    pub(crate) fn load(&self, path: &Path) -> anyhow::Result<Photo> {
        self.load_unless_estimated(path, |_| false)
    }

    /// Like [`Self::load`], but without warnings about the focal length of photographs for which `is_estimated` is
    /// true.
    pub(crate) fn load_unless_estimated(
        &self,
        path: &Path,
        is_estimated: impl Fn(&Photo) -> bool,
    ) -> anyhow::Result<Photo> {
        let options = PhotoOptions {
            focal_px: self.focal_px,
            max_pixels: self.max_pixels,
            rules: PictureRules {
                alpha: self.alpha,
                color: self.color,
                ..PictureRules::default()
            },
        };
        if path.is_dir() {
            let inside = what_lies_in(path);
            bail!(
                "{}: a folder, not a photograph; name the pictures in it ({inside})",
                path.display()
            );
        }
        let photo = sharp::model::preprocess::load_photo(path, &options)
            .map_err(|error| anyhow!(output::as_options(&error)))?;
        let of_focal = photo
            .focal_warnings
            .iter()
            .filter(|_| !is_estimated(&photo));
        for warning in photo.warnings.iter().chain(of_focal) {
            output::remark(format!(
                "warning: {}: {}",
                path.display(),
                output::as_options(warning)
            ));
        }
        Ok(photo)
    }
}

/// Describes the source of the focal length.
pub(crate) fn focal_text(photo: &Photo) -> String {
    let source = match photo.focal_source {
        FocalSource::Given => "given".to_owned(),
        FocalSource::Equivalent35mm(mm) => format!("{mm} mm on 35 mm film, from the file"),
        FocalSource::Lens(mm) => format!("{mm} mm lens, from the file"),
        FocalSource::Default => "the default of 30 mm on 35 mm film".to_owned(),
    };
    format!("{:.2} px ({source})", photo.focal_px)
}
