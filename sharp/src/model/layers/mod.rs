//! Layers of feature maps, on either engine, and their way back in training.

mod conv;
mod deconv;
mod group_norm;
mod learned;
#[cfg(test)]
mod tests;

pub(super) use conv::{Conv, Fused};
pub(super) use deconv::Deconv;
pub(super) use group_norm::GroupNormLayer;
pub(super) use learned::Learned;
