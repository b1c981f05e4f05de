//! `cargo xtask fuzz`: libFuzzer over the targets of `fuzz`, on the project's own toolchain.
//!
//! `cargo fuzz` would want a nightly compiler for its sanitizer of memory errors, which this code, without `unsafe`,
//! cannot have. The coverage that guides the engine comes from an LLVM pass that stable compilers carry too, so this
//! command builds the same targets with the flags of `cargo fuzz --sanitizer none`, and every machine has one engine.

use crate::error::Error;
use crate::process::{capture_output, format_command, run_command};
use crate::repository_root;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Instant;

/// The targets, and the longest input that tells more than a shorter one, in bytes.
const TARGETS: [(&str, usize); 2] = [
    // Several frames of the longest kind, and what is between them.
    ("decoder", 2_048),
    // A session of about a hundred commands.
    ("handle_frame", 4_096),
];

/// Flags of `cargo fuzz --sanitizer none`: counters at every edge of the control flow and at comparisons guide the
/// engine, and arithmetic is checked.
const FLAGS: &str = "--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=1 -Cdebug-assertions -Coverflow-checks";

/// Memory that one engine may take, in MiB; it needs about 30, the rest is for the corpus.
const MEMORY_LIMIT_MIB: u32 = 1_024;

/// How long one input may take in s: the longest that are allowed take milliseconds. libFuzzer itself would wait for 20 minutes.
const LONGEST_INPUT_S: u32 = 20;

/// Options of `cargo xtask fuzz`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// How long to look, in s; the targets run side by side.
    #[arg(long, default_value_t = 60)]
    seconds: u64,
    /// Only this target: decoder or handle_frame.
    #[arg(long, value_parser = TARGETS.map(|(name, _)| name))]
    target: Option<String>,
    /// Run one kept input instead, to see what it does; needs --target.
    #[arg(long, value_name = "FILE", requires = "target")]
    input: Option<PathBuf>,
}

impl Options {
    /// All targets for `seconds`.
    pub fn for_seconds(seconds: u64) -> Self {
        Self { seconds, target: None, input: None }
    }
}

/// Builds the targets and looks for inputs that make one panic.
///
/// # Errors
/// [`Error::Found`] if there is one; what went wrong in building or starting.
pub fn run_fuzzing(options: &Options) -> Result<(), Error> {
    let root = repository_root()?;
    let programs = build_fuzz_targets(&root)?;
    if let (Some(target), Some(input)) = (&options.target, &options.input) {
        return run_command(Command::new(programs.join(target)).arg(input).env("RUST_BACKTRACE", "0"));
    }
    let wanted = |name: &str| options.target.as_ref().is_none_or(|target| target == name);
    let started = Instant::now();
    let runs = TARGETS
        .into_iter()
        .filter(|(name, _)| wanted(name))
        .map(|(name, longest)| FuzzRun::start(&root, &programs, name, longest, options.seconds))
        .collect::<Result<Vec<_>, _>>()?;
    println!("fuzz: libFuzzer guided by coverage, {} s, logs in {}", options.seconds, scratch_folder(&root).display());
    // All are waited for before any is judged, so that none is left running.
    let ended = runs.into_iter().map(FuzzRun::wait_for_result).collect::<Result<Vec<_>, _>>()?;
    for end in &ended {
        println!("fuzz: {:<12} {:>9} inputs tried, {} edges covered", end.name, end.tried, end.covered);
    }
    println!("fuzz: {:.0} s", started.elapsed().as_secs_f64());
    match ended.into_iter().find(|end| !end.status.success()) {
        None => Ok(()),
        Some(FuzzResult { name, log, said, .. }) => Err(Error::Found { target: name, said, log }),
    }
}

/// Where builds, logs and found-along-the-way inputs go.
fn scratch_folder(root: &Path) -> PathBuf {
    root.join("target/fuzz")
}

