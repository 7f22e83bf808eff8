//! Differences by class of target pixel, determined from the depth of both views: visible in the
//! source, hidden, outside the source, or close to a depth edge.
//!
//! PSNR is computed over a class's pixels. SSIM and LPIPS are the means of their maps over those
//! pixels, although windows and receptive fields extend beyond the class. DISTS has no map, so it
//! is not reported by class.

use std::collections::BTreeMap;

use image::{GrayImage, RgbImage};
use sharp_datasets::{DepthMap, Scene, View};
use sharp_metrics::identity::{Family, MetricRegion};
use sharp_metrics::{Mask, MetricInfo, MetricKey, Picture, ScoreMap, Selection, Weights, psnr};

use super::breakdown::{Division, Stratum};
use super::{Against, CompareError, PairChange, RunComparison};
use crate::evaluate::record::Record;
use crate::io::counts::counted;
use crate::io::observer::Observer;
use crate::io::pictures::read_rgb8;
use crate::pairs::depth::PosedDepth;
use crate::pairs::overlap::Projection;
use crate::pairs::valid_depth::is_valid_depth;
use crate::report::pictures::ReportPictures;
use crate::scoring::{GroundTruth, Region, Scoring};

/// Relative difference above which two depths belong to different surfaces. By default, overlap is computed with the
/// same value.
const SURFACE_TOLERANCE: f64 = 0.05;
/// Distance up to which pixels belong to a depth edge, in pixels.
const EDGE_RADIUS: i64 = 3;
/// A class of pixels gets scores for a pair only if it has at least this share of the pair's scored pixels.
const MIN_SHARE: f64 = 0.001;

/// Class of a target pixel for methods that use only the source. A pixel that fits several classes gets the first of
/// them in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PixelClass {
    /// Within three pixels of a pixel whose depth differs from a neighbour's by more than 5 % of the nearer depth.
    DepthEdge,
    /// The target or the source has no valid depth at the pixel's surface point, or the source has
    /// a farther surface there.
    Unknown,
    /// The pixel's surface point is behind the source camera or outside its image.
    OutsideSource,
    /// The source's depth at the pixel's surface point agrees within 5 %.
    Visible,
    /// The source has a nearer surface in front of the pixel's surface point.
    Disoccluded,
}

impl PixelClass {
    const ALL: [Self; 5] = [
        Self::Visible,
        Self::Disoccluded,
        Self::OutsideSource,
        Self::DepthEdge,
        Self::Unknown,
    ];

    /// Display name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Visible => "visible in the source",
            Self::Disoccluded => "disoccluded",
            Self::OutsideSource => "outside the source",
            Self::DepthEdge => "within 3 px of a depth edge",
            Self::Unknown => "depth unknown",
        }
    }
}

/// The class of each of the target's pixels, row-major.
pub fn classes(target: &PosedDepth, source: &PosedDepth) -> Vec<PixelClass> {
    let projection = Projection::new(target, source);
    let (width, height) = source.depth().dimensions();
    let class = |x: u32, y: u32, depth: f32| {
        if !is_valid_depth(depth) {
            return PixelClass::Unknown;
        }
        let point = projection.apply(x as usize, y as usize, f64::from(depth));
        let (u, v, z) = (point.x / point.z, point.y / point.z, point.z);
        if !(z > 0.0 && u >= 0.0 && v >= 0.0 && u < f64::from(width) && v < f64::from(height)) {
            return PixelClass::OutsideSource;
        }
        let seen = source.depth().get_pixel(u as u32, v as u32).0[0];
        match f64::from(seen) - z {
            _ if !is_valid_depth(seen) => PixelClass::Unknown,
            difference if difference.abs() <= SURFACE_TOLERANCE * z => PixelClass::Visible,
            difference if difference < 0.0 => PixelClass::Disoccluded,
            _ => PixelClass::Unknown,
        }
    };
    let pixels = target.depth().enumerate_pixels();
    let mut classes: Vec<PixelClass> = pixels.map(|(x, y, d)| class(x, y, d.0[0])).collect();
    mark_edges(target.depth(), &mut classes);
    classes
}

