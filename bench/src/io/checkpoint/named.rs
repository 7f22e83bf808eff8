//! A network as people name it: by a file, by the name of the one that comes with the program, or not at all.

use std::path::{Path, PathBuf};

use sharp::model::{ModelConfig, ModelError, NetworkSpec, bundled};
use sharp_metrics::weights::own_folder;

use super::{NoCheckpoint, find_checkpoint};
use crate::io::atomic_files::FileError;
use crate::io::hash::file_sha256;

/// Why a name is none of a network.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    #[error(transparent)]
    NoCheckpoint(#[from] NoCheckpoint),
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    File(#[from] FileError),
    #[error(
        "checkpoint `{}` brings its own configuration; leave out the other one, or name the file as ./{}",
        bundled::NAME,
        bundled::NAME
    )]
    TwoConfigs,
    /// The file of the bundled network did not come along.
    #[error(
        "the weights of the checkpoint `{}` are not at hand (looked for {}); they travel beside the program",
        bundled::NAME,
        searched.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    NotBundled { searched: Vec<PathBuf> },
    #[error(
        "{}: not the weights that belong to this program: sha256 {sha256}, not {}",
        path.display(),
        bundled::weights_sha256()
    )]
    OtherWeights { path: PathBuf, sha256: String },
}

/// The network of a checkpoint, on the CPU. `mini` is the bundled one, with its sizes; any other name is a file, whose
/// sizes are those of `config` (`FILE.json#NAME`) or the release's; without a name it is the official one, where it is found.
///
/// # Errors
/// [`NetworkError`].
pub fn named_network(
    checkpoint: Option<&Path>,
    config: Option<&str>,
) -> Result<NetworkSpec, NetworkError> {
    let (checkpoint, config) = match (checkpoint, config) {
        (Some(name), config) if name == Path::new(bundled::NAME) => match config {
            None => (bundled_weights()?, bundled::config()?),
            Some(_) => return Err(NetworkError::TwoConfigs),
        },
        (file, config) => (
            file.map_or_else(find_checkpoint, |file| Ok(file.to_owned()))?,
            config.map_or_else(|| Ok(ModelConfig::release()), ModelConfig::load)?,
        ),
    };
    Ok(NetworkSpec {
        config,
        ..NetworkSpec::release(checkpoint)
    })
}

/// The weights of the bundled network: beside the program, or in the sources that it was built from.
///
/// # Errors
/// [`NetworkError`].
pub fn bundled_weights() -> Result<PathBuf, NetworkError> {
    let folders = own_folder().into_iter();
    let folders = folders.chain([bundled::source_folder().to_owned()]);
    let searched: Vec<PathBuf> = folders.map(|folder| folder.join(bundled::FILE)).collect();
    let Some(path) = searched.iter().find(|path| path.is_file()) else {
        return Err(NetworkError::NotBundled { searched });
    };
    let sha256 = file_sha256(path)?;
    match sha256 == bundled::weights_sha256() {
        true => Ok(path.clone()),
        false => Err(NetworkError::OtherWeights {
            path: path.clone(),
            sha256,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bundled_network_has_its_own_sizes_and_a_file_of_its_name_a_folder() {
        let mini = named_network(Some(Path::new("mini")), None).unwrap();
        assert_eq!(mini.config, bundled::config().unwrap());
        assert!(mini.checkpoint.is_file());
        let both = named_network(Some(Path::new("mini")), Some("x.json"));
        assert!(both.unwrap_err().to_string().contains("./mini"));
        let file = named_network(Some(Path::new("./mini")), None).unwrap();
        assert_eq!(file.checkpoint, Path::new("./mini"));
        assert_eq!(file.config, ModelConfig::release());
    }
}
