//! Matching of a scene's pictures with the blocks of its log.
//!
//! A missing or extra picture must not shift the poses of all pictures after it. So pictures are
//! matched by their numbers, or by order if every block has a picture.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::DatasetError;
use crate::files::{self, Root};
use crate::format::trajectory::Log;
use crate::left_out::first_few;

#[derive(Debug)]
pub(super) struct ScenePhotographs {
    pub(super) folder: PathBuf,
    /// The pictures in natural order; at least one.
    pub(super) files: Vec<PathBuf>,
    /// Notes on other folders that contain pictures but are not read.
    pub(super) notes: Vec<String>,
}

impl ScenePhotographs {
    /// Searches for pictures in `images/` and `<name>/` next to the log, in the log's folder, and
    /// then in `image_sets/<name>/`, `images/<name>/` and `<name>/` in the root. Uses the first
    /// folder with as many pictures as there are blocks, else the first that contains a picture.
    ///
    /// # Errors
    /// If there are no pictures, or one of them points outside the root.
    pub(super) fn find(
        root: &Root,
        beside: &Path,
        name: &str,
        blocks: usize,
    ) -> Result<Self, DatasetError> {
        let top = root.path();
        let candidates = [
            beside.join("images"),
            beside.join(name),
            beside.to_owned(),
            top.join("image_sets").join(name),
            top.join("images").join(name),
            top.join(name),
        ];
        let (mut found, mut leading_out) = (Vec::new(), None);
        let mut seen = BTreeSet::new();
        for folder in candidates.into_iter().filter(|folder| folder.is_dir()) {
            let canonical = folder
                .canonicalize()
                .map_err(|e| DatasetError::io(&folder, e))?;
            if !seen.insert(canonical) {
                continue;
            }
            if let Err(error) = root.check(&folder) {
                leading_out.get_or_insert(error);
                continue;
            }
            let files: Vec<PathBuf> = pictures_in(&folder)?.collect();
            if !files.is_empty() {
                found.push((folder, files));
            }
        }
        if found.is_empty() {
            return Err(leading_out.unwrap_or_else(|| {
                DatasetError::malformed(
                    beside,
                    format!(
                        "no pictures of {name}: neither images/ nor {name}/ here, nor \
                         image_sets/{name}/"
                    ),
                )
            }));
        }
        let fitting = found.iter().position(|(_, files)| files.len() == blocks);
        let (folder, files) = found.remove(fitting.unwrap_or(0));
        for file in &files {
            root.check(file)?;
        }
        let mut notes: Vec<String> = found
            .iter()
            .map(|(other, files)| {
                format!(
                    "{name}: the pictures in {} are read, and the {} file(s) in {} are ignored",
                    folder.display(),
                    files.len(),
                    other.display()
                )
            })
            .collect();
        notes.extend(leading_out.map(|error| format!("{name}: a folder was not read ({error})")));
        Ok(Self {
            folder,
            files,
            notes,
        })
    }

