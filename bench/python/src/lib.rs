//! The evaluation core for Python: what `sharp_bench/__init__.py` stands on. Arrays and options are checked there; here are
//! the crossings between the two languages, each by the core's own names.

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

/// Says where the package's own files are, VGG16's weights among them.
#[pyfunction]
fn lies_in(folder: PathBuf) {
    sharp_metrics::weights::lies_in(folder);
}

/// The command line; its exit code.
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
    use crate::results::{Sweep, compare, load_scores, means_html, means_text};
    #[pymodule_export]
    use crate::table::Table;
    #[pymodule_export]
    use crate::views::{Camera, Dataset, Scene, View, bundled_data, datasets};
}
