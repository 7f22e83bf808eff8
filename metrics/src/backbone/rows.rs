//! Rows of a feature map buffered for the next layer.

use sharp_kernels::RowWindow;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct MapSize {
    pub(crate) height: usize,
    pub(crate) width: usize,
    pub(crate) channels: usize,
}

impl MapSize {
    pub(crate) fn row_len(self) -> usize {
        self.width * self.channels
    }
}

/// Memory blocks for new rows, passed from layer to layer. Their contents are irrelevant.
#[derive(Debug, Default)]
pub(crate) struct Blocks(Vec<Vec<f32>>);

impl Blocks {
    /// Returns a block of at least `len` values.
    fn take(&mut self, len: usize) -> Vec<f32> {
        let mut block = self.0.pop().unwrap_or_default();
        if block.len() < len {
            // Allocate a new block, because resizing would copy irrelevant values.
            block = vec![0.0; len];
        }
        block
    }

    fn give_back(&mut self, block: Vec<f32>) {
        if !block.is_empty() {
            self.0.push(block);
        }
    }
}

/// Rows of a feature map that the next layer still needs: the new rows in a borrowed block, and the
/// few older ones.
#[derive(Debug)]
pub(crate) struct Buffer {
    size: MapSize,
    first: usize,
    /// Rows from `first` on; row-major, channels innermost.
    kept: Vec<f32>,
    /// Block with the new rows, which follow those in `kept`; only its first `fresh_len` values are
    /// in use.
    fresh: Vec<f32>,
    fresh_len: usize,
}

impl Buffer {
    pub(crate) fn new(size: MapSize) -> Self {
        Self {
            size,
            first: 0,
            kept: Vec::new(),
            fresh: Vec::new(),
            fresh_len: 0,
        }
    }

    pub(crate) fn size(&self) -> MapSize {
        self.size
    }

    /// Index one past the last row that was pushed.
    pub(crate) fn end(&self) -> usize {
        self.first + (self.kept.len() + self.fresh_len) / self.size.row_len()
    }

    /// Returns space for `count` rows starting at [`Self::end`], for the caller to fill. Rows pushed earlier must
    /// already have been kept or dropped.
    pub(crate) fn push(&mut self, count: usize, blocks: &mut Blocks) -> &mut [f32] {
        self.fresh_len = count * self.size.row_len();
        self.fresh = blocks.take(self.fresh_len);
        &mut self.fresh[..self.fresh_len]
    }

    /// The rows of the last [`Self::push`].
    pub(crate) fn fresh(&self) -> &[f32] {
        &self.fresh[..self.fresh_len]
    }

    /// Keeps the rows from `row` on, drops those above, and gives the block of new rows back to `blocks`.
    pub(crate) fn keep_from(&mut self, row: usize, blocks: &mut Blocks) {
        let row = row.clamp(self.first, self.end());
        let gone = (row - self.first) * self.size.row_len();
        let kept = self.kept.len();
        self.kept.drain(..gone.min(kept));
        let fresh = &self.fresh[gone.saturating_sub(kept)..self.fresh_len];
        self.kept.reserve_exact(fresh.len());
        self.kept.extend_from_slice(fresh);
        self.first = row;
        self.fresh_len = 0;
        blocks.give_back(std::mem::take(&mut self.fresh));
    }

    pub(crate) fn window(&self) -> RowWindow<'_> {
        let MapSize {
            height,
            width,
            channels,
        } = self.size;
        let rows = self.first..self.end();
        RowWindow::in_two(&self.kept, self.fresh(), rows, height, width, channels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_stay_until_they_are_dropped() {
        let size = MapSize {
            height: 20,
            width: 1,
            channels: 2,
        };
        let (mut buffer, mut blocks) = (Buffer::new(size), Blocks::default());
        let mut next = 0.0;
        let mut push = |buffer: &mut Buffer, blocks: &mut Blocks, count: usize| {
            for pixel in buffer.push(count, blocks).chunks_exact_mut(2) {
                pixel.fill(next);
                next += 1.0;
            }
        };
        // Number of rows pushed, and the first row kept afterwards: one of the new rows, one of the
        // old ones, all rows.
        for (count, from) in [(5, 3), (4, 4), (2, 7), (1, 7), (3, 15)] {
            push(&mut buffer, &mut blocks, count);
            let (first, end) = (buffer.first, buffer.end());
            let window = buffer.window();
            assert_eq!(window.rows(), first..end);
            for y in first..end {
                assert_eq!(window.row(y), [y as f32; 2]);
            }
            buffer.keep_from(from, &mut blocks);
            assert_eq!((buffer.first, buffer.end()), (from.min(end), end));
        }
        assert_eq!(blocks.0.len(), 1);
    }
}
