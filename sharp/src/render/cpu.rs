//! The CPU backend: the passes run on rayon's threads, with sixteen pixels per lane group.

use super::emit::{BIN, BinGrid, BinLists, count, emit};
use super::project::{Footprint, Projected, Splat, project};
use super::ranges::TileLists;
use super::raster::{BinPixels, raster};
use super::renderer::{LoadedScene, check_scene};
use super::{RenderError, RenderOutput, RenderView, Renderer, Simd, TileSize, radix};
use crate::gaussians::Gaussians;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Renders on the threads of the current rayon pool. Reuses its buffers between frames.
///
/// The picture has the same bytes for any number of threads, any tile size and any SIMD level.
#[derive(Debug)]
pub struct CpuRenderer {
    pub(super) simd: Simd,
    pub(super) tile: TileSize,
    pair_limit: u64,
    pub(super) projected: Projected,
    bins: Mutex<Vec<BinScratch>>,
}

/// Maximum number of (Gaussian, bin) pairs in memory at a time, 8 bytes each; a scene with more is rendered in several
/// rounds of bins.
const PAIR_LIMIT: u64 = 1 << 25;

/// Per-thread buffers for one bin.
#[derive(Debug, Default)]
pub(super) struct BinScratch {
    /// Sort keys of the bin's Gaussians, front to back.
    pub(super) keys: Vec<u64>,
    sorting: Vec<u64>,
    pub(super) lists: TileLists,
    pub(super) members: Vec<u32>,
}

impl BinScratch {
    /// Collects a bin's Gaussians, front to back, relative to the bin's first pixel. Returns the
    /// position of that pixel.
    pub(super) fn load(
        &mut self,
        (grid, bin): (BinGrid, usize),
        emitted: &BinLists,
        splats: &[Splat],
        footprints: &[Footprint],
    ) -> [usize; 2] {
        emitted.gather(bin, &mut self.keys);
        radix::sort(&mut self.keys, &mut self.sorting);
        let corner = [bin % grid.columns * BIN, bin / grid.columns * BIN];
        self.lists.load(&self.keys, splats, footprints, corner);
        corner
    }
}

impl Default for CpuRenderer {
    fn default() -> Self {
        Self::new()
    }
}

impl CpuRenderer {
    /// Creates a renderer with the best instruction set of this machine.
    pub fn new() -> Self {
        Self::with_simd(Simd::detect())
    }

    /// Creates a renderer with the given instruction set.
    pub fn with_simd(simd: Simd) -> Self {
        Self {
            simd,
            tile: TileSize::Px4,
            pair_limit: PAIR_LIMIT,
            projected: Projected::default(),
            bins: Mutex::default(),
        }
    }

    /// Sets the tile size; the default is 4×4 pixels.
    #[must_use]
    pub fn with_tile_size(self, tile: TileSize) -> Self {
        Self { tile, ..self }
    }

    /// Keeps at most `pairs` (Gaussian, bin) pairs, 8 bytes each, in memory at a time; all pairs of one bin of 64×64
    /// pixels are always kept, even if they are more. Affects memory and time, not the picture.
    #[must_use]
    pub fn with_pair_limit(self, pairs: u64) -> Self {
        Self {
            pair_limit: pairs,
            ..self
        }
    }
}

impl Renderer for CpuRenderer {
    fn name(&self) -> String {
        format!("cpu-{}", self.simd.instruction_set())
    }

    fn load<'a>(
        &'a mut self,
        scene: &'a Gaussians,
    ) -> Result<Box<dyn LoadedScene + 'a>, RenderError> {
        check_scene(scene)?;
        Ok(Box::new(CpuScene {
            renderer: self,
            scene,
        }))
    }
}

struct CpuScene<'a> {
    renderer: &'a mut CpuRenderer,
    scene: &'a Gaussians,
}

impl LoadedScene for CpuScene<'_> {
    fn render(&mut self, view: &RenderView) -> Result<RenderOutput, RenderError> {
        view.check()?;
        Ok(self.renderer.draw(self.scene, view))
    }
}

impl CpuRenderer {
    /// Runs all passes for a validated scene and view.
    fn draw(&mut self, scene: &Gaussians, view: &RenderView) -> RenderOutput {
        let (width, height) = (view.intrinsics.width, view.intrinsics.height);
        let grid = BinGrid::new(width, height);
        project(self.simd, scene, view, &mut self.projected);
        let Projected {
            splats,
            footprints,
            drawn,
            dropped,
        } = &self.projected;
        let mut out = RenderOutput {
            drawn: *drawn,
            dropped: *dropped,
            ..RenderOutput::empty(view)
        };
        let mut areas = cut(&mut out, grid);
        let counts = count(grid, footprints);
        for bins in counts.groups(grid, self.pair_limit) {
            let lists = emit(grid, footprints, &counts, bins.clone());
            areas[bins.clone()]
                .par_iter_mut()
                .zip(bins)
                .with_max_len(1)
                .for_each(|(area, bin)| {
                    let mut scratch = self.take_scratch();
                    scratch.load((grid, bin), &lists, splats, footprints);
                    if !scratch.keys.is_empty() {
                        let BinScratch { lists, members, .. } = &mut scratch;
                        lists.for_each_band(self.tile.pixels(), |band| {
                            raster(self.simd, band, view.rule.alpha_max, members, area);
                        });
                    }
                    self.return_scratch(scratch);
                });
        }
        drop(areas);
        out
    }

    pub(super) fn take_scratch(&self) -> BinScratch {
        let mut pool = self.bins.lock().unwrap_or_else(PoisonError::into_inner);
        pool.pop().unwrap_or_default()
    }

    pub(super) fn return_scratch(&self, scratch: BinScratch) {
        let mut pool = self.bins.lock().unwrap_or_else(PoisonError::into_inner);
        pool.push(scratch);
    }
}

/// Splits the output into the rows of each bin.
fn cut(out: &mut RenderOutput, grid: BinGrid) -> Vec<BinPixels<'_>> {
    let mut areas: Vec<BinPixels<'_>> = std::iter::repeat_with(BinPixels::default)
        .take(grid.len())
        .collect();
    let width = out.width as usize;
    let rows = out
        .rgb
        .chunks_mut(width)
        .zip(out.alpha.chunks_mut(width))
        .zip(out.depth_acc.chunks_mut(width));
    for (y, ((rgb, alpha), depth)) in rows.enumerate() {
        let parts = rgb
            .chunks_mut(BIN)
            .zip(alpha.chunks_mut(BIN))
            .zip(depth.chunks_mut(BIN));
        let first = y / BIN * grid.columns;
        for (area, ((rgb, alpha), depth)) in areas[first..].iter_mut().zip(parts) {
            area.rgb.push(rgb);
            area.alpha.push(alpha);
            area.depth.push(depth);
        }
    }
    areas
}
