//! SHARP's official checkpoint and other published networks (facts, location, integrity), and networks by name.
//!
//! * [`release`]: name, address and licence.
//! * [`record`]: size and SHA-256, recorded at the first use.
//! * `fetch`: the download.
//! * [`named_network`]: any network by name, including the bundled one; [`depth_pro_network`]: Depth Pro's network from
//!   a file.

pub mod fetch;
mod named;
pub mod record;
pub mod release;

use std::path::PathBuf;

use sharp_metrics::weights::{cache_folder, torch_hub};

pub use named::{NetworkError, bundled_weights, depth_pro_network, named_network};
pub use release::{RELEASE_ADDRESS, RELEASE_FILE};

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "no SHARP checkpoint found (looked for {}); get the official one with `sharp-bench weights \
     fetch sharp` or from {RELEASE_ADDRESS}, or give one with --checkpoint FILE (checkpoint=FILE \
     in a method); `mini` is the small network that comes with this program",
    searched.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
)]
pub struct NoCheckpoint {
    pub searched: Vec<PathBuf>,
}

/// The release's checkpoint, searched for in torch's hub folder (where the release stores it) and in sharp-bench's
/// cache.
pub fn find_checkpoint() -> Result<PathBuf, NoCheckpoint> {
    first_file(places_of(RELEASE_FILE))
}

/// File name of Depth Pro's checkpoint, as its authors distribute it.
pub const DEPTH_PRO_FILE: &str = "depth_pro.pt";

/// Depth Pro's checkpoint in torch's hub folder or in sharp-bench's cache; `None` if neither folder has it.
pub fn find_depth_pro() -> Option<PathBuf> {
    first_file(places_of(DEPTH_PRO_FILE)).ok()
}

/// The encoder of the paper's perceptual loss in sharp-bench's cache; `None` if the cache does not have it.
pub fn find_resnet() -> Option<PathBuf> {
    first_file(
        cache_folder()
            .into_iter()
            .map(|folder| folder.join(release::RESNET_FILE))
            .collect(),
    )
    .ok()
}

fn places_of(name: &str) -> Vec<PathBuf> {
    let folders = torch_hub().into_iter().chain(cache_folder());
    folders.map(|folder| folder.join(name)).collect()
}

fn first_file(searched: Vec<PathBuf>) -> Result<PathBuf, NoCheckpoint> {
    match searched.iter().find(|path| path.is_file()) {
        Some(path) => Ok(path.clone()),
        None => Err(NoCheckpoint { searched }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_file_wins_and_absence_names_every_place() {
        let dir = tempfile::tempdir().unwrap();
        let places: Vec<PathBuf> = ["a", "b", "c"].map(|name| dir.path().join(name)).into();
        let error = first_file(places.clone()).unwrap_err().to_string();
        for place in &places {
            assert!(error.contains(place.to_str().unwrap()), "{error}");
        }
        assert!(error.contains("weights fetch sharp") && error.contains(RELEASE_ADDRESS));
        for place in &places[1..] {
            std::fs::write(place, b"").unwrap();
        }
        assert_eq!(first_file(places.clone()), Ok(places[1].clone()));
    }
}
