//! Every case of the suite on every target that is here. The cases of one target run one after the other, as they share
//! a device; a target that is not here shows as ignored, by name and with the reason.

use hil_tests::bench::Bench;
use hil_tests::cases::{CASES, Case};
use hil_tests::targets::TargetKind;
use libtest_mimic::{Arguments, Failed, Trial};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

/// Started by the first case that needs it, kept for the others.
type Shared = Arc<Mutex<Option<Bench>>>;

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let mut trials = Vec::new();
    let mut benches = Vec::new();
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
            trials.push(Trial::test(name, move || run(kind, &shared, case)).with_ignored_flag(ignored));
        }
    }
    let conclusion = libtest_mimic::run(&arguments, trials);
    // Ends the emulator, which would outlive a process that exits.
    for bench in benches {
        bench.lock().unwrap_or_else(PoisonError::into_inner).take();
    }
    if conclusion.has_failed() { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

fn run(kind: TargetKind, shared: &Shared, case: &Case) -> Result<(), Failed> {
    let mut place = shared.lock().unwrap_or_else(PoisonError::into_inner);
    let bench = match place.take() {
        Some(bench) => bench,
        None => kind.start_target()?,
    };
    let result = (case.run)(&bench);
    *place = Some(bench);
    Ok(result?)
}
