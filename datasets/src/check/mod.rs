//! Checks a dataset before a long run: reports what is present, what is broken and why, and whether poses, depth and
//! pictures are consistent.
//!
//! * `convention`: common mistakes in poses.
//! * [`consistency`][]: agreement of depth and colours projected from view to view.
//! * `small_view`, `neighbours`, `explained`, `change`, `fit`: alternative interpretations of poses, cameras and depth,
//!   fitted to reduced views.
//! * `one_view`, `some_views`, `shifted`: interpretations that affect some views only.
//! * `still`: poses that stay the same while the pictures move, and pictures that stay the same while the poses move.
//! * `stereo`, `block_match`: interpretations of a rectified pair and its disparities.
//! * `features`: interpretations of poses without depth.
//! * `orders`: other assignments of pictures to poses; `search`: search for the best-fitting factor.
//! * `registered`, `z_buffer`, `overflow`: depth of another camera, of a renderer's z-buffer, or beyond 16 bits.
//! * `calibration`: calibrations of another scene; `plausible`: implausible values.
//! * [`advice`][]: a sentence on a better fit, with the setting that selects it.

pub mod advice;
mod block_match;
mod calibration;
mod change;
mod compare;
pub mod consistency;
mod convention;
mod depth_values;
mod explained;
mod features;
mod fit;
mod floor;
mod neighbours;
mod one_view;
mod orders;
mod overflow;
mod plausible;
mod registered;
mod search;
mod shifted;
mod small_view;
mod some_views;
mod stereo;
mod still;
mod z_buffer;

use std::collections::BTreeSet;

use rayon::prelude::*;
use serde::Serialize;

use crate::found_scenes::by_reason;
use crate::registry::open_each;
use crate::spec::SettingInForce;
use crate::view::{evenly_spaced, without_depth};
use crate::{DatasetError, DatasetSpec, Pairing, Scene, View};
use advice::Units;
pub use calibration::copied_calibrations;
use consistency::Consistency;
use features::Matches;
use neighbours::Neighbours;

/// Results of checking a dataset.
#[derive(Debug, Clone, Serialize)]
pub struct DatasetReport {
    pub dataset: String,
    pub readings: Vec<SettingInForce>,
    /// Scenes in the order in which the dataset reader returns them.
    pub scenes: Vec<SceneReport>,
    /// Scenes that are broken or incomplete: one line per reason, which names the file.
    pub unreadable: Vec<String>,
    /// Scenes excluded by settings, one line per reason; not counted as problems.
    pub ruled_out: Vec<String>,
    /// Number of problems in all scenes, including unreadable ones.
    pub problems: usize,
}

/// Results of checking a scene.
#[derive(Debug, Clone, Serialize)]
pub struct SceneReport {
    pub id: String,
    pub views: usize,
    pub decoded: usize,
    /// Sizes of the pictures in ascending order, `WIDTHxHEIGHT`.
    pub sizes: Vec<String>,
    /// Number of decoded views that have depth.
    pub with_depth: usize,
    /// Mean fraction of pixels with depth, 0..1, over the views that have any.
    pub depth_coverage: Option<f64>,
    /// Consistency of depth, pictures and poses, if two neighbouring views have depth.
    pub consistency: Option<Consistency>,
    /// Assumptions made and data skipped by the reader.
    pub notes: Vec<String>,
    /// Distinct problems; each names the file.
    pub problems: Vec<String>,
}

