//! Detects pictures that are stored differently from how they are read, such as mirrored ones, by comparing them with
//! the target's photograph.
//!
//! Poor predictions must not raise false alarms, so a change is reported only if undoing it brings nearly all pictures
//! of a dataset significantly closer to their photographs. Shifts are not tried here: if a method ignores parallax, all
//! its pictures of a stereo dataset are shifted alike. Scores do not depend on this check.

use std::collections::HashSet;
use std::iter::zip;

use image::imageops::{flip_horizontal, flip_vertical, rotate90, rotate180, rotate270, thumbnail};
use image::{GenericImageView, Rgb, RgbImage};
use sharp::color::{Quantization, linear_from_srgb, quantize, srgb_from_linear};

use super::filled::{filled_colour, without};
use super::finding::PictureChange;
use super::layout::layout_change;
use super::levels::{
    from_hsv, from_lab, from_luma, has_equal_channels, is_grey, is_limited, is_noise,
    is_normalised_and_stretched, is_uniform, is_unscaled, is_wrapped, normalised, stretching,
    to_luma,
};
use super::placement::placement_change;
use super::rearranged::rearranged;
use crate::evaluate::gaussians::likeness::Likeness;
use crate::evaluate::record::Record;
use crate::scoring::Region;

/// A photograph's background counts as white (or black) if at least this share of its pixels is white (or black).
const MIN_BACKGROUND: f64 = 0.15;
/// A picture has another background if at least this share of the background's pixels has the opposite colour.
const MIN_OTHER: f64 = 0.7;
/// Maximum width compared, in pixels.
const WIDTH: u32 = 160;
/// A mirroring, rotation or rearrangement is reported only if undoing it gains at least this, in dB.
pub(super) const MIN_GAIN: f64 = 1.0;
/// Like [`MIN_GAIN`], but for swapped channels, which hardly change brightness, in dB.
const MIN_GAIN_OF_CHANNELS: f64 = 0.25;
/// Like [`MIN_GAIN`], but for another transfer function, in dB. If linear light was stored as sRGB, undoing it gains
/// far more; undoing a wrong exposure gains less.
const MIN_GAIN_OF_TRANSFER: f64 = 3.0;
/// Another transfer function is reported even if changes of brightness and contrast fit about as well, provided that
/// undoing it brings the sorted levels closer by at least this, in dB. Poor predictions gain less, because their levels
/// are not those of the photograph.
const MIN_GAIN_BY_RANK: f64 = 8.0;
/// Like [`MIN_GAIN`], but for another range of levels, in dB. It is higher, because other exposures resemble other
/// ranges.
const MIN_GAIN_OF_RANGE: f64 = 1.5;
/// Other colour spaces and rearrangements are tried only on pictures with a PSNR below this, in dB. The limit saves
/// time. Pictures stored in another colour space have 8 to 13 dB, rearranged ones 13 to 17.
pub(super) const MAX_OF_SPACES: f64 = 20.0;
/// Share of the levels ignored at each end of the range, because JPEG and resampling cause ringing there.
const BEYOND_ENDS: f64 = 0.002;
/// A picture whose correlation with the photograph is below this is a negative. If the correlation of red minus blue is
/// below this, red and blue are swapped. Poor predictions have 0.4 to 0.8, and a tint does not matter.
const MAX_OPPOSED_CORRELATION: f64 = -0.4;
/// Like [`MAX_OPPOSED_CORRELATION`], but for the differences between channels if all three channels are moved. This
/// turns hues by a third of the circle, whose cosine is −0.5, so the correlation is half as strong as after a swap.
const MAX_TURNED_CORRELATION: f64 = MAX_OPPOSED_CORRELATION / 2.0;
/// A change is reported only if, once it is undone, the picture explains at least this share of the photograph's
/// variance. Poor predictions reach a quarter.
pub(super) const MIN_EXPLAINED: f64 = 0.2;
/// A picture has little in common with a photograph if their correlation is below this.
pub(super) const UNLIKE: f64 = 0.15;

/// Orders of stored channels: for each, which stored channel is red, which green, and which blue.
const PERMUTATIONS: [(PictureChange, [usize; 3]); 5] = [
    (PictureChange::Bgr, [2, 1, 0]),
    (PictureChange::Grb, [1, 0, 2]),
    (PictureChange::Rbg, [0, 2, 1]),
    (PictureChange::Gbr, [2, 0, 1]),
    (PictureChange::Brg, [1, 2, 0]),
];

/// Number of colours of a palette.
const PALETTE: usize = 256;
/// A picture with fewer colours than this is nearly uniform rather than stored with a palette.
const FEWEST_OF_PALETTE: usize = 16;
/// A picture with a palette cannot show a photograph well that has more colours than this.
const MIN_COLOURS: usize = 16 * PALETTE;

