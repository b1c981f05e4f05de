//! How long a daemon takes at one, a hundred and a thousand touches a second, over every connection, from when each touch was due.

mod aims;
mod echo;
mod frames;
mod measured;
mod over_http;
mod over_live;
mod touches;

use crate::board::Bench;
use crate::daemon::{Daemon, DaemonSetup};
use crate::error::Error;
use crate::http::{Endpoint, Http, find_metric};
use crate::times::Times;
use aims::LoadRow;
use clap::Args;
use echo::Echo;
use era::device::sim::SimControl;
use measured::{TouchStatistics, collect_due_to_end_times_refused_as_missing};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use touches::Touch;

/// Fewest touches that are measured: a p99 of a hundred or fewer is the longest of them ([`Times::percentile_counting_missing_as_infinite_ms`]), of 200 the second longest, and of
/// so many the third, so that two touches that meet one short disturbance do not decide.
const FEWEST: f64 = 300.0;
/// Touches a second up to which the echo has its load at the same time, half way between two touches, so that both meet the same
/// disturbances of the machine; of more the daemon's load would be another one.
const BESIDE: f64 = 10.0;
/// How often a load is put on at most where the machine was disturbed ([`LoadRow::describe_machine_disturbance_if_simultaneous_echo_was_slow`]). The last try counts, disturbed or not.
const TRIES: usize = 3;
/// Stops under each load, ...
const STOPS: u32 = 10;
/// ... and the time between them: the self-test and the rise of the rails after each are over by then.
const BETWEEN_STOPS: Duration = Duration::from_millis(500);
/// Longest wait for a stop to reach the board.
const STOP: Duration = Duration::from_secs(2);
/// Between two looks whether it has.
const LOOK: Duration = Duration::from_micros(100);
/// Between two loads, for the board's channels to rest.
const REST: Duration = Duration::from_secs(2);
/// From a load's beginning until its first touch is due: its connections are open by then. What a touch takes with a connection of its own is
/// measured apart ([`FRESH`]).
const OPENING: Duration = Duration::from_millis(200);
/// Touches over connections that are opened for them, when they are due, ...
const FRESH: u32 = 20;
/// ... and the time between them: drives of before are over by then.
const BETWEEN_FRESH: Duration = Duration::from_millis(500);
/// Most connections: each has one request on its way.
const CONNECTIONS: f64 = 32.0;
/// Connections for each touch a second: a request may take 20 ms.
const CONNECTIONS_PER_RATE: f64 = 0.02;
/// Frames with drives for each touch of which the last are kept: the daemon may send some again, and others to thin a drive out.
const FRAMES_PER_TOUCH: usize = 4;
/// A touch that takes longer, in ms, is named: where in a load it stands says whether it was its beginning or something later.
const LATE_MS: f64 = 2.0;
/// Places in an eighth of a pixel along the screen.
const PLACES: u32 = 1920 * 8;

/// How fast, and for how long.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// Touches a second
    #[arg(long, value_name = "N", value_delimiter = ',', default_values_t = [1.0, 100.0, 1000.0],
        value_parser = crate::parse_number_within_0_001_to_100000)]
    rates: Vec<f64>,
    /// Time for each, in s
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = crate::parse_number_within_0_001_to_100000)]
    seconds: f64,
    /// The program to start
    #[arg(long, value_name = "FILE", default_value = "target/release/era")]
    program: PathBuf,
}

/// How long before a touch is due its sender is awake, as an application is that has been told of a finger: where a processor has been idle, a
/// sleep ends some tenths of a millisecond late, which is no time of the daemon's.
const AWAKE: Duration = Duration::from_millis(2);
/// Time between two touches from which on the sender can be awake without taking a processor from the daemon.
const SELDOM: Duration = Duration::from_millis(8);

/// How often, and from when until when.
#[derive(Clone, Copy, Debug)]
struct Pace {
    from: Instant,
    every: Duration,
    until: Instant,
    /// Number of the first touch's place ([`distinct_x_px_of_touch`]).
    first: u32,
}

impl Pace {
    /// Of a load that begins now, its first touch a little later ([`OPENING`]).
    fn new(rate: f64, seconds: f64) -> Self {
        Self::from(Instant::now() + OPENING, rate, seconds)
    }