    /// Assigns the pictures to the blocks of the log, and lists those without a block.
    ///
    /// If any name is a number, pictures are matched by number: block i belongs to the picture numbered i + 1. If the
    /// pictures' numbers start with 0 and end with the last block, block i belongs to the picture numbered i instead.
    /// Pictures without a number have no block. If no name is a number, there must be as many pictures as blocks, and
    /// they are matched by order.
    ///
    /// # Errors
    /// If pictures cannot be matched with poses; the error says why.
    pub(super) fn by_block(&self, log: &Log) -> Result<ByBlock<'_>, String> {
        let last = log.blocks.last().copied().unwrap_or(-1);
        let (numbered, unnumbered) = self.numbered()?;
        if numbered.is_empty() {
            return self.by_order(last, log.blocks.len());
        }
        let bounds = numbered.first_key_value().zip(numbered.last_key_value());
        let (least, most) = bounds.map_or((0, 0), |((least, _), (most, _))| (*least, *most));
        let counts = || {
            format!(
                "there are {} pictures numbered {least} to {most} in {}, but {} blocks with the indices {} to {last}",
                numbered.len(),
                self.folder.display(),
                log.blocks.len(),
                log.blocks.first().unwrap_or(&0),
            )
        };
        let first = match (least, log.blocks.first()) {
            (0, _) if most == last => 0,
            (0, _) => {
                return Err(format!(
                    "{}, so the poses cannot be assigned; number the pictures from 1 (block 0 belongs to picture 1), or \
                     from 0 to the last block",
                    counts()
                ));
            }
            (_, Some(1)) if most == last => {
                return Err(format!(
                    "{}; number the blocks from 0, because block k belongs to picture k + 1",
                    counts()
                ));
            }
            _ => 1,
        };
        let mut by_block = ByBlock {
            left_over: unnumbered,
            ..ByBlock::default()
        };
        for (number, file) in numbered {
            let block = number - first;
            if log.blocks.binary_search(&block).is_ok() {
                by_block.files.insert(block, file);
            } else {
                by_block.left_over.push(file);
            }
        }
        by_block.first_number = Some(first);
        Ok(by_block)
    }

    /// The pictures, keyed by their number, and those whose names are not numbers.
    fn numbered(&self) -> Result<Numbered<'_>, String> {
        let (mut numbered, mut others) = (BTreeMap::new(), Vec::new());
        for file in &self.files {
            let stem = file.file_stem().unwrap_or_default().to_string_lossy();
            // Digits only, because parsing would also accept a sign.
            let plain = stem.bytes().all(|c| c.is_ascii_digit());
            let Some(number) = stem.parse().ok().filter(|_| plain) else {
                others.push(file.as_path());
                continue;
            };
            if let Some(other) = numbered.insert(number, file.as_path()) {
                return Err(format!(
                    "{} and {} have the same number",
                    other.display(),
                    file.display()
                ));
            }
        }
        Ok((numbered, others))
    }

    fn by_order(&self, last: i64, blocks: usize) -> Result<ByBlock<'_>, String> {
        let count = self.files.len();
        if usize::try_from(last + 1) != Ok(count) {
            let names: Vec<String> = self
                .files
                .iter()
                .filter_map(|file| Some(file.file_name()?.to_string_lossy().into_owned()))
                .collect();
            return Err(format!(
                "there are {count} pictures in {}, but {blocks} blocks (the last has the index {last}), and no picture has a \
                 number as its name ({}), so the poses cannot be assigned; remove files that do not belong there, or \
                 name the pictures 000001, 000002 and so on, with block 0 for 000001",
                self.folder.display(),
                first_few(&names)
            ));
        }
        let files = self.files.iter().zip(0..);
        Ok(ByBlock {
            files: files.map(|(file, block)| (block, file.as_path())).collect(),
            ..ByBlock::default()
        })
    }
}

/// Photographs, keyed by their number, and those without a number.
type Numbered<'a> = (BTreeMap<i64, &'a Path>, Vec<&'a Path>);

/// Photographs, assigned to the blocks of a log.
#[derive(Debug, Default)]
pub(super) struct ByBlock<'a> {
    /// Photographs, keyed by the index of their block.
    pub(super) files: BTreeMap<i64, &'a Path>,
    /// Photographs without a block.
    pub(super) left_over: Vec<&'a Path>,
    /// Number of block 0's picture, if matched by numbers.
    pub(super) first_number: Option<i64>,
}

impl ByBlock<'_> {
    /// Describes a block in a note, with the number of its picture.
    pub(super) fn label(&self, block: i64) -> String {
        match self.first_number {
            Some(first) => format!("block {block} (picture {:06})", block.saturating_add(first)),
            None => format!("block {block}"),
        }
    }
}

