//! 256 colours for a picture of many.
//!
//! By hand: `gif`'s own NeuQuant samples the picture and loses rare colours; `quantette`, which does not, brings a dozen
//! crates.

use image::RgbImage;
use rayon::prelude::*;

/// Bits of a channel that the statistics tell apart: colours that agree in them share an entry of the palette.
const BITS: u32 = 6;
/// Levels of a channel in the statistics.
const LEVELS: usize = 1 << BITS;
/// Most entries of a palette.
pub(super) const ENTRIES: usize = 256;
/// Rounds of moving each entry to the mean of the colours nearest to it.
const REFINEMENTS: usize = 8;

pub(super) struct Indexed {
    /// RGB after RGB, at most [`ENTRIES`].
    pub(super) palette: Vec<u8>,
    /// The entry of each pixel.
    pub(super) indices: Vec<u8>,
}

/// Chooses a palette and maps every pixel to its nearest entry (squared distance in sRGB levels).
///
/// A picture of at most 256 colours is kept exactly. Of more, the palette starts from boxes in colour space, split
/// where that lessens the squared error most, and is then refined as k-means does. No dithering: frames of a movie
/// would flicker. The result depends on nothing but the picture.
pub(super) fn index(image: &RgbImage) -> Indexed {
    if let Some(exact) = exact(image) {
        return exact;
    }
    let cells = cells(image);
    let mut palette = split(&cells);
    for _ in 0..REFINEMENTS {
        palette = refined(&cells, &palette);
    }
    let palette: Vec<[u8; 3]> = palette
        .iter()
        .map(|color| color.map(|level| level.round() as u8))
        .collect();
    let entries: Vec<[f32; 3]> = palette.iter().map(|c| c.map(f32::from)).collect();
    let mut table = vec![0; LEVELS * LEVELS * LEVELS];
    let nearest: Vec<u8> = cells
        .par_iter()
        .map(|cell| nearest(&entries, cell.mean()) as u8)
        .collect();
    for (cell, entry) in cells.iter().zip(nearest) {
        table[cell.place] = entry;
    }
    let indices = image.pixels().map(|p| table[place(p.0)]).collect();
    Indexed {
        palette: palette.into_flattened(),
        indices,
    }
}

/// The palette of a picture that has few colours, sorted; `None` for one of more than [`ENTRIES`].
fn exact(image: &RgbImage) -> Option<Indexed> {
    let mut colors: Vec<[u8; 3]> = Vec::new();
    for pixel in image.pixels() {
        if let Err(at) = colors.binary_search(&pixel.0) {
            if colors.len() == ENTRIES {
                return None;
            }
            colors.insert(at, pixel.0);
        }
    }
    let indices = image
        .pixels()
        // Found: every colour was put in above.
        .map(|pixel| colors.binary_search(&pixel.0).unwrap_or_default() as u8)
        .collect();
    Some(Indexed {
        palette: colors.into_flattened(),
        indices,
    })
}

/// Colours that agree in their upper bits.
struct ColorBin {
    place: usize,
    count: f64,
    sum: [f64; 3],
}

impl ColorBin {
    fn mean(&self) -> [f32; 3] {
        self.sum.map(|sum| (sum / self.count) as f32)
    }
}

fn place([r, g, b]: [u8; 3]) -> usize {
    let part = |level: u8| usize::from(level >> (8 - BITS));
    (part(r) * LEVELS + part(g)) * LEVELS + part(b)
}

/// The cells that have pixels, in the order of their places.
fn cells(image: &RgbImage) -> Vec<ColorBin> {
    let mut counts = vec![(0_u64, [0_u64; 3]); LEVELS * LEVELS * LEVELS];
    for pixel in image.pixels() {
        let (count, sum) = &mut counts[place(pixel.0)];
        *count += 1;
        for (sum, level) in sum.iter_mut().zip(pixel.0) {
            *sum += u64::from(level);
        }
    }
    counts
        .iter()
        .enumerate()
        .filter(|(_, (count, _))| *count > 0)
        .map(|(place, (count, sum))| ColorBin {
            place,
            count: *count as f64,
            sum: sum.map(|s| s as f64),
        })
        .collect()
}

/// Cells that will share an entry.
struct ColorBox {
    members: Vec<u32>,
    cut: Option<BoxCut>,
}

/// Where a group is best cut in two.
#[derive(Clone, Copy)]
struct BoxCut {
    channel: usize,
    /// Members before it, sorted along the channel.
    before: usize,
    gain: f64,
}

impl ColorBox {
    fn new(cells: &[ColorBin], members: Vec<u32>) -> Self {
        let (all_count, all_sum) = totals(cells, &members);
        let mut cut: Option<BoxCut> = None;
        for channel in 0..3 {
            let sorted = sorted_along(cells, &members, channel);
            let (mut count, mut sum) = (0.0, [0.0; 3]);
            for (at, &member) in sorted.iter().enumerate().take(sorted.len() - 1) {
                let cell = &cells[member as usize];
                count += cell.count;
                sum = [0, 1, 2].map(|c| sum[c] + cell.sum[c]);
                let rest = [0, 1, 2].map(|c| all_sum[c] - sum[c]);
                let gain = explained(count, sum) + explained(all_count - count, rest)
                    - explained(all_count, all_sum);
                if cut.is_none_or(|best| gain > best.gain) {
                    cut = Some(BoxCut {
                        channel,
                        before: at + 1,
                        gain,
                    });
                }
            }
        }
        Self { members, cut }
    }
}

