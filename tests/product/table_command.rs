//! `table` as a user runs it.
