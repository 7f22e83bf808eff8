//! Matches pictures and masks.

use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};

use crate::pictures::matching::{Match, MatchBy, match_folders, partner, shared_part};

/// The files of one pair.
pub(super) struct Input {
    pub(super) prediction: PathBuf,
    pub(super) target: PathBuf,
    pub(super) mask: Option<PathBuf>,
    /// Name of the pair's maps, unique among the pairs.
    pub(super) name: String,
}

/// The pair of two pictures, or all pairs of two folders, each with its mask.
pub(super) fn pairs(
    prediction: &Path,
    target: &Path,
    mask: Option<&Path>,
    by: MatchBy,
) -> anyhow::Result<Vec<Input>> {
    for path in [prediction, target] {
        ensure!(path.exists(), "{}: does not exist", path.display());
    }
    let pairs = match (prediction.is_dir(), target.is_dir()) {
        (true, true) => match_folders(prediction, target, by)?,
        (false, false) => vec![Match {
            key: shared_part(prediction, by),
            prediction: prediction.to_owned(),
            target: target.to_owned(),
        }],
        _ => bail!(
            "{} and {}: give two pictures or two folders",
            prediction.display(),
            target.display()
        ),
    };
    let input = |found: Match| {
        let mask = match mask {
            Some(folder) if folder.is_dir() => {
                Some(partner(&found.key, &found.prediction, folder, by)?)
            }
            other => other.map(Path::to_owned),
        };
        Ok(Input {
            name: found.key,
            prediction: found.prediction,
            target: found.target,
            mask,
        })
    };
    pairs.into_iter().map(input).collect()
}
