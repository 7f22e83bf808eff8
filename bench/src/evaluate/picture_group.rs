//! Groups of pictures that are examined together: those of a dataset and those of one of its scenes.

use std::collections::BTreeMap;

use super::record::{Record, Status};

/// A scene is examined on its own only if it has at least this many pictures.
pub(super) const FEWEST_IN_SCENE: usize = 4;
/// A finding on a scene is reported only if at least this share of its pictures have it, because poor predictions of one
/// scene often err alike.
const MIN_SHARE_IN_SCENE: f64 = 0.8;

/// What a group of pictures has in common. A finding on a scene needs more evidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Extent {
    Dataset,
    Scene,
}

impl Extent {
    /// How many pictures must have a finding, given the number for datasets.
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

/// Records of scored pictures.
pub(super) struct PictureGroup<'a> {
    pub extent: Extent,
    /// `DATASET` or `DATASET/SCENE`.
    pub name: String,
    pub records: Vec<&'a Record>,
}

/// Applies a check to the records of each dataset. If it reports nothing there, it is applied to each of the dataset's
/// scenes.
pub(super) fn in_datasets_or_scenes<'a>(
    records: impl Iterator<Item = &'a Record>,
    check: impl Fn(&PictureGroup<'a>) -> Vec<String>,
) -> Vec<String> {
    let mut datasets: BTreeMap<&str, Vec<&Record>> = BTreeMap::new();
    for record in records.filter(|record| record.status == Status::Ok) {
        datasets.entry(&record.dataset).or_default().push(record);
    }
    let of_dataset = |(dataset, records): (&str, Vec<&'a Record>)| {
        let scenes = scenes(
            records
                .iter()
                .map(|record| (record.scene.as_str(), *record)),
        );
        let whole = PictureGroup {
            extent: Extent::Dataset,
            name: dataset.to_owned(),
            records,
        };
        let found = check(&whole);
        if !found.is_empty() {
            return found;
        }
        let of_scene = |(scene, records)| {
            let name = format!("{dataset}/{scene}");
            let found = check(&PictureGroup {
                extent: Extent::Scene,
                name: name.clone(),
                records,
            });
            let told = found.into_iter();
            told.map(|text| in_scene(&name, &text)).collect::<Vec<_>>()
        };
        scenes.into_iter().flat_map(of_scene).collect()
    };
    datasets.into_iter().flat_map(of_dataset).collect()
}

/// A finding on the pictures of one scene, which begins with "its pictures".
pub(crate) fn in_scene(name: &str, text: &str) -> String {
    format!("in {name}, {text}")
}

/// The scene of a picture named `SCENE/NAME`, or `SCENE_NUMBER` without a folder.
pub(crate) fn scene_of(name: &str) -> &str {
    let folder = name.rsplit_once('/').map(|(folder, _)| folder);
    folder.unwrap_or_else(|| name.trim_end_matches(|c: char| c.is_ascii_digit()))
}

/// Sorts pictures by scene; empty if there is only one scene. Scenes with too few pictures are left out.
pub(crate) fn scenes<'a, T>(
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
impl<'a> PictureGroup<'a> {
    /// All records as those of one dataset.
    pub(super) fn of(records: &'a [Record]) -> Self {
        Self {
            extent: Extent::Dataset,
            name: records
                .first()
                .map_or("", |record| &record.dataset)
                .to_owned(),
            records: records.iter().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::doubts::doubts_of;
    use super::super::finding::{Framing, PictureChange, ShownCamera, ShownTarget};
    use super::super::record::tests::record;
    use super::*;
    use crate::methods::TrueDepth;

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
        doubts_of(records.iter(), "imported", TrueDepth::None)
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
