//! Target photographs, which predictions are scored against.

use std::borrow::Cow;

use image::{GrayImage, Rgb, Rgb32FImage, RgbImage};
use sharp_metrics::{
    Maps, Mask, Metric, MetricKey, MetricRegion, Picture, Scorer, Scores, Unavailable,
};

use super::Region;
use super::rules::Border;

/// A target's photograph with a mask of the pixels that count.
#[derive(Debug, Clone, PartialEq)]
pub struct GroundTruth {
    image: RgbImage,
    valid: Option<Mask>,
}

#[derive(Debug, Default)]
pub(crate) struct PairMasks {
    /// Mask for metrics with the suffix `@frustum`.
    pub(crate) frustum: Option<Mask>,
    /// Mask for metrics with the suffix `@mask`; `None` selects the pixels that the dataset does
    /// not exclude.
    pub(crate) given: Option<Mask>,
    pub(crate) border: Border,
}

/// Mask of the pixels whose value in `valid` is 255; `None` if all have this value.
pub(crate) fn valid_mask(valid: &GrayImage) -> Option<Mask> {
    let excludes = valid.iter().any(|level| *level < 255);
    let inside = valid.iter().map(|level| *level == 255).collect();
    Mask::new(valid.width(), valid.height(), inside).filter(|_| excludes)
}

impl GroundTruth {
    /// Creates the ground truth from an 8-bit sRGB photograph. Only pixels with the value 255 in
    /// `valid`, which has the same size, count; the dataset excludes all other pixels (anonymised
    /// faces, for instance).
    pub fn of(image: RgbImage, valid: Option<&GrayImage>) -> Self {
        let valid = valid.and_then(valid_mask);
        Self { image, valid }
    }

    pub fn image(&self) -> &RgbImage {
        &self.image
    }

    /// The pixels that count; `None` if the dataset excludes no pixels.
    pub(crate) fn valid(&self) -> Option<&Mask> {
        self.valid.as_ref()
    }

