//! Who renders, and what happens when a device fails.
//!
//! * [`batch`]: one scene uploaded once, many views, and the CPU to take over from a device that fails.
//! * [`shared`]: the one renderer of a run, where nothing takes over: a backend never changes within a run.

pub mod batch;
pub mod shared;

pub use batch::BatchRenderer;
pub use shared::{RenderSettings, SharedRenderer};