    fn from(from: Instant, rate: f64, seconds: f64) -> Self {
        Self {
            from,
            every: Duration::from_secs_f64(1.0 / rate),
            until: from + Duration::from_secs_f64(seconds),
            first: 0,
        }
    }

    /// Place of the `touch_number`th touch.
    fn touch_x_px(&self, touch_number: u32) -> f64 {
        distinct_x_px_of_touch(self.first.wrapping_add(touch_number))
    }

    /// Sleeps until a touch is due.
    fn sleep_until_due(&self, due: Instant) {
        let awake = if self.every < SELDOM { Duration::ZERO } else { AWAKE };
        std::thread::sleep(due.saturating_duration_since(Instant::now()).saturating_sub(awake));
        while Instant::now() < due {
            std::hint::spin_loop();
        }
    }

    /// When the `touch_number`th is due; `None` if that is beyond the end.
    fn due_time_unless_past_end(&self, touch_number: u32) -> Option<Instant> {
        Some(self.from + self.every * touch_number).filter(|due| *due < self.until)
    }
}

/// A place of its own for every touch, in eighths of a pixel, which every reader of numbers gets right to the last bit.
fn distinct_x_px_of_touch(touch_number: u32) -> f64 {
    f64::from(touch_number.wrapping_mul(7919) % PLACES) / 8.0
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transport {
    Tcp,
    Live,
    Unix,
}

impl Transport {
    const ALL: [Self; 3] = [Self::Tcp, Self::Live, Self::Unix];

    const fn name(self) -> &'static str {
        match self {
            Self::Tcp => "HTTP, kept open",
            Self::Live => "live socket",
            Self::Unix => "HTTP, Unix socket",
        }
    }
}

struct Measurement {
    daemon: Daemon,
    socket: PathBuf,
    control: SimControl,
    echo: Echo,
}

/// Measures and prints.
///
/// # Errors
/// [`Error::Missed`] if the daemon does not do what is asked of it, and what keeps that from being measured.
pub fn measure_and_print_touch_latency_failing_if_aim_is_missed(options: &Options) -> Result<(), Error> {
    let folder = tempfile::tempdir().map_err(Error::system_error("no folder for sockets"))?;
    let link = folder.path().join("board");
    let bench = Bench::new_linked_directly_to_board(link.clone())?;
    let socket = folder.path().join("era.sock");
    let plan = DaemonSetup {
        program: options.program.clone(),
        device: link,
        socket: socket.clone(),
        cache: folder.path().join("cache"),
        clears_silence: true,
    };
    let echo = Echo::start(folder.path().join("echo.sock"))?;
    let daemon = Daemon::start(&plan)?;
    daemon.await_device()?;
    let measurement = Measurement { daemon, socket, control: bench.sim_control(), echo };
    println!(
        "Times are p50 / p99 / longest, from the time when a touch was due; {} processors, shared with the \
         simulated board",
        count_processors()
    );
    println!(
        "{:<18} {:>6} {:>6} {:>6} {:>9} {:>7} {:>27} {:>27} {:>27} {:>27} {:>27}",
        "over",
        "rate",
        "sent",
        "driven",
        "overtaken",
        "refused",
        "to the frame's last byte",
        "an echo's answer",
        "to the answer",
        "overtaken, until told",
        "stop to the board"
    );
    let mut rows = Vec::new();
    for transport in Transport::ALL {
        for rate in &options.rates {
            rows.push(repeat_disturbed_measurement_keeping_last_try_and_all_stops(|| {
                measurement.measure_and_print_touches_echo_and_stops_at_rate(
                    transport,
                    *rate,
                    options.seconds.max(FEWEST / rate),
                )
            })?);
        }
        measurement.measure_and_print_touches_on_fresh_connections(transport)?;
    }
    let text = measurement.fetch_metrics()?;
    let ms = |name: &str| find_metric(&text, name).map_or_else(|| "-".into(), |s| format!("{:.1} ms", s * 1e3));
    println!(
        "longest time between two signs of life from the daemon to the armed board: {}",
        ms("era_link_longest_gap_seconds")
    );
    let count = |name: &str| find_metric(&text, name).unwrap_or(f64::NAN);
    println!(
        "doubts {}, outages {}, faults {}",
        count("era_device_doubts_total"),
        count("era_device_outages_total"),
        count("era_device_faults_total")
    );
    let (table, missed) =
        aims::format_aims_and_list_missed(&rows, measurement.control.observations_since_start().silence);
    println!("\n{table}");
    if missed.is_empty() { Ok(()) } else { Err(Error::Missed(missed.join("; "))) }
}

