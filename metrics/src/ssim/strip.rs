//! The rows under the window as it walks down the picture.

use super::filter::{Constants, QUANTITIES, filter_along_x, filter_along_y, padded};
use super::variant::{Border, Form};
use crate::picture::Picture;

/// The last 2 × radius + 1 rows, filtered along x, as one task walks down the picture.
///
/// Rows are counted as of the picture continued by a radius above: row 0 is the first that the
/// map's first row needs.
pub(super) struct Strip<'a> {
    form: &'a Form,
    pictures: [&'a Picture; 2],
    width: usize,
    height: usize,
    /// Length of a filtered row: padded map width × channels.
    length: usize,
    /// 2 × radius + 1 slots of `QUANTITIES` rows.
    ring: Vec<f64>,
    /// The four quantities of one row before filtering, border included.
    quantities: [Vec<f64>; QUANTITIES],
    /// A row as it comes from the picture.
    rgb: Vec<f64>,
}

impl<'a> Strip<'a> {
    pub(super) fn new(form: &'a Form, a: &'a Picture, b: &'a Picture, map_width: usize) -> Self {
        let (width, height) = a.dimensions();
        let channels = form.channels();
        let length = padded(map_width * channels);
        let unfiltered = length + 2 * form.radius * channels;
        Self {
            form,
            pictures: [a, b],
            width: width as usize,
            height: height as usize,
            length,
            ring: vec![0.0; (2 * form.radius + 1) * QUANTITIES * length],
            quantities: std::array::from_fn(|_| vec![0.0; unfiltered]),
            rgb: vec![0.0; 3 * width as usize],
        }
    }

    fn slot(&self, row: usize) -> std::ops::Range<usize> {
        let size = QUANTITIES * self.length;
        let slot = row % (2 * self.form.radius + 1);
        slot * size..(slot + 1) * size
    }

    /// Filters row `row` along x into its slot.
    pub(super) fn push(&mut self, row: usize) {
        let slot = self.slot(row);
        let margin = match self.form.border {
            Border::Valid => 0,
            Border::Zero | Border::Reflect => self.form.radius,
        };
        let source = match (row.checked_sub(margin), self.form.border) {
            (Some(y), _) if y < self.height => y,
            (_, Border::Zero) => {
                self.ring[slot].fill(0.0);
                return;
            }
            (Some(y), _) => 2 * (self.height - 1) - y,
            (None, _) => margin - row,
        };
        let channels = self.form.channels();
        for i in 0..2 {
            self.pictures[i].row_f64(source, &mut self.rgb);
            let inner = &mut self.quantities[i][margin * channels..][..self.width * channels];
            if self.form.gray {
                for (gray, rgb) in inner.iter_mut().zip(self.rgb.chunks_exact(3)) {
                    *gray = 0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2];
                }
            } else {
                inner.copy_from_slice(&self.rgb);
            }
            if self.form.border == Border::Reflect {
                for x in 1..=margin {
                    for c in 0..channels {
                        let at = |x: usize| x * channels + c;
                        let row = &mut self.quantities[i];
                        row[at(margin - x)] = row[at(margin + x)];
                        let last = margin + self.width - 1;
                        row[at(last + x)] = row[at(last - x)];
                    }
                }
            }
        }
        let [a, b, squares, products] = &mut self.quantities;
        for (((a, b), square), product) in a.iter().zip(b.iter()).zip(squares).zip(products) {
            *square = a * a + b * b;
            *product = a * b;
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

    /// Filters along y and forms the map's row `y`; rows `y` to `y + 2 radius` have been pushed.
    pub(super) fn map_row(&self, y: usize, constants: Constants, out: &mut [f64]) {
        let taps = 2 * self.form.radius + 1;
        let rows: Vec<&[f64]> = (0..taps).map(|k| &self.ring[self.slot(y + k)]).collect();
        filter_along_y(&rows, &self.form.half, constants, out);
    }
}
