//! Crops and resizes imported pictures for scoring, by the paper's rules for predictions that are cropped or smaller
//! than their targets.
//!
//! Scores are computed at the target's full resolution. A prediction of another size with the same aspect ratio is
//! resized by a named kernel. A cropped prediction is compared with the equally cropped target; its record states the
//! crop. Nothing is padded.

use std::collections::BTreeMap;
use std::path::Path;

use sharp::image_file::{PictureRules, parsed};
use sharp_metrics::resize::{ResizeKernel, resize};
use sharp_metrics::{Picture, PictureError};

use super::method::{MethodError, PicturePrediction};
use crate::io::pictures::{self, PictureReading, ReadError, to_rgb8};
use crate::scoring::Region;

/// Note on predictions stored as JPEG, whose compression errors count as errors of the method.
pub(crate) const LOSSY: &str =
    "stored as JPEG, whose losses change the scores; store them as PNG or EXR";

/// The part of the target that a method's pictures cover.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum CropRule {
    #[default]
    Whole,
    /// `x:y:w:h`: a fixed part, pixels of the target.
    Fixed(Region),
    /// `center:W:H`: the largest centred part with this aspect.
    Center(u32, u32),
    /// `center`: the largest centred part with the picture's own aspect.
    CenterOfOwnAspect,
    /// `sidecar`: the part stated in a file next to each picture.
    Sidecar,
}

/// How a method's pictures are cropped and resized.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct FitRules {
    kernel: Option<ResizeKernel>,
    crop: CropRule,
    reading: PictureReading,
}

impl FitRules {
    pub(super) const OPTIONS: [&'static str; 6] =
        ["resize", "crop", "alpha", "color", "orientation", "exr"];

    /// Parses [`Self::OPTIONS`]. Errors do not name the method.
    pub(super) fn parse<'a>(option: impl Fn(&str) -> Option<&'a str>) -> Result<Self, String> {
        Ok(Self {
            kernel: parsed("resize", &option)?,
            crop: option("crop")
                .map(parse_crop)
                .transpose()?
                .unwrap_or_default(),
            reading: PictureReading {
                rules: PictureRules::parse(&option)?,
                exr: parsed("exr", &option)?,
            },
        })
    }

    pub(super) fn reading(&self) -> &PictureReading {
        &self.reading
    }

    pub(super) fn crop(&self) -> CropRule {
        self.crop
    }

    /// Whether the covered region depends on the picture's size or on a sidecar file.
    pub(super) fn needs_file(&self) -> bool {
        matches!(self.crop, CropRule::CenterOfOwnAspect | CropRule::Sidecar)
    }

    /// The options that differ from the default, by key, for the method's identity.
    pub(super) fn settings(&self) -> BTreeMap<String, String> {
        let mut settings = BTreeMap::new();
        if let Some(kernel) = self.kernel {
            let value = format!("{} [{}]", kernel.name(), kernel.describe());
            settings.insert("resize".to_owned(), value);
        }
        let PictureReading { rules, exr } = self.reading;
        let given = rules.given().chain(exr.map(|exr| ("exr", exr.name())));
        settings.extend(given.map(|(key, value)| (key.to_owned(), value.to_owned())));
        let crop = match self.crop {
            CropRule::Whole => return settings,
            CropRule::Fixed(Region {
                x,
                y,
                width,
                height,
            }) => format!("{x}:{y}:{width}:{height}"),
            CropRule::Center(w, h) => format!("center:{w}:{h}"),
            CropRule::CenterOfOwnAspect => "center".to_owned(),
            CropRule::Sidecar => "sidecar".to_owned(),
        };
        settings.insert("crop".to_owned(), crop);
        settings
    }

    /// The part of a target that a picture of size `own` covers; `None` for the whole target. `sidecar` is the region
    /// from the picture's sidecar file, if any. Errors do not name the file.
    pub(super) fn region(
        &self,
        target: (u32, u32),
        own: Option<(u32, u32)>,
        sidecar: Option<Region>,
    ) -> Result<Option<Region>, String> {
        let region = match self.crop {
            CropRule::Whole => return Ok(None),
            CropRule::Fixed(region) => Some(region),
            CropRule::Center(w, h) => Region::centered((w, h), target),
            CropRule::CenterOfOwnAspect => own.and_then(|own| Region::centered(own, target)),
            CropRule::Sidecar => sidecar,
        };
        let region = region.ok_or("the part of the target that the picture covers is not known")?;
        if !region.fits(target) {
            return Err(format!(
                "the crop {region} is not inside the target, {}x{}",
                target.0, target.1
            ));
        }
        Ok((region != Region::whole(target)).then_some(region))
    }

