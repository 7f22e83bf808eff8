//! Files built byte by byte: every layout that a state dict may have, and every kind of
//! inconsistency that a file may contain.

use std::borrow::Cow;
use std::fs;
use std::path::PathBuf;

use proptest::prelude::*;
use tempfile::TempDir;

use super::*;
use crate::completeness::Expected;
use crate::convert::{OutTensor, write_safetensors};
use crate::zip::tests::archive;

/// Assembles pickles, opcode by opcode.
#[derive(Default, Clone)]
struct Pickle(Vec<u8>);

impl Pickle {
    fn new() -> Self {
        Self(b"\x80\x02".to_vec())
    }

    fn op(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }

    fn text(self, text: &str) -> Self {
        let len = (text.len() as u32).to_le_bytes();
        self.op(b"X").op(&len).op(text.as_bytes())
    }

    fn int(self, v: i64) -> Self {
        self.op(b"\x8a\x08").op(&v.to_le_bytes())
    }

    fn tuple(self, values: &[i64]) -> Self {
        values.iter().fold(self.op(b"("), |p, &v| p.int(v)).op(b"t")
    }

    /// A tensor; `view` appends the last item of older persistent ids.
    #[allow(clippy::too_many_arguments, reason = "the fields of a pickled tensor")]
    fn tensor(
        self,
        class: &str,
        key: &str,
        numel: i64,
        offset: i64,
        shape: &[i64],
        strides: &[i64],
        view: bool,
    ) -> Self {
        self.op(b"ctorch._utils\n_rebuild_tensor_v2\n((")
            .text("storage")
            .op(format!("ctorch\n{class}\n").as_bytes())
            .text(key)
            .text(if view { "cuda:0" } else { "cpu" })
            .int(numel)
            .op(if view { b"NtQ" } else { b"tQ" })
            .int(offset)
            .tuple(shape)
            .tuple(strides)
            .op(b"\x89ccollections\nOrderedDict\n)RtR")
    }

    fn float(self, key: &str, numel: i64, offset: i64, shape: &[i64], strides: &[i64]) -> Self {
        self.tensor("FloatStorage", key, numel, offset, shape, strides, false)
    }

    fn end(self) -> Vec<u8> {
        self.op(b".").0
    }
}

fn floats(n: usize) -> Vec<u8> {
    (0..n).flat_map(|v| (v as f32).to_le_bytes()).collect()
}

struct Files(TempDir);

impl Files {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join("weights.pt");
        fs::write(&path, bytes).unwrap();
        path
    }

    fn open(&self, bytes: &[u8]) -> Result<Checkpoint, CheckpointError> {
        Checkpoint::open(self.write(bytes))
    }

    /// A zip checkpoint of this pickle and one storage "0" of 24 floats.
    fn zip(&self, pickle: Vec<u8>) -> Result<Checkpoint, CheckpointError> {
        self.open(&zip_of(&pickle))
    }
}

fn zip_of(pickle: &[u8]) -> Vec<u8> {
    archive(
        &[
            ("m/data.pkl", pickle),
            ("m/byteorder", b"little"),
            ("m/data/0", &floats(24)),
        ],
        false,
    )
}

/// A file in the older format: a dict filled by `fill`, and storages "0", …, each with its own
/// floats.
fn legacy(fill: impl FnOnce(Pickle) -> Pickle, storages: &[(&str, u64, &[u8])]) -> Vec<u8> {
    let mut out = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.".to_vec();
    out.extend(b"\x80\x02M\xe9\x03.");
    out.extend(
        Pickle::new()
            .op(b"}")
            .text("little_endian")
            .op(b"\x88s")
            .end(),
    );
    out.extend(fill(Pickle::new().op(b"}(")).op(b"u").end());
    let keys = storages
        .iter()
        .fold(Pickle::new().op(b"]("), |p, (key, ..)| p.text(key));
    out.extend(keys.op(b"e").end());
    for (_, numel, bytes) in storages {
        out.extend(numel.to_le_bytes());
        out.extend(*bytes);
    }
    out
}

