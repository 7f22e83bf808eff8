//! Methods predict a target view from a source view.
//!
//! * [`spec`]: what the command line says, `KIND[:key=value,…]`.
//! * [`truth`]: what predictions of a target are scored against.
//! * [`method`]: the trait, its input and its output.
//! * [`trivial`]: `target`, `copy` and `mean`, the ends of the scale.
//! * [`depth_splat`]: the dataset's depth, splatted by SHARP's own initializer, composer and renderer.
//! * [`sharp`]: the SHARP network.
//! * [`gaussians`]: Gaussians that someone else's method predicted, rendered by us.
//! * [`imported`]: pictures that someone else's method made; `fit`: what becomes of smaller and cropped ones;
//!   [`scale_sweep`]: the best of several scales.
//! * [`command`]: someone's program, asked pair by pair.
//! * [`mod@build`]: from specs to instances.

pub mod build;
pub mod command;
pub mod depth_splat;
mod fit;
pub mod gaussians;
pub mod imported;
pub mod method;
pub mod scale_sweep;
pub mod sharp;
pub mod spec;
mod splat;
pub mod trivial;
pub mod truth;

pub use build::{KINDS, KindInfo, build};
pub use method::{Method, MethodError, PairInput, Prediction};
pub use spec::{MethodSpec, SpecError};
pub use truth::Truth;
