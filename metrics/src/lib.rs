//! sharp-metrics
