//! The paper's explanatory experiments, on any picture.
//!
//! * [`translation`]: how far each metric moves when a picture is shifted a little.

pub mod translation;
