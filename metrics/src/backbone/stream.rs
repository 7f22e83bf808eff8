//! Both pictures through a network, strip by strip, in lockstep.
//!
//! Each layer keeps just the rows that its next output rows need, so memory grows with the
//! picture's width and the strip's height but not with the picture's height. Deep layers, which
//! get few rows from a strip, wait for more: their weights are larger than any cache and should
//! not be read for a handful of rows. Every output row is computed once, from the same inputs by
//! the same operations, whatever the strip's height: the results are the same bits.

use std::ops::Range;

use sharp_kernels::Workspace;

use super::network::{Layer, Network};
use super::rows::{Blocks, Buffer, Size};

/// Rows of the features of both pictures at one tap.
#[derive(Clone, Copy)]
pub(crate) struct Taps<'a> {
    /// Which tap of the network, from 0.
    pub(crate) tap: usize,
    /// Size of the whole feature map.
    pub(crate) size: Size,
    /// The next rows of the prediction's and of the target's features, top to bottom.
    pub(crate) rows: [&'a [f32]; 2],
}

/// Memory that the new rows of both pictures may take together, one layer's input and output at a
/// time, where the strip's height is not given.
const MEMORY: usize = 64 << 20;

/// Rows that a layer with weights waits for, unless strips are smaller.
const BATCH: usize = 16;

/// One picture on its way through the network: the rows held of the picture and of each layer's
/// output.
struct Passage {
    buffers: Vec<Buffer>,
    blocks: Blocks,
    workspace: Workspace,
}

/// Runs a network over two pictures of size `width` × `height`.
///
/// `input(picture, row, values)` writes a row (channels innermost) as the network takes it. `each`
/// gets the features of every tap, rows from top to bottom. `strip` is the number of picture rows
/// taken at once, by default what fits into a fixed amount of memory. Returns the sizes of the
/// taps, or `None` (and does nothing) if the pictures are too small.
pub(crate) fn stream(
    network: &Network,
    (width, height): (usize, usize),
    strip: Option<usize>,
    input: impl Fn(usize, usize, &mut [f32]) + Sync,
    mut each: impl FnMut(Taps),
) -> Option<Vec<Size>> {
    let sizes = network.sizes(width, height)?;
    let strip = strip.unwrap_or_else(|| default_strip(&sizes)).max(1);
    let batch = BATCH.min(strip);
    let [mut a, mut b] = [0, 1].map(|_| Passage {
        buffers: sizes.iter().map(|&size| Buffer::new(size)).collect(),
        blocks: Blocks::default(),
        workspace: Workspace::new(),
    });
    for first in (0..height).step_by(strip) {
        let rows = first..(first + strip).min(height);
        let fill = |picture: usize, passage: &mut Passage| {
            let out = passage.buffers[0].push(rows.len(), &mut passage.blocks);
            for (y, out) in rows.clone().zip(out.chunks_exact_mut(sizes[0].row_len())) {
                input(picture, y, out);
            }
        };
        rayon::join(|| fill(0, &mut a), || fill(1, &mut b));
        for (i, layer) in network.layers.iter().enumerate() {
            let (rows, _) =
                rayon::join(|| a.advance(layer, i, batch), || b.advance(layer, i, batch));
            if let Some(tap) = layer.tap
                && !rows.is_empty()
            {
                each(Taps {
                    tap,
                    size: sizes[i + 1],
                    rows: [&a, &b].map(|picture| picture.buffers[i + 1].fresh()),
                });
            }
        }
        for picture in [&mut a, &mut b] {
            if let Some(last) = picture.buffers.last_mut() {
                last.keep_from(last.end(), &mut picture.blocks);
            }
        }
    }
    let outputs = network.layers.iter().zip(&sizes[1..]);
    let tapped = outputs.filter(|(layer, _)| layer.tap.is_some());
    Some(tapped.map(|(_, &size)| size).collect())
}

impl Passage {
    /// Computes those rows of layer `i` for which there is input, if they are at least `batch` or
    /// the last; returns which ones.
    fn advance(&mut self, layer: &Layer, i: usize, batch: usize) -> Range<usize> {
        let [input, output] = &mut self.buffers[i..i + 2] else {
            return 0..0;
        };
        let (height, size) = (input.size().height, output.size());
        let first = output.end();
        let needs = |y: usize| layer.op.in_rows(y..y + 1, height);
        let mut end = first;
        while end < size.height && needs(end).end <= input.end() {
            end += 1;
        }
        if end < size.height && end - first < batch && !layer.pools {
            end = first;
        }
        if end > first {
            let window = input.window();
            let room = output.push(end - first, &mut self.blocks);
            layer
                .op
                .run_rows(&window, first..end, room, &mut self.workspace);
        }
        let row = if end < size.height {
            needs(end).start
        } else {
            input.end()
        };
        input.keep_from(row, &mut self.blocks);
        first..end
    }
}

/// The picture rows whose new rows in any layer fit into [`MEMORY`], a multiple of [`BATCH`].
pub(super) fn default_strip(sizes: &[Size]) -> usize {
    let values = |size: &Size| (size.row_len() * size.height).div_ceil(sizes[0].height);
    let widest = sizes.iter().map(values).max().unwrap_or(1);
    // Of two pictures, and of two layers.
    let bytes_per_row = 2 * 2 * size_of::<f32>() * widest;
    (MEMORY / bytes_per_row).max(BATCH).next_multiple_of(BATCH)
}