    /// Reads a picture as 8 bit and resizes it to the part of the target that it covers. Checks the size in the file's
    /// header before decoding, because a small file may contain more pixels than fit into memory.
    pub(super) fn read(
        &self,
        path: &Path,
        region: Option<Region>,
        target: (u32, u32),
    ) -> Result<PicturePrediction, MethodError> {
        let named = |reason: String| MethodError::file(path, reason);
        let unreadable = |error: ReadError| MethodError::Model(error.to_string());
        if let Some(own) = pictures::dimensions(path, &self.reading.rules).map_err(unreadable)? {
            self.kernel_for(own, region, target).map_err(named)?;
        }
        let read = pictures::read_as(path, &self.reading).map_err(unreadable)?;
        let fitted = self.fit(read.picture, region, target).map_err(named)?;
        // Note only conversions that the user did not request.
        let given: Vec<String> = self
            .reading
            .rules
            .given()
            .map(|(key, _)| format!("{key}="))
            .collect();
        let mut notes = read.notes;
        notes.retain(|note| !given.iter().any(|key| note.contains(key.as_str())));
        if read.is_jpeg {
            notes.push(LOSSY.to_owned());
        }
        Ok(PicturePrediction { notes, ..fitted })
    }

    /// Resizes a picture to the part of the target that it covers, and converts it to 8 bit. Errors do not name the
    /// file.
    fn fit(
        &self,
        picture: Picture,
        region: Option<Region>,
        target: (u32, u32),
    ) -> Result<PicturePrediction, String> {
        let own = picture.dimensions();
        let shown = region.unwrap_or(Region::whole(target)).size();
        let picture = match self.kernel_for(own, region, target)? {
            None => picture,
            Some(kernel) => {
                resize(&picture, shown.0, shown.1, kernel).map_err(|error| error.to_string())?
            }
        };
        let image = match picture {
            Picture::Rgb8(image) => image,
            Picture::RgbF32(image) => to_rgb8(&image),
        };
        Ok(PicturePrediction {
            region,
            resized_from: (own != shown).then_some(own),
            ..image.into()
        })
    }

    /// The kernel for resizing the picture; `None` if it already has the right size.
    fn kernel_for(
        &self,
        (w, h): (u32, u32),
        region: Option<Region>,
        target: (u32, u32),
    ) -> Result<Option<ResizeKernel>, String> {
        let (what, (to_w, to_h)) = match region {
            Some(region) => ("its crop of the target", region.size()),
            None => ("the target", target),
        };
        if (w, h) == (to_w, to_h) {
            return Ok(None);
        }
        if (w, h) == (to_h, to_w) {
            return Err(format!(
                "the picture is {w}x{h}, but {what} is {to_w}x{to_h}; perhaps it was turned by 90 degrees, or made with \
                 width and height swapped"
            ));
        }
        // Aspect ratios count as equal if rounding the sides of the smaller size to whole pixels explains their
        // difference.
        let ((small_w, small_h), (large_w, large_h)) = if w > to_w || h > to_h {
            ((to_w, to_h), (w, h))
        } else {
            ((w, h), (to_w, to_h))
        };
        let height = f64::from(small_w) * f64::from(large_h) / f64::from(large_w);
        let width = f64::from(small_h) * f64::from(large_w) / f64::from(large_h);
        let is_off = |exact: f64, side: u32| (exact - f64::from(side)).abs() >= 1.0;
        if is_off(height, small_h) && is_off(width, small_w) {
            return Err(format!(
                "the picture is {w}x{h}, but {what} is {to_w}x{to_h}, with another aspect ratio; set the part of the \
                 target that it shows (crop=center, crop=x:y:w:h or crop=sidecar)"
            ));
        }
        if self.kernel == Some(ResizeKernel::Area) && (w < to_w || h < to_h) {
            return Err(format!("resize=area: {}", PictureError::AreaEnlarges));
        }
        let no_kernel = || needs_kernel(what, (w, h), (to_w, to_h), "resize=");
        self.kernel.map(Some).ok_or_else(no_kernel)
    }
}

/// The error message for a picture that needs a kernel to be resized to the size of `what`. Lists the kernels; `option`
/// is the option, as the user would write it, that sets a kernel.
pub(crate) fn needs_kernel(
    what: &str,
    (w, h): (u32, u32),
    (to_w, to_h): (u32, u32),
    option: &str,
) -> String {
    let reduces = to_w <= w && to_h <= h;
    let kernels = ResizeKernel::ALL.iter();
    let kernels = kernels.filter(|kernel| reduces || **kernel != ResizeKernel::Area);
    let names: Vec<&str> = kernels.map(|kernel| kernel.name()).collect();
    format!(
        "the picture is {w}x{h}, but {what} is {to_w}x{to_h}; set a kernel to resize it ({option}{})",
        names.join("|")
    )
}

