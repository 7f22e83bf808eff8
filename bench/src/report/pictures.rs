//! Pictures of a report: where they come from, and how they get into a page.

use std::collections::BTreeSet;
use std::path::PathBuf;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::{
    ExtendedColorType, GrayImage, ImageBuffer, ImageEncoder as _, Pixel, RgbImage, imageops,
};
use sharp_datasets::DepthMap;

use crate::evaluate::record::Record;
use crate::io::pictures::Alpha;
use crate::io::text::without_folders;

use super::error::MissingPicture;

/// Source of a record's pictures: sRGB, 8 bit. Called from several threads, and only for pictures that the gallery shows;
/// for a few pairs more than once, to choose the size of pictures.
pub trait ReportPictures: Sync {
    /// The photograph that the method was given.
    ///
    /// # Errors
    /// Why there is none.
    fn source(&self, _record: &Record) -> Result<RgbImage, MissingPicture> {
        Err(MissingPicture::NotWanted)
    }

    /// What it should have predicted, at the size at which predictions are scored.
    ///
    /// # Errors
    /// Why there is none.
    fn target(&self, _record: &Record) -> Result<RgbImage, MissingPicture> {
        Err(MissingPicture::NotWanted)
    }

    /// 255 where a pixel of the target is scored, at the target's size; `None` where the dataset excludes none.
    ///
    /// # Errors
    /// Why that is not known.
    fn valid_pixels(&self, _record: &Record) -> Result<Option<GrayImage>, MissingPicture> {
        Ok(None)
    }

    /// What it predicted, at the target's size.
    ///
    /// # Errors
    /// Why there is none.
    fn prediction(&self, _record: &Record) -> Result<RgbImage, MissingPicture> {
        Err(MissingPicture::NotWanted)
    }

    /// z-depth of the target, metres, 0 where there is none; `None` where the dataset has none or is not at hand.
    ///
    /// # Errors
    /// Why it cannot be read.
    fn target_depth(&self, _record: &Record) -> Result<Option<DepthMap>, MissingPicture> {
        Ok(None)
    }

    /// The same of the source.
    ///
    /// # Errors
    /// Why it cannot be read.
    fn source_depth(&self, _record: &Record) -> Result<Option<DepthMap>, MissingPicture> {
        Ok(None)
    }

    /// Expected z-depth of a rendering, metres, 0 where nothing was drawn; `None` where it was not kept.
    ///
    /// # Errors
    /// Why it cannot be read.
    fn rendered_depth(&self, _record: &Record) -> Result<Option<DepthMap>, MissingPicture> {
        Ok(None)
    }

    /// Coverage of a rendering in 0..1, at its size; `None` where it was not kept.
    ///
    /// # Errors
    /// Why it cannot be read.
    fn alpha(&self, _record: &Record) -> Result<Option<Alpha>, MissingPicture> {
        Ok(None)
    }

    /// The file of the prediction as it was kept, cropped where it is a crop.
    fn kept(&self, _record: &Record) -> Option<PathBuf> {
        None
    }

    /// The files of [`Self::source`] and [`Self::target`], where these are what is in them.
    fn photographs(&self, _record: &Record) -> [Option<PathBuf>; 2] {
        [None, None]
    }
}

/// Pictures for the public: without those of datasets whose terms forbid it, and without paths of this machine.
pub(super) struct PublicPictures<'a> {
    pub(super) pictures: &'a dyn ReportPictures,
    /// Whose pictures are withheld, by name.
    pub(super) withheld: BTreeSet<&'a str>,
}

impl PublicPictures<'_> {
    fn shown<T>(
        &self,
        record: &Record,
        get: impl Fn(&dyn ReportPictures) -> Result<T, MissingPicture>,
    ) -> Result<T, MissingPicture> {
        if self.withheld.contains(record.dataset.as_str()) {
            return Err(MissingPicture::NotPublic);
        }
        get(self.pictures).map_err(|missing| match missing {
            MissingPicture::Unusable(reason) => MissingPicture::Unusable(without_folders(&reason)),
            other => other,
        })
    }
}

impl ReportPictures for PublicPictures<'_> {
    fn source(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        self.shown(record, |pictures| pictures.source(record))
    }

    fn target(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        self.shown(record, |pictures| pictures.target(record))
    }

    fn valid_pixels(&self, record: &Record) -> Result<Option<GrayImage>, MissingPicture> {
        self.shown(record, |pictures| pictures.valid_pixels(record))
    }

    fn prediction(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        self.shown(record, |pictures| pictures.prediction(record))
    }

    fn target_depth(&self, record: &Record) -> Result<Option<DepthMap>, MissingPicture> {
        self.shown(record, |pictures| pictures.target_depth(record))
    }

    fn source_depth(&self, record: &Record) -> Result<Option<DepthMap>, MissingPicture> {
        self.shown(record, |pictures| pictures.source_depth(record))
    }

    fn alpha(&self, record: &Record) -> Result<Option<Alpha>, MissingPicture> {
        self.shown(record, |pictures| pictures.alpha(record))
    }
}

/// A report without pictures.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoPictures;

impl ReportPictures for NoPictures {}

/// JPEG quality of everything in the page. It changes no score: scores come from the pictures themselves.
const QUALITY: u8 = 88;

/// A small picture for the page; sizes in pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Thumbnail {
    pub jpeg: Vec<u8>,
    pub width: u32,
    pub height: u32,
}

impl Thumbnail {
    /// The picture reduced to fit `side`.
    ///
    /// # Errors
    /// [`MissingPicture::Unusable`] when it cannot be encoded.
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

    /// An address that holds the picture itself.
    pub(crate) fn address(&self) -> String {
        format!("data:image/jpeg;base64,{}", STANDARD.encode(&self.jpeg))
    }
}

/// The size with the same shape whose longer side is at most `side`, never larger, at least one pixel.
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

/// The picture at its [`fitted`] size, by averaging pixels.
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
