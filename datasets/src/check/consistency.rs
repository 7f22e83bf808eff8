//! Whether poses, depth and pictures agree: depth of one view, carried into the next by the poses, must meet that
//! view's depth, and its colours that view's colours. Poses read in the wrong convention fail this, and the convention
//! that would have passed can be named. Far-apart views tell by depth, close ones only by colour: there, depth agrees
//! under any pose.

use serde::Serialize;

use super::carried::{Carried, LoadedView};
use super::convention::CONVENTIONS;
use super::evenly_spaced;
use crate::View;

/// Pairs of neighbouring views that are looked at.
const PAIRS: usize = 4;
/// Depths that meet must agree at least this often in one pair of neighbours. Occlusion costs the
/// right poses some of it; on real frames read wrongly a fifth agrees.
const LEAST: f64 = 0.3;
/// Another convention is better by depth when it has this many times the agreement, and this much.
const MORE_DEPTH: (f64, f64) = (1.5, 0.2);
/// Another convention is better by colour when the energy of the differences is below this share: 3 dB.
const LESS_COLOUR: f64 = 0.5;

/// How well neighbouring views fit together under one convention for poses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Fit {
    /// The mistake that the reader would have made; `as read` for none.
    pub convention: &'static str,
    /// The share of depth values that agree within 5 %, 0..1.
    pub depth: f64,
    /// Root mean square difference of the colours of the values that land inside the other picture and meet no other
    /// depth there, 8-bit levels; `None` if none does.
    pub colour_levels: Option<f64>,
    pub colours: usize,
}

/// How well a scene's poses, depth and pictures agree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Consistency {
    /// As the reader takes the poses.
    pub as_read: Fit,
    /// Under the conventions that they are commonly mistaken for.
    pub otherwise: Vec<Fit>,
    /// Of the depth values that meet one of the other view, the share that agrees, in the pair in
    /// which it is largest; `None` where too few meet (neighbours that see different things, or
    /// sparse depth).
    pub meeting: Option<f64>,
    /// There: the median of the other view's depth over the depth carried to it, 1 where poses and
    /// depth have the same unit.
    pub unit_ratio: Option<f64>,
    /// Pairs of views that were looked at.
    pub pairs: usize,
}

impl Consistency {
    /// What looks wrong, if anything does. A scene whose neighbouring views hardly overlap fits badly under every
    /// convention, which is not reported.
    pub fn complaint(&self) -> Option<String> {
        let by_depth = self
            .otherwise
            .iter()
            .filter(|other| self.is_more_depth(other));
        if let Some(best) = by_depth.max_by(|a, b| a.depth.total_cmp(&b.depth)) {
            return Some(format!(
                "the pose convention looks wrong: {:.0} % of depths agree between neighbouring views; with {} it would \
                 be {:.0} %",
                100.0 * self.as_read.depth,
                best.convention,
                100.0 * best.depth
            ));
        }
        self.disagreement().or_else(|| self.colours())
    }

    fn is_more_depth(&self, other: &Fit) -> bool {
        let (times, least) = MORE_DEPTH;
        other.depth > least && other.depth > times * self.as_read.depth
    }

    /// Poses that no other convention explains.
    fn disagreement(&self) -> Option<String> {
        let (meeting, ratio) = (self.meeting?, self.unit_ratio?);
        (meeting < LEAST).then(|| {
            format!(
                "poses and depth do not fit together: of the depths that meet in neighbouring \
                 views at most {:.0} % agree, and the other view's is {ratio:.3} times as large in \
                 the median; the pose convention looks wrong, or the unit of depth or poses, or \
                 the intrinsics",
                100.0 * meeting
            )
        })
    }

