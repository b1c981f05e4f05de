//! `cargo xtask mutate`: plants mistakes in the board's code, one after the other, and shows which test detects each.
//!
//! A mistake in `shared/` is first shown to the tests of that crate. What they do not detect, and every mistake in `firmware/`, is built into an
//! image and taken through the report of the emulated board, whose expectations come from this program, which has no mistake in it. Several
//! mistakes are judged at a time, each in a copy of the tree of its own.

mod board_checks;
mod list;

use crate::error::{Error, file_error};
use crate::process::capture_output;
use crate::repository_root;
use board_checks::{run_all_board_checks, run_board_checks_until_one_fails};
use list::{Mutation, list_mutations};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;

/// Longest time in s for compiling and running the tests of the shared crate with a mistake in it.
const TEST_LIMIT_S: &str = "400";
/// The first run compiles everything.
const NO_LIMIT: &str = "0";

/// Options of `cargo xtask mutate`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Only mistakes whose name or file contains this
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// Only so many, chosen by the commit, of those that the tests of the shared crate see
    #[arg(long, value_name = "N")]
    some: Option<usize>,
    /// Judge so many mistakes at a time; as many as there are processors without this option
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
}

impl Options {
    /// The mistakes that a run of all tests plants, one at a time, because the tests run beside them.
    pub const fn for_sample_of_shared_crate_mutations(count: usize) -> Self {
        Self { only: None, some: Some(count), jobs: Some(1) }
    }
}

/// What has become of a mistake.
enum MutationOutcome {
    /// These tests or rows of the report fail.
    Detected(Vec<String>),
    /// Nothing fails.
    Survived,
}

/// What tests say of a tree.
enum TreeVerdict {
    Sound,
    /// The code does not compile; the compiler's first error.
    NotCompiled(String),
    /// These tests or rows of the report fail.
    Failed(Vec<String>),
}

/// The folders of one of the threads that judge mistakes.
struct Workbench<'a> {
    /// A copy of the tree, which the mistakes are planted in.
    tree: PathBuf,
    /// Where the copy is built.
    target: PathBuf,
    soundness: &'a Mutex<Soundness>,
}

/// Whether the tests of the shared crate, and the report, pass without a mistake. Each is tried before it judges the first one.
#[derive(Default)]
struct Soundness {
    of_tests: bool,
    of_report: bool,
}

/// Plants the mistakes and prints what detects each.
///
/// # Errors
/// [`Error::Mutations`] with those that nothing detects and those that could not be judged, [`Error::NotSound`] if the tree fails without
/// a mistake, or what kept one from being planted.
pub fn run_mutation_tests(options: &Options) -> Result<(), Error> {
    let root = repository_root()?;
    let chosen = select_matching_mutations_or_commit_sample_of_shared_ones(&root, options)?;
    let (next, unclear, soundness) = (AtomicUsize::new(0), Mutex::new(Vec::new()), Mutex::new(Soundness::default()));
    let judge_mutations = |job: usize| -> Result<(), Error> {
        let folder = root.join(format!("target/mutate/{job}"));
        let bench = Workbench { tree: folder.join("tree"), target: folder.join("target"), soundness: &soundness };
        copy_tracked_files(&root, &bench.tree)?;
        while let Some(mutation) = chosen.get(next.fetch_add(1, Ordering::Relaxed)) {
            let problem = judge_mutation_and_print_what_detects_it(&bench, mutation)
                // The other threads end with their present mistake.
                .inspect_err(|_| next.store(chosen.len(), Ordering::Relaxed))?;
            unclear.lock().unwrap_or_else(PoisonError::into_inner).extend(problem);
        }
        Ok(())
    };
    let jobs = options.jobs.unwrap_or_else(|| thread::available_parallelism().map_or(1, usize::from));
    thread::scope(|scope| {
        let threads: Vec<_> =
            (0..jobs.clamp(1, chosen.len().max(1))).map(|job| scope.spawn(move || judge_mutations(job))).collect();
        let ends =
            threads.into_iter().map(|thread| thread.join().unwrap_or(Err(Error::Mutations("a crash".to_owned()))));
        ends.collect::<Result<(), Error>>()
    })?;
    let unclear = unclear.into_inner().unwrap_or_else(PoisonError::into_inner);
    if unclear.is_empty() { Ok(()) } else { Err(Error::Mutations(unclear.join("; "))) }
}

