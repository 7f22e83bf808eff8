//! The interface of methods: input and output.
//!
//! A method sees the source view and the target's *camera*. It has no access to the target's photograph:
//!
//! ```compile_fail,E0599
//! use sharp_bench::methods::{MethodError, PicturePrediction, SourceView, TargetCamera};
//!
//! fn cheat(_: &SourceView, target: &TargetCamera) -> Result<PicturePrediction, MethodError> {
//!     Ok(target.image().clone().into())
//! }
//! ```
//!
//! It has access to the source's photograph:
//!
//! ```
//! use sharp_bench::methods::{MethodError, PicturePrediction, SourceView, TargetCamera};
//!
//! fn copy(source: &SourceView, _: &TargetCamera) -> Result<PicturePrediction, MethodError> {
//!     Ok(source.image().clone().into())
//! }
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use glam::DAffine3;
use image::RgbImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sharp::camera::{Intrinsics, RigidTransform};
use sharp::gaussians::Gaussians;
use sharp::render::Rule;
use sharp_datasets::{DatasetError, DepthMap};
use sharp_metrics::Picture;

use super::file_reading::FileReading;
use super::privilege::Privilege;
use super::spec::MethodSpec;
use crate::pairs::PosedCamera;
use crate::scoring::{Region, ScaleChooser};

/// The source view, a method's input.
#[derive(Debug, Clone, Copy)]
pub struct SourceView<'a> {
    name: &'a str,
    camera: &'a PosedCamera,
    image: &'a RgbImage,
    depth: Option<&'a DepthMap>,
}

impl<'a> SourceView<'a> {
    /// Creates a view. `name` is `dataset/scene/source`. `depth` must be `None` unless the method has the [`Privilege`]
    /// to see it.
    pub fn new(
        name: &'a str,
        camera: &'a PosedCamera,
        image: &'a RgbImage,
        depth: Option<&'a DepthMap>,
    ) -> Self {
        Self {
            name,
            camera,
            image,
            depth,
        }
    }

    /// `dataset/scene/source`, each part percent-encoded.
    pub fn name(&self) -> &'a str {
        self.name
    }

    pub fn camera(&self) -> &'a PosedCamera {
        self.camera
    }

    /// Intrinsics in pixels; pixel (i, j) has its centre at (i + 0.5, j + 0.5).
    pub fn intrinsics(&self) -> &'a Intrinsics {
        &self.camera.intrinsics
    }

    /// The photograph, 8-bit sRGB.
    pub fn image(&self) -> &'a RgbImage {
        self.image
    }

    /// Ground-truth z-depth in metres, 0 where unknown. `None` if the dataset has no depth, or the
    /// method does not have the [`Privilege`] to see it.
    pub fn depth(&self) -> Option<&'a DepthMap> {
        self.depth
    }
}

/// The target's camera, which is all that a method knows about the target.
#[derive(Debug, Clone, Copy)]
pub struct TargetCamera<'a> {
    pair_id: &'a str,
    camera: &'a PosedCamera,
}

impl<'a> TargetCamera<'a> {
    pub fn new(pair_id: &'a str, camera: &'a PosedCamera) -> Self {
        Self { pair_id, camera }
    }

    /// `dataset/scene/source__target`, each part percent-encoded.
    pub fn pair_id(&self) -> &'a str {
        self.pair_id
    }

    pub fn camera(&self) -> &'a PosedCamera {
        self.camera
    }

    /// Intrinsics in pixels; the prediction must have this width and height.
    pub fn intrinsics(&self) -> &'a Intrinsics {
        &self.camera.intrinsics
    }

    /// Width and height of the picture to predict, in pixels.
    pub fn size(&self) -> (u32, u32) {
        self.camera.size()
    }

    /// Maps points from the source camera's coordinates to this camera's, in metres.
    pub fn target_from_source(&self, source: &SourceView) -> RigidTransform {
        source.camera.to(self.camera)
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct PicturePrediction {
    /// sRGB picture of the target's size, or of [`Self::region`]'s.
    pub picture: Picture,
    /// The part of the target that the picture covers; `None` for all of it.
    pub region: Option<Region>,
    /// Size before resizing, pixels; `None` if not resized.
    pub resized_from: Option<(u32, u32)>,
    /// Extra values that the method reports; each becomes a column.
    pub extras: BTreeMap<String, f64>,
    /// One sentence for each conversion of the file that the user did not request. It names the setting that requests
    /// the conversion.
    pub notes: Vec<String>,
}

impl From<RgbImage> for PicturePrediction {
    fn from(image: RgbImage) -> Self {
        Self {
            picture: Picture::Rgb8(image),
            region: None,
            resized_from: None,
            extras: BTreeMap::new(),
            notes: Vec::new(),
        }
    }
}

/// A prediction at one of several scales of the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    pub scale: f64,
    pub prediction: PicturePrediction,
}

