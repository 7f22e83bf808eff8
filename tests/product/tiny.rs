//! The tiny network and its recorded input.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sharp_checkpoint::{Checkpoint, DType, OutTensor, write_safetensors};

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

/// Writes the tiny network's depth part, with its first layer, as Depth Pro's checkpoint without a field-of-view head.
/// Returns arguments that select it: the values of `--checkpoint` and `--config`.
pub(crate) fn depth_pro(file: &Path) -> [String; 2] {
    const PREFIX: &str = "monodepth_model.monodepth_predictor.";
    let tiny = Checkpoint::open(golden("tiny_model.pt")).unwrap();
    let names = tiny.names().filter_map(|name| name.strip_prefix(PREFIX));
    // Depth Pro's transformers have no classification heads.
    let names = names.filter(|name| !name.contains("encoder.head."));
    let tensor = |name: &str| {
        let mut shape = tiny.shape(&format!("{PREFIX}{name}")).unwrap().to_vec();
        if name.starts_with("head.4.") {
            shape[0] = 1;
        }
        OutTensor {
            name: name.to_owned(),
            dtype: DType::F32,
            shape,
        }
    };
    let tensors: Vec<OutTensor> = names.map(tensor).collect();
    write_safetensors(file, &BTreeMap::new(), &tensors, |tensor| {
        let values = tiny.tensor_f32(&format!("{PREFIX}{}", tensor.name))?;
        let values = &values[..tensor.shape.iter().product()];
        Ok(Cow::Owned(
            values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        ))
    })
    .unwrap();
    [file.display().to_string(), golden("tiny_config.json#tiny")]
}
