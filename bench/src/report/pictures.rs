//! Pictures of a report: where they are read from and how they are embedded in a page.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::{
    ExtendedColorType, GrayImage, ImageBuffer, ImageEncoder as _, Pixel, RgbImage, imageops,
};
use sharp_datasets::format::read_map;
use sharp_datasets::{DepthMap, Scene, View};

use crate::evaluate::record::Record;
use crate::evaluate::results::KeptPicture;
use crate::evaluate::{Manifest, Results};
use crate::io::observer::Observer;
use crate::io::pictures::{Alpha, read_linear, read_rgb8};
use crate::io::text::without_folders;
use crate::io::view_hashes::lock;

use super::error::MissingPicture;

/// Pictures of records, 8-bit sRGB: sources and targets from the datasets, predictions from the run folder. If a kept
/// file differs from the picture that was scored, it is left out and [listed](Self::not_scored).
pub struct ReportPictures<'a> {
    results: &'a Results,
    /// Scenes by dataset and id.
    scenes: BTreeMap<(&'a str, &'a str), &'a Scene>,
    /// The datasets whose pictures a public report withholds; `None` if the report is not public. A public report also
    /// shows no paths.
    withheld: Option<BTreeSet<String>>,
    /// Kept pictures, keyed by pair and method, so that each file is hashed once.
    kept: Mutex<BTreeMap<(String, String), Option<KeptPicture>>>,
    not_scored: Mutex<BTreeSet<PathBuf>>,
    /// Cache of photographs, because many pairs share a view; keyed by the view's address. Once the cache is full,
    /// nothing is added.
    photographs: Mutex<BTreeMap<usize, RgbImage>>,
}

/// Maximum memory for photographs, in bytes.
const PHOTOGRAPHS: usize = 128 << 20;

impl<'a> ReportPictures<'a> {
    pub fn new(results: &'a Results, scenes: &'a [Scene]) -> Self {
        Self {
            results,
            scenes: scenes
                .iter()
                .map(|scene| ((scene.dataset.as_str(), scene.id.as_str()), scene))
                .collect(),
            withheld: None,
            kept: Mutex::default(),
            not_scored: Mutex::default(),
            photographs: Mutex::default(),
        }
    }

    /// Makes the report public: withholds the pictures of the datasets in `withheld`, all links to files, and the
    /// folders in messages.
    pub(super) fn public(self, withheld: BTreeSet<String>) -> Self {
        Self {
            withheld: Some(withheld),
            ..self
        }
    }

    /// Kept pictures that were requested but differ from the scored ones, sorted.
    pub fn not_scored(&self) -> Vec<PathBuf> {
        lock(&self.not_scored).iter().cloned().collect()
    }

    fn check_terms(&self, record: &Record) -> Result<(), MissingPicture> {
        let withheld = self.withheld.as_ref();
        if withheld.is_some_and(|withheld| withheld.contains(&record.dataset)) {
            Err(MissingPicture::NotPublic)
        } else {
            Ok(())
        }
    }

    fn unusable(&self, error: impl Display) -> MissingPicture {
        let reason = error.to_string();
        MissingPicture::Unusable(match self.withheld {
            Some(_) => without_folders(&reason),
            None => reason,
        })
    }

