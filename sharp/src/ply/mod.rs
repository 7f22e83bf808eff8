//! Gaussian scenes and their PLY files: the SHARP release's form, the plain form for third-party viewers, and
//! PlayCanvas' compressed form. The reader also accepts files of other programs. [`table`] reads PLY files of any kind;
//! `gaussian_files` also reads other formats.
//!
//! Stored values are encoded: scales as natural logarithms, opacities as logits, colours as the constant term of
//! spherical harmonics, `(c − ½) / √(1 / 4π)`. [`StoredForm`] describes files with other encodings.

mod compressed;
mod decoded;
mod marks;
mod read;
mod reading;
mod suspicions;
pub mod table;
mod write;

use std::path::{Path, PathBuf};

use crate::camera::{CameraError, Intrinsics};
use crate::gaussians::Gaussians;
use table::TableError;

pub use compressed::to_compressed_bytes;
#[cfg(feature = "gaussian-files")]
pub(crate) use compressed::{completed, unit_quaternion};
pub use decoded::check_stored;
#[cfg(feature = "gaussian-files")]
pub(crate) use decoded::{Decoded, degree_of};
pub use marks::{FileMarks, Generator, SplatRenderMode};
pub use read::from_bytes;
#[cfg(feature = "render")]
pub(crate) use reading::setting;
pub use reading::{
    ColorSpace, Harmonics, Marks, StoredChannels, StoredColors, StoredForm, StoredOpacity,
    StoredQuaternions, StoredScales, UnknownReading,
};
pub use suspicions::{Suspicion, enormous_scale, suspicions};
#[cfg(feature = "gaussian-files")]
pub(crate) use write::srgb;
pub use write::{PlyForm, to_bytes};

/// √(1 / 4π), the value of the constant spherical harmonic.
pub(crate) const SH_CONSTANT: f32 = 0.282_094_79;

/// Vertex properties, in the order in which they are written.
const VERTEX: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
    "rot_0", "rot_1", "rot_2", "rot_3",
];

/// Gaussians and the other contents of their file.
#[derive(Debug, Clone, PartialEq)]
pub struct GaussianScene {
    /// The Gaussians in the space of the file; for SHARP, that is camera space in metres. Colours are in the blending
    /// colour space of `reading`; harmonics are only kept if that space is sRGB.
    pub gaussians: Gaussians,
    /// Camera from which the scene was predicted, if stored in the file.
    pub intrinsics: Option<Intrinsics>,
    /// Row-major 4×4 `camera_from_world`, if stored in the file.
    pub extrinsics: Option<[f32; 16]>,
    /// Colour encoding stated by the file, if any; the writer always stores sRGB.
    pub color_space: Option<ColorSpace>,
    /// Format version of the writing program; the SHARP release writes 1.5.0.
    pub version: Option<[u8; 3]>,
    /// Number of coefficients of view-dependent colour (`f_rest_*`) per Gaussian in the file: 9, 24, 45 or 72 for
    /// degrees 1 to 4.
    pub color_coefficients: usize,
    /// True if any coefficient of view-dependent colour is not zero.
    pub is_view_dependent: bool,
    /// The file's information about how it is meant to be rendered.
    pub marks: FileMarks,
    /// The encodings with which the numbers were read.
    pub reading: StoredForm,
    /// Doubts about the encodings with which the numbers were read.
    pub doubts: Vec<Suspicion>,
}

impl GaussianScene {
    /// A scene as produced by the predictor.
    pub fn new(gaussians: Gaussians, intrinsics: Intrinsics) -> Self {
        Self {
            gaussians,
            intrinsics: Some(intrinsics),
            extrinsics: None,
            color_space: Some(ColorSpace::Srgb),
            version: None,
            color_coefficients: 0,
            is_view_dependent: false,
            marks: FileMarks {
                generator: Some(Generator::Sharp),
                ..FileMarks::default()
            },
            reading: StoredForm::default(),
            doubts: Vec::new(),
        }
    }

