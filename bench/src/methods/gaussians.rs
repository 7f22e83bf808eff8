//! Gaussians predicted by an external method, one file per source view, rendered by this harness.

use std::collections::{BTreeMap, BTreeSet};
use std::iter;
use std::path::{Path, PathBuf};

use sharp::camera::Intrinsics;
use sharp::gaussian_files::{AXES, foreign_format};
use sharp::ply::{StoredQuaternions, Suspicion};
use sharp::render::Rule;
use sharp_datasets::files;

use super::file_reading::{Axes, FileReading, FileSpace};
use super::file_template::{FileTemplate, suggestion};
use super::method::{
    Approach, GaussianPrediction, GaussianSpace, Method, MethodError, MethodIdentity,
    PredictGaussians, SourceView, TargetCamera,
};
use super::placement_file;
use super::privilege::{Privilege, TrueDepth};
use super::spec::{MethodSpec, SpecError};
use super::training_views::TrainingViews;
use crate::io::gaussian_files::{EXTENSIONS, GaussianFile, is_sog_folder};
use crate::io::{fingerprints, gaussian_files};
use crate::pairs::pair_id::{path_of, source_of};
use crate::rendering::pose_alignment;

/// The principal points of a file and of the dataset count as different if they differ by more than this along an axis,
/// in pixels.
const MIN_SHIFT: f64 = 0.75;

/// Names of the recorded counts of Gaussians that the renderer drops, each with the reason in words.
pub const UNUSABLE: [(&str, &str); 2] = [
    ("not_finite", "have values that are not finite"),
    ("zero_quaternions", "have a quaternion of zero"),
];

/// Reads `DIR/<dataset>/<scene>/<source>.ply` or another of [`EXTENSIONS`] (percent-encoded like
/// pair ids), or a folder of that name with an unpacked SOG. With `space=world`, falls back to
/// `DIR/<dataset>/<scene>.ply`; with `space=target`, reads `DIR/<pair_id>.ply`. `file=` overrides
/// the path with a template of `{dataset} {scene} {source} {target} {pair}`.
///
/// By default, the Gaussians are in the source's camera space, in metres, with OpenCV's axes, as written by `sharp
/// predict` and `sharp-bench predict`; [`FileReading`] has the settings for other files. A camera stored in a file is
/// ignored: the dataset's poses and intrinsics place and render the Gaussians. If a PLY does not state the encoding of
/// its colours, `color_space=` is required.
///
/// Gaussians that are not finite or have a quaternion of zero are dropped, counted in the extras `not_finite` and
/// `zero_quaternions`, and warned about. Stored numbers that contradict the settings also cause a warning.
#[derive(Debug)]
pub struct GaussianFiles {
    label: String,
    dir: PathBuf,
    depth: TrueDepth,
    /// Whether `align=pose` was given.
    aligned: bool,
    /// The views that the method was trained on; `None` if `train=` does not list them.
    train: Option<TrainingViews>,
    several_views: bool,
    /// The settings for reading files, as given.
    reading: FileReading,
    /// Template for the paths of transform files; `None` unless each scene has its own transform file.
    transform: Option<FileTemplate>,
    /// Template for the paths of the Gaussian files; `None` for the default paths.
    file: Option<FileTemplate>,
    /// Whether `axes=` was given, which SPZ files require.
    has_axes: bool,
}

impl GaussianFiles {
    pub(super) fn from_spec(spec: &MethodSpec) -> Result<Self, SpecError> {
        let mut reading = FileReading::default();
        let of_scenes = |text: &&str| text.contains('{');
        let transform = spec.option("transform").filter(of_scenes);
        for key in FileReading::keys() {
            if let Some(value) = spec.option(key)
                && (key != "transform" || transform.is_none())
            {
                reading
                    .set(key, value)
                    .map_err(|reason| spec.error(reason))?;
            }
        }
        let file = spec.option("file").map(FileTemplate::parse).transpose();
        let file = file.map_err(|reason| spec.error(reason))?;
        let transform = transform.map(FileTemplate::parse).transpose();
        let dir = spec.folder()?;
        let aligned = match spec.option("align") {
            None | Some("none") => false,
            Some("pose") => true,
            Some(other) => return Err(spec.error(format!("align={other}: expected none or pose"))),
        };
        let train = match spec.option("train") {
            None | Some("source") => None,
            Some(text) => Some(TrainingViews::read(text).map_err(|reason| spec.refused(reason))?),
        };
        // A file that serves all sources of a scene is assumed to have been made from several views of it, unless
        // `train=` states otherwise.
        let is_of_scene = reading.placement.space == FileSpace::World
            && match &file {
                Some(template) => !template.names(&["source", "target", "pair"]),
                None => holds_files_of_scenes(&dir),
            };
        Ok(Self {
            label: spec.label.clone(),
            depth: spec.depth(TrueDepth::DepthScale)?,
            aligned,
            several_views: train.is_some() || is_of_scene && spec.option("train").is_none(),
            train,
            dir,
            reading,
            transform: transform.map_err(|reason| spec.error(reason))?,
            file,
            has_axes: spec.option("axes").is_some(),
        })
    }