    /// The view of a record's scene that has this id.
    ///
    /// # Errors
    /// If the dataset is not available, or its pictures are withheld.
    pub(crate) fn view(&self, record: &Record, id: &str) -> Result<&'a View, MissingPicture> {
        self.check_terms(record)?;
        let of = (record.dataset.as_str(), record.scene.as_str());
        let scene = self.scenes.get(&of);
        let view = scene.and_then(|scene| scene.views.iter().find(|view| view.id == id));
        view.ok_or(MissingPicture::NoDataset)
    }

    fn photograph(&self, record: &Record, id: &str) -> Result<RgbImage, MissingPicture> {
        let view = self.view(record, id)?;
        let place = std::ptr::from_ref(view).addr();
        if let Some(image) = lock(&self.photographs).get(&place) {
            return Ok(image.clone());
        }
        let image = view.content.image().map_err(|error| self.unusable(error))?;
        let mut known = lock(&self.photographs);
        let bytes: usize = known.values().map(|image| image.len()).sum();
        if bytes + image.len() <= PHOTOGRAPHS {
            known.insert(place, image.clone());
        }
        Ok(image)
    }

    /// The source photograph given to the method.
    ///
    /// # Errors
    /// [`MissingPicture`] states why the photograph is missing.
    pub fn source(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        self.photograph(record, &record.source)
    }

    /// The photograph of the target, at the scored size.
    ///
    /// # Errors
    /// [`MissingPicture`] states why the photograph is missing.
    pub fn target(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        self.photograph(record, &record.target)
    }

    /// Whether the target is only a camera without a photograph.
    pub(crate) fn is_virtual(&self, record: &Record) -> bool {
        let target = self.view(record, &record.target);
        target.is_ok_and(|target| !target.content.has_photograph())
    }

    /// Mask of the target at the target's size, with 255 for scored pixels. `None` if the dataset excludes no pixels.
    ///
    /// # Errors
    /// [`MissingPicture`] states why the mask is unknown.
    pub fn valid_pixels(&self, record: &Record) -> Result<Option<GrayImage>, MissingPicture> {
        let valid = self.view(record, &record.target)?.content.valid_pixels();
        valid.map_err(|error| self.unusable(error))
    }

    /// z-depth of a record's view, in metres, 0 where unknown. `None` if the dataset has no depth or is not available.
    ///
    /// # Errors
    /// [`MissingPicture`] states why the depth cannot be read.
    pub fn depth(&self, record: &Record, id: &str) -> Result<Option<DepthMap>, MissingPicture> {
        match self.view(record, id) {
            Ok(view) => view.content.depth().map_err(|error| self.unusable(error)),
            Err(MissingPicture::NoDataset) => Ok(None),
            Err(reason) => Err(reason),
        }
    }

    /// The file kept for a prediction. For a cropped prediction, it contains only the crop.
    ///
    /// # Errors
    /// If the file was not kept, or its picture differs from the one that was scored.
    pub(crate) fn kept_file(&self, record: &Record) -> Result<PathBuf, MissingPicture> {
        self.check_terms(record)?;
        let unit = (record.pair_id.clone(), record.method.clone());
        let known = lock(&self.kept).get(&unit).cloned();
        let kept = known.unwrap_or_else(|| {
            let kept = self.results.kept_picture(record);
            lock(&self.kept).insert(unit, kept.clone());
            kept
        });
        let KeptPicture { path, is_scored } = kept.ok_or(MissingPicture::NotKept)?;
        if is_scored {
            return Ok(path);
        }
        lock(&self.not_scored).insert(path);
        Err(MissingPicture::NotScored)
    }

    /// The prediction at the target's size. A cropped prediction is placed at its position in the
    /// target, on black.
    ///
    /// # Errors
    /// [`MissingPicture`] states why the prediction is missing.
    pub fn prediction(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        let file = self.kept_file(record)?;
        let picture = read_rgb8(&file).map_err(|error| self.unusable(error))?;
        let (Some(crop), Ok(target)) = (record.crop, self.view(record, &record.target)) else {
            return Ok(picture);
        };
        let mut whole = RgbImage::new(target.intrinsics.width, target.intrinsics.height);
        let (x, y) = (i64::from(crop.region.x), i64::from(crop.region.y));
        imageops::replace(&mut whole, &picture, x, y);
        Ok(whole)
    }

    /// File of the floating-point rendering behind a prediction; `None` if it was not kept.
    fn rendering(&self, record: &Record) -> Result<Option<PathBuf>, MissingPicture> {
        self.check_terms(record)?;
        match self.results.kept_rendering(record) {
            Some(kept) if !kept.is_scored => Err(MissingPicture::NotScored),
            kept => Ok(kept.map(|kept| kept.path)),
        }
    }

    /// Coverage of a rendering in 0..1, at its own size; `None` if the rendering was not kept.
    ///
    /// # Errors
    /// [`MissingPicture`] states why the rendering cannot be read.
    pub fn alpha(&self, record: &Record) -> Result<Option<Alpha>, MissingPicture> {
        let Some(path) = self.rendering(record)? else {
            return Ok(None);
        };
        let linear = read_linear(&path).map_err(|error| self.unusable(error))?;
        Ok(Some(linear.alpha))
    }

    /// Expected z-depth of a rendering, in metres, 0 where nothing was drawn; `None` if the rendering was not kept.
    ///
    /// # Errors
    /// [`MissingPicture`] states why the rendering cannot be read.
    pub fn rendered_depth(&self, record: &Record) -> Result<Option<DepthMap>, MissingPicture> {
        let Some(path) = self.rendering(record)? else {
            return Ok(None);
        };
        let linear = read_linear(&path).map_err(|error| self.unusable(error))?;
        let mut depth = read_map(&path).map_err(|error| self.unusable(error))?;
        // The channel contains accumulated depth, Σ w z.
        for (z, alpha) in depth.iter_mut().zip(linear.alpha.iter()) {
            *z = if *alpha > 0.0 { *z / alpha } else { 0.0 };
        }
        Ok(Some(depth))
    }

    /// The kept file of a prediction, for a link; `None` in a public report.
    pub(super) fn linked(&self, record: &Record) -> Option<PathBuf> {
        self.kept_file(record)
            .ok()
            .filter(|_| self.withheld.is_none())
    }

    /// Links to the files of [`Self::source`] and [`Self::target`]; `None` if the file's pixels are not those shown.
    pub(super) fn linked_photographs(&self, record: &Record) -> [Option<PathBuf>; 2] {
        [&record.source, &record.target].map(|id| {
            let content = &self.view(record, id).ok()?.content;
            let processing = content.processing();
            let is_stored = processing.undistorted.is_none() && !processing.masked;
            let file = content.image_file().map(Path::to_owned);
            file.filter(|_| is_stored && self.withheld.is_none())
        })
    }
}

