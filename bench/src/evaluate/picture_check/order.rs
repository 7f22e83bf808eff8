//! Detects pictures stored under the names of other pairs, and pictures that are the source's photograph. Compares a
//! sample of pictures with the targets of other pairs and with the source.
//!
//! To avoid false alarms on poor predictions and on pictures with little motion, most of the compared pictures must
//! show another target significantly better than their own, and better than the source's photograph shows it. Scores do
//! not depend on this check.

use std::collections::BTreeMap;

use image::RgbImage;
use image::imageops::thumbnail;
use sharp_datasets::View;

use super::change::shrunk;
use super::filled::filled_colour;
use super::finding::{ShownCamera, ShownTarget};
use super::framing::DisplacedBlocks;
use super::motion::{MeasuredMotion, shown_camera};
use super::sample::PictureSample;
use super::shift::shift_equations;
use super::stamp::wrong_cells;
use super::swapped::{is_worse_where, unseen_by_target};
use super::tone::tone;
use crate::evaluate::gaussians::likeness::Likeness;
use crate::evaluate::record::Record;
use crate::pairs::pair_list::ResolvedPair;
use crate::scoring::Region;

/// A picture shows another target only if it is closer to it than to its own target by at least this, in dB.
const MIN_GAIN: f64 = 2.0;
/// A picture is a copy of the source's photograph, perhaps stored as JPEG, only if its PSNR against that photograph is
/// at least this, in dB. It must also reach [`MIN_COPY_GAIN`].
const MIN_COPY_PSNR: f64 = 40.0;
/// A picture is a copy of the source's photograph only if its PSNR against that photograph exceeds its PSNR against the
/// target's by at least this, in dB.
const MIN_COPY_GAIN: f64 = 10.0;

/// A prediction shows the source's view only if it is closer to the source's photograph than to the target's by at
/// least this, in dB. It must also reach [`MIN_SOURCE_VIEW_ERROR`].
const MIN_SOURCE_VIEW_GAIN: f64 = 3.0;
/// A picture that is closer to the source's photograph than to the target's by at least this, in dB, shows the source's
/// view, even if a larger motion or another framing was measured.
const SURE_SOURCE_VIEW_GAIN: f64 = 5.0;
/// Minimum squared error against the target of a prediction that shows the source's view, as a fraction of the squared
/// error of the source's photograph against the target. Predictions of the target's view have a smaller error.
const MIN_SOURCE_VIEW_ERROR: f64 = 0.7;

/// Maximum number of reduced photographs in memory, of about 60 KB each. Pairs in sequence share views.
const MAX_THUMBNAILS: usize = 1024;

/// Reduced photographs, keyed by dataset, scene and view.
#[derive(Default)]
pub(crate) struct Thumbnails(BTreeMap<[String; 3], Option<RgbImage>>);

impl Thumbnails {
    /// A view's photograph, shrunk; `None` if it cannot be read.
    pub(crate) fn of(&mut self, planned: &ResolvedPair<'_>, view: &View) -> Option<RgbImage> {
        let scene = planned.scene;
        let name = [&scene.dataset, &scene.id, &view.id].map(Clone::clone);
        let read = || Some(shrunk(&view.content.image().ok()?));
        if self.0.len() >= MAX_THUMBNAILS {
            self.0.clear();
        }
        self.0.entry(name).or_insert_with(read).clone()
    }
}