/// Opens a dataset and checks every scene. At most `views_per_scene` views per scene are decoded,
/// evenly spaced; for all other views, only the existence of the files is checked. `done` is called
/// after each scene with the number of finished scenes and the total.
///
/// # Errors
/// If the dataset cannot be opened at all; all other errors are in the report.
pub fn check(
    spec: &DatasetSpec,
    views_per_scene: usize,
    done: &(dyn Fn(usize, usize) + Sync),
) -> Result<DatasetReport, DatasetError> {
    let found = open_each(spec)?;
    let mut reports = Vec::new();
    for (i, scene) in found.scenes.iter().enumerate() {
        let mut report = check_scene(scene, views_per_scene, spec);
        report.notes.extend(without_pairs(spec, scene));
        reports.push(report);
        done(i + 1, found.scenes.len());
    }
    for (i, text) in copied_calibrations(&found.scenes) {
        let problem = format!("{}: {text}", reports[i].id);
        reports[i].problems.push(problem);
    }
    let of_kind = |by_choice: bool| -> Vec<String> {
        let groups = by_reason(&found.left_out).into_iter();
        let groups = groups.filter(|group| group.by_choice == by_choice);
        groups.map(|group| group.to_string()).collect()
    };
    let broken = found.left_out.iter().filter(|scene| scene.why.is_fault());
    Ok(DatasetReport {
        dataset: spec.to_string(),
        readings: spec.readings(),
        problems: broken.count() + reports.iter().map(|r| r.problems.len()).sum::<usize>(),
        scenes: reports,
        unreadable: of_kind(false),
        ruled_out: of_kind(true),
    })
}

/// Results of decoding one view.
struct Decoded {
    problems: Vec<String>,
    coverage: Option<f64>,
    /// Minimum and maximum level; `None` if the picture cannot be decoded.
    levels: Option<(u8, u8)>,
}

/// The source of depth that the user requested explicitly.
fn demanded_depth(spec: &DatasetSpec) -> Option<&str> {
    let source = spec.settings.get("depth").map(String::as_str);
    source.filter(|source| !matches!(*source, "auto" | "none"))
}

/// Note on a scene without depth, for which no pairs can be chosen, with the settings that help.
fn without_pairs(spec: &DatasetSpec, scene: &Scene) -> Option<String> {
    let without = without_depth(&scene.views) == scene.views.len();
    let own = match spec.entry.format {
        "colmap" => {
            "put depth maps with the pictures' names into depth/; or set depth=points (sparse); or "
        }
        "nerfstudio" => "set depth_file_path of each frame to its depth map; or ",
        _ => "",
    };
    (scene.pairing == Pairing::MultiView && without).then(|| {
        format!(
            "no view has depth, so no pair can be selected; {own}measure overlap with your own depth maps in metres \
             (--pair-options overlap=given-metric with --overlap-depth DIR); or select pairs without overlap \
             (--pair-options missing-depth=accept)"
        )
    })
}

/// Extent of a check: how many views, depth values and interpretations it examines.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    /// Number of pairs of neighbouring views.
    pairs: usize,
    /// Number of depth values per view that are projected.
    samples: usize,
    /// True if the views around the examined pairs are also examined.
    thorough: bool,
}

const THOROUGH: Effort = Effort {
    pairs: 4,
    samples: 8000,
    thorough: true,
};
const QUICK: Effort = Effort {
    pairs: 2,
    samples: 1200,
    thorough: false,
};

/// Indices of the views whose pixels [`contradictions`] reads.
pub fn looked_at(scene: &Scene) -> BTreeSet<usize> {
    match scene.pairing {
        Pairing::Stereo { source, target } => BTreeSet::from([source, target]),
        _ => still::looked_at(&scene.views, QUICK),
    }
}

/// Contradictions and implausible values in a few views of a scene, one sentence each with cause and remedy. Empty for
/// a valid scene.
pub fn contradictions(scene: &Scene, units: Units) -> Vec<String> {
    look(scene, units, QUICK).contradictions
}

/// Result of examining some views of a scene.
struct Look {
    contradictions: Vec<String>,
    consistency: Option<Consistency>,
    /// A note for the report. If the views have no depth, it says how well the poses agree with matching features; if they
    /// have, the thorough check notes here that neighbouring views differ in exposure.
    note: Option<String>,
}

fn photographs(scene: &Scene) -> usize {
    let views = scene.views.iter();
    views.filter(|view| view.content.has_photograph()).count()
}