/// A colour space, its conversion to RGB, and the stored position of each of its channels. Positions are reversed if
/// OpenCV wrote the channels as BGR.
type OtherSpace = (PictureChange, fn([u8; 3]) -> [u8; 3], [usize; 3]);
const OTHER_SPACES: [OtherSpace; 9] = [
    (PictureChange::Luma, from_luma, [0, 1, 2]),
    (PictureChange::Luma, from_luma, [0, 2, 1]),
    (PictureChange::Luma, from_luma, [2, 0, 1]),
    (PictureChange::Hsv, |hsv| from_hsv(hsv, 256.0), [0, 1, 2]),
    (PictureChange::Hsv, |hsv| from_hsv(hsv, 256.0), [2, 1, 0]),
    (PictureChange::Hsv, |hsv| from_hsv(hsv, 180.0), [0, 1, 2]),
    (PictureChange::Hsv, |hsv| from_hsv(hsv, 180.0), [2, 1, 0]),
    (PictureChange::Lab, from_lab, [0, 1, 2]),
    (PictureChange::Lab, from_lab, [2, 1, 0]),
];

/// Whether methods of this kind read pictures stored by other programs.
pub(crate) fn is_checked(kind: &str) -> bool {
    ["imported", "command"].contains(&kind)
}

/// Sets [`Record::change`] if the picture equals the part of the photograph that it covers, is a copy of the source's
/// photograph, has been altered in a way that [`likely_change`] knows, or resembles neither photograph. `source` reads the
/// source's photograph and shrinks it.
pub(crate) fn note_change(
    record: &mut Record,
    photograph: &RgbImage,
    picture: &RgbImage,
    source: impl FnOnce() -> Option<RgbImage>,
) {
    let part = record.crop.map(|crop| crop.region);
    let part = part.unwrap_or(Region::whole(photograph.dimensions()));
    let part = photograph.view(part.x, part.y, part.width, part.height);
    let part = part.to_image();
    record.change = if part == *picture {
        Some(PictureChange::Photograph)
    } else {
        let source = source();
        if source.as_ref() == Some(&shrunk(picture)) {
            Some(PictureChange::CopiedSource)
        } else {
            likely_change(&part, picture).or_else(|| {
                // The picture also counts as related if it resembles the source: the method may have ignored a large
                // motion.
                let is_other =
                    is_unlike(&shrunk(&part), picture) && is_unlike(source.as_ref()?, picture);
                is_other.then_some(PictureChange::Unlike)
            })
        }
    };
}

/// How a stored picture was probably altered; `None` unless the picture shows traces of a change, or undoing a change
/// brings it significantly closer to its photograph.
pub(crate) fn likely_change(photograph: &RgbImage, picture: &RgbImage) -> Option<PictureChange> {
    let layout = layout_change(photograph, picture);
    if layout.is_some() {
        return layout;
    }
    let seen = shrunk(photograph);
    let shown = thumbnail(picture, seen.width(), seen.height());
    if is_unscaled(&seen, picture) {
        return Some(PictureChange::Unscaled);
    }
    if is_grey(&seen, picture) {
        return Some(PictureChange::Grey);
    }
    if has_equal_channels(&seen, picture) {
        return Some(PictureChange::EqualChannels);
    }
    if has_palette(photograph, picture) {
        return Some(PictureChange::Palette);
    }
    if is_noise(photograph, picture) {
        return Some(PictureChange::Noise);
    }
    let filled = filled_colour(photograph, picture);
    let rest = |pictures: [&RgbImage; 2]| filled.and_then(|colour| without(colour, pictures));
    let [small, large] = [[&seen, &shown], [photograph, picture]].map(rest);
    // The pixels whose levels are compared.
    let levels = (small.as_ref(), large.as_ref());
    let ([small_seen, small_shown], [large_seen, large_shown]) = match levels {
        (Some(small), Some(large)) => (small.each_ref(), large.each_ref()),
        _ => ([&seen, &shown], [photograph, picture]),
    };
    if is_normalised(small_seen, small_shown) {
        return Some(PictureChange::Normalised);
    }
    if has_other_background(&seen, &shown) {
        return Some(PictureChange::OtherBackground);
    }
    let rearranged = rearranged(photograph, picture);
    let undone = if small_shown.dimensions() == shown.dimensions() {
        undone_change(&seen, &shown, ends(picture), rearranged)
    } else {
        // The remaining pixels show their levels, but not where they were.
        let of_levels = undone_change(small_seen, small_shown, ends(large_shown), None);
        let moved = undone_change(&seen, &shown, ends(picture), rearranged);
        of_levels
            .filter(|change| change.is_of_levels())
            .or(moved.filter(|change| !change.is_of_levels()))
    };
    let wrapped = || is_wrapped(large_seen, large_shown).then_some(PictureChange::Wrapped);
    let stretched = || {
        let gain = stretching(large_seen, small_seen, small_shown, large_shown);
        gain.map(PictureChange::Stretched)
    };
    let placed = || placement_change(&seen, &shown);
    let normalised = || {
        let whole = Region::whole(small_seen.dimensions());
        let fit = Likeness::of(small_seen, whole, small_shown);
        let is_it = fit.explained() >= MIN_EXPLAINED
            && is_normalised_and_stretched(small_seen, small_shown);
        is_it.then_some(PictureChange::NormalisedAndStretched)
    };
    let found = undone.or_else(wrapped).or_else(placed).or_else(stretched);
    found.or_else(normalised)
}

