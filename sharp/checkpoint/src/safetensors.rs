//! Header of a safetensors file: an 8-byte length, JSON, then the data.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use serde::de::{MapAccess, Visitor};

use crate::bytes::Bytes;
use crate::error::{Fault, malformed};
use crate::tensor::{DType, TensorLayout};

/// Maximum length of a header, in bytes.
const MAX_HEADER: u64 = 32 << 20;

/// Tensor layouts and metadata of the header.
#[derive(Debug)]
pub(crate) struct Contents {
    pub(crate) tensors: BTreeMap<String, TensorLayout>,
    pub(crate) metadata: BTreeMap<String, String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TensorEntry {
    dtype: String,
    shape: Vec<usize>,
    data_offsets: [usize; 2],
}

#[derive(Default)]
struct SafetensorsHeader {
    entries: BTreeMap<String, TensorEntry>,
    metadata: BTreeMap<String, String>,
}

impl<'de> Deserialize<'de> for SafetensorsHeader {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct HeaderVisitor;
        impl<'de> Visitor<'de> for HeaderVisitor {
            type Value = SafetensorsHeader;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object that maps names to tensors")
            }

            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> Result<SafetensorsHeader, A::Error> {
                let mut header = SafetensorsHeader::default();
                while let Some(name) = map.next_key::<String>()? {
                    if name == "__metadata__" {
                        header.metadata = map.next_value()?;
                    } else if header.entries.insert(name, map.next_value()?).is_some() {
                        return Err(serde::de::Error::custom("a tensor is listed twice"));
                    }
                }
                Ok(header)
            }
        }
        deserializer.deserialize_map(HeaderVisitor)
    }
}

/// True if the first bytes and the length are consistent with a safetensors file.
pub(crate) fn looks_like(start: &[u8], file_len: usize) -> bool {
    match start.split_first_chunk::<8>() {
        Some((len, rest)) => {
            let len = u64::from_le_bytes(*len);
            rest.first() == Some(&b'{') && len >= 2 && len <= file_len as u64 - 8
        }
        None => false,
    }
}

/// Parses the header and checks every tensor against the file's length. As the format requires, the tensors must fill
/// the data without gaps or overlaps.
pub(crate) fn read(file: &(impl Bytes + ?Sized)) -> Result<Contents, Fault> {
    let start = file.start(8)?;
    let Ok(len) = <[u8; 8]>::try_from(start) else {
        return malformed!("safetensors: the header is cut off");
    };
    let len = u64::from_le_bytes(len);
    if len > MAX_HEADER || len > file.len() as u64 - 8 {
        return malformed!(
            "safetensors: the header states a length of {len} bytes, which is impossible or \
                           unsupported"
        );
    }
    let base = 8 + len as usize;
    let data_len = file.len() - base;
    let json = file.get(8..base)?;
    let header: SafetensorsHeader = match serde_json::from_slice(&json) {
        Ok(header) => header,
        Err(reason) => return malformed!("safetensors: header: {reason}"),
    };
    let mut tensors = BTreeMap::new();
    let mut spans = Vec::with_capacity(header.entries.len());
    for (name, entry) in header.entries {
        let Some(dtype) = DType::from_name(&entry.dtype) else {
            return malformed!("tensor '{name}': element type '{}' is unknown", entry.dtype);
        };
        let [start, end] = entry.data_offsets;
        if start > end || end > data_len {
            return malformed!(
                "tensor '{name}': bytes {start}..{end} lie beyond the {data_len} bytes of data \
                               (truncated?)"
            );
        }
        spans.push((start, end));
        match TensorLayout::contiguous(dtype, entry.shape, base + start..base + end, file.len()) {
            Ok(layout) => tensors.insert(name, layout),
            Err(Fault::Malformed(reason)) => return malformed!("tensor '{name}': {reason}"),
            Err(other) => return Err(other),
        };
    }
    spans.sort_unstable();
    let mut filled = 0;
    for (start, end) in spans {
        if start != filled {
            return malformed!("safetensors: tensors overlap or leave a gap at byte {start}");
        }
        filled = end;
    }
    if filled != data_len {
        return malformed!(
            "safetensors: {} bytes belong to no tensor",
            data_len - filled
        );
    }
    Ok(Contents {
        tensors,
        metadata: header.metadata,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(json: &str, data: usize) -> Vec<u8> {
        let mut out = (json.len() as u64).to_le_bytes().to_vec();
        out.extend(json.as_bytes());
        out.extend((0..data).map(|v| v as u8));
        out
    }

    #[test]
    fn a_good_header_is_read() {
        let good = file(
            r#"{"__metadata__":{"k":"v"},"b":{"dtype":"U8","shape":[2],"data_offsets":[4,6]},
               "a":{"dtype":"F32","shape":[],"data_offsets":[0,4]}}"#,
            6,
        );
        assert!(looks_like(&good, good.len()));
        let contents = read(good.as_slice()).unwrap();
        assert_eq!(
            contents.tensors["b"].f32(good.as_slice()).unwrap(),
            [4.0, 5.0]
        );
        assert_eq!(contents.metadata["k"], "v");
    }

    #[test]
    fn lying_headers_are_refused() {
        let one = |fields: &str, data| {
            let json = format!(r#"{{"a":{{{fields}}}}}"#);
            read(file(&json, data).as_slice()).is_err()
        };
        assert!(
            one(r#""dtype":"F32","shape":[2],"data_offsets":[0,4]"#, 4),
            "shape"
        );
        assert!(
            one(r#""dtype":"F32","shape":[1],"data_offsets":[0,4]"#, 3),
            "cut off"
        );
        assert!(
            one(r#""dtype":"F32","shape":[1],"data_offsets":[0,4]"#, 5),
            "surplus"
        );
        assert!(
            one(r#""dtype":"F32","shape":[1],"data_offsets":[1,5]"#, 5),
            "gap"
        );
        assert!(
            one(r#""dtype":"F32","shape":[1],"data_offsets":[4,0]"#, 4),
            "reversed"
        );
        assert!(
            one(r#""dtype":"F99","shape":[1],"data_offsets":[0,4]"#, 4),
            "type"
        );
        assert!(
            one(r#""dtype":"U8","shape":[-1],"data_offsets":[0,4]"#, 4),
            "negative"
        );
        let huge = r#""dtype":"U8","shape":[4294967296,4294967296,4],"data_offsets":[0,4]"#;
        assert!(one(huge, 4), "overflow");
        let twice = r#"{"a":{"dtype":"U8","shape":[1],"data_offsets":[0,1]},
                        "a":{"dtype":"U8","shape":[1],"data_offsets":[0,1]}}"#;
        assert!(read(file(twice, 1).as_slice()).is_err());
        let nested = format!("{{\"a\":{}", "[".repeat(100_000));
        assert!(read(file(&nested, 0).as_slice()).is_err());
        assert!(read([0xFF; 9].as_slice()).is_err());
        assert!(!looks_like(b"PK\x03\x04\0\0\0\0\0\0", 10));
    }
}
