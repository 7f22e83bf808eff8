//! Where checkpoints lie.

use std::path::PathBuf;

/// File name of the official release's checkpoint.
pub const RELEASE_FILE: &str = "sharp_2572gikvuh.pt";

/// Where the official release downloads it from.
pub const RELEASE_ADDRESS: &str = "https://ml-site.cdn-apple.com/models/sharp/sharp_2572gikvuh.pt";

/// No checkpoint at hand.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "no SHARP checkpoint found (looked for {}); get the official one from {RELEASE_ADDRESS} or name one with \
     --checkpoint FILE (checkpoint=FILE in a method)",
    searched.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
)]
pub struct NoCheckpoint {
    /// Where it was looked for.
    pub searched: Vec<PathBuf>,
}

/// The release's checkpoint, where the release itself (torch's hub folder) or we keep it.
///
/// # Errors
/// [`NoCheckpoint`] with the places searched.
pub fn find_checkpoint() -> Result<PathBuf, NoCheckpoint> {
    let searched = candidates();
    match searched.iter().find(|path| path.is_file()) {
        Some(path) => Ok(path.clone()),
        None => Err(NoCheckpoint { searched }),
    }
}

/// Torch's hub folder first (`TORCH_HOME`, then the user's cache), then our cache.
fn candidates() -> Vec<PathBuf> {
    let variable = |name: &str| {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    let cache = variable("XDG_CACHE_HOME").or_else(|| Some(variable("HOME")?.join(".cache")));
    let torch = variable("TORCH_HOME").or_else(|| Some(cache.clone()?.join("torch")));
    let hub = torch.map(|torch| torch.join("hub/checkpoints"));
    let ours = cache.map(|cache| cache.join("sharp-bench"));
    hub.into_iter()
        .chain(ours)
        .map(|folder| folder.join(RELEASE_FILE))
        .collect()
}
