//! sharp-kernels
