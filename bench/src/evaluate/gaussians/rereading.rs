//! Tries other readings of a Gaussian file on a small part of its source photograph. A reading is an interpretation of
//! the file's numbers and of its space, see [`FileReading`].

mod candidates;
mod flattened;

use glam::{DAffine3, DVec3};
use image::RgbImage;
use sharp::camera::Intrinsics;
use sharp::gaussians::Gaussians;
use sharp::ply::StoredOpacity;
use sharp::render::{PrincipalPoint, RenderError, RenderOutput, RenderView, Rule};

use super::footprint::{MIN_HOLES, mean_area};
use super::likeness::Likeness;
pub(in crate::evaluate) use candidates::Hints;
use candidates::{numbers, placements};

use crate::methods::file_reading::{FileReading, FileSpace, Placement};
use crate::pairs::PosedCamera;
use crate::rendering::SharedRenderer;
use crate::rendering::shared::HOLE_ALPHA;
use crate::scoring::Region;

/// Readings under which more Gaussians than this cover a pixel on average are not tried; no photograph needs so many.
const MAX_LAYERS: f64 = 3000.0;
/// Only readings that gain at least this much in the source's view, in dB, are tried in other views.
const MIN_SOURCE_GAIN_DB: f64 = 0.25;
/// Another form of the stored numbers is ruled out if it increases the error in the source's view by more than this, in
/// dB.
const RULED_OUT_LOSS_DB: f64 = 1.0;
/// Like [`RULED_OUT_LOSS_DB`], but for another form of opacities. It is larger, because the stored values themselves
/// are strong evidence of the form, and the rendering of the source hardly depends on opacities.
const RULED_OUT_LOSS_OF_OPACITY_DB: f64 = 3.0;
/// Readings that multiply the error in other views by more than this are not accepted.
const MAX_ERROR_ELSEWHERE: f64 = 1.1;
/// Like [`MAX_ERROR_ELSEWHERE`], but for changes that must improve other views, too: a shift, and any reading of
/// Gaussians that were made from several views. Where none of these views saw the scene, wrong readings fill holes by
/// chance.
const MAX_ERROR_OF_IMPROVED: f64 = 0.97;
/// A shift that gains at least this much in the source's view, in dB and with [flattened](Trial::flat_fits) Gaussians,
/// is accepted even if other views do not improve. In other views of poor Gaussians, half a pixel makes hardly any
/// difference.
const UNCONFIRMED_SHIFT_GAIN_DB: f64 = 1.0;
/// Another form of colours is preferred only if it gains at least this, in dB: forms of colours may differ merely in
/// brightness and contrast.
const MIN_RECOLORED_GAIN_DB: f64 = 6.0;
/// Like [`MIN_RECOLORED_GAIN_DB`], but for a form of colours whose rendering does not improve further when brightness
/// and contrast are fitted.
const MIN_EXACT_RECOLORED_GAIN_DB: f64 = 2.0;
/// Changes of the focal length by less than this fraction are small. Small changes must gain more, because a slight
/// enlargement may improve the fit of misshapen Gaussians by chance.
const SMALL_ZOOM: f64 = 0.05;
/// Minimum gain of a small change of the focal length, in dB. The rendering must also have no holes, because enlarging
/// narrows them.
const MIN_SMALL_ZOOM_GAIN_DB: f64 = 1.0;
/// Spreading Gaussians over the photograph is tried only if they extend over more than this share of its sides.
const MIN_EXTENT: f64 = 0.1;
/// Spreading Gaussians over the photograph is tried only if it enlarges their width or height by at least this factor.
const MIN_ENLARGEMENT: f64 = 1.3;
/// Average number of Gaussians per pixel above which they may be too wide, for example because standard deviations are
/// base-10 logarithms.
const WIDE_LAYERS: f64 = 500.0;
/// A view counts as wholly shown if Gaussians cover at least this share of it.
const MIN_WHOLE_COVERAGE: f64 = 0.7;
/// Minimum gain for reporting that Gaussians should be narrower, in dB. Crude but correct Gaussians gain less.
pub(super) const MIN_NARROWER_GAIN_DB: f64 = 4.0;
/// Another order of quaternions is accepted only if the area of the Gaussians is at least this fraction of the area as
/// read, or if it gains [`MIN_NARROWER_GAIN_DB`]. Wrong orders reduce the area, because most Gaussians lie on surfaces that
/// face the camera.
pub(super) const MIN_FACING_AREA: f64 = 0.97;
/// If two readings of the stored numbers differ by at least this in the compared part of the source, in dB, the closer one
/// there is chosen, whatever other views show.
const MIN_DECISIVE_GAIN_DB: f64 = 1.5;
/// Another named rendering rule is advised only if it gains at least this much, in dB. In the source's own view, poor but
/// correctly drawn Gaussians look much the same under all rules.
const MIN_RULE_GAIN_DB: f64 = 3.0;
/// Maximum number of settings that may be wrong at once.
const ROUNDS: usize = 3;

