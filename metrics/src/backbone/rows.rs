//! Some consecutive rows of a feature map.

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

/// Rows `first..` of a feature map of size `size`: row-major, channels innermost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rows<'a> {
    pub(crate) size: Size,
    pub(crate) first: usize,
    pub(crate) data: &'a [f32],
}

impl<'a> Rows<'a> {
    /// Row `y` of the map.
    pub(crate) fn row(&self, y: usize) -> &'a [f32] {
        let len = self.size.row_len();
        &self.data[(y - self.first) * len..][..len]
    }
}

/// Rows of a feature map that are held until the next layer has used them. Memory is reused.
#[derive(Debug)]
pub(crate) struct Buffer {
    size: Size,
    first: usize,
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

    pub(crate) fn rows(&self) -> Rows<'_> {
        Rows {
            size: self.size,
            first: self.first,
            data: &self.data,
        }
    }

    /// The rows from `first` on.
    pub(crate) fn rows_from(&self, first: usize) -> Rows<'_> {
        Rows {
            size: self.size,
            first,
            data: &self.data[(first - self.first) * self.size.row_len()..],
        }
    }
}
