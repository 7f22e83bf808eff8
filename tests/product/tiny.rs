//! The tiny network and its recorded input.

use std::path::PathBuf;

/// A file of the network's golden data.
pub(crate) fn golden(name: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/model");
    path.join(name).display().to_string()
}

/// Arguments that select the tiny network.
pub(crate) fn tiny() -> [String; 4] {
    with_checkpoint(&golden("tiny_model.pt"))
}

/// Arguments that select the tiny network with other weights.
pub(crate) fn with_checkpoint(file: &str) -> [String; 4] {
    [
        "--checkpoint".into(),
        file.into(),
        "--config".into(),
        golden("tiny_config.json#tiny"),
    ]
}

/// The photograph with which the tiny network was recorded, and its focal length.
pub(crate) fn recorded_input() -> (String, String) {
    (golden("inputs/main_640x480.png"), "500".into())
}
