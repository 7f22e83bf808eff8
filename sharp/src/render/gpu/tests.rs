//! Each pass against its twin on the CPU, on every adapter. Ignored by default, because a test
//! cannot report at run time that there is no adapter.

use super::super::emit::{BIN, BinGrid, count, emit, key};
use super::super::project::{Footprint, Projected, project};
use super::super::ranges::TileLists;
use super::super::{CpuRenderer, RenderError, RenderView, Renderer, Simd, radix, scan};
use super::frame::{Frame, Work};
use super::memory::GpuBuffer;
use super::scene::GpuScene;
use super::sort::{Scan, SortBuffers};
use super::subframe::SubFrame;
use super::{GpuAdapter, GpuRenderer};
use crate::camera::Intrinsics;
use crate::gaussians::Gaussians;
use glam::{DAffine3, DVec3};

fn on_each_adapter(test: impl Fn(&GpuRenderer)) {
    let adapters = GpuAdapter::all();
    assert!(!adapters.is_empty(), "there is no adapter");
    for adapter in adapters {
        test(&GpuRenderer::new(&adapter).unwrap());
    }
}

/// Pseudo-random numbers.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as u32
    }

    fn within(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * (self.bits() as f32 / (1_u64 << 31) as f32)
    }
}

const SIZE: (u32, u32) = (300, 210);

fn view() -> RenderView {
    let k = Intrinsics::new((260.0, 255.0), (148.0, 107.0), SIZE).unwrap();
    let turn = DAffine3::from_axis_angle(DVec3::new(0.2, 0.9, -0.1).normalize(), 0.1);
    RenderView::new(turn, k)
}

/// Gaussians with equal scales if `round`, else with three different ones. They include some that
/// are dropped, for every possible reason.
fn scene(count: usize, round: bool) -> Gaussians {
    let mut random = Random(7);
    let mut scene = Gaussians::default();
    for k in 0..count {
        let z = random.within(-0.2, 4.0);
        scene.means.push([
            random.within(-0.8, 0.8) * z,
            random.within(-0.6, 0.6) * z,
            z,
        ]);
        scene
            .quaternions
            .push([0, 1, 2, 3].map(|_| random.within(-1.0, 1.0)));
        let scale = random.within(0.003, 0.06);
        let factors = [0, 1, 2].map(|_| if round { 1.0 } else { random.within(0.2, 1.0) });
        scene.scales.push(factors.map(|f| f * scale));
        scene.opacities.push(random.within(-0.02, 1.0));
        scene
            .colors
            .push([0, 1, 2].map(|_| random.within(0.0, 1.0)));
        match k % 50 {
            11 => scene.means[k][1] = f32::NAN,
            12 => scene.quaternions[k] = [0.0; 4],
            13 => scene.scales[k] = [0.0; 3],
            // A tie in depth.
            14 => scene.means[k] = scene.means[k - 4],
            _ => (),
        }
    }
    scene
}

fn read<T: bytemuck::AnyBitPattern>(gpu: &GpuRenderer, buffer: &GpuBuffer, count: usize) -> Vec<T> {
    let bytes = (count * size_of::<T>()) as u64;
    let mut encoder = gpu.gpu.encoder();
    let staged = gpu.gpu.stage(&mut encoder, buffer, bytes);
    let mut found = Vec::new();
    gpu.gpu
        .finish(encoder, &[(&staged, bytes)], |_, bytes| {
            found = bytes
                .chunks_exact(size_of::<T>())
                .map(bytemuck::pod_read_unaligned)
                .collect();
        })
        .unwrap();
    found
}

#[test]
#[ignore = "needs an adapter"]
fn scan_is_its_twin() {
    on_each_adapter(|renderer| {
        let gpu = &renderer.gpu;
        for count in [1, 2, 1023, 1024, 1025, 5000, (1 << 20) + 1] {
            let mut random = Random(count);
            let counts: Vec<u32> = (0..count).map(|_| random.bits() % 1000).collect();
            let data = gpu.filled("data", &counts);
            let buffers = Scan::new(gpu, count);
            let mut encoder = gpu.encoder();
            let count = counts.len() as u32;
            buffers.scan(gpu, &renderer.passes, &mut encoder, &data, count);
            gpu.finish(encoder, &[], |_, _| ()).unwrap();
            let mut expected = Vec::new();
            scan::scan(&counts, &mut expected);
            let found: Vec<u32> = read(renderer, &data, counts.len());
            assert!(found == expected[..counts.len()], "{count}");
        }
    });
}

