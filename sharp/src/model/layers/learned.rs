//! Gradients of a layer's parameters.

use sharp_kernels::NormGradient;
use sharp_kernels::conv::backward::bias_gradient;

use crate::model::engine::Runtime;
use crate::model::params::Parameter;
use crate::model::tape::Gradients;

/// Parameters of a layer that need gradients.
pub(in crate::model) struct Learned {
    pub(in crate::model) weight: Option<String>,
    pub(in crate::model) bias: Option<String>,
}

impl Learned {
    pub(in crate::model) fn of(rt: &Runtime, weight: &Parameter, bias: Option<&Parameter>) -> Self {
        let wanted = |parameter: &Parameter| {
            let tape = rt.tape.as_ref()?;
            tape.trains(&parameter.name).then(|| parameter.name.clone())
        };
        Self {
            weight: wanted(weight),
            bias: bias.and_then(wanted),
        }
    }

    pub(in crate::model) fn any(&self) -> bool {
        self.weight.is_some() || self.bias.is_some()
    }

    /// Adds what the gradient `g` of an output with so many channels means.
    pub(in crate::model) fn add(
        &self,
        gradients: &mut Gradients,
        channels: usize,
        g: &[f32],
        weight: impl FnOnce() -> Vec<f32>,
    ) {
        if let Some(name) = &self.weight {
            gradients.add_parameter(name, weight());
        }
        if let Some(name) = &self.bias {
            gradients.add_parameter(name, bias_gradient(g, channels));
        }
    }

    /// Adds the gradients of a normalisation's scales and shifts; that of its input is given back.
    pub(in crate::model) fn add_norm(
        &self,
        gradients: &mut Gradients,
        back: NormGradient,
    ) -> Vec<f32> {
        if let Some(name) = &self.weight {
            gradients.add_parameter(name, back.gamma);
        }
        if let Some(name) = &self.bias {
            gradients.add_parameter(name, back.beta);
        }
        back.input
    }
}