/// True if a folder contains pictures named by numbers, as in an image set.
pub(super) fn has_pictures(folder: &Path) -> bool {
    let is_number = |path: PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        stem.bytes().all(|c| c.is_ascii_digit())
    };
    pictures_in(folder).is_ok_and(|mut pictures| pictures.any(is_number))
}

/// The pictures of a folder in natural order.
fn pictures_in(folder: &Path) -> Result<impl Iterator<Item = PathBuf>, DatasetError> {
    Ok(files::pictures(folder)?.into_iter().map(|(_, path)| path))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pictures(names: &[&str]) -> ScenePhotographs {
        ScenePhotographs {
            folder: PathBuf::from("images"),
            files: names.iter().map(PathBuf::from).collect(),
            notes: Vec::new(),
        }
    }

    fn log(blocks: &[i64]) -> Log {
        Log {
            blocks: blocks.to_vec(),
            poses: Vec::new(),
        }
    }

    #[test]
    fn numbers_count_and_not_the_order() {
        for (names, blocks, expected, left_over) in [
            (
                &["1.jpg", "2.jpg", "3.jpg"][..],
                &[0, 1, 2][..],
                "0:1 1:2 2:3",
                0,
            ),
            (
                &["000001.jpg", "000003.PNG"],
                &[0, 1, 2],
                "0:000001 2:000003",
                0,
            ),
            (&["1.jpg", "2.jpg", "9.jpg"], &[0, 1, 2], "0:1 1:2", 1),
            (&["1.jpg", "2.jpg", "3.jpg"], &[0, 2], "0:1 2:3", 1),
            (&["2.jpg", "3.jpg"], &[0, 1], "1:2", 1),
            (&["0.jpg", "2.jpg"], &[0, 1, 2], "0:0 2:2", 0),
            // Pictures without a number have no block, however many they are.
            (
                &["000000_preview.jpg", "1.jpg", "3.jpg", "cover.jpg"],
                &[0, 1, 2, 3],
                "0:1 2:3",
                2,
            ),
            // A log without its first block.
            (&["1.jpg", "2.jpg", "3.jpg"], &[1, 2], "1:2 2:3", 1),
        ] {
            let pictures = pictures(names);
            let found = pictures.by_block(&log(blocks)).unwrap();
            let pairs: Vec<String> = found
                .files
                .iter()
                .map(|(block, file)| {
                    format!("{block}:{}", file.file_stem().unwrap().to_string_lossy())
                })
                .collect();
            assert_eq!(pairs.join(" "), expected, "{names:?} {blocks:?}");
            assert_eq!(found.left_over.len(), left_over, "{names:?} {blocks:?}");
        }
    }

    #[test]
    fn names_count_by_order_only_where_each_block_has_its_picture() {
        let named = pictures(&["a.jpg", "b.jpg"]);
        let found = named.by_block(&log(&[0, 1])).unwrap();
        assert_eq!(
            found.files.values().collect::<Vec<_>>(),
            [&Path::new("a.jpg"), &Path::new("b.jpg")]
        );
        assert_eq!(found.first_number, None);
    }

    #[test]
    fn poses_that_might_be_shifted_are_refused() {
        for (names, blocks, reason) in [
            (
                &["a.jpg", "b.jpg"][..],
                &[0, 1, 2][..],
                "2 pictures in images, but 3 blocks",
            ),
            (&["a.jpg", "b.jpg"], &[0, 2], "the last has the index 2"),
            (&["+1.jpg", "b.jpg"], &[0], "as its name (+1.jpg, b.jpg)"),
            (
                &["0.jpg", "1.jpg", "2.jpg"],
                &[0, 1],
                "numbered 0 to 2 in images, but 2 blocks",
            ),
            (&["1.jpg", "2.jpg"], &[1, 2], "number the blocks from 0"),
            (&["1.jpg", "01.jpg"], &[0, 1], "the same number"),
        ] {
            let error = pictures(names).by_block(&log(blocks)).unwrap_err();
            assert!(error.contains(reason), "{names:?} {blocks:?}: {error}");
        }
    }
}
