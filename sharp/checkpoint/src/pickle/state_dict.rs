//! Conversion of a pickled object to named tensors.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::error::{Fault, malformed};
use crate::tensor::TensorLayout;

use super::value::{Heap, Storage, Value};

/// The named tensors of a state dict, and the keys of its other entries.
#[derive(Debug, Default)]
pub(crate) struct NamedTensors {
    pub(crate) tensors: BTreeMap<String, TensorLayout>,
    /// Keys whose values are not tensors.
    pub(crate) others: Vec<String>,
}

/// Selects the state dict in `root`: `root` itself if it contains tensors and no dict inside it contains more. (A loss or
/// the state of a random generator often stands next to the state dict.) Otherwise, exactly one dict inside `root` must
/// contain tensors.
///
/// `place` returns the byte range of a storage in the file of `file_len` bytes.
pub(crate) fn resolve<'a>(
    heap: &Heap<'a>,
    root: Value<'a>,
    file_len: usize,
    mut place: impl FnMut(&Storage<'a>) -> Result<Range<usize>, Fault>,
) -> Result<NamedTensors, Fault> {
    let Some(top) = entries(heap, root) else {
        if let Value::Foreign(id) = root {
            return Err(Fault::ForbiddenGlobal(heap.foreign[id as usize].clone()));
        }
        return Err(Fault::StateDict(format!(
            "the pickled object is {}, not a dict of tensors",
            root.kind()
        )));
    };
    let own = tensors(top.values());
    let inner = top.values().filter_map(|&value| match value {
        Value::Dict(id) => Some(tensors(heap.dicts[id as usize].iter().map(|(_, v)| v))),
        _ => None,
    });
    let chosen = if own > 0 && inner.max().is_none_or(|inner| inner <= own) {
        top
    } else {
        only_nested(heap, top, MAX_DEPTH)?
    };
    let mut named = NamedTensors::default();
    for (name, value) in chosen {
        match value {
            Value::Tensor(id) => {
                let layout =
                    layout(heap, id, file_len, &mut place).map_err(|fault| about(fault, name))?;
                named.tensors.insert(name.to_owned(), layout);
            }
            _ => named.others.push(name.to_owned()),
        }
    }
    Ok(named)
}

fn about(fault: Fault, name: &str) -> Fault {
    match fault {
        Fault::Malformed(reason) => {
            let name: String = name.chars().take(200).collect();
            Fault::Malformed(format!("tensor '{name}': {reason}"))
        }
        other => other,
    }
}

/// The string-keyed entries of a dict, sorted; for equal keys the last one wins.
fn entries<'a>(heap: &Heap<'a>, value: Value<'a>) -> Option<BTreeMap<&'a str, Value<'a>>> {
    let Value::Dict(id) = value else {
        return None;
    };
    let pairs = &heap.dicts[id as usize];
    Some(
        pairs
            .iter()
            .filter_map(|&(key, value)| match key {
                Value::Str(key) => Some((key, value)),
                _ => None,
            })
            .collect(),
    )
}

fn tensors<'v, 'a: 'v>(values: impl Iterator<Item = &'v Value<'a>>) -> usize {
    values.filter(|v| matches!(v, Value::Tensor(_))).count()
}

/// Maximum nesting depth at which a state dict is searched for.
const MAX_DEPTH: usize = 4;

fn only_nested<'a>(
    heap: &Heap<'a>,
    top: BTreeMap<&'a str, Value<'a>>,
    depth: usize,
) -> Result<BTreeMap<&'a str, Value<'a>>, Fault> {
    // Every dict is visited once, however often the pickle refers to it.
    let mut seen = BTreeMap::new();
    let mut nested: Vec<&'a str> = Vec::new();
    for (&key, &value) in &top {
        if let Value::Dict(id) = value {
            let holds = *seen.entry(id).or_insert_with(|| {
                let pairs = &heap.dicts[id as usize];
                pairs.iter().any(|(_, v)| matches!(v, Value::Tensor(_)))
            });
            if holds {
                nested.push(key);
            }
        }
    }
    match nested[..] {
        [key] => match entries(heap, top[key]) {
            Some(found) if tensors(found.values()) > 0 => Ok(found),
            _ => Err(Fault::StateDict(format!(
                "the keys of the tensors under '{key}' are not strings"
            ))),
        },
        [] if top.is_empty() => Ok(top),
        [] => {
            let mut dicts = top.values().filter_map(|&value| entries(heap, value));
            // Searches further only inside a dict that contains exactly one other dict.
            if let (true, Some(inner), None) = (depth > 0, dicts.next(), dicts.next()) {
                return only_nested(heap, inner, depth - 1);
            }
            Err(Fault::StateDict(format!(
                "no state dict; keys: {}",
                list(top.keys().copied())
            )))
        }
        _ => Err(Fault::StateDict(format!(
            "several state dicts, under {}; save only the one to use",
            list(nested.iter().copied())
        ))),
    }
}

/// Formats the first few of many keys for a message.
fn list<'a>(keys: impl Iterator<Item = &'a str> + Clone) -> String {
    const SHOWN: usize = 12;
    let mut text: Vec<String> = keys
        .clone()
        .take(SHOWN)
        .map(|k| format!("'{}'", k.chars().take(80).collect::<String>()))
        .collect();
    let more = keys.count().saturating_sub(SHOWN);
    if more > 0 {
        text.push(format!("{more} more"));
    }
    text.join(", ")
}

fn layout<'a>(
    heap: &Heap<'a>,
    id: u32,
    file_len: usize,
    place: &mut impl FnMut(&Storage<'a>) -> Result<Range<usize>, Fault>,
) -> Result<TensorLayout, Fault> {
    let tensor = &heap.tensors[id as usize];
    let storage = &heap.storages[tensor.storage as usize];
    if tensor.shape.len() > crate::tensor::MAX_RANK {
        return malformed!(
            "{} axes; at most {} are supported",
            tensor.shape.len(),
            crate::tensor::MAX_RANK
        );
    }
    let numbers = |range: &Range<u32>| -> Result<Vec<usize>, Fault> {
        heap.tuples[range.start as usize..range.end as usize]
            .iter()
            .take(crate::tensor::MAX_RANK + 1)
            .map(|v| match *v {
                Value::Int(n) => usize::try_from(n)
                    .map_err(|_| Fault::Malformed(format!("a negative size or stride ({n})"))),
                _ => malformed!("a size or stride is {}", v.kind()),
            })
            .collect()
    };
    let Ok(offset) = usize::try_from(tensor.offset) else {
        return malformed!("a negative offset ({})", tensor.offset);
    };
    TensorLayout::new(
        storage.dtype,
        numbers(&tensor.shape)?,
        numbers(&tensor.strides)?,
        offset,
        place(storage)?,
        file_len,
    )
}
