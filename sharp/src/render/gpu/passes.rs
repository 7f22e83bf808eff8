//! The compute pipelines, one for each entry point under `shaders/`.

use wgpu::ComputePipeline;

macro_rules! shader {
    ($($file:literal),*) => {
        concat!($(include_str!(concat!("../../../../shaders/", $file)), "\n"),*)
    };
}

/// Each pass: its file's name and its text with the shared pieces before it.
const SOURCES: [(&str, &str); 7] = [
    ("project", shader!("shared/view.wgsl", "project.wgsl")),
    ("scan", shader!("shared/view.wgsl", "scan.wgsl")),
    (
        "radix_histogram",
        shader!(
            "shared/view.wgsl",
            "shared/radix.wgsl",
            "radix_histogram.wgsl"
        ),
    ),
    (
        "radix_scatter",
        shader!(
            "shared/view.wgsl",
            "shared/radix.wgsl",
            "radix_scatter.wgsl"
        ),
    ),
    (
        "emit",
        shader!("shared/view.wgsl", "shared/frame.wgsl", "emit.wgsl"),
    ),
    (
        "ranges",
        shader!("shared/view.wgsl", "shared/frame.wgsl", "ranges.wgsl"),
    ),
    (
        "raster",
        shader!(
            "shared/view.wgsl",
            "shared/frame.wgsl",
            "shared/exp2.wgsl",
            "raster.wgsl"
        ),
    ),
];

/// The pipelines in the order in which a frame runs them.
pub(super) struct Passes {
    pub(super) project: ComputePipeline,
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
        let modules = SOURCES.map(|(name, source)| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            })
        });
        let pipeline = |module: usize, entry: &str| {
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
            project: pipeline(0, "project"),
            scan_blocks: pipeline(1, "scan_blocks"),
            add_sums: pipeline(1, "add_sums"),
            radix_histogram: pipeline(2, "radix_histogram"),
            radix_scatter: pipeline(3, "radix_scatter"),
            count_tiles: pipeline(4, "count_tiles"),
            emit: pipeline(4, "emit"),
            find_ranges: pipeline(5, "find_ranges"),
            raster: pipeline(6, "raster"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::SOURCES;
    use wgpu::naga::front::wgsl;
    use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};

    #[test]
    fn every_shader_is_valid_without_any_capability() {
        for (name, source) in SOURCES {
            let module = wgsl::parse_str(source)
                .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
            Validator::new(ValidationFlags::all(), Capabilities::empty())
                .validate(&module)
                .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
            assert!(!module.entry_points.is_empty(), "{name}");
        }
    }

    #[test]
    fn every_file_under_shaders_is_used() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shaders");
        let mut files: Vec<String> = std::fs::read_dir(&folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter(|name| name.ends_with(".wgsl"))
            .collect();
        files.sort();
        let mut used = SOURCES.map(|(name, _)| format!("{name}.wgsl"));
        used.sort();
        assert_eq!(files, used);
    }
}
