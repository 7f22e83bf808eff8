//! sharp-tests
