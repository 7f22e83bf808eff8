//! A frame: projection and depth order once, then one sub-frame after another.

use super::super::harmonics::ViewColors;
use super::super::view::ViewConstants;
use super::super::{RenderError, RenderOutput, RenderView};
use super::device::Gpu;
use super::layout::{DroppedCounts, FrameUniform, ViewUniform, dropped};
use super::memory::GpuBuffer;
use super::passes::Passes;
use super::readback::copy_home;
use super::scene::GpuScene;
use super::sort::{PAIR_BYTES, SortBuffers};
use super::subframe::{MIN_TILE, SubFrame};

/// Threads per workgroup of the passes over Gaussians and pairs.
const GROUP: u32 = 256;
/// Width and height of a `raster` workgroup in pixels.
const RASTER_GROUP: (u32, u32) = (8, 32);
/// Bytes per pixel in the larger of the two output bindings.
pub(super) const PIXEL_BYTES: u64 = 16;

/// Buffers for sub-frames; kept between sub-frames and frames, and only ever enlarged.
pub(super) struct Work {
    pub(super) pairs: SortBuffers,
    pub(super) targets: Targets,
}

impl Work {
    pub(super) fn new(gpu: &Gpu) -> Self {
        Self {
            pairs: SortBuffers::new(gpu, 0),
            targets: Targets::new(gpu, 0, 0),
        }
    }
}

/// Ranges and pixels of a sub-frame, and the staging buffers that transfer the pixels to the host.
pub(super) struct Targets {
    pub(super) ranges: GpuBuffer,
    picture: GpuBuffer,
    depths: GpuBuffer,
    pub(super) home: [GpuBuffer; 2],
    tiles: u32,
    pixels: u64,
}

impl Targets {
    fn new(gpu: &Gpu, tiles: u32, pixels: u64) -> Self {
        Self {
            ranges: gpu.storage("ranges", u64::from(tiles) * 8),
            picture: gpu.storage("picture", pixels * PIXEL_BYTES),
            depths: gpu.storage("depths", pixels * 4),
            home: [gpu.staging(pixels * PIXEL_BYTES), gpu.staging(pixels * 4)],
            tiles,
            pixels,
        }
    }

    fn grow(&mut self, gpu: &Gpu, part: SubFrame) {
        let (tiles, pixels) = (part.count(), part.pixels());
        if tiles > self.tiles || pixels > self.pixels {
            let (tiles, pixels) = (tiles.max(self.tiles), pixels.max(self.pixels));
            // Frees the old buffers first.
            *self = Self::new(gpu, 0, 0);
            *self = Self::new(gpu, tiles, pixels);
        }
    }
}

pub(super) struct Frame<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) passes: &'a Passes,
    pub(super) scene: &'a GpuScene,
    pub(super) view: &'a RenderView,
    /// True if the pixels are copied to the host.
    pub(super) copied: bool,
    /// Side of a tile in pixels: a power of two of at least [`MIN_TILE`]. If the rule limits the
    /// support to tiles, tiles are no larger than the rule's tiles, because a list applies to all
    /// pixels of a tile.
    pub(super) tile: u32,
}

