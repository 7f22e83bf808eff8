//! Figures of a paper, made from runs, in print quality.
//!
//! * [`catalogue`]: the list of figures, with contents and requirements; [`from_runs`]: makes plots and sheets from
//!   results.
//! * [`sheet`], `sheet_drawing`: pictures in rows and columns, with text below and enlarged parts; [`qualitative`]:
//!   predictions side by side, as rows or as columns; [`choice`]: the pairs to show; [`failure`]: view and inverse
//!   depth; [`uncertainty`]: depth of a picture compared with depth of its mirror image.
//! * [`fidelity_time`]: scores against seconds per pair.

pub mod catalogue;
pub mod choice;
pub mod failure;
pub mod fidelity_time;
pub mod from_runs;
pub mod qualitative;
pub mod sheet;
mod sheet_drawing;
pub mod uncertainty;
