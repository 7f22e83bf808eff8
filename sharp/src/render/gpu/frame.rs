//! A frame: projection and depth order once, then sub-frame after sub-frame.

use super::super::{Dropped, RenderError, RenderOutput, RenderView};
use super::device::Gpu;
use super::passes::Passes;
use super::scene::GpuScene;
use super::sort::{SortBuffers, scan, sort};
use wgpu::Buffer;

/// Side of a tile, pixels; `TILE` of the shaders.
const TILE: u32 = 8;
/// Threads in a workgroup of the passes over Gaussians and pairs.
const GROUP: u32 = 256;
/// Bytes of a pixel in the larger of the two output bindings.
const PIXEL_BYTES: u64 = 16;

/// A rectangle of tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct SubFrame {
    first: (u32, u32),
    tiles: (u32, u32),
}

impl SubFrame {
    /// The longer side cut in half; `None` for a single tile.
    fn halves(self) -> Option<[Self; 2]> {
        let (x, y) = self.tiles;
        if x * y == 1 {
            return None;
        }
        let cut = |along_x: bool| {
            let size = if along_x { x } else { y };
            let half = size / 2;
            let part = |offset: u32, length: u32| {
                if along_x {
                    Self {
                        first: (self.first.0 + offset, self.first.1),
                        tiles: (length, y),
                    }
                } else {
                    Self {
                        first: (self.first.0, self.first.1 + offset),
                        tiles: (x, length),
                    }
                }
            };
            [part(0, half), part(half, size - half)]
        };
        Some(cut(x > y))
    }

    fn pixels(self) -> u64 {
        u64::from(self.tiles.0) * u64::from(self.tiles.1) * u64::from(TILE * TILE)
    }
}

/// The view as `shared/view.wgsl` lays it out.
fn view_words(view: &RenderView, count: u32) -> [u32; 32] {
    let k = view.intrinsics;
    let m = view.camera_from_scene.matrix3.transpose();
    let t = view.camera_from_scene.translation;
    let size = (f64::from(k.width), f64::from(k.height));
    let bounds = super::super::project::jacobian_bounds(view);
    let depth_row = [m.z_axis.x, m.z_axis.y, m.z_axis.z, t.z];
    let floats = [
        [m.x_axis.x, m.x_axis.y, m.x_axis.z, t.x],
        [m.y_axis.x, m.y_axis.y, m.y_axis.z, t.y],
        depth_row,
        depth_row.map(|v| v - f64::from(v as f32)),
        [k.fx, k.fy, k.cx, k.cy],
        [bounds[0][0], bounds[0][1], bounds[1][0], bounds[1][1]],
        [size.0, size.1, f64::from(view.eps2d), f64::from(view.near)],
        [f64::from(view.far), 0.0, 0.0, 0.0],
    ];
    let mut words = [0; 32];
    for (word, value) in words.iter_mut().zip(floats.iter().flatten()) {
        *word = (*value as f32).to_bits();
    }
    words[29] = count;
    words
}

/// Renders one view. `order`, when given, replaces the device's own depth order.
pub(super) fn render(
    gpu: &Gpu,
    passes: &Passes,
    scene: &GpuScene,
    view: &RenderView,
    order: Option<&[u32]>,
) -> Result<RenderOutput, RenderError> {
    let (width, height) = (view.intrinsics.width, view.intrinsics.height);
    let pixels = width as usize * height as usize;
    let mut out = RenderOutput {
        width,
        height,
        rgb_linear: vec![[0.0; 3]; pixels],
        alpha: vec![0.0; pixels],
        depth_acc: vec![0.0; pixels],
        drawn: 0,
        dropped: Dropped::default(),
    };
    if scene.count == 0 {
        return Ok(out);
    }
    let order = begin(gpu, passes, scene, view, order, &mut out)?;
    let mut pairs = SortBuffers::new(gpu, 0);
    let mut waiting = vec![SubFrame {
        first: (0, 0),
        tiles: (width.div_ceil(TILE), height.div_ceil(TILE)),
    }];
    while let Some(part) = waiting.pop() {
        if part.pixels() * PIXEL_BYTES > gpu.binding_limit
            || part.tiles.0.max(part.tiles.1) > gpu.groups_limit
        {
            split(gpu, part, &mut waiting)?;
            continue;
        }
        let count = count_pairs(gpu, passes, scene, order, part)?;
        if u64::from(count) * 4 > gpu.binding_limit || count == u32::MAX {
            split(gpu, part, &mut waiting)?;
        } else if count > 0 {
            pairs = pairs.grown(gpu, count);
            draw(gpu, passes, scene, order, (part, count), &pairs, &mut out)?;
        }
    }
    Ok(out)
}

