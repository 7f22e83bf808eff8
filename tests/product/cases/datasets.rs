//! Cases of datasets.