fn look(scene: &Scene, units: Units, effort: Effort) -> Look {
    let neighbours = match (&scene.pairing, effort.thorough) {
        // A single depth map is enough to judge a stereo pair.
        (Pairing::Stereo { .. }, false) => None,
        _ => Neighbours::new(&scene.views, effort),
    };
    let is_centre_right = neighbours.as_ref().is_some_and(Neighbours::confirm_centre);
    let mut contradictions = plausible::cameras(&scene.views, is_centre_right);
    let mut note = None;
    let floor = |matches: &Matches<'_>, neighbours: Option<&Neighbours<'_>>| {
        let rounded = || plausible::rounded(&scene.views, units).unwrap_or_default();
        floor::contradiction(matches, neighbours).map(|text| text + &rounded())
    };
    let overflowed = overflow::overflowed(&scene.views, effort);
    let is_known = overflowed.is_some() || plausible::are_of_other_size(&scene.views);
    contradictions.extend(overflowed);
    let still = || {
        let one_pose = plausible::one_pose(&scene.views);
        one_pose.or_else(|| still::frozen_poses(&scene.views, effort))
    };
    let repeated = |mut same: BTreeSet<usize>| {
        same.extend(still::same_files(&scene.views, effort));
        still::repeated_pictures(&scene.views, &same, effort)
    };
    contradictions.extend(match (&scene.pairing, &neighbours) {
        // An overflow or a wrong calibration also makes the following tests fail, so they would not reveal any other
        // error.
        _ if is_known => None,
        (Pairing::Stereo { .. }, _) => {
            let (contradiction, said) = stereo::contradictions(&scene.views, effort);
            note = said;
            contradiction
        }
        (_, Some(neighbours)) => {
            let contradiction = still().or_else(|| neighbours.repeated());
            let contradiction = contradiction.or_else(|| repeated(BTreeSet::new()));
            let contradiction = contradiction.or_else(|| neighbours.contradictions(units));
            if effort.thorough {
                note = neighbours.exposures();
            }
            // If no interpretation of depth explains the views, features may still show which pictures belong to which
            // poses.
            contradiction.or_else(|| {
                let is_suspicious = effort.thorough
                    || neighbours.is_poorly_explained()
                    || neighbours.has_little_scan_depth();
                // Colours that fit show which matches of repeated patterns are wrong.
                let matches = is_suspicious.then(|| Matches::new(&scene.views, effort, false))?;
                let named = effort
                    .thorough
                    .then(|| matches.contradiction(units))
                    .flatten();
                named.or_else(|| floor(&matches, Some(neighbours)))
            })
        }
        // With virtual views, there may not be two pictures to compare.
        (_, None) if photographs(scene) < 2 => None,
        (_, None) => {
            let matches = Matches::new(&scene.views, effort, true);
            note = Some(matches.note());
            let named = still().or_else(|| repeated(matches.repeated.clone()));
            let named = named.or_else(|| matches.contradiction(units));
            let named = named.or_else(|| {
                let is_open = !effort.thorough && matches.is_poorly_explained();
                let all = is_open.then(|| Matches::new(&scene.views, THOROUGH, true));
                all?.contradiction(units)
            });
            named.or_else(|| floor(&matches, None))
        }
    });
    if let Some(share) = neighbours.as_ref().and_then(Neighbours::excluded) {
        for text in &mut contradictions {
            *text += &units.inverted_masks(share);
        }
    }
    if contradictions.is_empty() {
        contradictions.extend(plausible::depth_outside_masks(&scene.views, effort, units));
    }
    if !effort.thorough {
        contradictions.extend(neighbours.as_ref().and_then(Neighbours::blank));
    }
    Look {
        contradictions,
        consistency: neighbours.as_ref().and_then(Neighbours::consistency),
        note,
    }
}