#[test]
fn views_of_one_storage_with_any_strides() {
    let pickle = Pickle::new()
        .op(b"}(")
        .text("plain")
        .float("0", 24, 4, &[2, 3], &[3, 1])
        .text("transposed")
        .float("0", 24, 0, &[3, 2], &[1, 3])
        .text("parameter")
        .op(b"ctorch._utils\n_rebuild_parameter\n(")
        .float("0", 24, 23, &[], &[])
        .op(b"\x88ccollections\nOrderedDict\n)RtR")
        .text("empty")
        .float("0", 24, 0, &[0, 4], &[4, 1])
        .text("version")
        .int(7)
        .op(b"u")
        .end();
    let found = Files::new().zip(pickle).unwrap();
    let names: Vec<_> = found.names().collect();
    assert_eq!(names, ["empty", "parameter", "plain", "transposed"]);
    assert_eq!(found.others(), ["version"]);
    assert_eq!(found.tensor_f32("plain").unwrap(), [4., 5., 6., 7., 8., 9.]);
    assert_eq!(
        found.tensor_f32("transposed").unwrap(),
        [0., 3., 1., 4., 2., 5.]
    );
    assert_eq!(found.tensor_f32("parameter").unwrap(), [23.]);
    assert_eq!(found.shape("empty").unwrap(), [0, 4]);
    assert_eq!(found.dtype("plain").unwrap(), DType::F32);
    assert!(matches!(
        found.tensor_f32("absent"),
        Err(CheckpointError::NoTensor { .. })
    ));
}

#[test]
fn a_nested_state_dict_is_found_and_ambiguity_is_named() {
    let nested = |keys: &[&str]| {
        let mut p = Pickle::new().op(b"}(").text("epoch").int(3);
        for key in keys {
            p = p
                .text(key)
                .op(b"ccollections\nOrderedDict\n)R(")
                .text("w")
                .float("0", 24, 0, &[1], &[1])
                .op(b"u}")
                .text("_metadata")
                .op(b"}sb");
        }
        p.op(b"u").end()
    };
    let files = Files::new();
    let one = files.zip(nested(&["state_dict"])).unwrap();
    assert_eq!(one.names().collect::<Vec<_>>(), ["w"]);
    let beside = Pickle::new()
        .op(b"}(")
        .text("loss")
        .float("0", 24, 0, &[1], &[1]);
    let beside = beside.text("model").op(b"}(");
    let beside = beside.text("w").float("0", 24, 0, &[1], &[1]);
    let beside = beside.text("b").float("0", 24, 1, &[1], &[1]);
    let beside = files.zip(beside.op(b"uu").end()).unwrap();
    assert_eq!(beside.names().collect::<Vec<_>>(), ["b", "w"]);
    let two = zip_of(&nested(&["ema", "model"]));
    let why = files.open(&two).unwrap_err().to_string();
    assert!(why.contains("'ema', 'model'"), "{why}");
    let why = files.zip(nested(&[])).unwrap_err().to_string();
    assert!(why.contains("'epoch'"), "{why}");
}

#[test]
fn older_files_with_gpu_storages_and_pairs_of_python_2() {
    let halves: Vec<u8> = [1.0_f32, -2.5]
        .iter()
        .flat_map(|&v| half::f16::from_f32(v).to_le_bytes())
        .collect();
    let bytes = legacy(
        |p| {
            p.text("a")
                .tensor("FloatStorage", "94", 24, 2, &[2], &[1], true)
                .text("b")
                .tensor("HalfStorage", "17", 2, 0, &[2], &[1], false)
        },
        &[("17", 2, &halves), ("94", 24, &floats(24))],
    );
    let found = Files::new().open(&bytes).unwrap();
    assert_eq!(found.tensor_f32("a").unwrap(), [2.0, 3.0]);
    assert_eq!(found.tensor_f32("b").unwrap(), [1.0, -2.5]);

    // OrderedDict([['w', tensor]]) with the string opcode of Python 2.
    let mut python2 = bytes[..15 + 6].to_vec();
    python2.extend(b"\x80\x02}.");
    let dict = Pickle::new()
        .op(b"ccollections\nOrderedDict\n](](U\x01w")
        .tensor("FloatStorage", "5", 1, 0, &[1], &[1], true)
        .op(b"ee\x85R}U\x09_metadata}sb");
    python2.extend(dict.end());
    python2.extend(b"\x80\x02](U\x015e.");
    python2.extend(1_u64.to_le_bytes());
    python2.extend(9.0_f32.to_le_bytes());
    let found = Files::new().open(&python2).unwrap();
    assert_eq!(found.tensor_f32("w").unwrap(), [9.0]);
}

