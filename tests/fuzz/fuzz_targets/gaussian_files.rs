#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| sharp_fuzz::run("gaussian_files", bytes));