/// Plants one mistake and prints what detects it; what is wrong with that, if something is.
fn judge_mutation_and_print_what_detects_it(bench: &Workbench, mutation: &Mutation) -> Result<Option<String>, Error> {
    let outcome = match find_what_detects_mutation(bench, mutation) {
        Err(Error::Unjudged(reason)) => Err(reason),
        other => Ok(other?),
    };
    let seen = match &outcome {
        Ok(MutationOutcome::Detected(by)) => by.iter().take(3).cloned().collect::<Vec<_>>().join(", "),
        Ok(MutationOutcome::Survived) => match mutation.unseen_because {
            Some(reason) => format!("nothing, as listed: {reason}"),
            None => "NOTHING".to_owned(),
        },
        Err(reason) => format!("NOT JUDGED: {reason}"),
    };
    println!("{:<58} {}: {seen}", mutation.name, mutation.file);
    Ok(describe_outcome_unless_as_listed(mutation, &outcome))
}

/// What is wrong with an outcome: a mistake that is not detected, not judged, or detected although its list says that it cannot be.
fn describe_outcome_unless_as_listed(mutation: &Mutation, outcome: &Result<MutationOutcome, String>) -> Option<String> {
    match (outcome, mutation.unseen_because) {
        (Err(reason), _) => Some(format!("{} ({reason})", mutation.name)),
        (Ok(MutationOutcome::Survived), None) => Some(mutation.name.to_owned()),
        (Ok(MutationOutcome::Detected(_)), Some(_)) => {
            Some(format!("{} (detected, but listed as a mistake that no test can detect)", mutation.name))
        }
        (Ok(MutationOutcome::Survived), Some(_)) | (Ok(MutationOutcome::Detected(_)), None) => None,
    }
}

fn select_matching_mutations_or_commit_sample_of_shared_ones(
    root: &Path,
    options: &Options,
) -> Result<Vec<&'static Mutation>, Error> {
    let wanted = |mutation: &&Mutation| {
        options.only.as_ref().is_none_or(|only| mutation.name.contains(only) || mutation.file.contains(only))
    };
    let Some(count) = options.some else { return Ok(list_mutations().filter(wanted).collect()) };
    let shared: Vec<&Mutation> = list_mutations().filter(wanted).filter(|it| it.file.starts_with("shared/")).collect();
    let commit = capture_output(Command::new("git").current_dir(root).args(["rev-parse", "HEAD"]))?;
    let start = usize::from_str_radix(commit.trim().get(..8).unwrap_or("0"), 16).unwrap_or(0);
    // A stride that shares no factor with any length below it takes each once.
    Ok((0..count.min(shared.len())).filter_map(|k| shared.get((start + 97 * k) % shared.len()).copied()).collect())
}

/// Copies the files that git tracks, as they are now.
fn copy_tracked_files(root: &Path, tree: &Path) -> Result<(), Error> {
    let listed = capture_output(Command::new("git").current_dir(root).args(["ls-files"]))?;
    for file in listed.lines().filter(|file| root.join(file).is_file()) {
        let to = tree.join(file);
        if let Some(folder) = to.parent() {
            std::fs::create_dir_all(folder).map_err(file_error("cannot make", folder))?;
        }
        let from = root.join(file);
        let content = std::fs::read(&from).map_err(file_error("cannot read", &from))?;
        // What has not changed keeps its time, so that nothing is compiled again for it.
        if std::fs::read(&to).ok().as_ref() != Some(&content) {
            std::fs::write(&to, content).map_err(file_error("cannot write", &to))?;
        }
    }
    Ok(())
}

/// Does `work` while the mistake is in the copy.
fn with_mistake<T>(tree: &Path, mutation: &Mutation, work: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    let path = tree.join(mutation.file);
    let sound = std::fs::read_to_string(&path).map_err(file_error("cannot read", &path))?;
    let wrong = sound.replacen(mutation.from, mutation.to, 1);
    std::fs::write(&path, wrong).map_err(file_error("cannot write", &path))?;
    let result = work();
    std::fs::write(&path, sound).map_err(file_error("cannot write", &path))?;
    result
}

fn find_what_detects_mutation(bench: &Workbench, mutation: &Mutation) -> Result<MutationOutcome, Error> {
    if mutation.file.starts_with("shared/") {
        expect_sound_tests_of_shared_crate(bench)?;
        let verdict =
            with_mistake(&bench.tree, mutation, || run_tests_of_shared_crate_with_time_limit(bench, TEST_LIMIT_S))?;
        let outcome = convert_verdict_to_outcome_failing_if_not_compiled_or_nameless(verdict)?;
        if !matches!(outcome, MutationOutcome::Survived) {
            return Ok(outcome);
        }
    }
    expect_sound_report(bench)?;
    convert_verdict_to_outcome_failing_if_not_compiled_or_nameless(with_mistake(&bench.tree, mutation, || {
        build_image_and_judge(bench, |tree, image| run_board_checks_until_one_fails(tree, image, mutation.first_check))
    })?)
}

