#![no_main]

libfuzzer_sys::fuzz_target!(|text: &str| mirror_core_fuzz::urdf(text));
