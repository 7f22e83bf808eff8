//! Figures of a paper from runs, in print.
//!
//! * [`catalogue`]: the list of figures, with what each shows and needs; [`from_runs`]: plots and sheets from results.
//! * [`sheet`]: pictures in rows and columns with text below and parts of them enlarged; [`qualitative`]: predictions side by
//!   side, as rows or as columns; [`choice`]: the pairs to show; [`failure`]: view and inverse depth; [`uncertainty`]: depth
//!   against that of the mirrored picture.
//! * [`fidelity_time`]: scores against seconds a pair.

pub mod catalogue;
pub mod choice;
pub mod failure;
pub mod fidelity_time;
pub mod from_runs;
pub mod qualitative;
pub mod sheet;
pub mod uncertainty;
