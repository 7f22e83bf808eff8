//! This project's kernels as candle custom operations.

use std::borrow::Cow;

use candle_core::backprop::GradStore;
use candle_core::{
    CpuStorage, CustomOp3, DType, Device, Layout, Result, Shape, Storage, Tensor, Var, bail,
};
use sharp_kernels::RowWindow;
use sharp_kernels::conv::backward::keep_where_positive;

use crate::model::compute::{Compute, Kernels};

/// An operation on one to three tensors.
pub(super) trait Operation: Send + Sync + 'static {
    const NAME: &'static str;

    /// Evaluates with candle, on any device.
    fn by_candle(&self, inputs: &[Tensor]) -> Result<Tensor>;

    /// Evaluates with this project's kernels; returns the output's values and shape.
    fn by_kernels(&self, kernels: Kernels, inputs: &[View<'_>]) -> (Vec<f32>, Vec<usize>);

    /// Gradients of the inputs computed by this project's kernels. `None` (the default) uses candle's gradients of
    /// [`Self::by_candle`].
    fn back(&self, _: Kernels, _: &Pass<'_>) -> Option<Vec<Option<Back>>> {
        None
    }
}

pub(super) fn apply(
    kernels: Option<Kernels>,
    operation: impl Operation,
    inputs: &[&Tensor],
) -> Result<Tensor> {
    let Some(kernels) = kernels else {
        let inputs: Vec<Tensor> = inputs.iter().copied().cloned().collect();
        return operation.by_candle(&inputs);
    };
    // A custom operation always has three inputs; unused ones are empty.
    let nothing = Tensor::zeros(0, DType::F32, &Device::Cpu)?;
    let [a, b, c] = [0, 1, 2].map(|k| inputs.get(k).copied().unwrap_or(&nothing));
    a.apply_op3(b, c, Custom { operation, kernels })
}

/// Values of a contiguous f32 tensor on the CPU.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) values: &'a [f32],
    pub(super) dims: &'a [usize],
}

impl<'a> View<'a> {
    pub(super) fn new(storage: &'a CpuStorage, layout: &'a Layout) -> Result<Self> {
        match (storage, layout.contiguous_offsets()) {
            (CpuStorage::F32(values), Some((start, end))) => Ok(Self {
                values: &values[start..end],
                dims: layout.dims(),
            }),
            _ => bail!("kernels need contiguous f32 tensors, not {layout:?}"),
        }
    }

    pub(super) fn of(storage: &'a Storage, layout: &'a Layout) -> Result<Self> {
        match storage {
            Storage::Cpu(storage) => Self::new(storage, layout),
            _ => bail!("kernels need tensors on the CPU"),
        }
    }

    /// Height, width and channels of an image.
    pub(super) fn image(&self) -> (usize, usize, usize) {
        match *self.dims {
            [.., height, width, channels] => (height, width, channels),
            _ => (1, 1, self.values.len()),
        }
    }

    pub(super) fn window(&self) -> RowWindow<'a> {
        let (height, width, channels) = self.image();
        RowWindow::whole(self.values, height, width, channels)
    }
}

/// Gradient with respect to an input: values of its own, or the output's gradient unchanged.
pub(super) enum Back {
    Values(Vec<f32>),
    Upstream,
}

/// Tensors of an operation in the backward pass.
pub(super) struct Pass<'a> {
    pub(super) inputs: &'a [View<'a>],
    pub(super) output: View<'a>,
    /// Gradient of the output.
    pub(super) upstream: &'a [f32],
    /// True for inputs whose gradient is needed.
    wanted: &'a [bool],
}

impl Pass<'_> {
    /// Gradient with respect to the output or, if the operation ends with a ReLU (`rectified`),
    /// with respect to the values before the ReLU.
    pub(super) fn upstream(&self, rectified: bool) -> Cow<'_, [f32]> {
        let mut upstream = Cow::Borrowed(self.upstream);
        if rectified {
            keep_where_positive(upstream.to_mut(), self.output.values);
        }
        upstream
    }

    pub(super) fn wants(&self, input: usize) -> bool {
        self.wanted.get(input) == Some(&true)
    }
}

struct Custom<O> {
    operation: O,
    kernels: Kernels,
}

