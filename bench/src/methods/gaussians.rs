//! Gaussians that someone else's method predicted, one file per source view, rendered by us.

use std::collections::BTreeSet;
use std::iter;
use std::path::{Path, PathBuf};

use sharp::gaussian_files::{AXES, foreign_format};
use sharp::ply::StoredQuaternions;
use sharp::render::Rule;
use sharp_datasets::files;

use super::file_reading::{Axes, FileReading, FileSpace};
use super::file_template::{FileTemplate, suggestion};
use super::method::{
    Approach, GaussianPrediction, GaussianSpace, Method, MethodError, MethodIdentity,
    PredictGaussians, SourceView,
};
use super::privilege::Privilege;
use super::spec::{MethodSpec, SpecError};
use crate::io::gaussian_files::{EXTENSIONS, GaussianFile, is_sog_folder};
use crate::io::{fingerprints, gaussian_files};
use crate::pairs::pair_id::path_of;

/// Extras that count Gaussians which the renderer drops, and the reasons in words.
pub const UNUSABLE: [(&str, &str); 2] = [
    ("not_finite", "hold values that are not finite"),
    ("zero_quaternions", "have a quaternion of zero"),
];

/// Reads `DIR/<dataset>/<scene>/<source>.ply` or another of [`EXTENSIONS`] (percent-encoded like pair ids), or a folder of
/// that name that holds an unpacked SOG, or with `space=world` where that is missing, `DIR/<dataset>/<scene>.ply`. With
/// `file=` it is the file that a template of `{dataset} {scene} {source}` names.
///
/// Unless [`FileReading`]'s settings say otherwise the Gaussians lie in the source's camera space, metres, OpenCV axes: what
/// `sharp predict` and `sharp-bench predict` write. Whatever camera a file stores is ignored; the dataset's poses and
/// intrinsics place and render them. Colours of a PLY that does not say how they are encoded need `color_space=`. Gaussians
/// that are not finite or have a quaternion of zero are dropped, counted in the extras `not_finite` and `zero_quaternions`,
/// and warned about; so are stored numbers that speak against the reading.
#[derive(Debug)]
pub struct GaussianFiles {
    label: String,
    dir: PathBuf,
    privilege: Privilege,
    /// As given.
    reading: FileReading,
    /// Where files lie, if not as by default.
    file: Option<FileTemplate>,
    /// Whether `axes=` is among the settings: SPZ files need it.
    has_axes: bool,
}

impl GaussianFiles {
    pub(super) fn from_spec(spec: &MethodSpec) -> Result<Self, SpecError> {
        let mut reading = FileReading::default();
        for key in FileReading::keys() {
            if let Some(value) = spec.option(key) {
                reading
                    .set(key, value)
                    .map_err(|reason| spec.error(reason))?;
            }
        }
        Ok(Self {
            label: spec.label.clone(),
            dir: spec.folder()?,
            privilege: spec.privilege(Privilege::DepthScale)?,
            reading,
            file: spec
                .option("file")
                .map(FileTemplate::of_sources)
                .transpose()
                .map_err(|reason| spec.error(reason))?,
            has_axes: spec.option("axes").is_some(),
        })
    }

    fn find(&self, source: &str) -> Result<PathBuf, MethodError> {
        if let Some(template) = &self.file {
            let named = template.candidates(&self.dir, source);
            let there = |path: &&PathBuf| path.is_file() || is_sog_folder(path);
            let found = named.iter().find(there).cloned();
            return found.ok_or_else(|| {
                let path = named.first().unwrap_or(&self.dir);
                MethodError::file(path, format!("no Gaussians (file={})", template.text()))
            });
        }
        let path = self.dir.join(path_of(source));
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
                Some((format, name)) => format!("{looked}, but {name} is there: {format}"),
            };
            MethodError::file(&self.dir.join(source), reason)
        })
    }
}

/// Files and folders of this name with any extension, sorted.
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
        // Where a file lies is no part of it: its bytes are hashed.
        identity
    }

    fn sources(&self) -> &'static str {
        fingerprints::FILES
    }

    fn input_files(&self, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        // Ids encode underscores that would form a second separator.
        let source = pair_id.split("__").next().unwrap_or(pair_id);
        let found = self.find(source)?;
        if !found.is_dir() {
            return Ok(vec![found]);
        }
        let entries =
            std::fs::read_dir(&found).map_err(|error| MethodError::file(&found, error))?;
        let mut all: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        all.retain(|path| path.is_file());
        all.sort();
        Ok(all)
    }

    fn check_files(&self, pair_ids: &BTreeSet<String>) -> Result<(), String> {
        let sources = pair_ids.iter().filter_map(|id| id.split("__").next());
        let sources: BTreeSet<String> = sources.map(str::to_owned).collect();
        if sources.iter().any(|source| self.find(source).is_ok()) {
            return Ok(());
        }
        suggestion(&self.dir, &sources, &EXTENSIONS, FileTemplate::of_sources).map_or(Ok(()), Err)
    }

    fn privilege(&self) -> Privilege {
        self.privilege
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Gaussians(self)
    }
}

impl PredictGaussians for GaussianFiles {
    fn predict(&self, source: &SourceView) -> Result<GaussianPrediction, MethodError> {
        let path = self.find(source.name())?;
        let scene = gaussian_files::read(&path, self.reading.stored, self.reading.rule);
        let GaussianFile {
            gaussians,
            rule,
            rule_note,
            reading: stored,
            doubts,
            ..
        } = scene.map_err(|error| MethodError::Model(error.to_string()))?;
        if let Some(doubt) = doubts
            .iter()
            .find(|doubt| doubt.about == AXES && !self.has_axes)
        {
            return Err(MethodError::file(&path, &doubt.text));
        }
        let camera = source.camera();
        let placement = self.reading.placement;
        let finite: Vec<usize> = (0..gaussians.len())
            .filter(|&k| gaussians.is_finite(k))
            .collect();
        if finite.is_empty() {
            return Err(MethodError::file(&path, "it holds no finite Gaussian"));
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
        let extras = counts.map(|(name, count)| (name, count as f64)).collect();
        Ok(GaussianPrediction {
            gaussians,
            space: GaussianSpace::Camera(placement.camera_from_file(camera)),
            first_layer: None,
            extras,
            rule: (rule != Rule::SHARP).then_some(rule),
            reading: Some(FileReading {
                stored,
                ..self.reading
            }),
            rule_note,
            warnings: doubts
                .into_iter()
                // A turn about z is what the axes then say.
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
