//! Groups of pictures that are examined together: all pictures of a dataset, or of one of its scenes.

use std::collections::BTreeMap;

/// Minimum number of pictures in a scene that is examined separately.
const FEWEST_IN_SCENE: usize = 4;
/// A finding on a scene is reported only if at least this share of its pictures have it. The share is high, because
/// poor predictions of one scene often have the same errors.
const MIN_SHARE_IN_SCENE: f64 = 0.8;

/// Whether a group is a dataset or one of its scenes. A finding on a scene needs more evidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Extent {
    Dataset,
    Scene,
}

impl Extent {
    /// The number of pictures of the group that must have a finding, given the number for datasets.
    pub(super) fn fewest(self, of_dataset: usize) -> usize {
        match self {
            Self::Dataset => of_dataset,
            Self::Scene => of_dataset.max(FEWEST_IN_SCENE),
        }
    }

    /// The share of the pictures that must have a finding, given the share for datasets.
    pub(super) fn share(self, of_dataset: f64) -> f64 {
        match self {
            Self::Dataset => of_dataset,
            Self::Scene => of_dataset.max(MIN_SHARE_IN_SCENE),
        }
    }
}

/// Pictures that are examined together. `T` identifies a picture.
pub(crate) struct PictureGroup<'a, T> {
    pub extent: Extent,
    /// Name of the dataset or scene.
    pub name: &'a str,
    pub pictures: &'a [T],
}

/// Applies `check` to all pictures of a dataset and, if this finds nothing, to the pictures of each scene. Each picture
/// is given with the name of its scene. Findings on a scene begin with "in SCENE, ".
pub(crate) fn all_or_scenes<T: Copy>(
    dataset: &str,
    pictures: &[(String, T)],
    check: impl Fn(&PictureGroup<'_, T>) -> Vec<String>,
) -> Vec<String> {
    let all: Vec<T> = pictures.iter().map(|(_, picture)| *picture).collect();
    let found = check(&PictureGroup {
        extent: Extent::Dataset,
        name: dataset,
        pictures: &all,
    });
    if !found.is_empty() {
        return found;
    }
    let pictures = pictures.iter().map(|(scene, picture)| (&**scene, *picture));
    let of_scene = |(name, pictures): (&str, Vec<T>)| {
        let found = check(&PictureGroup {
            extent: Extent::Scene,
            name,
            pictures: &pictures,
        });
        let texts = found.iter().map(|text| format!("in {name}, {text}"));
        texts.collect::<Vec<_>>()
    };
    scenes(pictures).into_iter().flat_map(of_scene).collect()
}

/// The scene of a picture named `SCENE/NAME`, or `SCENE_NUMBER` without a folder.
pub(crate) fn scene_of(name: &str) -> &str {
    let folder = name.rsplit_once('/').map(|(folder, _)| folder);
    folder.unwrap_or_else(|| {
        let scene = name.trim_end_matches(|c: char| c.is_ascii_digit());
        scene.trim_end_matches(['_', '-'])
    })
}

/// Sorts pictures by scene; empty if there is only one scene. Scenes with too few pictures are left out.
pub(super) fn scenes<'a, T>(
    pictures: impl Iterator<Item = (&'a str, T)>,
) -> BTreeMap<&'a str, Vec<T>> {
    let mut scenes: BTreeMap<&str, Vec<T>> = BTreeMap::new();
    for (scene, picture) in pictures {
        scenes.entry(scene).or_default().push(picture);
    }
    let is_only = scenes.len() == 1;
    scenes.retain(|_, pictures| !is_only && pictures.len() >= FEWEST_IN_SCENE);
    scenes
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::finding::{Framing, PictureChange, ShownCamera, ShownTarget};
    use super::*;
    use crate::evaluate::doubts::doubts_of;
    use crate::evaluate::record::tests::record;
    use crate::evaluate::record::{Record, Status};

    /// The result of a check of these records as those of one dataset.
    pub(in crate::evaluate) fn of_dataset<T>(
        records: &[Record],
        check: fn(&PictureGroup<'_, &Record>) -> T,
    ) -> T {
        let pictures: Vec<&Record> = records.iter().collect();
        check(&PictureGroup {
            extent: Extent::Dataset,
            name: records.first().map_or("", |record| &record.dataset),
            pictures: &pictures,
        })
    }

    #[test]
    fn names_without_folders_begin_with_their_scene() {
        let scenes = ["a/b/12", "kitchen_0012", "kitchen-7", "0012", "left"].map(scene_of);
        assert_eq!(scenes, ["a/b", "kitchen", "kitchen", "", "left"]);
    }

    /// What is said of three scenes with four pictures each, after a change of scene 1.
    fn told(change: impl Fn(usize, &mut Record)) -> Vec<String> {
        let one = |at: usize| {
            let mut record = Record {
                status: Status::Ok,
                scene: format!("scene{}", at / 4),
                source: at.to_string(),
                shows: Some(ShownTarget::Own),
                camera: Some(ShownCamera::Moved(100)),
                masked: Some(0),
                ..record()
            };
            record.pair_id = format!("{}/{}/a__{at}", record.dataset, record.scene);
            if at / 4 == 1 {
                change(at % 4, &mut record);
            }
            record
        };
        let records: Vec<Record> = (0..12).map(one).collect();
        doubts_of(records.iter(), "imported")
    }

    #[test]
    fn one_wrong_scene_is_named() {
        const ZOOM: Framing = Framing {
            zoom: 1080,
            roll: 0,
            shift: [0; 2],
            lens: 0,
        };
        type Change = dyn Fn(&mut Record);
        let cases: [(&str, &Change); 4] = [
            ("linear", &|r| r.change = Some(PictureChange::Linear)),
            ("names of other pairs", &|r| {
                r.shows = Some(ShownTarget::Next)
            }),
            ("1.08 times its focal length", &|r| {
                r.camera = Some(ShownCamera::Reframed(ZOOM));
            }),
            ("masked background", &|r| r.masked = Some(40)),
        ];
        for (what, change) in cases {
            let said = told(|_, record| change(record));
            assert!(
                said.len() == 1
                    && said[0].starts_with("in m/scene1, its pictures ")
                    && said[0].contains(what),
                "{what}: {said:?}"
            );
            assert_eq!(
                told(|at, r| if at > 0 {
                    change(r)
                }),
                [""; 0],
                "{what}"
            );
        }
    }

    #[test]
    fn a_scale_of_one_scene_is_no_mistake() {
        assert_eq!(
            told(|_, r| r.camera = Some(ShownCamera::Moved(50))),
            [""; 0]
        );
    }
}