#[test]
#[ignore = "needs an adapter"]
fn radix_is_its_twin() {
    on_each_adapter(|renderer| {
        let gpu = &renderer.gpu;
        for count in [1, 2, 255, 4096, 4097, 300_000] {
            let mut random = Random(u64::from(count));
            let depths: Vec<u32> = (0..count)
                .map(|k| random.bits() % if k % 2 == 0 { 50 } else { u32::MAX })
                .collect();
            let buffers = SortBuffers::new(gpu, u64::from(count));
            gpu.queue
                .write_buffer(&buffers.keys[0], 0, bytemuck::cast_slice(&depths));
            let mut encoder = gpu.encoder();
            let half = buffers.sort(gpu, &renderer.passes, &mut encoder, (count, 32), true);
            gpu.finish(encoder, &[], |_, _| ()).unwrap();
            let mut expected: Vec<u64> = depths
                .iter()
                .zip(0..)
                .map(|(z, k)| key(f32::from_bits(*z), k))
                .collect();
            radix::sort(&mut expected, &mut Vec::new());
            let keys: Vec<u32> = read(renderer, &buffers.keys[half], count as usize);
            let values: Vec<u32> = read(renderer, &buffers.values[half], count as usize);
            let found = keys
                .iter()
                .zip(&values)
                .map(|(z, k)| key(f32::from_bits(*z), *k));
            assert!(found.eq(expected), "{count}");
        }
    });
}

/// A frame after `project` on the GPU, and the CPU's results for the same scene.
struct Both {
    on_device: GpuScene,
    cpu: Projected,
    footprints: Vec<Footprint>,
}

impl Both {
    fn new(renderer: &GpuRenderer, scene: &Gaussians, view: &RenderView) -> Self {
        let on_device = GpuScene::upload(&renderer.gpu, scene).unwrap();
        let mut encoder = renderer.gpu.encoder();
        frame(renderer, &on_device, view, 8).project(&mut encoder);
        renderer.gpu.finish(encoder, &[], |_, _| ()).unwrap();
        let mut cpu = Projected::default();
        project(Simd::detect(), scene, view, &mut cpu);
        let boxes: Vec<[u16; 4]> = read(renderer, &on_device.footprints, scene.len());
        let depths: Vec<f32> = read(renderer, &on_device.by_depth.keys[0], scene.len());
        let footprints = boxes
            .iter()
            .zip(depths)
            .map(|(&[x0, x1, y0, y1], z)| Footprint { x0, x1, y0, y1, z })
            .collect();
        Self {
            on_device,
            cpu,
            footprints,
        }
    }

    /// Runs the passes up to `ranges` for tiles of `side` pixels; returns each tile's list.
    fn lists(&self, renderer: &GpuRenderer, view: &RenderView, side: u32) -> Vec<Vec<u32>> {
        let gpu = &renderer.gpu;
        let frame = frame(renderer, &self.on_device, view, side);
        let mut encoder = gpu.encoder();
        let count = (self.on_device.count, 32);
        let by_depth = &self.on_device.by_depth;
        let half = by_depth.sort(gpu, &renderer.passes, &mut encoder, count, true);
        gpu.finish(encoder, &[], |_, _| ()).unwrap();
        let order = &by_depth.values[half];
        let whole = SubFrame::whole(SIZE.0, SIZE.1, side);
        let pairs = frame.count_pairs(order, whole).unwrap() as u32;
        let mut work = Work::new(gpu);
        let mut encoder = gpu.encoder();
        let half = frame.list(&mut encoder, order, (whole, pairs), &mut work);
        gpu.finish(encoder, &[], |_, _| ()).unwrap();
        let members: Vec<u32> = read(renderer, &work.pairs.values[half], pairs as usize);
        let ranges: Vec<[u32; 2]> = read(renderer, &work.targets.ranges, whole.count() as usize);
        ranges
            .iter()
            .map(|[from, to]| members[*from as usize..*to as usize].to_vec())
            .collect()
    }
}

fn frame<'a>(
    renderer: &'a GpuRenderer,
    scene: &'a GpuScene,
    view: &'a RenderView,
    tile: u32,
) -> Frame<'a> {
    Frame {
        copied: true,
        gpu: &renderer.gpu,
        passes: &renderer.passes,
        scene,
        view,
        tile,
    }
}

#[test]
#[ignore = "needs an adapter"]
fn project_is_its_twin() {
    on_each_adapter(|renderer| {
        let scene = scene(6000, false);
        let view = view();
        let both = Both::new(renderer, &scene, &view);
        let splats: Vec<[f32; 4]> = read(renderer, &both.on_device.splats, scene.len());
        let details: Vec<[f32; 4]> = read(renderer, &both.on_device.details, scene.len());
        let mut drawn = 0;
        for k in 0..scene.len() {
            let (cpu, expected) = (&both.cpu.splats[k], &both.cpu.footprints[k]);
            let (found, splat, detail) = (&both.footprints[k], &splats[k], &details[k]);
            if expected.is_empty() {
                continue;
            }
            drawn += 1;
            // The bits of z determine the drawing order, so they must be equal.
            assert_eq!(found.z.to_bits(), expected.z.to_bits(), "{k}");
            assert_eq!((detail[1], detail[2]), (cpu.opacity, expected.z), "{k}");
            for axis in 0..2 {
                let off = (f64::from(splat[axis]) - cpu.mean[axis]).abs();
                assert!(off < 1e-3, "{k}: {off} pixels");
            }
            let size = cpu.p.abs() + cpu.q.abs() + cpu.r.abs();
            let factor = [splat[2], splat[3], detail[0]];
            for (found, expected) in factor.iter().zip([cpu.p, cpu.q, cpu.r]) {
                assert!((found - expected).abs() < 1e-4 * size, "{k}: {factor:?}");
            }
            // The box is never smaller, and at most one pixel larger.
            for (found, expected) in [
                (expected.x0, found.x0),
                (expected.y0, found.y0),
                (found.x1, expected.x1),
                (found.y1, expected.y1),
            ] {
                assert!(
                    (0..=1).contains(&(i32::from(found) - i32::from(expected))),
                    "{k}"
                );
            }
        }
        assert!(drawn > 3000, "{drawn}");
    });
}

