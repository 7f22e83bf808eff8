//! Pictures made by an external method: `DIR/<pair_id>.png|jpg|exr|webp|tif|bmp`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use sharp_datasets::files;

use super::crop_and_resize::{CropRule, FitRules};
use super::file_template::{FileTemplate, suggestion};
use super::method::{
    Approach, Method, MethodError, MethodIdentity, PicturePrediction, PredictPicture, SourceView,
    TargetCamera,
};
use super::scale_sweep::{PredictAtScale, Scale};
use super::spec::{MethodSpec, SpecError};
use crate::io::{fingerprints, pictures};
use crate::pairs::pair_id::path_of;
use crate::scoring::Region;

/// Reads a folder of predicted pictures.
///
/// Subfolders follow the pair id: `DIR/dataset/scene/source__target.png`; `file=` overrides this with a template of
/// `{dataset} {scene} {source} {target} {pair}`. `alpha=`, `color=`, `orientation=` and `exr=` set how to read pictures
/// that are transparent, not in sRGB, not upright or in EXR files
/// ([`PictureReading`](crate::io::pictures::PictureReading)). Like all predictions, the pictures are rounded to 8 bit.
///
/// A picture of another size than the target's is an error unless these settings explain it:
///
/// * `resize=KERNEL`: the kernel for resizing pictures with the aspect ratio of the part that they cover.
/// * `crop=`: the part of the target that the picture covers. `x:y:w:h` is in pixels of the target, `center:W:H` is the
///   largest centred part with that aspect ratio, `center` is the largest one with the picture's own aspect ratio, and
///   `sidecar` reads the part from `DIR/<pair_id>.json`, which contains `{"crop": [x, y, width, height]}`.
#[derive(Debug, Clone)]
pub struct Imported {
    label: String,
    dir: PathBuf,
    /// Template for the paths of the pictures; `None` for the default paths.
    file: Option<FileTemplate>,
    fit: FitRules,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sidecar {
    crop: [u32; 4],
}

impl Imported {
    const EXTENSIONS: [&'static str; 9] = [
        "png", "jpg", "jpeg", "exr", "webp", "tif", "tiff", "bmp", "jfif",
    ];

    pub fn from_spec(spec: &MethodSpec) -> Result<Self, SpecError> {
        let fit = FitRules::parse(|key| spec.option(key));
        Ok(Self {
            label: spec.label.clone(),
            dir: spec.folder()?,
            file: spec
                .option("file")
                .map(FileTemplate::parse)
                .transpose()
                .map_err(|reason| spec.error(reason))?,
            fit: fit.map_err(|reason| spec.error(reason))?,
        })
    }

    /// A copy of this method that reads from the subfolder `name`.
    fn in_folder(&self, name: &str) -> Self {
        Self {
            dir: self.dir.join(name),
            ..self.clone()
        }
    }

    fn find(&self, pair_id: &str) -> Result<PathBuf, MethodError> {
        if let Some(template) = &self.file {
            return template.find(&self.dir, pair_id, Path::is_file, ("no picture", "file"));
        }
        let named = self.dir.join(path_of(pair_id));
        let folder = named.parent().unwrap_or(&self.dir);
        let stem = named.file_name().unwrap_or_default().to_string_lossy();
        let candidates = files::of_stem(folder, &stem, &Self::EXTENSIONS);
        match candidates.as_slice() {
            [path] => Ok(path.clone()),
            [] => {
                let reason = format!(
                    "no picture (looked for {}); {}",
                    Self::EXTENSIONS.join(", "),
                    files::what_lies_in(folder)
                );
                Err(MethodError::file(&named, reason))
            }
            [first, second, ..] => {
                let other = second.file_name().unwrap_or_default().to_string_lossy();
                Err(MethodError::file(
                    first,
                    format!("ambiguous, because {other} exists, too"),
                ))
            }
        }
    }

    /// Path of the sidecar file. The extension is appended instead of replacing one, because a view's name may contain
    /// a dot.
    fn sidecar_path(&self, pair_id: &str) -> PathBuf {
        self.dir.join(format!("{}.json", path_of(pair_id)))
    }

    fn sidecar(&self, pair_id: &str) -> Result<Region, MethodError> {
        let path = self.sidecar_path(pair_id);
        let bytes = sharp::files::read(&path).map_err(|error| MethodError::file(&path, error))?;
        let sidecar = serde_json::from_slice(&bytes);
        let Sidecar { crop } = sidecar.map_err(|error| MethodError::file(&path, error))?;
        let [x, y, width, height] = crop;
        Ok(Region {
            x,
            y,
            width,
            height,
        })
    }

    /// The part of the target that a pair's picture covers.
    fn region_of(
        &self,
        path: &Path,
        pair_id: &str,
        target: (u32, u32),
    ) -> Result<Option<Region>, MethodError> {
        let (own, sidecar) = match self.fit.crop() {
            CropRule::CenterOfOwnAspect => {
                let size = pictures::dimensions(path, &self.fit.reading().rules);
                (size.map_err(|e| MethodError::Model(e.to_string()))?, None)
            }
            CropRule::Sidecar => (None, Some(self.sidecar(pair_id)?)),
            _ => (None, None),
        };
        let region = self.fit.region(target, own, sidecar);
        region.map_err(|reason| MethodError::file(path, reason))
    }
}

impl Method for Imported {
    fn label(&self) -> &str {
        &self.label
    }

    /// The identity leaves out the folder, so that moving it keeps finished work valid. The bytes of each picture are
    /// hashed instead.
    fn identity(&self) -> MethodIdentity {
        MethodIdentity {
            kind: "imported".to_owned(),
            settings: self.fit.settings(),
        }
    }

    fn sources(&self) -> &'static str {
        fingerprints::FILES
    }

    fn input_files(&self, pair_id: &str) -> Result<Vec<PathBuf>, MethodError> {
        let mut files = vec![self.find(pair_id)?];
        if self.fit.crop() == CropRule::Sidecar {
            files.push(self.sidecar_path(pair_id));
        }
        Ok(files)
    }

    fn check_files(&self, pair_ids: &BTreeSet<String>) -> Result<(), String> {
        if pair_ids.iter().any(|id| self.find(id).is_ok()) {
            return Ok(());
        }
        suggestion(&self.dir, pair_ids, &Self::EXTENSIONS).map_or(Ok(()), Err)
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Pictures(self)
    }
}

/// Each scale has a folder of its own, `DIR/<scale>/`.
impl PredictAtScale for Imported {
    fn predict_at(
        &self,
        (folder, _): &Scale,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<PicturePrediction, MethodError> {
        self.in_folder(folder).predict(source, target)
    }

    fn input_files_at(
        &self,
        (folder, _): &Scale,
        pair_id: &str,
    ) -> Result<Vec<PathBuf>, MethodError> {
        self.in_folder(folder).input_files(pair_id)
    }

    fn check(&self, (folder, _): &Scale) -> Result<(), String> {
        let dir = self.dir.join(folder);
        if dir.is_dir() {
            Ok(())
        } else {
            Err(format!("{} is not a folder", dir.display()))
        }
    }
}

impl PredictPicture for Imported {
    fn predict(
        &self,
        _source: &SourceView,
        target: &TargetCamera,
    ) -> Result<PicturePrediction, MethodError> {
        let path = self.find(target.pair_id())?;
        let region = self.region_of(&path, target.pair_id(), target.size())?;
        self.fit.read(&path, region, target.size())
    }
}
