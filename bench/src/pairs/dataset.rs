//! An opened dataset and its own pair options.

use std::collections::BTreeMap;
use std::path::Path;

use globset::{GlobBuilder, GlobMatcher};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sharp_datasets::Scene;
use sharp_datasets::check::advice::Units;
use sharp_datasets::found_scenes::by_reason;
use sharp_datasets::left_out::LeftOutScenes;

use super::error::PairError;
use crate::pairs::DatasetConfig;

/// Label of the mean over several datasets; no dataset may have this name.
pub const ALL_DATASETS: &str = "all";

#[derive(Debug, Clone)]
pub struct OpenDataset {
    pub name: String,
    /// The configuration as given.
    pub config: DatasetConfig,
    /// The format and all settings of the reader (not its folder) as text; they determine how files are interpreted.
    pub settings: String,
    /// Settings for details that the paper leaves open.
    pub readings: Vec<DatasetReading>,
    /// Units of the dataset's files.
    pub units: Units,
    pub scenes: Vec<Scene>,
    /// Scenes that exist but are not in `scenes`.
    pub left_out: Vec<LeftOutScenes>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct DatasetReading {
    pub key: String,
    pub value: String,
    /// Whether the value is known to differ from the paper's.
    pub proxy: bool,
    /// Whether the paper does not state the value, and may have used another.
    #[serde(default)]
    pub open: bool,
}

impl OpenDataset {
    /// Opens datasets; names must be unique, because tables have a column for each. `scenes` is a pattern with `*` and
    /// `?` that scene ids must match. A scene that cannot be read is added to [`Self::left_out`].
    ///
    /// # Errors
    /// If a dataset or all of its scenes cannot be read, a name occurs twice, or no scene matches.
    pub fn open_all(
        configs: &[DatasetConfig],
        scenes: Option<&str>,
    ) -> Result<Vec<Self>, PairError> {
        let mut open: Vec<Self> = Vec::new();
        for config in configs {
            let dataset = Self::open_recorded(config, &[], scenes)?;
            let is_taken = open.iter().any(|other| other.name == dataset.name);
            if is_taken || dataset.name == ALL_DATASETS {
                let reason = if is_taken {
                    format!(
                        "the name '{}' is taken; give this dataset another name with NAME:FORMAT=PATH",
                        dataset.name
                    )
                } else {
                    format!(
                        "'{ALL_DATASETS}' is reserved for the mean over datasets; give this \
                         dataset another name with NAME:FORMAT=PATH"
                    )
                };
                return Err(PairError::DatasetSpec {
                    spec: config.to_string(),
                    reason,
                });
            }
            open.push(dataset);
        }
        if open.iter().all(|dataset| dataset.scenes.is_empty()) {
            return Err(PairError::NoScene(scenes.unwrap_or("*").to_owned()));
        }
        Ok(open)
    }

    /// Opens a dataset with the settings that a run recorded, even if a default has changed since.
    ///
    /// # Errors
    /// If the dataset or all of its scenes cannot be read. It is not an error if no scene matches.
    pub fn open_recorded(
        config: &DatasetConfig,
        recorded: &[DatasetReading],
        scenes: Option<&str>,
    ) -> Result<Self, PairError> {
        let given = &config.spec;
        let mut spec = given.clone();
        for reading in recorded.iter().filter(|r| given.setting(&r.key) != r.value) {
            let mut settings = spec.entry.settings.iter();
            if let Some(setting) =
                settings.find(|setting| setting.allows(&reading.key, &reading.value))
            {
                spec.settings.insert(setting.key, reading.value.clone());
            }
        }
        let mut found = sharp_datasets::open_each(&spec)?;
        if let Some(pattern) = scenes {
            let glob = name_matcher(pattern)
                .map_err(|error| PairError::Recipe(format!("--scenes {pattern}: {error}")))?;
            found.choose(|id| glob.is_match(id), &format!("--scenes {pattern}"));
        }
        let left_out = by_reason(&found.left_out);
        // If all scenes are broken, fail with the reason.
        let scenes = if found.scenes.is_empty() {
            found.all()?
        } else {
            found.scenes
        };
        let mut settings = format!("{} {:?}", given.entry.format, given.settings);
        let readings = spec.readings().into_iter();
        let mut readings: Vec<DatasetReading> = readings
            .map(|setting| DatasetReading {
                key: setting.key.to_owned(),
                value: setting.value,
                proxy: setting.proxy,
                open: setting.open,
            })
            .collect();
        let mut scenes = scenes;
        if let Some(frame) = config.frame {
            settings += &format!(" frame={frame}");
            readings.push(DatasetReading {
                key: "frame".to_owned(),
                value: frame.to_string(),
                // The paper scores at full resolution, so any resizing differs from the paper.
                proxy: true,
                open: false,
            });
            for view in scenes.iter_mut().flat_map(|scene| &mut scene.views) {
                let applied = frame.apply(view);
                *view = applied.map_err(|reason| PairError::DatasetSpec {
                    spec: config.to_string(),
                    reason,
                })?;
            }
        }
        Ok(Self {
            settings,
            units: Units::of(&spec),
            readings,
            name: spec.name,
            config: config.clone(),
            scenes,
            left_out,
        })
    }

