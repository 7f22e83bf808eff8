//! The key of a unit: a hash of everything that its value depends on.

use sharp_metrics::{InstructionSet, Simd};

use crate::durable::sha256_hex;

/// sha256 over the crates' sources and the locked dependencies, taken when the harness was built. Two builds of
/// one version that differ in code never share results.
pub const SOURCE_FINGERPRINT: &str = env!("SHARP_BENCH_SOURCE_FINGERPRINT");

/// Identifies a unit's result: equal keys mean equal values.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct UnitKey(String);

impl UnitKey {
    /// Hashes named facts. The order is part of the key; names and values are length-prefixed, so that
    /// no two different lists give the same bytes.
    pub fn new(facts: &[(&str, &str)]) -> Self {
        let mut text = Vec::new();
        for (name, value) in facts {
            for part in [name, value] {
                text.extend_from_slice(&(part.len() as u64).to_le_bytes());
                text.extend_from_slice(part.as_bytes());
            }
        }
        Self(sha256_hex(&text))
    }

    /// 64 hexadecimal digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// The instruction set of the metrics' and the network's kernels, part of a unit's key: results are
/// bit-identical within one, not across.
pub fn cpu_backend() -> &'static str {
    match Simd::detect().instruction_set() {
        InstructionSet::Avx512 => "cpu-avx512",
        InstructionSet::Avx2 => "cpu-avx2",
        InstructionSet::Portable => "cpu-portable",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_differ_when_a_boundary_moves() {
        let a = UnitKey::new(&[("a", "bc")]);
        let b = UnitKey::new(&[("ab", "c")]);
        assert_ne!(a, b);
        assert_eq!(a, UnitKey::new(&[("a", "bc")]));
        assert_eq!(a.as_str().len(), 64);
    }
}
