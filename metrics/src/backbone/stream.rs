//! Runs pictures of equal size through a network strip by strip, in lockstep.
//!
//! Each layer buffers only the rows that its next output rows need. Memory therefore grows with the number and width of
//! the pictures and with the strip's height, but not with the pictures' height. Deep layers get few rows per strip.
//! They wait until enough rows have accumulated, because their weights exceed any cache and should not be read for a
//! handful of pixels. Every output row is computed once, from the same inputs by the same operations, so results are
//! bit-identical for any strip height and number of pictures.

use std::ops::Range;

use super::network::{Layer, Network};
use super::rows::{Blocks, Buffer, MapSize};

/// Feature rows of all pictures at one tap.
#[derive(Clone, Copy)]
pub(crate) struct Taps<'a> {
    /// Index of the tap in the network, from 0.
    pub(crate) tap: usize,
    /// Size of the whole feature map.
    pub(crate) size: MapSize,
    /// The next rows of each picture's features, top to bottom.
    pub(crate) rows: &'a [&'a [f32]],
}

/// Memory budget in bytes for the new rows of one layer's input and output. Determines the height of strips if none is
/// given.
const MEMORY: usize = 64 << 20;

/// Minimum number of pixels for which a layer with weights waits; fewer do not justify reading the
/// weights.
const BATCH_PIXELS: usize = 2048;

/// Maximum number of rows for which a layer waits, even if they have fewer than [`BATCH_PIXELS`]
/// pixels.
const BATCH: usize = 16;

/// Rows per Winograd tile. A batch that ends within a tile wastes the tile's remaining rows.
const TILE: usize = 4;

/// Number of pictures processed concurrently. The others wait at each layer, so that scratch memory
/// does not grow with the number of pictures.
const LANES: usize = 2;

/// Working memory of one of the [`LANES`], used by its pictures in turn.
#[derive(Default)]
struct Lane {
    blocks: Blocks,
}

/// Runs a network on `pictures` pictures of size `width` × `height`.
///
/// `input(picture, row, values)` writes a row as the network's input (channels innermost). `each` receives the features
/// of every tap, rows from top to bottom. `strip` is the number of picture rows processed at once; the default is what
/// fits into a fixed amount of memory. Returns the sizes of the taps, or `None` without doing anything if the pictures
/// are too small.
pub(crate) fn stream(
    network: &Network,
    (width, height): (usize, usize),
    pictures: usize,
    strip: Option<usize>,
    input: impl Fn(usize, usize, &mut [f32]) + Sync,
    mut each: impl FnMut(Taps),
) -> Option<Vec<MapSize>> {
    let sizes = network.sizes(width, height)?;
    let strip = strip.unwrap_or_else(|| default_strip(&sizes, pictures));
    // For each picture, the buffered rows of the picture and of every layer's output.
    let mut held: Vec<Vec<Buffer>> = (0..pictures)
        .map(|_| sizes.iter().map(|&size| Buffer::new(size)).collect())
        .collect();
    let mut lanes: [Lane; LANES] = Default::default();
    for first in (0..height).step_by(strip) {
        let rows = first..(first + strip).min(height);
        in_lanes(&mut held, &mut lanes, |picture, buffers, lane| {
            let out = buffers[0].push(rows.len(), &mut lane.blocks);
            for (y, out) in rows.clone().zip(out.chunks_exact_mut(sizes[0].row_len())) {
                input(picture, y, out);
            }
        });
        for (i, layer) in network.layers.iter().enumerate() {
            // All pictures advance in lockstep, so each has as many rows ready as the first.
            let rows = ready(layer, &held[0][i], &held[0][i + 1], strip);
            in_lanes(&mut held, &mut lanes, |_, buffers, lane| {
                let (inputs, outputs) = buffers.split_at_mut(i + 1);
                advance(layer, &mut inputs[i], &mut outputs[0], &rows, lane);
            });
            if let Some(tap) = layer.tap
                && !rows.is_empty()
            {
                let rows: Vec<&[f32]> = held.iter().map(|buffers| buffers[i + 1].fresh()).collect();
                each(Taps {
                    tap,
                    size: sizes[i + 1],
                    rows: &rows,
                });
            }
        }
        in_lanes(&mut held, &mut lanes, |_, buffers, lane| {
            if let Some(last) = buffers.last_mut() {
                last.keep_from(last.end(), &mut lane.blocks);
            }
        });
    }
    let outputs = network.layers.iter().zip(&sizes[1..]);
    let tapped = outputs.filter(|(layer, _)| layer.tap.is_some());
    Some(tapped.map(|(_, &size)| size).collect())
}