/// The part of a source's photograph on which readings are compared, and how it is rendered.
#[derive(Clone, Copy)]
pub(in crate::evaluate) struct Trial<'a> {
    pub(in crate::evaluate) source: &'a PosedCamera,
    pub(in crate::evaluate) photograph: &'a RgbImage,
    pub(in crate::evaluate) region: Region,
    /// Shift of the photograph to the right and down, in pixels.
    pub(in crate::evaluate) moved: [f64; 2],
    pub(in crate::evaluate) renderer: &'a SharedRenderer,
    pub(in crate::evaluate) rule: Option<Rule>,
    /// Whether the Gaussians were made from several views, so that the source need not be one of them.
    pub(in crate::evaluate) of_several_views: bool,
}

/// The rendering `rule`, changed to use the camera's principal point.
fn general(rule: Rule) -> Rule {
    Rule {
        principal_point: PrincipalPoint::Used,
        ..rule
    }
}

/// The rule with the low-pass and the compensation of each other named rule that does not merely sharpen by a smaller
/// low-pass; none without a rule.
fn other_rules(rule: Option<Rule>) -> Vec<Rule> {
    let mut all: Vec<Rule> = rule.into_iter().collect();
    for (_, named) in Rule::NAMED.iter().filter(|_| rule.is_some()) {
        let other = Rule {
            low_pass: named.low_pass,
            compensation: named.compensation,
            ..all[0]
        };
        if other.low_pass >= all[0].low_pass && !all.contains(&other) {
            all.push(other);
        }
    }
    all.into_iter().skip(1).collect()
}