impl Frame<'_> {
    pub(super) fn render(&self, work: &mut Work) -> Result<RenderOutput, RenderError> {
        let (gpu, scene) = (self.gpu, self.scene);
        let k = self.view.intrinsics;
        let mut out = RenderOutput::empty(self.view);
        if scene.count == 0 {
            return Ok(out);
        }
        let (half, colors) = self.begin(&mut out)?;
        let colors = colors.as_ref().unwrap_or(&scene.colors);
        let order = &scene.by_depth.values[half];
        let mut waiting = vec![SubFrame::whole(k.width, k.height, self.tile)];
        while let Some(part) = waiting.pop() {
            let halves = part.halves();
            let (width, height) = part.size();
            let groups = (width / RASTER_GROUP.0).max(height.div_ceil(RASTER_GROUP.1));
            if part.pixels() * PIXEL_BYTES > gpu.window() || groups > gpu.groups_limit {
                waiting.extend(halves.ok_or_else(|| self.no_tile(part))?);
                continue;
            }
            let count = self.count_pairs(order, part)?;
            // A single tile cannot be split, so it may exceed the window; it has at most one pair per Gaussian.
            let most = if halves.is_some() {
                gpu.window() / PAIR_BYTES
            } else {
                gpu.binding_limit / 4
            };
            if count > most.min(u64::from(u32::MAX)) {
                waiting.extend(halves.ok_or_else(|| self.no_tile(part))?);
            } else if count > 0 {
                // The cast fits, because the comparison above limits `count` to 32 bits.
                let lists = (order, colors);
                self.draw(lists, (part, count as u32), work, &mut out)?;
            }
        }
        Ok(out)
    }

    fn no_tile(&self, part: SubFrame) -> RenderError {
        let limit = self.gpu.binding_limit;
        let side = part.side;
        self.gpu.no_room(format!(
            "the GPU's buffer limit of {limit} bytes is too small for one {side}x{side}-pixel tile and its list of \
             Gaussians"
        ))
    }

    /// Projects the Gaussians, sorts them by depth, and sets the counts in `out`. Returns the half of the buffers (0 or
    /// 1) that contains the depth order, and the view's colours if they differ from the scene's.
    fn begin(&self, out: &mut RenderOutput) -> Result<(usize, Option<GpuBuffer>), RenderError> {
        let Self {
            gpu, passes, scene, ..
        } = *self;
        let mut encoder = gpu.encoder();
        let counts = self.project(&mut encoder);
        let colors = self.colors(&mut encoder);
        let count = (scene.count, 32);
        let half = scene.by_depth.sort(gpu, passes, &mut encoder, count, true);
        let bytes = size_of::<DroppedCounts>() as u64;
        let staged = gpu.stage(&mut encoder, &counts, bytes);
        gpu.finish(encoder, &[(&staged, bytes)], |_, bytes| {
            out.dropped = dropped(bytemuck::pod_read_unaligned(bytes));
            out.drawn = u64::from(scene.count) - out.dropped.total();
        })?;
        Ok((half, colors))
    }

    fn view_uniform(&self) -> GpuBuffer {
        let colors = ViewColors::new(self.scene.degree, self.view);
        let constants = ViewConstants::new(self.view);
        let view = ViewUniform::new(&constants, colors, (self.scene.count, self.scene.degree));
        self.gpu.uniform("view", &view)
    }

    /// Runs pass `harmonics`; `None` if the scene's colours are drawn unchanged.
    fn colors(&self, encoder: &mut wgpu::CommandEncoder) -> Option<GpuBuffer> {
        let (gpu, scene) = (self.gpu, self.scene);
        ViewColors::new(scene.degree, self.view)?;
        let colors = gpu.storage("colors of the view", u64::from(scene.count) * 16);
        gpu.run(
            encoder,
            &self.passes.harmonics,
            &[
                &self.view_uniform(),
                &scene.means_opacities,
                &scene.colors,
                &scene.coefficients,
                &colors,
            ],
            scene.count.div_ceil(GROUP),
        );
        Some(colors)
    }

    /// Runs pass `project`; returns the buffer with the counts of dropped Gaussians.
    pub(super) fn project(&self, encoder: &mut wgpu::CommandEncoder) -> GpuBuffer {
        let (gpu, scene) = (self.gpu, self.scene);
        let dropped = gpu.storage("dropped", size_of::<DroppedCounts>() as u64);
        gpu.run(
            encoder,
            &self.passes.project,
            &[
                &self.view_uniform(),
                &scene.means_opacities,
                &scene.quaternions,
                &scene.scales,
                &scene.splats,
                &scene.details,
                &scene.footprints,
                &scene.by_depth.keys[0],
                &dropped,
            ],
            scene.count.div_ceil(GROUP),
        );
        dropped
    }

    fn uniform(&self, part: SubFrame, pairs: u32) -> GpuBuffer {
        let alpha_max = self.view.rule.alpha_max;
        let uniform = FrameUniform::new(part, (self.scene.count, pairs), alpha_max);
        self.gpu.uniform("frame", &uniform)
    }

    /// Writes the start of each Gaussian's pairs to `scene.places`, and returns the total number of pairs.
    ///
    /// The sum of a scan block cannot wrap: its 1024 Gaussians have at most one pair per tile, and a sub-frame has
    /// fewer than 2²² tiles. (The pixels of a sub-frame fit in one binding.) The starts can wrap if the total exceeds
    /// 32 bits; such a sub-frame is split, not drawn.
    pub(super) fn count_pairs(
        &self,
        order: &GpuBuffer,
        part: SubFrame,
    ) -> Result<u64, RenderError> {
        let Self {
            gpu, passes, scene, ..
        } = *self;
        let mut encoder = gpu.encoder();
        let frame = self.uniform(part, 0);
        let count = scene.count + 1;
        gpu.run(
            &mut encoder,
            &passes.count_tiles,
            &[&frame, order, &scene.footprints, &scene.places],
            count.div_ceil(GROUP),
        );
        let (sums, bytes) =
            scene
                .scan
                .scan_and_stage(gpu, passes, &mut encoder, &scene.places, count);
        let mut total = 0;
        gpu.finish(encoder, &[(&sums, bytes)], |_, bytes| {
            let sums: &[u32] = bytemuck::cast_slice(bytes);
            total = sums.iter().map(|sum| u64::from(*sum)).sum();
        })?;
        Ok(total)
    }

    /// Emits the pairs of tile and Gaussian, sorts them by tile, and finds each tile's range. Returns the index (0 or
    /// 1) of the half of the buffers that contains the sorted pairs.
    pub(super) fn list(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        order: &GpuBuffer,
        (part, count): (SubFrame, u32),
        work: &mut Work,
    ) -> usize {
        let Self {
            gpu, passes, scene, ..
        } = *self;
        work.pairs.grow(gpu, count);
        work.targets.grow(gpu, part);
        let (pairs, targets) = (&work.pairs, &work.targets);
        let frame = self.uniform(part, count);
        gpu.run(
            encoder,
            &passes.emit,
            &[
                &frame,
                order,
                &scene.footprints,
                &scene.places,
                &pairs.keys[0],
                &pairs.values[0],
            ],
            scene.count.div_ceil(GROUP),
        );
        let bits = 32 - (part.count() - 1).leading_zeros();
        let half = pairs.sort(gpu, passes, encoder, (count, bits), false);
        encoder.clear_buffer(&targets.ranges, 0, None);
        gpu.run(
            encoder,
            &passes.find_ranges,
            &[&frame, &pairs.keys[half], &targets.ranges],
            count.div_ceil(GROUP),
        );
        half
    }

    /// Builds the lists, rasterises, and copies the pixels to the host if `copied`.
    fn draw(
        &self,
        (order, colors): (&GpuBuffer, &GpuBuffer),
        (part, count): (SubFrame, u32),
        work: &mut Work,
        out: &mut RenderOutput,
    ) -> Result<(), RenderError> {
        let (gpu, scene) = (self.gpu, self.scene);
        let mut encoder = gpu.encoder();
        let half = self.list(&mut encoder, order, (part, count), work);
        let Work { pairs, targets } = work;
        let (width, height) = part.size();
        gpu.run_grid(
            &mut encoder,
            &self.passes.raster,
            &[
                &self.uniform(part, count),
                &targets.ranges,
                &pairs.values[half],
                &scene.splats,
                &scene.details,
                colors,
                &targets.picture,
                &targets.depths,
            ],
            (width / RASTER_GROUP.0, height.div_ceil(RASTER_GROUP.1)),
        );
        if !self.copied {
            return gpu.finish(encoder, &[], |_, _| {});
        }
        let (colors, depths) = (part.pixels() * PIXEL_BYTES, part.pixels() * 4);
        encoder.copy_buffer_to_buffer(&targets.picture, 0, &targets.home[0], 0, colors);
        encoder.copy_buffer_to_buffer(&targets.depths, 0, &targets.home[1], 0, depths);
        let staged = [(&targets.home[0], colors), (&targets.home[1], depths)];
        gpu.finish(encoder, &staged, |which, bytes| {
            copy_home(part, which, bytes, out);
        })
    }
}

/// Side of the GPU's tiles for a requested side.
pub(super) fn tile_side(wanted: usize) -> u32 {
    // `wanted` is at most 32.
    (wanted as u32).max(MIN_TILE)
}