fn totals(cells: &[ColorBin], members: &[u32]) -> (f64, [f64; 3]) {
    members
        .iter()
        .fold((0.0, [0.0; 3]), |(count, sum), &member| {
            let cell = &cells[member as usize];
            (count + cell.count, [0, 1, 2].map(|c| sum[c] + cell.sum[c]))
        })
}

/// What a mean takes off the sum of squares: |sum|² / count.
fn explained(count: f64, sum: [f64; 3]) -> f64 {
    sum.iter().map(|s| s * s).sum::<f64>() / count
}

fn sorted_along(cells: &[ColorBin], members: &[u32], channel: usize) -> Vec<u32> {
    let mut keyed: Vec<(f32, u32)> = members
        .iter()
        .map(|&member| (cells[member as usize].mean()[channel], member))
        .collect();
    keyed.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    keyed.into_iter().map(|(_, member)| member).collect()
}

/// Splits the group whose cut gains most, until there are enough or none can be cut.
fn split(cells: &[ColorBin]) -> Vec<[f32; 3]> {
    let mut groups = vec![ColorBox::new(cells, (0..cells.len() as u32).collect())];
    while groups.len() < ENTRIES {
        let gains = groups.iter().enumerate();
        let best = gains
            .filter_map(|(index, group)| Some((index, group.cut?)))
            .reduce(|a, b| if b.1.gain > a.1.gain { b } else { a });
        let Some((index, cut)) = best else {
            break;
        };
        let group = groups.swap_remove(index);
        let mut low = sorted_along(cells, &group.members, cut.channel);
        let high = low.split_off(cut.before);
        groups.extend([low, high].map(|members| ColorBox::new(cells, members)));
    }
    groups
        .iter()
        .map(|group| {
            let (count, sum) = totals(cells, &group.members);
            sum.map(|sum| (sum / count) as f32)
        })
        .collect()
}

/// Each entry moved to the mean of the cells nearest to it; one without cells stays.
fn refined(cells: &[ColorBin], palette: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let nearest: Vec<usize> = cells
        .par_iter()
        .map(|cell| nearest(palette, cell.mean()))
        .collect();
    let mut sums = vec![(0.0, [0.0; 3]); palette.len()];
    for (cell, entry) in cells.iter().zip(nearest) {
        let (count, sum) = &mut sums[entry];
        *count += cell.count;
        for (sum, more) in sum.iter_mut().zip(cell.sum) {
            *sum += more;
        }
    }
    palette
        .iter()
        .zip(sums)
        .map(|(entry, (count, sum))| {
            if count > 0.0 {
                sum.map(|s: f64| (s / count) as f32)
            } else {
                *entry
            }
        })
        .collect()
}

fn nearest(palette: &[[f32; 3]], color: [f32; 3]) -> usize {
    let mut best = (f32::INFINITY, 0);
    for (index, entry) in palette.iter().enumerate() {
        let distance: f32 = (0..3).map(|c| (entry[c] - color[c]).powi(2)).sum();
        if distance < best.0 {
            best = (distance, index);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rms(image: &RgbImage) -> f64 {
        let Indexed { palette, indices } = index(image);
        assert!(palette.len() <= 3 * ENTRIES);
        let squares: f64 = image
            .pixels()
            .zip(&indices)
            .map(|(pixel, &entry)| {
                let entry = &palette[3 * usize::from(entry)..][..3];
                let error = |c: usize| f64::from(pixel.0[c].abs_diff(entry[c])).powi(2);
                error(0) + error(1) + error(2)
            })
            .sum();
        (squares / image.as_raw().len() as f64).sqrt()
    }

    #[test]
    fn few_colours_are_exact() {
        let image = RgbImage::from_fn(16, 16, |x, y| image::Rgb([(16 * y + x) as u8, 7, x as u8]));
        assert_eq!(rms(&image), 0.0);
        assert_eq!(rms(&RgbImage::new(3, 2)), 0.0);
    }

    #[test]
    fn a_plane_of_colours_is_cut_about_as_well_as_a_grid_would() {
        // Red and green run over a plane, blue is their mean. A grid of 16×16 cells of 16 levels would be 16/√12 off in
        // red and in green and 16/√24 in blue, 4.22 in all; a twentieth more is allowed.
        let image = RgbImage::from_fn(128, 128, |x, y| {
            image::Rgb([(2 * x) as u8, (2 * y) as u8, (x + y) as u8])
        });
        let found = rms(&image);
        assert!(found < 4.43, "{found}");
    }

    #[test]
    fn rare_colours_far_from_all_others_get_an_entry() {
        let image = RgbImage::from_fn(100, 100, |x, y| {
            if (x, y) == (50, 50) {
                image::Rgb([255, 0, 255])
            } else {
                image::Rgb([(x / 2) as u8, (y / 2) as u8, 20])
            }
        });
        let Indexed { palette, indices } = index(&image);
        let entry = 3 * usize::from(indices[50 * 100 + 50]);
        assert_eq!(palette[entry..entry + 3], [255, 0, 255]);
    }
}
