//! The views that a scene's Gaussians were trained on.

use std::path::Path;

use globset::GlobMatcher;

use crate::io::hash::sha256_hex;
use crate::pairs::dataset::name_matcher;
use crate::pairs::pair_id::PairName;

/// Patterns `VIEW`, `SCENE/VIEW` or `DATASET/SCENE/VIEW`, with or without a picture's extension; `*` and `?` are
/// wildcards.
#[derive(Debug)]
pub(super) struct TrainingViews {
    patterns: Vec<GlobMatcher>,
    sha256: String,
}

/// Whether `train=` names a list file rather than a pattern.
pub fn is_training_list(text: &str) -> bool {
    text.to_ascii_lowercase().ends_with(".txt")
}

impl TrainingViews {
    /// Parses `train=`: a list (a `.txt` file, one pattern per line) or a single pattern.
    pub(super) fn read(text: &str) -> Result<Self, String> {
        let list = if is_training_list(text) {
            sharp::files::read_text(Path::new(text))
                .map_err(|error| format!("train={text}: {error}"))?
        } else {
            text.to_owned()
        };
        let names = list.lines().map(str::trim).filter(|name| !name.is_empty());
        let names = names.flat_map(|name| [Some(name), without_extension(name)]);
        let patterns: Result<Vec<GlobMatcher>, String> =
            names.flatten().map(name_matcher).collect();
        let patterns = patterns.map_err(|error| format!("train={text}: {error}"))?;
        if patterns.is_empty() {
            Err(format!("train={text} lists no view"))
        } else {
            Ok(Self {
                patterns,
                sha256: sha256_hex(list.as_bytes()),
            })
        }
    }

    /// Short hash for the identity of a method.
    pub(super) fn hash(&self) -> &str {
        &self.sha256[..16]
    }

    /// Whether the method was trained on the pair's source, and on its target; `None` for an invalid id.
    pub(super) fn hold(&self, pair_id: &str) -> Option<[bool; 2]> {
        let name = PairName::decode(pair_id).ok()?;
        let views = [&name.source, &name.target];
        Some(views.map(|view| self.holds(&format!("{}/{}/{view}", name.dataset, name.scene))))
    }

    fn holds(&self, whole: &str) -> bool {
        let starts = whole.match_indices('/').map(|(at, _)| at + 1);
        let mut ends = std::iter::once(0).chain(starts).map(|at| &whole[at..]);
        ends.any(|name| self.patterns.iter().any(|pattern| pattern.is_match(name)))
    }
}

fn without_extension(name: &str) -> Option<&str> {
    let (stem, extension) = name.rsplit_once('.')?;
    let is_picture = ["png", "jpg", "jpeg", "webp", "tif", "tiff", "bmp"]
        .iter()
        .any(|known| extension.eq_ignore_ascii_case(known));
    is_picture.then_some(stem)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_found_by_their_last_parts_and_by_patterns() {
        let holds = |text: &str, id: &str| TrainingViews::read(text).unwrap().hold(id).unwrap()[1];
        for (text, id) in [
            ("view_01", "d/s/view_00__view_01"),
            ("s/view_0?", "d/s/a__view_01"),
            ("d/s/*", "d/s/a__b"),
            ("b.png", "d/s/a__b"),
            ("left/b", "d/s/a__left%2Fb"),
        ] {
            assert!(holds(text, id), "{text} {id}");
        }
        for (text, id) in [
            ("view_00", "d/s/view_00__view_01"),
            ("t/*", "d/s/a__b"),
            ("1", "d/s/a__view_01"),
        ] {
            assert!(!holds(text, id), "{text} {id}");
        }
    }

    #[test]
    fn lists_are_read_and_empty_ones_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("train.txt");
        std::fs::write(&path, "a.png\n\ns/b*\n").unwrap();
        let views = TrainingViews::read(&path.display().to_string()).unwrap();
        assert!(
            views.hold("d/s/x__a") == Some([false, true])
                && views.hold("d/s/b2__x") == Some([true, false])
        );
        assert!(views.hold("d/t/x__b2") == Some([false; 2]));
        std::fs::write(&path, "\n").unwrap();
        for (text, part) in [
            (path.display().to_string(), "no view"),
            ("gone.txt".to_owned(), "gone.txt"),
        ] {
            let error = TrainingViews::read(&text).unwrap_err();
            assert!(error.contains(part), "{error}");
        }
    }
}
