//! Detects exposures, white balances and tone curves that all pictures of a dataset have and their targets do not, as
//! well as darker corners and masked backgrounds.
//!
//! Sorted levels are compared, because they do not depend on position and, in reduced pictures, hardly on noise and
//! blur. Methods that reproduce levels badly err differently in each picture, so only a curve shared by nearly all
//! pictures is evidence.

use std::collections::BTreeSet;
use std::iter::zip;

use image::RgbImage;
use image::imageops::thumbnail;
use sharp::color::linear_from_srgb;

use super::camera::is_reframed;
use super::curve::{Curve, LevelPair, explained, explaining, level_pairs};
use super::group::{Extent, PictureGroup};
use super::measures::Tone;
use crate::evaluate::record::Record;

/// Number of cells across and down.
const GRID: [u32; 2] = [32, 24];
/// Quantiles that are compared, in percent.
const QUANTILES: [usize; 5] = [10, 30, 50, 70, 90];
/// Highest level that counts as black. Cells with a black pixel are skipped as holes unless the target is dark there.
const MAX_BLACK: u8 = 3;
/// Maximum mean level of the target in a cell where it is dark.
const MAX_DARK: u8 = 20;
/// A picture's tone is measured only if at least this share of its cells are not skipped as holes.
const MIN_CELLS: f64 = 0.5;
/// A finding is reported only if at least this many of a dataset's pictures have it.
const MIN_PICTURES: usize = 3;
/// A curve or dark corners are reported only if at least this share of a dataset's pictures have them.
const MIN_SHARE: f64 = 0.8;
/// A curve is sought only if the root mean square difference of the pictures' levels from the targets' is at least
/// this.
const MIN_OFF: f64 = 8.0;
/// Like [`MIN_OFF`], but for one scene of a dataset. Blurred predictions of one scene differ by less.
const MIN_OFF_IN_SCENE: f64 = 16.0;
/// A difference in exposure between sources and targets is reported only if at least this share of the pictures have
/// the exposure of their sources.
const MIN_FOLLOWING: f64 = 0.4;
/// The rings that are compared (middle, halfway, corners) as ranges of the squared distance from the middle, which is 1
/// at the corners.
const RINGS: [(f64, f64); 3] = [(0.0, 0.12), (0.3, 0.5), (0.65, 1.0)];
/// Corners are dark if their darkening is at least this. Darkening is the natural logarithm of picture / target
/// brightness in the middle, minus that in the corners.
const MIN_DARKENING: f64 = 0.16;
/// A picture agrees on dark corners if its darkening, a natural logarithm, differs from the median of all pictures by
/// at most this, or by 0.3 of the median if that is larger.
const MAX_UNEVEN: f64 = 0.12;
/// Dark corners are reported only if the darkening halfway to them is at least this share of their own.
const MIN_BETWEEN: f64 = 0.15;
/// Dark corners are reported only if the darkening halfway to them is at most this share of their own.
const MAX_BETWEEN: f64 = 0.85;

/// Colour spaces with wider primaries than sRGB, with [`Tone::mixed`] of sRGB's colours in them (IEC 61966-2-1, Adobe RGB
/// (1998), SMPTE EG 432-1).
const WIDER: [(&str, [f64; 3]); 2] = [
    ("Adobe RGB", [0.285, 0.0, 0.041]),
    ("Display P3", [0.178, 0.033, 0.09]),
];
/// A picture agrees with a wider colour space if each share in [`Tone::mixed`] differs from the space's share by at
/// most this. Predictions of weak colours mix more green into blue.
const MAX_MIXED_OFF: f64 = 0.05;
/// Mixing is measured only if the variance of the difference between two channels is at least this, in linear light.
const MIN_COLOUR: f64 = 4e-4;

