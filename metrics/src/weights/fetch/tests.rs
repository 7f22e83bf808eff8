//! Downloads of weights from a misbehaving server.

use std::borrow::Cow;
use std::collections::BTreeMap;

use sharp_checkpoint::deterministic::backbone_weights;
use sharp_checkpoint::{DType, OutTensor, write_safetensors};
use sharp_tests::unreliable_server::{Answer, Server};

use super::*;
use crate::Backbone;
use crate::backbone::architecture;

/// A whole squeezenet1_1 with a classifier, as bytes of a safetensors file.
fn weights() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("full");
    let mut tensors: Vec<OutTensor> = architecture::tensors(Backbone::SqueezeNet1_1)
        .into_iter()
        .map(|tensor| OutTensor {
            name: format!("features.{}", tensor.name),
            dtype: DType::F32,
            shape: tensor.shape,
        })
        .collect();
    tensors.push(OutTensor {
        name: "classifier.1.bias".into(),
        dtype: DType::F32,
        shape: vec![1000],
    });
    write_safetensors(&path, &BTreeMap::new(), &tensors, |tensor| {
        let values = backbone_weights("", &tensor.name, &tensor.shape);
        let bytes = values.iter().flat_map(|v| v.to_le_bytes());
        Ok(Cow::Owned(bytes.collect()))
    })
    .unwrap();
    std::fs::read(path).unwrap()
}

fn sha256(bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bytes");
    std::fs::write(&file, bytes).unwrap();
    file_sha256(&file).unwrap()
}

fn published(bytes: &[u8], address: String) -> Published {
    Published {
        backbone: Backbone::SqueezeNet1_1,
        file: "w-cafe.pth".into(),
        address: address.into(),
        size_milli_mib: (bytes.len() as u64 * 2000 + (1 << 20)) / (2 << 20),
        sha256_prefix: sha256(bytes)[..8].to_owned().into(),
        licence: "none",
    }
}

fn attempt_with(
    answers: Vec<Answer>,
) -> (Result<PathBuf, FetchError>, Vec<usize>, tempfile::TempDir) {
    let bytes = weights();
    let server = Server::start(bytes.clone(), "v1", answers);
    let cache = tempfile::tempdir().unwrap();
    let published = published(&bytes, server.address());
    let result = fetch(&published, cache.path(), false, |_| {});
    (result, server.starts(), cache)
}

fn leftovers(cache: &tempfile::TempDir) -> usize {
    std::fs::read_dir(cache.path()).unwrap().count()
}

#[test]
fn features_are_kept_with_the_hash_of_the_original() {
    let (result, _, cache) = attempt_with(vec![Answer::Whole]);
    let kept = Checkpoint::open(result.unwrap()).unwrap();
    assert!(!kept.contains("classifier.1.bias") && kept.contains("features.0.weight"));
    assert_eq!(kept.metadata()["source_sha256"], sha256(&weights()));
    assert_eq!(leftovers(&cache), 1);
    // A second call needs no server.
    let unreachable = Published {
        address: "http://127.0.0.1:9/w".into(),
        ..published(&weights(), String::new())
    };
    assert!(fetch(&unreachable, cache.path(), true, |_| {}).is_ok());
}

#[test]
fn lies_about_the_size_and_pages_are_errors_and_leave_nothing() {
    let cases = [
        (Answer::Length(1000), "announced 1000 bytes"),
        (Answer::Page, "text instead of the file"),
    ];
    for (answer, reason) in cases {
        let (result, asked, cache) = attempt_with(vec![answer]);
        let error = result.unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
        assert_eq!((asked.len(), leftovers(&cache)), (1, 0));
    }
}

#[test]
fn other_bytes_of_the_right_size_are_deleted() {
    let (result, _, cache) = attempt_with(vec![Answer::Length(weights().len())]);
    let error = result.unwrap_err().to_string();
    assert!(error.contains("should begin with"), "{error}");
    assert_eq!(leftovers(&cache), 0);
}

#[test]
fn offline_nothing_is_asked_for() {
    let cache = tempfile::tempdir().unwrap();
    let published = Published::of(Backbone::Vgg16);
    let error = fetch(&published, cache.path(), true, |_| {}).unwrap_err();
    assert!(matches!(error, FetchError::Offline { .. }), "{error}");
    assert!(error.to_string().contains("vgg16-397923af.pth"), "{error}");
}
