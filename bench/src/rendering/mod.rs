//! Rendering backends, and recovery from device failures.
//!
//! * [`batch`]: many views of a scene that is uploaded once, with a fallback to the CPU.
//! * [`pose_alignment`]: moves a camera until the rendering fits a photograph.
//! * [`shared`]: the single renderer of a run, without a fallback: the backend never changes within a run.

pub mod batch;
pub mod pose_alignment;
pub mod shared;

pub use batch::BatchRenderer;
pub use shared::{RenderSettings, SharedRenderer};
