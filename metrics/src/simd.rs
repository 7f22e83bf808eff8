//! Element-wise loops compiled for several vector widths.

/// Calls a function, compiled for the process's instruction set. The function may only use `*`,
/// `+`, `-` and `/`, which are never fused, so that every version gives the same bits.
macro_rules! with_widest_vectors {
    ($body:ident($($arg:expr),*) : fn($($name:ident: $type:ty),*)) => {{
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx512f")]
            fn avx512($($name: $type),*) { $body($($name),*) }
            #[target_feature(enable = "avx2")]
            fn avx2($($name: $type),*) { $body($($name),*) }
            match sharp_kernels::Simd::detect().instruction_set() {
                // SAFETY: a `Simd` of this set exists only if the machine supports it.
                sharp_kernels::InstructionSet::Avx512 => unsafe { avx512($($arg),*) },
                // SAFETY: a `Simd` of this set exists only if the machine supports it.
                sharp_kernels::InstructionSet::Avx2 => unsafe { avx2($($arg),*) },
                sharp_kernels::InstructionSet::Portable => $body($($arg),*),
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        $body($($arg),*)
    }};
}
pub(crate) use with_widest_vectors;