fn split(gpu: &Gpu, part: SubFrame, waiting: &mut Vec<SubFrame>) -> Result<(), RenderError> {
    let halves = part.halves().ok_or_else(|| {
        gpu.error(format!(
            "a binding of {} bytes cannot hold one tile",
            gpu.binding_limit
        ))
    })?;
    waiting.extend(halves);
    Ok(())
}

/// Projects and sorts by depth; returns the buffer with the order and fills in the counts.
fn begin<'a>(
    gpu: &Gpu,
    passes: &Passes,
    scene: &'a GpuScene,
    view: &RenderView,
    order: Option<&[u32]>,
    out: &mut RenderOutput,
) -> Result<&'a Buffer, RenderError> {
    let mut encoder = gpu.encoder();
    let dropped = gpu.storage("dropped", 32);
    let words = gpu.uniform("view", &view_words(view, scene.count));
    gpu.run(
        &mut encoder,
        &passes.project,
        &[
            &words,
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
    let half = if let Some(order) = order {
        gpu.queue
            .write_buffer(&scene.by_depth.values[0], 0, bytemuck::cast_slice(order));
        0
    } else {
        let count = (scene.count, 32);
        sort(gpu, passes, &mut encoder, &scene.by_depth, count, true)
    };
    let staged = gpu.stage(&mut encoder, &dropped, 0, 32);
    gpu.finish(encoder, &[&staged], |_, bytes| {
        let counts: &[u32] = bytemuck::cast_slice(bytes);
        let count = |reason: usize| u64::from(counts[reason]);
        out.dropped = Dropped {
            not_finite: count(0),
            zero_quaternion: count(1),
            near: count(2),
            far: count(3),
            degenerate: count(4),
            transparent: count(5),
            outside: count(6),
        };
        out.drawn = u64::from(scene.count) - out.dropped.total();
    })?;
    Ok(&scene.by_depth.values[half])
}

fn frame_uniform(gpu: &Gpu, scene: &GpuScene, part: SubFrame, pairs: u32) -> Buffer {
    gpu.uniform(
        "frame",
        &[
            part.first.0,
            part.first.1,
            part.tiles.0,
            part.tiles.1,
            scene.count,
            pairs,
            0,
            0,
        ],
    )
}

/// Leaves in `scene.places` where each Gaussian's pairs start, and returns how many there are;
/// `u32::MAX` where 32 bits cannot say.
fn count_pairs(
    gpu: &Gpu,
    passes: &Passes,
    scene: &GpuScene,
    order: &Buffer,
    part: SubFrame,
) -> Result<u32, RenderError> {
    let tiles = u64::from(part.tiles.0) * u64::from(part.tiles.1);
    // An upper bound is enough to know that the sum of u32 counts cannot wrap.
    if u64::from(scene.count) * tiles >= 1 << 32 {
        let total = exact_pairs(gpu, passes, scene, order, part)?;
        if total >= u64::from(u32::MAX) {
            return Ok(u32::MAX);
        }
    }
    let mut encoder = gpu.encoder();
    let frame = frame_uniform(gpu, scene, part, 0);
    gpu.run(
        &mut encoder,
        &passes.count_tiles,
        &[&frame, order, &scene.footprints, &scene.places],
        (scene.count + 1).div_ceil(GROUP),
    );
    scan(gpu, passes, &mut encoder, &scene.places, scene.count + 1);
    let end = u64::from(scene.count) * 4;
    let staged = gpu.stage(&mut encoder, &scene.places, end, 4);
    let mut total = 0;
    gpu.finish(encoder, &[&staged], |_, bytes| {
        total = bytemuck::pod_read_unaligned(bytes);
    })?;
    Ok(total)
}

/// The number of pairs, added up on the host in 64 bits.
fn exact_pairs(
    gpu: &Gpu,
    passes: &Passes,
    scene: &GpuScene,
    order: &Buffer,
    part: SubFrame,
) -> Result<u64, RenderError> {
    let mut encoder = gpu.encoder();
    let frame = frame_uniform(gpu, scene, part, 0);
    gpu.run(
        &mut encoder,
        &passes.count_tiles,
        &[&frame, order, &scene.footprints, &scene.places],
        (scene.count + 1).div_ceil(GROUP),
    );
    let staged = gpu.stage(&mut encoder, &scene.places, 0, u64::from(scene.count) * 4);
    let mut total = 0;
    gpu.finish(encoder, &[&staged], |_, bytes| {
        let counts: &[u32] = bytemuck::cast_slice(bytes);
        total = counts.iter().map(|count| u64::from(*count)).sum();
    })?;
    Ok(total)
}

/// Emits, sorts by tile, finds the ranges, rasterises, and copies the picture home.
fn draw(
    gpu: &Gpu,
    passes: &Passes,
    scene: &GpuScene,
    order: &Buffer,
    (part, count): (SubFrame, u32),
    pairs: &SortBuffers,
    out: &mut RenderOutput,
) -> Result<(), RenderError> {
    let mut encoder = gpu.encoder();
    let frame = frame_uniform(gpu, scene, part, count);
    gpu.run(
        &mut encoder,
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
    let tiles = part.tiles.0 * part.tiles.1;
    let bits = 32 - (tiles - 1).leading_zeros();
    let half = sort(gpu, passes, &mut encoder, pairs, (count, bits), false);
    let ranges = gpu.storage("ranges", u64::from(tiles) * 8);
    gpu.run(
        &mut encoder,
        &passes.find_ranges,
        &[&frame, &pairs.keys[half], &ranges],
        count.div_ceil(GROUP),
    );
    let picture = gpu.storage("picture", part.pixels() * PIXEL_BYTES);
    let depths = gpu.storage("depths", part.pixels() * 4);
    gpu.run_grid(
        &mut encoder,
        &passes.raster,
        &[
            &frame,
            &ranges,
            &pairs.values[half],
            &scene.splats,
            &scene.details,
            &scene.colors,
            &picture,
            &depths,
        ],
        part.tiles,
    );
    let staged = [
        gpu.stage(&mut encoder, &picture, 0, part.pixels() * PIXEL_BYTES),
        gpu.stage(&mut encoder, &depths, 0, part.pixels() * 4),
    ];
    gpu.finish(encoder, &[&staged[0], &staged[1]], |which, bytes| {
        if which == 0 {
            let colors: &[[f32; 4]] = bytemuck::cast_slice(bytes);
            copy(part, out.width, out.height, |from, to| {
                let [r, g, b, a] = colors[from];
                out.rgb_linear[to] = [r, g, b];
                out.alpha[to] = a;
            });
        } else {
            let depths: &[f32] = bytemuck::cast_slice(bytes);
            copy(part, out.width, out.height, |from, to| {
                out.depth_acc[to] = depths[from];
            });
        }
    })
}

/// Calls `put(index in the sub-frame, index in the picture)` for every pixel they share.
fn copy(part: SubFrame, width: u32, height: u32, mut put: impl FnMut(usize, usize)) {
    let (x0, y0) = (part.first.0 * TILE, part.first.1 * TILE);
    let stride = part.tiles.0 * TILE;
    for y in 0..(part.tiles.1 * TILE).min(height - y0) {
        for x in 0..stride.min(width - x0) {
            let from = y as usize * stride as usize + x as usize;
            let to = (y0 + y) as usize * width as usize + (x0 + x) as usize;
            put(from, to);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_covers_every_tile_once_and_ends() {
        let mut seen = [[0; 9]; 5];
        let mut waiting = vec![SubFrame {
            first: (2, 3),
            tiles: (9, 5),
        }];
        while let Some(part) = waiting.pop() {
            match part.halves() {
                Some(halves) => waiting.extend(halves),
                None => seen[part.first.1 as usize - 3][part.first.0 as usize - 2] += 1,
            }
        }
        assert_eq!(seen, [[1; 9]; 5]);
    }
}
