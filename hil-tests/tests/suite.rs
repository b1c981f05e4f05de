//! Every case of the suite on every target that is here. The cases of one target run one after the other, as they share
//! a device; a target that is not here shows as ignored, by name and with the reason. A case whose outputs cannot be
//! observed on a target shows as ignored there, too, after it was run: it has not failed, but nor has it passed.

use hil_tests::bench::Bench;
use hil_tests::cases::{CASES, Case};
use hil_tests::outputs::OutputCheck;
use hil_tests::targets::TargetKind;
use libtest_mimic::{Arguments, Completion, Failed, Trial};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

/// Started by the first case that needs it, kept for the others.
type Shared = Arc<Mutex<Option<Bench>>>;

/// Names of the cases whose outputs were not observed, with the checks that were not made.
type Unobserved = Arc<Mutex<Vec<String>>>;

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let mut trials = Vec::new();
    let mut benches = Vec::new();
    let unobserved = Unobserved::default();
    for kind in TargetKind::ALL {
        let missing = kind.missing_reason();
        if let Some(reason) = &missing {
            println!("skipped: {} ({reason})", kind.name());
        }
        let shared: Shared = Arc::default();
        benches.push(Arc::clone(&shared));
        for case in CASES {
            let name = format!("{}::{}", kind.name(), case.name);
            let lacks = kind.missing_need(case.needs);
            if let (None, Some(reason)) = (&missing, lacks) {
                println!("skipped: {name} ({reason})");
            }
            let shared = Arc::clone(&shared);
            let ignored = missing.is_some() || lacks.is_some();
            let unobserved = Arc::clone(&unobserved);
            let run = move || complete_or_note_unobserved(kind, case, run(kind, &shared, case)?, &unobserved);
            trials.push(Trial::ignorable_test(name, run).with_ignored_flag(ignored));
        }
    }
    let conclusion = libtest_mimic::run(&arguments, trials);
    // Ends the emulator, which would outlive a process that exits.
    for bench in benches {
        bench.lock().unwrap_or_else(PoisonError::into_inner).take();
    }
    let unobserved = unobserved.lock().unwrap_or_else(PoisonError::into_inner);
    for case in unobserved.iter() {
        println!("not observed on this target: {case}");
    }
    if !arguments.list {
        println!("cases not observed on their target, and not counted as passed: {}", unobserved.len());
    }
    if conclusion.has_failed() { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

fn run(kind: TargetKind, shared: &Shared, case: &Case) -> Result<Vec<OutputCheck>, Failed> {
    let mut place = shared.lock().unwrap_or_else(PoisonError::into_inner);
    let bench = match place.take() {
        Some(bench) => bench,
        None => kind.start_target()?,
    };
    let result = case.run_and_list_unobserved_checks(&bench);
    *place = Some(bench);
    Ok(result?)
}

/// A case has passed if all its checks of outputs were observed.
fn complete_or_note_unobserved(
    kind: TargetKind,
    case: &Case,
    checks: Vec<OutputCheck>,
    unobserved: &Unobserved,
) -> Result<Completion, Failed> {
    if checks.is_empty() {
        return Ok(Completion::Completed);
    }
    let names: Vec<&str> = checks.into_iter().map(OutputCheck::name).collect();
    let names = names.join(", ");
    if kind.can_observe_outputs() {
        return Err(format!("{names}: not observed, though this target can be").into());
    }
    let line = format!("{}::{} ({names})", kind.name(), case.name);
    unobserved.lock().unwrap_or_else(PoisonError::into_inner).push(line);
    Ok(Completion::ignored_with(format!("not observed on this target: {names}")))
}
