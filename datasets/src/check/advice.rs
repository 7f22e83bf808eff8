//! Sentences about a better-fitting interpretation, with the setting that selects it.

use std::ops::RangeInclusive;

use glam::DVec2;

use super::change::{Change, Focal, Moves};
use super::convention::PICTURES_TURNED;
use super::explained::Explained;
use super::small_view::Part;
use crate::{DatasetSpec, View};

/// Plausible range of scene depths, in metres.
pub(super) const DEPTHS_M: RangeInclusive<f64> = 0.05..=2000.0;

/// Facts about a dataset that advice depends on: its settings for units, whether it has a setting
/// for masks, and how it stores poses.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Units {
    /// Metres per unit of the poses; `None` if the dataset has no setting for the unit.
    scale: Option<f64>,
    /// Metres per unit of depth maps; `None` if the dataset has no setting for the unit.
    depth_unit: Option<f64>,
    /// True if depth comes from the points of a model; `scale` then multiplies points and poses alike.
    is_of_points: bool,
    /// True if the dataset has the setting `masks`, which says whether black or white pixels are
    /// kept.
    has_mask_sides: bool,
    pub(super) poses_are_matrices: bool,
}

impl Units {
    pub fn of(spec: &DatasetSpec) -> Self {
        let value = |key: &str| spec.setting(key).parse().ok();
        let is_of_points = spec.setting("depth") == "points";
        Self {
            scale: value("scale"),
            depth_unit: value("depth-unit").filter(|_| !is_of_points),
            is_of_points,
            has_mask_sides: spec.has_mask_sides(),
            poses_are_matrices: spec.entry.poses_are_matrices,
        }
    }

    /// Text to append to a contradiction; names inverted masks as another possible cause.
    /// `excluded` is the fraction of pixels that the masks exclude.
    pub(super) fn inverted_masks(self, excluded: f64) -> String {
        let setting = if self.has_mask_sides {
            " (masks=keep-black keeps black pixels, masks=keep-white white ones)"
        } else {
            ""
        };
        let percent = 100.0 * excluded;
        format!(
            "; or perhaps the masks are inverted, because they exclude {percent:.0} % of the pixels{setting}"
        )
    }

    /// Metres per unit of the poses; 1 without a setting.
    pub(super) fn pose_unit_m(self) -> f64 {
        self.scale.unwrap_or(1.0)
    }

    /// Metres per unit of depth maps; 1 without a setting.
    pub(super) fn depth_unit_m(self) -> f64 {
        self.depth_unit.unwrap_or(1.0)
    }

    /// Names the settings for the units of depth and poses; if the dataset has neither setting,
    /// asks whether its unit is correct.
    pub(super) fn where_to_set(self) -> &'static str {
        match (self.scale, self.depth_unit) {
            (Some(_), Some(_)) => "set depth-unit=, and scale= for the poses",
            (Some(_), None) => "set scale=",
            (None, Some(_)) => "set depth-unit=",
            (None, None) => "is its unit correct?",
        }
    }
}

