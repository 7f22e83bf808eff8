//! Layers of the frozen networks.

use super::conv::{FeatureMap, FrozenConv};
use rayon::prelude::*;

/// From the gradient of a layer's output to that of its input.
pub(super) type Pull<'a> = Box<dyn FnOnce(FeatureMap) -> FeatureMap + 'a>;

/// A layer of a frozen network.
pub(super) trait Layer: Send + Sync {
    /// The output, with what the derivative needs: which units were active, not their values.
    fn trace<'a>(&'a self, x: &FeatureMap) -> (FeatureMap, Pull<'a>);
}

/// Active units of a rectified map.
struct Gate(Vec<bool>);

impl Gate {
    fn of(map: &FeatureMap) -> Self {
        Self(
            map.data
                .par_iter()
                .with_min_len(1 << 15)
                .map(|v| *v > 0.0)
                .collect(),
        )
    }

    /// Zeros the gradient of those that are not.
    fn close(&self, gradient: &mut FeatureMap) {
        let pairs = gradient
            .data
            .par_iter_mut()
            .zip(&self.0)
            .with_min_len(1 << 15);
        pairs.for_each(|(g, open)| *g = if *open { *g } else { 0.0 });
    }
}

/// A convolution, rectified.
pub(super) struct ReluConv(pub(super) FrozenConv);

impl Layer for ReluConv {
    fn trace<'a>(&'a self, x: &FeatureMap) -> (FeatureMap, Pull<'a>) {
        let (out, size) = (self.0.run(x, None, true), x.size());
        let gate = Gate::of(&out);
        let pull = move |mut gradient: FeatureMap| {
            gate.close(&mut gradient);
            self.0.pull(&gradient, size, None)
        };
        (out, Box::new(pull))
    }
}

/// ResNet's block: 1×1, 3×3 and 1×1 convolutions, added to the input, which a 1×1 convolution fits
/// where its shape changes; rectified after each and at the end (He et al. 2016, figure 5).
pub(super) struct Bottleneck {
    pub(super) narrow: FrozenConv,
    pub(super) middle: FrozenConv,
    pub(super) widen: FrozenConv,
    pub(super) shortcut: Option<FrozenConv>,
}

impl Layer for Bottleneck {
    fn trace<'a>(&'a self, x: &FeatureMap) -> (FeatureMap, Pull<'a>) {
        let size = x.size();
        let narrow = self.narrow.run(x, None, true);
        let middle = self.middle.run(&narrow, None, true);
        let fitted = self.shortcut.as_ref().map(|s| s.run(x, None, false));
        let residual = fitted.as_ref().unwrap_or(x);
        let out = self.widen.run(&middle, Some(residual), true);
        let (inner, gates) = (narrow.size(), [&narrow, &middle, &out].map(Gate::of));
        let pull = move |mut gradient: FeatureMap| {
            let [narrow_gate, middle_gate, out_gate] = gates;
            out_gate.close(&mut gradient);
            let mut middle = self.widen.pull(&gradient, gradient.size(), None);
            middle_gate.close(&mut middle);
            let mut narrow = self.middle.pull(&middle, inner, None);
            narrow_gate.close(&mut narrow);
            if let Some(shortcut) = &self.shortcut {
                gradient = shortcut.pull(&gradient, size, None);
            }
            self.narrow.pull(&narrow, size, Some(&gradient))
        };
        (out, Box::new(pull))
    }
}
