//! A page that draws Gaussians in a browser: one file that opens from disk and loads nothing else.
//!
//! WebGPU runs the renderer's own shaders ([`sharp_shaders::PASSES`]); `screen.wgsl` draws the result on the screen.
//! Browsers without WebGPU show pictures rendered when the page was written.

use std::io::{self, Write};
use std::path::Path;

use askama::Template;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DAffine3;
use image::RgbImage;
use serde_json::json;
use sha2::{Digest as _, Sha256};
use sharp::color::Quantization;
use sharp::gaussians::{Gaussians, Harmonics};
use sharp::ply::ColorSpace;
use sharp::render::{Background, RenderView};
use sharp::trajectory::DepthRange;

use crate::io::atomic_files::{FileError, write_over_own};
use crate::report::html::{STYLE, VERSION, without_tags};
use crate::report::pictures::Thumbnail;

const SCRIPT: &str = concat!(
    "'use strict';\n",
    include_str!("../../templates/gaussians/renderer.js"),
    include_str!("../../templates/gaussians/page.js"),
);
const SCREEN: (&str, &str) = (
    "screen",
    include_str!("../../templates/gaussians/screen.wgsl"),
);
/// Maximum number of pictures along a camera path.
const PICTURES: usize = 12;
/// Marks a page as written by this program.
const MARK: &str = "<meta name=\"generator\" content=\"sharp-bench viewer\">";

/// A self-contained page that renders Gaussians in a browser, from given views.
pub struct Viewer<'a> {
    pub title: &'a str,
    pub scene: &'a Gaussians,
    /// Reference camera, for example the photograph's.
    pub photograph: DAffine3,
    /// At least one view; all views have the same intrinsics and the same rendering rule.
    pub views: &'a [RenderView],
    pub background: Background,
    pub quantization: Quantization,
}

#[derive(Template)]
#[template(path = "gaussians/page.html")]
struct ViewerPage<'a> {
    title: &'a str,
    lead: String,
    views: usize,
    /// Distance of the focus, in metres.
    focus: String,
    facts: String,
    shaders: String,
    gaussians: String,
    /// Pictures as data URLs.
    pictures: Vec<String>,
}

impl ViewerPage<'_> {
    fn script_sha256(&self) -> String {
        STANDARD.encode(Sha256::digest(SCRIPT))
    }
}

