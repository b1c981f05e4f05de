//! The fuzzing engine over [`era_fuzz::decoder`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| era_fuzz::decoder::check_decoder_against_reference(data));