/// Describes a `change` to the dataset reader's interpretation that fits better, followed by the
/// `evidence`.
pub(super) fn sentence(
    change: &Change,
    evidence: &str,
    units: Units,
    median_m: f64,
    views: &[View],
) -> String {
    let Some(first) = views.first().map(|view| view.intrinsics) else {
        return evidence.to_owned();
    };
    match change {
        Change::Scale(scale) => {
            let (fits, or) = scaled(*scale, units, median_m);
            format!("{fits} fits better ({evidence}){or}")
        }
        Change::Inverse(scale) => {
            let fits = match units.depth_unit {
                Some(unit) => {
                    let unit = number(unit * scale);
                    format!("depth-kind=inverse,depth-unit={unit} fits better")
                }
                None => "the stored depth is the reciprocal of depth".to_owned(),
            };
            format!("{fits} ({evidence})")
        }
        Change::Buffer(near) => format!(
            "the stored depth is that of a z-buffer with its near plane at about {} m ({evidence}); convert it to metres: z = \
             near · far / (far − value · (far − near)) for values from 0 to 1",
            number(*near)
        ),
        Change::InverseBetween(near, far) => format!(
            "the stored depth is the reciprocal of depth, normalised between about {} m and about {} m ({evidence}); convert \
             it to metres: 1 / z = 1 / far + value · (1 / near − 1 / far) for values from 0 to 1",
            number(*near),
            number(*far)
        ),
        Change::Planes { scale, by } => {
            let (factor, offset) = (
                number(1.0 / scale),
                number(units.pose_unit_m() * by / scale),
            );
            format!(
                "depth was probably normalised between a near and a far distance, because depth times about {factor} plus \
                 about {offset} m fits better ({evidence}); convert the depth maps to metres"
            )
        }
        Change::RayLength => {
            let fits = match units.depth_unit {
                Some(_) => "depth-kind=ray fits better",
                None => "the stored depth is the length of rays, not z",
            };
            format!("{fits} ({evidence})")
        }
        Change::NoRayLength => {
            let fits = match units.depth_unit {
                Some(_) => "depth-kind=z fits better",
                None => "the stored depth is already z, not the length of rays",
            };
            format!("{fits} ({evidence})")
        }
        Change::Focal(which, factor) => {
            let (what, read) = match which {
                Focal::Both => ("the focal length", first.fx),
                Focal::X => ("fx", first.fx),
                Focal::Y => ("fy", first.fy),
            };
            let (one, other) = (number(read * factor), number(read));
            format!(
                "{what} should be {} times as long, {one} instead of {other} pixels ({evidence}); correct it in the \
                 cameras' file",
                number(*factor)
            )
        }
        Change::CentreSwapped => {
            let (cx, cy) = (number(first.cx), number(first.cy));
            format!(
                "cx and cy appear to be swapped, because cx = {cy} and cy = {cx} fit better ({evidence}); swap them \
                 in the cameras' file"
            )
        }
        Change::CentreOff(off) => {
            let off = *off * f64::from(first.width);
            let [x, y] = [first.cx + off.x, first.cy + off.y].map(number);
            let (cx, cy) = (number(first.cx), number(first.cy));
            format!(
                "cx and cy should be about {x} and {y} instead of {cx} and {cy} ({evidence}); correct them in the \
                 cameras' file"
            )
        }
        Change::Short(by) => {
            let (metres, than_stored) = (
                number(by.abs()),
                if *by < 0.0 { "smaller" } else { "larger" },
            );
            format!(
                "depths should be {metres} m {than_stored} ({evidence}); correct the depth maps"
            )
        }
        Change::Convention(name) => {
            let turned = views.iter().filter(|_| *name == PICTURES_TURNED);
            let mut turned = turned.filter_map(|v| v.content.image_otherwise_turned().ok()?);
            match turned.next() {
                Some((_, setting)) => format!(
                    "the pictures are turned by 180 degrees; {setting} fits better ({evidence})"
                ),
                None => format!(
                    "the pose convention looks wrong; the poses fit better if read with {name} ({evidence})"
                ),
            }
        }
        Change::Views(sentence) | Change::Shifted(sentence) => sentence.clone(),
        Change::Unlisted => format!("pictures and poses contradict each other ({evidence})"),
        Change::Cameras(how) => format!("{how} ({evidence}); correct the cameras' file"),
        Change::Bent(by) => {
            let is_undone = |view: &View| view.content.processing().undistorted.is_some();
            if views.iter().any(is_undone) {
                format!(
                    "the distortion in the cameras' file does not fit the pictures, which fit better with k1 changed by \
                     about {} ({evidence}); correct the coefficients, or remove them if the pictures were undistorted already",
                    number(-by)
                )
            } else {
                format!(
                    "lens distortion was left in, with a k1 of about {} ({evidence}); undistort the pictures, or put the \
                     coefficients into the cameras' file",
                    number(-by)
                )
            }
        }
        Change::Registered(by) => {
            let size = (by.zoom != 1.0).then(|| {
                if by.zoom < 1.0 {
                    format!("enlarged {} times", number(1.0 / by.zoom))
                } else {
                    format!("reduced to {} of its size", number(1.0 / by.zoom))
                }
            });
            let off = -by.off * f64::from(first.width) / by.zoom;
            // Addition turns -0 into 0.
            let off = off.round() + DVec2::ZERO;
            let place = (by.off != DVec2::ZERO)
                .then(|| format!("shifted by about ({}, {}) pixels", off.x, off.y));
            let how: Vec<String> = size.into_iter().chain(place).collect();
            format!(
                "the depth maps are not aligned with the photographs; they fit if {} ({evidence}); project them into \
                 the cameras of the photographs",
                how.join(" and ")
            )
        }
        Change::Turned(setting) => format!("{setting} fits better ({evidence})"),
        Change::Flipped(part, how) => {
            let what = match part {
                Part::Picture => "pictures",
                Part::Depth => "depth maps",
            };
            format!("the {what} are {how} ({evidence})")
        }
        Change::Order(how, moves) => {
            let (what, correct) = match moves {
                Moves::Depth => ("depth maps", "the names of the depth maps"),
                _ => ("poses", "the list of poses"),
            };
            format!(
                "pictures and {what} are assigned incorrectly: {how} ({evidence}); correct {correct}"
            )
        }
    }
}

