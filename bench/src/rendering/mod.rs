//! Rendering backends, and recovery when a device fails.
//!
//! * [`batch`]: one scene uploaded once, many views, and a fallback to the CPU when the device fails.
//! * [`pose_alignment`]: a camera moved until the rendering fits a photograph.
//! * [`shared`]: the one renderer of a run, without a fallback: a backend never changes within a run.

pub mod batch;
pub mod pose_alignment;
pub mod shared;

pub use batch::BatchRenderer;
pub use shared::{RenderSettings, SharedRenderer};