    /// Poses under which depth may agree, but not what is seen.
    fn colours(&self) -> Option<String> {
        let read = self.as_read.colour_levels?;
        let is_better = |other: &&Fit| {
            let levels = other.colour_levels.unwrap_or(f64::INFINITY);
            // On few colours anything can look alike.
            levels * levels < LESS_COLOUR * read * read && 2 * other.colours >= self.as_read.colours
        };
        let better = self.otherwise.iter().filter(is_better);
        let levels = |fit: &Fit| fit.colour_levels.unwrap_or(f64::INFINITY);
        let best = better.min_by(|a, b| levels(a).total_cmp(&levels(b)))?;
        Some(format!(
            "the pose convention looks wrong: colours that poses and depth carry into neighbouring views differ by \
             {read:.1} levels; with {} it would be {:.1}",
            best.convention,
            levels(best)
        ))
    }
}

/// Measures neighbouring views of a scene; `None` when no two of them have depth and pictures that can be read.
pub fn of(views: &[View]) -> Option<Consistency> {
    let mut fits = [Sum::default(); CONVENTIONS.len()];
    let mut best: Option<(f64, f64)> = None;
    let mut pairs = 0;
    for i in evenly_spaced(views.len().saturating_sub(1), PAIRS) {
        let (Some(a), Some(b)) = (LoadedView::new(&views[i]), LoadedView::new(&views[i + 1]))
        else {
            continue;
        };
        let carried = CONVENTIONS.iter().map(|convention| {
            let pose = |view: &View| (convention.take)(&view.camera_from_world);
            Carried::between(
                &a,
                &b,
                &pose(&views[i + 1]).after(&pose(&views[i]).inverse()),
            )
        });
        let Some(carried) = carried.collect::<Option<Vec<Carried>>>() else {
            continue;
        };
        if let Some(found) = carried[0].agreeing_where_met()
            && best.is_none_or(|best| found.0 > best.0)
        {
            best = Some(found);
        }
        pairs += 1;
        for (fit, carried) in fits.iter_mut().zip(&carried) {
            fit.add(carried);
        }
    }
    if pairs == 0 {
        return None;
    }
    let mut fits = CONVENTIONS.iter().zip(fits).map(|(convention, sum)| Fit {
        convention: convention.name,
        depth: sum.depth / pairs as f64,
        colour_levels: sum.colour_levels(),
        colours: sum.compared,
    });
    Some(Consistency {
        as_read: fits.next()?,
        otherwise: fits.collect(),
        meeting: best.map(|best| best.0),
        unit_ratio: best.map(|best| best.1),
        pairs,
    })
}

/// One convention's agreement, over pairs.
#[derive(Debug, Default, Clone, Copy)]
struct Sum {
    depth: f64,
    compared: usize,
    squares: f64,
}

impl Sum {
    fn add(&mut self, carried: &Carried) {
        self.depth += carried.agreement();
        self.compared += carried.compared;
        self.squares += carried.squares;
    }

