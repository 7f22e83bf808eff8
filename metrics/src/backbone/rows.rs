//! Rows of a feature map held for the next layer.

use sharp_kernels::RowWindow;

/// Size of a feature map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Size {
    pub(crate) height: usize,
    pub(crate) width: usize,
    pub(crate) channels: usize,
}

impl Size {
    /// Values a row.
    pub(crate) fn row_len(self) -> usize {
        self.width * self.channels
    }
}

/// Rows of a feature map that are held until the next layer has used them. Memory is reused.
#[derive(Debug)]
pub(crate) struct Buffer {
    size: Size,
    first: usize,
    /// From row `first` on: row-major, channels innermost.
    data: Vec<f32>,
}

impl Buffer {
    pub(crate) fn new(size: Size) -> Self {
        Self {
            size,
            first: 0,
            data: Vec::new(),
        }
    }

    pub(crate) fn size(&self) -> Size {
        self.size
    }

    /// One past the last row that has been pushed.
    pub(crate) fn end(&self) -> usize {
        self.first + self.data.len() / self.size.row_len()
    }

    /// Room for `count` further rows, to be filled by the caller.
    pub(crate) fn push(&mut self, count: usize) -> &mut [f32] {
        let len = self.data.len();
        let more = count * self.size.row_len();
        self.data.reserve_exact(more);
        self.data.resize(len + more, 0.0);
        &mut self.data[len..]
    }

    /// Forgets the rows above `row`.
    pub(crate) fn drop_before(&mut self, row: usize) {
        let row = row.clamp(self.first, self.end());
        let gone = (row - self.first) * self.size.row_len();
        self.data.copy_within(gone.., 0);
        self.data.truncate(self.data.len() - gone);
        self.first = row;
    }

    /// The rows that are held.
    pub(crate) fn window(&self) -> RowWindow<'_> {
        let Size {
            height,
            width,
            channels,
        } = self.size;
        RowWindow::new(&self.data, self.first..self.end(), height, width, channels)
    }

    /// The values from row `first` on.
    pub(crate) fn rows_from(&self, first: usize) -> &[f32] {
        &self.data[(first - self.first) * self.size.row_len()..]
    }
}
