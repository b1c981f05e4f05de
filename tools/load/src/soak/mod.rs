//! Many clients for a long time, with faults or without.

mod clients;
mod faults;
mod growth;
#[cfg(test)]
mod judge_tests;
mod ledger;
mod report;
mod slow;
mod tally;
mod world;

use crate::board::Bench;
use crate::daemon::{Daemon, DaemonSetup, MemoryThreadsAndHandles};
use crate::error::Error;
use clap::Args;
use fastrand::Rng;
use faults::Faults;
use ledger::FaultLedger;
use report::Report;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tally::Tally;
use world::SoakState;

/// Clients over TCP, ...
const TCP_CLIENTS: usize = 4;
/// ... over the socket in the file system, ...
const SOCKET_CLIENTS: usize = 1;
/// ... and with a live socket.
const LIVE_CLIENTS: usize = 3;
/// Time for a daemon to come to rest before it is looked at what it takes: threads of its pools and memory grow until then.
const WARM: Duration = Duration::from_secs(5);
/// Time for connections to be forgotten after the last client.
const REST: Duration = Duration::from_secs(1);
/// Between two lines about how far it is.
const TELL: Duration = Duration::from_secs(10);

/// For how long, and with what.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// How long, in minutes; with faults, the last round of them is ended
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = crate::parse_number_within_0_001_to_100000)]
    minutes: f64,
    /// Inject faults
    #[arg(long)]
    faults: bool,
    /// Seed of all random choices
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// The program to start
    #[arg(long, value_name = "FILE", default_value = "target/release/era")]
    program: PathBuf,
}

/// Runs it and prints the table.
///
/// # Errors
/// [`Error::NotStood`] if something was lost, missed, told late, ever growing or unsafe, and what keeps the run from going on.
pub fn run_soak(options: &Options) -> Result<(), Error> {
    let folder = tempfile::tempdir().map_err(Error::system_error("no folder for sockets"))?;
    let bench = Bench::new(folder.path().join("board"))?;
    let plan = DaemonSetup {
        program: options.program.clone(),
        device: folder.path().join("board"),
        socket: folder.path().join("era.sock"),
        cache: folder.path().join("cache"),
        clears_silence: options.faults,
    };
    let daemon = Daemon::start(&plan)?;
    daemon.await_device()?;
    let world = Arc::new(SoakState::default());
    world.set_serving_daemon_incrementing_generation(daemon.address);
    let mut random = Rng::with_seed(options.seed);
    let socket = plan.socket.clone();
    let mut faults = Faults {
        world: &world,
        bench,
        plan,
        daemon,
        ledger: FaultLedger::default(),
        random: random.fork(),
        outages: 0,
        faults: 0,
        before_kill: None,
    };
    eprintln!("{} serves on {}", options.program.display(), faults.daemon.address);
    let begun = Instant::now();
    let mut threads = Vec::new();
    for client in 0..TCP_CLIENTS + SOCKET_CLIENTS {
        let (world, random) = (Arc::clone(&world), random.fork());
        let socket = (client >= TCP_CLIENTS).then(|| socket.clone());
        threads.push(std::thread::spawn(move || clients::run_http_client(&world, socket.as_deref(), client, random)));
    }
    for client in 0..LIVE_CLIENTS {
        let (world, random) = (Arc::clone(&world), random.fork());
        threads.push(std::thread::spawn(move || clients::run_live_client(&world, client, random)));
    }
    std::thread::sleep(WARM);
    let at_start = faults.daemon.read_memory_threads_and_handles_or_zeros();
    let result = run_until_end_with_faults_if_enabled_failing_if_daemon_ends(options, begun, &mut faults);
    world.tell_clients_to_end();
    let mut tally = Tally::default();
    for thread in threads {
        match thread.join() {
            Ok(one) => tally.merge(one),
            Err(_) => tally.record_and_print_lost_touch("a client has panicked".into()),
        }
    }
    result?;
    std::thread::sleep(REST);
    let report = make_report(options, begun, at_start, tally, faults);
    println!("{}", report.format_table());
    match report.find_failures() {
        None => Ok(()),
        Some(what) => Err(Error::NotStood(what)),
    }
}

/// What has become of all.
fn make_report(
    options: &Options,
    begun: Instant,
    at_start: MemoryThreadsAndHandles,
    tally: Tally,
    faults: Faults<'_>,
) -> Report {
    let outages = faults.outages + faults.fetch_metric_count_or_zero("era_device_outages_total");
    let latched = faults.faults + faults.fetch_metric_count_or_zero("era_device_faults_total");
    let Faults { bench, mut daemon, ledger, before_kill, .. } = faults;
    Report {
        seed: options.seed,
        injects: options.faults,
        lasted: begun.elapsed(),
        tally,
        ledger,
        outages,
        latched,
        at_start,
        before_kill,
        at_end: daemon.read_memory_threads_and_handles_or_zeros(),
        watch: bench.sim_control().observations_since_start(),
        ended: daemon.has_ended().then(|| daemon.recent_log()),
    }
}

/// Lets clients and faults go on until the time is over.
fn run_until_end_with_faults_if_enabled_failing_if_daemon_ends(
    options: &Options,
    begun: Instant,
    faults: &mut Faults<'_>,
) -> Result<(), Error> {
    let lasts = Duration::from_secs_f64(options.minutes * 60.0);
    let mut told = Instant::now();
    while begun.elapsed() < lasts {
        if faults.daemon.has_ended() {
            return Err(Error::Answer(format!(
                "the daemon has ended by itself; its log:\n{}",
                faults.daemon.recent_log()
            )));
        }
        if options.faults {
            faults.inject_round_of_all_fault_kinds_in_random_order()?;
            let total = faults.ledger.sum_counts_with_longest_times_over_kinds();
            eprintln!(
                "{:.0} s: {} faults, {} recovered",
                begun.elapsed().as_secs_f64(),
                total.injected,
                total.recovered
            );
            continue;
        }
        std::thread::sleep(Duration::from_millis(200).min(lasts.saturating_sub(begun.elapsed())));
        if told.elapsed() >= TELL {
            told = Instant::now();
            let takes = faults.daemon.read_memory_threads_and_handles_or_zeros();
            eprintln!("{:.0} s: {} kB, {} handles", begun.elapsed().as_secs_f64(), takes.memory_kb, takes.handles);
        }
    }
    Ok(())
}