fn mark_edges(depth: &DepthMap, classes: &mut [PixelClass]) {
    let (width, height) = (i64::from(depth.width()), i64::from(depth.height()));
    let at = |x: i64, y: i64| depth.as_raw()[(y * width + x) as usize];
    let differ = |a: f32, b: f32| {
        let (a, b) = (f64::from(a), f64::from(b));
        (a - b).abs() > SURFACE_TOLERANCE * a.min(b)
    };
    let reach = || -EDGE_RADIUS..=EDGE_RADIUS;
    let disc: Vec<(i64, i64)> = reach()
        .flat_map(|dy| reach().map(move |dx| (dx, dy)))
        .filter(|(dx, dy)| dx * dx + dy * dy <= EDGE_RADIUS * EDGE_RADIUS)
        .collect();
    let mut mark = |x: i64, y: i64| {
        for (dx, dy) in &disc {
            let (x, y) = (x + dx, y + dy);
            if (0..width).contains(&x) && (0..height).contains(&y) {
                classes[(y * width + x) as usize] = PixelClass::DepthEdge;
            }
        }
    };
    for y in 0..height {
        for x in 0..width {
            for (nx, ny) in [(x + 1, y), (x, y + 1)] {
                if nx >= width || ny >= height {
                    continue;
                }
                let (here, there) = (at(x, y), at(nx, ny));
                if is_valid_depth(here) && is_valid_depth(there) && differ(here, there) {
                    mark(x, y);
                    mark(nx, ny);
                }
            }
        }
    }
}

/// Differences of two methods by class of pixel.
#[derive(Debug, Default)]
pub struct Anatomy {
    /// Differences by class of pixel, each with the class's share of the pixels.
    pub strata: Vec<Stratum>,
    /// Pairs and metrics that were left out, and why, one line each.
    pub notes: Vec<String>,
}

/// Scores of one class in one pair.
struct ClassScores<'a> {
    class: PixelClass,
    share: f64,
    /// Changes, indexed by metric; `None` if the class has too few pixels.
    changes: Vec<Option<PairChange<'a>>>,
}

impl RunComparison {
    /// Compares two methods by class of target pixel, on pairs with kept pictures in both runs. `scenes` provide
    /// photographs, cameras and depth.
    ///
    /// # Errors
    /// If the available weights differ from the weights of the runs.
    pub fn anatomy(
        &self,
        against: &Against,
        scenes: &[Scene],
        weights: &Weights,
        observer: &dyn Observer,
    ) -> Result<Anatomy, CompareError> {
        let mut anatomy = Anatomy::default();
        let metrics = self.mapped_metrics(&mut anatomy.notes);
        let keys: Vec<MetricKey> = metrics.iter().map(|metric| metric.key).collect();
        let refused = |reason: String| CompareError::Anatomy(reason);
        let scoring = Scoring::new(&Selection::of(&keys), weights)
            .map_err(|error| refused(error.to_string()))?;
        for (at_hand, of_runs) in scoring.scorer.info().iter().zip(&metrics) {
            let network = |info: &MetricInfo| info.backbone.as_ref().map(ToString::to_string);
            if network(at_hand) != network(of_runs) {
                let (found, used) = (network(at_hand), network(of_runs));
                return Err(refused(format!(
                    "the runs computed {} with {}, but {} is available",
                    of_runs.key,
                    used.as_deref().unwrap_or("no network"),
                    found.as_deref().unwrap_or("none"),
                )));
            }
        }
        let pictures = ReportPictures::new(&self.results, scenes);
        let pairs: Vec<(&Record, &Record)> = self.sides(against).both().collect();
        observer.begin(
            "locating differences between pictures",
            pairs.len(),
            "pairs",
        );
        let mut datasets: BTreeMap<&str, Vec<ClassScores<'_>>> = BTreeMap::new();
        let mut without: BTreeMap<String, usize> = BTreeMap::new();
        for (done, (a, b)) in pairs.into_iter().enumerate() {
            observer.progress(done, &a.pair_id);
            match of_pair([a, b], &pictures, &metrics, &scoring) {
                Ok(classes) => datasets.entry(&a.dataset).or_default().extend(classes),
                Err(reason) => *without.entry(reason).or_default() += 1,
            }
        }
        observer.end();
        for (reason, pairs) in without {
            let pairs = counted(pairs, "pair");
            anatomy
                .notes
                .push(format!("{pairs} not divided by kind of pixel: {reason}"));
        }
        for of_dataset in datasets.values() {
            for (at, metric) in metrics.iter().enumerate() {
                for class in PixelClass::ALL {
                    let of_class = || of_dataset.iter().filter(|found| found.class == class);
                    let shares = of_class().map(|found| found.share);
                    let share = shares.sum::<f64>() / of_class().count().max(1) as f64;
                    let changes: Vec<&PairChange<'_>> = of_class()
                        .filter_map(|found| found.changes[at].as_ref())
                        .collect();
                    if !changes.is_empty() {
                        let name = class.name().to_owned();
                        let by = Division::Pixels;
                        let stratum = self.stratum(against, metric, by, name, &changes);
                        anatomy.strata.push(Stratum {
                            pixel_share: Some(share),
                            ..stratum
                        });
                    }
                }
            }
        }
        Ok(anatomy)
    }

