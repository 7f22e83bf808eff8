//! PyTorch's format before 1.6: five consecutive pickles, followed by the storages.
//!
//! The pickles are a magic number, the protocol version, information about the machine that wrote the file, the object,
//! and the keys of the storages in file order. Each storage is its element count (8 bytes) followed by its elements.
//! The files of torchvision and LPIPS use this format.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::bytes::Bytes;
use crate::error::{Fault, malformed};
use crate::pickle;
use crate::pickle::state_dict::{NamedTensors, resolve};
use crate::pickle::value::{Heap, Value};

/// 0x1950a86a20f9469cfc6c, little-endian.
const MAGIC: [u8; 10] = [0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];
const PROTOCOL: i64 = 1001;
/// Maximum total size of the pickles before the storages, in bytes.
const MAX_PICKLES: usize = 64 << 20;

/// Reads the table of contents.
pub(crate) fn read(file: &(impl Bytes + ?Sized)) -> Result<NamedTensors, Fault> {
    // The length of the pickles is known only after running them.
    let mut len = 1 << 17;
    loop {
        match contents(file, &file.start(len)?) {
            Err(Fault::CutOff(_)) if len < MAX_PICKLES.min(file.len()) => len *= 8,
            read => return read,
        }
    }
}

/// Reads the table of contents from the first bytes of the file, `start`.
fn contents(file: &(impl Bytes + ?Sized), start: &[u8]) -> Result<NamedTensors, Fault> {
    let mut heap = Heap::default();
    let mut values = [Value::None; 5];
    let mut at = 0;
    for (nth, slot) in values.iter_mut().enumerate() {
        let (value, used) = pickle::load(&start[at..], &mut heap)?;
        at += used;
        if nth == 0 && value != Value::Long(&MAGIC) {
            return malformed!("a pickle, but not written by PyTorch");
        }
        *slot = value;
    }
    let [_, protocol, system, root, keys] = values;
    if protocol != Value::Int(PROTOCOL) {
        return malformed!("unknown version of PyTorch's older format");
    }
    if let Value::Dict(id) = system
        && heap.dicts[id as usize].contains(&(Value::Str("little_endian"), Value::Bool(false)))
    {
        return malformed!("written on a big-endian machine, which is not supported");
    }
    let places = storages(file, at, &heap, keys)?;
    resolve(&heap, root, file.len(), |storage| {
        match places.get(storage.key) {
            Some(place) => Ok(place.clone()),
            None => malformed!("storage '{}' is not in the file", storage.key),
        }
    })
}

/// Locates the storages that follow the pickles.
fn storages<'a>(
    file: &(impl Bytes + ?Sized),
    mut at: usize,
    heap: &Heap<'a>,
    keys: Value<'a>,
) -> Result<BTreeMap<&'a str, Range<usize>>, Fault> {
    let mut described = BTreeMap::new();
    for storage in &heap.storages {
        if described
            .insert(storage.key, storage)
            .is_some_and(|other| other != storage)
        {
            return malformed!(
                "storage '{}' is described twice, with different types or sizes",
                storage.key
            );
        }
    }
    let Value::List(id) = keys else {
        return malformed!("the keys of the storages are {}, not a list", keys.kind());
    };
    let mut places = BTreeMap::new();
    for key in &heap.lists[id as usize] {
        let &Value::Str(key) = key else {
            return malformed!("a storage's key is {}", key.kind());
        };
        let Some(storage) = described.get(key) else {
            return malformed!("storage '{key}' belongs to no tensor, so its type is unknown");
        };
        if at + 8 > file.len() {
            return malformed!("storage '{key}' is cut off");
        }
        let mut count = [0; 8];
        file.read_into(at, &mut count)?;
        let numel = u64::from_le_bytes(count);
        if numel != storage.numel {
            return malformed!(
                "storage '{key}' has {numel} elements, but its tensors declare {}",
                storage.numel
            );
        }
        let start = at + 8;
        let end = usize::try_from(numel)
            .ok()
            .and_then(|n| n.checked_mul(storage.dtype.size())?.checked_add(start))
            .filter(|&end| end <= file.len());
        let Some(end) = end else {
            return malformed!("storage '{key}' of {numel} elements reaches beyond the file");
        };
        if places.insert(key, start..end).is_some() {
            return malformed!("storage '{key}' occurs twice");
        }
        at = end;
    }
    Ok(places)
}
