//! Tests whether another interpretation explains the same views well, and significantly better than the dataset
//! reader's own.

use super::explained::{ENOUGH, Explained};

/// Minimum fraction of the loss that another interpretation must remove to count as better.
pub(super) const MIN_GAIN: f64 = 0.1;
/// Replaces [`MIN_GAIN`] for changes by a factor. This threshold can be lower, because in valid
/// data hardly any factor fits better than 1.
pub(super) const MIN_GAIN_OF_FACTORS: f64 = 0.05;
/// Replaces [`MIN_GAIN`] for changes to some of the views.
pub(super) const MIN_GAIN_OF_VIEWS: f64 = 0.15;
/// Minimum number of samples that must land in other views for an interpretation to be judged; fewer prove nothing.
const MIN_LANDED: usize = 500;
/// Minimum fraction of the picture tiles in which another interpretation must fit better to count as better.
const MIN_SHARE: f64 = 0.75;
/// Another interpretation counts as better only if its mean improvement over the tiles exceeds this many standard
/// errors of that mean.
pub(super) const MIN_ERRORS: f64 = 3.0;
/// Replaces [`MIN_GAIN`] for lens distortion; in valid scenes, the gain is 0.003.
pub(super) const MIN_GAIN_OF_LENSES: f64 = 0.03;
/// Replaces [`MIN_ERRORS`] for lens distortion.
pub(super) const MIN_ERRORS_OF_LENSES: f64 = 4.0;
/// An interpretation explains the views well if its mean loss is at most this.
const MAX_LEFT: f64 = 0.45;
/// The views are suspicious, and more interpretations are tried, if the mean loss of the reader's interpretation is at
/// least this.
const SUSPICIOUS: f64 = 0.25;
/// Depth agrees overall if at least this fraction of the depths agree. Valid data reach it even with coarse pixels and
/// slanted surfaces.
const MOSTLY_AGREEING: f64 = 0.8;
/// Depths agree under the reader's interpretation if at least this fraction of them agree, as in
/// valid data with little motion.
const AGREEING: f64 = 0.9;
/// Smallest increase in the fraction of agreeing depths that makes a change necessary although at least [`AGREEING`] of
/// them agree already. Colours alone may also make a change necessary ([`NEARER_COLOURS`]).
const MORE_AGREEING: f64 = 0.03;
/// Largest fraction of the colour differences that may remain after a change that colours alone justify.
const NEARER_COLOURS: f64 = 0.9;
/// A tile of a picture is judged only if at least this many samples lie in it.
const ENOUGH_IN_TILE: usize = 8;
/// An interpretation is refuted if it increases colour differences by more than this factor, even if depth agrees
/// better.
const WORSE_COLOURS: f64 = 1.02;
/// Like [`WORSE_COLOURS`], but for another assignment of pictures to poses, which must reduce colour differences: views
/// that move by equal steps fit poses shifted by a step just as well.
const AS_FAR_COLOURS: f64 = 0.97;
/// An interpretation under which as many samples land in the other view is refuted if the fraction of depths that agree falls
/// below this share of the fraction under the reader's interpretation, even if colours fit better.
const MIN_AGREEMENT: f64 = 0.5;
/// Minimum number of colours that an interpretation of a single view compares, as a fraction of those compared under the
/// reader's interpretation.
const MIN_COMPARED: f64 = 0.5;
/// Minimum fraction of depths that agree under an interpretation of a single view, as a fraction of that under the reader's
/// interpretation.
const MIN_AGREEMENT_OF_VIEW: f64 = 0.9;
/// Minimum texture of the places that an interpretation compares, as a fraction of the texture of the places compared
/// under the reader's interpretation.
const MIN_TEXTURE: f64 = 0.2;

/// Sum over the projections of each view into the next one. Projections in the opposite direction are left out.
pub(super) fn forward(all: &[Explained]) -> Explained {
    let mut sum = Explained::default();
    all.iter().step_by(2).for_each(|one| sum.add(one));
    sum
}

pub(super) fn landed(all: &[Explained]) -> usize {
    all.iter().map(Explained::landed).sum()
}

/// Mean loss of the samples that land inside the other view; 1, the maximum, if too few do.
pub(super) fn mean_loss(all: &[Explained]) -> f64 {
    let samples: usize = all.iter().map(|one| one.samples).sum();
    let landed = landed(all);
    if (landed as f64) < ENOUGH * samples as f64 || landed == 0 {
        return 1.0;
    }
    all.iter().map(Explained::loss).sum::<f64>() / landed as f64
}