impl Trial<'_> {
    /// This trial with the rendering rule of `reading`; unchanged if `reading` sets no rule.
    fn under(&self, reading: &FileReading) -> Self {
        Self {
            rule: reading.rule.or(self.rule),
            ..*self
        }
    }

    /// The point that the rule uses as the camera's principal point, in pixels.
    fn principal_point_of_rule(&self) -> [f64; 2] {
        let k = self.source.intrinsics;
        match self.rule.map(|rule| rule.principal_point) {
            Some(PrincipalPoint::Ignored) => [k.width, k.height].map(|side| f64::from(side) / 2.0),
            _ => [k.cx, k.cy],
        }
    }

    /// [`Self::principal_point_of_rule`] in the moved photograph, in pixels.
    pub(in crate::evaluate) fn principal_point(&self) -> [f64; 2] {
        let [x, y] = self.principal_point_of_rule();
        [x + self.moved[0], y + self.moved[1]]
    }

    /// Offset of the camera's principal point from the one that the rule uses, in pixels to the right and down.
    fn ignored_offset(&self) -> [f64; 2] {
        let k = self.source.intrinsics;
        let [x, y] = self.principal_point_of_rule();
        [k.cx - x, k.cy - y]
    }

    /// The rendering rule, changed to use the camera's principal point. `None` if it uses the point already, or if the
    /// point is within a pixel of the picture's centre.
    fn general_rule(&self) -> Option<Rule> {
        let is_off = self
            .ignored_offset()
            .into_iter()
            .any(|offset| offset.abs() > 1.0);
        self.rule.filter(|_| is_off).map(general)
    }

    /// Whether a shift equals, to within a pixel, the offset of the camera's principal point from the one that the rule
    /// uses.
    fn is_ignored_offset(&self, shift: [f64; 2]) -> bool {
        let offset = self.ignored_offset();
        (shift[0] - offset[0]).abs() <= 1.0 && (shift[1] - offset[1]).abs() <= 1.0
    }

    fn intrinsics(&self) -> Intrinsics {
        let [cx, cy] = self.principal_point();
        Intrinsics {
            cx: cx - f64::from(self.region.x),
            cy: cy - f64::from(self.region.y),
            width: self.region.width,
            height: self.region.height,
            ..self.source.intrinsics
        }
    }

    /// This trial, extended to the whole photograph.
    pub(in crate::evaluate) fn whole(&self) -> Self {
        Self {
            region: Region::whole(self.photograph.dimensions()),
            ..*self
        }
    }

    /// Like [`Trial::fit`], but as if the file, which was read with the settings `reading`, had been read with those of
    /// `other`.
    pub(in crate::evaluate) fn fit_read(
        &self,
        gaussians: &Gaussians,
        reading: &FileReading,
        other: &FileReading,
    ) -> Result<Option<Likeness>, RenderError> {
        let mut recoded = gaussians.clone();
        if other.stored != reading.stored {
            reading.stored.encode(&mut recoded);
            other.stored.decode(&mut recoded);
        }
        let placed = other.placement.camera_from_file(self.source);
        self.under(other).fit(&recoded, placed)
    }

    /// Mean area of the `gaussians` in this part of the picture.
    pub(super) fn mean_area(&self, gaussians: &Gaussians, placement: Placement) -> f64 {
        let map = placement.camera_from_file(self.source);
        let mut view = RenderView::new(map, self.intrinsics());
        view.rule = self.rule.unwrap_or(view.rule);
        let seen = Seen::of(gaussians, map, &view.intrinsics);
        mean_area(&gaussians.subset(&seen.members), &view)
    }

    /// The factors of the focal length, and the shift in pixels to the right and down, that spread the centres of the
    /// `gaussians` over the whole photograph. `None` unless all centres lie in a part of it, as if they had been placed
    /// on a grid whose size differs from the intrinsics'.
    pub(in crate::evaluate) fn spread(
        &self,
        gaussians: &Gaussians,
        camera_from_file: DAffine3,
    ) -> Option<[[f64; 2]; 2]> {
        let k = self.source.intrinsics;
        let centres = gaussians.means.iter().filter_map(|mean| {
            let p = camera_from_file.transform_point3(DVec3::from(mean.map(f64::from)));
            (p.z > 0.0).then_some([k.fx * p.x / p.z, k.fy * p.y / p.z])
        });
        let centres: Vec<[f64; 2]> = centres.collect();
        let principal = self.principal_point_of_rule();
        let sides = [f64::from(k.width), f64::from(k.height)];
        let [across, down] = [0, 1].map(|axis| {
            let mut along: Vec<f64> = centres.iter().map(|centre| centre[axis]).collect();
            along.sort_unstable_by(f64::total_cmp);
            let beyond = along.len() / 1000;
            let ends = along.get(beyond).zip(along.iter().rev().nth(beyond));
            let (low, high) = ends.map(|(low, high)| (*low, *high))?;
            let extent = (high - low) / sides[axis];
            let is_inside = low + principal[axis] > -0.05 * sides[axis]
                && high + principal[axis] < 1.05 * sides[axis];
            // 1.002 makes up for the thousandth of the centres that is ignored at either end.
            (is_inside && extent > MIN_EXTENT).then(|| {
                let zoom = 1.0 / (extent * 1.002);
                (zoom, -zoom * low - principal[axis])
            })
        });
        let ((x, right), (y, bottom)) = (across?, down?);
        (x.max(y) >= MIN_ENLARGEMENT).then_some([[x, y], [right, bottom]])
    }

    /// How many of the `gaussians` cover a pixel of this part of the picture on average. Each Gaussian counts as an
    /// ellipse with radii of √2 standard deviations, whose area equals the Gaussian's integral.
    pub(super) fn overlap(&self, gaussians: &Gaussians, placement: Placement) -> f64 {
        let map = placement.camera_from_file(self.source);
        let k = self.intrinsics();
        let is_inside = |mean: &[f32; 3]| {
            let p = map.transform_point3(DVec3::from(mean.map(f64::from)));
            let [x, y] = [k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy];
            let (width, height) = (f64::from(k.width), f64::from(k.height));
            p.z > 0.0 && (0.0..width).contains(&x) && (0.0..height).contains(&y)
        };
        let inside = (0..gaussians.len()).filter(|at| is_inside(&gaussians.means[*at]));
        let inside: Vec<usize> = inside.collect();
        let mut view = RenderView::new(map, k);
        view.rule = self.rule.unwrap_or(view.rule);
        view.rule.low_pass = 0.0;
        let area = mean_area(&gaussians.subset(&inside), &view);
        std::f64::consts::TAU * area * inside.len() as f64
            / (f64::from(k.width) * f64::from(k.height))
    }

    /// Compares [`Trial::rendered`] with this trial's part of the photograph.
    pub(in crate::evaluate) fn fit(
        &self,
        gaussians: &Gaussians,
        camera_from_file: DAffine3,
    ) -> Result<Option<Likeness>, RenderError> {
        let output = self.rendered(gaussians, camera_from_file)?;
        Ok(output.map(|output| {
            let picture = self.renderer.picture(&output);
            Likeness::of(self.photograph, self.region, &picture)
        }))
    }

    /// Share of this trial's part of the photograph that the `gaussians` cover.
    pub(in crate::evaluate) fn covered(
        &self,
        gaussians: &Gaussians,
        camera_from_file: DAffine3,
    ) -> Result<f64, RenderError> {
        let output = self.rendered(gaussians, camera_from_file)?;
        let alpha = output.map_or_else(Vec::new, |output| output.alpha);
        let covered = alpha.iter().filter(|alpha| **alpha >= HOLE_ALPHA).count();
        Ok(covered as f64 / alpha.len().max(1) as f64)
    }

    /// Whether the source may see only the edge of the Gaussians. True for Gaussians in world space if they cover most
    /// of a view in `elsewhere`, or if `elsewhere` is empty.
    pub(in crate::evaluate) fn is_whole_elsewhere(
        &self,
        gaussians: &Gaussians,
        reading: &FileReading,
        elsewhere: &[Trial<'_>],
    ) -> Result<bool, RenderError> {
        if reading.placement.space != FileSpace::World {
            return Ok(false);
        }
        let mut is_whole = elsewhere.is_empty();
        for other in elsewhere {
            let placed = reading.placement.camera_from_file(other.source);
            is_whole |= other.covered(gaussians, placed)? >= MIN_WHOLE_COVERAGE;
        }
        Ok(is_whole)
    }

    /// Renders the `gaussians` that reach this part of the photograph. `None` if no Gaussian does, or if more than
    /// [`MAX_LAYERS`] cover a pixel on average.
    pub(in crate::evaluate) fn rendered(
        &self,
        gaussians: &Gaussians,
        camera_from_file: DAffine3,
    ) -> Result<Option<RenderOutput>, RenderError> {
        let seen = Seen::of(gaussians, camera_from_file, &self.intrinsics());
        if seen.members.is_empty() || seen.layers > MAX_LAYERS {
            return Ok(None);
        }
        let seen = gaussians.subset(&seen.members);
        // The part's centre is not the principal point, so the rule must not assume that it is.
        let (intrinsics, rule) = (self.intrinsics(), self.rule.map(general));
        let output = self
            .renderer
            .render(&seen, camera_from_file, intrinsics, rule)?;
        Ok(Some(output))
    }

    /// Whether the stored numbers may have the form that `other` states. True if `other` fits this part of the
    /// photograph better than `reading`, or if `reading` does not explain the part and `other` fits only slightly
    /// worse.
    pub(in crate::evaluate) fn allows(
        &self,
        other: &FileReading,
        gaussians: &Gaussians,
        reading: &FileReading,
    ) -> Result<bool, RenderError> {
        let other_form = other.stored;
        let Some(as_read) = self.fit_read(gaussians, reading, reading)? else {
            return Ok(true);
        };
        let other = self.fit_read(gaussians, reading, other)?;
        let gain = other.map_or(f64::NEG_INFINITY, |other| other.gain_over(&as_read));
        // Tolerate a larger loss for logarithmic or linear opacities. They hardly change the source's rendering, and
        // opacities stored in another form do not look like logarithms, nor do they all lie between 0 and 1.
        let is_of_opacity = matches!(
            other_form.opacity,
            Some(StoredOpacity::Log | StoredOpacity::Linear)
        ) && other_form.opacity != reading.stored.opacity;
        Ok(gain >= MIN_SOURCE_GAIN_DB
            || !as_read.explains() && gain > -RULED_OUT_LOSS_DB
            || is_of_opacity && gain > -RULED_OUT_LOSS_OF_OPACITY_DB)
    }

    /// The best reading that explains the photograph significantly better than `as_read`, either in this part alone or
    /// together with `neighbours` (other views of the scene), and that does not increase the error in the neighbours.
    /// Several such readings are ranked by the gain over part and neighbours, unless the part alone decides
    /// ([`MIN_DECISIVE_GAIN_DB`]): wrongly rotated Gaussians may cover either slightly better than correct ones.
    pub(in crate::evaluate) fn best_reading(
        &self,
        gaussians: &Gaussians,
        reading: &FileReading,
        as_read: &Likeness,
        neighbours: &[Trial<'_>],
        hints: &Hints,
    ) -> Result<Option<(FileReading, Likeness)>, RenderError> {
        let mut best = (*reading, as_read.clone());
        for _ in 0..ROUNDS {
            let (before, fit_before) = &best;
            let mut decoded = gaussians.clone();
            if before.stored != reading.stored {
                reading.stored.encode(&mut decoded);
                before.stored.decode(&mut decoded);
            }
            let mut better = Vec::new();
            let mut consider = |candidate: FileReading, gaussians: &Gaussians| {
                let placed = candidate.placement.camera_from_file(self.source);
                if let Some(fit) = self.under(&candidate).fit(gaussians, placed)? {
                    let [own, read] = [candidate.placement, before.placement];
                    let compared = if own.shift != read.shift || own.focal != read.focal {
                        self.flat_fits(gaussians, before, candidate.placement)?
                    } else {
                        Some([fit_before.clone(), fit.clone()])
                    };
                    let gains =
                        |[before, own]: &[Likeness; 2]| own.gain_over(before) >= MIN_SOURCE_GAIN_DB;
                    better.extend(compared.filter(gains).map(|both| (candidate, fit, both)));
                }
                Ok::<(), RenderError>(())
            };
            let general_rule = self.under(before).general_rule();
            for placement in placements(before.placement, hints) {
                // If the rule ignores the principal point, a shift to that point is due to the rule, not to the file.
                let moved = [0, 1].map(|axis| placement.shift[axis] - before.placement.shift[axis]);
                if general_rule.is_some() && self.is_ignored_offset(moved) {
                    continue;
                }
                consider(
                    FileReading {
                        placement,
                        ..*before
                    },
                    &decoded,
                )?;
            }
            if general_rule.is_some() {
                let rule = general_rule;
                consider(FileReading { rule, ..*before }, &decoded)?;
            }
            for rule in other_rules(self.under(before).rule) {
                let rule = Some(rule);
                consider(FileReading { rule, ..*before }, &decoded)?;
            }
            let map = before.placement.camera_from_file(self.source);
            let seen = Seen::of(&decoded, map, &self.intrinsics());
            let mut stored = decoded.subset(&seen.members);
            before.stored.encode(&mut stored);
            for candidate in numbers(before, &stored, seen.layers > WIDE_LAYERS) {
                let mut decoded = stored.clone();
                candidate.stored.decode(&mut decoded);
                consider(candidate, &decoded)?;
            }
            if better.is_empty() {
                break;
            }
            let recoded = |reading: &FileReading| {
                let mut recoded = decoded.clone();
                before.stored.encode(&mut recoded);
                reading.stored.decode(&mut recoded);
                recoded
            };
            let of_others = |reading: &FileReading| {
                let placed = reading.placement.camera_from_file(self.source);
                self.fit_elsewhere(&recoded(reading), placed, reading, neighbours)
            };
            let area = |reading: &FileReading| {
                let trial = self.under(reading);
                trial.mean_area(&recoded(reading), reading.placement)
            };
            let fit_elsewhere = of_others(before)?;
            let mut chosen: Option<(FileReading, Likeness, f64)> = None;
            for (candidate, fit, [own_before, own]) in better {
                let elsewhere = of_others(&candidate)?;
                let all_before = own_before.joined(&fit_elsewhere);
                let all = own.joined(&elsewhere);
                let gain = all.gain_over(&all_before);
                let recolors = candidate.stored.colors != before.stored.colors;
                let is_closer = |own: &Likeness, other: &Likeness| {
                    let gain = own.gain_over(other);
                    let is_form = gain >= MIN_RECOLORED_GAIN_DB
                        || gain >= MIN_EXACT_RECOLORED_GAIN_DB && own.is_as_near_as_exposed(other);
                    own.is_closer_than(other) || recolors && is_form && own.is_nearer_than(other)
                };
                let is_better = own.explains()
                    && (is_closer(&own, &own_before) || is_closer(&all, &all_before));
                let is_shift = candidate.placement.shift != before.placement.shift;
                let is_large = own.gain_over(&own_before) >= UNCONFIRMED_SHIFT_GAIN_DB;
                let is_rule = candidate.rule != before.rule && candidate.rule != general_rule;
                // Narrower Gaussians may merely copy the photograph's noise.
                let is_sharpened = candidate.stored.scales != before.stored.scales
                    && area(&candidate) < area(before);
                let must_improve =
                    is_shift && !is_large || is_rule || is_sharpened || self.of_several_views;
                let zooms = [0, 1].map(|axis| {
                    let [own, other] = [&candidate, before].map(|reading| reading.placement.focal);
                    (own[axis] / other[axis] - 1.0).abs()
                });
                let zoom = zooms.into_iter().fold(0.0, f64::max);
                let is_chance = zoom > 0.0
                    && zoom < SMALL_ZOOM
                    && (fit.gain_over(fit_before) < MIN_SMALL_ZOOM_GAIN_DB
                        || self.covered(&decoded, map)? < 1.0 - MIN_HOLES);
                let allowed = if must_improve {
                    MAX_ERROR_OF_IMPROVED
                } else {
                    MAX_ERROR_ELSEWHERE
                };
                let worse = elsewhere.error() > allowed * fit_elsewhere.error()
                    || is_shift && neighbours.is_empty();
                // Only the source decides between two forms of colours: in other views, wrong geometry causes blur,
                // which paler colours hide.
                let is_closest = chosen.as_ref().is_none_or(|(other, its_fit, its_gain)| {
                    let is_decided = candidate.placement == other.placement
                        && fit.gain_over(its_fit).abs() >= MIN_DECISIVE_GAIN_DB;
                    if is_decided || recolors && other.stored.colors != before.stored.colors {
                        fit.error() < its_fit.error()
                    } else {
                        gain > *its_gain
                    }
                });
                let is_weak_rule = is_rule && fit.gain_over(fit_before) < MIN_RULE_GAIN_DB;
                let may_be_too_wide =
                    hints.is_blurred || hints.is_lost || seen.layers > WIDE_LAYERS;
                let is_noise = is_sharpened
                    && !(may_be_too_wide
                        && self.fits_between([&decoded, &recoded(&candidate)], map)?);
                let is_off = is_shift
                    && candidate.placement.focal == before.placement.focal
                    && !self.brings_colors_nearer(&decoded, before, candidate.placement);
                // Skip orders of quaternions that show the Gaussians more edge-on and gain little: they would only sharpen
                // a rendering whose Gaussians are too wide.
                let is_narrower = candidate.stored.quaternions != before.stored.quaternions
                    && fit.gain_over(fit_before) < MIN_NARROWER_GAIN_DB
                    && area(&candidate) < MIN_FACING_AREA * area(before);
                let is_misleading = is_narrower || is_chance || is_weak_rule || is_noise || is_off;
                if is_better && !worse && is_closest && !is_misleading {
                    chosen = Some((candidate, fit, gain));
                }
            }
            match chosen {
                Some((candidate, fit, _)) => best = (candidate, fit),
                None => break,
            }
        }
        let (other, fit) = self.simplest(gaussians, reading, best, neighbours)?;
        Ok((other != *reading).then_some((other, fit)))
    }

    /// Reverts each changed setting that can be reverted without making the reading significantly worse: such a change
    /// only compensated for another setting.
    fn simplest(
        &self,
        gaussians: &Gaussians,
        reading: &FileReading,
        mut best: (FileReading, Likeness),
        neighbours: &[Trial<'_>],
    ) -> Result<(FileReading, Likeness), RenderError> {
        let all = |(other, fit): &(FileReading, Likeness)| {
            let mut recoded = gaussians.clone();
            reading.stored.encode(&mut recoded);
            other.stored.decode(&mut recoded);
            let placed = other.placement.camera_from_file(self.source);
            let elsewhere = self.fit_elsewhere(&recoded, placed, other, neighbours)?;
            Ok::<_, RenderError>(fit.joined(&elsewhere))
        };
        let settings = reading.changes_from(&best.0);
        for (key, value) in settings.iter().filter(|_| settings.len() > 1) {
            let mut fewer = best.0;
            if fewer.set(key, value).is_ok()
                && fewer != *reading
                && let Some(fit) = self.fit_read(gaussians, reading, &fewer)?
            {
                // Misread quaternions turn Gaussians at random, which may fill holes that are due to another wrong
                // setting.
                let is_weak = *key == "quaternions" && best.1.gain_over(&fit) < RULED_OUT_LOSS_DB;
                let fewer = (fewer, fit);
                let is_needed = || -> Result<bool, RenderError> {
                    let is_nearer = best.1.is_nearer_than(&fewer.1);
                    Ok(is_nearer || all(&best)?.is_nearer_than(&all(&fewer)?))
                };
                if is_weak || !is_needed()? {
                    best = fewer;
                }
            }
        }
        Ok(best)
    }

    /// Whether other views allow replacing the first Gaussians, with the map that places them, by the second ones. If the
    /// Gaussians were made from several views, the error in the views `elsewhere` must decrease, too. Always true if they
    /// were made from one view, or if `elsewhere` is empty.
    pub(super) fn is_borne_out(
        &self,
        both: [(&Gaussians, DAffine3); 2],
        reading: &FileReading,
        elsewhere: &[Trial<'_>],
    ) -> Result<bool, RenderError> {
        if !self.of_several_views || elsewhere.is_empty() {
            return Ok(true);
        }
        let [own, other] = both.map(|(of, map)| self.fit_elsewhere(of, map, reading, elsewhere));
        Ok(other?.error() <= MAX_ERROR_OF_IMPROVED * own?.error())
    }

    /// Compares the Gaussians, rendered into other views, with the photographs of these views. `camera_from_file` places
    /// them in the source's camera.
    fn fit_elsewhere(
        &self,
        gaussians: &Gaussians,
        camera_from_file: DAffine3,
        reading: &FileReading,
        elsewhere: &[Trial<'_>],
    ) -> Result<Likeness, RenderError> {
        let mut joined = Likeness::default();
        for other in elsewhere {
            let placed = self.source.to(other.source).to_affine() * camera_from_file;
            let black = RgbImage::new(other.region.width, other.region.height);
            let nothing = || Likeness::of(other.photograph, other.region, &black);
            let fit = other.under(reading).fit(gaussians, placed)?;
            let fit = fit.unwrap_or_else(nothing);
            joined = joined.joined(&fit);
        }
        Ok(joined)
    }
}

pub(in crate::evaluate) struct Seen {
    pub(in crate::evaluate) members: Vec<usize>,
    /// Average number of Gaussians that cover a pixel.
    pub(in crate::evaluate) layers: f64,
}

impl Seen {
    /// Bounds each Gaussian by its centre and largest standard deviation; this overestimates its
    /// extent.
    pub(in crate::evaluate) fn of(
        gaussians: &Gaussians,
        camera_from_file: DAffine3,
        k: &Intrinsics,
    ) -> Self {
        let linear = camera_from_file.matrix3;
        let stretch = [linear.x_axis, linear.y_axis, linear.z_axis].map(DVec3::length);
        let stretch = stretch.into_iter().fold(0.0, f64::max);
        let (width, height) = (f64::from(k.width), f64::from(k.height));
        let mut members = Vec::new();
        let mut area = 0.0;
        for (index, mean) in gaussians.means.iter().enumerate() {
            let p = camera_from_file.transform_point3(DVec3::from(mean.map(f64::from)));
            if !(p.z > 0.01 && gaussians.is_finite(index)) {
                continue;
            }
            let scale = gaussians.scales[index].into_iter().fold(0.0, f32::max);
            // 3.33 standard deviations, times 1.5 for perspective stretch off the axis.
            let reach = 5.0 * f64::from(scale) * stretch / p.z;
            let along = |middle: f64, reach: f64, side: f64| {
                ((middle + reach).min(side) - (middle - reach).max(0.0)).max(0.0)
            };
            let across = along(k.fx * p.x / p.z + k.cx, k.fx * reach + 1.0, width);
            let down = along(k.fy * p.y / p.z + k.cy, k.fy * reach + 1.0, height);
            if across > 0.0 && down > 0.0 {
                members.push(index);
                area += across * down;
            }
        }
        Self {
            members,
            layers: area / (width * height),
        }
    }
}
