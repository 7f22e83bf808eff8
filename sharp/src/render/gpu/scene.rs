//! A scene on the device.

use super::super::RenderError;
use super::device::Gpu;
use super::memory::GpuBuffer;
use super::sort::{Scan, SortBuffers};
use crate::gaussians::Gaussians;

/// Gaussians on the device, with the buffers that a frame fills: 124 bytes per Gaussian, plus 12 for each harmonics
/// coefficient.
pub(super) struct GpuScene {
    pub(super) count: u32,
    pub(super) means_opacities: GpuBuffer,
    pub(super) quaternions: GpuBuffer,
    pub(super) scales: GpuBuffer,
    pub(super) colors: GpuBuffer,
    pub(super) coefficients: GpuBuffer,
    pub(super) degree: usize,
    pub(super) splats: GpuBuffer,
    pub(super) details: GpuBuffer,
    pub(super) footprints: GpuBuffer,
    pub(super) by_depth: SortBuffers,
    pub(super) places: GpuBuffer,
    pub(super) scan: Scan,
}

impl GpuScene {
    pub(super) fn upload(gpu: &Gpu, scene: &Gaussians) -> Result<Self, RenderError> {
        let n = scene.len() as u64;
        let most = n * (scene.harmonics.per_gaussian() as u64 * 12).max(16);
        if most > gpu.binding_limit {
            return Err(gpu.no_room(format!(
                "{n} Gaussians need bindings of {most} bytes, but the limit is {}",
                gpu.binding_limit
            )));
        }
        let wide = |v: [f32; 3], w: f32| [v[0], v[1], v[2], w];
        let means: Vec<[f32; 4]> = scene
            .means
            .iter()
            .zip(&scene.opacities)
            .map(|(mean, opacity)| wide(*mean, *opacity))
            .collect();
        let scales: Vec<[f32; 4]> = scene
            .scales
            .iter()
            .enumerate()
            .map(|(k, scale)| wide(*scale, f32::from(u8::from(scene.is_finite(k)))))
            .collect();
        let colors: Vec<[f32; 4]> = scene.colors.iter().map(|c| wide(*c, 0.0)).collect();
        let uploaded = Self {
            // The count was already checked against u32::MAX with the rest of the scene.
            count: n as u32,
            means_opacities: gpu.filled("means", &means),
            quaternions: gpu.filled("quaternions", &scene.quaternions),
            scales: gpu.filled("scales", &scales),
            colors: gpu.filled("colors", &colors),
            coefficients: gpu.filled("coefficients", &scene.harmonics.coefficients),
            degree: scene.harmonics.degree,
            splats: gpu.storage("splats", n * 16),
            details: gpu.storage("details", n * 16),
            footprints: gpu.storage("footprints", n * 8),
            by_depth: SortBuffers::new(gpu, n),
            places: gpu.storage("places", (n + 1) * 4),
            scan: Scan::new(gpu, n + 1),
        };
        // Waits, so that wgpu frees its copies of the data.
        gpu.finish(gpu.encoder(), &[], |_, _| ())?;
        Ok(uploaded)
    }
}
