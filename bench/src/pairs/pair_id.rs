//! The name of a pair: `dataset/scene/source__target`.
//!
//! Each of the four parts is percent-encoded from its UTF-8 bytes. ASCII letters and digits, `-`,
//! `.`, `_` and `~` (RFC 3986's unreserved characters) are kept; everything else, including a `/`
//! within a scene's id, becomes `%XX` with upper-case digits. Two further rules make the id
//! decodable and a safe relative path:
//! * a `_` at either end of a part, or next to another `_`, is encoded, so that the only `__` is
//!   the one between source and target;
//! * a `.` at either end of a part is encoded, so that no part is `.`, `..` or hidden.
//!
//! After splitting at `/` and `__`, any percent-decoder (Python's `urllib.parse.unquote`) decodes
//! the parts.

use super::PairError;
use crate::io::hash::sha256_hex;

/// The four names in a pair id.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PairName {
    pub dataset: String,
    pub scene: String,
    pub source: String,
    pub target: String,
}

impl PairName {
    pub fn encode(&self) -> String {
        format!(
            "{}/{}/{}__{}",
            encode_part(&self.dataset),
            encode_part(&self.scene),
            encode_part(&self.source),
            encode_part(&self.target)
        )
    }

    /// Decodes an id.
    ///
    /// # Errors
    /// [`PairError::PairId`] if the text is not exactly what [`Self::encode`] writes. A pair therefore has only one
    /// valid id.
    pub fn decode(id: &str) -> Result<Self, PairError> {
        let wrong = |reason: &str| PairError::PairId {
            text: id.to_owned(),
            reason: reason.to_owned(),
        };
        let [dataset, scene, views] = <[&str; 3]>::try_from(id.split('/').collect::<Vec<_>>())
            .map_err(|_| wrong("not of the form dataset/scene/source__target"))?;
        let (source, target) = views
            .split_once("__")
            .ok_or_else(|| wrong("no '__' between source and target"))?;
        let part = |text| decode_part(text).ok_or_else(|| wrong("bad percent-encoding"));
        let name = Self {
            dataset: part(dataset)?,
            scene: part(scene)?,
            source: part(source)?,
            target: part(target)?,
        };
        if name.encode() == id {
            Ok(name)
        } else {
            Err(wrong("not in the canonical encoding"))
        }
    }
}

/// `dataset/scene/source` of a pair's id.
pub fn source_of(pair_id: &str) -> &str {
    // Ids encode underscores, so the first `__` is the separator.
    pair_id.split("__").next().unwrap_or(pair_id)
}

/// Maximum length of a file or folder name made from an id, in bytes. File systems allow 255, but names of partial files
/// have additional affixes and extensions.
const LONGEST: usize = 180;

/// Converts an id (of a pair, or `dataset/scene/view`) to a relative path without extension. The
/// path equals the id, except that a part too long for a file name is cut and ends with `~` and the
/// first 16 digits of its SHA-256.
pub fn path_of(id: &str) -> String {
    let parts: Vec<String> = id.split('/').map(short).collect();
    parts.join("/")
}

fn short(part: &str) -> String {
    if part.len() <= LONGEST {
        return part.to_owned();
    }
    let hash = &sha256_hex(part.as_bytes())[..16];
    let mut end = LONGEST - hash.len() - 1;
    while !part.is_char_boundary(end) {
        end -= 1;
    }
    format!("{}~{hash}", &part[..end])
}

/// Path `dataset/scene`, encoded as in pair ids, for a folder of files that belong to views.
pub fn scene_path(dataset: &str, scene: &str) -> String {
    path_of(&format!("{}/{}", encode_part(dataset), encode_part(scene)))
}

/// A view's name, encoded as in pair ids, for the stem of a file that belongs to it.
pub fn view_name(view: &str) -> String {
    short(&encode_part(view))
}

fn encode_part(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut out = String::with_capacity(bytes.len());
    for (i, &b) in bytes.iter().enumerate() {
        let edge = i == 0 || i + 1 == bytes.len();
        let keep = match b {
            b'_' => !edge && bytes[i - 1] != b'_' && bytes[i + 1] != b'_',
            b'.' => !edge,
            _ => b.is_ascii_alphanumeric() || b == b'-' || b == b'~',
        };
        if keep {
            out.push(char::from(b));
        } else {
            out.push('%');
            for digit in [b >> 4, b & 15] {
                out.push(char::from(b"0123456789ABCDEF"[usize::from(digit)]));
            }
        }
    }
    out
}

fn decode_part(text: &str) -> Option<String> {
    let mut out = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(b) = bytes.next() {
        if b == b'%' {
            let mut digit = || char::from(bytes.next()?).to_digit(16);
            let (high, low) = (digit()?, digit()?);
            out.push((high * 16 + low) as u8);
        } else {
            out.push(b);
        }
    }
    String::from_utf8(out).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn name(dataset: &str, scene: &str, source: &str, target: &str) -> PairName {
        PairName {
            dataset: dataset.into(),
            scene: scene.into(),
            source: source.into(),
            target: target.into(),
        }
    }

    #[test]
    fn plain_names_stay_readable() {
        let id = name("middlebury", "Motorcycle-perfect", "im0", "im1").encode();
        assert_eq!(id, "middlebury/Motorcycle-perfect/im0__im1");
        let id = name("w", "cup/scene_000", "00000", "00012").encode();
        assert_eq!(id, "w/cup%2Fscene_000/00000__00012");
    }

    #[test]
    fn parts_too_long_for_a_file_name_are_cut_and_stay_apart() {
        let long = |last: &str| {
            name(
                "d",
                &"森".repeat(33),
                "a",
                &format!("{}{last}", "林".repeat(40)),
            )
        };
        let (one, two) = (path_of(&long("1").encode()), path_of(&long("2").encode()));
        assert_ne!(one, two);
        assert!(one.split('/').all(|part| part.len() <= LONGEST), "{one}");
        assert_eq!(one.split('/').count(), 3);
        let plain = name("w", "cup/scene_000", "00000", "00012").encode();
        assert_eq!(path_of(&plain), plain);
    }

    #[test]
    fn what_could_mislead_is_encoded() {
        let id = name("a b", "..", "x_", "_y__z").encode();
        assert_eq!(id, "a%20b/%2E%2E/x%5F__%5Fy%5F%5Fz");
        assert_eq!(
            name("é", "50%", "a\n", ".").encode(),
            "%C3%A9/50%25/a%0A__%2E"
        );
    }

    #[test]
    fn ids_that_are_not_canonical_are_refused() {
        for id in [
            "a/b",
            "a/b/c",
            "a/b/c_d",
            "a/b/c__d/e",
            "a/b/c__d__e",
            "a/b/c___d",
            "a/b/c%5f__d",
            "a/b/%63__d",
            "a/b/c%__d",
            "a/b/c%4__d",
            "a/b/c%+1__d",
            "a/b/c%FF__d",
            "a/../c__d",
            "a/b/c d__e",
        ] {
            let error = PairName::decode(id).unwrap_err().to_string();
            assert!(error.contains(id), "{error}");
        }
    }

    proptest! {
        #[test]
        fn every_name_comes_back(parts in proptest::array::uniform4("[a-b_./% \u{e9}\n]{0,6}|\\PC{0,4}")) {
            let [dataset, scene, source, target] = parts;
            let name = PairName { dataset, scene, source, target };
            prop_assert_eq!(PairName::decode(&name.encode()).unwrap(), name);
        }
    }
}
