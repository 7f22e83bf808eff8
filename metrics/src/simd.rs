//! Element-wise loops compiled for several vector widths.

/// Runs a function compiled for the widest vectors that the processor has. Only `*`, `+`, `-`, `/`
/// are used and never fused, so every version gives the same bits.
macro_rules! with_widest_vectors {
    ($body:ident($($arg:expr),*) : fn($($name:ident: $type:ty),*)) => {{
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx512f")]
            fn avx512($($name: $type),*) { $body($($name),*) }
            #[target_feature(enable = "avx2")]
            fn avx2($($name: $type),*) { $body($($name),*) }
            if is_x86_feature_detected!("avx512f") {
                // SAFETY: the processor was just found to have AVX-512F.
                unsafe { avx512($($arg),*) }
            } else if is_x86_feature_detected!("avx2") {
                // SAFETY: the processor was just found to have AVX2.
                unsafe { avx2($($arg),*) }
            } else {
                $body($($arg),*)
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        $body($($arg),*)
    }};
}
pub(crate) use with_widest_vectors;
