//! Addresses of torchvision's published weights, and the local folders that are searched for weights.

use std::borrow::Cow;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use super::{Backbone, Weights, WeightsSource};

/// A published weights file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Published {
    pub backbone: Backbone,
    /// File name, which ends with the first digits of the file's SHA-256.
    pub file: Cow<'static, str>,
    pub address: Cow<'static, str>,
    /// Published size in thousandths of a MiB.
    pub size_milli_mib: u64,
    /// First digits of the file's SHA-256.
    pub sha256_prefix: Cow<'static, str>,
    pub licence: &'static str,
}

impl Published {
    /// torchvision's file for a network.
    pub fn of(backbone: Backbone) -> Self {
        let (file, size_milli_mib, sha256_prefix) = match backbone {
            Backbone::AlexNet => ("alexnet-owt-7be5be79.pth", 233_087, "7be5be79"),
            Backbone::Vgg16 => ("vgg16-397923af.pth", 527_796, "397923af"),
            Backbone::SqueezeNet1_1 => ("squeezenet1_1-b8a52dc0.pth", 4_729, "b8a52dc0"),
        };
        Self {
            backbone,
            file: file.into(),
            address: mirrored(&format!("https://download.pytorch.org/models/{file}")).into(),
            size_milli_mib,
            sha256_prefix: sha256_prefix.into(),
            licence: "BSD-3-Clause (torchvision)",
        }
    }

    /// File sizes in bytes that round to the published size.
    pub fn sizes(&self) -> RangeInclusive<u64> {
        const MIB: u64 = 1 << 20;
        // In units of a two-thousandth of a MiB, the published size s covers 2 s − 1 to 2 s + 1.
        let (low, high) = (2 * self.size_milli_mib - 1, 2 * self.size_milli_mib + 1);
        (low * MIB).div_ceil(2000)..=high * MIB / 2000
    }

    /// Path of the features-only copy in a cache folder.
    pub fn cached(&self, cache: &Path) -> PathBuf {
        let stem = self.file.trim_end_matches(".pth");
        cache.join(format!("{stem}.features.safetensors"))
    }

    /// The file with the network's weights in `folder`, if there is one. Accepted file names: that
    /// of this program's own downloads, torchvision's, and the network's name.
    fn in_folder(&self, folder: &Path) -> Option<PathBuf> {
        let plain = folder.join(format!("{}.safetensors", self.backbone));
        let files = [self.cached(folder), folder.join(&*self.file), plain];
        files.into_iter().find(|file| file.is_file())
    }
}

/// Address from which to download a published file: the publisher's, or the same file name under `SHARP_BENCH_MIRROR`,
/// if that is set.
pub fn mirrored(address: &str) -> String {
    let mirror = std::env::var("SHARP_BENCH_MIRROR").unwrap_or_default();
    match address.rsplit_once('/') {
        Some((_, file)) if !mirror.is_empty() => {
            format!("{}/{file}", mirror.trim_end_matches('/'))
        }
        _ => address.to_owned(),
    }
}

/// Folder of downloaded weights: `SHARP_BENCH_WEIGHTS` if set, else `weights` in [`user_cache`];
/// `None` if neither is defined.
pub fn cache_folder() -> Option<PathBuf> {
    let given = variable("SHARP_BENCH_WEIGHTS");
    given.or_else(|| user_cache().map(|cache| cache.join("weights")))
}

/// Folder for data that can be downloaded or computed again: `sharp-bench` in `XDG_CACHE_HOME` if that is set, else in
/// the system's cache folder; `None` if the environment defines neither.
pub fn user_cache() -> Option<PathBuf> {
    let systems = || {
        if cfg!(windows) {
            return variable("LOCALAPPDATA");
        }
        let inside = if cfg!(target_os = "macos") {
            "Library/Caches"
        } else {
            ".cache"
        };
        Some(variable("HOME")?.join(inside))
    };
    let base = variable("XDG_CACHE_HOME").or_else(systems)?;
    Some(base.join("sharp-bench"))
}

/// Folder of torch's downloads, by torch's own rule on every system: `TORCH_HOME`, else `torch` in `XDG_CACHE_HOME`,
/// else `~/.cache/torch`.
pub fn torch_hub() -> Option<PathBuf> {
    torch_hub_by(variable)
}

fn torch_hub_by(variable: impl Fn(&str) -> Option<PathBuf>) -> Option<PathBuf> {
    let home = || variable("HOME").or_else(|| variable("USERPROFILE"));
    let cache = || variable("XDG_CACHE_HOME").or_else(|| Some(home()?.join(".cache")));
    let torch = variable("TORCH_HOME").or_else(|| Some(cache()?.join("torch")))?;
    Some(torch.join("hub").join("checkpoints"))
}

fn variable(name: &str) -> Option<PathBuf> {
    let value = std::env::var_os(name).filter(|value| !value.is_empty());
    value.map(PathBuf::from)
}

