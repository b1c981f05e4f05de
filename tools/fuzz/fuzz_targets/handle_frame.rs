//! The fuzzing engine over [`era_fuzz::handle_frame`].
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| era_fuzz::handle_frame::run_script_with_safety_checks(data));