#[test]
fn older_files_that_lie_are_refused() {
    let one = |numel: i64, told: u64, bytes: &[u8]| {
        legacy(
            |p| p.text("a").float("0", numel, 0, &[1], &[1]),
            &[("0", told, bytes)],
        )
    };
    let files = Files::new();
    assert!(files.open(&one(2, 2, &floats(2))).is_ok());
    for (what, bytes) in [
        ("count differs", one(2, 3, &floats(3))),
        ("reaches beyond", one(1 << 60, 1 << 60, &floats(2))),
        ("overflows", one(i64::MAX, i64::MAX as u64, &floats(2))),
        ("negative", one(-1, u64::MAX, &floats(2))),
        ("unknown key", legacy(|p| p, &[("0", 1, &floats(1))])),
        (
            "missing",
            legacy(|p| p.text("a").float("0", 1, 0, &[1], &[1]), &[]),
        ),
        ("no torch", b"\x80\x02N.".to_vec()),
    ] {
        assert!(files.open(&bytes).is_err(), "{what}");
    }
}

#[test]
fn zip_files_that_lie_are_refused_with_the_tensor_named() {
    let files = Files::new();
    let one = |numel, offset, shape: &[i64], strides: &[i64]| {
        let p = Pickle::new().op(b"}(").text("w");
        files.zip(p.float("0", numel, offset, shape, strides).op(b"u").end())
    };
    assert!(one(24, 0, &[24], &[1]).is_ok());
    for (what, found) in [
        ("storage size", one(25, 0, &[1], &[1])),
        ("huge storage", one(i64::MAX, 0, &[1], &[1])),
        ("beyond", one(24, 1, &[24], &[1])),
        ("negative stride", one(24, 23, &[2], &[-1])),
        ("negative offset", one(24, -1, &[1], &[1])),
        ("rank", one(24, 0, &[1], &[1, 1])),
        ("axes", one(24, 0, &[1; 40], &[1; 40])),
        ("expanded beyond the file", one(24, 0, &[1 << 40], &[0])),
        ("overflow", one(24, 0, &[i64::MAX, i64::MAX], &[1, 1])),
    ] {
        let why = found.unwrap_err().to_string();
        assert!(why.contains("'w'"), "{what}: {why}");
        assert!(why.contains("weights.pt"), "{what}: {why}");
    }
    let missing = Pickle::new()
        .op(b"}(")
        .text("w")
        .float("7", 1, 0, &[1], &[1]);
    assert!(files.zip(missing.op(b"u").end()).is_err());
    assert!(files.open(&archive(&[("a/x", b"")], false)).is_err());
    let big = archive(&[("data.pkl", b"\x80\x02}."), ("byteorder", b"big")], false);
    assert!(files.open(&big).unwrap_err().to_string().contains("endian"));
}

#[test]
fn code_is_named_and_never_run() {
    let evil = Pickle::new()
        .op(b"cos\nsystem\n")
        .text("true")
        .op(b"\x85R")
        .end();
    let why = Files::new().zip(evil).unwrap_err();
    assert!(matches!(
        &why,
        CheckpointError::ForbiddenGlobal { global, .. } if global == "os.system"
    ));
}

#[test]
fn other_files_are_recognised() {
    let files = Files::new();
    let why = |bytes: &[u8]| files.open(bytes).unwrap_err().to_string();
    assert!(why(b"").contains("empty"));
    assert!(why(b"<!DOCTYPE html>").contains("web page"));
    assert!(why(b"version https://git-lfs.github.com/spec/v1\n").contains("LFS"));
    assert!(why(b"\x7fELF").contains("neither"));
    assert!(matches!(
        Checkpoint::open(files.0.path().join("absent")),
        Err(CheckpointError::Io { .. })
    ));
}

