//! Data that may not be redistributed.

use std::path::{Path, PathBuf};

/// The folder of data that may not be part of the repository: the environment variable
/// `SHARP_BENCH_SHARED`, or else `../shared` next to the checkout. If it is missing, tests that
/// need it are reported as ignored.
pub fn shared_data() -> PathBuf {
    std::env::var_os("SHARP_BENCH_SHARED").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"),
        PathBuf::from,
    )
}
