//! Element types, strided layouts, and reading of a single tensor.

use std::fmt;
use std::ops::Range;

use half::{bf16, f16};

use crate::bytes::Bytes;
use crate::error::{Fault, malformed};

/// Maximum number of axes of a tensor; limits the shapes that a hostile file can declare.
pub(crate) const MAX_RANK: usize = 32;

/// Element type of a stored tensor. All are little-endian in every format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DType {
    F32,
    F16,
    /// The upper half of an IEEE single.
    BF16,
    F64,
    I64,
    I32,
    I16,
    I8,
    U8,
    /// One byte, 0 or 1.
    Bool,
}

impl DType {
    /// Bytes per element.
    pub fn size(self) -> usize {
        match self {
            Self::F64 | Self::I64 => 8,
            Self::F32 | Self::I32 => 4,
            Self::F16 | Self::BF16 | Self::I16 => 2,
            Self::I8 | Self::U8 | Self::Bool => 1,
        }
    }

    /// Name as in safetensors headers: `F32`, `BF16`, `BOOL`, …
    pub fn name(self) -> &'static str {
        match self {
            Self::F32 => "F32",
            Self::F16 => "F16",
            Self::BF16 => "BF16",
            Self::F64 => "F64",
            Self::I64 => "I64",
            Self::I32 => "I32",
            Self::I16 => "I16",
            Self::I8 => "I8",
            Self::U8 => "U8",
            Self::Bool => "BOOL",
        }
    }

    pub fn from_name(name: &str) -> Option<Self> {
        const ALL: [DType; 10] = [
            DType::F32,
            DType::F16,
            DType::BF16,
            DType::F64,
            DType::I64,
            DType::I32,
            DType::I16,
            DType::I8,
            DType::U8,
            DType::Bool,
        ];
        ALL.into_iter().find(|d| d.name() == name)
    }
}

impl fmt::Display for DType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Location of a tensor in the file. Built only by [`TensorLayout::new`] and [`TensorLayout::contiguous`], which check
/// every bound.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TensorLayout {
    pub(crate) dtype: DType,
    pub(crate) shape: Vec<usize>,
    /// Distances along each axis, in elements.
    strides: Vec<usize>,
    /// Byte range in the file from the tensor's first element to the end of its storage.
    bytes: Range<usize>,
    numel: usize,
}

impl TensorLayout {
    /// Creates a view into a storage.
    ///
    /// `storage` is the byte range of the whole storage in a file of `file_len` bytes, `offset` the
    /// index of the tensor's first element within the storage. The tensor may overlap itself
    /// (stride 0). It must not have more elements than the file has bytes: real tensors never have,
    /// and the limit bounds the memory needed to read one.
    pub(crate) fn new(
        dtype: DType,
        shape: Vec<usize>,
        strides: Vec<usize>,
        offset: usize,
        storage: Range<usize>,
        file_len: usize,
    ) -> Result<Self, Fault> {
        if shape.len() != strides.len() {
            return malformed!("shape {shape:?} and strides {strides:?} differ in length");
        }
        if shape.len() > MAX_RANK {
            return malformed!(
                "a tensor of {} axes; at most {MAX_RANK} are supported",
                shape.len()
            );
        }
        if storage.start > storage.end || storage.end > file_len {
            return malformed!(
                "a storage at bytes {storage:?}, beyond the end of the file of {file_len} bytes"
            );
        }
        let numel = shape.iter().try_fold(1_usize, |n, &s| n.checked_mul(s));
        // An empty axis makes the product zero only if no earlier product overflowed.
        let numel = if shape.contains(&0) { Some(0) } else { numel };
        let Some(numel) = numel.filter(|&n| n <= file_len) else {
            return malformed!("shape {shape:?} has more elements than the file has bytes");
        };
        let available = (storage.end - storage.start) / dtype.size();
        let last = shape
            .iter()
            .zip(&strides)
            .try_fold(offset, |at, (&n, &stride)| {
                at.checked_add(n.saturating_sub(1).checked_mul(stride)?)
            });
        let fits = match last {
            Some(last) if numel > 0 => last < available,
            // An empty tensor reads nothing, but its offset must still be valid.
            _ => numel == 0 && offset <= available,
        };
        if !fits {
            return malformed!(
                "shape {shape:?} with strides {strides:?} at element {offset} lies outside its \
                 storage of {available} elements"
            );
        }
        Ok(Self {
            dtype,
            shape,
            strides,
            bytes: storage.start + offset * dtype.size()..storage.end,
            numel,
        })
    }

