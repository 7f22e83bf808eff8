//! The compute pipelines, one per entry point under `shaders/`.

use sharp_shaders::PASSES;
use wgpu::ComputePipeline;

/// The pipelines in the order in which a frame runs them.
pub(super) struct Passes {
    pub(super) project: ComputePipeline,
    pub(super) harmonics: ComputePipeline,
    pub(super) scan_blocks: ComputePipeline,
    pub(super) add_sums: ComputePipeline,
    pub(super) radix_histogram: ComputePipeline,
    pub(super) radix_scatter: ComputePipeline,
    pub(super) count_tiles: ComputePipeline,
    pub(super) emit: ComputePipeline,
    pub(super) find_ranges: ComputePipeline,
    pub(super) raster: ComputePipeline,
}

impl Passes {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let modules = PASSES.map(|(name, source)| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            })
        });
        let pass = |module: usize, entry: &str| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: None,
                module: &modules[module],
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        };
        Self {
            project: pass(0, "project"),
            scan_blocks: pass(1, "scan_blocks"),
            add_sums: pass(1, "add_sums"),
            radix_histogram: pass(2, "radix_histogram"),
            radix_scatter: pass(2, "radix_scatter"),
            count_tiles: pass(3, "count_tiles"),
            emit: pass(3, "emit"),
            find_ranges: pass(4, "find_ranges"),
            raster: pass(5, "raster"),
            harmonics: pass(6, "harmonics"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::PASSES;
    use wgpu::naga::front::wgsl;
    use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};

    #[test]
    fn every_shader_is_valid_without_any_capability() {
        for (name, source) in PASSES {
            let module = wgsl::parse_str(source)
                .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
            Validator::new(ValidationFlags::all(), Capabilities::empty())
                .validate(&module)
                .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
            assert!(!module.entry_points.is_empty(), "{name}");
        }
    }

    #[test]
    fn every_file_under_shaders_is_used_and_has_its_twin() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        let folder = root.join("../shaders");
        let mut files: Vec<String> = std::fs::read_dir(&folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter(|name| name.ends_with(".wgsl"))
            .collect();
        files.sort();
        let mut used = PASSES.map(|(name, _)| format!("{name}.wgsl"));
        used.sort();
        assert_eq!(files, used);
        for (name, _) in PASSES {
            let twin = root.join("src/render").join(name).with_extension("rs");
            assert!(twin.is_file(), "{}", twin.display());
        }
    }
}