    /// Metrics on whole pictures that have per-pixel values. Adds a note on the metrics that have
    /// no per-pixel values.
    fn mapped_metrics(&self, notes: &mut Vec<String>) -> Vec<MetricInfo> {
        let metrics = self.results.manifest.metrics.iter().map(|m| &m.info);
        let (mapped, others): (Vec<_>, Vec<_>) = metrics
            .filter(|metric| metric.key.region() == MetricRegion::Whole)
            .cloned()
            .partition(|metric| metric.key.family() != Family::Dists);
        for metric in others {
            notes.push(format!(
                "{} compares statistics of whole pictures, so it has no value per pixel and is \
                 not divided by kind of pixel",
                metric.key
            ));
        }
        mapped
    }
}

/// Scores of one pair by class. Errors do not name the pair; the caller counts pairs by reason.
fn of_pair<'a>(
    [a, b]: [&'a Record; 2],
    pictures: &ReportPictures<'_>,
    metrics: &[MetricInfo],
    scoring: &Scoring,
) -> Result<Vec<ClassScores<'a>>, String> {
    let kept = |record| {
        pictures
            .kept_file(record)
            .map_err(|error| error.to_string())
    };
    let files = [kept(a)?, kept(b)?];
    let view = |id: &str| pictures.view(a, id).map_err(|error| error.to_string());
    let (source, target) = (view(&a.source)?, view(&a.target)?);
    let (from, at) = (posed(source)?, posed(target)?);
    let image = target.content.image().map_err(|error| error.to_string())?;
    let valid = target.content.valid_pixels();
    let valid = valid.map_err(|error| error.to_string())?;
    let region = a
        .crop
        .map_or(Region::whole(image.dimensions()), |crop| crop.region);
    let masks = masks(&classes(&at, &from), &image, valid.as_ref(), region)?;
    let truth_part = region.crop(&Picture::Rgb8(image.clone())).into_owned();
    let truth = GroundTruth::of(image, valid.as_ref());
    let mut sides = Vec::new();
    for file in files {
        let picture = read_rgb8(&file).map_err(|error| error.to_string())?;
        let picture = Picture::Rgb8(picture);
        if picture.dimensions() != region.size() {
            return Err("a kept picture does not have the size of the scored region".to_owned());
        }
        let maps = truth.maps(&scoring.scorer, &picture, Some(region))?;
        sides.push((picture, maps));
    }
    let scored: usize = masks.iter().map(|(_, mask)| mask.count()).sum();
    let classes = masks.into_iter().map(|(class, mask)| {
        let share = mask.count() as f64 / scored.max(1) as f64;
        let change = |metric: &MetricInfo| {
            let of_side =
                |(picture, maps): &(Picture, sharp_metrics::Maps)| match metric.key.family() {
                    Family::Psnr => psnr(picture, &truth_part, Some(&mask)).ok(),
                    _ => {
                        let (_, map) = maps.iter().find(|(key, _)| *key == metric.key)?;
                        mean_inside(map.as_ref().ok()?, &mask)
                    }
                };
            let scores = [of_side(&sides[0])?, of_side(&sides[1])?];
            Some(PairChange::new(metric, a, scores))
        };
        let changes = metrics.iter().map(|metric| {
            if share < MIN_SHARE {
                None
            } else {
                change(metric)
            }
        });
        ClassScores {
            class,
            share,
            changes: changes.collect(),
        }
    });
    Ok(classes.collect())
}

