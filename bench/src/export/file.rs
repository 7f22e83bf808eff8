//! Files of an export, which are written only if missing or outdated. A description file, written
//! last, lists the hashes of the files.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::io::atomic_files::{FileError, write_atomic};
use crate::io::hash::{file_sha256, sha256_hex};

pub(super) type Hashes = BTreeMap<String, String>;

/// The fields common to all descriptions; read back to check whether the files are complete.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Stamp {
    /// Hash of everything that the files depend on.
    pub(super) key: String,
    pub(super) files: Hashes,
}

impl Stamp {
    /// Whether `folder` has the file `description` with the key `key`, and all files that it lists are intact.
    pub(super) fn is_done(folder: &Path, description: &str, key: &str) -> bool {
        let Ok(bytes) = std::fs::read(folder.join(description)) else {
            return false;
        };
        let Ok(stamp) = serde_json::from_slice::<Self>(&bytes) else {
            return false;
        };
        stamp.key == key
            && stamp
                .files
                .iter()
                .all(|(name, hash)| file_sha256(&folder.join(name)).is_ok_and(|h| h == *hash))
    }
}

pub(super) fn write(
    folder: &Path,
    name: &str,
    bytes: &[u8],
    hashes: &mut Hashes,
) -> Result<(), FileError> {
    write_atomic(&folder.join(name), bytes)?;
    hashes.insert(name.to_owned(), sha256_hex(bytes));
    Ok(())
}