    /// Creates a contiguous tensor that fills `bytes` of the file exactly.
    pub(crate) fn contiguous(
        dtype: DType,
        shape: Vec<usize>,
        bytes: Range<usize>,
        file_len: usize,
    ) -> Result<Self, Fault> {
        let mut strides = vec![0; shape.len()];
        let mut step = 1_usize;
        for (stride, &n) in strides.iter_mut().zip(&shape).rev() {
            *stride = step;
            step = step.saturating_mul(n.max(1));
        }
        let len = bytes.end.saturating_sub(bytes.start);
        let layout = Self::new(dtype, shape, strides, 0, bytes, file_len)?;
        if layout.numel.checked_mul(dtype.size()) != Some(len) {
            return malformed!(
                "shape {:?} of {dtype} does not fill {len} bytes",
                layout.shape
            );
        }
        Ok(layout)
    }

    /// True if elements are contiguous in C order. Axes of length 1 may have any stride.
    fn is_contiguous(&self) -> bool {
        let mut step = 1;
        for (&n, &stride) in self.shape.iter().zip(&self.strides).rev() {
            if n != 1 {
                if stride != step {
                    return false;
                }
                step *= n;
            }
        }
        true
    }

    /// Elements in C order, little-endian.
    pub(crate) fn bytes(&self, file: &(impl Bytes + ?Sized)) -> Result<Vec<u8>, Fault> {
        let size = self.dtype.size();
        if self.numel == 0 {
            return Ok(Vec::new());
        }
        let last: usize = self
            .shape
            .iter()
            .zip(&self.strides)
            .map(|(&n, &stride)| (n - 1) * stride)
            .sum();
        let source = file.get(self.bytes.start..self.bytes.start + (last + 1) * size)?;
        let (Some((&run, outer)), Some((&step, outer_strides)), false) = (
            self.shape.split_last(),
            self.strides.split_last(),
            self.is_contiguous(),
        ) else {
            return Ok(source);
        };
        let mut out = Vec::with_capacity(self.numel * size);
        let mut index = vec![0_usize; outer.len()];
        loop {
            let base: usize = index.iter().zip(outer_strides).map(|(&i, &s)| i * s).sum();
            for i in 0..run {
                let at = (base + i * step) * size;
                out.extend_from_slice(&source[at..at + size]);
            }
            // Odometer: the last axis changes fastest.
            let mut axis = outer.len();
            loop {
                if axis == 0 {
                    return Ok(out);
                }
                axis -= 1;
                index[axis] += 1;
                if index[axis] < outer[axis] {
                    break;
                }
                index[axis] = 0;
            }
        }
    }

    /// Elements in C order as f32.
    pub(crate) fn f32(&self, file: &(impl Bytes + ?Sized)) -> Result<Vec<f32>, Fault> {
        if self.dtype == DType::F32 && self.is_contiguous() && cfg!(target_endian = "little") {
            let mut values = vec![0.0_f32; self.numel];
            file.read_into(self.bytes.start, bytemuck::cast_slice_mut(&mut values))?;
            return Ok(values);
        }
        Ok(to_f32(self.dtype, &self.bytes(file)?))
    }
}