fn check_scene(scene: &Scene, views_per_scene: usize, spec: &DatasetSpec) -> SceneReport {
    let depth = demanded_depth(spec);
    let chosen = evenly_spaced(scene.views.len(), views_per_scene);
    let decoded: Vec<Decoded> = chosen
        .par_iter()
        .map(|&i| decode(&scene.views[i]))
        .collect();
    let left_out = scene.left_out.iter().map(ToString::to_string);
    let of_views = decoded.iter().flat_map(|d| d.problems.clone());
    let mut problems: Vec<String> = left_out.chain(of_views).collect();
    let mut missing = BTreeSet::new();
    for (i, view) in scene.views.iter().enumerate() {
        if !chosen.contains(&i) {
            let files = view.content.files();
            missing.extend(files.into_iter().filter(|file| !file.is_file()));
        }
    }
    problems.extend(
        missing
            .iter()
            .map(|file| format!("{}: does not exist", file.display())),
    );
    let ids: BTreeSet<_> = scene.views.iter().map(|v| &v.id).collect();
    if ids.len() < scene.views.len() {
        problems.push(format!("{}: two views have the same id", scene.id));
    }
    if scene.views.len() < 2 {
        problems.push(format!(
            "{}: fewer than two views, so there are no pairs",
            scene.id
        ));
    }
    if let Some(source) = depth
        && without_depth(&scene.views) == scene.views.len()
    {
        problems.push(format!(
            "{}: depth={source} was requested, but no picture has such depth",
            scene.id
        ));
    }
    // One broken file may affect a picture and its depth, or every view; report it once.
    let mut seen = BTreeSet::new();
    problems.retain(|problem| seen.insert(problem.clone()));
    let coverages: Vec<f64> = decoded.iter().filter_map(|d| d.coverage).collect();
    let Look {
        mut contradictions,
        consistency,
        note,
    } = look(scene, Units::of(spec), THOROUGH);
    let levels = chosen.iter().zip(&decoded);
    let levels = levels.map(|(i, decoded)| (scene.views[*i].id.as_str(), decoded.levels));
    contradictions.extend(plausible::pictures(&levels.collect::<Vec<_>>()));
    let of_scene = |complaint| format!("{}: {complaint}", scene.id);
    problems.extend(contradictions.into_iter().map(of_scene));
    let sizes: BTreeSet<(u32, u32)> = scene
        .views
        .iter()
        .map(|v| (v.intrinsics.width, v.intrinsics.height))
        .collect();
    SceneReport {
        id: scene.id.clone(),
        views: scene.views.len(),
        decoded: chosen.len(),
        sizes: sizes.iter().map(|(w, h)| format!("{w}x{h}")).collect(),
        with_depth: coverages.len(),
        depth_coverage: (!coverages.is_empty())
            .then(|| coverages.iter().sum::<f64>() / coverages.len() as f64),
        consistency,
        notes: scene
            .notes
            .iter()
            .chain(&scene.warnings)
            .cloned()
            .chain(note)
            .collect(),
        problems,
    }
}

fn decode(view: &View) -> Decoded {
    let mut problems = Vec::new();
    let mut levels = None;
    match view.content.image() {
        Err(DatasetError::NoPhotograph) => {}
        Ok(image) => levels = image.iter().min().copied().zip(image.iter().max().copied()),
        Err(error) => problems.push(error.to_string()),
    }
    let coverage = match view.content.depth() {
        Ok(Some(depth)) => {
            let valid = depth.iter().filter(|z| **z > 0.0).count();
            if valid == 0 {
                let is_scan = view.content.processing().depth_by_pose;
                let cause = is_scan.then(|| format!("; {}", floor::MISPLACED_SCAN));
                problems.push(format!(
                    "{}: no pixel has depth{}",
                    view.id,
                    cause.unwrap_or_default()
                ));
            }
            Some(valid as f64 / depth.len().max(1) as f64)
        }
        Ok(None) => None,
        Err(error) => {
            problems.push(error.to_string());
            None
        }
    };
    Decoded {
        problems,
        coverage,
        levels,
    }
}

#[cfg(test)]
mod tests;