/// Whether the photograph's background is white and the picture's black, or the other way round, while the rest of the
/// picture is no negative.
fn has_other_background(seen: &RgbImage, shown: &RgbImage) -> bool {
    let is_white = |pixel: &Rgb<u8>| pixel.0.iter().all(|level| *level >= 250);
    let is_black = |pixel: &Rgb<u8>| pixel.0.iter().all(|level| *level <= 5);
    let others = |seen_is: &dyn Fn(&Rgb<u8>) -> bool, shown_is: &dyn Fn(&Rgb<u8>) -> bool| {
        let behind = zip(seen.pixels(), shown.pixels()).filter(|(seen, _)| seen_is(seen));
        let (mut count, mut other) = (0, 0);
        for (_, shown) in behind {
            count += 1;
            other += usize::from(shown_is(shown));
        }
        let is_background = count as f64 >= MIN_BACKGROUND * seen.pixels().len() as f64;
        (is_background && other as f64 >= MIN_OTHER * count as f64).then(|| {
            let error = |of: &dyn Fn(u8) -> u8| -> u64 {
                let rest = zip(seen.pixels(), shown.pixels());
                let rest = rest.filter(|(seen, shown)| !seen_is(seen) && !shown_is(shown));
                let levels = rest.flat_map(|(seen, shown)| zip(seen.0, shown.0));
                levels
                    .map(|(a, b)| u64::from(a.abs_diff(of(b))).pow(2))
                    .sum()
            };
            error(&|level| level) < error(&|level| 255 - level)
        })
    };
    let found = others(&is_white, &is_black).or_else(|| others(&is_black, &is_white));
    found.unwrap_or(false)
}

/// Whether normalising the photograph by ImageNet's mean and standard deviation brings it significantly closer to the
/// picture than any change of brightness and contrast. CLIP's values are too similar to need their own test.
fn is_normalised(seen: &RgbImage, shown: &RgbImage) -> bool {
    let fit = |seen: &RgbImage| Likeness::of(shown, Region::whole(shown.dimensions()), seen);
    let (as_read, normalised) = (fit(seen), fit(&mapped(seen, normalised)));
    normalised.is_nearer_than(&as_read) && normalised.is_nearer_than_exposed(&as_read)
}

