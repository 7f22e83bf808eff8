//! Converts NumPy arrays, already checked and laid out by `sharp_bench/_arrays.py`, to the core's types and back.

use image::{ImageBuffer, Luma, Pixel, Rgb, RgbImage};
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2,
    PyReadonlyArray3,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use sharp_metrics::{Mask, Picture};

/// Converts a contiguous picture `[H, W, 3]`: `uint8` levels or `float32` in 0..1.
pub(crate) fn picture(array: &Bound<'_, PyAny>) -> PyResult<Picture> {
    if let Ok(levels) = array.extract::<PyReadonlyArray3<'_, u8>>() {
        return Ok(Picture::Rgb8(interleaved::<Rgb<u8>>(&levels)?));
    }
    match array.extract::<PyReadonlyArray3<'_, f32>>() {
        Ok(values) => Ok(Picture::RgbF32(interleaved::<Rgb<f32>>(&values)?)),
        Err(_) => Err(PyTypeError::new_err(
            "expected an array [H, W, 3] of uint8 or float32",
        )),
    }
}

fn interleaved<P: Pixel<Subpixel: Element>>(
    array: &PyReadonlyArray3<'_, P::Subpixel>,
) -> PyResult<ImageBuffer<P, Vec<P::Subpixel>>> {
    let (height, width, channels) = array.as_array().dim();
    let wrong =
        || PyValueError::new_err(format!("{height}×{width}×{channels}: expected [H, W, 3]"));
    let side = |n: usize| u32::try_from(n).map_err(|_| wrong());
    let values = array.as_slice()?.to_vec();
    if channels != 3 {
        return Err(wrong());
    }
    ImageBuffer::from_raw(side(width)?, side(height)?, values).ok_or_else(wrong)
}

/// Converts a mask `[H, W]` of bool.
pub(crate) fn mask(array: &PyReadonlyArray2<'_, bool>) -> PyResult<Mask> {
    let (height, width) = array.as_array().dim();
    let wrong = || PyValueError::new_err(format!("a mask of {height}×{width} is too large"));
    let side = |n: usize| u32::try_from(n).map_err(|_| wrong());
    let values = array.as_slice()?.to_vec();
    Mask::new(side(width)?, side(height)?, values).ok_or_else(wrong)
}

/// Converts an array `[K, N]` to `K` rows of `N` numbers each; errors call it `name`.
pub(crate) fn rows<const N: usize>(
    name: &str,
    array: &PyReadonlyArray2<'_, f32>,
) -> PyResult<Vec<[f32; N]>> {
    let (count, columns) = array.as_array().dim();
    if columns != N {
        return Err(PyValueError::new_err(format!(
            "{name}: expected [K, {N}], found {count}×{columns}"
        )));
    }
    let rows = array.as_array();
    let rows = rows.outer_iter();
    Ok(rows
        .map(|row| std::array::from_fn(|column| row[column]))
        .collect())
}

/// Converts rows to an array `[K, N]`.
pub(crate) fn from_rows<'py, const N: usize>(
    py: Python<'py>,
    rows: &[[f32; N]],
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), N])
}

/// Converts interleaved values to an array `[H, W, C]`, with `C = 1` for one channel.
pub(crate) fn from_values<'py, T: Element>(
    py: Python<'py>,
    values: Vec<T>,
    (width, height): (u32, u32),
) -> PyResult<Bound<'py, PyArray3<T>>> {
    let (width, height) = (width as usize, height as usize);
    let channels = values.len() / (width * height).max(1);
    values.into_pyarray(py).reshape([height, width, channels])
}

/// Converts values to an array `[H, W]`.
pub(crate) fn from_plane<'py, T: Element>(
    py: Python<'py>,
    values: Vec<T>,
    (width, height): (u32, u32),
) -> PyResult<Bound<'py, PyArray2<T>>> {
    values
        .into_pyarray(py)
        .reshape([height as usize, width as usize])
}

/// Converts a picture to an array `[H, W, 3]` of uint8.
pub(crate) fn from_rgb8(py: Python<'_>, image: RgbImage) -> PyResult<Bound<'_, PyArray3<u8>>> {
    let size = image.dimensions();
    from_values(py, image.into_raw(), size)
}

/// Converts a depth map to an array `[H, W]` of float32, in metres.
pub(crate) fn from_depth(
    py: Python<'_>,
    depth: ImageBuffer<Luma<f32>, Vec<f32>>,
) -> PyResult<Bound<'_, PyArray2<f32>>> {
    let size = depth.dimensions();
    from_plane(py, depth.into_raw(), size)
}