#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum GaussianSpace {
    /// The source's normalised space: the picture's edges are at ±1, z is in metres. Placed by E_t E_s⁻¹ K_s⁻¹.
    #[default]
    Normalized,
    /// A space with this affine map to the source camera's space, in metres.
    Camera(DAffine3),
}

impl GaussianSpace {
    /// The source camera's space itself, in metres.
    pub const CAMERA: Self = Self::Camera(DAffine3::IDENTITY);
}

/// Gaussians predicted from a source for all targets.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GaussianPrediction {
    /// Gaussians with colours in the rule's blending space.
    pub gaussians: Gaussians,
    /// Rendering rule; `None` for SHARP's rule under the run's settings.
    pub rule: Option<Rule>,
    pub space: GaussianSpace,
    /// The network's first depth layer, in metres, aligned to the true depth if the method has the [`Privilege`] to use
    /// it.
    pub first_layer: Option<DepthMap>,
    /// Extra values that the method reports; each becomes a column.
    pub extras: BTreeMap<String, f64>,
    /// How the file was read; `None` unless the Gaussians are from an external file.
    pub reading: Option<FileReading>,
    /// Warnings about how the file was read, by topic.
    pub warnings: BTreeMap<String, String>,
    /// Why this rendering rule was chosen; `None` if the file or the user stated it.
    pub rule_note: Option<String>,
}

/// Everything that a method's predictions depend on, apart from the pair itself. Printed as `kind(key=value,…)`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct MethodIdentity {
    /// The kind in `--method KIND`.
    pub kind: String,
    /// SHA-256 of weights, and values of options. Paths are excluded, so that moved files stay valid.
    pub settings: BTreeMap<String, String>,
}

impl MethodIdentity {
    /// Key of the setting that states by which metric the best of several scales is chosen. Methods that predict a single
    /// scale do not have this setting.
    pub const CHOSEN_BY: &str = "chosen_by";

    pub fn new<const N: usize>(kind: &str, settings: [(&str, String); N]) -> Self {
        let settings = settings.into_iter();
        Self {
            kind: kind.to_owned(),
            settings: settings.map(|(k, v)| (k.to_owned(), v)).collect(),
        }
    }
}

impl fmt::Display for MethodIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.kind)?;
        if self.settings.is_empty() {
            return Ok(());
        }
        let settings: Vec<String> = self
            .settings
            .iter()
            .map(|(k, v)| format!("{k}={v}"))
            .collect();
        write!(f, "({})", settings.join(","))
    }
}

/// Why a method failed on a pair. The failure is recorded, and the run continues with the other pairs.
#[derive(Debug, Clone, thiserror::Error)]
pub enum MethodError {
    #[error("{view}: {reason}")]
    Unsuitable { view: String, reason: String },
    #[error("{}: {reason}", path.display())]
    File { path: PathBuf, reason: String },
    #[error("'{run}': {reason}")]
    Program { run: String, reason: String },
    /// An error in the network, a Gaussian file, or another part of the method.
    #[error("{0}")]
    Model(String),
}

impl MethodError {
    pub(super) fn file(path: &Path, reason: impl ToString) -> Self {
        Self::File {
            path: path.to_owned(),
            reason: reason.to_string(),
        }
    }

    pub(super) fn unsuitable(view: &str, reason: impl ToString) -> Self {
        Self::Unsuitable {
            view: view.to_owned(),
            reason: reason.to_string(),
        }
    }
}

impl From<DatasetError> for MethodError {
    fn from(error: DatasetError) -> Self {
        Self::Model(error.to_string())
    }
}

/// A way to predict a target view from a source view.
pub trait Method: Send + Sync {
    /// Value of the `method` column.
    fn label(&self) -> &str;

    /// Everything about this instance that its predictions depend on.
    fn identity(&self) -> MethodIdentity;

