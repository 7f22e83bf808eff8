//! Strips of an image, and the interface shared by all kernels that process them.

use std::ops::Range;

/// Some consecutive rows of an NHWC image. The window may cover only part of the image; padding applies at the image's
/// borders, not at the window's.
#[derive(Debug, Clone)]
pub struct RowWindow<'a> {
    /// The first rows of the window.
    head: &'a [f32],
    /// The remaining rows of the window.
    tail: &'a [f32],
    /// Image row at which `tail` begins.
    split: usize,
    rows: Range<usize>,
    height: usize,
    width: usize,
    channels: usize,
}

impl<'a> RowWindow<'a> {
    /// Creates a window on the `rows` of an image of `height` × `width` × `channels`, whose values are `data`.
    ///
    /// # Panics
    /// If `data` has another length, or the rows lie outside the image.
    pub fn new(
        data: &'a [f32],
        rows: Range<usize>,
        height: usize,
        width: usize,
        channels: usize,
    ) -> Self {
        Self::in_two(&[], data, rows, height, width, channels)
    }

    /// Like [`new`](Self::new), for rows in two slices: the rows of `tail` follow the rows of
    /// `head`. Thus, rows kept from the previous strip need not be copied next to the new ones.
    ///
    /// # Panics
    /// If the total length is wrong, `head` ends within a row, or the rows lie outside the image.
    pub fn in_two(
        head: &'a [f32],
        tail: &'a [f32],
        rows: Range<usize>,
        height: usize,
        width: usize,
        channels: usize,
    ) -> Self {
        assert!(
            rows.start <= rows.end && rows.end <= height,
            "rows {rows:?} of {height}"
        );
        let row = width * channels;
        assert_eq!(
            head.len() + tail.len(),
            rows.len() * row,
            "{} rows of {width} x {channels}",
            rows.len()
        );
        assert!(head.is_empty() || head.len().is_multiple_of(row));
        let split = rows.start + head.len().checked_div(row).unwrap_or(0);
        Self {
            head,
            tail,
            split,
            rows,
            height,
            width,
            channels,
        }
    }

    /// Creates a window that covers a whole image.
    ///
    /// # Panics
    /// If the length of `data` is not `height` × `width` × `channels`.
    pub fn whole(data: &'a [f32], height: usize, width: usize, channels: usize) -> Self {
        Self::new(data, 0..height, height, width, channels)
    }

    /// Range of image rows in the window.
    pub fn rows(&self) -> Range<usize> {
        self.rows.clone()
    }

    /// Height of the whole image.
    pub fn height(&self) -> usize {
        self.height
    }

    pub fn width(&self) -> usize {
        self.width
    }

    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Row `y` of the image, `[width][channels]`.
    ///
    /// # Panics
    /// If the row is not in the window.
    pub fn row(&self, y: usize) -> &'a [f32] {
        assert!(self.rows.contains(&y), "row {y} of {:?}", self.rows);
        let len = self.width * self.channels;
        let (rows, first) = if y < self.split {
            (self.head, self.rows.start)
        } else {
            (self.tail, self.split)
        };
        &rows[(y - first) * len..][..len]
    }

    /// Panics unless the window contains `rows`.
    pub(crate) fn expect_rows(&self, rows: &Range<usize>) {
        assert!(
            rows.is_empty() || (self.rows.start <= rows.start && rows.end <= self.rows.end),
            "rows {rows:?} are needed, but the window has {:?}",
            self.rows
        );
    }
}

/// A kernel that can compute any range of its output rows from the input rows they depend on.
///
/// Results are bit-identical however the image is cut into strips.
pub trait RowOp: Send + Sync {
    /// Height and width of the output for an input of `height` × `width`; zero if the input is smaller than one window.
    fn out_size(&self, height: usize, width: usize) -> (usize, usize);

    fn out_channels(&self, in_channels: usize) -> usize;

    /// Input rows that the output rows `out` depend on, for an image of `in_height` rows. Clamped
    /// to the image.
    ///
    /// Winograd convolutions work on blocks of four output rows that start at multiples of four,
    /// and need the input of whole blocks. To avoid computing rows twice, cut strips at multiples
    /// of four.
    fn in_rows(&self, out: Range<usize>, in_height: usize) -> Range<usize>;

    /// Writes the output rows `out` to `output` as `[row][column][channel]`.
    ///
    /// # Panics
    /// If the window does not contain [`Self::in_rows`], `out` exceeds the output's height, or a length or channel
    /// count is wrong.
    fn run_rows(&self, input: &RowWindow<'_>, out: Range<usize>, output: &mut [f32]);
}

/// Checks the preconditions of every [`RowOp::run_rows`]; returns the output's width.
pub(crate) fn expect(
    op: &impl RowOp,
    input: &RowWindow<'_>,
    out: &Range<usize>,
    output: &[f32],
) -> usize {
    let (height, width) = op.out_size(input.height(), input.width());
    assert!(
        out.start <= out.end && out.end <= height,
        "output rows {out:?} of {height}"
    );
    input.expect_rows(&op.in_rows(out.clone(), input.height()));
    let len = out.len() * width * op.out_channels(input.channels());
    assert_eq!(output.len(), len, "length of the output");
    width
}

/// Input rows of a window operation: `size` rows per output row, every `stride` rows, with `padding` rows of border.
pub(crate) fn window_rows(
    out: Range<usize>,
    in_height: usize,
    size: usize,
    stride: usize,
    padding: usize,
) -> Range<usize> {
    if out.is_empty() {
        return 0..0;
    }
    let start = (out.start * stride).saturating_sub(padding).min(in_height);
    let end = ((out.end - 1) * stride + size).saturating_sub(padding);
    start..end.clamp(start, in_height)
}
