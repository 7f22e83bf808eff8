//! Gaussians that someone else's method predicted, one file per source view, rendered by us.

use std::path::PathBuf;

use sharp::ply::{ColorSpace, UnknownColorSpace};

use super::method::{
    Approach, GaussianPrediction, GaussianSpace, Method, MethodError, MethodIdentity,
    PredictGaussians, Privilege, SourceView,
};
use super::spec::{MethodSpec, SpecError};
use crate::io::gaussian_files::GaussianFile;
use crate::io::{fingerprints, gaussian_files};
use crate::pairs::pair_id::path_of;

/// The extras of a file that count what the renderer drops, and what is wrong with those.
pub const UNUSABLE: [(&str, &str); 2] = [
    ("not_finite", "hold values that are not finite"),
    ("zero_quaternions", "have a quaternion of zero"),
];

/// Reads `DIR/<dataset>/<scene>/<source>.ply` or `.safetensors` (percent-encoded like pair ids).
///
/// The Gaussians lie in the source's camera space, metres, OpenCV axes: what `sharp predict` and
/// `sharp-bench predict` write. Whatever camera a file stores is ignored; the dataset's poses and intrinsics place and
/// render them. Colours of a PLY that does not say how they are encoded need `color_space=`. Gaussians that are not finite
/// or have a quaternion of zero are dropped, counted in the extras `not_finite` and `zero_quaternions`, and warned about.
#[derive(Debug)]
pub struct GaussianFiles {
    label: String,
    dir: PathBuf,
    privilege: Privilege,
    color_space: Option<ColorSpace>,
}

impl GaussianFiles {
    pub(super) fn from_spec(spec: &MethodSpec) -> Result<Self, SpecError> {
        Ok(Self {
            label: spec.label.clone(),
            dir: spec.folder()?,
            privilege: spec.privilege(Privilege::DepthScale)?,
            color_space: spec
                .option("color_space")
                .map(str::parse)
                .transpose()
                .map_err(|error: UnknownColorSpace| spec.error(error.to_string()))?,
        })
    }

    fn find(&self, source: &str) -> Result<PathBuf, MethodError> {
        ["ply", "safetensors"]
            .iter()
            .map(|extension| self.dir.join(format!("{}.{extension}", path_of(source))))
            .find(|path| path.is_file())
            .ok_or_else(|| {
                let reason = "no Gaussians (looked for .ply and .safetensors)";
                MethodError::file(&self.dir.join(source), reason)
            })
    }
}

impl Method for GaussianFiles {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> MethodIdentity {
        let mut identity = MethodIdentity::new("gaussians", [("space", "camera".to_owned())]);
        if let Some(space) = self.color_space {
            let settings = &mut identity.settings;
            settings.insert("color_space".to_owned(), space.to_string());
        }
        identity
    }

    fn sources(&self) -> &'static str {
        fingerprints::FILES
    }

    fn input_files(&self, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        // Ids encode underscores that would form a second separator.
        let source = pair_id.split("__").next().unwrap_or(pair_id);
        Ok(vec![self.find(source)?])
    }

    fn privilege(&self) -> Privilege {
        self.privilege
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Gaussians(self)
    }
}

impl PredictGaussians for GaussianFiles {
    fn predict(&self, source: &SourceView) -> Result<GaussianPrediction, MethodError> {
        let path = self.find(source.name())?;
        let scene = gaussian_files::read(&path, self.color_space);
        let GaussianFile { gaussians, .. } =
            scene.map_err(|error| MethodError::Model(error.to_string()))?;
        let finite: Vec<usize> = (0..gaussians.len())
            .filter(|&k| gaussians.is_finite(k))
            .collect();
        if finite.is_empty() {
            return Err(MethodError::file(&path, "it holds no finite Gaussian"));
        }
        let zero = finite
            .iter()
            .filter(|&&k| gaussians.quaternions[k] == [0.0; 4]);
        let unusable = [gaussians.len() - finite.len(), zero.count()];
        let names = UNUSABLE.map(|(name, _)| name.to_owned());
        let counts = names
            .into_iter()
            .zip(unusable)
            .filter(|(_, count)| *count > 0);
        let extras = counts.map(|(name, count)| (name, count as f64)).collect();
        Ok(GaussianPrediction {
            gaussians,
            space: GaussianSpace::Camera,
            first_layer: None,
            extras,
        })
    }
}