    /// The stored camera, or the SHARP release's default for files without one: 640 × 480 pixels, focal length 512 px,
    /// principal point in the centre.
    pub fn intrinsics_or_default(&self) -> Intrinsics {
        self.intrinsics.unwrap_or(Intrinsics {
            fx: 512.0,
            fy: 512.0,
            cx: 320.0,
            cy: 240.0,
            width: 640,
            height: 480,
        })
    }

    /// Writes the scene to `path`.
    ///
    /// # Errors
    /// [`PlyError`] with the path and the operating system's reason.
    pub fn save(&self, path: &Path, form: PlyForm) -> Result<(), PlyError> {
        std::fs::write(path, to_bytes(self, form)).map_err(|e| PlyError::new(path, e.into()))
    }
}

/// An error in reading or writing a Gaussian scene.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct PlyError {
    pub path: PathBuf,
    #[source]
    pub reason: PlyReason,
}

impl PlyError {
    pub(crate) fn new(path: &Path, reason: PlyReason) -> Self {
        Self {
            path: path.to_owned(),
            reason,
        }
    }
}

/// Reasons that a file cannot be read as a Gaussian scene.
#[derive(Debug, thiserror::Error)]
pub enum PlyReason {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    Table(#[from] TableError),
    #[error("no Gaussians: there is no element `vertex`")]
    NoVertices,
    /// The vertices are not Gaussians: the listed properties are missing.
    #[error("no Gaussians: element `vertex` has no {}", .0.join(", "))]
    Missing(Vec<&'static str>),
    /// One of the SHARP release's extra elements has the wrong number of values or an unknown code.
    #[error("element `{element}`: {what}")]
    Extra { element: &'static str, what: String },
    #[error("stored camera: {0}")]
    Camera(#[from] CameraError),
    /// The file does not state its colour encoding; the wrong choice would distort colours.
    #[error(
        "the file does not say whether its colours are linear or sRGB-encoded; set color_space=linear, as the SHARP \
         release assumes, or color_space=srgb, as 3D Gaussian Splatting trains them"
    )]
    ColorSpaceUnknown,
    /// The file is in a recognised format other than the supported ones.
    #[error("not a file of Gaussians, but {0}")]
    Foreign(String),
    #[error("it is empty: nothing was written, or its download failed")]
    Empty,
    /// The format is not recognised.
    #[error("not a known format of Gaussians (PLY, SPZ, SOG, .splat)")]
    Unknown,
    /// A file in a format other than PLY is damaged.
    #[error("{format}: {what}")]
    Damaged { format: &'static str, what: String },
    /// The vertices are Gaussians in an unsupported form.
    #[error("{0}")]
    OtherForm(&'static str),
    #[error("it has {0} properties f_rest_*, but there must be 9, 24, 45 or 72, numbered from 0")]
    Degree(usize),
    #[error(
        "colours depend on the view ({0} coefficients f_rest_*), which `harmonics=refuse` does not allow"
    )]
    ViewDependent(usize),
    #[error(
        "colours depend on the view and are linear, which no rendering rule supports; `harmonics=drop` draws the \
         constant term only"
    )]
    LinearHarmonics,
    /// The Gaussians were made for another rendering rule.
    #[error("made for {0}; `marks=ignore` renders it like any other file")]
    OtherRule(String),
    #[error(
        "exported by nerfstudio without f_rest_*, so f_dc_* are logits of colours; use `colors=logit`, or \
         `colors=dc` to read them as coefficients"
    )]
    LogitColors,
    #[error(
        "{surplus} bytes follow the last row, {each} for each of {count} rows, so the rows are longer than the header \
         says and were misread; write the file again with all properties declared"
    )]
    LongerRows {
        surplus: usize,
        count: usize,
        each: usize,
    },
    /// A value is impossible in the given encoding.
    #[error("{what} is {value}: {advice}")]
    Impossible {
        what: &'static str,
        value: f32,
        advice: &'static str,
    },
    #[error("the file says that its colours are {stated}, but color_space={given} was given")]
    ColorSpaceContradicted {
        stated: ColorSpace,
        given: ColorSpace,
    },
}

#[cfg(test)]
mod tests;
