//! Tables for pandas, polars and notebooks.

use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// The values of a column; unknown values are null.
#[derive(Clone)]
pub(crate) enum Column {
    Text(Vec<Option<String>>),
    Number(Vec<Option<f64>>),
    Truth(Vec<bool>),
}

impl Column {
    pub(crate) fn text<'a>(values: impl Iterator<Item = &'a str>) -> Self {
        Self::Text(
            values
                .map(|text| (!text.is_empty()).then(|| text.to_owned()))
                .collect(),
        )
    }

    fn len(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::Number(values) => values.len(),
            Self::Truth(values) => values.len(),
        }
    }

    fn python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        match self {
            Self::Text(values) => PyList::new(py, values),
            Self::Number(values) => PyList::new(py, values),
            Self::Truth(values) => PyList::new(py, values),
        }
    }

    fn cell(&self, row: usize) -> String {
        match self {
            Self::Text(values) => values[row].clone().unwrap_or_default(),
            Self::Number(values) => {
                values[row].map_or_else(String::new, |value| format!("{value:.6}"))
            }
            Self::Truth(values) => values[row].to_string(),
        }
    }
}

/// Columns of equal length. ``pandas.DataFrame`` and ``polars.DataFrame`` take its ``to_dict()``.
#[pyclass(frozen, module = "sharp_bench")]
pub(crate) struct Table {
    columns: Vec<(String, Column)>,
}

/// Number of rows that a notebook shows at the start and at the end of a table.
const SHOWN: usize = 10;

impl Table {
    pub(crate) fn new(columns: Vec<(String, Column)>) -> Self {
        Self { columns }
    }
}

#[pymethods]
impl Table {
    #[getter]
    fn columns(&self) -> Vec<&str> {
        self.columns.iter().map(|(name, _)| name.as_str()).collect()
    }

    fn __len__(&self) -> usize {
        self.columns.first().map_or(0, |(_, column)| column.len())
    }

    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyList>> {
        match self.columns.iter().find(|(known, _)| known == name) {
            Some((_, column)) => column.python(py),
            None => Err(PyKeyError::new_err(format!(
                "there is no column {name:?}; there are {}",
                self.columns().join(", ")
            ))),
        }
    }

    /// Each column as a list; None for unknown values.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, column) in &self.columns {
            dict.set_item(name, column.python(py)?)?;
        }
        Ok(dict)
    }

    /// A pandas DataFrame.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let pandas = py.import("pandas")?;
        pandas.call_method1("DataFrame", (self.to_dict(py)?,))
    }

    /// A polars DataFrame.
    fn to_polars<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let polars = py.import("polars")?;
        polars.call_method1("DataFrame", (self.to_dict(py)?,))
    }

    fn __repr__(&self) -> String {
        format!(
            "Table of {} rows: {}",
            self.__len__(),
            self.columns().join(", ")
        )
    }

    fn _repr_html_(&self) -> String {
        let rows = self.__len__();
        let row = |tag: &str, cells: Vec<String>| {
            let cells = cells
                .iter()
                .map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell)));
            format!("<tr>{}</tr>", cells.collect::<String>())
        };
        let line = |at: usize| {
            row(
                "td",
                self.columns
                    .iter()
                    .map(|(_, column)| column.cell(at))
                    .collect(),
            )
        };
        let head = row(
            "th",
            self.columns().into_iter().map(str::to_owned).collect(),
        );
        let first = rows.min(SHOWN);
        let last = rows.saturating_sub(SHOWN).max(first);
        let gap = match last - first {
            0 => String::new(),
            more => format!(
                "<tr><td colspan={}>… {more} more …</td></tr>",
                self.columns.len()
            ),
        };
        let body: String = (0..first)
            .map(line)
            .chain([gap])
            .chain((last..rows).map(line))
            .collect();
        format!("<table><thead>{head}</thead><tbody>{body}</tbody></table>")
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}
