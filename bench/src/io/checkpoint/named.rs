//! Networks given by name: a file, the bundled network, or the official checkpoint by default.

use std::path::{Path, PathBuf};

use sharp::model::depth_pro::is_depth_pro;
use sharp::model::inventory::CheckpointSource;
use sharp::model::{ModelConfig, ModelError, NetworkSpec, bundled};
use sharp_metrics::weights::own_folders;

use super::{NoCheckpoint, find_checkpoint};
use crate::io::atomic_files::FileError;
use crate::io::hash::file_sha256;

/// Why no network was found for a name.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    #[error(transparent)]
    NoCheckpoint(#[from] NoCheckpoint),
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    File(#[from] FileError),
    #[error(
        "{source} (compared with the network `{preset}`); for a network of another size, give its configuration: \
         config=FILE.json#NAME in --method, else --config"
    )]
    Sizes {
        preset: String,
        source: Box<ModelError>,
    },
    /// The checkpoint is Depth Pro's, but SHARP's is needed.
    #[error(
        "{}: Depth Pro's weights, which predict depth instead of Gaussians; pass them to `predict --depth-only`, \
         and give SHARP's weights here",
        checkpoint.display()
    )]
    DepthPro { checkpoint: PathBuf },
    #[error(
        "{}: several configurations in the same folder fit this checkpoint ({names}); choose one: \
         config=FILE.json#NAME in --method, else --config", checkpoint.display()
    )]
    SeveralConfigs { checkpoint: PathBuf, names: String },
    #[error(
        "checkpoint `{}` has its own configuration; remove the given one, or write ./{} if you \
         mean a file",
        bundled::NAME,
        bundled::NAME
    )]
    TwoConfigs,
    /// The file of the bundled network is missing.
    #[error(
        "the weights of the checkpoint `{}` are missing (looked for {}); they must be copied along with the program",
        bundled::NAME,
        searched.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    NotBundled { searched: Vec<PathBuf> },
    #[error(
        "{}: not the weights that belong to this program (sha256 {sha256}, expected {})",
        path.display(),
        bundled::weights_sha256()
    )]
    OtherWeights { path: PathBuf, sha256: String },
}

/// The network of a checkpoint, on the CPU. `checkpoint` is a file, or `mini` for the bundled network; if `checkpoint`
/// is `None`, the official checkpoint is searched for. `mini` has its own configuration. Any other checkpoint has the
/// configuration `config` (`FILE.json#NAME`), if given. Without it, the official checkpoint has the release's
/// configuration, and a file has the first of these that fits: `STEM.json` next to the file, the release's, any other
/// `.json` next to the file.
///
/// # Errors
/// [`NetworkError`] if no checkpoint is found, if the file or its configuration cannot be read, if several
/// configurations fit, or if `config` is given for `mini`.
pub fn named_network(
    checkpoint: Option<&Path>,
    config: Option<&str>,
) -> Result<NetworkSpec, NetworkError> {
    let (checkpoint, config) = match (checkpoint, config) {
        (Some(name), config) if name == Path::new(bundled::NAME) => match config {
            None => (bundled_weights()?, bundled::config()?),
            Some(_) => return Err(NetworkError::TwoConfigs),
        },
        (Some(file), config) => return network_of(file, config),
        (None, config) => {
            let found = find_checkpoint()?;
            let config = config.map_or_else(|| Ok(ModelConfig::release()), ModelConfig::load)?;
            let notes = CheckpointSource::open(&found)?.implausible_weights()?;
            return Ok(NetworkSpec {
                config,
                notes: notes.into_iter().collect(),
                ..NetworkSpec::release(found)
            });
        }
    };
    Ok(NetworkSpec {
        config,
        ..NetworkSpec::release(checkpoint)
    })
}

/// Depth Pro's network from a file, on the CPU. `config` (`FILE.json#NAME`) states the layer sizes;
/// only those of the depth network are used. Without `config`, the sizes are those of Depth Pro's
/// release, which equal SHARP's.
///
/// # Errors
/// [`NetworkError`] if the configuration cannot be read.
pub fn depth_pro_network(
    checkpoint: &Path,
    config: Option<&str>,
) -> Result<NetworkSpec, NetworkError> {
    Ok(NetworkSpec {
        config: config.map_or_else(|| Ok(ModelConfig::release()), ModelConfig::load)?,
        ..NetworkSpec::release(checkpoint)
    })
}