impl<O: Operation> Custom<O> {
    fn back_by_kernels(
        &self,
        inputs: &[&Tensor],
        output: &Tensor,
        upstream: &Tensor,
    ) -> Result<Option<Vec<Option<Tensor>>>> {
        let all = inputs.iter().copied().chain([output, upstream]);
        let storages: Vec<_> = all.map(Tensor::storage_and_layout).collect();
        let views = storages.iter().map(|(s, l)| View::of(s, l));
        let views = views.collect::<Result<Vec<_>>>()?;
        let (views, rest) = views.split_at(inputs.len());
        let wanted: Vec<bool> = inputs.iter().map(|input| input.track_op()).collect();
        let pass = Pass {
            inputs: views,
            output: rest[0],
            upstream: rest[1].values,
            wanted: &wanted,
        };
        let Some(found) = self.operation.back(self.kernels, &pass) else {
            return Ok(None);
        };
        let pairs = found.into_iter().zip(inputs);
        let tensors = pairs.map(|(back, input)| match back {
            None => Ok(None),
            Some(Back::Upstream) => upstream.reshape(input.shape()).map(Some),
            Some(Back::Values(values)) => {
                Tensor::from_vec(values, input.shape(), &Device::Cpu).map(Some)
            }
        });
        tensors.collect::<Result<Vec<_>>>().map(Some)
    }

    fn back_by_candle(&self, inputs: &[&Tensor], upstream: &Tensor) -> Result<Vec<Option<Tensor>>> {
        let ends = inputs.iter().map(|input| {
            if input.track_op() {
                Ok(Var::from_tensor(input)?.into_inner())
            } else {
                Ok((*input).clone())
            }
        });
        let ends = ends.collect::<Result<Vec<_>>>()?;
        let output = self.operation.by_candle(&ends)?;
        let found = (output * upstream)?.sum_all()?.backward()?;
        Ok(ends.iter().map(|end| found.get(end).cloned()).collect())
    }
}

impl<O: Operation> CustomOp3 for Custom<O> {
    fn name(&self) -> &'static str {
        O::NAME
    }

    fn cpu_fwd(
        &self,
        s1: &CpuStorage,
        l1: &Layout,
        s2: &CpuStorage,
        l2: &Layout,
        s3: &CpuStorage,
        l3: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let given = [(s1, l1), (s2, l2), (s3, l3)].into_iter();
        let given = given.filter(|(_, layout)| layout.shape().elem_count() > 0);
        let views = given.map(|(s, l)| View::new(s, l));
        let views = views.collect::<Result<Vec<_>>>()?;
        let (values, shape) = self.operation.by_kernels(self.kernels, &views);
        Ok((CpuStorage::F32(values), shape.into()))
    }

    fn bwd(
        &self,
        a: &Tensor,
        b: &Tensor,
        c: &Tensor,
        output: &Tensor,
        upstream: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let upstream = &upstream.contiguous()?;
        let given = [a, b, c].into_iter();
        let given: Vec<_> = given.filter(|input| input.elem_count() > 0).collect();
        let found = match self.back_by_kernels(&given, output, upstream)? {
            Some(found) => found,
            None => self.back_by_candle(&given, upstream)?,
        };
        let mut found = found.into_iter();
        let [a, b, c] = std::array::from_fn(|_| found.next().flatten());
        Ok((a, b, c))
    }
}

/// Gradients of Σ output · upstream with respect to all variables that the outputs depend on;
/// `None` if the outputs depend on no variable.
///
/// # Errors
/// If shapes differ, or the device fails.
pub fn pull(compute: &Compute, outputs: &[(Tensor, Tensor)]) -> Result<Option<GradStore>> {
    let tracked = outputs.iter().filter(|(output, _)| output.track_op());
    let parts =
        tracked.map(|(output, upstream)| apply(compute.kernels, Inner, &[output, upstream]));
    let parts = parts.collect::<Result<Vec<_>>>()?;
    if parts.is_empty() {
        return Ok(None);
    }
    Tensor::stack(&parts, 0)?.sum_all()?.backward().map(Some)
}

/// `Σ x·w`, a scalar. Its gradient with respect to `x` is `w`; there is no gradient with respect to `w`.
struct Inner;

impl Operation for Inner {
    const NAME: &'static str = "sharp-inner-product";

    fn by_candle(&self, inputs: &[Tensor]) -> Result<Tensor> {
        (&inputs[0] * &inputs[1])?.sum_all()
    }

    fn by_kernels(&self, _: Kernels, inputs: &[View<'_>]) -> (Vec<f32>, Vec<usize>) {
        let pairs = inputs[0].values.iter().zip(inputs[1].values);
        (vec![pairs.map(|(x, y)| x * y).sum()], Vec::new())
    }

    fn back(&self, _: Kernels, pass: &Pass<'_>) -> Option<Vec<Option<Back>>> {
        let constant = pass.inputs[1].values.iter();
        let values = constant.map(|v| v * pass.upstream[0]).collect();
        Some(vec![Some(Back::Values(values))])
    }
}