    /// The id after which the file is named: the pair's if each target has its own file, otherwise the source's.
    fn file_id<'p>(&self, pair_id: &'p str) -> &'p str {
        if self.needs_target() {
            pair_id
        } else {
            source_of(pair_id)
        }
    }

    /// The transform file of the id's scene; `None` if scenes have no transform files.
    fn transform_of(&self, id: &str) -> Result<Option<PathBuf>, MethodError> {
        let Some(template) = &self.transform else {
            return Ok(None);
        };
        let absent = ("no transform", "transform");
        let found = template.find(&self.dir, id, Path::is_file, absent);
        found.map(Some)
    }

    /// The Gaussian file for an id returned by [`Self::file_id`].
    fn find(&self, id: &str) -> Result<PathBuf, MethodError> {
        if let Some(template) = &self.file {
            let is_there = |path: &Path| path.is_file() || is_sog_folder(path);
            return template.find(&self.dir, id, is_there, ("no Gaussians", "file"));
        }
        let path = self.dir.join(path_of(id));
        let scene = path
            .parent()
            .filter(|_| self.reading.placement.space == FileSpace::World);
        let stems: Vec<&Path> = iter::once(path.as_path()).chain(scene).collect();
        let found = stems.iter().find_map(|stem| {
            let (folder, name) = (stem.parent()?, stem.file_name()?.to_string_lossy());
            let found = files::of_stem(folder, &name, &EXTENSIONS).into_iter();
            let unpacked = is_sog_folder(stem).then(|| stem.to_path_buf());
            found.chain(unpacked).next()
        });
        found.ok_or_else(|| {
            let looked = format!("no Gaussians (looked for {})", EXTENSIONS.join(", "));
            let others = stems.iter().flat_map(|stem| beside(stem));
            let other = others.filter_map(|path| {
                let name = path.file_name()?.to_string_lossy().into_owned();
                Some((foreign_format(&[], &name)?, name))
            });
            let reason = match other.into_iter().next() {
                None => looked,
                Some((format, name)) => format!("{looked}, but {name} exists ({format})"),
            };
            MethodError::file(&self.dir.join(id), reason)
        })
    }
}

/// Size of a file, or total size of a folder's files, in bytes.
fn size(path: &Path) -> u64 {
    let of_file = |path: &Path| std::fs::metadata(path).map_or(0, |about| about.len());
    let inside = std::fs::read_dir(path).map(|entries| {
        let entries = entries.flatten();
        entries.map(|entry| of_file(&entry.path())).sum()
    });
    inside.unwrap_or_else(|_| of_file(path))
}

/// Warns if a file was made for a principal point (`stored`) that differs from the dataset's (`own`). SHARP assumes the
/// centre of the photograph.
fn other_principal_point(stored: &Intrinsics, own: &Intrinsics) -> Option<String> {
    let is_same_size = (stored.width, stored.height) == (own.width, own.height);
    let by = [stored.cx - own.cx, stored.cy - own.cy].map(|by| (by * 1000.0).round() / 1000.0);
    let [x, y] = by;
    (is_same_size && by.iter().any(|by| by.abs() > MIN_SHIFT)).then(|| {
        format!(
            "it was predicted with the principal point ({:.1}, {:.1}), but the dataset's is \
             ({:.1}, {:.1}); `shift={x}:{y}` corrects this",
            stored.cx, stored.cy, own.cx, own.cy
        )
    })
}

/// Whether a folder contains `<dataset>/<scene>.ply` or another of [`EXTENSIONS`].
fn holds_files_of_scenes(dir: &Path) -> bool {
    let entries = |folder: &Path| std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files = entries(dir).flat_map(|dataset| entries(&dataset.path()));
    files.any(|file| {
        let path = file.path();
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        path.is_file() && EXTENSIONS.contains(&extension.to_ascii_lowercase().as_str())
    })
}

