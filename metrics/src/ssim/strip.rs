//! The rows under the window as it moves down the picture.

use std::ops::Range;

use super::filter::{Constants, QUANTITIES, filter_along_x, filter_along_y, padded};
use super::spec::SsimSpec;
use super::variant::SsimBorder;
use crate::picture::Picture;

/// The last 2 × radius + 1 rows of some columns, filtered along x, as one task moves down the picture.
///
/// If the picture is padded, rows and columns are counted from the padded origin, one radius above and to the left of
/// the picture's. Row 0 is then the first row needed for the map's first row.
pub(super) struct Strip<'a> {
    form: &'a SsimSpec,
    pictures: [&'a Picture; 2],
    height: usize,
    /// First column under the windows.
    first: usize,
    /// Columns under the windows, relative to `first`, that are inside the picture.
    inside: Range<usize>,
    /// Number of values in a row of the map.
    values: usize,
    /// Length of a filtered row: `values`, rounded up to whole blocks.
    length: usize,
    /// 2 × radius + 1 slots, each with one row per quantity.
    ring: Vec<f64>,
    /// The quantities of one row before filtering, including the border.
    quantities: [Vec<f64>; QUANTITIES],
    /// Buffer for a row as read from the picture.
    rgb: Vec<f64>,
    /// Buffer for a row of the map.
    row: Vec<f64>,
}

impl<'a> Strip<'a> {
    /// Creates the strip that computes the given `columns` of the map.
    pub(super) fn new(
        form: &'a SsimSpec,
        a: &'a Picture,
        b: &'a Picture,
        columns: Range<usize>,
    ) -> Self {
        let (width, height) = a.dimensions();
        let channels = form.channels();
        let values = columns.len() * channels;
        let length = padded(values);
        let unfiltered = length + 2 * form.radius * channels;
        let continued = form.margin() + width as usize;
        let inside = form.margin().saturating_sub(columns.start)
            ..(columns.end + 2 * form.radius).min(continued) - columns.start;
        Self {
            form,
            pictures: [a, b],
            height: height as usize,
            first: columns.start,
            rgb: vec![0.0; 3 * inside.len()],
            inside,
            values,
            length,
            ring: vec![0.0; (2 * form.radius + 1) * form.quantities() * length],
            quantities: std::array::from_fn(|_| vec![0.0; unfiltered]),
            row: vec![0.0; length],
        }
    }

    fn slot(&self, row: usize) -> Range<usize> {
        let size = self.form.quantities() * self.length;
        let slot = row % (2 * self.form.radius + 1);
        slot * size..(slot + 1) * size
    }

    /// Filters row `row` along x and stores it in its slot.
    pub(super) fn push(&mut self, row: usize) {
        let slot = self.slot(row);
        let margin = self.form.margin();
        let source = match (row.checked_sub(margin), self.form.form.border) {
            (Some(y), _) if y < self.height => y,
            (_, SsimBorder::Zero) => {
                self.ring[slot].fill(0.0);
                return;
            }
            (Some(y), _) => 2 * (self.height - 1) - y,
            (None, _) => margin - row,
        };
        let channels = self.form.channels();
        let Range { start, end } = self.inside;
        for (picture, row) in self.pictures.into_iter().zip(&mut self.quantities) {
            picture.row_f64(self.first + start - margin, source, &mut self.rgb);
            let inner = &mut row[start * channels..end * channels];
            if self.form.form.gray {
                for (gray, rgb) in inner.iter_mut().zip(self.rgb.chunks_exact(3)) {
                    *gray = 0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2];
                }
            } else {
                inner.copy_from_slice(&self.rgb);
            }
            if self.form.form.border == SsimBorder::Reflect {
                let all = self.values / channels + 2 * margin;
                let pixel = |x: usize| x * channels..(x + 1) * channels;
                for x in 0..start {
                    row.copy_within(pixel(2 * start - x), x * channels);
                }
                for x in end..all {
                    row.copy_within(pixel(2 * (end - 1) - x), x * channels);
                }
            }
        }
        let [a, b, squares, products, squares_a] = &mut self.quantities;
        for (((a, b), square), product) in a.iter().zip(b.iter()).zip(squares).zip(products) {
            *square = a * a + b * b;
            *product = a * b;
        }
        if self.form.quantities() == QUANTITIES {
            for (a, square) in a.iter().zip(squares_a) {
                *square = a * a;
            }
        }
        let slot = &mut self.ring[slot];
        for (quantity, out) in self
            .quantities
            .iter()
            .zip(slot.chunks_exact_mut(self.length))
        {
            filter_along_x(quantity, &self.form.half, channels, out);
        }
    }

    /// Filters along y and computes the map's row `y`; rows `y` to `y + 2 radius` must have been pushed.
    pub(super) fn map_row(&mut self, y: usize, constants: Constants) -> &[f64] {
        let (taps, size) = (
            2 * self.form.radius + 1,
            self.form.quantities() * self.length,
        );
        let slots: Vec<&[f64]> = self.ring.chunks_exact(size).collect();
        let rows: Vec<&[f64]> = (y..y + taps).map(|row| slots[row % taps]).collect();
        filter_along_y(&rows, &self.form.half, constants, &mut self.row);
        &self.row[..self.values]
    }
}
