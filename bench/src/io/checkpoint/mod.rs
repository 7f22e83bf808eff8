//! SHARP's official checkpoint: what it is, where it lies, and whether it is still the same file.
//!
//! * [`release`]: name, address and licence.
//! * [`record`]: its size and sha256 from the first use on.
//! * `fetch`: getting it (feature `download`).

#[cfg(any(feature = "download", test))]
pub mod fetch;
pub mod record;
pub mod release;

use std::path::PathBuf;

use sharp_metrics::weights::cache_folder;

pub use release::{RELEASE_ADDRESS, RELEASE_FILE};

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "no SHARP checkpoint found (looked for {}); get the official one with `sharp-bench weights fetch sharp` or from \
     {RELEASE_ADDRESS}, or name one with --checkpoint FILE (checkpoint=FILE in a method)",
    searched.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
)]
pub struct NoCheckpoint {
    pub searched: Vec<PathBuf>,
}

/// The release's checkpoint, where the release itself (torch's hub folder) or we keep it.
pub fn find_checkpoint() -> Result<PathBuf, NoCheckpoint> {
    let ours = cache_folder().map(|folder| folder.join(RELEASE_FILE));
    first_file(hub_file(variable).into_iter().chain(ours).collect())
}

fn first_file(searched: Vec<PathBuf>) -> Result<PathBuf, NoCheckpoint> {
    match searched.iter().find(|path| path.is_file()) {
        Some(path) => Ok(path.clone()),
        None => Err(NoCheckpoint { searched }),
    }
}

fn variable(name: &str) -> Option<PathBuf> {
    std::env::var_os(name).map(PathBuf::from)
}

/// In torch's hub folder, by torch's own rule on every system: `TORCH_HOME`, else `torch` in `XDG_CACHE_HOME`, else
/// `~/.cache/torch`.
fn hub_file(variable: impl Fn(&str) -> Option<PathBuf>) -> Option<PathBuf> {
    let variable = |name| variable(name).filter(|value| !value.as_os_str().is_empty());
    let home = || variable("HOME").or_else(|| variable("USERPROFILE"));
    let cache = || variable("XDG_CACHE_HOME").or_else(|| Some(home()?.join(".cache")));
    let torch = variable("TORCH_HOME").or_else(|| Some(cache()?.join("torch")))?;
    Some(torch.join("hub").join("checkpoints").join(RELEASE_FILE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torchs_folder_is_found_by_torchs_rules() {
        let folder = |set: &[(&str, &str)]| {
            let found = hub_file(|name| {
                let (_, value) = set.iter().find(|(key, _)| *key == name)?;
                Some(PathBuf::from(value))
            });
            let ours = |path: PathBuf| path.parent().unwrap().to_owned();
            found.map(ours)
        };
        let (home, cache, torch) = (
            ("HOME", "/h"),
            ("XDG_CACHE_HOME", "/c"),
            ("TORCH_HOME", "/t"),
        );
        for (set, expected) in [
            (&[home, cache, torch][..], "/t/hub/checkpoints"),
            (&[home, cache], "/c/torch/hub/checkpoints"),
            (&[home], "/h/.cache/torch/hub/checkpoints"),
            (
                &[home, ("XDG_CACHE_HOME", ""), ("TORCH_HOME", "")],
                "/h/.cache/torch/hub/checkpoints",
            ),
            (&[("USERPROFILE", "/u")], "/u/.cache/torch/hub/checkpoints"),
        ] {
            assert_eq!(folder(set), Some(PathBuf::from(expected)), "{set:?}");
        }
        assert_eq!(folder(&[]), None);
    }

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