/// Sets [`Record::shows`], [`Record::camera`], [`Record::in_world`], [`Record::wrong_cells`], [`Record::tone`], [`Record::shift`],
/// [`Record::far_shift`], [`Record::masked`] and [`Record::filled`] if the picture is in `sample` and covers the whole target.
pub(crate) fn note_order(
    record: &mut Record,
    planned: &ResolvedPair<'_>,
    sample: &PictureSample<'_>,
    (photograph, picture): (&RgbImage, &RgbImage),
    read: &mut Thumbnails,
) {
    (record.shows, record.camera, record.wrong_cells) = (None, None, None);
    (record.tone, record.shift, record.masked) = (None, None, None);
    (record.far_shift, record.filled, record.in_world) = (None, None, None);
    if record.crop.is_some() {
        return;
    }
    let views = [planned.source, planned.target];
    let [from, to] = views.map(|view| view.camera_from_world);
    let target_from_source = to.after(&from.inverse());
    let others = sample.others.get(&record.pair_id);
    if others.is_some() || sample.shifts.contains(&record.pair_id) {
        let (target, moved) = (planned.target.intrinsics, target_from_source.translation);
        record.shift = shift_equations(target, moved, [photograph, picture]);
    }
    let Some(others) = others else {
        return;
    };
    record.wrong_cells = Some(wrong_cells(photograph, picture));
    let [seen, shown] = [photograph, picture].map(shrunk);
    let Some(source) = read.of(planned, planned.source) else {
        return;
    };
    record.filled = filled_colour(photograph, picture);
    record.tone = tone([&source, &seen, &shown], record.filled);
    let is_other = |other: &ResolvedPair<'_>| {
        let is_own_scene = other.scene.id == planned.scene.id;
        !(is_own_scene && [&planned.source.id, &planned.target.id].contains(&&other.target.id))
    };
    let others = others.iter().filter(|(_, other)| is_other(other));
    let others = others.map(|(place, other)| (*place, *other));
    let beside = views_beside(planned).into_iter();
    let others = others.chain(beside.filter(|(_, other)| is_other(other)));
    let others = others.filter_map(|(place, other)| Some((place, read.of(&other, other.target)?)));
    let MeasuredMotion {
        camera: moved,
        in_world,
        masked,
    } = shown_camera(
        views.map(|view| view.intrinsics),
        [from, to],
        [&source, &seen, &shown],
        record.filled,
    );
    record.masked = masked;
    // A zoom resembles a reversed motion along the optical axis.
    let is_certain =
        |camera: &ShownCamera| camera.is_wrong() && *camera != ShownCamera::Reversed(2);
    let translation = target_from_source.translation;
    let (intrinsics, both) = (planned.target.intrinsics, [&seen, &shown]);
    let blocks = DisplacedBlocks::of(intrinsics, translation, both);
    record.far_shift = blocks.shift();
    let framing = || blocks.framing(moved.is_some()).map(ShownCamera::Reframed);
    let camera = moved.filter(is_certain).or_else(framing).or(moved);
    let shows = shown_target(&seen, &shown, Some(&source), others);
    let gain = || fit(&source, &shown).gain_over(&fit(&seen, &shown));
    (record.shows, record.camera) = reconciled(shows, camera, gain);
    record.in_world = in_world.filter(|_| record.camera.is_some());
    if record.shows == Some(ShownTarget::SourceView)
        && let Some(is_unseen) = unseen_by_target(planned, source.dimensions())
        && is_worse_where(&is_unseen, &source, &shown)
    {
        record.shows = Some(ShownTarget::SourceFromTarget);
    }
}

/// The pair with its target replaced by the scene's view before it, and by the view after it. A method that names its
/// pictures one frame off may show views that are no pair's target.
fn views_beside<'a>(planned: &ResolvedPair<'a>) -> Vec<(ShownTarget, ResolvedPair<'a>)> {
    let views = &planned.scene.views;
    let Some(at) = views.iter().position(|view| view.id == planned.target.id) else {
        return Vec::new();
    };
    let beside = [
        (ShownTarget::ViewBefore, at.checked_sub(1)),
        (ShownTarget::ViewAfter, Some(at + 1)),
    ];
    let views = beside
        .into_iter()
        .filter_map(|(place, at)| Some((place, views.get(at?)?)));
    let pairs = views.map(|(place, target)| (place, ResolvedPair { target, ..*planned }));
    pairs.collect()
}

/// If the view and the camera that a picture shows contradict each other, drops one of them. `gain` computes how much
/// closer the picture is to the source's photograph than to the target's, in dB.
fn reconciled(
    shows: Option<ShownTarget>,
    camera: Option<ShownCamera>,
    gain: impl Fn() -> f64,
) -> (Option<ShownTarget>, Option<ShownCamera>) {
    use ShownCamera::{Moved, Reframed};
    use ShownTarget::{Own, Source, SourceView};
    match (shows, camera) {
        (Some(Source), _) | (Some(SourceView), Some(Moved(-5..=5))) => (shows, None),
        // If both cameras look at one point, the source's view resembles a larger motion, or another framing.
        (Some(SourceView), Some(Reframed(_) | Moved(51..))) if gain() >= SURE_SOURCE_VIEW_GAIN => {
            (shows, None)
        }
        // Poor depth may make a picture closer to the source, although its motion was measured.
        (Some(SourceView), Some(_)) => (Some(Own), camera),
        _ => (shows, camera),
    }
}