impl Viewer<'_> {
    /// Indices of the views whose pictures [`Self::write`] embeds: evenly spaced, including the first and the last
    /// view.
    pub fn pictured(&self) -> Vec<usize> {
        let last = self.views.len().saturating_sub(1);
        let mut chosen: Vec<usize> = (0..PICTURES).map(|i| i * last / (PICTURES - 1)).collect();
        chosen.dedup();
        chosen
    }

    /// Writes the page with one rendering per [pictured](Self::pictured) view. Overwrites only an earlier page.
    ///
    /// # Errors
    /// If the file cannot be written, or exists and is not a viewer page.
    pub fn write(&self, path: &Path, pictures: &[RgbImage]) -> Result<(), FileError> {
        let page = self
            .page(pictures)
            .map_err(FileError::new(path, "fill in"))?;
        write_over_own(path, page.as_bytes(), MARK)
    }

    fn page(&self, pictures: &[RgbImage]) -> io::Result<String> {
        let mut visible = drawable(self.scene);
        let depth = DepthRange::seen_from(&visible, &self.photograph);
        let focus = depth.map_or(1.0, |depth| depth.focus);
        let [near, far] = depth.map_or([1.0, 2.0], |depth| [depth.near, depth.far]);
        let Some(first) = self.views.first() else {
            return Err(io::Error::other("a page needs at least one view"));
        };
        let (k, rule) = (first.intrinsics, first.rule);
        // Leave out harmonics that are not drawn.
        let all = visible.harmonics.per_gaussian();
        let degree = visible.harmonics.degree.min(rule.degree);
        let drawn = Harmonics::coefficients_of(degree);
        if drawn < all {
            let of_each = visible.harmonics.coefficients.chunks_exact(all);
            let coefficients = of_each.flat_map(|own| own[..drawn].to_vec()).collect();
            visible.harmonics = Harmonics {
                degree,
                coefficients,
            };
        }
        let shared = first.shader_constants();
        let facts = json!({
            "count": visible.len(),
            "size": [k.width, k.height],
            "focal": [k.fx, k.fy],
            "center": shared.center,
            "bounds": shared.bounds.as_flattened(),
            "eps2d": rule.low_pass,
            "near": shared.near,
            // JSON has no infinity, so write the largest f32 instead.
            "far": rule.far.min(f32::MAX),
            "alpha_max": rule.alpha_max,
            "compensation": shared.compensation,
            "tiled": shared.tiled,
            "degree": degree,
            "encoded": rule.blending == ColorSpace::Srgb,
            "photograph": rows(&self.photograph),
            "views": self.views.iter().map(|view| rows(&view.camera_from_scene)).collect::<Vec<_>>(),
            "pictures": self.pictured(),
            "focus_m": focus,
            "inverse_depth": [1.0 / far, 1.0 / near],
            "background": self.background.in_space(rule.blending),
            "truncate": self.quantization == Quantization::Truncate,
        });
        let shaders: Vec<_> = sharp_shaders::PASSES.into_iter().chain([SCREEN]).collect();
        let page = ViewerPage {
            title: self.title,
            lead: format!(
                "{} Gaussians, {}×{} pixels, rule {rule}, over {}: drawn in this page by the renderer's own shaders.",
                self.scene.len(),
                k.width,
                k.height,
                self.background
            ),
            views: self.views.len(),
            focus: format!("{focus:.2}"),
            facts: without_tags(&facts),
            shaders: without_tags(&json!(shaders)),
            gaussians: STANDARD.encode(packed(&visible)?),
            pictures: pictures.iter().map(address).collect::<io::Result<_>>()?,
        };
        page.render().map_err(io::Error::other)
    }
}

/// The Gaussians that can be visible. The order of the Gaussians is kept, because it decides which
/// of two Gaussians at equal depth is drawn first.
fn drawable(scene: &Gaussians) -> Gaussians {
    scene.filtered(|k| scene.is_finite(k) && scene.opacities[k] >= 1.0 / 255.0)
}

/// The matrix by rows, with the offset in the last column.
fn rows(map: &DAffine3) -> [[f64; 4]; 3] {
    let linear = map.matrix3.transpose();
    let rows = [linear.x_axis, linear.y_axis, linear.z_axis];
    let offset = map.translation.to_array();
    std::array::from_fn(|i| [rows[i].x, rows[i].y, rows[i].z, offset[i]])
}

/// Means, opacities, quaternions, scales, colours and harmonics as columns of f32. Each column is split into byte
/// planes, because deflate then compresses it to about three quarters.
fn packed(scene: &Gaussians) -> io::Result<Vec<u8>> {
    let harmonics = &scene.harmonics;
    let arrays = [
        (scene.means.as_flattened(), 3),
        (scene.opacities.as_slice(), 1),
        (scene.quaternions.as_flattened(), 4),
        (scene.scales.as_flattened(), 3),
        (scene.colors.as_flattened(), 3),
        (
            harmonics.coefficients.as_flattened(),
            3 * harmonics.per_gaussian(),
        ),
    ];
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    for (values, width) in arrays {
        for column in 0..width {
            for byte in 0..4 {
                let values = values.iter().skip(column).step_by(width);
                let plane: Vec<u8> = values.map(|value| value.to_le_bytes()[byte]).collect();
                encoder.write_all(&plane)?;
            }
        }
    }
    encoder.finish()
}