fn parse_crop(text: &str) -> Result<CropRule, String> {
    let wrong = || format!("crop={text}: expected x:y:w:h, center:W:H, center or sidecar");
    let parts: Vec<&str> = text.split([':', ',']).map(str::trim).collect();
    let number = |part: &str| part.parse::<u32>().map_err(|_| wrong());
    Ok(match parts.as_slice() {
        ["sidecar"] => CropRule::Sidecar,
        ["center"] => CropRule::CenterOfOwnAspect,
        ["center", w, h] => match (number(w)?, number(h)?) {
            (0, _) | (_, 0) => return Err(wrong()),
            (w, h) => CropRule::Center(w, h),
        },
        [x, y, w, h] => CropRule::Fixed(Region {
            x: number(x)?,
            y: number(y)?,
            width: number(w)?,
            height: number(h)?,
        }),
        _ => return Err(wrong()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::RgbImage;

    fn rules(kernel: Option<&str>, crop: Option<&str>) -> FitRules {
        FitRules::parse(|key| match key {
            "resize" => kernel,
            "crop" => crop,
            _ => None,
        })
        .unwrap()
    }

    fn picture(w: u32, h: u32) -> Picture {
        Picture::Rgb8(RgbImage::new(w, h))
    }

    #[test]
    fn crops_in_all_their_forms() {
        let region = |crop: &str, own| rules(None, Some(crop)).region((640, 480), own, None);
        let square = Region {
            x: 80,
            y: 0,
            width: 480,
            height: 480,
        };
        assert_eq!(region("center:1:1", None), Ok(Some(square)));
        assert_eq!(region("center", Some((576, 576))), Ok(Some(square)));
        assert_eq!(region("80:0:480:480", None), Ok(Some(square)));
        assert_eq!(region("80,0,480,480", None), Ok(Some(square)));
        assert_eq!(region("center:4:3", None), Ok(None));
        assert!(
            region("200:0:480:480", None)
                .unwrap_err()
                .contains("640x480")
        );
        assert!(region("0:0:0:480", None).is_err());
        assert!(region("center", None).is_err());
        assert!(region("sidecar", None).is_err());
        for text in ["middle", "1:2:3", "center:0:1", "center:1", "-1:0:2:2", ""] {
            let error = FitRules::parse(|key| (key == "crop").then_some(text)).unwrap_err();
            assert!(error.contains("x:y:w:h"), "{error}");
        }
        assert!(FitRules::parse(|key| (key == "resize").then_some("cubic")).is_err());
        let both = rules(Some("bicubic"), Some("center:16:9"));
        assert!(both.settings()["resize"].starts_with("bicubic"));
        assert_eq!(both.settings()["crop"], "center:16:9");
        assert!(FitRules::default().settings().is_empty());
    }

    #[test]
    fn pictures_of_the_aspect_are_resized_and_only_by_name() {
        let fit = |kernel, w, h| rules(kernel, None).fit(picture(w, h), None, (96, 72));
        assert_eq!(fit(None, 96, 72).unwrap().resized_from, None);
        let resized = fit(Some("bicubic"), 32, 24).unwrap();
        assert_eq!(resized.picture.dimensions(), (96, 72));
        assert_eq!(resized.resized_from, Some((32, 24)));
        // 72 / 96 · 50 is 37.5, so rounding may give either height.
        for height in [37, 38] {
            fit(Some("lanczos"), 50, height).unwrap();
        }
        for (kernel, size) in [
            ("bicubic", (192, 144)),
            ("area", (192, 144)),
            ("lanczos", (97, 72)),
        ] {
            let resized = fit(Some(kernel), size.0, size.1).unwrap();
            assert_eq!(resized.picture.dimensions(), (96, 72));
            assert_eq!(resized.resized_from, Some(size));
        }
        for (kernel, size, part) in [
            (None, (32, 24), "resize=bilinear|"),
            (None, (192, 144), "resize=bilinear|"),
            (Some("area"), (32, 24), "resize=area: "),
            (Some("bicubic"), (5, 5), "another aspect"),
            (Some("bicubic"), (72, 96), "turned by 90 degrees"),
            (Some("bicubic"), (36, 24), "another aspect"),
            (Some("bicubic"), (192, 36), "another aspect"),
        ] {
            let error = fit(kernel, size.0, size.1).unwrap_err();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn a_picture_of_the_wrong_size_is_not_decoded() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("p.png");
        RgbImage::new(97, 72).save(&path).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        let data = bytes.windows(4).position(|w| w == b"IDAT").unwrap();
        bytes[data + 6] ^= 0xFF;
        std::fs::write(&path, bytes).unwrap();
        let said = |target| {
            let read = rules(None, None).read(&path, None, target);
            read.unwrap_err().to_string()
        };
        assert!(said((96, 72)).contains("set a kernel"));
        assert!(!said((97, 72)).contains("97x72"), "decoded, and damaged");
    }

    #[test]
    fn a_cropped_picture_has_to_have_its_crops_size() {
        let square = Region::centered((1, 1), (96, 72));
        let fit =
            |kernel, w, h| rules(kernel, Some("center:1:1")).fit(picture(w, h), square, (96, 72));
        assert_eq!(fit(None, 72, 72).unwrap().region, square);
        assert_eq!(
            fit(Some("bicubic"), 36, 36).unwrap().picture.dimensions(),
            (72, 72)
        );
        assert!(
            fit(None, 36, 36)
                .unwrap_err()
                .contains("its crop of the target")
        );
    }
}
