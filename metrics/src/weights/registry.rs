//! Where torchvision's weights are published, and where they are kept here.

use std::borrow::Cow;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use super::{Backbone, Weights};

/// A published file of weights.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Published {
    pub backbone: Backbone,
    /// Name of the file; its publisher ends it with the first digits of its sha256.
    pub file: Cow<'static, str>,
    pub address: Cow<'static, str>,
    /// Size as published, in thousandths of a MiB.
    pub size_milli_mib: u64,
    /// First digits of the file's sha256.
    pub sha256_prefix: Cow<'static, str>,
    pub licence: &'static str,
}

impl Published {
    /// torchvision's file for a network.
    pub fn of(backbone: Backbone) -> Self {
        let (file, address, size_milli_mib, sha256_prefix) = match backbone {
            Backbone::AlexNet => (
                "alexnet-owt-7be5be79.pth",
                "https://download.pytorch.org/models/alexnet-owt-7be5be79.pth",
                233_087,
                "7be5be79",
            ),
            Backbone::Vgg16 => (
                "vgg16-397923af.pth",
                "https://download.pytorch.org/models/vgg16-397923af.pth",
                527_796,
                "397923af",
            ),
            Backbone::SqueezeNet1_1 => (
                "squeezenet1_1-b8a52dc0.pth",
                "https://download.pytorch.org/models/squeezenet1_1-b8a52dc0.pth",
                4_729,
                "b8a52dc0",
            ),
        };
        Self {
            backbone,
            file: file.into(),
            address: address.into(),
            size_milli_mib,
            sha256_prefix: sha256_prefix.into(),
            licence: "BSD-3-Clause (torchvision)",
        }
    }

    /// The numbers of bytes that round to the published size.
    pub fn sizes(&self) -> RangeInclusive<u64> {
        const MIB: u64 = 1 << 20;
        // In units of a two-thousandth of a MiB the published size covers 2 s − 1 to 2 s + 1.
        let (low, high) = (2 * self.size_milli_mib - 1, 2 * self.size_milli_mib + 1);
        (low * MIB).div_ceil(2000)..=high * MIB / 2000
    }

    /// The copy that keeps the features only, in a cache folder.
    pub fn cached(&self, cache: &Path) -> PathBuf {
        let stem = self.file.trim_end_matches(".pth");
        cache.join(format!("{stem}.features.safetensors"))
    }
}

/// The folder where fetched weights are kept: `SHARP_BENCH_WEIGHTS` if set, else
/// `weights` in [`user_cache`]; `None` where there is no such folder.
pub fn cache_folder() -> Option<PathBuf> {
    let given = variable("SHARP_BENCH_WEIGHTS");
    given.or_else(|| user_cache().map(|cache| cache.join("weights")))
}

/// Where this program keeps what it can fetch or compute again: `sharp-bench` in `XDG_CACHE_HOME` if
/// that is set, else where the system keeps caches; `None` where the environment does not tell.
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

fn variable(name: &str) -> Option<PathBuf> {
    let value = std::env::var_os(name).filter(|value| !value.is_empty());
    value.map(PathBuf::from)
}

impl Weights {
    /// Takes from a cache folder the weights of those networks for which nothing else is given.
    #[must_use]
    pub fn with_cache(mut self, cache: &Path) -> Self {
        for backbone in Backbone::ALL {
            let file = Published::of(backbone).cached(cache);
            if !self.has(backbone) && file.is_file() {
                self = self.with_file(backbone, file);
            }
        }
        self
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
    fn the_cache_yields_to_files_that_were_given() {
        let cache = tempfile::tempdir().unwrap();
        let squeeze = Published::of(Backbone::SqueezeNet1_1).cached(cache.path());
        let vgg = Published::of(Backbone::Vgg16).cached(cache.path());
        for file in [&squeeze, &vgg] {
            std::fs::write(file, b"").unwrap();
        }
        let weights = Weights::none()
            .with_file(Backbone::Vgg16, "mine.pth")
            .with_cache(cache.path());
        assert_eq!(weights.file(Backbone::Vgg16), Some(Path::new("mine.pth")));
        assert_eq!(weights.file(Backbone::SqueezeNet1_1), Some(&*squeeze));
        assert!(!weights.has(Backbone::AlexNet));
    }
}