/// Calls `work` for every picture; each lane processes half of them.
fn in_lanes(
    pictures: &mut [Vec<Buffer>],
    [a, b]: &mut [Lane; LANES],
    work: impl Fn(usize, &mut [Buffer], &mut Lane) + Sync,
) {
    let half = pictures.len().div_ceil(LANES);
    let (first, second) = pictures.split_at_mut(half);
    let run = |pictures: &mut [Vec<Buffer>], offset: usize, lane: &mut Lane| {
        for (i, buffers) in pictures.iter_mut().enumerate() {
            work(offset + i, buffers, lane);
        }
    };
    rayon::join(|| run(first, 0, a), || run(second, half, b));
}

/// The output rows that a layer computes next, i.e. whose input rows are complete.
///
/// For layers with weights, the end is rounded down to a whole tile, and the range is empty until
/// it fills a batch, except at the end of the picture.
fn ready(layer: &Layer, input: &Buffer, output: &Buffer, strip: usize) -> Range<usize> {
    let (first, MapSize { height, width, .. }) = (output.end(), output.size());
    let needs = |y: usize| layer.op.in_rows(y..y + 1, input.size().height);
    let mut end = first;
    while end < height && needs(end).end <= input.end() {
        end += 1;
    }
    if end < height && !layer.pools {
        end = (end / tile(strip) * tile(strip)).max(first);
        if end - first < batch(width, strip) {
            end = first;
        }
    }
    first..end
}

/// Approximate memory in bytes that [`stream`] uses for rows; 0 if the pictures are too small.
pub(super) fn memory(
    network: &Network,
    (width, height): (usize, usize),
    pictures: usize,
    strip: Option<usize>,
) -> usize {
    let Some(sizes) = network.sizes(width, height) else {
        return 0;
    };
    let strip = strip.unwrap_or_else(|| default_strip(&sizes, pictures));
    let (mut held, mut block) = (0, strip * sizes[0].row_len());
    let mut fresh = strip;
    for (layer, size) in network.layers.iter().zip(sizes.windows(2)) {
        let (input, output) = (size[0], size[1]);
        let waits = if layer.pools {
            1
        } else {
            batch(output.width, strip)
        };
        // Evaluated in the middle of the picture, where no window is clipped.
        let middle = output.height / 2 / TILE * TILE;
        let window = middle..(middle + waits).min(output.height);
        let rows = layer.op.in_rows(window, input.height).len();
        held += rows * input.row_len();
        fresh = waits - 1 + (fresh * output.height).div_ceil(input.height);
        block = block.max(fresh * output.row_len());
    }
    (pictures * held + (pictures + LANES) * block) * size_of::<f32>()
}

/// Number of rows that a layer of `width` pixels waits for.
fn batch(width: usize, strip: usize) -> usize {
    let rows = BATCH_PIXELS.div_ceil(width).next_multiple_of(TILE);
    rows.min(BATCH).min(strip)
}

fn tile(strip: usize) -> usize {
    TILE.min(strip)
}

/// Computes the output `rows` of a layer for one picture, and drops input rows that are no longer needed.
fn advance(
    layer: &Layer,
    input: &mut Buffer,
    output: &mut Buffer,
    rows: &Range<usize>,
    lane: &mut Lane,
) {
    if !rows.is_empty() {
        let window = input.window();
        let room = output.push(rows.len(), &mut lane.blocks);
        layer.op.run_rows(&window, rows.clone(), room);
    }
    let needed = if rows.end < output.size().height {
        let next = rows.end..rows.end + 1;
        layer.op.in_rows(next, input.size().height).start
    } else {
        input.end()
    };
    input.keep_from(needed, &mut lane.blocks);
}

/// Number of picture rows, in whole tiles, such that the new rows of any layer fit into [`MEMORY`].
pub(super) fn default_strip(sizes: &[MapSize], pictures: usize) -> usize {
    let values = |size: &MapSize| (size.row_len() * size.height).div_ceil(sizes[0].height);
    let widest = sizes.iter().map(values).max().unwrap_or(1);
    // One block per picture for the input, and one per lane for the output.
    let bytes_per_row = (pictures + LANES) * size_of::<f32>() * widest;
    (MEMORY / bytes_per_row / TILE * TILE).max(TILE)
}