    /// Hash of the predicting code, so that predictions are renewed when the code changes; see
    /// [`fingerprints`](crate::io::fingerprints). External methods have a version in their identity instead.
    fn sources(&self) -> &'static str {
        ""
    }

    fn privilege(&self) -> Privilege {
        Privilege::NONE
    }

    /// Whether a pair's source and target are among the views that the method was trained on; `None` if unknown.
    fn trained_on(&self, _pair_id: &str) -> Option<[bool; 2]> {
        None
    }

    /// Warnings about the method's options, one sentence each, without the label.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// Files that belong to the method, not to the dataset, and that the prediction for this pair depends on.
    fn input_files(&self, _pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        Ok(Vec::new())
    }

    /// Checks, before the first prediction, that the method's files for these pairs exist.
    ///
    /// # Errors
    /// If no file is at its expected place, but files are at another place, which the error names.
    fn check_files(&self, _pair_ids: &BTreeSet<String>) -> Result<(), String> {
        Ok(())
    }

    /// Called once before the first prediction of a run. `logs` is the folder for logs, which is created on demand;
    /// `scratch_in` is the folder for [`scratch_folder`](crate::io::atomic_files::scratch_folder)s.
    fn begin(&self, _logs: &Path, _scratch_in: &Path) {}

    fn approach(&self) -> Approach<'_>;
}

pub enum Approach<'a> {
    Pictures(&'a dyn PredictPicture),
    Gaussians(&'a dyn PredictGaussians),
    /// Pictures at several scales of the scene; the best is scored.
    Scales(&'a dyn PredictScales),
    /// The ground truth itself, for a self-test of the whole pipeline. The method's own code does not see it.
    Target,
}

pub trait PredictPicture: Sync {
    /// Predicts the picture taken by the target's camera.
    fn predict(
        &self,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<PicturePrediction, MethodError>;
}

pub trait PredictGaussians: Sync {
    /// Whether each target needs its own Gaussians. By default, a source's Gaussians serve all targets, and the method
    /// is not given the target.
    fn needs_target(&self) -> bool {
        false
    }

    /// Predicts the Gaussians of a source. `target` is `None` unless [`Self::needs_target`].
    fn predict(
        &self,
        source: &SourceView,
        target: Option<&TargetCamera>,
    ) -> Result<GaussianPrediction, MethodError>;
}

/// Predicts pictures at several scales of the scene.
pub trait PredictScales: Sync {
    /// Predicts the target's picture at every scale.
    ///
    /// # Errors
    /// If a picture is missing or unusable, or the pictures cover different parts of the target.
    fn predict(
        &self,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<Vec<Candidate>, MethodError>;

    /// Chooses the best scale by comparing pictures with the target.
    fn chooser(&self) -> &ScaleChooser;
}

/// A function as a method.
pub struct Closure<F> {
    label: String,
    identity: MethodIdentity,
    sources: &'static str,
    predict: F,
}

impl<F> Closure<F>
where
    F: Fn(&SourceView, &TargetCamera) -> Result<PicturePrediction, MethodError> + Send + Sync,
{
    /// Wraps a function. Its code cannot be hashed, so changes of the code need a new `version` to take effect.
    pub fn new(label: impl Into<String>, version: impl Into<String>, predict: F) -> Self {
        Self {
            label: label.into(),
            identity: MethodIdentity::new("closure", [("version", version.into())]),
            sources: "",
            predict,
        }
    }

    /// Wraps a method of this crate, whose code is hashed.
    pub(super) fn built_in(
        spec: &MethodSpec,
        identity: MethodIdentity,
        sources: &'static str,
        predict: F,
    ) -> Self {
        Self {
            label: spec.label.clone(),
            identity,
            sources,
            predict,
        }
    }
}

impl<F> Method for Closure<F>
where
    F: Fn(&SourceView, &TargetCamera) -> Result<PicturePrediction, MethodError> + Send + Sync,
{
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> MethodIdentity {
        self.identity.clone()
    }

    fn sources(&self) -> &'static str {
        self.sources
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Pictures(self)
    }
}

impl<F> PredictPicture for Closure<F>
where
    F: Fn(&SourceView, &TargetCamera) -> Result<PicturePrediction, MethodError> + Sync,
{
    fn predict(
        &self,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<PicturePrediction, MethodError> {
        (self.predict)(source, target)
    }
}