/// A picture is masked if at least this percentage of the content that both source and target show is black or white in
/// it. Holes of predictions do not count, because they are where the source shows nothing.
const MIN_MASKED_PERCENT: u8 = 5;
/// Masked pictures are reported only if they are at least this share of the pictures.
const MIN_MASKED_SHARE: f64 = 0.5;

/// Measures a picture's tone; all pictures are shrunk. Cells with a pixel of the colour `filled` are skipped as holes.
/// `None` if too much of the picture is black or filled.
pub(super) fn tone(
    [source, target, shown]: [&RgbImage; 3],
    filled: Option<[u8; 3]>,
) -> Option<Tone> {
    let reduced = |of: &RgbImage| thumbnail(of, GRID[0], GRID[1]);
    let [source, seen, own] = [source, target, shown].map(reduced);
    let (width, height) = shown.dimensions();
    let mut is_hole = vec![false; own.pixels().len()];
    for (x, y, pixel) in shown.enumerate_pixels() {
        let (x, y) = (x * GRID[0] / width, y * GRID[1] / height);
        let is_dark = seen
            .get_pixel(x, y)
            .0
            .iter()
            .all(|level| *level <= MAX_DARK);
        let is_black = !is_dark && pixel.0.iter().all(|level| *level <= MAX_BLACK);
        is_hole[(y * GRID[0] + x) as usize] |= is_black || Some(pixel.0) == filled;
    }
    let cells = is_hole.iter().enumerate().filter(|(_, is)| !**is);
    let cells: Vec<u32> = cells.map(|(cell, _)| cell as u32).collect();
    if (cells.len() as f64) < MIN_CELLS * is_hole.len() as f64 {
        return None;
    }
    let levels = |of: &RgbImage| {
        std::array::from_fn(|channel| {
            let of_cell = |cell: &u32| of.get_pixel(cell % GRID[0], cell / GRID[0]).0[channel];
            let mut levels: Vec<u8> = cells.iter().map(of_cell).collect();
            levels.sort_unstable();
            QUANTILES.map(|percent| levels[(levels.len() - 1) * percent / 100])
        })
    };
    Some(Tone {
        picture: levels(&own),
        target: levels(&seen),
        source: levels(&source),
        corners: corners(&cells, &seen, &own),
        mixed: mixed(&cells, &seen, &own),
    })
}

/// Measures [`Tone::mixed`] by fitting each channel with a constant and two channels of the target.
fn mixed(cells: &[u32], seen: &RgbImage, own: &RgbImage) -> Option<[i16; 3]> {
    let light = |of: &RgbImage, channel: usize| -> Vec<f64> {
        let levels = cells
            .iter()
            .map(|cell| of.get_pixel(cell % GRID[0], cell / GRID[0]).0[channel]);
        levels
            .map(|level| f64::from(linear_from_srgb(f32::from(level) / 255.0)))
            .collect()
    };
    let count = cells.len() as f64;
    let product = |one: &[f64], other: &[f64]| {
        let [x, y] = [one, other].map(|of| of.iter().sum::<f64>() / count);
        zip(one, other).map(|(a, b)| (a - x) * (b - y)).sum::<f64>() / count
    };
    let share = |[channel, other]: [usize; 2]| {
        let [x, y, own] = [
            light(seen, channel),
            light(seen, other),
            light(own, channel),
        ];
        let [xx, xy, yy] = [product(&x, &x), product(&x, &y), product(&y, &y)];
        let [x, y] = [product(&x, &own), product(&y, &own)];
        let [of_channel, of_other] = [yy * x - xy * y, xx * y - xy * x];
        let share = of_other / (of_channel + of_other);
        let is_measured = xx + yy - 2.0 * xy >= MIN_COLOUR && share.is_finite();
        is_measured.then(|| (1000.0 * share).round() as i16)
    };
    let [red, green, blue] = [[0, 1], [1, 0], [2, 1]].map(share);
    Some([red?, green?, blue?])
}