/// Runs the tests of the shared crate without a mistake, unless a thread has done that before. Other threads wait meanwhile.
fn expect_sound_tests_of_shared_crate(bench: &Workbench) -> Result<(), Error> {
    let mut sound = bench.soundness.lock().unwrap_or_else(PoisonError::into_inner);
    if !sound.of_tests {
        expect_sound("the tests of shared/", run_tests_of_shared_crate_with_time_limit(bench, NO_LIMIT)?)?;
        sound.of_tests = true;
    }
    Ok(())
}

/// Has the checks of the emulated board judge the image without a mistake, unless a thread has done that before.
fn expect_sound_report(bench: &Workbench) -> Result<(), Error> {
    let mut sound = bench.soundness.lock().unwrap_or_else(PoisonError::into_inner);
    if !sound.of_report {
        expect_sound("the report of the emulated board", build_image_and_judge(bench, run_all_board_checks)?)?;
        sound.of_report = true;
    }
    Ok(())
}

/// A tree that fails by itself would detect everything.
fn expect_sound(what: &'static str, verdict: TreeVerdict) -> Result<(), Error> {
    match verdict {
        TreeVerdict::Sound => Ok(()),
        TreeVerdict::NotCompiled(reason) => Err(Error::NotSound { what, reason }),
        TreeVerdict::Failed(names) => Err(Error::NotSound { what, reason: names.join(", ") }),
    }
}

/// What a verdict on the tree with a mistake means: only what has a name has detected it.
fn convert_verdict_to_outcome_failing_if_not_compiled_or_nameless(
    verdict: TreeVerdict,
) -> Result<MutationOutcome, Error> {
    match verdict {
        TreeVerdict::Sound => Ok(MutationOutcome::Survived),
        TreeVerdict::NotCompiled(reason) => {
            Err(Error::Unjudged(format!("the changed code does not compile: {reason}")))
        }
        TreeVerdict::Failed(names) if names.is_empty() => {
            Err(Error::Unjudged("a run failed, but named no test and no row of the report".to_owned()))
        }
        TreeVerdict::Failed(names) => Ok(MutationOutcome::Detected(names)),
    }
}

fn run_tests_of_shared_crate_with_time_limit(bench: &Workbench, limit_s: &str) -> Result<TreeVerdict, Error> {
    let (works, output) = run_command_and_get_success_and_all_output(
        // A mistake can make a test run for ever. Sound, all of them take seconds once they are compiled.
        Command::new("timeout")
            .current_dir(&bench.tree)
            // A case that failed with one mistake would be tried with all that follow, and may fail without any.
            .env("PROPTEST_DISABLE_FAILURE_PERSISTENCE", "true")
            .args([limit_s, "cargo", "test", "--manifest-path", "shared/Cargo.toml", "--no-fail-fast", "--target-dir"])
            .arg(bench.target.join("shared")),
    )?;
    Ok(if works { TreeVerdict::Sound } else { parse_verdict_of_failed_test_run(&output) })
}

/// What cargo's tests said when they did not succeed.
fn parse_verdict_of_failed_test_run(output: &str) -> TreeVerdict {
    if !output.contains("test result:") {
        return TreeVerdict::NotCompiled(find_first_error_line_or_text_that_none_is_named(output));
    }
    let failed = |line: &str| Some(line.strip_prefix("test ")?.strip_suffix(" ... FAILED")?.to_owned());
    let mut failed: Vec<String> = output.lines().filter_map(failed).collect();
    // Only a run that was ended says nothing of the test that it was in.
    if failed.is_empty() && !output.contains("test failed, to rerun") {
        failed.push(format!("a test that does not end within {TEST_LIMIT_S} s"));
    }
    TreeVerdict::Failed(failed)
}

/// Builds the image of the bench's tree and has `judge` judge it, which gets the tree and the image.
fn build_image_and_judge(
    bench: &Workbench,
    judge: impl FnOnce(&Path, &Path) -> Result<TreeVerdict, Error>,
) -> Result<TreeVerdict, Error> {
    let target = bench.target.join("firmware");
    let (works, output) = run_command_and_get_success_and_all_output(
        Command::new("cargo")
            .current_dir(bench.tree.join("firmware"))
            .args(["build", "--release", "--locked", "--target", "thumbv7em-none-eabihf", "--target-dir"])
            .arg(&target),
    )?;
    if !works {
        return Ok(TreeVerdict::NotCompiled(find_first_error_line_or_text_that_none_is_named(&output)));
    }
    let image: PathBuf = target.join("thumbv7em-none-eabihf/release/era-firmware");
    judge(&bench.tree, &image)
}