/// The change whose undoing brings the shrunk picture `shown` closest to its photograph `seen`; `None` if none brings
/// it significantly closer. `ends` are the [`ends()`] of the picture at full size; `rearranged` is its
/// [rearrangement](rearranged()).
fn undone_change(
    seen: &RgbImage,
    shown: &RgbImage,
    ends: [u8; 2],
    rearranged: Option<(PictureChange, RgbImage)>,
) -> Option<PictureChange> {
    let whole = Region::whole(seen.dimensions());
    let fit = |shown: &RgbImage| Likeness::of(seen, whole, shown);
    let as_read = fit(shown);
    let nearer = |changed: &RgbImage, gain: f64| {
        let fit = fit(changed);
        (fit.explained() >= MIN_EXPLAINED && fit.gain_over(&as_read) >= gain).then_some(fit)
    };
    let moved =
        |changed: &RgbImage| nearer(changed, MIN_GAIN).filter(|fit| fit.is_closer_than(&as_read));
    let is_far = as_read.psnr() < MAX_OF_SPACES;
    // Pictures that are not square were probably stretched to the target's size.
    let turned = |by: fn(&RgbImage) -> RgbImage| {
        let turned = || moved(&thumbnail(&by(shown), seen.width(), seen.height()));
        (is_far || seen.width() == seen.height())
            .then(turned)
            .flatten()
    };
    let encoded = |transfer: fn(f32) -> f32| {
        let level = |v: u8| quantize(transfer(f32::from(v) / 255.0), Quantization::Round);
        let changed = mapped(shown, |color| color.map(level));
        // Compare sorted levels, which do not depend on position. Allow for brightness and contrast, because a mere
        // change of exposure is not a transfer function.
        let by_rank = |of: &RgbImage| Likeness::of(&ranked(seen), whole, &ranked(of));
        let fit = nearer(&changed, MIN_GAIN_OF_TRANSFER);
        fit.filter(|_| {
            let (before, after) = (by_rank(shown), by_rank(&changed));
            let is_far_nearer = after.gain_over(&before) >= MIN_GAIN_BY_RANK;
            after.is_nearer_than_exposed(&before) || is_far_nearer && after.is_closer_than(&before)
        })
    };
    // Ignore black, which may be a hole or clipped and is therefore no evidence of a range.
    let lit = |of: &dyn Fn(u8) -> u8| {
        let mut lit = shown.clone();
        for (own, seen) in lit.iter_mut().zip(seen.iter()) {
            *own = if *own == 0 { *seen } else { of(*own) };
        }
        fit(&lit)
    };
    let ranged = |undo: fn(f32) -> f32, is_bound: bool| {
        // The conversion to u8 saturates outside 0..255.
        let (before, after) = (lit(&|v| v), lit(&|v| undo(f32::from(v)).round() as u8));
        let is_right = after.explained() >= MIN_EXPLAINED
            && after.gain_over(&before) >= MIN_GAIN_OF_RANGE
            && after.is_nearer_than(&before)
            && (is_bound || after.is_as_near_as_exposed(&before));
        is_right.then_some(after)
    };
    let is_upper_half = shown.iter().all(|level| *level >= 127);
    let is_low_quarter = ends[1] <= 64;
    let full = mapped(shown, |color| {
        color.map(|v| ((f32::from(v) - 16.0) * 255.0 / 219.0).round() as u8)
    });
    let full = is_limited(seen, shown, ends).then(|| fit(&full));
    let spaces = OTHER_SPACES.into_iter().filter(|_| is_far);
    let other_spaces = spaces.map(|(change, to_rgb, order)| {
        let rgb = mapped(shown, |color| to_rgb(order.map(|channel| color[channel])));
        let fit = nearer(&rgb, MIN_GAIN_OF_TRANSFER);
        (
            change,
            fit.filter(|fit| fit.is_nearer_than_exposed(&as_read)),
        )
    });
    // Before a reordering is undone, the differences between the channels are opposed to those of the photograph;
    // afterwards, they are alike.
    let recoloured = |undone: &RgbImage, order: [usize; 3]| {
        let tint = |of: &RgbImage| {
            let difference = |color: [u8; 3], c: usize| 128 - color[order[c]] / 2 + color[c] / 2;
            mapped(of, |color| [0, 1, 2].map(|c| difference(color, c)))
        };
        let tints = |of: &RgbImage| Likeness::of(&tint(seen), whole, &tint(of)).correlation();
        let is_swap = (0..3).any(|channel| order[channel] == channel);
        let most = if is_swap {
            MAX_OPPOSED_CORRELATION
        } else {
            MAX_TURNED_CORRELATION
        };
        let fit = nearer(undone, MIN_GAIN_OF_CHANNELS);
        fit.filter(|_| tints(shown) < most && tints(undone) > -MAX_OPPOSED_CORRELATION)
    };
    let swapped = PERMUTATIONS.map(|(change, order)| {
        let permuted = mapped(shown, |color| order.map(|channel| color[channel]));
        (change, recoloured(&permuted, order))
    });
    let other_chroma = mapped(shown, |color| {
        let [y, cb, cr] = to_luma(color);
        from_luma([y, cr, cb])
    });
    // Cb is mostly blue and Cr mostly red.
    let other_chroma = recoloured(&other_chroma, [2, 1, 0]);
    let negative = nearer(&inverted(shown), MIN_GAIN);
    let negative = negative.filter(|_| as_read.correlation() < MAX_OPPOSED_CORRELATION);
    let all = [
        (PictureChange::Negative, negative),
        (PictureChange::Linear, encoded(srgb_from_linear)),
        (PictureChange::EncodedTwice, encoded(linear_from_srgb)),
        (
            PictureChange::HalfContrast,
            ranged(|v| 2.0 * v - 255.0, is_upper_half),
        ),
        (PictureChange::Quarter, ranged(|v| 4.0 * v, is_low_quarter)),
        (
            PictureChange::DarkHalfCutOff,
            ranged(|v| (v + 255.0) / 2.0, false),
        ),
        (PictureChange::LimitedRange, full),
        (PictureChange::SwappedChroma, other_chroma),
        (PictureChange::Mirrored, moved(&flip_horizontal(shown))),
        (PictureChange::UpsideDown, moved(&flip_vertical(shown))),
        (PictureChange::Turned180, moved(&rotate180(shown))),
        (PictureChange::Turned90, turned(rotate270)),
        (PictureChange::Turned270, turned(rotate90)),
        (
            PictureChange::Transposed,
            turned(|p| rotate90(&flip_vertical(p))),
        ),
    ];
    let rearranged = rearranged.map(|(change, undone)| (change, Some(fit(&undone))));
    let likely = all
        .into_iter()
        .chain(rearranged)
        .chain(swapped)
        .chain(other_spaces)
        .filter_map(|(change, fit)| Some((change, fit?.error())));
    let best = likely.min_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|(change, _)| change)
}