/// Decodes little-endian elements; wider types are rounded to the nearest f32.
fn to_f32(dtype: DType, bytes: &[u8]) -> Vec<f32> {
    fn each<const N: usize>(bytes: &[u8], decode: impl Fn([u8; N]) -> f32) -> Vec<f32> {
        bytes
            .as_chunks::<N>()
            .0
            .iter()
            .map(|&b| decode(b))
            .collect()
    }
    match dtype {
        DType::F32 => each(bytes, f32::from_le_bytes),
        DType::F16 => each(bytes, |b| f16::from_le_bytes(b).to_f32()),
        DType::BF16 => each(bytes, |b| bf16::from_le_bytes(b).to_f32()),
        DType::F64 => each(bytes, |b| f64::from_le_bytes(b) as f32),
        DType::I64 => each(bytes, |b| i64::from_le_bytes(b) as f32),
        DType::I32 => each(bytes, |b| i32::from_le_bytes(b) as f32),
        DType::I16 => each(bytes, |b| f32::from(i16::from_le_bytes(b))),
        DType::I8 => each(bytes, |b| f32::from(i8::from_le_bytes(b))),
        DType::U8 | DType::Bool => each(bytes, |[b]| f32::from(b)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> Vec<u8> {
        (0..24).flat_map(|v| (v as f32).to_le_bytes()).collect()
    }

    fn view(shape: &[usize], strides: &[usize], offset: usize) -> Result<Vec<f32>, Fault> {
        let file = file();
        TensorLayout::new(
            DType::F32,
            shape.to_vec(),
            strides.to_vec(),
            offset,
            0..96,
            96,
        )
        .and_then(|layout| layout.f32(file.as_slice()))
    }

    #[test]
    fn any_strides_come_out_in_c_order() {
        assert_eq!(
            view(&[2, 3], &[3, 1], 6).unwrap(),
            [6., 7., 8., 9., 10., 11.]
        );
        assert_eq!(view(&[3, 2], &[1, 3], 0).unwrap(), [0., 3., 1., 4., 2., 5.]);
        // channels_last of (1, 2, 2, 2), an expanded axis, and a scalar.
        let channels_last = view(&[1, 2, 2, 2], &[8, 1, 4, 2], 0).unwrap();
        assert_eq!(channels_last, [0., 2., 4., 6., 1., 3., 5., 7.]);
        assert_eq!(view(&[2, 2], &[0, 1], 4).unwrap(), [4., 5., 4., 5.]);
        assert_eq!(view(&[], &[], 23).unwrap(), [23.]);
        assert!(view(&[3, 0], &[1, 1], 24).unwrap().is_empty());
    }

    #[test]
    fn views_outside_their_storage_and_overflowing_shapes_are_refused() {
        assert!(view(&[2, 3], &[3, 1], 19).is_err());
        assert!(view(&[2], &[24], 0).is_err());
        assert!(view(&[2], &[usize::MAX], 5).is_err());
        assert!(view(&[usize::MAX, 2], &[0, 0], 0).is_err());
        assert!(view(&[97], &[0], 0).is_err(), "more elements than bytes");
        assert!(view(&[1 << 40, 1 << 40, 0], &[0, 0, 0], 0).is_ok_and(|v| v.is_empty()));
        assert!(view(&[0], &[1], 25).is_err());
        assert!(view(&[1; 33], &[0; 33], 0).is_err());
        assert!(TensorLayout::contiguous(DType::F32, vec![2], 0..7, 96).is_err());
        assert!(TensorLayout::contiguous(DType::F32, vec![2], 92..100, 96).is_err());
    }

    #[test]
    fn narrow_and_wide_types_are_converted() {
        let mut file = vec![0_u8; 8];
        file.extend(f16::from_f32(-1.5).to_le_bytes());
        file.extend(bf16::from_f32(3.25).to_le_bytes());
        file.extend(0.1_f64.to_le_bytes());
        file.extend((-3_i64).to_le_bytes());
        file.extend((-7_i16).to_le_bytes());
        file.extend([0xFF, 0x01]);
        let len = file.len();
        let one = |dtype: DType, at: usize| {
            TensorLayout::contiguous(dtype, vec![1], at..at + dtype.size(), len)
                .unwrap()
                .f32(file.as_slice())
                .unwrap()[0]
        };
        assert_eq!(one(DType::F16, 8), -1.5);
        assert_eq!(one(DType::BF16, 10), 3.25);
        assert_eq!(one(DType::F64, 12), 0.1);
        assert_eq!(one(DType::I64, 20), -3.0);
        assert_eq!(one(DType::I16, 28), -7.0);
        assert_eq!(one(DType::I8, 30), -1.0);
        assert_eq!(one(DType::U8, 30), 255.0);
        assert_eq!(one(DType::Bool, 31), 1.0);
    }
}
