//! The corpus on the plain toolchain, without an engine: the seeds are what the code says, and every kept input passes.

use era_fuzz::seeds::Seed;
use era_fuzz::step::Step;
use era_fuzz::{decoder, handle_frame, seeds};
use std::path::{Path, PathBuf};
use std::{env, fs};

fn folder(target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target)
}

/// Each seed is in the repository, so that engines that know nothing of this crate can start from it. With
/// `ERA_WRITE_SEEDS=1` they are written instead.
fn seeds_are_kept(target: &str, seeds: Vec<Seed>) {
    for (name, bytes) in seeds {
        let path = folder(target).join(name);
        if env::var_os("ERA_WRITE_SEEDS").is_some() {
            fs::write(&path, &bytes).expect("the corpus can be written");
        }
        let kept = fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert_eq!(kept, bytes, "{} is not what seeds.rs says; ERA_WRITE_SEEDS=1 writes it", path.display());
    }
}

fn every_input(target: &str, run: fn(&[u8])) {
    let mut count = 0;
    for entry in fs::read_dir(folder(target)).expect("a corpus") {
        let path = entry.expect("an entry").path();
        println!("{}", path.display());
        run(&fs::read(&path).expect("an input"));
        count += 1;
    }
    assert!(count > 0, "no inputs");
}

#[test]
fn decoder_seeds_are_kept() {
    seeds_are_kept("decoder", seeds::decoder());
}

#[test]
fn handle_frame_seeds_are_kept() {
    seeds_are_kept("handle_frame", seeds::handle_frame());
}

#[test]
fn decoder_passes_its_corpus() {
    every_input("decoder", decoder::run);
}

#[test]
fn handle_frame_passes_its_corpus() {
    every_input("handle_frame", handle_frame::run);
}

#[test]
fn scripts_are_read_as_they_were_written() {
    for (name, bytes) in seeds::handle_frame() {
        let mut again = Vec::new();
        Step::script(&bytes).iter().for_each(|step| step.write(&mut again));
        assert_eq!(again, bytes, "{name}");
    }
}