/// A picture reduced to the size at which pictures are compared.
pub(crate) fn shrunk(picture: &RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    let to = width.min(WIDTH);
    thumbnail(picture, to, (height * to / width).max(1))
}

/// Whether a picture has so few colours that it was stored with a palette, unlike its photograph.
fn has_palette(photograph: &RgbImage, picture: &RgbImage) -> bool {
    let colours = |of: &RgbImage, most: usize| {
        let mut seen = HashSet::new();
        let mut pixels = of.pixels();
        pixels.find(|pixel| seen.insert(pixel.0) && seen.len() > most);
        seen.len()
    };
    let own = colours(picture, PALETTE);
    (FEWEST_OF_PALETTE..=PALETTE).contains(&own) && colours(photograph, MIN_COLOURS) > MIN_COLOURS
}

/// True if a picture has little in common with a [`shrunk`] photograph, apart from a part that is filled with one colour.
/// False for uniform pictures.
pub(crate) fn is_unlike(small: &RgbImage, picture: &RgbImage) -> bool {
    let shown = thumbnail(picture, small.width(), small.height());
    let filled = filled_colour(small, &shown);
    let rest = filled.and_then(|colour| without(colour, [small, &shown]));
    let [small, rest] = rest
        .as_ref()
        .map_or([small, &shown], |rest| rest.each_ref());
    let fit = Likeness::of(small, Region::whole(small.dimensions()), rest);
    !is_uniform(&shown) && fit.correlation() < UNLIKE
}

/// The darkest and the brightest level, ignoring [`BEYOND_ENDS`] of the levels at each end.
fn ends(picture: &RgbImage) -> [u8; 2] {
    let mut counts = [0_usize; 256];
    picture
        .iter()
        .for_each(|level| counts[usize::from(*level)] += 1);
    let beyond = (BEYOND_ENDS * picture.len() as f64) as usize;
    let end = |level: &dyn Fn(u8) -> u8| {
        let mut seen = 0;
        (0..255).map(level).find(|level| {
            seen += counts[usize::from(*level)];
            seen > beyond
        })
    };
    [end(&|k| k).unwrap_or(255), end(&|k| 255 - k).unwrap_or(0)]
}

fn mapped(picture: &RgbImage, of: impl Fn([u8; 3]) -> [u8; 3]) -> RgbImage {
    let mut changed = picture.clone();
    changed
        .pixels_mut()
        .for_each(|pixel| *pixel = Rgb(of(pixel.0)));
    changed
}

fn inverted(picture: &RgbImage) -> RgbImage {
    mapped(picture, |color| color.map(|level| 255 - level))
}