fn count_processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

impl Measurement {
    fn send_touches(&self, transport: Transport, rate: f64, pace: Pace) -> Result<Vec<Touch>, Error> {
        match transport {
            Transport::Tcp => Ok(over_http::send_touches_over_http(&Endpoint::Tcp(self.daemon.address), pace, rate)),
            Transport::Unix => Ok(over_http::send_touches_over_http(&Endpoint::Unix(self.socket.clone()), pace, rate)),
            Transport::Live => over_live::send_touches_over_live(self.daemon.address, pace).map_err(Error::Answer),
        }
    }

    /// The same load on a server that does nothing.
    fn measure_echo_round_trips(&self, transport: Transport, rate: f64, pace: Pace) -> Result<Times, Error> {
        let touches = match transport {
            Transport::Tcp => over_http::send_touches_over_http(&self.echo.tcp, pace, rate),
            Transport::Unix => over_http::send_touches_over_http(&self.echo.unix, pace, rate),
            Transport::Live => over_live::send_touches_over_live(self.echo.live, pace).map_err(Error::Answer)?,
        };
        Ok(collect_due_to_end_times_refused_as_missing(&touches))
    }

    /// A load, and the same on the echo: beside it where touches are seldom, before it where they are not.
    fn measure_touches_and_echo_simultaneously_if_rate_is_low(
        &self,
        transport: Transport,
        rate: f64,
        seconds: f64,
    ) -> Result<(Vec<Touch>, Times), Error> {
        if rate > BESIDE {
            let echo = self.measure_echo_round_trips(transport, rate, Pace::new(rate, seconds))?;
            return Ok((self.send_touches(transport, rate, Pace::new(rate, seconds))?, echo));
        }
        let pace = Pace::new(rate, seconds);
        let between = Pace::from(pace.from + pace.every / 2, rate, seconds);
        std::thread::scope(|threads| {
            let echo = threads.spawn(move || self.measure_echo_round_trips(transport, rate, between));
            let touches = self.send_touches(transport, rate, pace)?;
            let echo = echo.join().map_err(|_| Error::Answer("the load on the echo did not end".into()))?;
            Ok((touches, echo?))
        })
    }

    fn measure_and_print_touches_echo_and_stops_at_rate(
        &self,
        transport: Transport,
        rate: f64,
        seconds: f64,
    ) -> Result<LoadRow, Error> {
        std::thread::sleep(REST);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
        let most = (rate * seconds).ceil() as usize * FRAMES_PER_TOUCH;
        self.control.start_recording_newest_drive_frames(most);
        let (begun, worked_s) = (Instant::now(), self.daemon.processor_time_s());
        let (touches, echo) = self.measure_touches_and_echo_simultaneously_if_rate_is_low(transport, rate, seconds)?;
        let worked_s = worked_s.zip(self.daemon.processor_time_s()).map(|(before, after)| after - before);
        let worked = worked_s.map(|worked_s| worked_s / begun.elapsed().as_secs_f64());
        let measured = TouchStatistics::from_touches(&touches, &self.control.stop_recording_and_take_recorded_frames())
            .map_err(Error::Answer)?;
        std::thread::sleep(REST);
        let stops = std::thread::scope(|threads| {
            let seconds = (BETWEEN_STOPS * (STOPS + 1)).as_secs_f64();
            let pace = Pace::new(rate, seconds);
            let load = threads.spawn(move || self.send_touches(transport, rate, pace).map(|_| ()));
            let stops = self.measure_stop_times_to_board(transport, pace.from);
            load.join().unwrap_or(Ok(())).and(stops)
        })?;
        println!(
            "{:<18} {rate:>6} {:>6} {:>6} {:>9} {:>7} {:>27} {:>27} {:>27} {:>27} {:>27}",
            transport.name(),
            measured.sent,
            measured.count_driven(),
            measured.overtaken.len(),
            measured.refused.values().sum::<usize>(),
            measured.frame.describe_median_p99_and_longest(),
            echo.describe_median_p99_and_longest(),
            measured.answer.describe_median_p99_and_longest(),
            measured.overtaken.describe_median_p99_and_longest(),
            stops.describe_median_p99_and_longest()
        );
        let busy = worked.map(|worked| format!("the daemon used {:.1} % of a processor", worked * 1e2));
        for what in measured
            .describe_counts_of_refused_touches_and_those_without_frame()
            .into_iter()
            .chain(busy)
            .chain(measured.list_slowest_touches_over_limit(LATE_MS))
        {
            println!("  {what}");
        }
        Ok(LoadRow { transport, rate, measured, stops, echo, tries: 1 })
    }

