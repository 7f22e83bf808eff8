//! Converts errors to Python exceptions.

use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyValueError};
use sharp_bench::io::text::{one_line, visible_line};

create_exception!(
    sharp_bench,
    Error,
    PyException,
    "A file, dataset or run that cannot be read, computed or finished. The message names the file and the reason."
);

fn line(error: impl Into<anyhow::Error>) -> String {
    visible_line(&one_line(&error.into())).into_owned()
}

/// An error caused by a file, a dataset or a run: `sharp_bench.Error`.
pub(crate) fn failed(error: impl Into<anyhow::Error>) -> PyErr {
    Error::new_err(line(error))
}

/// An error caused by the caller's arguments: `ValueError`.
pub(crate) fn refused(error: impl Into<anyhow::Error>) -> PyErr {
    PyValueError::new_err(line(error))
}
