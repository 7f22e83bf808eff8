//! Instruction sets: detected at run time, or forced.

use std::fmt;

/// An instruction set that kernels are written for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Whatever the compiler makes of plain Rust for the target's baseline.
    Portable,
    /// AVX2 with FMA, 8 lanes.
    Avx2,
    /// AVX-512 (F, VL, BW, DQ), 16 lanes.
    Avx512,
}

impl Level {
    /// All levels, slowest first.
    pub const ALL: [Self; 3] = [Self::Portable, Self::Avx2, Self::Avx512];

    /// `portable`, `avx2` or `avx512`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// The inverse of [`Self::name`].
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|level| level.name() == name)
    }
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Proof that this machine has a [`Level`]: kernels take it by value and rely on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Simd(Level);

impl Simd {
    /// The fastest level of this machine.
    pub fn detect() -> Self {
        let best = Level::ALL.into_iter().rev().find_map(Self::new);
        best.unwrap_or(Self(Level::Portable))
    }

    /// That level, if this machine has it.
    pub fn new(level: Level) -> Option<Self> {
        let supported = match level {
            Level::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => {
                Self::new(Level::Avx2).is_some()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Level::Avx2 | Level::Avx512 => false,
        };
        supported.then_some(Self(level))
    }

    /// All levels of this machine, slowest first.
    pub fn available() -> Vec<Self> {
        Level::ALL.into_iter().filter_map(Self::new).collect()
    }

    /// Which level it is.
    pub fn level(self) -> Level {
        self.0
    }
}

/// Defines a function that runs `$body::<FMA>` compiled for the level of its first argument.
///
/// The body must be `#[inline(always)]`, so that it is compiled once per instruction set; its
/// parameter says whether fused multiply-add is an instruction there.
macro_rules! per_level {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($($arg:ident: $ty:ty),* $(,)?) = $body:ident) => {
        $(#[$doc])*
        #[allow(clippy::too_many_arguments, reason = "the inputs of a kernel")]
        $vis fn $name(simd: $crate::simd::Simd, $($arg: $ty),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,fma")]
                #[allow(clippy::too_many_arguments, reason = "the inputs of a kernel")]
                fn avx512($($arg: $ty),*) {
                    $body::<true>($($arg),*)
                }
                #[target_feature(enable = "avx2,fma")]
                #[allow(clippy::too_many_arguments, reason = "the inputs of a kernel")]
                fn avx2($($arg: $ty),*) {
                    $body::<true>($($arg),*)
                }
                match simd.level() {
                    // SAFETY: a `Simd` of this level exists only where the machine has it.
                    $crate::simd::Level::Avx512 => return unsafe { avx512($($arg),*) },
                    // SAFETY: as above.
                    $crate::simd::Level::Avx2 => return unsafe { avx2($($arg),*) },
                    $crate::simd::Level::Portable => {}
                }
            }
            let _ = simd;
            $body::<false>($($arg),*)
        }
    };
}
pub(crate) use per_level;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detection_is_consistent() {
        let available = Simd::available();
        assert_eq!(available[0].level(), Level::Portable);
        assert_eq!(available.last(), Some(&Simd::detect()));
        for level in Level::ALL {
            assert_eq!(Level::from_name(level.name()), Some(level));
        }
    }
}
