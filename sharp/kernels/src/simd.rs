//! Instruction sets: detected at run time, pinned for the process, or forced on one kernel.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

/// An instruction set that kernels are written for. Results are bit-identical within one instruction set, but not
/// across them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum InstructionSet {
    /// Plain Rust, compiled for the target's baseline.
    Portable,
    /// AVX2 with FMA, 8 lanes.
    Avx2,
    /// AVX-512 (F, VL, BW, DQ), 16 lanes.
    Avx512,
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown instruction set '{0}'; known: avx512, avx2, portable")]
pub struct UnknownInstructionSet(String);

impl InstructionSet {
    /// All instruction sets, slowest first.
    pub const ALL: [Self; 3] = [Self::Portable, Self::Avx2, Self::Avx512];

    /// `portable`, `avx2` or `avx512`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for InstructionSet {
    type Err = UnknownInstructionSet;

    fn from_str(name: &str) -> Result<Self, UnknownInstructionSet> {
        let known = Self::ALL.into_iter().find(|set| set.name() == name);
        known.ok_or_else(|| UnknownInstructionSet(name.to_owned()))
    }
}

/// Proof that this machine supports an [`InstructionSet`]: kernels take a `Simd` by value and rely
/// on the support.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Simd(InstructionSet);

/// The instruction set of this process, fixed by the first call of `detect` or `pin`.
static IN_USE: OnceLock<Simd> = OnceLock::new();

/// Reason why a process cannot be pinned to an instruction set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PinError {
    #[error(
        "this machine does not have {wanted}; it has {}",
        Simd::available().iter().map(|simd| simd.0.name()).collect::<Vec<_>>().join(", ")
    )]
    Unsupported { wanted: InstructionSet },
    #[error("kernels cannot be pinned to {wanted}: this process already uses {in_use}")]
    InUse {
        wanted: InstructionSet,
        in_use: InstructionSet,
    },
}

impl Simd {
    /// The pinned instruction set, or else the fastest set of this machine. The result never
    /// changes: after the first call, no other set can be [pinned](Self::pin).
    pub fn detect() -> Self {
        let fastest = || {
            let sets = InstructionSet::ALL.into_iter().rev();
            sets.filter_map(Self::new).next()
        };
        *IN_USE.get_or_init(|| fastest().unwrap_or(Self(InstructionSet::Portable)))
    }

    /// Makes [`detect`](Self::detect) return `wanted` for the rest of the process, so that
    /// different machines compute the same bits. Call it before computing anything.
    ///
    /// # Errors
    /// If the machine does not support the set, or another set is already in use.
    pub fn pin(wanted: InstructionSet) -> Result<Self, PinError> {
        let simd = Self::new(wanted).ok_or(PinError::Unsupported { wanted })?;
        let in_use = IN_USE.get_or_init(|| simd).0;
        if in_use == wanted {
            Ok(simd)
        } else {
            Err(PinError::InUse { wanted, in_use })
        }
    }

    /// Returns the token for `set`, if this machine supports it.
    pub fn new(set: InstructionSet) -> Option<Self> {
        let supported = match set {
            InstructionSet::Portable => true,
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2 => {
                is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
            }
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512 => {
                Self::new(InstructionSet::Avx2).is_some()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
            }
            #[cfg(not(target_arch = "x86_64"))]
            InstructionSet::Avx2 | InstructionSet::Avx512 => false,
        };
        supported.then_some(Self(set))
    }

    /// All sets that this machine supports, slowest first.
    pub fn available() -> Vec<Self> {
        InstructionSet::ALL
            .into_iter()
            .filter_map(Self::new)
            .collect()
    }

    pub fn instruction_set(self) -> InstructionSet {
        self.0
    }
}

/// Defines a function that runs a body compiled for the instruction set given by its first argument.
///
/// `= body` calls `body::<FMA>`, where `FMA` is true if the set has a fused multiply-add; `= avx512, avx2, portable`
/// names a body for each set. Bodies must be `#[inline(always)]`.
#[macro_export]
macro_rules! per_instruction_set {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($($arg:ident: $ty:ty),* $(,)?) = $body:ident) => {
        $crate::per_instruction_set! {
            $(#[$doc])*
            $vis fn $name($($arg: $ty),*) = $body::<true>, $body::<true>, $body::<false>
        }
    };
    (
        $(#[$doc:meta])* $vis:vis fn $name:ident($($arg:ident: $ty:ty),* $(,)?) =
            $avx512:expr, $avx2:expr, $portable:expr
    ) => {
        $(#[$doc])*
        #[allow(clippy::too_many_arguments, reason = "the inputs of a kernel")]
        $vis fn $name(simd: $crate::Simd, $($arg: $ty),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,fma")]
                #[allow(clippy::too_many_arguments, reason = "the inputs of a kernel")]
                fn avx512($($arg: $ty),*) {
                    $avx512($($arg),*)
                }
                #[target_feature(enable = "avx2,fma")]
                #[allow(clippy::too_many_arguments, reason = "the inputs of a kernel")]
                fn avx2($($arg: $ty),*) {
                    $avx2($($arg),*)
                }
                match simd.instruction_set() {
                    // SAFETY: a `Simd` of this set exists only if the machine supports it.
                    $crate::InstructionSet::Avx512 => return unsafe { avx512($($arg),*) },
                    // SAFETY: a `Simd` of this set exists only if the machine supports it.
                    $crate::InstructionSet::Avx2 => return unsafe { avx2($($arg),*) },
                    $crate::InstructionSet::Portable => {}
                }
            }
            let _ = simd;
            $portable($($arg),*)
        }
    };
}
pub(crate) use per_instruction_set;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detection_is_consistent() {
        let available = Simd::available();
        assert_eq!(available[0].instruction_set(), InstructionSet::Portable);
        assert_eq!(available.last(), Some(&Simd::detect()));
        for set in InstructionSet::ALL {
            assert_eq!(set.to_string().parse(), Ok(set));
        }
        assert!("sse9".parse::<InstructionSet>().is_err());
    }

    #[test]
    fn what_is_in_use_stays() {
        let in_use = Simd::detect();
        assert_eq!(Simd::pin(in_use.instruction_set()), Ok(in_use));
        for wanted in InstructionSet::ALL {
            let expected = match Simd::new(wanted) {
                None => Err(PinError::Unsupported { wanted }),
                Some(simd) if simd == in_use => Ok(simd),
                Some(_) => Err(PinError::InUse {
                    wanted,
                    in_use: in_use.instruction_set(),
                }),
            };
            assert_eq!(Simd::pin(wanted), expected);
        }
    }
}