    /// Measures touches over connections that are opened when they are due, to the frame's last byte, and prints that.
    fn measure_and_print_touches_on_fresh_connections(&self, transport: Transport) -> Result<(), Error> {
        let rate = BETWEEN_FRESH.as_secs_f64().recip();
        let mut times = Times::default();
        for first in 0..FRESH {
            std::thread::sleep(BETWEEN_FRESH);
            self.control.start_recording_newest_drive_frames(FRAMES_PER_TOUCH);
            let touches =
                self.send_touches(transport, rate, Pace { first, ..Pace::from(Instant::now(), rate, 0.9 / rate) })?;
            let measured =
                TouchStatistics::from_touches(&touches, &self.control.stop_recording_and_take_recorded_frames())
                    .map_err(Error::Answer)?;
            for what in measured.describe_counts_of_refused_touches_and_those_without_frame() {
                println!("  {what}");
            }
            times.merge(measured.frame);
        }
        let (count, told) = (times.len(), times.describe_median_p99_and_longest());
        println!(
            "  {count} touches, each over a new connection, from before the connection is opened to the frame's \
             last byte: {told}"
        );
        Ok(())
    }

    /// Stops the device again and again, over a connection of its own, from when the load does; from when each was due.
    fn measure_stop_times_to_board(&self, transport: Transport, begun: Instant) -> Result<Times, Error> {
        let place = match transport {
            Transport::Unix => Endpoint::Unix(self.socket.clone()),
            _ => Endpoint::Tcp(self.daemon.address),
        };
        let (mut times, mut http) = (Times::default(), Http::new(place));
        for number in 1..=STOPS {
            let due = begun + BETWEEN_STOPS * number;
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            let received = || self.control.last_stop_received_at().filter(|at| *at >= due);
            let answer = http.post("/v1/stop", "").map_err(Error::system_error("a stop was not answered"))?;
            while received().is_none() && due.elapsed() < STOP {
                std::thread::sleep(LOOK);
            }
            let Some(at) = received() else {
                return Err(Error::Answer(format!(
                    "a stop did not reach the board, but was answered {}",
                    answer.status
                )));
            };
            times.add_time(at - due);
        }
        Ok(times)
    }

    fn fetch_metrics(&self) -> Result<String, Error> {
        let answer = Http::new(Endpoint::Tcp(self.daemon.address)).get("/metrics");
        let answer = answer.map_err(Error::system_error("no metrics"))?;
        Ok(String::from_utf8_lossy(&answer.body).into_owned())
    }
}

/// A row from a time in which the machine did nothing else, if there is one; each try is printed, and stops count of all of them.
fn repeat_disturbed_measurement_keeping_last_try_and_all_stops(
    mut measure: impl FnMut() -> Result<LoadRow, Error>,
) -> Result<LoadRow, Error> {
    let mut row = measure()?;
    while let Some(why) = row.describe_machine_disturbance_if_simultaneous_echo_was_slow() {
        println!("  {why}");
        if row.tries >= TRIES || !row.was_every_touch_driven_or_overtaken() {
            break;
        }
        let (stops, tries) = (row.stops, row.tries + 1);
        row = LoadRow { tries, ..measure()? };
        row.stops.merge(stops);
    }
    Ok(row)
}

/// The next touch among those of all connections.
fn take_number_and_due_time_of_next_touch(counter: &AtomicU32, pace: Pace) -> Option<(u32, Instant)> {
    let k = counter.fetch_add(1, Ordering::Relaxed);
    pace.due_time_unless_past_end(k).map(|due| (k, due))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn touches_are_due_evenly_until_the_end() {
        let pace = Pace::new(100.0, 0.045);
        let counter = AtomicU32::new(0);
        let due: Vec<_> = std::iter::from_fn(|| take_number_and_due_time_of_next_touch(&counter, pace)).collect();
        assert_eq!(due.len(), 5);
        assert_eq!(due[3].1 - pace.from, Duration::from_millis(30));
    }
}