/// The network in a file. Its configuration is the first available of: `config`, `STEM.json` next to the file, the
/// release's, or the only fitting one in the `.json` files next to the file.
fn network_of(file: &Path, config: Option<&str>) -> Result<NetworkSpec, NetworkError> {
    let source = CheckpointSource::open(file)?;
    if is_depth_pro(&source) {
        let checkpoint = file.to_owned();
        return Err(NetworkError::DepthPro { checkpoint });
    }
    // Allow additional tensors here; whether they may stay unused is decided later.
    let fits = |config: &ModelConfig| source.check(config, &[String::new()]);
    let mut notes = Vec::new();
    notes.extend(source.left_out().map(|prefix| {
        format!("all names in the checkpoint have the prefix `{prefix}`, which is ignored")
    }));
    notes.extend(source.implausible_weights()?);
    let release = ModelConfig::release();
    let own = ModelConfig::all_of(&file.with_extension("json"));
    let config = match config {
        Some(config) => ModelConfig::load(config)?,
        None if own.is_empty() && fits(&release).is_ok() => release,
        None => {
            let found = beside(file);
            let (fitting, others): (Vec<_>, Vec<_>) = found
                .into_iter()
                .partition(|(_, config)| fits(config).is_ok());
            match &fitting[..] {
                // Its own configuration explains best what does not fit.
                [] => match others.into_iter().next() {
                    Some((name, config)) if !own.is_empty() => ModelConfig {
                        preset: name,
                        ..config
                    },
                    _ => release,
                },
                [(name, config)] => {
                    notes.push(format!(
                        "the checkpoint's tensor shapes match {name} next to the file"
                    ));
                    config.clone()
                }
                several => {
                    let names = several.iter().map(|(name, _)| name.as_str());
                    return Err(NetworkError::SeveralConfigs {
                        checkpoint: file.to_owned(),
                        names: names.collect::<Vec<_>>().join(", "),
                    });
                }
            }
        }
    };
    fits(&config).map_err(|source| match source {
        // No configuration fits empty placeholders.
        ModelError::Incomplete(found) if found.placeholders() > 0 => {
            NetworkError::Model(found.into())
        }
        source => NetworkError::Sizes {
            preset: config.preset.clone(),
            source: Box::new(source),
        },
    })?;
    Ok(NetworkSpec {
        config,
        notes,
        ..NetworkSpec::release(file)
    })
}

/// Configurations, each with its `FILE#NAME`: those in `STEM.json` next to the checkpoint or, if
/// that file has none, those in all `.json` files in the checkpoint's folder.
fn beside(checkpoint: &Path) -> Vec<(String, ModelConfig)> {
    let own = checkpoint.with_extension("json");
    let of_file = |path: &Path| {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let configs = ModelConfig::all_of(path).into_iter();
        let named = configs.map(|(name, config)| {
            if name.is_empty() {
                (file.to_string(), config)
            } else {
                (format!("{file}#{name}"), config)
            }
        });
        named.collect::<Vec<_>>()
    };
    let found = of_file(&own);
    if !found.is_empty() {
        return found;
    }
    let folder = checkpoint.parent().filter(|p| !p.as_os_str().is_empty());
    let entries = std::fs::read_dir(folder.unwrap_or(Path::new("."))).into_iter();
    let paths = entries.flatten().flatten().map(|entry| entry.path());
    let mut paths: Vec<PathBuf> = paths
        .filter(|path| path.extension().is_some_and(|end| end == "json"))
        .collect();
    paths.sort();
    paths.iter().flat_map(|path| of_file(path)).collect()
}

/// The file with the bundled network's weights, searched for next to the program and in the program's source tree.
///
/// # Errors
/// [`NetworkError`] if there is no such file, or its content does not belong to this program.
pub fn bundled_weights() -> Result<PathBuf, NetworkError> {
    let folders = own_folders().into_iter();
    let folders = folders.chain([bundled::source_folder().to_owned()]);
    let searched: Vec<PathBuf> = folders.map(|folder| folder.join(bundled::FILE)).collect();
    let Some(path) = searched.iter().find(|path| path.is_file()) else {
        return Err(NetworkError::NotBundled { searched });
    };
    let sha256 = file_sha256(path)?;
    if sha256 == bundled::weights_sha256() {
        Ok(path.clone())
    } else {
        Err(NetworkError::OtherWeights {
            path: path.clone(),
            sha256,
        })
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
        let file = named_network(Some(Path::new("./mini")), None);
        assert!(file.unwrap_err().to_string().contains("./mini"));
    }
}
