//! Both pictures through a network, strip by strip, in lockstep.
//!
//! Each layer keeps just the rows that its next output rows need, so memory grows with the
//! picture's width and the strip's height but not with the picture's height. Every output row is
//! computed once, from the same inputs by the same operations, whatever the strip's height: the
//! results are the same bits.

use std::ops::Range;

use sharp_kernels::Workspace;

use super::network::{Layer, Network};
use super::rows::{Buffer, Size};

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

/// Memory that the feature rows of both pictures may take together where the strip's height is
/// not given. Enough for a whole picture of some 300,000 pixels.
const MEMORY: usize = 192 << 20;

/// One picture on its way through the network: the rows held of the picture and of each layer's
/// output.
struct Passage {
    buffers: Vec<Buffer>,
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
    let [mut a, mut b] = [0, 1].map(|_| Passage {
        buffers: sizes.iter().map(|&size| Buffer::new(size)).collect(),
        workspace: Workspace::new(),
    });
    for first in (0..height).step_by(strip) {
        let rows = first..(first + strip).min(height);
        let fill = |picture: usize, passage: &mut Passage| {
            let out = passage.buffers[0].push(rows.len());
            for (y, out) in rows.clone().zip(out.chunks_exact_mut(sizes[0].row_len())) {
                input(picture, y, out);
            }
        };
        rayon::join(|| fill(0, &mut a), || fill(1, &mut b));
        for (i, layer) in network.layers.iter().enumerate() {
            let (rows, _) = rayon::join(|| a.advance(layer, i), || b.advance(layer, i));
            if let Some(tap) = layer.tap
                && !rows.is_empty()
            {
                each(Taps {
                    tap,
                    size: sizes[i + 1],
                    rows: [&a, &b].map(|picture| picture.buffers[i + 1].rows_from(rows.start)),
                });
            }
        }
        for picture in [&mut a, &mut b] {
            if let Some(last) = picture.buffers.last_mut() {
                last.drop_before(last.end());
            }
        }
    }
    let outputs = network.layers.iter().zip(&sizes[1..]);
    let tapped = outputs.filter(|(layer, _)| layer.tap.is_some());
    Some(tapped.map(|(_, &size)| size).collect())
}

impl Passage {
    /// Computes those rows of layer `i` for which there is input; returns which ones.
    fn advance(&mut self, layer: &Layer, i: usize) -> Range<usize> {
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
        if end > first {
            let window = input.window();
            let room = output.push(end - first);
            layer
                .op
                .run_rows(&window, first..end, room, &mut self.workspace);
        }
        input.drop_before(if end < size.height {
            needs(end).start
        } else {
            input.end()
        });
        first..end
    }
}

/// The rows that fit into [`MEMORY`], a multiple of 16 because pooling halves four times.
pub(super) fn default_strip(sizes: &[Size]) -> usize {
    let values: f64 = sizes
        .iter()
        .map(|size| size.row_len() as f64 * size.height as f64)
        .sum();
    let pictures = 2.0;
    let bytes_per_row = pictures * size_of::<f32>() as f64 * values / sizes[0].height as f64;
    (MEMORY as f64 / bytes_per_row) as usize / 16 * 16 + 16
}