    /// A prediction of the whole target, in which pixels that the dataset excludes are replaced by those of the
    /// photograph.
    pub(crate) fn with_excluded_of<'a>(&self, prediction: &'a RgbImage) -> Cow<'a, RgbImage> {
        let Some(valid) = &self.valid else {
            return Cow::Borrowed(prediction);
        };
        if prediction.dimensions() != self.dimensions() {
            return Cow::Borrowed(prediction);
        }
        let mut filled = prediction.clone();
        let pixels = filled.pixels_mut().zip(self.image.pixels());
        for ((own, seen), counts) in pixels.zip(valid.values()) {
            if !counts {
                *own = *seen;
            }
        }
        Cow::Owned(filled)
    }

    /// Width and height, in pixels.
    pub fn dimensions(&self) -> (u32, u32) {
        self.image.dimensions()
    }

    /// Share of a region's pixels that count, 0..1; `None` if the dataset excludes no pixels.
    pub fn valid_share(&self, region: Option<Region>) -> Option<f64> {
        let region = region.unwrap_or(Region::whole(self.dimensions()));
        share(&*region.crop_mask(self.valid.as_ref()?)?)
    }

    /// Memory that [`score`](Self::score) needs for copies of a prediction, in bytes: a cropped copy, and a copy in
    /// floats if pixels are excluded.
    pub(crate) fn copied_bytes(&self) -> u64 {
        let pixels = u64::from(self.image.width()) * u64::from(self.image.height());
        pixels
            * match self.valid {
                Some(_) => 3 + 12,
                None => 3,
            }
    }

    /// Scores pictures, each of a region or the whole target. Pictures of the same region share each network's pass
    /// over the target. Each picture has its own error, which names neither file nor pair.
    ///
    /// Excluded pixels do not count: in both pictures, these pixels are filled with the mean colour
    /// of the region's valid target pixels, and PSNR is computed over valid pixels only. Metrics
    /// with `@mask` use the unfilled pictures inside the given mask or, without a mask, at the
    /// pixels that are not excluded.
    pub(crate) fn score(
        &self,
        scorer: &Scorer,
        pictures: &[(&Picture, Option<Region>)],
        masks: &PairMasks,
    ) -> Vec<Result<Scores, String>> {
        let size = self.dimensions();
        let mut scored: Vec<Option<Result<Scores, String>>> = vec![None; pictures.len()];
        for first in 0..pictures.len() {
            let region = pictures[first].1.unwrap_or(Region::whole(size));
            let same: Vec<usize> = (first..pictures.len())
                .filter(|&i| scored[i].is_none())
                .filter(|&i| pictures[i].1.unwrap_or(Region::whole(size)) == region)
                .collect();
            if same.is_empty() {
                continue;
            }
            let of_region: Vec<&Picture> = same.iter().map(|&i| pictures[i].0).collect();
            let results = self.score_region(scorer, region, &of_region, masks);
            for (i, result) in same.into_iter().zip(results) {
                scored[i] = Some(result);
            }
        }
        scored.into_iter().flatten().collect()
    }

    fn score_region(
        &self,
        scorer: &Scorer,
        region: Region,
        pictures: &[&Picture],
        masks: &PairMasks,
    ) -> Vec<Result<Scores, String>> {
        let border = masks.border.kept(self.dimensions());
        let compared = region.intersection(&border);
        let Some(compared) = compared.filter(|_| border.fits(self.dimensions())) else {
            let reason = "nothing is left inside the cropped border".to_owned();
            return vec![Err(reason); pictures.len()];
        };
        // A picture of the wrong size is passed on uncropped; the scorer reports both sizes.
        let pictures: Vec<Cow<'_, Picture>> = pictures
            .iter()
            .map(|picture| match compared.within(&region) {
                Some(part) if picture.dimensions() == region.size() => part.crop(picture),
                _ => Cow::Borrowed(*picture),
            })
            .collect();
        let shown = match self.shown(compared) {
            Ok(shown) => shown,
            Err(reason) => return vec![Err(reason); pictures.len()],
        };
        let is_given = |key: &MetricKey| key.region() == MetricRegion::Given;
        let (given, others): (Vec<MetricKey>, Vec<MetricKey>) =
            scorer.keys().iter().partition(|key| is_given(key));
        let frustum = masks.frustum.as_ref();
        let frustum = frustum.and_then(|mask| compared.crop_mask(mask));
        let seen: Vec<Cow<'_, Picture>> = pictures.iter().map(|p| shown.seen(p)).collect();
        let seen: Vec<&Picture> = seen.iter().map(AsRef::as_ref).collect();
        let others = scorer.restricted(&others);
        let mut results = scored(&others, &shown.truth, &seen, frustum.as_deref());
        if let Some((valid, _)) = &shown.excluding {
            for (result, picture) in results.iter_mut().zip(&seen) {
                for (key, score) in result.iter_mut().flatten() {
                    over_valid(*key, score, picture, &shown.truth, valid);
                }
            }
        }
        if !given.is_empty() {
            let all = Mask::new(compared.width, compared.height, vec![true; compared.area()]);
            let mask = masks.given.as_ref().or(self.valid.as_ref());
            let mask = mask.and_then(|mask| compared.crop_mask(mask));
            let mask = mask.or(all.map(Cow::Owned));
            let truth = compared
                .crop(&Picture::Rgb8(self.image.clone()))
                .into_owned();
            let pictures: Vec<&Picture> = pictures.iter().map(AsRef::as_ref).collect();
            let inside = scored(
                &scorer.restricted(&given),
                &truth,
                &pictures,
                mask.as_deref(),
            );
            let place = |key: &MetricKey| scorer.keys().iter().position(|k| k == key);
            for (result, inside) in results.iter_mut().zip(inside) {
                if let (Ok(scores), Ok(inside)) = (result, inside) {
                    scores.extend(inside);
                    scores.sort_by_key(|(key, _)| place(key));
                }
            }
        }
        results
    }

    /// Maps of SSIM and LPIPS for a picture, by the rules of [`score`](Self::score).
    pub(crate) fn maps(
        &self,
        scorer: &Scorer,
        picture: &Picture,
        region: Option<Region>,
    ) -> Result<Maps, String> {
        let shown = self.shown(region.unwrap_or(Region::whole(self.dimensions())))?;
        let examined = scorer.examine(&shown.seen(picture), &shown.truth, None, true);
        Ok(examined.map_err(|error| error.to_string())?.maps)
    }

    /// Prepares the part of the target inside `region`.
    fn shown(&self, region: Region) -> Result<Shown<'_>, String> {
        let size = self.dimensions();
        if !region.fits(size) {
            return Err(format!(
                "the crop {region} is not inside the target, {}x{}",
                size.0, size.1
            ));
        }
        let truth = region.crop(&Picture::Rgb8(self.image.clone())).into_owned();
        let valid = self.valid.as_ref().and_then(|mask| region.crop_mask(mask));
        let Some(valid) = valid.filter(|mask| mask.values().contains(&false)) else {
            return Ok(Shown {
                truth,
                excluding: None,
            });
        };
        let colour = mean_colour(&truth, &valid)
            .ok_or_else(|| "the dataset's mask leaves no pixel to score".to_owned())?;
        Ok(Shown {
            truth: filled(&truth, &valid, colour),
            excluding: Some((valid, colour)),
        })
    }
}

