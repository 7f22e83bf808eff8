//! The renderer's passes as WGSL: what the wgpu backend runs, and the pages with a viewer in a browser.

macro_rules! shader {
    ($($file:literal),*) => {
        concat!($(include_str!($file), "\n"),*)
    };
}

/// Each pass: its file's name and its text with the shared pieces before it.
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
