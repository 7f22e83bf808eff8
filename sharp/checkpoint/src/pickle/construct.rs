//! The supported constructors, which turn arguments into values.

use crate::error::{Fault, malformed};

use super::value::{Global, Heap, Storage, Tensor, Value};

/// Maximum number of pairs that all ordered dicts together may copy from lists.
const MAX_COPIED: usize = 1 << 20;
/// Maximum length of a storage's key, in bytes. PyTorch uses counters or addresses, which are short.
const MAX_KEY_LEN: usize = 128;

impl<'a> Heap<'a> {
    /// Evaluates a call of `function` with the tuple `args`.
    pub(super) fn construct(
        &mut self,
        function: Value<'a>,
        args: Value<'a>,
    ) -> Result<Value<'a>, Fault> {
        if let Value::Foreign(_) = function {
            return Ok(function);
        }
        let Value::Global(global) = function else {
            return malformed!("pickle: {} is called as a function", function.kind());
        };
        let Value::Tuple(start, end) = args else {
            return malformed!(
                "pickle: the arguments of a call are {}, not a tuple",
                args.kind()
            );
        };
        let args = &self.tuples[start as usize..end as usize];
        match (global, args) {
            (Global::OrderedDict, []) => Ok(self.new_dict(Vec::new())),
            (Global::OrderedDict, &[pairs]) => {
                let pairs = self.pairs(pairs)?;
                Ok(self.new_dict(pairs))
            }
            (
                Global::RebuildTensor | Global::RebuildTensorV2,
                &[
                    Value::Storage(storage),
                    Value::Int(offset),
                    Value::Tuple(a, b),
                    Value::Tuple(c, d),
                    ..,
                ],
            ) => {
                self.tensors.push(Tensor {
                    storage,
                    offset,
                    shape: a..b,
                    strides: c..d,
                });
                Ok(Value::Tensor(self.tensors.len() as u32 - 1))
            }
            (Global::RebuildParameter, &[tensor @ (Value::Tensor(_) | Value::Foreign(_)), ..])
            | (
                Global::RebuildTensor | Global::RebuildTensorV2,
                &[tensor @ Value::Foreign(_), ..],
            ) => Ok(tensor),
            (Global::Size, &[shape @ Value::Tuple(..)]) => Ok(shape),
            _ => malformed!("pickle: {global:?} is called with unexpected arguments"),
        }
    }

    /// Key-value pairs of a list of two-item lists or tuples, which is how Python 2 pickled ordered dicts.
    fn pairs(&mut self, list: Value<'a>) -> Result<Vec<(Value<'a>, Value<'a>)>, Fault> {
        let Some(items) = self.items(list) else {
            return malformed!(
                "pickle: an ordered dict is built from {}, not from a list",
                list.kind()
            );
        };
        // Limit the total copied: this is the only place where one opcode can copy more than it consumes.
        let copied = self.copied + items.len();
        if copied > MAX_COPIED {
            return malformed!("pickle: too many pairs copied into ordered dicts");
        }
        let pairs = items
            .iter()
            .map(|&item| match self.items(item) {
                Some(&[key, value]) => Ok((key, value)),
                _ => malformed!("pickle: the items of an ordered dict are not pairs"),
            })
            .collect();
        self.copied = copied;
        pairs
    }

    pub(super) fn new_dict(&mut self, pairs: Vec<(Value<'a>, Value<'a>)>) -> Value<'a> {
        self.dicts.push(pairs);
        Value::Dict(self.dicts.len() as u32 - 1)
    }

    /// The storage denoted by a persistent id `('storage', class, key, location, numel[, view])`.
    /// The location (`cpu`, `cuda:0`) is the device from which the storage was saved; it is
    /// ignored.
    pub(super) fn persistent(&mut self, id: Value<'a>) -> Result<Value<'a>, Fault> {
        if let Some(&[Value::Str("storage"), class @ Value::Foreign(_), ..]) = self.items(id) {
            return Ok(class);
        }
        let (dtype, key, numel) = match self.items(id) {
            Some(
                &[
                    Value::Str("storage"),
                    Value::Global(Global::Storage(dtype)),
                    Value::Str(key),
                    Value::Str(_),
                    Value::Int(numel),
                ]
                | &[
                    Value::Str("storage"),
                    Value::Global(Global::Storage(dtype)),
                    Value::Str(key),
                    Value::Str(_),
                    Value::Int(numel),
                    Value::None,
                ],
            ) => (dtype, key, numel),
            _ => return malformed!("pickle: a persistent id does not describe a storage"),
        };
        if key.len() > MAX_KEY_LEN {
            return malformed!(
                "pickle: a storage key has {} bytes; at most {MAX_KEY_LEN} are supported",
                key.len()
            );
        }
        let Ok(numel) = u64::try_from(numel) else {
            return malformed!("pickle: storage '{key}' has a negative size ({numel} elements)");
        };
        self.storages.push(Storage { key, dtype, numel });
        Ok(Value::Storage(self.storages.len() as u32 - 1))
    }
}
