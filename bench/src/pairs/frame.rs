//! Resizes and crops the views of a dataset to another resolution, as a protocol requires. Cameras are adjusted
//! accordingly, before any other processing.
//!
//! Text form, the setting `frame=RULE:SIZE:KERNEL` of a dataset:
//! * `cover:256x256:lanczos`: scaled by one factor (sides rounded) to cover the size, then centre-cropped;
//! * `cover8:256x256:lanczos`: as `cover`, with the width rounded to a multiple of 8, as in LVSM;
//! * `stretch:384x256:lanczos`: each side scaled by its own factor;
//! * `width:1600:bicubic`: wider pictures reduced to that width, height rounded down.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use image::{GrayImage, Luma, RgbImage, imageops};
use sharp::camera::Intrinsics;
use sharp_datasets::format::FloatMap;
use sharp_datasets::processing::Processing;
use sharp_datasets::required_files::FileRole;
use sharp_datasets::{DatasetError, DepthMap, View, ViewContent};
use sharp_metrics::{Picture, ResizeKernel, resize};

use crate::io::pictures::to_rgb8;

/// A rule for resizing and cropping pictures to a protocol's size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    pub rule: FrameRule,
    /// A kernel whose input and output are 8 bit.
    pub kernel: ResizeKernel,
}

/// Rules; sizes are width and height, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameRule {
    Cover(u32, u32),
    CoverOfEights(u32, u32),
    Stretch(u32, u32),
    AtMostWidth(u32),
}

/// How pictures of one size are resized and cropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Fit {
    resized: (u32, u32),
    /// Top left corner and size of the crop.
    corner: (u32, u32),
    size: (u32, u32),
}

impl Frame {
    /// Kernels with 8-bit input and output.
    const KERNELS: [ResizeKernel; 3] = [
        ResizeKernel::Lanczos,
        ResizeKernel::Bicubic,
        ResizeKernel::Area,
    ];

    /// The accepted forms, for help and errors.
    pub fn forms() -> String {
        let kernels = Self::KERNELS.map(|kernel| kernel.name()).join("|");
        format!(
            "cover:WxH:KERNEL, cover8:WxH:KERNEL, stretch:WxH:KERNEL or width:W:KERNEL (pixels; KERNEL {kernels})"
        )
    }

    /// How a picture of `w` × `h` pixels is resized and cropped. Errors do not name the view.
    fn fit(&self, (w, h): (u32, u32)) -> Result<Fit, String> {
        let fit = |resized, size: (u32, u32)| {
            let (rw, rh): (u32, u32) = resized;
            let corner = (rw.saturating_sub(size.0) / 2, rh.saturating_sub(size.1) / 2);
            Fit {
                resized,
                corner,
                size,
            }
        };
        let smaller = |to_w: u32, to_h: u32| {
            if w < to_w || h < to_h {
                Err(format!(
                    "frame={self}: a view is {w}x{h}, and pictures are never enlarged"
                ))
            } else {
                Ok(())
            }
        };
        let rounded = |side: f64| side.round_ties_even() as u32;
        let (fw, fh) = (f64::from(w), f64::from(h));
        Ok(match self.rule {
            FrameRule::Cover(to_w, to_h) => {
                smaller(to_w, to_h)?;
                let scale = (f64::from(to_w) / fw).max(f64::from(to_h) / fh);
                fit((rounded(fw * scale), rounded(fh * scale)), (to_w, to_h))
            }
            FrameRule::CoverOfEights(to_w, to_h) => {
                smaller(to_w, to_h)?;
                let width = (f64::from(to_h) / fh * fw).trunc();
                let width = 8 * rounded(width / 8.0);
                if width < to_w {
                    return Err(format!(
                        "frame={self}: a view of {w}x{h} is too narrow for this rule"
                    ));
                }
                fit((width, to_h), (to_w, to_h))
            }
            FrameRule::Stretch(to_w, to_h) => {
                smaller(to_w, to_h)?;
                fit((to_w, to_h), (to_w, to_h))
            }
            FrameRule::AtMostWidth(most) if w > most => {
                let height = (fh / (fw / f64::from(most))) as u32;
                fit((most, height.max(1)), (most, height.max(1)))
            }
            FrameRule::AtMostWidth(_) => fit((w, h), (w, h)),
        })
    }