/// Sorts the levels of each channel in ascending order.
fn ranked(picture: &RgbImage) -> RgbImage {
    let mut ranked = picture.clone();
    for channel in 0..3 {
        let mut levels: Vec<u8> = picture.pixels().map(|pixel| pixel.0[channel]).collect();
        levels.sort_unstable();
        let sorted = ranked.pixels_mut().zip(levels);
        sorted.for_each(|(pixel, level)| pixel.0[channel] = level);
    }
    ranked
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coloured blobs, shifted by `by`, with `noise` added.
    fn picture(by: f64, noise: u32) -> RgbImage {
        RgbImage::from_fn(96, 96, |x, y| {
            let (u, v) = ((f64::from(x) + by) / 9.0, f64::from(y) / 13.0);
            let hash = (f64::from((x * 7919 + y * 104_729) % 31) - 15.0) * f64::from(noise);
            let wave =
                |phase: f64| 120.0 + 60.0 * (u + phase).sin() + 50.0 * (v + 0.3 * u + phase).cos();
            let level = |phase: f64| (wave(phase) + hash).clamp(0.0, 255.0) as u8;
            Rgb([level(0.0), level(0.9), level(2.4)])
        })
    }

    fn told(shown: &RgbImage) -> Option<PictureChange> {
        likely_change(&picture(0.0, 0), shown)
    }

    fn swapped(picture: &RgbImage) -> RgbImage {
        mapped(picture, |[r, g, b]| [b, g, r])
    }

    fn recolored(picture: &RgbImage, transfer: fn(f32) -> f32) -> RgbImage {
        let level = |v: u8| quantize(transfer(f32::from(v) / 255.0), Quantization::Round);
        mapped(picture, |color| color.map(level))
    }

    fn levels(picture: &RgbImage, of: fn(f32) -> f32) -> RgbImage {
        mapped(picture, |c| c.map(|v| of(f32::from(v)).round() as u8))
    }

    #[test]
    fn what_was_done_to_a_picture_is_told() {
        // A prediction with some noise and parallax.
        let proper = picture(1.0, 1);
        let transposed = |p: &RgbImage| rotate270(&flip_horizontal(p));
        for (name, done) in [
            (PictureChange::Bgr, swapped as fn(&RgbImage) -> RgbImage),
            (PictureChange::Grb, |p| mapped(p, |[r, g, b]| [g, r, b])),
            (PictureChange::Rbg, |p| mapped(p, |[r, g, b]| [r, b, g])),
            (PictureChange::Gbr, |p| mapped(p, |[r, g, b]| [g, b, r])),
            (PictureChange::Brg, |p| mapped(p, |[r, g, b]| [b, r, g])),
            (PictureChange::SwappedChroma, |p| {
                mapped(p, |color| {
                    let [y, cb, cr] = to_luma(color);
                    from_luma([y, cr, cb])
                })
            }),
            (PictureChange::Linear, |p| recolored(p, linear_from_srgb)),
            (PictureChange::EncodedTwice, |p| {
                recolored(p, srgb_from_linear)
            }),
            (PictureChange::HalfContrast, |p| {
                levels(p, |v| (v + 255.0) / 2.0)
            }),
            (PictureChange::DarkHalfCutOff, |p| {
                levels(p, |v| 2.0 * v - 255.0)
            }),
            (PictureChange::Quarter, |p| levels(p, |v| v / 4.0)),
            (PictureChange::Palette, |p| {
                mapped(p, |color| color.map(|v| v / 64 * 64 + 32))
            }),
            (PictureChange::Negative, inverted),
            (PictureChange::Mirrored, flip_horizontal),
            (PictureChange::UpsideDown, flip_vertical),
            (PictureChange::Turned180, rotate180),
            (PictureChange::Turned90, rotate90),
            (PictureChange::Turned270, rotate270),
            (PictureChange::Transposed, transposed),
            (PictureChange::Luma, |p| mapped(p, to_luma)),
            (PictureChange::Luma, |p| {
                mapped(p, |color| [0, 2, 1].map(|c| to_luma(color)[c]))
            }),
            (PictureChange::Hsv, |p| mapped(p, to_hsv)),
            (PictureChange::Hsv, |p| {
                mapped(p, |color| {
                    let [h, s, v] = to_hsv(color);
                    [v, s, (f64::from(h) * 180.0 / 256.0) as u8]
                })
            }),
            (PictureChange::Normalised, |p| mapped(p, normalised)),
            (PictureChange::Unscaled, |p| levels(p, |v| v / 255.0)),
            (PictureChange::Grey, grey),
            (PictureChange::EqualChannels, |p| {
                mapped(p, |[r, g, _]| [r, g, g])
            }),
            (PictureChange::Noise, |p| {
                RgbImage::from_fn(p.width(), p.height(), |x, y| {
                    let hash = (x * 7919 + y * 104_729).wrapping_mul(2_654_435_761);
                    let hash = (hash ^ (hash >> 15)).wrapping_mul(2_246_822_519);
                    Rgb([8, 16, 24].map(|by| (hash >> by) as u8))
                })
            }),
        ] {
            assert_eq!(told(&done(&proper)), Some(name));
        }
    }

    #[test]
    fn copies_of_the_source_and_unrelated_pictures_are_noted() {
        let (target, source) = (picture(14.0, 0), picture(0.0, 0));
        let noted = |shown: &RgbImage| {
            let mut record = crate::evaluate::record::tests::record();
            note_change(&mut record, &target, shown, || Some(shrunk(&source)));
            record.change
        };
        assert_eq!(noted(&target), Some(PictureChange::Photograph));
        assert_eq!(noted(&source), Some(PictureChange::CopiedSource));
        // Depths as colours. Their red happens to resemble the source's.
        let map = RgbImage::from_fn(96, 96, |x, y| {
            let depth = f64::from(x + 96 - y) / 192.0;
            let [b, g, r] = [1.0, 2.0, 3.0].map(|at| 1.5 - (4.0 * depth - at).abs());
            let [r, g, b] = [r, g, b].map(|v| (255.0 * v.clamp(0.0, 1.0)) as u8);
            Rgb([r / 2 + source.get_pixel(x, y).0[0] / 2, g, b])
        });
        assert_eq!(noted(&map), Some(PictureChange::Unlike));
        // Predictions that nearly equal the source, have no content or did not move.
        for proper in [
            mapped(&source, |[r, g, b]| [r.saturating_add(1), g, b]),
            picture(0.0, 1),
            picture(1.0, 0),
            image::imageops::fast_blur(&source, 5.0),
            RgbImage::from_pixel(96, 96, Rgb([90; 3])),
        ] {
            assert_eq!(noted(&proper), None);
        }
    }

    #[test]
    fn another_background_is_no_negative() {
        let on = |background: u8, of: &RgbImage| {
            RgbImage::from_fn(of.width(), of.height(), |x, y| {
                if 3 * x < of.width() || 5 * y < of.height() {
                    Rgb([background; 3])
                } else {
                    *of.get_pixel(x, y)
                }
            })
        };
        let (truth, proper) = (picture(0.0, 0), picture(1.0, 1));
        for [seen, shown] in [[255, 0], [0, 255]] {
            let found = likely_change(&on(seen, &truth), &on(shown, &proper));
            assert_eq!(found, Some(PictureChange::OtherBackground));
            let negative = inverted(&on(seen, &proper));
            let found = likely_change(&on(seen, &truth), &negative);
            assert_eq!(found, Some(PictureChange::Negative));
            assert_eq!(likely_change(&on(seen, &truth), &on(seen, &proper)), None);
        }
    }

    fn grey(picture: &RgbImage) -> RgbImage {
        mapped(picture, |[_, g, _]| [g; 3])
    }

    fn to_hsv(color: [u8; 3]) -> [u8; 3] {
        let [r, g, b] = color.map(f64::from);
        let (most, range) = (r.max(g).max(b), r.max(g).max(b) - r.min(g).min(b));
        let hue = match range {
            0.0 => 0.0,
            _ if most == r => ((g - b) / range).rem_euclid(6.0),
            _ if most == g => (b - r) / range + 2.0,
            _ => (r - g) / range + 4.0,
        };
        [hue * 256.0 / 6.0, 255.0 * range / most.max(1.0), most].map(|v| v as u8)
    }

    #[test]
    fn colour_spaces_are_undone() {
        for color in [[200, 30, 90], [10, 240, 60], [120, 120, 120], [5, 80, 250]] {
            let back = from_hsv(to_hsv(color), 256.0);
            assert!(
                color.iter().zip(back).all(|(a, b)| a.abs_diff(b) <= 8),
                "{color:?} {back:?}"
            );
        }
        // OpenCV's values of these colours.
        for (lab, color) in [
            ([136, 208, 195], [255, 0, 0]),
            ([224, 42, 211], [0, 255, 0]),
            ([137, 128, 128], [128; 3]),
        ] {
            let back = from_lab(lab);
            assert!(
                back.iter()
                    .zip(color)
                    .all(|(a, b): (&u8, u8)| a.abs_diff(b) <= 8),
                "{back:?}"
            );
        }
    }

    #[test]
    fn normalised_and_stretched_levels_are_told() {
        // The photograph is neither red nor blue on average.
        let stretched = |p: &RgbImage, statistics: [(f64, f64); 3]| {
            mapped(p, |color| {
                std::array::from_fn(|c| {
                    let (mean, deviation) = statistics[c];
                    let value = (f64::from(color[c]) / 255.0 - mean) / deviation;
                    (255.0 * (value + 2.118) / 4.758).round() as u8
                })
            })
        };
        let proper = picture(1.0, 1);
        let imagenet = [(0.485, 0.229), (0.456, 0.224), (0.406, 0.225)];
        let told_of = told(&stretched(&proper, imagenet));
        assert_eq!(told_of, Some(PictureChange::NormalisedAndStretched));
        // With equal statistics for all channels, it is only another exposure.
        assert_eq!(told(&stretched(&proper, [(0.45, 0.226); 3])), None);
    }

    #[test]
    fn levels_that_wrapped_around_are_told() {
        // A photograph with highlights, and a prediction whose noise exceeds white there.
        let wave = |x: u32, y: u32| {
            140.0 + 114.0 * (f64::from(x) / 9.0).sin() * (f64::from(y) / 13.0).cos()
        };
        let seen = RgbImage::from_fn(96, 96, |x, y| {
            Rgb([0.0, 1.0, -2.0].map(|tint| (wave(x, y) + tint) as u8))
        });
        let noisy = |to_level: fn(i32) -> u8| {
            RgbImage::from_fn(96, 96, |x, y| {
                let noise = |c: u32| f64::from((x * 7919 + y * 104_729 + c * 31) % 19) - 9.0;
                Rgb([0, 1, 2].map(|c| to_level((wave(x, y) + noise(c)) as i32)))
            })
        };
        assert_eq!(
            likely_change(&seen, &noisy(|v| v as u8)),
            Some(PictureChange::Wrapped)
        );
        let limited = noisy(|v| v.clamp(0, 255) as u8);
        assert_eq!(likely_change(&seen, &limited), None);
    }

    #[test]
    fn the_limited_range_of_video_is_told() {
        let contrast = |p: &RgbImage| levels(p, |v| (1.5 * (v - 120.0) + 128.0).clamp(0.0, 255.0));
        let photograph = contrast(&picture(0.0, 0));
        let told = |shown: &RgbImage| likely_change(&photograph, shown);
        let proper = contrast(&picture(1.0, 1));
        let blurred = image::imageops::fast_blur(&proper, 3.0);
        assert_eq!(
            told(&levels(&proper, |v| 16.0 + v * 219.0 / 255.0)),
            Some(PictureChange::LimitedRange)
        );
        for poor in [proper.clone(), levels(&proper, |v| 30.0 + 0.8 * v), blurred] {
            assert_eq!(told(&poor), None);
        }
    }

    #[test]
    fn proper_and_poor_predictions_are_not_accused() {
        let faint = |p: &RgbImage| mapped(p, |[r, g, b]| [g - g / 9 + r / 9, g, g - g / 9 + b / 9]);
        let dim = |p: &RgbImage, by: f64| mapped(p, |c| c.map(|v| (f64::from(v) * by) as u8));
        let tinted = mapped(&picture(0.0, 1), |[r, g, b]| {
            [r.saturating_add(40), g, b.saturating_sub(40)]
        });
        for (what, poor) in [
            ("itself", picture(0.0, 0)),
            ("parallax", picture(6.0, 0)),
            ("much parallax", picture(20.0, 0)),
            ("noise", picture(0.0, 4)),
            ("faint colours", faint(&picture(0.0, 1))),
            (
                "one colour",
                RgbImage::from_pixel(96, 96, Rgb([120, 90, 60])),
            ),
            ("dim", dim(&picture(1.0, 1), 0.4)),
            ("pale", levels(&picture(1.0, 1), |v| 30.0 + 0.75 * v)),
            ("bright", levels(&picture(1.0, 1), |v| 0.8 * v + 51.0)),
            ("tinted", tinted),
            ("black", RgbImage::new(96, 96)),
            ("blurred", image::imageops::fast_blur(&picture(2.0, 0), 6.0)),
        ] {
            assert_eq!(told(&poor), None, "{what}");
        }
        // A grey photograph gives no evidence on channels or colours.
        let seen = grey(&picture(0.0, 0));
        assert_eq!(likely_change(&seen, &grey(&picture(1.0, 1))), None);
        assert_eq!(likely_change(&seen, &tint_of(&seen)), None);
    }

    fn tint_of(picture: &RgbImage) -> RgbImage {
        mapped(picture, |[r, g, b]| [r.saturating_add(9), g, b])
    }

    #[test]
    fn levels_stretched_to_the_whole_range_are_told() {
        // The photograph has no black and no white.
        let photograph = levels(&picture(0.0, 0), |v| 60.0 + 0.5 * v);
        let mut proper = levels(&picture(1.0, 0), |v| 60.0 + 0.5 * v);
        proper.put_pixel(3, 3, Rgb([60; 3]));
        proper.put_pixel(9, 3, Rgb([180; 3]));
        let gain = 255.0 / 120.0;
        let [lowest, highest] =
            [proper.iter().min(), proper.iter().max()].map(|v| f32::from(*v.unwrap()));
        let normalised = mapped(&proper, |c| {
            c.map(|v| (255.0 * (f32::from(v) - lowest) / (highest - lowest)).round() as u8)
        });
        let told = |shown: &RgbImage| likely_change(&photograph, shown);
        let found = told(&normalised);
        assert!(
            matches!(found, Some(PictureChange::Stretched(percent)) if (f64::from(percent) - 100.0 * gain).abs() < 30.0),
            "{found:?}"
        );
        // A few pixels at both ends, and contrast that saturates.
        proper.put_pixel(3, 3, Rgb([0; 3]));
        proper.put_pixel(9, 3, Rgb([255; 3]));
        let hard = levels(&proper, |v| (3.0 * (v - 120.0) + 128.0).clamp(0.0, 255.0));
        for silent in [proper, hard] {
            assert_eq!(told(&silent), None);
        }
    }
}