/// True if the mean loss under an interpretation is at most [`MAX_LEFT`].
pub(super) fn fits_well(all: &[Explained]) -> bool {
    mean_loss(all) <= MAX_LEFT
}

/// True if the mean loss under an interpretation is at least [`SUSPICIOUS`], i.e. higher than valid data usually have.
pub(super) fn is_suspicious(all: &[Explained]) -> bool {
    mean_loss(all) >= SUSPICIOUS
}

/// True if at least [`MOSTLY_AGREEING`] of the depths agree.
pub(super) fn agrees(all: &[Explained]) -> bool {
    forward(all).agreement() >= MOSTLY_AGREEING
}

/// True if another interpretation increases colour differences too much, even if depth agrees better. `is_order`:
/// whether it assigns pictures to other poses.
pub(super) fn is_refuted(as_read: &[Explained], other: &[Explained], is_order: bool) -> bool {
    let most = if is_order {
        AS_FAR_COLOURS
    } else {
        WORSE_COLOURS
    };
    let (before, after) = (forward(as_read), forward(other));
    let levels = before.colour_levels().zip(after.colour_levels());
    let is_farther = 10 * before.compared >= 3 * after.compared
        && levels.is_some_and(|(before, after)| after > most * before);
    let disagrees =
        landed(other) >= landed(as_read) && after.agreement() < MIN_AGREEMENT * before.agreement();
    is_farther || disagrees
}

/// True if another interpretation of a single view still compares enough colours, and about as many depths agree.
/// Otherwise, it merely moves the part that a mask leaves to a place where nothing is known.
pub(super) fn is_supported(as_read: &[Explained], other: &[Explained]) -> bool {
    let [before, after] = [as_read, other].map(forward);
    after.compared as f64 >= MIN_COMPARED * before.compared as f64
        && after.agreement() >= MIN_AGREEMENT_OF_VIEW * before.agreement()
}

/// True if another interpretation compares mainly places without texture, such as sky, which fit each other anywhere.
pub(super) fn is_plain(as_read: &[Explained], other: &[Explained]) -> bool {
    let [read, other] = [as_read, other].map(|all| forward(all).texture());
    other < MIN_TEXTURE * read
}

/// False if depths agree under the reader's interpretation (`as_read`) and `other` hardly improves
/// their agreement: with little motion or few pixels, a small improvement is due to chance.
/// `by_colours`: true if colours alone may show that the change is needed.
pub(super) fn is_needed(as_read: &[Explained], other: &[Explained], by_colours: bool) -> bool {
    let [read, other] = [as_read, other].map(forward);
    let levels = read.colour_levels().zip(other.colour_levels());
    let levels = levels.filter(|_| by_colours);
    read.agreement() < AGREEING
        || other.agreement() >= read.agreement() + MORE_AGREEING
        || levels.is_some_and(|(before, after)| after <= NEARER_COLOURS * before)
}

/// True if another interpretation explains the same pairs of views significantly better than
/// `as_read`.
pub(super) fn is_better(as_read: &[Explained], other: &[Explained], least_gain: f64) -> bool {
    is_better_by(as_read, other, (least_gain, MIN_ERRORS))
}

/// Like [`is_better`], but `least_errors` sets the number of standard errors that the improvement must exceed.
pub(super) fn is_better_by(
    as_read: &[Explained],
    other: &[Explained],
    (least_gain, least_errors): (f64, f64),
) -> bool {
    let (before, after) = (mean_loss(as_read), mean_loss(other));
    let few = landed(other) < MIN_LANDED || 10 * landed(other) < 3 * landed(as_read);
    if few || after > (1.0 - least_gain) * before {
        return false;
    }
    let mut differences = Vec::new();
    for (read, other) in as_read.iter().zip(other) {
        for (one, another) in read.tiles.iter().zip(&other.tiles) {
            let mean = |tile: &(usize, f64)| tile.1 / tile.0 as f64;
            let enough = |tile: &(usize, f64)| tile.0 >= ENOUGH_IN_TILE;
            match (enough(one), enough(another)) {
                (true, true) => differences.push(mean(one) - mean(another)),
                (false, true) => differences.push(1.0 - mean(another)),
                _ => {}
            }
        }
    }
    // A tile with the same loss under both interpretations is no evidence for either.
    differences.retain(|difference| *difference != 0.0);
    let n = differences.len() as f64;
    let mean = differences.iter().sum::<f64>() / n;
    let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let better = differences.iter().filter(|d| **d > 0.0).count() as f64;
    n >= 4.0 && better >= MIN_SHARE * n && mean > least_errors * (variance / n).sqrt()
}
