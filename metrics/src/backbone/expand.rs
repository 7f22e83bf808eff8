//! SqueezeNet's two convolutions side by side.

use std::ops::Range;

use sharp_kernels::{Conv2d, RowOp, RowWindow, Workspace};

/// Two convolutions of the same input, with outputs of the same size, whose channels are joined.
#[derive(Debug)]
pub(crate) struct Expand {
    pub(crate) parts: [Conv2d; 2],
}

impl RowOp for Expand {
    fn out_size(&self, height: usize, width: usize) -> (usize, usize) {
        self.parts[0].out_size(height, width)
    }

    fn out_channels(&self, in_channels: usize) -> usize {
        self.parts
            .iter()
            .map(|part| part.out_channels(in_channels))
            .sum()
    }

    fn in_rows(&self, out: Range<usize>, in_height: usize) -> Range<usize> {
        let [a, b] = self
            .parts
            .each_ref()
            .map(|part| part.in_rows(out.clone(), in_height));
        a.start.min(b.start)..a.end.max(b.end)
    }

    fn run_rows(
        &self,
        input: &RowWindow<'_>,
        out: Range<usize>,
        output: &mut [f32],
        workspace: &mut Workspace,
    ) {
        let channels = self.out_channels(input.channels());
        let mut first = 0;
        for part in &self.parts {
            let own = part.out_channels(input.channels());
            let mut values = vec![0.0; output.len() / channels * own];
            part.run_rows(input, out.clone(), &mut values, workspace);
            let pixels = output
                .chunks_exact_mut(channels)
                .zip(values.chunks_exact(own));
            for (pixel, values) in pixels {
                pixel[first..first + own].copy_from_slice(values);
            }
            first += own;
        }
    }
}