    /// The resized and cropped view. Errors do not name the view.
    pub fn apply(&self, view: &View) -> Result<View, String> {
        let before = view.intrinsics;
        let fit = self.fit((before.width, before.height))?;
        let resized = before.resized(fit.resized.0, fit.resized.1);
        let intrinsics = Intrinsics {
            cx: resized.cx - f64::from(fit.corner.0),
            cy: resized.cy - f64::from(fit.corner.1),
            width: fit.size.0,
            height: fit.size.1,
            ..resized
        };
        Ok(View {
            intrinsics,
            content: Arc::new(Framed {
                whole: Arc::clone(&view.content),
                from: (before.width, before.height),
                kernel: self.kernel,
                fit,
            }),
            ..view.clone()
        })
    }
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.rule {
            FrameRule::Cover(w, h) => write!(f, "cover:{w}x{h}:{}", self.kernel),
            FrameRule::CoverOfEights(w, h) => write!(f, "cover8:{w}x{h}:{}", self.kernel),
            FrameRule::Stretch(w, h) => write!(f, "stretch:{w}x{h}:{}", self.kernel),
            FrameRule::AtMostWidth(w) => write!(f, "width:{w}:{}", self.kernel),
        }
    }
}

impl FromStr for Frame {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("frame={text}: expected {}", Self::forms());
        let side = |text: &str| {
            let side = text.parse().ok();
            let side = side.filter(|side| (1..=1 << 14).contains(side));
            side.ok_or_else(wrong)
        };
        let [rule, size, kernel] =
            <[&str; 3]>::try_from(text.split(':').collect::<Vec<_>>()).map_err(|_| wrong())?;
        let kernel = Self::KERNELS.into_iter().find(|k| k.name() == kernel);
        let kernel = kernel.ok_or_else(wrong)?;
        let rule = match (rule, size.split_once('x')) {
            ("width", None) => FrameRule::AtMostWidth(side(size)?),
            ("cover", Some((w, h))) => FrameRule::Cover(side(w)?, side(h)?),
            ("cover8", Some((w, h))) => FrameRule::CoverOfEights(side(w)?, side(h)?),
            ("stretch", Some((w, h))) => FrameRule::Stretch(side(w)?, side(h)?),
            _ => return Err(wrong()),
        };
        Ok(Self { rule, kernel })
    }
}

/// A view's content that is resized and cropped when it is read.
#[derive(Debug)]
struct Framed {
    whole: Arc<dyn ViewContent>,
    /// Original width and height.
    from: (u32, u32),
    kernel: ResizeKernel,
    fit: Fit,
}

impl Framed {
    /// The range of original rows or columns (first, end) that row or column `at` of the crop covers, at least partly.
    fn covered(at: u32, corner: u32, from: u32, resized: u32) -> (u32, u32) {
        let place = |at: u32| f64::from(at) * f64::from(from) / f64::from(resized);
        let (first, end) = (place(at + corner), place(at + corner + 1));
        // A position that misses the edge of a pixel only by a rounding error counts as on the edge.
        let end = (end - 1e-9).ceil() as u32;
        ((first + 1e-9).floor() as u32, end.min(from))
    }

    fn covered_by(&self, x: u32, y: u32) -> [(u32, u32); 2] {
        let Fit {
            resized, corner, ..
        } = self.fit;
        [
            Self::covered(x, corner.0, self.from.0, resized.0),
            Self::covered(y, corner.1, self.from.1, resized.1),
        ]
    }
}

impl ViewContent for Framed {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        let image = Picture::Rgb8(self.whole.image()?);
        let Fit {
            resized,
            corner,
            size,
        } = self.fit;
        let image = resize(&image, resized.0, resized.1, self.kernel);
        let image = match image.map_err(|error| self.refused(&error.to_string()))? {
            Picture::Rgb8(image) => image,
            Picture::RgbF32(image) => to_rgb8(&image),
        };
        let cropped = imageops::crop_imm(&image, corner.0, corner.1, size.0, size.1);
        Ok(cropped.to_image())
    }

    /// A pixel is valid if all original pixels that it covers are valid.
    fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError> {
        let Some(valid) = self.whole.valid_pixels()? else {
            return Ok(None);
        };
        let (width, height) = self.fit.size;
        Ok(Some(GrayImage::from_fn(width, height, |x, y| {
            let [(left, right), (top, bottom)] = self.covered_by(x, y);
            let mut covered = (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
            let all = covered.all(|(x, y)| valid.get_pixel(x, y).0[0] == 255);
            Luma([if all { 255 } else { 0 }])
        })))
    }

    /// The original depth at each pixel's centre, without interpolation.
    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        let Some(depth) = self.whole.depth()? else {
            return Ok(None);
        };
        let Fit {
            resized,
            corner,
            size,
        } = self.fit;
        let at = |at: u32, corner: u32, from: u32, resized: u32| {
            let place = (f64::from(at + corner) + 0.5) * f64::from(from) / f64::from(resized);
            (place as u32).min(from - 1)
        };
        Ok(Some(DepthMap::from_fn(size.0, size.1, |x, y| {
            let x = at(x, corner.0, self.from.0, resized.0);
            *depth.get_pixel(x, at(y, corner.1, self.from.1, resized.1))
        })))
    }

    /// The stored depth of the original picture, neither resized nor cropped.
    fn stored_depth(&self) -> Result<Option<(PathBuf, FloatMap)>, DatasetError> {
        self.whole.stored_depth()
    }

    fn has_photograph(&self) -> bool {
        self.whole.has_photograph()
    }

    fn image_file(&self) -> Option<&Path> {
        self.whole.image_file()
    }

    fn files_by_role(&self) -> Vec<(FileRole, PathBuf)> {
        self.whole.files_by_role()
    }

    fn processing(&self) -> Processing {
        self.whole.processing()
    }

    fn image_sha256(&self) -> Result<String, DatasetError> {
        self.whole.image_sha256()
    }
}