/// The part of the target that a picture is compared with.
struct Shown<'a> {
    truth: Picture,
    /// The pixels that count, and the colour that replaces all other pixels in both pictures;
    /// `None` if all pixels count.
    excluding: Option<(Cow<'a, Mask>, [f32; 3])>,
}

impl Shown<'_> {
    /// The picture as it is compared, with excluded pixels filled. A picture of the wrong size is returned unchanged;
    /// the scorer reports both sizes.
    fn seen<'p>(&self, picture: &'p Picture) -> Cow<'p, Picture> {
        match &self.excluding {
            Some((valid, colour)) if picture.dimensions() == self.truth.dimensions() => {
                Cow::Owned(filled(picture, valid, *colour))
            }
            _ => Cow::Borrowed(picture),
        }
    }
}

fn scored(
    scorer: &Scorer,
    truth: &Picture,
    pictures: &[&Picture],
    frustum: Option<&Mask>,
) -> Vec<Result<Scores, String>> {
    let results = scorer.score_all(truth, pictures, frustum).into_iter();
    results
        .map(|result| result.map_err(|error| error.to_string()))
        .collect()
}

/// Share of the pixels that are inside the mask; `None` if the mask has no pixels.
fn share(mask: &Mask) -> Option<f64> {
    let inside = mask.values().iter().filter(|inside| **inside).count();
    let all = mask.values().len();
    (all > 0).then(|| inside as f64 / all as f64)
}

/// Mean colour over valid pixels, 0..1 per channel; `None` if no pixel is valid.
fn mean_colour(picture: &Picture, valid: &Mask) -> Option<[f32; 3]> {
    let width = picture.dimensions().0 as usize;
    let (mut sum, mut count) = ([0.0; 3], 0_u64);
    let places = valid.values().iter().enumerate();
    for (i, _) in places.filter(|(_, inside)| **inside) {
        let (x, y) = ((i % width) as u32, (i / width) as u32);
        count += 1;
        for (channel, sum) in sum.iter_mut().enumerate() {
            *sum += picture.value(x, y, channel);
        }
    }
    (count > 0).then(|| sum.map(|sum: f64| (sum / count as f64) as f32))
}

/// Fills all pixels outside `valid` with one colour.
fn filled(picture: &Picture, valid: &Mask, colour: [f32; 3]) -> Picture {
    let (width, height) = picture.dimensions();
    Picture::RgbF32(Rgb32FImage::from_fn(width, height, |x, y| {
        let inside = valid.values()[y as usize * width as usize + x as usize];
        Rgb(if inside {
            std::array::from_fn(|channel| picture.value(x, y, channel) as f32)
        } else {
            colour
        })
    }))
}