fn address(picture: &RgbImage) -> io::Result<String> {
    let whole = Thumbnail::new(picture, u32::MAX).map_err(io::Error::other)?;
    Ok(whole.address())
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use flate2::read::GzDecoder;
    use sharp::camera::Intrinsics;

    use super::*;

    fn scene() -> Gaussians {
        let mut scene = Gaussians::default();
        for k in 0..5_u8 {
            let k = f32::from(k);
            scene.means.push([k, -k, 2.0 + k]);
            scene.quaternions.push([1.0, 0.0, 0.5, k]);
            scene.scales.push([0.1, 0.2, 0.3 + k]);
            scene.opacities.push(0.2 * k);
            scene.colors.push([0.5, 0.25, k]);
        }
        scene
    }

    #[test]
    fn what_is_packed_comes_back_and_leaves_out_only_what_leaves_no_trace() {
        let mut scene = scene();
        scene.means[3][1] = f32::NAN;
        let visible = drawable(&scene);
        // The first is transparent, the fourth is NaN.
        assert_eq!(
            visible.means,
            [scene.means[1], scene.means[2], scene.means[4]]
        );
        let mut planes = Vec::new();
        GzDecoder::new(packed(&visible).unwrap().as_slice())
            .read_to_end(&mut planes)
            .unwrap();
        assert_eq!(planes.len(), 3 * 14 * 4);
        let at = |column: usize, k: usize| {
            let byte = |plane: usize| planes[(column * 4 + plane) * 3 + k];
            f32::from_le_bytes(std::array::from_fn(byte))
        };
        for k in 0..3 {
            assert_eq!([at(0, k), at(1, k), at(2, k)], visible.means[k]);
            assert_eq!(at(3, k), visible.opacities[k]);
            assert_eq!(
                [at(4, k), at(5, k), at(6, k), at(7, k)],
                visible.quaternions[k]
            );
            assert_eq!([at(8, k), at(9, k), at(10, k)], visible.scales[k]);
            assert_eq!([at(11, k), at(12, k), at(13, k)], visible.colors[k]);
        }
    }

    fn views(count: usize) -> Vec<RenderView> {
        let intrinsics = Intrinsics::new((8.0, 8.0), (4.0, 4.0), (8, 8)).unwrap();
        vec![RenderView::new(DAffine3::IDENTITY, intrinsics); count]
    }

    fn viewer<'a>(title: &'a str, scene: &'a Gaussians, views: &'a [RenderView]) -> Viewer<'a> {
        Viewer {
            title,
            scene,
            photograph: DAffine3::IDENTITY,
            views,
            background: Background::Black,
            quantization: Quantization::Round,
        }
    }

    #[test]
    fn a_hostile_name_stays_text() {
        let (scene, views) = (scene(), views(1));
        let title = "</script><img src=x onerror=alert(1)>.ply";
        let viewer = viewer(title, &scene, &views);
        assert_eq!(viewer.pictured(), [0]);
        let page = viewer.page(&[RgbImage::new(8, 8)]).unwrap();
        assert!(!page.contains("<img src=x"));
        assert_eq!(page.matches("</script>").count(), 4);
        assert!(page.contains(MARK));
    }

    #[test]
    fn a_page_is_written_over_a_page_and_nothing_else() {
        let (scene, mut views) = (scene(), views(1));
        views[0].rule.far = f32::INFINITY;
        let viewer = viewer("scene.ply", &scene, &views);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("new/page.html");
        let pictures = [RgbImage::new(8, 8)];
        viewer.write(&path, &pictures).unwrap();
        viewer.write(&path, &pictures).unwrap();
        assert!(
            std::fs::read_to_string(&path)
                .unwrap()
                .contains("\"far\":3.4028")
        );
        std::fs::write(&path, "mine").unwrap();
        let error = viewer.write(&path, &pictures).unwrap_err().to_string();
        assert!(error.contains("of another kind"), "{error}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "mine");
    }

    #[test]
    fn pictures_are_spread_over_a_path() {
        let (empty, views) = (Gaussians::default(), views(60));
        let pictured = |n: usize| viewer("", &empty, &views[..n]).pictured();
        let many = pictured(60);
        assert_eq!((many.len(), many[0], many[11]), (12, 0, 59));
        assert_eq!(pictured(3), [0, 1, 2]);
    }
}