/// Opens the scenes of results for their pictures. Warns about datasets that are not available; the report then omits
/// their pictures.
pub fn scenes(manifest: &Manifest, observer: &dyn Observer) -> Vec<Scene> {
    let mut scenes = Vec::new();
    for dataset in &manifest.datasets {
        match dataset.open(None) {
            Ok(open) => scenes.extend(open.scenes),
            Err(error) => observer.warn(&format!(
                "source and target pictures of dataset '{}' are not available: {error}",
                dataset.name
            )),
        }
    }
    scenes
}

/// JPEG quality of all pictures in the page. Scores are unaffected, because they are computed from
/// the original pictures.
const QUALITY: u8 = 88;

/// A small picture for the page; sizes in pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Thumbnail {
    pub jpeg: Vec<u8>,
    pub width: u32,
    pub height: u32,
}

impl Thumbnail {
    /// Reduces a picture to fit `side`.
    ///
    /// # Errors
    /// [`MissingPicture::Unusable`] if it cannot be encoded.
    pub fn new(picture: &RgbImage, side: u32) -> Result<Self, MissingPicture> {
        let small = reduced(picture, side);
        let (width, height) = small.dimensions();
        let mut jpeg = Vec::new();
        JpegEncoder::new_with_quality(&mut jpeg, QUALITY)
            .write_image(&small, width, height, ExtendedColorType::Rgb8)
            .map_err(|e| MissingPicture::Unusable(format!("cannot be encoded: {e}")))?;
        Ok(Self {
            jpeg,
            width,
            height,
        })
    }

    /// The picture as a data URL.
    pub(crate) fn address(&self) -> String {
        format!("data:image/jpeg;base64,{}", STANDARD.encode(&self.jpeg))
    }
}

/// The size with the same aspect ratio, not larger than the original, whose longer side is at most `side` pixels. Each
/// side is at least one pixel.
pub fn fitted((width, height): (u32, u32), side: u32) -> (u32, u32) {
    let longest = width.max(height);
    if longest <= side || longest == 0 {
        return (width, height);
    }
    let scaled = |n: u32| {
        let exact = f64::from(n) * f64::from(side) / f64::from(longest);
        (exact.round() as u32).clamp(1, side.max(1))
    };
    (scaled(width), scaled(height))
}

/// The picture reduced to its [`fitted`] size by averaging pixels.
pub fn reduced<P: Pixel + 'static>(
    picture: &ImageBuffer<P, Vec<P::Subpixel>>,
    side: u32,
) -> ImageBuffer<P, Vec<P::Subpixel>>
where
    P::Subpixel: 'static,
{
    let (width, height) = fitted(picture.dimensions(), side);
    if (width, height) == picture.dimensions() {
        picture.clone()
    } else {
        imageops::resize(picture, width, height, imageops::FilterType::Triangle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_shrink_and_never_grow() {
        assert_eq!(fitted((741, 497), 960), (741, 497));
        assert_eq!(fitted((1482, 994), 741), (741, 497));
        assert_eq!(fitted((4000, 3), 400), (400, 1));
        assert_eq!(fitted((0, 0), 400), (0, 0));
    }
}