/// The view that the picture `shown` resembles most, given its own target `seen`: the first of these that applies.
///
/// * [`ShownTarget::Source`]: a copy of the source's photograph.
/// * [`ShownTarget::SourceView`]: significantly closer to that photograph than to `seen`.
/// * The closest of `others` to which the picture is significantly closer than to `seen`.
/// * [`ShownTarget::Own`].
///
/// `None` if `shown` and `seen` differ in size. All pictures must be [`shrunk`].
pub(crate) fn shown_target(
    seen: &RgbImage,
    shown: &RgbImage,
    source: Option<&RgbImage>,
    others: impl Iterator<Item = (ShownTarget, RgbImage)>,
) -> Option<ShownTarget> {
    if seen.dimensions() != shown.dimensions() {
        return None;
    }
    let own = fit(seen, shown);
    let is_copy = |copied: Likeness| {
        copied.psnr() >= MIN_COPY_PSNR && copied.psnr() - own.psnr() >= MIN_COPY_GAIN
    };
    if source.is_some_and(|source| is_copy(fit(source, shown))) {
        return Some(ShownTarget::Source);
    }
    // A prediction that follows the motion is closer to the target than the source's photograph is.
    if let Some(source) = source
        && let (shows, copied) = (fit(source, shown), fit(seen, source))
        && shows.is_better_than(&own)
        && shows.gain_over(&own) >= MIN_SOURCE_VIEW_GAIN
        && own.error() >= MIN_SOURCE_VIEW_ERROR * copied.error()
    {
        return Some(ShownTarget::SourceView);
    }
    let mut best: Option<(ShownTarget, Likeness)> = None;
    for (place, seen) in others {
        let other = fit(&seen, shown);
        if other.is_better_than(&own)
            && other.gain_over(&own) >= MIN_GAIN
            && source.is_none_or(|source| other.is_closer_than(&fit(&seen, source)))
            && best.as_ref().is_none_or(|(_, b)| other.error() < b.error())
        {
            best = Some((place, other));
        }
    }
    Some(best.map_or(ShownTarget::Own, |(place, _)| place))
}

/// Compares `shown` with `seen`, at the size of `shown`.
fn fit(seen: &RgbImage, shown: &RgbImage) -> Likeness {
    let size = shown.dimensions();
    let resized = (seen.dimensions() != size).then(|| thumbnail(seen, size.0, size.1));
    Likeness::of(resized.as_ref().unwrap_or(seen), Region::whole(size), shown)
}

#[cfg(test)]
mod tests {
    use image::Rgb;
    use sharp_tests::holds;

    use super::super::camera::misplaced;
    use super::super::group::Extent;
    use super::super::sample::compared_pictures;
    use super::*;

    /// Waves of another direction for each `view`, with some noise.
    fn view(view: usize, noise: u32) -> RgbImage {
        RgbImage::from_fn(96, 72, |x, y| {
            let (u, v) = (f64::from(x) / 7.0, f64::from(y) / 9.0);
            let wave = 120.0 + 90.0 * (u * (view as f64 * 0.7).cos() + v + view as f64).sin();
            let hash = f64::from((x * 7919 + y * 104_729) % 17) - 8.0;
            Rgb([(wave + hash * f64::from(noise)).clamp(0.0, 255.0) as u8; 3])
        })
    }

    /// What the sentence is if the picture of `from(k)` has the name of k, for 9 pictures.
    fn told(from: impl Fn(usize) -> usize) -> Option<String> {
        let mut found = BTreeMap::new();
        for (at, others) in
            compared_pictures(&["1", "2", "3", "4", "5", "6", "7", "8", "9"].map(|name| ["", name]))
        {
            let others = others.into_iter().map(|(place, k)| (place, view(k, 0)));
            let shown = view(from(at), 1);
            *found
                .entry(shown_target(&view(at, 0), &shown, None, others)?)
                .or_insert(0) += 1;
        }
        misplaced(&found, "pictures", Extent::Dataset)
    }

