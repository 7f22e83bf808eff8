//! The transformer in training: the kernels of [`host`](super::host) one by one, each with its way back.
//!
//! Tokens are a map: a row an image, a pixel a token.

use std::sync::Arc;

use sharp_kernels::activation::{gelu, gelu_gradient};
use sharp_kernels::conv::backward::bias_gradient;
use sharp_kernels::{
    AttentionShape, Simd, Workspace, attention, attention_gradient, layer_norm, layer_norm_gradient,
};

use super::{Features, Vit, VitBlock, WeightBias};
use crate::model::ModelError;
use crate::model::engine::Runtime;
use crate::model::layers::{Conv, Fused, Learned};
use crate::model::map::{HostMap, Map};
use crate::model::params::Parameter;
use crate::model::tape::{Gradients, Node, Tape};

/// One pass on a tape.
struct Pass<'a> {
    rt: &'a Runtime,
    tape: &'a Arc<Tape>,
    simd: Simd,
}

impl Vit {
    /// As [`Vit::forward`], unobserved.
    pub(super) fn on_tape(
        &self,
        rt: &Runtime,
        tape: &Arc<Tape>,
        simd: Simd,
        images: &[f32],
        taps: &[usize],
    ) -> Result<Features, ModelError> {
        let pass = &Pass { rt, tape, simd };
        let mut x = self.tokens_on_tape(pass, images)?;
        let mut tapped = Vec::with_capacity(taps.len());
        for (k, block) in self.blocks.iter().enumerate() {
            x = block.on_tape(pass, x, self.shape.heads, self.shape.norm_eps)?;
            if taps.contains(&k) {
                tapped.push(self.maps_on_tape(&x));
            }
        }
        let last = pass.norm(&self.norm, &x, self.shape.norm_eps)?;
        Ok(Features {
            taps: tapped,
            last: self.maps_on_tape(&last),
        })
    }

    /// Embedded squares behind a class token, positions added.
    fn tokens_on_tape(&self, pass: &Pass<'_>, images: &[f32]) -> Result<HostMap, ModelError> {
        let (tokens, dim) = (self.shape.tokens(), self.shape.dim);
        let square = self.shape.square();
        let rows = self.squares(images);
        let count = rows.len() / (square * (tokens - 1));
        let squares = HostMap::new((count, tokens - 1, square), rows);
        let embed = WeightBias {
            weight: Parameter {
                // A square's pixels are the channels of a linear layer.
                shape: vec![dim, square],
                ..self.patch_embed.weight.clone()
            },
            bias: self.patch_embed.bias.clone(),
        };
        let embedded = pass.linear(&embed, squares)?;
        let x = self.with_positions(pass.rt, &embedded.data)?;
        let learned = Learned::of(pass.rt, &self.cls_token, Some(&self.pos_embed));
        let node = (learned.any() || embedded.node.is_some()).then(|| {
            pass.tape.record(move |g, gradients| {
                let image = tokens * dim;
                let first = |g: &[f32]| -> Vec<f32> {
                    let class = g.chunks_exact(image).flat_map(|g| &g[..dim]);
                    class.copied().collect()
                };
                if let Some(name) = &learned.weight {
                    gradients.add_parameter(name, bias_gradient(&first(&g), dim));
                }
                if let Some(name) = &learned.bias {
                    gradients.add_parameter(name, bias_gradient(&g, image));
                }
                let rest = g.chunks_exact(image).flat_map(|g| &g[dim..]);
                gradients.add(embedded.node.as_ref(), rest.copied().collect());
                Ok(())
            })
        });
        Ok(HostMap::new((count, tokens, dim), x).at_node(node))
    }

    /// Tokens as one map an image, the class token dropped.
    fn maps_on_tape(&self, x: &HostMap) -> Vec<Map> {
        let (image, dim, side) = (x.width * x.channels, x.channels, self.shape.side);
        let total = x.data.len();
        let map = |(k, values): (usize, &[f32])| {
            let node = x.node.as_ref().map(|whole| {
                let node = whole.clone();
                whole.record(move |g, gradients| {
                    gradients.add_part(&node, total, k * image + dim, &g);
                    Ok(())
                })
            });
            Map::Host(HostMap::new((side, side, dim), values[dim..].to_vec()).at_node(node))
        };
        x.data.chunks_exact(image).enumerate().map(map).collect()
    }
}

impl VitBlock {
    fn on_tape(
        &self,
        pass: &Pass<'_>,
        x: HostMap,
        heads: usize,
        eps: f32,
    ) -> Result<HostMap, ModelError> {
        let normal = pass.norm(&self.norm1, &x, eps)?;
        let qkv = pass.linear(&self.qkv, normal)?;
        let attended = pass.attention(&qkv, heads);
        let attended = pass.linear(&self.proj, attended)?;
        let x = sum(x, pass.layer_scale(&self.ls1, &attended)?)?;
        let normal = pass.norm(&self.norm2, &x, eps)?;
        let hidden = pass.linear(&self.fc1, normal)?;
        let hidden = pass.linear(&self.fc2, pass.gelu(&hidden))?;
        sum(x, pass.layer_scale(&self.ls2, &hidden)?)
    }
}

