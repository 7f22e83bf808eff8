//! sharp-bench