/// The first line of `output` that begins with "error", or a text that says that no error is named.
fn find_first_error_line_or_text_that_none_is_named(output: &str) -> String {
    let error = output.lines().map(str::trim).find(|line| line.starts_with("error"));
    error.unwrap_or("no error is named").to_owned()
}

/// Whether a command succeeds, and all that it writes.
fn run_command_and_get_success_and_all_output(command: &mut Command) -> Result<(bool, String), Error> {
    let output =
        command.output().map_err(|source| Error::Start { command: crate::process::format_command(command), source })?;
    let text = [output.stdout, output.stderr].concat();
    Ok((output.status.success(), String::from_utf8_lossy(&text).into_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mistake that cannot be planted any more would count as planted and detected.
    #[test]
    fn every_mistake_has_its_one_place() {
        let root = repository_root().expect("the repository");
        for Mutation { name, file, from, to, .. } in list_mutations() {
            let text = std::fs::read_to_string(root.join(file)).expect("a file of the repository");
            assert_eq!(text.matches(from).count(), 1, "{name}: {file} has not one `{from}`");
            assert_ne!(from, to, "{name}");
        }
    }

    /// A run that ends in an error proves nothing, unless it names a test.
    #[test]
    fn only_a_named_test_detects_a_mistake() {
        let verdict = parse_verdict_of_failed_test_run(
            "test one ... ok\ntest two ... FAILED\ntest result: FAILED. 1 passed; 1 failed",
        );
        let outcome = convert_verdict_to_outcome_failing_if_not_compiled_or_nameless(verdict).expect("it is judged");
        assert!(matches!(outcome, MutationOutcome::Detected(names) if names == ["two"]));
        assert!(matches!(
            convert_verdict_to_outcome_failing_if_not_compiled_or_nameless(TreeVerdict::Sound),
            Ok(MutationOutcome::Survived)
        ));
        let verdict = parse_verdict_of_failed_test_run("error[E0425]: cannot find `x`\nerror: could not compile");
        let Err(Error::Unjudged(reason)) = convert_verdict_to_outcome_failing_if_not_compiled_or_nameless(verdict)
        else {
            panic!("the compiler was not to find it")
        };
        assert!(reason.ends_with("error[E0425]: cannot find `x`"), "{reason}");
        // A report that cannot start, and a test program that crashes.
        assert!(matches!(
            convert_verdict_to_outcome_failing_if_not_compiled_or_nameless(TreeVerdict::Failed(Vec::new())),
            Err(Error::Unjudged(_))
        ));
        let crash = "test result: ok. 3 passed\nerror: test failed, to rerun pass `--test link` (signal: 11)";
        assert!(matches!(
            convert_verdict_to_outcome_failing_if_not_compiled_or_nameless(parse_verdict_of_failed_test_run(crash)),
            Err(Error::Unjudged(_))
        ));
        let Ok(MutationOutcome::Detected(names)) = convert_verdict_to_outcome_failing_if_not_compiled_or_nameless(
            parse_verdict_of_failed_test_run("test result: ok. 3 passed"),
        ) else {
            panic!("a run that was ended by its time limit is detected")
        };
        assert!(names[0].contains("does not end"), "{names:?}");
    }

    /// A reason why a mistake is not seen excuses that mistake only, and only as long as it is not seen.
    #[test]
    fn only_listed_mistakes_may_survive() {
        let listed = list_mutations().find(|it| it.unseen_because.is_some()).expect("a mistake with a reason");
        let other = list_mutations().find(|it| it.unseen_because.is_none()).expect("a mistake without one");
        let [survived, detected] = [Ok(MutationOutcome::Survived), Ok(MutationOutcome::Detected(vec!["a".to_owned()]))];
        assert_eq!(describe_outcome_unless_as_listed(listed, &survived), None);
        assert_eq!(describe_outcome_unless_as_listed(other, &detected), None);
        assert_eq!(describe_outcome_unless_as_listed(other, &survived).as_deref(), Some(other.name));
        assert!(describe_outcome_unless_as_listed(listed, &detected).is_some());
        assert!(describe_outcome_unless_as_listed(listed, &Err("it does not compile".to_owned())).is_some());
    }

    #[test]
    fn a_tree_that_fails_by_itself_judges_nothing() {
        assert!(expect_sound("tests", TreeVerdict::Sound).is_ok());
        for verdict in [TreeVerdict::Failed(vec!["two".to_owned()]), TreeVerdict::NotCompiled("error".to_owned())] {
            assert!(matches!(expect_sound("tests", verdict), Err(Error::NotSound { .. })));
        }
    }
}