    /// The dataset's folder, or the folder of its only photograph; `None` for a procedural dataset.
    pub fn root(&self) -> Option<&Path> {
        let path = self.config.spec.path.as_path();
        let path = if path.is_file() { path.parent()? } else { path };
        (!path.as_os_str().is_empty()).then_some(path)
    }

    /// Scenes left out because they are broken or incomplete.
    pub fn broken(&self) -> impl Iterator<Item = &LeftOutScenes> {
        self.left_out.iter().filter(|group| !group.by_choice)
    }

    /// Number of views left out because of their files.
    pub fn unreadable_views(&self) -> usize {
        let groups = self.scenes.iter().flat_map(|scene| &scene.left_out);
        groups.map(|group| group.views.len()).sum()
    }

    /// Why a scene was left out, alone or with a folder that contains it; `None` if the scene was read or does not
    /// exist.
    pub fn leaves_out(&self, scene: &str) -> Option<&LeftOutScenes> {
        let holds = |id: &String| {
            let rest = scene.strip_prefix(id.as_str());
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        };
        let is_read = self.scenes.iter().any(|read| read.id == scene);
        let mut groups = self.left_out.iter().filter(|_| !is_read);
        groups.find(|group| group.scenes.iter().any(holds))
    }

    /// The readers' warnings about the dataset's files, one line each. A warning on several scenes is listed once.
    pub fn warnings(&self) -> Vec<String> {
        let mut scenes: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for scene in &self.scenes {
            let left_out = scene.left_out.iter().map(ToString::to_string);
            for warning in scene.warnings.iter().cloned().chain(left_out) {
                scenes.entry(warning).or_default().push(scene.id.clone());
            }
        }
        let lines = scenes.into_iter();
        lines
            .map(|(warning, scenes)| match scenes.as_slice() {
                [scene] => format!("{}/{scene}: {warning}", self.name),
                [first, ..] => format!(
                    "{}/{first} and {} more: {warning}",
                    self.name,
                    scenes.len() - 1
                ),
                [] => warning,
            })
            .collect()
    }

    /// The reader's notes on its scenes, including warnings, for the manifest.
    pub fn notes(&self) -> Vec<String> {
        let of_scene = |scene: &Scene| {
            let left_out = scene.left_out.iter().map(ToString::to_string);
            let notes = scene.notes.iter().chain(&scene.warnings).cloned();
            notes
                .chain(left_out)
                .map(|note| format!("{}: {note}", scene.id))
                .collect::<Vec<_>>()
        };
        self.scenes.iter().flat_map(of_scene).collect()
    }