/// Measures [`Tone::corners`]; `None` if one of the rings has too few of the `cells`, which exclude holes.
fn corners(cells: &[u32], seen: &RgbImage, own: &RgbImage) -> Option<[i16; 2]> {
    let mut rings: [Vec<f64>; 3] = Default::default();
    for cell in cells {
        let (x, y) = (cell % GRID[0], cell / GRID[0]);
        let from_middle = |at: u32, of: u32| 2.0 * (f64::from(at) + 0.5) / f64::from(of) - 1.0;
        let squares = [from_middle(x, GRID[0]), from_middle(y, GRID[1])].map(|v| v * v);
        let off = (squares[0] + squares[1]) / 2.0;
        let [seen, own] = [seen, own].map(|of| {
            let sum: f64 = of.get_pixel(x, y).0.iter().map(|v| f64::from(*v)).sum();
            sum.max(3.0).ln()
        });
        for (ring, (from, to)) in rings.iter_mut().zip(RINGS) {
            if (from..to).contains(&off) {
                ring.push(own - seen);
            }
        }
    }
    let [middle, between, corner] = rings.map(|mut ring| {
        ring.sort_by(f64::total_cmp);
        (ring.len() >= 24).then(|| ring[ring.len() / 2])
    });
    let middle = middle?;
    let thousandths = |v: f64| (1000.0 * (v - middle)).round() as i16;
    Some([thousandths(corner?), thousandths(between?)])
}

/// Warns if the pictures have one curve or dark corners in common.
pub(crate) fn toned_pictures(group: &PictureGroup<'_, &Record>) -> Option<String> {
    let records = group.pictures.iter();
    let measured = records.filter_map(|record| Some((record.change, record.tone.as_ref()?)));
    let (changes, tones): (Vec<_>, Vec<&Tone>) = measured.unzip();
    // If most pictures have another detected change, that change explains their levels.
    let changed = changes.iter().flatten().count();
    if tones.len() < group.extent.fewest(MIN_PICTURES) || 2 * changed >= tones.len() {
        return None;
    }
    let (tones, name) = (&tones[..], group.name);
    match group.extent {
        Extent::Dataset => dark_corners(tones, name)
            .or_else(|| wider_colours(tones, name))
            .or_else(|| common_curve(tones, name, group.extent))
            .or_else(|| exposures_of_sources(tones, name)),
        Extent::Scene => common_curve(tones, name, group.extent),
    }
}

/// Warns if most pictures are black, white or of one colour where source and target show content. Does not warn if their
/// cameras differ from the targets', because a border may then be missing.
pub(crate) fn masked_pictures(group: &PictureGroup<'_, &Record>) -> Option<String> {
    let mut shares: Vec<u8> = group.pictures.iter().filter_map(|r| r.masked).collect();
    shares.sort_unstable();
    let (all, median) = (shares.len(), *shares.get(shares.len() / 2)?);
    let is_masked = |share: &&u8| **share >= MIN_MASKED_PERCENT;
    let count = shares.iter().filter(is_masked).count();
    let is_found = count >= group.extent.fewest(MIN_PICTURES)
        && count as f64 >= group.extent.share(MIN_MASKED_SHARE) * all as f64;
    let masked = group
        .pictures
        .iter()
        .filter(|r| r.masked.as_ref().is_some_and(|v| is_masked(&v)));
    let colours: BTreeSet<[u8; 3]> = masked.filter_map(|record| record.filled).collect();
    let are = match (colours.len(), colours.first()) {
        (0, _) | (_, None) => "are black or white".to_owned(),
        (1, Some([0, 0, 0])) => "are black".to_owned(),
        (1, Some([255, 255, 255])) => "are white".to_owned(),
        (1, Some([r, g, b])) => format!("have the colour ({r}, {g}, {b})"),
        _ => "have one exactly constant colour each".to_owned(),
    };
    (is_found && !is_reframed(group)).then(|| {
        format!(
            "its pictures {are} in places that both source and target show (a median of {median} % of these places, \
             in {count} of the {all} compared pairs of {}), as with a masked background or one that was not rendered; \
             store the pictures without a mask and render the background as well, put the pictures over a background, \
             or score them inside a mask of the dataset",
            group.name
        )
    })
}

