//! Compares stored pictures with photographs, to find what was done to them or to the dataset that they were made from.
//!
//! Scores do not depend on these checks. Poor predictions must not raise false alarms, so most findings are reported
//! only if nearly all pictures of a dataset or scene share them.
//!
//! * [`finding`], `measures`: what one picture's comparison yields, as its record stores it.
//! * One picture and its own target: `filled` (a background or holes of one colour, which other tests leave out),
//!   `change` (mirrored, other channels or levels), `layout` (bars, missing rows),
//!   `levels`, `placement` (panels, padding), `rearranged` (samples in other places), `framing` (zoom, roll, lens), `motion`
//!   (another pose), `shift`, `stamp` and `tone` (with `curve`).
//! * `order`: a `sample` of pictures and other targets than their own; `swapped` is about the source.
//! * What a `group` of pictures has in common: `agreement`, `camera`, and again `shift`, `stamp` and `tone`.

pub(crate) mod agreement;
pub(crate) mod camera;
pub(crate) mod change;
mod curve;
mod filled;
pub mod finding;
mod framing;
pub(crate) mod group;
mod layout;
mod levels;
pub(crate) mod measures;
mod motion;
pub(crate) mod order;
mod placement;
mod rearranged;
pub(crate) mod sample;
mod shift;
pub(crate) mod stamp;
mod swapped;
pub(crate) mod tone;