/// Replaces PSNR by PSNR over the valid pixels; other metrics are unchanged.
fn over_valid(
    key: MetricKey,
    score: &mut Result<f64, Unavailable>,
    picture: &Picture,
    truth: &Picture,
    valid: &Mask,
) {
    let psnr = || sharp_metrics::psnr(picture, truth, Some(valid));
    match key.metric() {
        _ if key.is_masked() => {}
        Metric::Psnr => *score = psnr(),
        Metric::PsnrFloored => *score = psnr().map(sharp_metrics::psnr::floored),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;
    use sharp_metrics::Selection;
    use sharp_metrics::weights::Weights;

    fn noise(seed: u32, x: u32, y: u32) -> u8 {
        let mixed = (x * 7 + y * 13 + seed * 31).wrapping_mul(2_654_435_761);
        (mixed >> 24) as u8
    }

    fn picture(seed: u32) -> RgbImage {
        RgbImage::from_fn(40, 30, |x, y| Rgb([0, 1, 2].map(|c| noise(seed + c, x, y))))
    }

    /// Excludes a block of 12 × 10 pixels.
    fn valid() -> GrayImage {
        GrayImage::from_fn(40, 30, |x, y| {
            let excluded = (8..20).contains(&x) && (5..15).contains(&y);
            Luma([if excluded { 0 } else { 255 }])
        })
    }

    fn scores(truth: &GroundTruth, prediction: &RgbImage) -> Vec<f64> {
        let selection = Selection::parse("psnr,ssim-all").unwrap();
        let scorer = Scorer::new(&selection, &Weights::none()).unwrap();
        let picture = Picture::Rgb8(prediction.clone());
        let mut scores = truth.score(&scorer, &[(&picture, None)], &PairMasks::default());
        scores
            .remove(0)
            .unwrap()
            .into_iter()
            .map(|(_, score)| score.unwrap())
            .collect()
    }

    #[test]
    fn excluded_pixels_are_the_photographs_own() {
        let gray = |level: u8| RgbImage::from_pixel(4, 1, Rgb([level; 3]));
        let valid = GrayImage::from_raw(4, 1, vec![255, 0, 255, 0]).unwrap();
        let truth = GroundTruth::of(gray(9), Some(&valid));
        let filled = truth.with_excluded_of(&gray(200)).into_owned();
        let levels: Vec<u8> = filled.pixels().map(|pixel| pixel.0[0]).collect();
        assert_eq!(levels, [200, 9, 200, 9]);
        // A prediction of a part of the target stays as it is.
        let part = RgbImage::new(2, 1);
        assert_eq!(*truth.with_excluded_of(&part), part);
    }

    #[test]
    fn psnr_is_that_of_the_valid_pixels() {
        let (truth, prediction, valid) = (picture(1), picture(2), valid());
        let mut squares = 0.0;
        let pixels = truth.pixels().zip(prediction.pixels()).zip(valid.pixels());
        for ((a, b), _) in pixels.filter(|(_, valid)| valid.0[0] == 255) {
            for channel in 0..3 {
                squares += (f64::from(a.0[channel]) - f64::from(b.0[channel])).powi(2);
            }
        }
        let mean = squares / (3.0 * f64::from(40 * 30 - 12 * 10));
        let expected = 10.0 * (255.0_f64.powi(2) / mean).log10();
        let found = scores(&GroundTruth::of(truth, Some(&valid)), &prediction)[0];
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }

    #[test]
    fn nothing_that_is_excluded_has_a_say() {
        let valid = valid();
        let truth = GroundTruth::of(picture(1), Some(&valid));
        let (mut other, mut black) = (picture(2), picture(1));
        let before = scores(&truth, &other);
        for (x, y, level) in valid.enumerate_pixels() {
            if level.0[0] == 0 {
                other.put_pixel(x, y, Rgb([255, 0, 255]));
                black.put_pixel(x, y, Rgb([0; 3]));
            }
        }
        assert_eq!(scores(&truth, &other), before);
        // The target's own values at excluded pixels do not count either.
        assert_eq!(
            scores(&GroundTruth::of(black, Some(&valid)), &other),
            before
        );
        assert_ne!(scores(&GroundTruth::of(picture(1), None), &other), before);
        // The target equals itself, whatever the fill colour.
        let perfect = scores(&truth, truth.image());
        assert_eq!(perfect[0], f64::INFINITY);
        let close = |score: &f64| *score > 80.0 - 1e-9 || (score - 1.0).abs() < 1e-4;
        assert!(perfect[1..].iter().all(close), "{perfect:?}");
    }

    #[test]
    fn the_mask_of_a_run_is_the_datasets_unless_one_is_given() {
        let selection = Selection::parse("psnr@mask,psnr,ssim-gauss11-zero@mask").unwrap();
        let scorer = Scorer::new(&selection, &Weights::none()).unwrap();
        let prediction = Picture::Rgb8(picture(2));
        let score = |truth: &GroundTruth, masks: &PairMasks| -> Vec<f64> {
            let mut found = truth.score(&scorer, &[(&prediction, None)], masks);
            let found = found.remove(0).unwrap().into_iter();
            found.map(|(_, score)| score.unwrap()).collect()
        };
        let (valid, none) = (valid(), PairMasks::default());
        let of_dataset = score(&GroundTruth::of(picture(1), Some(&valid)), &none);
        assert!(
            (of_dataset[0] - of_dataset[1]).abs() < 1e-6,
            "{of_dataset:?}"
        );
        let given = PairMasks {
            given: Mask::new(40, 30, valid.iter().map(|v| *v == 255).collect()),
            ..PairMasks::default()
        };
        let whole = score(&GroundTruth::of(picture(1), None), &given);
        assert_eq!((whole[0], whole[2]), (of_dataset[0], of_dataset[2]));
        assert_ne!(whole[1], of_dataset[1]);
        let unmasked = score(&GroundTruth::of(picture(1), None), &none);
        assert_eq!(unmasked[0], unmasked[1]);
    }

    #[test]
    fn a_cropped_border_is_no_part_of_either_picture() {
        let selection = Selection::parse("psnr,ssim").unwrap();
        let scorer = Scorer::new(&selection, &Weights::none()).unwrap();
        let masks = PairMasks {
            border: Border::Twentieth,
            ..PairMasks::default()
        };
        let inner = Border::Twentieth.kept((40, 30));
        let cut = |seed| inner.crop(&Picture::Rgb8(picture(seed))).into_owned();
        let Picture::Rgb8(truth) = cut(1) else {
            panic!()
        };
        let expected = GroundTruth::of(truth, None);
        let expected = expected.score(&scorer, &[(&cut(2), None)], &PairMasks::default());
        let right = Region {
            x: 20,
            ..Region::whole((20, 30))
        };
        let half = right.crop(&Picture::Rgb8(picture(2))).into_owned();
        let whole = Picture::Rgb8(picture(2));
        let pictures = [(&whole, None), (&half, Some(right)), (&half, None)];
        let found = GroundTruth::of(picture(1), None).score(&scorer, &pictures, &masks);
        assert_eq!(found[0], expected[0]);
        assert!(found[1].is_ok() && found[1] != found[0]);
        assert!(found[2].as_ref().unwrap_err().contains("20x30"));
    }

    #[test]
    fn a_mask_that_excludes_nothing_changes_no_bit() {
        let all = GrayImage::from_pixel(40, 30, Luma([255]));
        let masked = GroundTruth::of(picture(1), Some(&all));
        assert_eq!(masked, GroundTruth::of(picture(1), None));
        assert_eq!(masked.valid_share(None), None);
        let share = GroundTruth::of(picture(1), Some(&valid())).valid_share(None);
        assert_eq!(share, Some(0.9));
        let nothing = GrayImage::new(40, 30);
        let truth = GroundTruth::of(picture(1), Some(&nothing));
        let selection = Selection::parse("psnr").unwrap();
        let scorer = Scorer::new(&selection, &Weights::none()).unwrap();
        let picture = Picture::Rgb8(picture(2));
        let mut error = truth.score(&scorer, &[(&picture, None)], &PairMasks::default());
        assert!(error.remove(0).unwrap_err().contains("no pixel to score"));
    }

    #[test]
    fn predictions_scored_together_have_the_bits_of_each_alone() {
        let selection =
            Selection::parse("psnr,psnr@mask,ssim-all,lpips-alex,dists,psnr@frustum").unwrap();
        let scorer = Scorer::new(&selection, &Weights::deterministic("")).unwrap();
        let truth = GroundTruth::of(picture(1), Some(&valid()));
        let masks = PairMasks {
            frustum: Mask::new(40, 30, (0..1200).map(|i| i % 40 > 10).collect()),
            ..PairMasks::default()
        };
        let region = Region {
            x: 4,
            y: 2,
            width: 32,
            height: 24,
        };
        let crop = |seed| region.crop(&Picture::Rgb8(picture(seed))).into_owned();
        let pictures = [
            (Picture::Rgb8(picture(2)), None),
            (crop(3), Some(region)),
            (Picture::Rgb8(RgbImage::new(5, 5)), None),
            (Picture::Rgb8(picture(4)), None),
            (crop(5), Some(region)),
        ];
        let refs: Vec<_> = pictures.iter().map(|(p, region)| (p, *region)).collect();
        let together = truth.score(&scorer, &refs, &masks);
        for (result, one) in together.iter().zip(&refs) {
            let alone = truth.score(&scorer, &[*one], &masks).remove(0);
            assert_eq!(*result, alone);
        }
        assert!(together[2].as_ref().unwrap_err().contains("5x5"));
        assert!(together.iter().filter(|result| result.is_ok()).count() == 4);
    }
}