fn common_curve(tones: &[&Tone], name: &str, extent: Extent) -> Option<String> {
    let is_most = |count: usize| count as f64 >= MIN_SHARE * tones.len() as f64;
    let by_picture = |of: fn(&Tone) -> &[[u8; 5]; 3]| -> Vec<Vec<LevelPair>> {
        tones
            .iter()
            .map(|tone| level_pairs(&tone.target, of(tone)))
            .collect()
    };
    let [pictures, sources] = [
        by_picture(|tone| &tone.picture),
        by_picture(|tone| &tone.source),
    ];
    let min_off = match extent {
        Extent::Dataset => MIN_OFF,
        Extent::Scene => MIN_OFF_IN_SCENE,
    };
    let curve = explaining(&pictures.concat(), min_off)?;
    let (count, of_sources) = (explained(&pictures, curve), explained(&sources, curve));
    let all = tones.len();
    // Within a scene, cameras often expose each photograph differently.
    if extent == Extent::Scene && 4 * of_sources > all {
        return None;
    }
    let (text, is_of_sources) = (curve.text(), is_most(of_sources));
    let told =
        format!("its pictures {text} ({count} of the {all} compared in pairs of {name} agree)");
    is_most(count).then(|| {
        if is_of_sources {
            format!(
                "{told}; the sources have the same change, so the dataset's photographs differ in exposure or white \
                 balance, and the predictions are not to blame"
            )
        } else {
            let advice = if let Curve::Line { .. } = curve {
                "store the values as predicted, without blending or stretching them"
            } else {
                "store the pictures in sRGB, as the photographs are"
            };
            format!("{told}; the sources do not have this change; {advice}")
        }
    })
}

/// Warns if many sources and targets differ in exposure, each pair by its own factor, and the pictures have the
/// exposure of their sources.
fn exposures_of_sources(tones: &[&Tone], dataset: &str) -> Option<String> {
    let following = tones.iter().filter(|tone| {
        let curve = explaining(&level_pairs(&tone.target, &tone.source), MIN_OFF);
        curve
            .is_some_and(|curve| explained(&[level_pairs(&tone.target, &tone.picture)], curve) == 1)
    });
    let (count, all) = (following.count(), tones.len());
    (count >= MIN_PICTURES && count as f64 >= MIN_FOLLOWING * all as f64).then(|| {
        format!(
            "its pictures have the exposure or white balance of their sources, which differs from the targets' in {count} of \
             the {all} compared pairs of {dataset}; use photographs of one exposure, or compare \
             scores only with those of other methods on the same pairs"
        )
    })
}

fn wider_colours(tones: &[&Tone], dataset: &str) -> Option<String> {
    let measured = tones.iter().filter_map(|tone| tone.mixed);
    let measured: Vec<[f64; 3]> = measured
        .map(|of| of.map(|v| f64::from(v) / 1000.0))
        .collect();
    WIDER.iter().find_map(|(space, mixture)| {
        let is_near = |(share, own): (&f64, &f64)| (share - own).abs() <= MAX_MIXED_OFF;
        let agreeing = measured.iter().filter(|of| zip(*of, mixture).all(is_near));
        let (count, all) = (agreeing.count(), measured.len());
        let is_found = count >= MIN_PICTURES && count as f64 >= MIN_SHARE * all as f64;
        is_found.then(|| {
            format!(
                "its pictures have the colours of pictures in {space} that are read as sRGB ({count} of the {all} pictures \
                 compared for {dataset}); convert them to sRGB, or store them with their colour profile"
            )
        })
    })
}