#[test]
#[ignore = "needs an adapter"]
fn emit_is_its_twin() {
    on_each_adapter(|renderer| {
        let (scene, view) = (scene(6000, false), view());
        let both = Both::new(renderer, &scene, &view);
        let lists = both.lists(renderer, &view, BIN as u32);
        let grid = BinGrid::new(SIZE.0, SIZE.1);
        let counts = count(grid, &both.footprints);
        let bins = emit(grid, &both.footprints, &counts, 0..grid.len());
        assert_eq!(lists.len(), grid.len());
        let mut keys = Vec::new();
        for (bin, found) in lists.iter().enumerate() {
            bins.gather(bin, &mut keys);
            radix::sort(&mut keys, &mut Vec::new());
            assert!(keys.len() > 100);
            let expected = keys.iter().map(|key| *key as u32);
            assert!(found.iter().copied().eq(expected), "bin {bin}");
        }
    });
}

#[test]
#[ignore = "needs an adapter"]
fn ranges_is_its_twin() {
    on_each_adapter(|renderer| {
        // The CPU lists slanted Gaussians in fewer tiles than their boxes cover, so use round ones.
        let (scene, view) = (scene(3000, true), view());
        let both = Both::new(renderer, &scene, &view);
        let found = both.lists(renderer, &view, 8);
        let grid = BinGrid::new(SIZE.0, SIZE.1);
        let counts = count(grid, &both.footprints);
        let bins = emit(grid, &both.footprints, &counts, 0..grid.len());
        let (mut keys, mut lists) = (Vec::new(), TileLists::default());
        let columns = SIZE.0.div_ceil(8) as usize;
        let mut compared = 0;
        for bin in 0..grid.len() {
            bins.gather(bin, &mut keys);
            radix::sort(&mut keys, &mut Vec::new());
            let corner = [bin % grid.columns * BIN, bin / grid.columns * BIN];
            lists.load(&keys, &both.cpu.splats, &both.footprints, corner);
            lists.for_each_band(8, |band| {
                for ((x, y), members) in band.tiles() {
                    let (x, y) = ((corner[0] + x) / 8, (corner[1] + y) / 8);
                    let expected = members.iter().map(|m| keys[*m as usize] as u32);
                    if x < columns && y < SIZE.1.div_ceil(8) as usize {
                        let found = found[y * columns + x].iter().copied();
                        assert!(found.eq(expected), "tile {x}, {y}");
                        compared += members.len();
                    }
                }
            });
        }
        assert!(compared > 3000, "{compared}");
    });
}

#[test]
#[ignore = "needs an adapter"]
fn raster_is_its_twin() {
    on_each_adapter(|renderer| {
        let (scene, view) = (scene(6000, false), view());
        let on_device = GpuScene::upload(&renderer.gpu, &scene).unwrap();
        let mut work = Work::new(&renderer.gpu);
        let frame = frame(renderer, &on_device, &view, 8);
        let found = frame.render(&mut work).unwrap();
        let expected = CpuRenderer::new().render(&scene, &view).unwrap();
        assert_eq!(found.dropped, expected.dropped);
        let mut far = 0;
        for i in 0..found.alpha.len() {
            let mut off = (found.alpha[i] - expected.alpha[i]).abs();
            for channel in 0..3 {
                let (a, b) = (found.rgb[i][channel], expected.rgb[i][channel]);
                off = off.max((a - b).abs());
            }
            // At most one threshold decides differently.
            assert!(off <= 1.0 / 255.0, "{off}");
            far += u32::from(off > 2e-5);
        }
        assert!(far * 1000 < SIZE.0 * SIZE.1, "{far}");
    });
}

#[test]
#[ignore = "needs an adapter"]
fn a_lost_device_is_an_error_of_its_own() {
    for adapter in GpuAdapter::all() {
        let mut renderer = GpuRenderer::new(&adapter).unwrap();
        let scene = scene(500, false);
        renderer.render(&scene, &view()).unwrap();
        renderer.gpu.device.destroy();
        for _ in 0..2 {
            let error = renderer.render(&scene, &view()).unwrap_err();
            assert!(matches!(error, RenderError::DeviceLost { .. }), "{error:?}");
            assert!(error.is_device_fault());
        }
        // Another device of the same adapter still works.
        let mut renderer = GpuRenderer::new(&adapter).unwrap();
        renderer.render(&scene, &view()).unwrap();
    }
}