    #[test]
    fn pictures_of_a_folder_under_the_names_of_others_are_told() {
        let before = told(|k| (k + 8) % 9).unwrap();
        holds(&before, &["show the target of the pair before theirs"]);
        let after = told(|k| (k + 1) % 9).unwrap();
        holds(&after, &["show the target of the pair after theirs"]);
        assert!(
            told(|k| (k * 4 + 3) % 9)
                .unwrap()
                .contains("the target of another pair")
        );
        assert_eq!(told(|k| k), None);
        // A frame in the middle was dropped; then one picture has another's name.
        let half = told(|k| if k < 4 { k } else { k - 1 }).unwrap();
        assert!(half.contains("before theirs"), "{half}");
        assert_eq!(told(|k| if k == 5 { 4 } else { k }), None);
        assert_eq!(compared_pictures(&[["", "1"], ["", "2"]]), BTreeMap::new());
    }

    #[test]
    fn frames_one_off_are_told_although_nobody_targets_them() {
        use ShownTarget::{Own, Source, ViewAfter};
        let said = |found: &[(ShownTarget, usize)]| {
            misplaced(&found.iter().copied().collect(), "pairs", Extent::Dataset)
        };
        // The frame after two of the targets is the source.
        let text = said(&[(ViewAfter, 3), (Source, 2), (Own, 3)]).unwrap();
        assert!(
            text.contains("3 of the 6 compared show the scene's view after"),
            "{text}"
        );
        assert_eq!(said(&[(ViewAfter, 2), (Own, 6)]), None);
    }

    #[test]
    fn copies_of_the_source_are_told_from_predictions_near_it() {
        let shown = |shown: &RgbImage, target| {
            shown_target(
                &view(target, 0),
                shown,
                Some(&view(0, 0)),
                std::iter::empty(),
            )
        };
        assert_eq!(shown(&view(0, 0), 1), Some(ShownTarget::Source));
        assert_eq!(shown(&view(0, 1), 1), Some(ShownTarget::SourceView));
        assert_eq!(shown(&view(1, 4), 1), Some(ShownTarget::Own));
        let between = |x: u32, y: u32| {
            let [a, b] = [0, 1].map(|k| view(k, 0).get_pixel(x, y).0[0] / 2);
            Rgb([a + b; 3])
        };
        let blend = RgbImage::from_fn(96, 72, between);
        assert_eq!(shown(&blend, 1), Some(ShownTarget::Own));
        // A target equal to its source.
        assert_eq!(shown(&view(0, 0), 0), Some(ShownTarget::Own));
        let said = misplaced(
            &BTreeMap::from([(ShownTarget::Source, 3)]),
            "pairs of d",
            Extent::Dataset,
        )
        .unwrap();
        assert!(
            said.contains("are the source's photograph, as with the baseline `copy` (3 of the 3"),
            "{said}"
        );
        let said = BTreeMap::from([(ShownTarget::Source, 1), (ShownTarget::SourceView, 3)]);
        let said = misplaced(&said, "pairs of d", Extent::Dataset).unwrap();
        assert!(
            said.contains("show the source's view rather than the target's (4 of the 4"),
            "{said}"
        );
    }

    #[test]
    fn a_picture_far_closer_to_the_source_did_not_move() {
        use ShownCamera::{InversePose, Moved};
        use ShownTarget::{Own, Source, SourceView};
        let told = |shows, camera, gain: f64| reconciled(Some(shows), Some(camera), || gain);
        assert_eq!(told(SourceView, Moved(133), 6.0), (Some(SourceView), None));
        assert_eq!(
            told(SourceView, Moved(133), 4.0),
            (Some(Own), Some(Moved(133)))
        );
        for camera in [Moved(40), InversePose] {
            assert_eq!(told(SourceView, camera, 9.0), (Some(Own), Some(camera)));
        }
        assert_eq!(told(SourceView, Moved(3), 4.0), (Some(SourceView), None));
        assert_eq!(told(Source, Moved(100), 0.0), (Some(Source), None));
        assert_eq!(told(Own, Moved(133), 9.0), (Some(Own), Some(Moved(133))));
    }

    #[test]
    fn pictures_of_other_targets_are_told_at_other_sizes() {
        let resized = thumbnail(&view(1, 1), 120, 60);
        let own = thumbnail(&view(0, 0), 120, 60);
        let other = [(ShownTarget::Next, view(1, 0))].into_iter();
        assert_eq!(
            shown_target(&own, &resized, None, other),
            Some(ShownTarget::Next)
        );
    }
}