    /// The settings in [`Self::readings`], as comma-separated `key=value`.
    pub fn readings_text(&self) -> String {
        let readings = self.readings.iter();
        let texts: Vec<String> = readings.map(|r| format!("{}={}", r.key, r.value)).collect();
        texts.join(",")
    }
}

/// All scenes of some datasets, in order.
pub fn scenes_of(datasets: &[OpenDataset]) -> Vec<Scene> {
    let scenes = datasets.iter().flat_map(|dataset| &dataset.scenes);
    scenes.cloned().collect()
}

/// A matcher for `*` and `?`. All other characters are literal, even those that are special in shell patterns, because
/// names may contain them.
pub(crate) fn name_matcher(pattern: &str) -> Result<GlobMatcher, String> {
    let plain: String = pattern
        .chars()
        .flat_map(|c| match c {
            '*' | '?' => vec![c],
            '[' | ']' | '{' | '}' | '!' | '\\' | ',' => vec!['\\', c],
            c => vec![c],
        })
        .collect();
    let glob = GlobBuilder::new(&plain).backslash_escape(true).build();
    glob.map(|glob| glob.compile_matcher())
        .map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_match_by_wildcards_and_nothing_else_is_special() {
        let matches = |pattern: &str, id: &str| name_matcher(pattern).unwrap().is_match(id);
        for (pattern, id) in [
            ("*", ""),
            ("*", "a/b"),
            ("Moto*", "Motorcycle"),
            ("*cycle", "Motorcycle"),
            ("M?t*", "Motorcycle"),
            ("a[1]{b}", "a[1]{b}"),
            ("a\\b!,", "a\\b!,"),
        ] {
            assert!(matches(pattern, id), "{pattern} {id}");
        }
        for (pattern, id) in [
            ("Moto", "Motorcycle"),
            ("a[1]", "a1"),
            ("{a,b}", "a"),
            ("?", ""),
        ] {
            assert!(!matches(pattern, id), "{pattern} {id}");
        }
    }

    #[test]
    fn a_recorded_dataset_is_read_as_it_was() {
        let dir = tempfile::tempdir().unwrap();
        let source = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../tests/fuzz/datasets/middlebury/A"
        );
        for scene in ["A-perfect", "A-imperfect"] {
            let target = dir.path().join(scene);
            std::fs::create_dir(&target).unwrap();
            for file in ["im0.png", "im1.png", "calib.txt"] {
                std::fs::copy(format!("{source}/{file}"), target.join(file)).unwrap();
            }
        }
        let config = format!("M:middlebury={}", dir.path().display());
        let config: DatasetConfig = config.parse().unwrap();
        let recorded = |key: &str, value: &str| DatasetReading {
            key: key.to_owned(),
            value: value.to_owned(),
            proxy: false,
            open: false,
        };
        let open =
            |readings: &[DatasetReading]| OpenDataset::open_recorded(&config, readings, None);
        let now = open(&[]).unwrap();
        // Recorded settings: an earlier version's default, an unknown value, an unknown key.
        let then = open(&[recorded("rectification", "any")]).unwrap();
        let odd = open(&[recorded("rectification", "none"), recorded("left", "im1")]).unwrap();
        let counts = [&now, &then, &odd].map(|open| (open.scenes.len(), open.left_out.len()));
        assert_eq!(counts, [(1, 1), (2, 0), (1, 1)]);
        // The settings in force are the same, and so is the identity of results.
        assert_eq!(now.settings, then.settings);
    }

    #[test]
    fn a_frame_is_a_reading_and_part_of_the_identity() {
        let open = |text: &str| OpenDataset::open_recorded(&text.parse()?, &[], None);
        let plain = open("synthetic=size=48x36,views=2").unwrap();
        let text = "S:synthetic=size=48x36,views=2,frame=cover:24x24:area,pairs.order=once";
        let framed = open(text).unwrap();
        assert_ne!(framed.settings, plain.settings);
        let reading = framed.readings.last().unwrap();
        assert_eq!(
            (reading.key.as_str(), reading.value.as_str()),
            ("frame", "cover:24x24:area")
        );
        let view = &framed.scenes[0].views[0];
        assert_eq!(view.content.image().unwrap().dimensions(), (24, 24));
        // A recorded manifest opens the same dataset.
        let recorded = framed.config.without_pairs();
        let again = OpenDataset::open_recorded(&recorded, &framed.readings, None).unwrap();
        assert_eq!(again.settings, framed.settings);
        let error = open("synthetic=size=48x36,views=2,frame=cover:64x64:area").unwrap_err();
        assert!(error.to_string().contains("48x36"), "{error}");
    }
}
