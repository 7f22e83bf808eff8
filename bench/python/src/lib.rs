//! The Rust side of `sharp_bench/__init__.py`. Arrays and options are checked in Python; this crate converts between
//! the two languages under the core's own names.

mod arrays;
mod errors;
mod evaluate;
mod gaussians;
mod metrics;
mod pairs;
mod results;
mod table;
mod views;

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;

/// Sets the folders of the package's own files, such as VGG16's weights.
#[pyfunction]
fn lies_in(folders: Vec<PathBuf>) {
    sharp_metrics::weights::lies_in(folders);
}

/// Runs the command line and returns its exit code.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| sharp_bench::cli::main(arguments))
}

#[pymodule]
mod _sharp_bench {
    #[pymodule_export]
    use super::{lies_in, main};
    #[pymodule_export]
    use crate::errors::Error;
    #[pymodule_export]
    use crate::evaluate::{Source, Stop, evaluate};
    #[pymodule_export]
    use crate::gaussians::{Gaussians, Predictor, Rendering, render};
    #[pymodule_export]
    use crate::metrics::Scorer;
    #[pymodule_export]
    use crate::pairs::pairs;
    #[pymodule_export]
    use crate::results::{Sweep, load_scores, means_html, means_text};
    #[pymodule_export]
    use crate::table::Table;
    #[pymodule_export]
    use crate::views::{Camera, Dataset, Scene, View, bundled_data, datasets};
}