#[test]
fn one_error_lists_everything_that_does_not_fit() {
    let pickle = Pickle::new()
        .op(b"}(")
        .text("a.weight")
        .float("0", 24, 0, &[2, 3], &[3, 1])
        .text("b.weight")
        .float("0", 24, 0, &[2], &[1])
        .text("head.weight")
        .float("0", 24, 0, &[1], &[1])
        .text("extra")
        .op(b"Nu")
        .end();
    let found = Files::new().zip(pickle).unwrap();
    let expected = |name: &str, shape: &[usize]| Expected {
        name: name.into(),
        shape: shape.to_vec(),
    };
    let good = [expected("a.weight", &[2, 3]), expected("b.weight", &[2])];
    assert!(found.check(&good, &["head.", "extra"]).is_ok());
    let bad = [
        expected("a.weight", &[3, 2]),
        expected("z", &[1]),
        expected("b.weight", &[2]),
        expected("c", &[]),
    ];
    let why = found.check(&bad, &["hea"]).unwrap_err();
    assert_eq!(why.missing.len(), 2);
    assert_eq!(why.surplus, ["extra"]);
    assert_eq!(why.misshaped.len(), 1);
    assert_eq!(why.placeholders(), 0);
    let mut sharded = why.clone();
    sharded.misshaped[0].found = vec![0];
    assert_eq!(sharded.placeholders(), 1);
    for (text, is_told) in [(why.to_string(), false), (sharded.to_string(), true)] {
        assert_eq!(text.contains("zero_to_fp32"), is_told, "{text}");
    }
    let text = why.to_string();
    for part in ["c []", "z [1]", "extra", "a.weight [2, 3], expected [3, 2]"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(
        found
            .check(&good, &[] as &[&str])
            .unwrap_err()
            .surplus
            .len()
            == 2
    );
}

#[test]
fn conversion_keeps_types_values_and_the_source() {
    let bytes = legacy(
        |p| {
            p.text("t")
                .tensor("BFloat16Storage", "0", 4, 0, &[2, 2], &[1, 2], false)
                .text("u")
                .tensor("FloatStorage", "1", 3, 0, &[3], &[1], false)
        },
        &[
            ("0", 4, &[0, 0x3f, 0, 0x40, 0, 0x41, 0, 0x42]),
            ("1", 3, &floats(3)),
        ],
    );
    let files = Files::new();
    let source = files.open(&bytes).unwrap();
    let out = files.0.path().join("out.safetensors");
    source.convert(&out, |_| true).unwrap();
    let copy = Checkpoint::open(&out).unwrap();
    assert_eq!(copy.metadata()["source_sha256"], source.sha256().unwrap());
    assert_eq!(copy.dtype("t").unwrap(), DType::BF16);
    for name in ["t", "u"] {
        assert_eq!(copy.shape(name).unwrap(), source.shape(name).unwrap());
        assert_eq!(
            copy.tensor_f32(name).unwrap(),
            source.tensor_f32(name).unwrap()
        );
    }
    // The public reader reads the same, and a second conversion changes nothing.
    let raw = fs::read(&out).unwrap();
    let theirs = ::safetensors::SafeTensors::deserialize(&raw).unwrap();
    assert_eq!(theirs.tensor("t").unwrap().shape(), [2, 2]);
    let again = files.0.path().join("again.safetensors");
    copy.convert(&again, |_| true).unwrap();
    assert_eq!(raw, fs::read(&again).unwrap());
    copy.convert(&again, |name| name == "u").unwrap();
    assert_eq!(Checkpoint::open(&again).unwrap().names().len(), 1);
}

#[test]
fn a_failed_write_leaves_no_file() {
    let files = Files::new();
    let out = files.0.path().join("out.safetensors");
    let tensor = OutTensor {
        name: "a".into(),
        dtype: DType::F32,
        shape: vec![2],
    };
    let short = |_: &OutTensor| Ok(Cow::Owned(vec![0_u8; 4]));
    assert!(
        write_safetensors(&out, &BTreeMap::new(), std::slice::from_ref(&tensor), short).is_err()
    );
    let twice = [tensor.clone(), tensor];
    let full = |_: &OutTensor| Ok(Cow::Owned(vec![0_u8; 8]));
    assert!(write_safetensors(&out, &BTreeMap::new(), &twice, full).is_err());
    assert_eq!(fs::read_dir(files.0.path()).unwrap().count(), 0);
}

/// Small valid files of every format.
fn samples() -> Vec<Vec<u8>> {
    let pickle = Pickle::new()
        .op(b"}q\x01(")
        .text("w")
        .float("0", 24, 0, &[3, 4], &[4, 1])
        .op(b"u")
        .end();
    let files = Files::new();
    let out = files.0.path().join("s");
    files
        .zip(pickle.clone())
        .unwrap()
        .convert(&out, |_| true)
        .unwrap();
    vec![
        zip_of(&pickle),
        legacy(
            |p| p.text("a").float("0", 2, 0, &[2], &[1]),
            &[("0", 2, &floats(2))],
        ),
        fs::read(&out).unwrap(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_never_panic(
        which in 0..3_usize,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        thread_local!(static SAMPLES: Vec<Vec<u8>> = samples());
        let mut bytes = SAMPLES.with(|s| s[which].clone());
        for (at, value) in edits {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok((named, _)) = read(bytes.as_slice()) {
            for layout in named.tensors.values() {
                prop_assert!(layout.f32(bytes.as_slice()).unwrap().len() <= bytes.len());
            }
        }
    }
}
