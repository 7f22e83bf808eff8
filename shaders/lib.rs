//! The renderer's passes in WGSL, used by the wgpu backend and by the browser viewer of the report pages.

macro_rules! shader {
    ($($file:literal),*) => {
        concat!($(include_str!($file), "\n"),*)
    };
}

/// Name and text of each pass; the text includes the shared files.
pub const PASSES: [(&str, &str); 7] = [
    ("project", shader!("shared/view.wgsl", "project.wgsl")),
    ("scan", shader!("shared/view.wgsl", "scan.wgsl")),
    (
        "radix",
        shader!("shared/view.wgsl", "shared/radix.wgsl", "radix.wgsl"),
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
    ("harmonics", shader!("shared/view.wgsl", "harmonics.wgsl")),
];
