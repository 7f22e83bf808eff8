//! Methods that predict a target view from a source view.
//!
//! * [`method`]: the traits, with their input and output.
//! * [`spec`]: an instance on the command line, `KIND[:key=value,…]`; [`kinds`]: builds instances
//!   from specs.
//! * [`trivial`]: `target`, `copy` and `mean`, as reference points for scores.
//! * [`depth_splat`]: the dataset's depth, splatted by SHARP's own initializer and composer.
//! * [`sharp`]: the SHARP network.
//! * [`gaussians`]: Gaussians of an external method; [`file_reading`]: how their files are read.
//!   `file_template`: paths of the files; `placement_file`: transforms of their Gaussians.
//! * [`imported`]: pictures of an external method; `crop_and_resize`: rules for cropped and smaller
//!   pictures; [`scale_sweep`]: pictures at several scales.
//! * [`command`]: an external program, queried pair by pair.

pub mod command;
mod crop_and_resize;
pub mod depth_splat;
pub mod file_reading;
mod file_template;
pub mod gaussians;
pub mod imported;
pub mod kinds;
pub mod method;
mod placement_file;
mod privilege;
pub mod scale_sweep;
pub mod sharp;
pub mod spec;
pub mod training_views;
pub mod trivial;

pub(crate) use crop_and_resize::{LOSSY, needs_kernel};
pub use gaussians::UNUSABLE;
pub use kinds::{BuiltMethod, KINDS, MethodKind, build};
pub use method::{
    Approach, Candidate, Closure, GaussianPrediction, GaussianSpace, Method, MethodError,
    MethodIdentity, PicturePrediction, PredictGaussians, PredictPicture, PredictScales, SourceView,
    TargetCamera,
};
pub use privilege::{Privilege, TrueDepth};
pub use scale_sweep::sweep_scales;
pub use spec::{MethodSpec, SpecError};

/// Maximum number of extras that a method may report; each becomes a table column.
pub const MAX_EXTRAS: usize = 32;
