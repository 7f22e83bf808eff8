//! Winograd convolution: tiles of 4×4 output pixels, 36 small products instead of 144.

use std::ops::Range;

use crate::conv::transform::{self, InputLayout, LANES, OUTSIDE, OutputTile, PLACES};
use crate::conv::{ConvOptions, ConvSpec};
use crate::gemm::block::ProductBlock;
use crate::gemm::micro::{KC, MicroTile, stride_for};
use crate::gemm::{Epilogue, PackedMatrix};
use crate::rows::RowWindow;
use crate::simd::Simd;
use crate::workspace::{Aligned, SharedOut, run_tasks};

/// Side of a tile of output pixels.
const SIDE: usize = 4;

/// Widens `out` to the rows of all tiles that it overlaps; the tile grid starts at row 0.
pub(super) fn whole_tiles(out: Range<usize>) -> Range<usize> {
    if out.is_empty() {
        return 0..0;
    }
    out.start / SIDE * SIDE..out.end.next_multiple_of(SIDE)
}

#[derive(Debug, Clone)]
pub(super) struct Winograd {
    simd: Simd,
    in_channels: usize,
    out_channels: usize,
    /// For each place of a transformed tile, a matrix of input by output channels. The output channels are padded to
    /// whole panels and a multiple of [`LANES`].
    filters: Vec<PackedMatrix>,
    /// Bias of each output channel, padded like the output channels of `filters`.
    bias: Aligned,
}

impl Winograd {
    pub(super) fn suits(spec: &ConvSpec) -> bool {
        let ConvSpec {
            kernel,
            stride,
            padding,
            in_channels,
            ..
        } = *spec;
        (kernel, stride, padding) == (3, 1, 1) && in_channels.is_multiple_of(LANES)
    }

    pub(super) fn new(simd: Simd, spec: &ConvSpec, weight: &[f32], bias: Option<&[f32]>) -> Self {
        let (c, n) = (spec.in_channels, spec.out_channels);
        let padded = n.next_multiple_of(MicroTile::of(simd).nr.max(LANES));
        // All transformed filters, [place][in][out], before they are packed one by one.
        let mut transformed = vec![0.0; PLACES * c * n];
        for o in 0..n {
            for i in 0..c {
                let filter = transform::filter(&weight[(o * c + i) * 9..][..9]);
                for (place, value) in filter.iter().enumerate() {
                    transformed[(place * c + i) * n + o] = *value;
                }
            }
        }
        let filters = transformed
            .chunks_exact(c * n)
            .map(|matrix| {
                PackedMatrix::pack(simd, c, padded, None, |row, col| {
                    if col < n { matrix[row * n + col] } else { 0.0 }
                })
            })
            .collect();
        let mut padded_bias = Aligned::zeros(padded);
        if let Some(bias) = bias {
            assert_eq!(bias.len(), n, "one bias per output channel");
            padded_bias[..n].copy_from_slice(bias);
        }
        Self {
            simd,
            in_channels: c,
            out_channels: n,
            filters,
            bias: padded_bias,
        }
    }

    /// Tiles per task: as many as fit in the L2 cache once transformed; more if the filters are
    /// large, because each task reads them from memory again.
    fn tiles_per_task(&self) -> usize {
        let tiles: usize = if self.in_channels * self.out_channels > 256 * 256 {
            56
        } else {
            28
        };
        tiles.next_multiple_of(MicroTile::of(self.simd).mr)
    }

    pub(super) fn run(
        &self,
        input: &RowWindow<'_>,
        out: Range<usize>,
        output: &mut [f32],
        options: ConvOptions<'_>,
    ) {
        if output.is_empty() {
            return;
        }
        let c = self.in_channels;
        let most = self.tiles_per_task();
        let stride = stride_for(c.min(KC));
        let run = most * stride;
        let layout = InputLayout {
            tile: stride,
            run,
            place: c.div_ceil(KC) * run,
        };
        // Add one cache line, so that the same channel of different places does not map to the same
        // cache set.
        let product_stride = self.bias.len();
        let product_place = most * product_stride + LANES;

        let columns = input.width().div_ceil(SIDE);
        let first = out.start / SIDE;
        let tiles = (out.end.div_ceil(SIDE) - first) * columns;
        let shared = SharedOut::new(output);
        let len = PLACES * (layout.place + product_place) + c;
        run_tasks(tiles.div_ceil(most), len, |task, scratch| {
            let (transformed, rest) = scratch.split_at_mut(PLACES * layout.place);
            let (products, zeros) = rest.split_at_mut(PLACES * product_place);
            let zeros = &mut zeros[..c];
            zeros.fill(0.0);
            let range = task * most..tiles.min((task + 1) * most);
            for (index, tile) in range.clone().enumerate() {
                let (y, x) = (first + tile / columns, tile % columns);
                let pixels = pixels(input, SIDE * y, SIDE * x, zeros);
                transform::input(
                    self.simd,
                    &pixels,
                    options.relu_input,
                    transformed,
                    layout,
                    index,
                );
            }
            self.multiply(transformed, layout, range.len(), products, product_place);
            for (index, tile) in range.enumerate() {
                let (y, x) = (SIDE * (first + tile / columns), SIDE * (tile % columns));
                let at = std::array::from_fn(|i| {
                    let (y, x) = (y + i / SIDE, x + i % SIDE);
                    if out.contains(&y) && x < input.width() {
                        ((y - out.start) * input.width() + x) * self.out_channels
                    } else {
                        OUTSIDE
                    }
                });
                let tile = OutputTile {
                    bias: &self.bias,
                    channels: self.out_channels,
                    at,
                    residual: options.residual,
                    relu: options.relu,
                    // Tasks own disjoint tiles, hence disjoint pixels.
                    out: shared,
                };
                let start = index * product_stride;
                transform::output(self.simd, products, start, product_place, &tile);
            }
        });
    }

    /// Computes the 36 products of `tiles` transformed tiles.
    fn multiply(
        &self,
        transformed: &[f32],
        layout: InputLayout,
        tiles: usize,
        products: &mut [f32],
        product_place: usize,
    ) {
        let n = self.bias.len();
        let nr = MicroTile::of(self.simd).nr;
        for (place, filter) in self.filters.iter().enumerate() {
            let block = ProductBlock {
                b: filter.view(),
                rows: 0..tiles,
                panels: 0..n / nr,
                epilogue: Epilogue::None,
                out: SharedOut::new(&mut products[place * product_place..][..product_place]),
                out_stride: n,
            };
            for k0 in (0..self.in_channels).step_by(KC) {
                let a = &transformed[place * layout.place + k0 / KC * layout.run..][..layout.run];
                // SAFETY: the products belong to this task only.
                unsafe { block.multiply(a, k0, &|row| row * n) };
            }
        }
    }
}

/// The 6×6 input pixels under the tile whose first output pixel is (`y`, `x`); `zeros` stands in for pixels beyond the
/// image.
fn pixels<'a>(input: &RowWindow<'a>, y: usize, x: usize, zeros: &'a [f32]) -> [&'a [f32]; PLACES] {
    let c = input.channels();
    let mut pixels = [zeros; PLACES];
    for (dy, pixels) in pixels.chunks_exact_mut(6).enumerate() {
        let Some(y) = (y + dy).checked_sub(1).filter(|&y| y < input.height()) else {
            continue;
        };
        let row = input.row(y);
        for (dx, pixel) in pixels.iter_mut().enumerate() {
            if let Some(x) = (x + dx).checked_sub(1).filter(|&x| x < input.width()) {
                *pixel = &row[x * c..][..c];
            }
        }
    }
    pixels
}
