//! The corpus on the plain toolchain, without an engine: the seeds are what the code says, and every kept input passes.

use era_fuzz::seeds::Seed;
use era_fuzz::step::Step;
use era_fuzz::{decoder, handle_frame, seeds};
use std::path::{Path, PathBuf};
use std::{env, fs};

fn build_corpus_path(target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target)
}

/// Each seed is in the repository, so that engines that know nothing of this crate can start from it. With
/// `ERA_WRITE_SEEDS=1` they are written instead.
fn check_or_write_seed_files(target: &str, seeds: Vec<Seed>) {
    for (name, bytes) in seeds {
        let path = build_corpus_path(target).join(name);
        if env::var_os("ERA_WRITE_SEEDS").is_some() {
            fs::write(&path, &bytes).expect("the corpus can be written");
        }
        let kept = fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert_eq!(kept, bytes, "{} is not what seeds.rs says; ERA_WRITE_SEEDS=1 writes it", path.display());
    }
}

fn run_target_on_stored_inputs(target: &str, run: fn(&[u8])) {
    let mut count = 0;
    for entry in fs::read_dir(build_corpus_path(target)).expect("a corpus") {
        let path = entry.expect("an entry").path();
        println!("{}", path.display());
        run(&fs::read(&path).expect("an input"));
        count += 1;
    }
    assert!(count > 0, "no inputs");
}

#[test]
fn decoder_seeds_are_kept() {
    check_or_write_seed_files("decoder", seeds::make_decoder_seeds());
}

#[test]
fn handle_frame_seeds_are_kept() {
    check_or_write_seed_files("handle_frame", seeds::make_handle_frame_seeds());
}

#[test]
fn decoder_passes_its_corpus() {
    run_target_on_stored_inputs("decoder", decoder::check_decoder_against_reference);
}

#[test]
fn handle_frame_passes_its_corpus() {
    run_target_on_stored_inputs("handle_frame", handle_frame::run_script_with_safety_checks);
}

#[test]
fn scripts_are_read_as_they_were_written() {
    for (name, bytes) in seeds::make_handle_frame_seeds() {
        let mut again = Vec::new();
        Step::decode_script(&bytes).iter().for_each(|step| step.append_encoded_step(&mut again));
        assert_eq!(again, bytes, "{name}");
    }
}