/// Files and folders whose path is `stem` with any extension, sorted.
fn beside(stem: &Path) -> Vec<PathBuf> {
    let (Some(folder), Some(name)) = (stem.parent(), stem.file_name()) else {
        return Vec::new();
    };
    let name = name.to_string_lossy();
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let named = entries.filter(|entry| {
        let found = entry.file_name();
        let found = found.to_string_lossy();
        let rest = found.strip_prefix(name.as_ref());
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    });
    let mut paths: Vec<PathBuf> = named.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

impl Method for GaussianFiles {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> MethodIdentity {
        let mut identity = MethodIdentity::new("gaussians", [("space", "camera".to_owned())]);
        let given = self.reading.settings().into_iter();
        let given = given.map(|(key, value)| (key.to_owned(), value));
        identity.settings.extend(given);
        if let Some(train) = &self.train {
            let train = ("train".to_owned(), train.hash().to_owned());
            identity.settings.extend([train]);
        }
        if let Some(transform) = &self.transform {
            let transform = ("transform".to_owned(), transform.text().to_owned());
            identity.settings.extend([transform]);
        }
        if self.aligned {
            let align = ("align".to_owned(), pose_alignment::procedure());
            identity.settings.extend([align]);
        }
        // Leave out the file's location, because its bytes are hashed.
        identity
    }

    fn sources(&self) -> &'static str {
        fingerprints::FILES
    }

    fn input_files(&self, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        let id = self.file_id(pair_id);
        let found = self.find(id)?;
        let transform = self.transform_of(id)?;
        if !found.is_dir() {
            return Ok([found].into_iter().chain(transform).collect());
        }
        let entries =
            std::fs::read_dir(&found).map_err(|error| MethodError::file(&found, error))?;
        let mut all: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        all.retain(|path| path.is_file());
        all.sort();
        all.extend(transform);
        Ok(all)
    }

    fn check_files(&self, pair_ids: &BTreeSet<String>) -> Result<(), String> {
        if pair_ids
            .iter()
            .any(|id| self.find(self.file_id(id)).is_ok())
        {
            return Ok(());
        }
        let sources = pair_ids.iter().map(|id| source_of(id).to_owned()).collect();
        suggestion(&self.dir, &sources, &EXTENSIONS)
            .or_else(|| suggestion(&self.dir, pair_ids, &EXTENSIONS))
            .map_or(Ok(()), Err)
    }

    fn privilege(&self) -> Privilege {
        Privilege {
            depth: self.depth,
            several_views: self.several_views,
            target_pose: self.aligned,
        }
    }

    fn trained_on(&self, pair_id: &str) -> Option<[bool; 2]> {
        self.train.as_ref()?.hold(pair_id)
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Gaussians(self)
    }
}

impl PredictGaussians for GaussianFiles {
    fn needs_target(&self) -> bool {
        let of_pairs = |file: &FileTemplate| file.names(&["target", "pair"]);
        self.reading.placement.space == FileSpace::Target
            || self.file.as_ref().is_some_and(of_pairs)
    }

    fn predict(
        &self,
        source: &SourceView,
        target: Option<&TargetCamera>,
    ) -> Result<GaussianPrediction, MethodError> {
        let id = target.map_or(source.name(), TargetCamera::pair_id);
        let path = self.find(id)?;
        let scene = gaussian_files::read(&path, self.reading.stored, self.reading.rule);
        let GaussianFile {
            gaussians,
            rule,
            rule_note,
            reading: stored,
            mut doubts,
            camera: stored_camera,
        } = scene.map_err(|error| MethodError::Model(error.to_string()))?;
        if let Some(doubt) = doubts
            .iter()
            .find(|doubt| doubt.about == AXES && !self.has_axes)
        {
            return Err(MethodError::file(&path, &doubt.text));
        }
        let camera = source.camera();
        let stored_intrinsics = stored_camera.map(|(intrinsics, _)| intrinsics);
        let mut placement = self.reading.placement;
        if let Some(file) = self.transform_of(id)? {
            let read = placement_file::read(&file);
            placement.transform = Some(read.map_err(|reason| MethodError::file(&file, reason))?);
        }
        if placement.space == FileSpace::Camera && placement.shift == [0.0; 2] {
            let other =
                stored_intrinsics.and_then(|k| other_principal_point(&k, &camera.intrinsics));
            doubts.extend(other.map(|text| Suspicion::new("shift", text)));
        }
        let finite: Vec<usize> = (0..gaussians.len())
            .filter(|&k| gaussians.is_finite(k))
            .collect();
        if finite.is_empty() {
            return Err(MethodError::file(&path, "it has no finite Gaussian"));
        }
        let zero = finite
            .iter()
            .filter(|&&k| gaussians.quaternions[k] == [0.0; 4]);
        let unusable = [gaussians.len() - finite.len(), zero.count()];
        let names = UNUSABLE.map(|(name, _)| name.to_owned());
        let counts = names
            .into_iter()
            .zip(unusable)
            .filter(|(_, count)| *count > 0);
        let mut extras: BTreeMap<String, f64> =
            counts.map(|(name, count)| (name, count as f64)).collect();
        extras.insert("file_mb".to_owned(), size(&path) as f64 / 1e6);
        Ok(GaussianPrediction {
            gaussians,
            space: GaussianSpace::Camera(match target {
                Some(target) if placement.space == FileSpace::Target => {
                    let source_from_target = target.camera().to(camera).to_affine();
                    source_from_target * placement.camera_from_file(target.camera())
                }
                _ => placement.camera_from_file(camera),
            }),
            first_layer: None,
            extras,
            rule: (rule != Rule::SHARP).then_some(rule),
            // `None` for a file in the target's space, so that the source check tries no other settings.
            reading: (placement.space != FileSpace::Target).then_some(FileReading {
                stored,
                placement,
                ..self.reading
            }),
            rule_note,
            warnings: doubts
                .into_iter()
                // Keep warnings about the order of quaternions only for OpenCV's axes: other axes also rotate Gaussians
                // about z.
                .filter(|d| d.about != StoredQuaternions::KEY || placement.axes == Axes::OPENCV)
                .filter(|d| d.about != AXES)
                .map(|doubt| {
                    let text = format!("{} ({})", doubt.text, camera.id);
                    (doubt.about.to_owned(), text)
                })
                .collect(),
        })
    }
}
