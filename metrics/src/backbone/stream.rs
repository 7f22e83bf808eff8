//! Both pictures through a network, strip by strip, in lockstep.
//!
//! Each layer keeps just the rows that its next output rows need, so memory grows with the
//! picture's width and the strip's height but not with the picture's height. Every output row is
//! computed once, from the same inputs by the same operations, whatever the strip's height: the
//! results are the same bits.

use std::ops::Range;

use super::network::{Layer, Network};
use super::rows::{Buffer, Rows, Size};

/// Features of both pictures at one tap: rows of the same range.
#[derive(Clone, Copy)]
pub(crate) struct Taps<'a> {
    /// Which tap of the network, from 0.
    pub(crate) tap: usize,
    /// Features of the prediction and of the target.
    pub(crate) rows: [Rows<'a>; 2],
}

/// Memory that the feature rows of both pictures may take together where the strip's height is
/// not given. Enough for a whole picture of some 300,000 pixels.
const MEMORY: usize = 192 << 20;

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
    let mut pictures = [0, 1].map(|_| sizes.iter().map(|&size| Buffer::new(size)).collect());
    let mut row = 0;
    while row < height {
        let rows = row..(row + strip).min(height);
        let [a, b]: &mut [Vec<Buffer>; 2] = &mut pictures;
        let fill = |picture: usize, buffers: &mut Vec<Buffer>| {
            let len = sizes[0].row_len();
            let out = buffers[0].push(rows.len());
            for (y, out) in rows.clone().zip(out.chunks_exact_mut(len)) {
                input(picture, y, out);
            }
        };
        rayon::join(|| fill(0, a), || fill(1, b));
        for (i, (layer, tap)) in network.layers.iter().enumerate() {
            let (rows, _) = rayon::join(|| advance(layer, i, a), || advance(layer, i, b));
            if let Some(tap) = *tap
                && !rows.is_empty()
            {
                let rows = [&*a, &*b].map(|buffers| buffers[i + 1].rows_from(rows.start));
                each(Taps { tap, rows });
            }
        }
        let last = network.layers.len();
        for buffers in [a, b] {
            let end = buffers[last].end();
            buffers[last].drop_before(end);
        }
        row = rows.end;
    }
    let tapped = network.layers.iter().zip(&sizes[1..]);
    Some(
        tapped
            .filter_map(|((_, tap), &size)| tap.map(|_| size))
            .collect(),
    )
}

/// Computes the rows of layer `i` for which there is input; returns which ones.
fn advance(layer: &Layer, i: usize, buffers: &mut [Buffer]) -> Range<usize> {
    let [input, output] = &mut buffers[i..i + 2] else {
        return 0..0;
    };
    let (height, size) = (input.size().height, output.size());
    let first = output.end();
    let mut end = first;
    while end < size.height && layer.needs(end, height).end <= input.end() {
        end += 1;
    }
    if input.end() < height {
        end = (end / ALIGNMENT * ALIGNMENT).max(first);
    }
    if end > first {
        layer.run(input.rows(), first..end, size, output.push(end - first));
        input.drop_before(layer.needs(end, height).start);
    }
    first..end
}

/// Until a picture ends, layers compute multiples of this many rows: the height of a Winograd
/// tile.
const ALIGNMENT: usize = 4;

fn default_strip(sizes: &[Size]) -> usize {
    let values: f64 = sizes
        .iter()
        .map(|size| size.row_len() as f64 * size.height as f64)
        .sum();
    let bytes_per_row = 2.0 * 4.0 * values / sizes[0].height as f64;
    (MEMORY as f64 / bytes_per_row) as usize / 16 * 16 + 16
}