fn posed(view: &View) -> Result<PosedDepth, String> {
    let depth = view.content.depth().map_err(|error| error.to_string())?;
    let depth = depth.ok_or("a view has no depth")?;
    PosedDepth::of_view(view, depth).map_err(|error| error.to_string())
}

/// The scored pixels of each class in a region.
fn masks(
    classes: &[PixelClass],
    image: &RgbImage,
    valid: Option<&GrayImage>,
    region: Region,
) -> Result<Vec<(PixelClass, Mask)>, String> {
    let (width, height) = image.dimensions();
    let counts = |i: usize| valid.is_none_or(|valid| valid.as_raw().get(i) == Some(&255));
    let mask = |class: PixelClass| {
        let inside = classes.iter().enumerate();
        let inside = inside.map(|(i, of_pixel)| *of_pixel == class && counts(i));
        let whole = Mask::new(width, height, inside.collect())?;
        Some((class, region.crop_mask(&whole)?.into_owned()))
    };
    let masks: Option<Vec<_>> = PixelClass::ALL.into_iter().map(mask).collect();
    masks.ok_or_else(|| "its depth and its photograph differ in size".to_owned())
}

/// Mean of a map over a mask; `None` if the map has no value inside the mask.
fn mean_inside(map: &ScoreMap, mask: &Mask) -> Option<f64> {
    let width = mask.dimensions().0;
    let values = map.values.enumerate_pixels().filter(|(x, y, _)| {
        let (x, y) = (x + map.origin, y + map.origin);
        mask.values().get((y * width + x) as usize) == Some(&true)
    });
    let (sum, count) = values.fold((0.0, 0_u64), |(sum, count), (_, _, value)| {
        (sum + f64::from(value.0[0]), count + 1)
    });
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests {
    use image::Luma;
    use sharp::camera::{Intrinsics, RigidTransform};

    use super::*;

    fn view(shift: f64, depth: DepthMap) -> PosedDepth {
        let (width, height) = depth.dimensions();
        let centre = (f64::from(width) / 2.0, f64::from(height) / 2.0);
        let intrinsics = Intrinsics::new((10.0, 10.0), centre, (width, height)).unwrap();
        let camera_from_world = RigidTransform {
            translation: glam::DVec3::new(shift, 0.0, 0.0),
            ..RigidTransform::IDENTITY
        };
        PosedDepth::new("v", intrinsics, camera_from_world, depth).unwrap()
    }

    /// A wall at 10 m, with a board at 5 m in front of it in columns `near` of the picture.
    fn wall(near: std::ops::Range<u32>) -> DepthMap {
        DepthMap::from_fn(60, 9, |x, _| {
            Luma([if near.contains(&x) { 5.0 } else { 10.0 }])
        })
    }

    #[test]
    fn a_board_before_a_wall_hides_what_lies_behind_it() {
        // The target is 10 m to the right of the source (f 10 px), so the wall moves by 10 columns and the board by 20:
        // from 40..50 in the source to 20..30 in the target.
        let source = view(0.0, wall(40..50));
        let target = view(-10.0, wall(20..30));
        let found = classes(&target, &source);
        let row: Vec<PixelClass> = found[4 * 60..5 * 60].to_vec();
        // Around the board's edges (19|20 and 29|30): the adjacent pixels, and three more on each side.
        for x in [16, 19, 20, 23, 26, 29, 30, 33] {
            assert_eq!(row[x], PixelClass::DepthEdge, "{x}");
        }
        assert_eq!(row[24], PixelClass::Visible);
        // Column x of the target's wall is column x + 10 of the source, so for 30..40 it is behind the board.
        assert_eq!(
            (row[34], row[39]),
            (PixelClass::Disoccluded, PixelClass::Disoccluded)
        );
        assert_eq!(
            (row[40], row[49], row[15]),
            (
                PixelClass::Visible,
                PixelClass::Visible,
                PixelClass::Visible
            )
        );
        assert_eq!(
            (row[50], row[59]),
            (PixelClass::OutsideSource, PixelClass::OutsideSource)
        );
    }

    #[test]
    fn what_depth_does_not_tell_is_unknown() {
        let mut holed = wall(0..0);
        holed.put_pixel(5, 4, Luma([0.0]));
        let plain = view(0.0, wall(0..0));
        let class = |target: &PosedDepth, source: &PosedDepth| classes(target, source)[4 * 60 + 5];
        assert_eq!(class(&plain, &plain), PixelClass::Visible);
        assert_eq!(
            class(&view(0.0, holed.clone()), &plain),
            PixelClass::Unknown
        );
        assert_eq!(class(&plain, &view(0.0, holed)), PixelClass::Unknown);
        // The source has a farther surface.
        let far = DepthMap::from_pixel(60, 9, Luma([30.0]));
        assert_eq!(class(&plain, &view(0.0, far)), PixelClass::Unknown);
        let behind = DepthMap::from_pixel(60, 9, Luma([1.0]));
        assert_eq!(class(&plain, &view(0.0, behind)), PixelClass::Disoccluded);
    }

    #[test]
    fn classes_part_the_picture_and_their_errors_add_up() {
        let source = view(0.0, wall(40..50));
        let target = view(-10.0, wall(20..30));
        let picture = |seed: u32| {
            RgbImage::from_fn(60, 9, |x, y| {
                image::Rgb([0, 1, 2].map(|c| ((x * 7 + y * 13 + c * 5) * seed % 251) as u8))
            })
        };
        let (truth, shown) = (picture(3), picture(5));
        let region = Region {
            x: 2,
            y: 1,
            width: 50,
            height: 7,
        };
        let mut valid = GrayImage::from_pixel(60, 9, Luma([255]));
        valid.put_pixel(24, 4, Luma([0]));
        let masks = masks(&classes(&target, &source), &truth, Some(&valid), region).unwrap();
        let scored: usize = masks.iter().map(|(_, mask)| mask.count()).sum();
        assert_eq!(scored, 50 * 7 - 1);
        let crop = |image: &RgbImage| region.crop(&Picture::Rgb8(image.clone())).into_owned();
        let (truth, shown) = (crop(&truth), crop(&shown));
        let mse = |mask: &Mask| 10_f64.powf(-psnr(&shown, &truth, Some(mask)).unwrap() / 10.0);
        let parts: f64 = masks
            .iter()
            .filter(|(_, mask)| mask.count() > 0)
            .map(|(_, mask)| mask.count() as f64 * mse(mask))
            .sum();
        let mut inside = vec![true; 350];
        inside[3 * 50 + 22] = false;
        let all = Mask::new(50, 7, inside).unwrap();
        assert!((parts / 349.0 - mse(&all)).abs() < 1e-12);
    }

    #[test]
    fn means_are_those_of_the_map_inside() {
        // A map without the picture's outermost rows and columns.
        let map = ScoreMap {
            values: image::ImageBuffer::from_vec(2, 1, vec![0.25, 0.75]).unwrap(),
            origin: 1,
        };
        let mask = |set: &[usize]| {
            let inside = (0..12).map(|i| set.contains(&i)).collect();
            Mask::new(4, 3, inside).unwrap()
        };
        assert_eq!(mean_inside(&map, &mask(&[5])), Some(0.25));
        assert_eq!(mean_inside(&map, &mask(&[0, 5, 6])), Some(0.5));
        assert_eq!(mean_inside(&map, &mask(&[0, 4, 7])), None);
    }
}