fn dark_corners(tones: &[&Tone], dataset: &str) -> Option<String> {
    let measured = tones
        .iter()
        .filter_map(|tone| Some(tone.corners?.map(|v| f64::from(v) / 1000.0)));
    let measured: Vec<[f64; 2]> = measured.collect();
    let mut corners: Vec<f64> = measured.iter().map(|rings| rings[0]).collect();
    corners.sort_by(f64::total_cmp);
    let middle = *corners.get(corners.len() / 2)?;
    let agreeing = measured.iter().filter(|[corner, between]| {
        (corner - middle).abs() <= MAX_UNEVEN.max(0.3 * middle.abs())
            && *between <= MIN_BETWEEN * corner
            && *between >= MAX_BETWEEN * corner
    });
    let (count, all) = (agreeing.count(), tones.len());
    let is_found =
        middle <= -MIN_DARKENING && count >= MIN_PICTURES && count as f64 >= MIN_SHARE * all as f64;
    is_found.then(|| {
        format!(
            "its pictures have corners that are {:.0} % darker, compared with their middle, than those of the photographs \
             ({count} of the {all} compared in pairs of {dataset} agree), as with vignetting or colours multiplied by an \
             alpha that falls off; store them without it",
            100.0 * (1.0 - middle.exp())
        )
    })
}

#[cfg(test)]
mod tests {
    use image::Rgb;
    use image::imageops::fast_blur;

    use super::super::filled::filled_colour;
    use super::super::group::tests::of_dataset;
    use sharp::color::srgb_from_linear;

    use super::*;
    use crate::evaluate::record::Status;
    use crate::evaluate::record::tests::record;

    const SIZE: (u32, u32) = (160, 120);