/// Folders of bundled files, as set by [`lies_in`] if this code is a library inside another program.
static OWN_FOLDERS: OnceLock<Vec<PathBuf>> = OnceLock::new();

/// For a library inside another program: sets the folders of bundled files, searched in this order instead of the
/// executable's own. Only the first call has an effect; call it before any weights are searched for.
pub fn lies_in(folders: Vec<PathBuf>) {
    OWN_FOLDERS.get_or_init(|| folders);
}

/// Folders of the program's bundled files: those [set](lies_in), or else the folder of the executable.
pub fn own_folders() -> Vec<PathBuf> {
    let beside = || Some(std::env::current_exe().ok()?.parent()?.to_owned());
    let set = OWN_FOLDERS.get().cloned();
    set.unwrap_or_else(|| beside().into_iter().collect())
}

impl Weights {
    /// Locally available weights. Each network's weights are taken from the first of these sources that has them:
    ///
    /// 1. the download folder ([`cache_folder`]);
    /// 2. for AlexNet, the program itself; for other networks, the bundled files ([`own_folders`], then
    ///    `metrics/weights` in the source code), which include VGG16;
    /// 3. torch's hub folder ([`torch_hub`]).
    pub fn at_hand() -> Self {
        let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("weights");
        let bundled = [own_folders(), vec![sources]].concat();
        let [cache, hub] = [cache_folder(), torch_hub()].map(Option::unwrap_or_default);
        Self::found_in(&cache, &bundled, &hub)
    }

    fn found_in(cache: &Path, bundled: &[PathBuf], hub: &Path) -> Self {
        let find = |backbone| {
            let published = Published::of(backbone);
            let file = |folder: &Path| Some(WeightsSource::File(published.in_folder(folder)?));
            let built_in = || match backbone {
                Backbone::AlexNet => Some(WeightsSource::BuiltIn),
                _ => bundled.iter().find_map(|folder| file(folder)),
            };
            file(cache).or_else(built_in).or_else(|| file(hub))
        };
        let sources = Backbone::ALL.into_iter();
        let sources = sources.filter_map(|backbone| Some((backbone, find(backbone)?)));
        Self {
            sources: sources.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_carry_the_hash_and_sizes_are_checked_to_the_published_digit() {
        for backbone in Backbone::ALL {
            let published = Published::of(backbone);
            assert!(published.file.contains(&*published.sha256_prefix));
            assert!(published.address.ends_with(&*published.file));
        }
        let vgg = Published::of(Backbone::Vgg16).sizes();
        assert!(vgg.contains(&553_433_881));
        assert!(!vgg.contains(&(553_433_881 + 2_000)) && !vgg.contains(&(553_433_881 - 2_000)));
    }

    #[test]
    fn the_first_place_that_has_weights_is_taken() {
        let dir = tempfile::tempdir().unwrap();
        let [cache, empty, bundled, hub] = ["cache", "empty", "bundled", "hub"].map(|name| {
            let folder = dir.path().join(name);
            std::fs::create_dir(&folder).unwrap();
            folder
        });
        let put = |folder: &Path, file: &str| {
            std::fs::write(folder.join(file), b"").unwrap();
            Some(WeightsSource::File(folder.join(file)))
        };
        let found = || Weights::found_in(&cache, &[empty.clone(), bundled.clone()], &hub);
        let of = |backbone| found().source(backbone).cloned();

        assert_eq!(of(Backbone::AlexNet), Some(WeightsSource::BuiltIn));
        assert_eq!(of(Backbone::Vgg16), None);
        let torchs = put(&hub, "vgg16-397923af.pth");
        assert_eq!(of(Backbone::Vgg16), torchs);
        let ours = put(&bundled, "vgg16.safetensors");
        assert_eq!(of(Backbone::Vgg16), ours);
        let fetched = put(&cache, "vgg16-397923af.features.safetensors");
        assert_eq!(of(Backbone::Vgg16), fetched);
        assert_eq!(of(Backbone::SqueezeNet1_1), None);
        let whole = put(&cache, "squeezenet1_1-b8a52dc0.pth");
        assert_eq!(of(Backbone::SqueezeNet1_1), whole);
        let mine = found().with_file(Backbone::AlexNet, "mine.pth");
        let given = WeightsSource::File("mine.pth".into());
        assert_eq!(mine.source(Backbone::AlexNet), Some(&given));
    }

    #[test]
    fn torchs_folder_is_found_by_torchs_rules() {
        let folder = |set: &[(&str, &str)]| {
            torch_hub_by(|name| {
                let (_, value) = set.iter().find(|(key, _)| *key == name)?;
                Some(PathBuf::from(value))
            })
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
            (&[("USERPROFILE", "/u")], "/u/.cache/torch/hub/checkpoints"),
        ] {
            assert_eq!(folder(set), Some(PathBuf::from(expected)), "{set:?}");
        }
        assert_eq!(folder(&[]), None);
    }
}
