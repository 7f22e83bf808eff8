//! Data that may not be redistributed.

use std::path::{Path, PathBuf};

/// The folder of data that the repository may not hold: what the environment variable
/// `SHARP_BENCH_SHARED` names, else `../shared` beside the checkout. It need not be there; tests that
/// take something from it are reported as ignored then.
pub fn shared_data() -> PathBuf {
    std::env::var_os("SHARP_BENCH_SHARED").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"),
        PathBuf::from,
    )
}