    /// A photograph of waves in several colours, moved by `by`.
    fn photograph(view: u32, by: f64) -> RgbImage {
        RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
            let (u, v) = (f64::from(x) + by, f64::from(y) + f64::from(view * 17));
            let wave = |phase: f64| (u / 9.0 + phase).sin() + (v / 13.0 + 2.0 * phase).cos();
            Rgb([0.0, 1.0, 2.5].map(|phase| (125.0 + 50.0 * wave(phase + u / 70.0)) as u8))
        })
    }

    type Change = dyn Fn(u32, u32, u32, [f64; 3]) -> [f64; 3];

    /// What is said of six predictions with some parallax and blur, whose colours (0..1) are changed by view and place.
    fn told(sources: &Change, change: &Change) -> Option<String> {
        let changed = |of: &RgbImage, view: u32, change: &Change| {
            RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
                let color = of.get_pixel(x, y).0.map(|level| f64::from(level) / 255.0);
                Rgb(change(view, x, y, color).map(|v| (255.0 * v).round() as u8))
            })
        };
        let records: Vec<Record> = (0..6)
            .map(|view| {
                let target = photograph(view, 0.0);
                let source = changed(&photograph(view, 12.0), view, sources);
                let predicted = fast_blur(&photograph(view, 2.0), 1.0);
                let shown = changed(&predicted, view, change);
                Record {
                    target: view.to_string(),
                    status: Status::Ok,
                    tone: tone([&source, &target, &shown], filled_colour(&target, &shown)),
                    ..record()
                }
            })
            .collect();
        of_dataset(&records, toned_pictures)
    }

    const AS_READ: &Change = &|_, _, _, color| color;

    /// Squared distance from the middle, 0..1 in the corners.
    fn off(x: u32, y: u32) -> f64 {
        let [x, y] = [f64::from(x) / 80.0 - 1.0, f64::from(y) / 60.0 - 1.0];
        (x * x + y * y) / 2.0
    }

    #[test]
    fn curves_of_all_pictures_are_told() {
        fn reinhard(v: f64) -> f64 {
            let light = linear_from_srgb(v as f32);
            f64::from(srgb_from_linear(light / (1.0 + light)))
        }
        fn exposed(v: f64) -> f64 {
            f64::from(srgb_from_linear(0.35 * linear_from_srgb(v as f32)))
        }
        // Narkowicz's approximation of ACES.
        fn aces(v: f64) -> f64 {
            let x = f64::from(linear_from_srgb(v as f32));
            let light = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
            f64::from(srgb_from_linear(light.min(1.0) as f32))
        }
        let cases: [(&str, f64, &Change); 11] = [
            ("blended with one colour", 0.75, &|_, _, _, color| {
                color.map(|v| 0.75 * v + 0.25 * 0.85)
            }),
            ("another range of levels", 1.2, &|_, _, _, color| {
                color.map(|v| 1.2 * v - 0.18)
            }),
            ("another exposure (-1.5", 0.35, &|_, _, _, color| {
                color.map(exposed)
            }),
            ("another exposure", 0.7, &|_, _, _, color| {
                color.map(|v| 0.7 * v)
            }),
            ("another exposure", 1.2, &|_, _, _, color| {
                color.map(|v| 1.2 * v)
            }),
            ("white balance", 0.75, &|_, _, _, [r, g, b]| {
                [1.15 * r, g, 0.75 * b]
            }),
            ("another gamma", 0.6, &|_, _, _, color| {
                color.map(|v| v.powf(0.6))
            }),
            ("another gamma", 1.5, &|_, _, _, color| {
                color.map(|v| v.powf(1.5))
            }),
            ("Reinhard", 1.0, &|_, _, _, color| color.map(reinhard)),
            ("filmic", 128.0, &|_, _, _, color| color.map(aces)),
            // The medians of the rings are at 0.76 and 0.06: (1 - 0.45 * 0.76) / (1 - 0.45 * 0.06) = 1 - 0.32.
            ("vignetting", 32.0, &|_, x, y, color| {
                color.map(|v| v * (1.0 - 0.45 * off(x, y)))
            }),
        ];
        for (cause, measured, change) in cases {
            let said = told(AS_READ, change).unwrap();
            assert!(said.contains(cause), "{cause}: {said:?}");
            let words = said.split(|c: char| c != '.' && !c.is_ascii_digit());
            let mut numbers =
                words.filter_map(|word| word.trim_end_matches('.').parse::<f64>().ok());
            assert!(
                numbers.any(|number| (number / measured - 1.0).abs() <= 0.1),
                "{cause} {measured}: {said:?}"
            );
        }
        let varied: &Change =
            &|view, _, _, color| color.map(|v| v * [0.7, 0.6, 0.8, 1.0, 1.0, 0.65][view as usize]);
        let said = told(varied, varied).unwrap();
        assert!(said.contains("in 4 of the 6"), "{said:?}");
        assert_eq!(told(varied, AS_READ), None);
        let darker: &Change = &|_, _, _, color| color.map(|v| 0.7 * v);
        assert!(
            told(AS_READ, darker)
                .unwrap()
                .contains("the sources do not have")
        );
        assert!(
            told(darker, darker)
                .unwrap()
                .contains("photographs differ in exposure")
        );
    }

    #[test]
    fn proper_and_poor_predictions_are_not() {
        let proper: [(&str, &Change); 10] = [
            ("proper", AS_READ),
            ("slightly dim", &|_, _, _, color| color.map(|v| 0.96 * v)),
            ("pale", &|_, _, _, color| {
                color.map(|v| 0.5 + 0.85 * (v - 0.5))
            }),
            ("paler", &|_, _, _, color| {
                color.map(|v| 0.4 + 0.7 * (v - 0.4))
            }),
            ("other exposures", &|view, _, _, color| {
                color.map(|v| v * [0.8, 1.2, 0.9, 1.1, 1.0, 0.85][view as usize])
            }),
            ("other tints", &|view, _, _, [r, g, b]| match view % 2 {
                0 => [0.85 * r, g, 1.1 * b],
                _ => [1.1 * r, g, 0.85 * b],
            }),
            ("holes at one side", &|_, x, _, color| {
                if x > 125 { [0.0; 3] } else { color }
            }),
            ("holes on all sides", &|_, x, y, color| {
                if off(x, y) > 0.5 { [0.0; 3] } else { color }
            }),
            ("background of one colour", &|_, _, y, color| {
                if y < 45 { [0.2, 0.3, 0.9] } else { color }
            }),
            ("unfinished side", &|_, x, _, color| {
                if x > 130 { [0.3; 3] } else { color }
            }),
        ];
        for (what, change) in proper {
            assert_eq!(told(AS_READ, change), None, "{what}");
        }
    }

    #[test]
    fn wider_colour_spaces_are_told() {
        fn of(color: [f64; 3]) -> [f64; 3] {
            color.map(|v| f64::from(linear_from_srgb(v as f32)))
        }
        // sRGB's primaries in the other space, by the specifications.
        let adobe: &Change = &|_, _, _, color| {
            let [r, g, b] = of(color);
            let light = [0.715 * r + 0.285 * g, g, 0.041 * g + 0.959 * b];
            light.map(|v| v.powf(256.0 / 563.0))
        };
        let p3: &Change = &|_, _, _, color| {
            let [r, g, b] = of(color);
            let light = [
                0.8225 * r + 0.1775 * g,
                0.0332 * r + 0.9668 * g,
                0.0171 * r + 0.0724 * g + 0.9105 * b,
            ];
            light.map(|v| f64::from(srgb_from_linear(v as f32)))
        };
        let grey: &Change = &|_, _, _, [r, g, b]| {
            let luma = 0.3 * r + 0.59 * g + 0.11 * b;
            [r, g, b].map(|v| luma + 0.8 * (v - luma))
        };
        let told = |change: &Change| {
            let of_view = |view: u32| {
                let target = photograph(view, 0.0);
                let moved = if view.is_multiple_of(2) { 0.3 } else { -0.3 };
                let predicted = fast_blur(&photograph(view, moved), 1.0);
                let shown = RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
                    let color = predicted.get_pixel(x, y).0.map(|v| f64::from(v) / 255.0);
                    Rgb(change(view, x, y, color).map(|v| (255.0 * v).round() as u8))
                });
                tone([&photograph(view, 12.0), &target, &shown], None).unwrap()
            };
            let tones: Vec<Tone> = (0..6).map(of_view).collect();
            wider_colours(&tones.iter().collect::<Vec<_>>(), "m").unwrap_or_default()
        };
        assert!(told(adobe).contains("in Adobe RGB"));
        assert!(told(p3).contains("in Display P3"));
        for proper in [AS_READ, grey] {
            assert_eq!(told(proper), "");
        }
    }

    #[test]
    fn masks_of_nearly_all_pictures_are_told() {
        let filled = std::cell::Cell::new(None);
        let told = |shares: [u8; 5]| {
            let of = |masked| Record {
                status: Status::Ok,
                masked: Some(masked),
                filled: filled.get(),
                ..record()
            };
            of_dataset(&shares.map(of), masked_pictures)
        };
        assert!(
            told([30, 40, 35, 25, 20])
                .unwrap()
                .contains("a median of 30 %")
        );
        assert!(told([30, 40, 35, 25, 0]).unwrap().contains("4 of the 5"));
        for (colour, part) in [
            (None, "are black or white in places"),
            (Some([255; 3]), "are white in places"),
            (
                Some([49, 77, 121]),
                "have the colour (49, 77, 121) in places",
            ),
        ] {
            filled.set(colour);
            let said = told([30, 40, 35, 25, 20]).unwrap();
            assert!(said.contains(part) && said.contains("30 %"), "{said}");
        }
        for proper in [[0; 5], [4; 5], [60, 50, 4, 0, 3]] {
            assert_eq!(told(proper), None);
        }
    }
}
