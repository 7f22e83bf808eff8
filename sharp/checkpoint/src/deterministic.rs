//! Weights as a pure function of tensor names, so that implementations can be compared without a checkpoint.
//!
//! Element `i` (C order of PyTorch's layout) of a tensor depends on `splitmix64(h + i)`, where
//! `h` is the FNV-1a hash of `salt + name`. Two rules turn the 24 upper bits into a value:
//! [`model_weights`] for the SHARP network, [`backbone_weights`] for the metrics' backbones.
//! Bit-exact on every machine.

/// FNV-1a, 64 bits, of several strings joined.
pub fn fnv1a64(parts: &[&str]) -> u64 {
    parts
        .iter()
        .flat_map(|part| part.bytes())
        .fold(0xcbf2_9ce4_8422_2325, |h, byte| {
            (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        })
}

/// The splitmix64 generator's output for state `s`.
pub fn splitmix64(s: u64) -> u64 {
    let z = s.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Weights of the SHARP network for the tensor `name` with `shape`; `salt` selects one of several sets.
///
/// Offset and scale depend on the name and the number of axes. They are chosen so that activations stay of order one
/// through the whole network: norms near 1, LayerScale near 0.3, biases within 0.05, matrices and filters uniform with
/// unit gain.
pub fn model_weights(salt: &str, name: &str, shape: &[usize]) -> Vec<f32> {
    let (offset, scale) = model_rule(name, shape);
    let (offset, scale) = (offset as f32, scale as f32);
    let h = fnv1a64(&[salt, name]);
    let numel: usize = shape.iter().product();
    (0..numel as u64)
        .map(|i| {
            let k = (splitmix64(h.wrapping_add(i)) >> 40) as i32;
            let centred = (k - (1 << 23)) as f32 / (1 << 23) as f32;
            // Rounds twice: a fused multiply-add would give different bits.
            let scaled = centred * scale;
            scaled + offset
        })
        .collect()
}

/// Offset and scale for a tensor of the network.
fn model_rule(name: &str, shape: &[usize]) -> (f64, f64) {
    let gain = |fan_in: usize| (3.0 / fan_in as f64).sqrt();
    let second = shape.get(1).copied().unwrap_or(1);
    match shape.len() {
        _ if name.ends_with("monodepth_predictor.head.4.bias") => (2.0, 0.25),
        _ if name.ends_with("monodepth_predictor.head.4.weight") => (0.0, 0.15 * gain(second)),
        _ if name.ends_with("geometry_prediction_head.weight") => (0.0, 8.0 * gain(second)),
        _ if name.ends_with("texture_prediction_head.weight") => (0.0, 0.3 * gain(second)),
        _ if name.ends_with(".gamma") => (0.3, 0.1),
        1 if name.ends_with(".weight") => (1.0, 0.1),
        1 => (0.0, 0.05),
        3 => (0.0, 0.5),
        4 => {
            // All 2x2 filters belong to transposed convolutions, except in the image encoder's
            // input layer.
            let transposed = shape[2..] == [2, 2] && !name.ends_with("image_encoder.conv.weight");
            let fan_in = if transposed {
                shape[0]
            } else {
                shape[1..].iter().product()
            };
            (0.0, gain(fan_in))
        }
        _ => (0.0, gain(second)),
    }
}

/// Weights of a metric's backbone. `name` is `<arch>.features.<key>` with torchvision's keys, for example
/// `vgg16.features.28.bias`.
///
/// Filters are uniform with the gain of a ReLU network, biases within 0.05.
pub fn backbone_weights(salt: &str, name: &str, shape: &[usize]) -> Vec<f32> {
    let scale = if shape.len() >= 2 {
        let fan_in: usize = shape[1..].iter().product();
        (6.0 / fan_in as f64).sqrt()
    } else {
        0.05
    };
    let h = fnv1a64(&[salt, name]);
    let numel: usize = shape.iter().product();
    (0..numel as u64)
        .map(|i| {
            let u = (splitmix64(h.wrapping_add(i)) >> 40) as f64 / (1 << 24) as f64;
            (scale * (2.0 * u - 1.0)) as f32
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integer_functions_match_the_published_values() {
        assert_eq!(fnv1a64(&[]), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv1a64(&["a"]), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(fnv1a64(&["foo", "bar"]), 0x8594_4171_f739_67e8);
        assert_eq!(splitmix64(0), 0xe220_a839_7b1d_cdaf);
        assert_eq!(splitmix64(u64::MAX), 0xe4d9_7177_1b65_2c20);
    }

    #[test]
    fn the_salt_changes_every_value() {
        let plain = backbone_weights("", "vgg16.features.0.bias", &[64]);
        let salted = backbone_weights("x", "vgg16.features.0.bias", &[64]);
        assert!(plain.iter().zip(&salted).all(|(a, b)| a != b));
        assert!(plain.iter().all(|v| v.abs() <= 0.05));
    }
}
