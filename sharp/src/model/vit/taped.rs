//! The transformer in training: by tensors, so that candle differentiates it.

use std::sync::Arc;

use candle_core::{Device, Tensor};

use super::{Features, Vit};
use crate::model::ModelError;
use crate::model::engine::Runtime;
use crate::model::map::{HostMap, Map};
use crate::model::observer::StageObserver;
use crate::model::tape::{Node, Tape};

impl Vit {
    /// As [`Vit::forward`]. All maps together are one node, behind one for each map.
    pub(super) fn on_tape(
        &self,
        rt: &Runtime,
        tape: &Arc<Tape>,
        images: &[f32],
        taps: &[usize],
        name: &str,
        observer: &mut dyn StageObserver,
    ) -> Result<Features, ModelError> {
        let (mut outputs, last) =
            self.tokens(rt, &Device::Cpu, images, taps, &mut |stage, value| {
                observer.stage(&format!("{name}.{stage}"), value)
            })?;
        outputs.push(last);
        let squares = self.shape.tokens() - 1;
        let outputs = outputs
            .iter()
            .map(|tokens| Ok(tokens.narrow(1, 1, squares)?.contiguous()?))
            .collect::<Result<Vec<Tensor>, ModelError>>()?;
        let variables = rt.variables();
        let whole = outputs.iter().any(Tensor::track_op).then(|| {
            let outputs = outputs.clone();
            tape.record(move |gradient, gradients| {
                let mut loss: Option<Tensor> = None;
                let len = gradient.len() / outputs.len();
                for (output, part) in outputs.iter().zip(gradient.chunks_exact(len)) {
                    let part = Tensor::from_slice(part, output.shape(), &Device::Cpu)?;
                    let term = (output * part)?.sum_all()?;
                    loss = Some(match loss {
                        Some(loss) => (loss + term)?,
                        None => term,
                    });
                }
                let Some(loss) = loss else {
                    return Ok(());
                };
                let found = loss.backward()?;
                for (name, variable) in &variables {
                    if let Some(gradient) = found.get(variable) {
                        let gradient = gradient.flatten_all()?.to_vec1()?;
                        gradients.add_parameter(name, gradient);
                    }
                }
                Ok(())
            })
        });
        let mut maps = outputs
            .iter()
            .enumerate()
            .map(|(k, tokens)| self.cells(tokens, k, outputs.len(), whole.as_ref()))
            .collect::<Result<Vec<_>, _>>()?;
        let last = maps.pop().unwrap_or_default();
        Ok(Features { taps: maps, last })
    }

    /// Output `k` of `outputs`, `[images, side², dim]`, as one map an image.
    fn cells(
        &self,
        tokens: &Tensor,
        k: usize,
        outputs: usize,
        whole: Option<&Node>,
    ) -> Result<Vec<Map>, ModelError> {
        let shape = (self.shape.side, self.shape.side, self.shape.dim);
        let cell = shape.0 * shape.1 * shape.2;
        let values: Vec<f32> = tokens.flatten_all()?.to_vec1()?;
        let total = outputs * values.len();
        let map = |(image, values): (usize, &[f32])| {
            let first = k * (total / outputs) + image * cell;
            let node = whole.map(|whole| {
                let node = whole.clone();
                whole.record(move |gradient, gradients| {
                    gradients.add_part(&node, total, first, &gradient);
                    Ok(())
                })
            });
            Map::Host(HostMap::new(shape, values.to_vec()).at_node(node))
        };
        Ok(values.chunks_exact(cell).enumerate().map(map).collect())
    }
}
