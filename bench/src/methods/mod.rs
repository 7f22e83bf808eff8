//! Methods predict a target view from a source view.
//!
//! * [`method`]: the traits, with their input and output.
//! * [`spec`]: an instance on the command line, `KIND[:key=value,…]`; [`kinds`]: builds instances from specs.
//! * [`trivial`]: `target`, `copy` and `mean`, the ends of the scale.
//! * [`depth_splat`]: the dataset's depth, splatted by SHARP's own initializer and composer.
//! * [`sharp`]: the SHARP network.
//! * [`gaussians`]: Gaussians that someone else's method predicted; [`file_reading`]: how their files are read.
//!   `file_template`: where they lie; `placement_file`: where their Gaussians do.
//! * [`imported`]: pictures that someone else's method made; `crop_and_resize`: rules for cropped and smaller
//!   ones; [`scale_sweep`]: pictures at several scales.
//! * [`command`]: someone's program, asked pair by pair.

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

/// Limit of the names that a method reports about its predictions: each is a column of tables.
pub const MOST_EXTRAS: usize = 32;