    fn colour_levels(&self) -> Option<f64> {
        (self.compared > 0).then(|| (self.squares / (3 * self.compared) as f64).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::convention::flip;
    use crate::required_files::FileRole;
    use crate::synthetic::{SyntheticOptions, SyntheticScene};
    use crate::{DatasetError, DepthMap, ViewContent};
    use glam::{DMat3, DVec3};
    use image::{GrayImage, Luma, RgbImage};
    use sharp::camera::RigidTransform;
    use std::path::{Path, PathBuf};
    use std::sync::Arc;

    /// Views on an arc; `spread` 1 is so wide that a wrong convention moves them out of each other's sight.
    fn views(spread: f64) -> Vec<View> {
        let scene = SyntheticScene::new(SyntheticOptions {
            width: 128,
            height: 96,
            views: 2,
            ..SyntheticOptions::default()
        })
        .unwrap();
        let k = scene.views()[0].intrinsics;
        let lens = crate::lens::Lens::new(
            (k.fx, k.fy),
            (k.cx, k.cy),
            (k.width, k.height),
            crate::lens::Distortion::None,
        )
        .unwrap();
        (0..4)
            .map(|i| {
                let angle = spread * (0.25 * f64::from(i) - 0.4);
                let center = DVec3::new(-1.5 * angle, -0.2, spread * 0.1 * f64::from(i));
                let rotation = DMat3::from_rotation_y(-angle) * DMat3::from_rotation_x(0.15);
                let pose = RigidTransform {
                    rotation,
                    translation: -(rotation * center),
                };
                scene.view_through(&format!("v{i}"), lens, pose)
            })
            .collect()
    }

    fn taken(views: &[View], take: fn(&RigidTransform) -> RigidTransform) -> Consistency {
        let mut wrong = views.to_vec();
        for view in &mut wrong {
            view.camera_from_world = take(&view.camera_from_world);
        }
        of(&wrong).unwrap()
    }

    #[test]
    fn right_poses_pass_and_wrong_conventions_are_named() {
        let views = views(1.0);
        let right = of(&views).unwrap();
        assert!(right.as_read.depth > 0.5, "{right:?}");
        assert!(right.complaint().is_none(), "{right:?}");
        let inverted = taken(&views, RigidTransform::inverse).complaint().unwrap();
        assert!(inverted.contains("exchanged"), "{inverted}");
        let flipped = taken(&views, flip).complaint().unwrap();
        assert!(flipped.contains("OpenGL"), "{flipped}");
    }

    /// Neighbours a few centimetres apart: depth agrees under every convention, colours do not.
    #[test]
    fn wrong_conventions_are_named_at_small_baselines_too() {
        let views = views(0.1);
        let right = of(&views).unwrap();
        assert!(right.complaint().is_none(), "{right:?}");
        for (take, name) in [
            (RigidTransform::inverse as fn(&_) -> _, "exchanged it would"),
            (flip, "OpenGL"),
            (|pose| flip(&pose.inverse()), "exchanged it would"),
            (|pose| flip(pose).inverse(), "exchanged, and OpenGL"),
        ] {
            let wrong = taken(&views, take);
            let complaint = wrong.complaint();
            assert!(
                complaint.as_ref().is_some_and(|c| c.contains(name)),
                "{name}: {complaint:?} {wrong:?}"
            );
        }
    }

    /// A view of which a block is excluded by a mask.
    #[derive(Debug)]
    struct Masked(Arc<dyn ViewContent>);

    fn is_excluded(x: u32) -> bool {
        (30..80).contains(&x)
    }

    impl ViewContent for Masked {
        fn image(&self) -> Result<RgbImage, DatasetError> {
            let mut image = self.0.image()?;
            let excluded = image
                .enumerate_pixels_mut()
                .filter(|(x, ..)| is_excluded(*x));
            excluded.for_each(|(_, _, pixel)| pixel.0 = [0; 3]);
            Ok(image)
        }

        fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError> {
            let level = |x, _| Luma([if is_excluded(x) { 0 } else { 255 }]);
            Ok(Some(GrayImage::from_fn(128, 96, level)))
        }

        fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
            let mut depth = self.0.depth()?;
            let pixels = depth
                .iter_mut()
                .flat_map(|depth| depth.enumerate_pixels_mut());
            let excluded = pixels.filter(|(x, ..)| is_excluded(*x));
            excluded.for_each(|(_, _, pixel)| pixel.0 = [0.0]);
            Ok(depth)
        }

        fn image_file(&self) -> Option<&Path> {
            None
        }

        fn files_by_role(&self) -> Vec<(FileRole, PathBuf)> {
            Vec::new()
        }

        fn image_sha256(&self) -> Result<String, DatasetError> {
            self.0.image_sha256()
        }
    }

    /// Black pixels of a mask in every other view are no colours to compare.
    #[test]
    fn what_masks_exclude_is_not_compared() {
        let plain = views(0.1);
        let mut masked = plain.clone();
        for view in masked.iter_mut().skip(1).step_by(2) {
            view.content = Arc::new(Masked(Arc::clone(&view.content)));
        }
        let levels = |views: &[View]| of(views).unwrap().as_read.colour_levels.unwrap();
        assert!(
            levels(&masked) < 1.5 * levels(&plain),
            "{}",
            levels(&masked)
        );
        assert!(of(&masked).unwrap().complaint().is_none());
        let complaint = taken(&masked, RigidTransform::inverse).complaint().unwrap();
        assert!(complaint.contains("exchanged it would"), "{complaint}");
    }
}
