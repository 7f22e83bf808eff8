//! Pictures without depth, for self-supervised fine-tuning.

use std::path::{Path, PathBuf};

use image::RgbImage;
use sharp::camera::Intrinsics;
use sharp::color::{Quantization, quantize};
use sharp::model::preprocess::{Photo, PhotoOptions, load_photo};
use sharp_datasets::files;

use super::procedural::{TrainingWorlds, scene};
use super::view::resized;
use super::{DataError, Photograph, Source, draws};

/// Accepted file extensions, in lower case.
const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Pictures below a folder: the path relative to it, with `/` as the separator, and the file.
type Pictures = Vec<(String, PathBuf)>;

/// PNG and JPEG files of a folder and its subfolders. Photograph k is drawn from these files at
/// random.
#[derive(Debug, Clone)]
pub struct FolderPhotographs {
    seed: u64,
    size: (u32, u32),
    files: Pictures,
}

/// True if the file or subfolder at `index` of a folder is held out.
fn is_held_out(index: usize, every: Option<usize>) -> bool {
    every.is_some_and(|every| (index + 1).is_multiple_of(every))
}

/// The files and subfolders directly in a folder that are held out of training: every `every`-th one that has pictures.
///
/// # Errors
/// [`DataError::Dataset`] if the folder cannot be read.
pub fn held_out_entries(folder: &Path, every: usize) -> Result<Vec<PathBuf>, DataError> {
    let entries = entries(folder)?.into_iter().enumerate();
    let held_out = entries.filter(|(index, _)| is_held_out(*index, Some(every)));
    Ok(held_out.map(|(_, (path, _))| path).collect())
}

/// The files and subfolders directly in a folder that have pictures, each with its [`Pictures`].
fn entries(folder: &Path) -> Result<Vec<(PathBuf, Pictures)>, DataError> {
    let mut all = Vec::new();
    find(folder, "", &mut all)?;
    let mut entries: Vec<(PathBuf, Pictures)> = Vec::new();
    for (name, path) in all {
        let entry = folder.join(name.split('/').next().unwrap_or_default());
        match entries.last_mut() {
            Some((last, pictures)) if *last == entry => pictures.push((name, path)),
            _ => entries.push((entry, vec![(name, path)])),
        }
    }
    Ok(entries)
}

/// Adds the pictures below `folder` to `found`. `inside` is the path of `folder` relative to the top folder, and ends
/// with `/` unless empty. Links to folders are not followed, because they may form a cycle.
fn find(folder: &Path, inside: &str, found: &mut Pictures) -> Result<(), DataError> {
    for (name, path) in files::list(folder)? {
        let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
        if path.is_dir() && !path.is_symlink() {
            find(&path, &format!("{inside}{name}/"), found)?;
        } else if path.is_file() && ENDINGS.iter().any(|known| ending == *known) {
            found.push((format!("{inside}{name}"), path));
        }
    }
    Ok(())
}

impl FolderPhotographs {
    /// Lists a folder without its [held-out entries](held_out_entries); pictures are resized to `size` (width, height)
    /// in pixels.
    ///
    /// # Errors
    /// [`DataError::Dataset`] if the folder cannot be read; [`DataError::NoPicture`] if the folder
    /// has no pictures; [`DataError::Unsplit`] if nothing would be held out.
    pub fn open(
        folder: &Path,
        held_out: Option<usize>,
        seed: u64,
        size: (u32, u32),
    ) -> Result<Self, DataError> {
        let entries = entries(folder)?;
        let (count, folder) = (entries.len(), folder.to_owned());
        let kept = entries.into_iter().enumerate();
        let kept = kept.filter(|(index, _)| !is_held_out(*index, held_out));
        let files: Vec<_> = kept.flat_map(|(_, (_, pictures))| pictures).collect();
        match held_out {
            _ if files.is_empty() => Err(DataError::NoPicture { folder }),
            Some(every) if count < every => Err(DataError::Unsplit {
                folder,
                count,
                every,
            }),
            _ => Ok(Self { seed, size, files }),
        }
    }

    /// Reads a file and turns it upright. The focal length is the file's, or 30 mm (35 mm
    /// equivalent) if the file states none.
    fn read(&self, id: &str, path: &Path) -> Result<Photograph, DataError> {
        let photo = load_photo(path, &PhotoOptions::default())?;
        let (width, height) = (photo.width as u32, photo.height as u32);
        let middle = (0.5 * f64::from(width), 0.5 * f64::from(height));
        let focal = (photo.focal_px, photo.focal_px);
        let intrinsics = Intrinsics::new(focal, middle, (width, height))?;
        Ok(Photograph {
            id: id.to_owned(),
            image: resized(eight_bit(&photo, (width, height)), self.size)?,
            intrinsics: intrinsics.resized(self.size.0, self.size.1),
        })
    }
}

impl Source<Photograph> for FolderPhotographs {
    fn get(&self, k: u64) -> Result<Photograph, DataError> {
        let index = draws(self.seed, k).below(self.files.len() as u64);
        let (id, path) = &self.files[index as usize];
        self.read(id, path).map_err(|error| error.of_sample(id))
    }
}

/// Converts a photograph's planes to an 8-bit picture; exact for an 8-bit file.
fn eight_bit(photo: &Photo, (width, height): (u32, u32)) -> RgbImage {
    let plane = photo.width * photo.height;
    RgbImage::from_fn(width, height, |x, y| {
        let at = y as usize * photo.width + x as usize;
        let channel = |c: usize| quantize(photo.values[c * plane + at], Quantization::Round);
        image::Rgb([channel(0), channel(1), channel(2)])
    })
}

/// Pictures of the procedural training scenes: photograph k is a random view of a random scene.
#[derive(Debug, Clone)]
pub struct ProceduralPhotographs {
    seed: u64,
    size: (u32, u32),
    worlds: TrainingWorlds,
}

/// Combined with the seed, so that the photographs show scenes other than those of a first stage
/// with the same seed.
const PHOTOGRAPH_SEED: u64 = 0x5048_4f54;

impl ProceduralPhotographs {
    /// Creates a source with the given seed and picture size (width, height) in pixels.
    pub fn new(seed: u64, size: (u32, u32), worlds: TrainingWorlds) -> Self {
        Self { seed, size, worlds }
    }
}

impl Source<Photograph> for ProceduralPhotographs {
    fn get(&self, k: u64) -> Result<Photograph, DataError> {
        let mut random = draws(self.seed ^ PHOTOGRAPH_SEED, k);
        let (scene, views) = scene(&mut random, self.size, self.worlds.of(k))?;
        let view = &views[random.below(views.len() as u64) as usize];
        let id = format!("{scene}/{}", view.id);
        let image = view.content.image();
        Ok(Photograph {
            image: image.map_err(|error| DataError::from(error).of_sample(&id))?,
            intrinsics: view.intrinsics,
            id,
        })
    }
}
