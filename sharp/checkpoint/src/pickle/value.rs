//! Values of the interpreter and the arenas that store them.

use std::ops::Range;

use crate::tensor::DType;

/// A constructor that state dicts use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Global {
    OrderedDict,
    /// `torch._utils._rebuild_tensor`: storage, offset, shape, strides.
    RebuildTensor,
    /// `torch._utils._rebuild_tensor_v2`: the arguments of `_rebuild_tensor`, followed by arguments for autograd.
    RebuildTensorV2,
    /// `torch._utils._rebuild_parameter`: a trainable tensor.
    RebuildParameter,
    /// `torch.Size`: a tuple.
    Size,
    /// `torch.FloatStorage` and the storages of other types.
    Storage(DType),
}

impl Global {
    /// The constructor `name` of the module `module`, if it is supported.
    pub(super) fn find(module: &str, name: &str) -> Option<Self> {
        Some(match (module, name) {
            ("collections", "OrderedDict") => Self::OrderedDict,
            ("torch._utils", "_rebuild_tensor") => Self::RebuildTensor,
            ("torch._utils", "_rebuild_tensor_v2") => Self::RebuildTensorV2,
            ("torch._utils", "_rebuild_parameter") => Self::RebuildParameter,
            ("torch", "Size") => Self::Size,
            ("torch" | "torch.cuda", storage) => Self::Storage(match storage {
                "FloatStorage" => DType::F32,
                "HalfStorage" => DType::F16,
                "BFloat16Storage" => DType::BF16,
                "DoubleStorage" => DType::F64,
                "LongStorage" => DType::I64,
                "IntStorage" => DType::I32,
                "ShortStorage" => DType::I16,
                "CharStorage" => DType::I8,
                "ByteStorage" => DType::U8,
                "BoolStorage" => DType::Bool,
                _ => return None,
            }),
            _ => return None,
        })
    }
}

/// A value. Containers are indices into [`Heap`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Value<'a> {
    None,
    Bool(bool),
    Int(i64),
    /// An integer longer than 8 bytes, little-endian two's complement.
    Long(&'a [u8]),
    Float,
    Str(&'a str),
    Bytes,
    /// Items `start..end` of [`Heap::tuples`].
    Tuple(u32, u32),
    List(u32),
    Dict(u32),
    Global(Global),
    /// An unknown class or function, or the result of calling it: index of its name in [`Heap::foreign`].
    Foreign(u32),
    Storage(u32),
    Tensor(u32),
}

impl Value<'_> {
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::None => "None",
            Self::Bool(_) => "a bool",
            Self::Int(_) | Self::Long(_) => "an integer",
            Self::Float => "a float",
            Self::Str(_) => "a string",
            Self::Bytes => "bytes",
            Self::Tuple(..) => "a tuple",
            Self::List(_) => "a list",
            Self::Dict(_) => "a dict",
            Self::Global(_) | Self::Foreign(_) => "a class, a function or an object made by one",
            Self::Storage(_) => "a storage",
            Self::Tensor(_) => "a tensor",
        }
    }
}

/// A storage as described by its persistent id. The container knows the location of its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Storage<'a> {
    pub(crate) key: &'a str,
    pub(crate) dtype: DType,
    pub(crate) numel: u64,
}

/// A tensor as described by the pickle; only the types of its parts have been checked.
#[derive(Debug, Clone)]
pub(crate) struct Tensor {
    /// Index of the tensor's [`Storage`].
    pub(crate) storage: u32,
    /// Offset of the first element in the storage.
    pub(crate) offset: i64,
    pub(crate) shape: Range<u32>,
    pub(crate) strides: Range<u32>,
}

/// Arenas for everything that values refer to.
#[derive(Debug, Default)]
pub(crate) struct Heap<'a> {
    pub(crate) tuples: Vec<Value<'a>>,
    pub(crate) lists: Vec<Vec<Value<'a>>>,
    /// Pairs in the order of assignment; for equal keys the last one wins.
    pub(crate) dicts: Vec<Vec<(Value<'a>, Value<'a>)>>,
    pub(crate) storages: Vec<Storage<'a>>,
    pub(crate) tensors: Vec<Tensor>,
    /// Module and name of unknown classes and functions.
    pub(crate) foreign: Vec<String>,
    /// Number of pairs that ordered dicts have copied from lists so far.
    pub(super) copied: usize,
}

impl<'a> Heap<'a> {
    /// Items of a tuple or a list.
    pub(super) fn items(&self, value: Value<'a>) -> Option<&[Value<'a>]> {
        match value {
            Value::Tuple(start, end) => Some(&self.tuples[start as usize..end as usize]),
            Value::List(id) => Some(&self.lists[id as usize]),
            _ => None,
        }
    }
}
