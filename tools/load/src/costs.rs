//! What every route costs at its worst, and how long a stop takes beside it: `cargo xtask bench costs` prints the table of docs/src/http.md.

mod requests;

use crate::daemon::{Daemon, DaemonSetup};
use crate::error::Error;
use crate::http::{Endpoint, Http};
use crate::live::Live;
use crate::times::{Times, format_ms_number_or_never};
use clap::Args;
use requests::{Case, Sending, list_request_kinds_to_measure_cost_of};
use std::io::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Connections that ask for the same at once.
const CONNECTIONS: usize = 8;
/// Between two stops.
const BETWEEN_STOPS: Duration = Duration::from_millis(20);
/// Between two requests whose senders hang up: an answer is not what paces them.
const BETWEEN_HANG_UPS: Duration = Duration::from_millis(5);
/// Longest stop that is asked for.
const LONGEST_STOP_MS: f64 = 10.0;

/// For how long.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// Time for each route, in s
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = crate::parse_number_within_0_001_to_100000)]
    seconds: f64,
    /// The program to start
    #[arg(long, value_name = "FILE", default_value = "target/release/era")]
    program: PathBuf,
}

/// What was measured of one.
struct CaseMeasurement {
    answers: Times,
    /// Answers of each status, in words.
    statuses: String,
    stops: Times,
}

/// Measures all and prints a table.
///
/// # Errors
/// [`Error::Missed`] if a stop took too long.
pub fn measure_and_print_route_costs_failing_if_a_stop_is_late(options: &Options) -> Result<(), Error> {
    let folder = tempfile::tempdir().map_err(Error::system_error("no folder"))?;
    let plan = DaemonSetup {
        program: options.program.clone(),
        device: "sim".into(),
        socket: folder.path().join("era.sock"),
        cache: folder.path().join("cache"),
        clears_silence: true,
    };
    let daemon = Daemon::start(&plan)?;
    daemon.await_device()?;
    println!(
        "{CONNECTIONS} connections send the same request for {} s; another connection sends a stop every \
         {BETWEEN_STOPS:?}\n",
        options.seconds
    );
    println!("| route | bound | answers | longest answer, ms | stops: median / p99 / longest | memory so far, MB |");
    println!("|---|---|---|---|---|---|");
    let mut missed = Vec::new();
    for case in list_request_kinds_to_measure_cost_of() {
        let measured = measure_case_and_stops_meanwhile(&daemon, &case, Duration::from_secs_f64(options.seconds))?;
        let longest = measured
            .answers
            .longest_counting_missing_as_infinite_ms()
            .map_or_else(|| "-".into(), format_ms_number_or_never);
        println!(
            "| {} | {} | {} | {longest} | {} | {} |",
            case.route,
            case.bound,
            measured.statuses,
            measured.stops.describe_median_p99_and_longest(),
            read_peak_memory_or_zero_mb(&daemon)
        );
        if measured.stops.longest_counting_missing_as_infinite_ms().is_none_or(|longest| longest > LONGEST_STOP_MS) {
            missed.push(case.route);
        }
    }
    if missed.is_empty() {
        return Ok(());
    }
    Err(Error::Missed(format!("a stop within {LONGEST_STOP_MS} ms beside {}", missed.join(", "))))
}

fn measure_case_and_stops_meanwhile(daemon: &Daemon, case: &Case, time: Duration) -> Result<CaseMeasurement, Error> {
    let until = Instant::now() + time;
    let mut stops = Times::default();
    let asked = std::thread::scope(|threads| {
        let asking: Vec<_> = (0..CONNECTIONS)
            .map(|_| threads.spawn(|| measure_answer_times_and_statuses_0_if_hung_up(daemon, case, until)))
            .collect();
        let mut http = Http::new(Endpoint::Tcp(daemon.address));
        while Instant::now() < until {
            let begun = Instant::now();
            match http.post("/v1/stop", "") {
                Ok(answer) if answer.status == 200 => stops.add_time(begun.elapsed()),
                _ => stops.add_missing(),
            }
            std::thread::sleep(BETWEEN_STOPS);
        }
        asking.into_iter().filter_map(|thread| thread.join().ok()).collect::<Vec<_>>()
    });
    let (mut answers, mut counts) = (Times::default(), std::collections::BTreeMap::<u16, usize>::new());
    for one in asked {
        let (times, own) = one.map_err(Error::Answer)?;
        answers.merge(times);
        own.into_iter().for_each(|status| *counts.entry(status).or_default() += 1);
    }
    let statuses: Vec<String> = counts
        .into_iter()
        .map(|(status, count)| if status == 0 { format!("{count} hung up") } else { format!("{count} x {status}") })
        .collect();
    Ok(CaseMeasurement { answers, statuses: statuses.join(", "), stops })
}

/// Times of answers, and their statuses; 0 where nobody waited for one.
fn measure_answer_times_and_statuses_0_if_hung_up(
    daemon: &Daemon,
    case: &Case,
    until: Instant,
) -> Result<(Times, Vec<u16>), String> {
    let (mut times, mut statuses) = (Times::default(), Vec::new());
    let mut http = Http::new(Endpoint::Tcp(daemon.address));
    let mut live = None;
    if matches!(case.sending, Sending::Live) {
        live = Some(Live::open(daemon.address, "state")?);
    }
    let mut turn = 0;
    while Instant::now() < until {
        let (method, path, body) = &case.requests[turn % case.requests.len()];
        turn += 1;
        let begun = Instant::now();
        match (case.sending, &mut live) {
            (Sending::Live, Some(live)) => {
                live.send_text(body)?;
                // What is told meanwhile is read, so that the socket is not let go.
                while live
                    .read_next_json_message_until_none_if_late_or_not_text(Instant::now() + Duration::from_micros(100))?
                    .is_some()
                {}
                statuses.push(101);
            }
            (Sending::HangUp, _) => {
                let mut stream = crate::http::connect_tcp(daemon.address).map_err(|error| error.to_string())?;
                let length = body.len();
                let head = format!("{method} {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n");
                stream.write_all(format!("{head}{body}").as_bytes()).map_err(|error| error.to_string())?;
                statuses.push(0);
                std::thread::sleep(BETWEEN_HANG_UPS);
            }
            _ => match http.send_request(method, path, None, body) {
                Ok(answer) => {
                    times.add_time(begun.elapsed());
                    statuses.push(answer.status);
                }
                Err(error) => return Err(format!("{method} {path}: {error}")),
            },
        }
    }
    Ok((times, statuses))
}

/// Most memory that the daemon has had so far, in MB.
fn read_peak_memory_or_zero_mb(daemon: &Daemon) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", daemon.process_id())).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) / 1000
}