impl Framed {
    fn refused(&self, reason: &str) -> DatasetError {
        let file = self.whole.image_file().unwrap_or(Path::new("")).to_owned();
        DatasetError::malformed(file, reason)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp_datasets::{DatasetSpec, open};

    fn fit(text: &str, size: (u32, u32)) -> Result<Fit, String> {
        text.parse::<Frame>().unwrap().fit(size)
    }

    #[test]
    fn sizes_are_those_of_the_protocols() {
        // pixelSplat: 360 x 640 becomes 256 x 455, from column 99.
        let pixelsplat = fit("cover:256x256:lanczos", (640, 360)).unwrap();
        let expected = Fit {
            resized: (455, 256),
            corner: (99, 0),
            size: (256, 256),
        };
        assert_eq!(pixelsplat, expected);
        // LVSM: 256 x 456, from column 100.
        let lvsm = fit("cover8:256x256:lanczos", (640, 360)).unwrap();
        assert_eq!((lvsm.resized, lvsm.corner), ((456, 256), (100, 0)));
        let flash3d = fit("stretch:384x256:lanczos", (640, 360)).unwrap();
        assert_eq!((flash3d.resized, flash3d.size), ((384, 256), (384, 256)));
        let splatting = fit("width:1600:bicubic", (4946, 3286)).unwrap();
        assert_eq!(splatting.size, (1600, 1063));
        assert_eq!(
            fit("width:1600:bicubic", (800, 600)).unwrap().size,
            (800, 600)
        );
        assert!(
            fit("cover:256x256:area", (640, 255))
                .unwrap_err()
                .contains("640x255")
        );
        assert!(
            fit("cover8:256x64:area", (256, 256))
                .unwrap_err()
                .contains("narrow")
        );
    }

    #[test]
    fn texts_read_back_and_others_are_refused() {
        for text in [
            "cover:256x256:lanczos",
            "cover8:256x256:lanczos",
            "stretch:384x256:area",
            "width:1600:bicubic",
        ] {
            assert_eq!(text.parse::<Frame>().unwrap().to_string(), text);
        }
        for text in [
            "",
            "cover:256:lanczos",
            "cover:0x256:lanczos",
            "cover:99999x256:lanczos",
            "cover:256x256:bilinear",
            "cover:256x256",
            "width:16x16:area",
        ] {
            assert!(text.parse::<Frame>().unwrap_err().contains("WxH"), "{text}");
        }
    }

    #[test]
    fn camera_picture_and_depth_stay_together() {
        let spec = DatasetSpec::parse("synthetic=size=96x64,views=2").unwrap();
        let view = open(&spec).unwrap().remove(0).views.remove(0);
        let frame: Frame = "cover:32x32:area".parse().unwrap();
        let framed = frame.apply(&view).unwrap();
        let (before, after) = (view.intrinsics, framed.intrinsics);
        assert_eq!((after.width, after.height), (32, 32));
        assert!((after.fx - before.fx / 2.0).abs() < 1e-12);
        // 48 columns, 8 of which are cut off on the left.
        assert!((after.cx - (before.cx / 2.0 - 8.0)).abs() < 1e-12);
        let (image, depth) = (
            view.content.image().unwrap(),
            view.content.depth().unwrap().unwrap(),
        );
        let small = framed.content.image().unwrap();
        // The mean of 2 × 2 pixels, rounded.
        for (x, y) in [(0, 0), (17, 30)] {
            let sum: u32 = [(0, 0), (1, 0), (0, 1), (1, 1)]
                .map(|(i, j)| u32::from(image.get_pixel(2 * (x + 8) + i, 2 * y + j).0[1]))
                .iter()
                .sum();
            let mean = f64::from(sum) / 4.0;
            assert!((f64::from(small.get_pixel(x, y).0[1]) - mean).abs() <= 0.5);
        }
        let near = framed.content.depth().unwrap().unwrap();
        assert_eq!(near.get_pixel(3, 5), depth.get_pixel(2 * 11 + 1, 2 * 5 + 1));
        assert_eq!(near.dimensions(), (32, 32));
    }

    #[test]
    fn a_pixel_covers_what_it_is_made_of() {
        assert_eq!(Framed::covered(0, 0, 640, 455), (0, 2));
        assert_eq!(Framed::covered(1, 7, 96, 48), (16, 18));
        assert_eq!(Framed::covered(454, 0, 640, 455), (638, 640));
    }
}