/// Builds all targets and returns the folder that they are in.
fn build_fuzz_targets(root: &Path) -> Result<PathBuf, Error> {
    let verbose = capture_output(Command::new("rustc").arg("-vV").current_dir(root))?;
    let host = verbose.lines().find_map(|line| line.strip_prefix("host: ")).unwrap_or_default().to_owned();
    let folder = scratch_folder(root);
    run_command(
        Command::new("cargo")
            .current_dir(root)
            // With a target named, the flags are not those of build scripts.
            .args(["build", "--quiet", "--release", "--locked", "-p", "era-fuzz", "--features", "libfuzzer", "--bins"])
            .args(["--target", &host])
            .env("RUSTFLAGS", FLAGS)
            .env("CARGO_TARGET_DIR", &folder),
    )?;
    Ok(folder.join(host).join("release"))
}

/// A running engine.
struct FuzzRun {
    name: &'static str,
    child: Child,
    log: PathBuf,
}

/// How an engine ended.
struct FuzzResult {
    name: &'static str,
    status: ExitStatus,
    log: PathBuf,
    tried: String,
    covered: String,
    /// The panic, and where the input was kept.
    said: String,
}

impl FuzzRun {
    fn start(
        root: &Path,
        program_folder: &Path,
        target: &'static str,
        longest_input_bytes: usize,
        seconds: u64,
    ) -> Result<Self, Error> {
        let grown = scratch_folder(root).join("corpus").join(target);
        let kept = root.join("tools/fuzz/corpus").join(target);
        let found = root.join("tools/fuzz/artifacts").join(target);
        let log = scratch_folder(root).join(format!("{target}.log"));
        for path in [&grown, &found] {
            fs::create_dir_all(path).map_err(|source| Error::File {
                what: "cannot make",
                path: path.clone(),
                source,
            })?;
        }
        let file =
            File::create(&log).map_err(|source| Error::File { what: "cannot write", path: log.clone(), source })?;
        let mut engine = Command::new(program_folder.join(target));
        engine
            // What it finds interesting goes into the first folder; the second is only read.
            .args([&grown, &kept])
            .arg(format!("-max_total_time={seconds}"))
            .arg(format!("-max_len={longest_input_bytes}"))
            .arg(format!("-rss_limit_mb={MEMORY_LIMIT_MIB}"))
            .arg(format!("-timeout={LONGEST_INPUT_S}"))
            .arg(format!("-artifact_prefix={}/", found.display()))
            .arg("-print_final_stats=1")
            .env("RUST_BACKTRACE", "0")
            .stdout(Stdio::null())
            .stderr(file);
        let child = engine.spawn().map_err(|source| Error::Start { command: format_command(&engine), source })?;
        Ok(Self { name: target, child, log })
    }

    fn wait_for_result(mut self) -> Result<FuzzResult, Error> {
        let status = self.child.wait().map_err(|source| Error::Start { command: self.name.to_owned(), source })?;
        let bytes = fs::read(&self.log).map_err(|source| Error::File {
            what: "cannot read",
            path: self.log.clone(),
            source,
        })?;
        let text = String::from_utf8_lossy(&bytes);
        let last_after = |mark: &str| {
            let found = text.lines().rev().find_map(|line| line.split_once(mark));
            found.and_then(|(_, rest)| rest.split_whitespace().next()).unwrap_or("?").to_owned()
        };
        // From the first word of trouble on; an engine that is cut short in another way says why in its last lines.
        let trouble = text.lines().skip_while(|line| !line.contains("panicked at") && !line.contains("ERROR: "));
        let said = trouble.filter(|line| !line.is_empty()).take(8);
        let kept = text.lines().filter(|line| line.contains("Test unit written to"));
        Ok(FuzzResult {
            name: self.name,
            status,
            tried: last_after("stat::number_of_executed_units:"),
            covered: last_after(" cov: "),
            said: said.chain(kept).collect::<Vec<_>>().join("\n  "),
            log: self.log,
        })
    }
}
