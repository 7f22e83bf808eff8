//! The paper's explanatory experiments on pictures of one's own.
//!
//! * [`translation`]: how far each metric moves when a picture is shifted a little.

pub mod translation;