fn sum(a: HostMap, b: HostMap) -> Result<HostMap, ModelError> {
    host(Map::Host(a).add(&Map::Host(b))?)
}

fn host(map: Map) -> Result<HostMap, ModelError> {
    match map {
        Map::Host(map) => Ok(map),
        Map::Tensor(_) => Err(crate::model::map::mixed()),
    }
}

fn shape_of(x: &HostMap) -> (usize, usize, usize) {
    (x.height, x.width, x.channels)
}

impl Pass<'_> {
    fn linear(&self, affine: &WeightBias, x: HostMap) -> Result<HostMap, ModelError> {
        let layer = Conv::linear(&affine.weight, &affine.bias);
        host(layer.forward(self.rt, &Map::Host(x), Fused::default())?)
    }

    /// A node for what was made of `x` and perhaps of parameters.
    fn recorded(
        &self,
        x: &HostMap,
        learned: bool,
        backward: impl FnOnce(Vec<f32>, &mut Gradients) -> Result<(), ModelError> + Send + 'static,
    ) -> Option<Node> {
        (learned || x.node.is_some()).then(|| self.tape.record(backward))
    }

    fn norm(&self, affine: &WeightBias, x: &HostMap, eps: f32) -> Result<HostMap, ModelError> {
        let gamma = self.rt.values(&affine.weight)?;
        let beta = self.rt.values(&affine.bias)?;
        let mut out = vec![0.0; x.data.len()];
        layer_norm(self.simd, &x.data, &gamma, &beta, eps, &mut out);
        let learned = Learned::of(self.rt, &affine.weight, Some(&affine.bias));
        let (data, node) = (Arc::clone(&x.data), x.node.clone());
        let node = self.recorded(x, learned.any(), move |g, gradients| {
            let back = layer_norm_gradient(&data, &gamma, eps, &g);
            let of_input = learned.add_norm(gradients, back);
            gradients.add(node.as_ref(), of_input);
            Ok(())
        });
        Ok(HostMap::new(shape_of(x), out).at_node(node))
    }

    /// From queries, keys and values side by side.
    fn attention(&self, qkv: &HostMap, heads: usize) -> HostMap {
        let dim = qkv.channels / 3;
        let shape = AttentionShape {
            batch: qkv.height,
            tokens: qkv.width,
            heads,
            head_dim: dim / heads,
        };
        let scale = 1.0 / (shape.head_dim as f32).sqrt();
        let mut out = vec![0.0; qkv.data.len() / 3];
        let workspace = |w: &mut Workspace| {
            attention(self.simd, &qkv.data, &mut out, shape, scale, w);
        };
        self.rt.with_workspace(workspace);
        let (data, node) = (Arc::clone(&qkv.data), qkv.node.clone());
        let node = self.recorded(qkv, false, move |g, gradients| {
            gradients.add(node.as_ref(), attention_gradient(&data, &g, shape, scale));
            Ok(())
        });
        HostMap::new((qkv.height, qkv.width, dim), out).at_node(node)
    }

    fn gelu(&self, x: &HostMap) -> HostMap {
        let simd = self.simd;
        let (data, node) = (Arc::clone(&x.data), x.node.clone());
        let node = self.recorded(x, false, move |g, gradients| {
            gradients.add(node.as_ref(), gelu_gradient(simd, &data, &g));
            Ok(())
        });
        HostMap::new(shape_of(x), gelu(simd, &x.data)).at_node(node)
    }

    /// Channels times learned factors.
    fn layer_scale(&self, gamma: &Parameter, x: &HostMap) -> Result<HostMap, ModelError> {
        let factors = self.rt.values(gamma)?;
        let times = |x: &[f32], factors: &[f32]| -> Vec<f32> {
            let rows = x.chunks_exact(factors.len());
            rows.flat_map(|row| row.iter().zip(factors).map(|(x, f)| x * f))
                .collect()
        };
        let out = times(&x.data, &factors);
        let learned = Learned::of(self.rt, gamma, None);
        let (data, node) = (Arc::clone(&x.data), x.node.clone());
        let node = self.recorded(x, learned.any(), move |g, gradients| {
            if let Some(name) = &learned.weight {
                let products: Vec<f32> = g.iter().zip(data.iter()).map(|(g, x)| g * x).collect();
                gradients.add_parameter(name, bias_gradient(&products, factors.len()));
            }
            gradients.add(node.as_ref(), times(&g, &factors));
            Ok(())
        });
        Ok(HostMap::new(shape_of(x), out).at_node(node))
    }
}