/// Returns the setting that brings poses and depth to the same unit or, if no setting exists, a description of the
/// required unit. The second text is about an alternative; empty if there is none.
///
/// If depth is implausible as read, or there is no setting for the poses' unit, the unit of depth
/// is changed, without an alternative. Otherwise, the poses' unit is changed, and a change of the
/// depth unit is the alternative. A depth unit that makes depth implausible is never suggested.
fn scaled(scale: f64, units: Units, median_m: f64) -> (String, String) {
    if units.is_of_points {
        let factor = number(scale);
        let other = "; use points and poses from the same model, because no setting scales only one of them";
        let fits = format!("a unit of the poses that is {factor} times that of the points");
        return (fits, other.to_owned());
    }
    let poses = units
        .scale
        .map(|unit| format!("scale={}", number(unit * scale)));
    let depth = units
        .depth_unit
        .map(|unit| format!("depth-unit={}", number(unit / scale)));
    let is_plausible = |depth: f64| DEPTHS_M.contains(&depth);
    let depth = depth.filter(|_| is_plausible(median_m / scale));
    let alone = |fits: String| (fits, String::new());
    match (poses, depth) {
        (_, Some(depth)) if !is_plausible(median_m) => alone(depth),
        (Some(poses), Some(depth)) => (
            poses,
            format!(", or {depth} if the poses are in metres and the depth is not"),
        ),
        (Some(poses), None) => alone(poses),
        (None, Some(depth)) => alone(depth),
        (None, None) => alone(format!(
            "a unit of the poses that is {} times as long",
            number(scale)
        )),
    }
}

/// Describes, with numbers, how much better another interpretation fits neighbouring views.
pub(super) fn evidence(as_read: &Explained, other: &Explained) -> String {
    let mut parts = Vec::new();
    let [after, before] = [other, as_read].map(|read| format!("{:.1}", 100.0 * read.agreement()));
    // Equal numbers would show no improvement.
    if other.meets_depth() && (after != before || other.colour_levels().is_none()) {
        parts.push(format!(
            "{after} % of depths agree between neighbouring views instead of {before} %"
        ));
    }
    if let Some(levels) = other.colour_levels() {
        let before = as_read.colour_levels();
        let before = before.map_or(String::new(), |before| format!(" instead of {before:.1}"));
        parts.push(format!("colours differ by {levels:.1} levels{before}"));
    }
    parts.join(", ")
}

/// Formats a number with at most four digits, without trailing zeros.
pub(super) fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let places = (3 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{value:.places$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}
