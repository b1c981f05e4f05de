//! Faults, one after the other, each with what has to be seen of it and after it.

use super::ledger::{FaultKind, FaultLedger};
use super::slow::{self, SlowClient, SlowClientEnd};
use super::world::{ServingDaemon, SoakState};
use crate::board::{Bench, Direction, Rubbish};
use crate::daemon::{Daemon, DaemonSetup, MemoryThreadsAndHandles};
use crate::error::Error;
use crate::http::{Endpoint, Http, find_metric};
use era::device::sim::SimControl;
use fastrand::Rng;
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Longest time for the board to go off: the dead-man time (250 ms), and some for a busy machine.
const OFF: Duration = Duration::from_millis(400);
/// Longest time for the daemon to notice.
const NOTICED: Duration = Duration::from_secs(5);
/// Longest time until a touch is driven again.
const AGAIN: Duration = Duration::from_secs(15);
/// Longest time for a frame with the byte that rubbish waits for.
const FRAME: Duration = Duration::from_secs(1);
/// Between two looks.
const LOOK: Duration = Duration::from_millis(10);
/// A board that was stopped has discharged its rails after 13 ms, and one that is not spoken to stays on for its dead-man time, 250 ms.
const DISCHARGED_WITHIN: Duration = Duration::from_millis(30);
/// Between two looks for the loss of the board.
const LOOK_FOR_LOSS: Duration = Duration::from_millis(1);
/// Lines that are cut in both directions in a round: so that there are some times of their being told; ...
const CUTS: usize = 4;
/// ... and one way, for each way.
const CUTS_ONE_WAY: usize = 2;
/// Longest time for which a line is cut in ms: some are over before the board is given up, after 1.1 s, and some are not.
const CUT_MS: u64 = 2000;
/// Bytes of frames before which rubbish is put: the longest common ones have as many.
const BYTES: usize = 24;
/// Slow clients of each kind in a round.
const SLOW_EACH: usize = 3;
/// How often a touch is tried before there is high voltage to be lost: for 2 s, as other clients' newer touches replace it again and again while all
/// of them begin.
const TRIES: u32 = 200;
/// A touch that is still driven when the fault comes.
const LONG_TOUCH: &str = r#"{"x_px": 960, "y_px": 640, "intensity_g": 0.4, "duration_ms": 8000}"#;

/// What faults are injected into.
pub struct Faults<'a> {
    /// What clients are told.
    pub world: &'a SoakState,
    /// The board and its cable.
    pub bench: Bench,
    /// How a daemon is started.
    pub plan: DaemonSetup,
    /// The present one.
    pub daemon: Daemon,
    /// What came of all.
    pub ledger: FaultLedger,
    /// Which comes next.
    pub random: Rng,
    /// Outages of the link that daemons before this one have counted.
    pub outages: u64,
    /// Faults latched by the board that these have counted.
    pub faults: u64,
    /// What the last of them took before it was killed.
    pub before_kill: Option<MemoryThreadsAndHandles>,
}

/// After how long something was seen; otherwise what was.
type SeenAfter = Result<Duration, String>;

impl Faults<'_> {
    /// A round of all faults, in an order of its own.
    ///
    /// # Errors
    /// What keeps the run from going on.
    pub fn inject_round_of_all_fault_kinds_in_random_order(&mut self) -> Result<(), Error> {
        let serving = self.find_serving_daemon()?;
        let world = self.world;
        std::thread::scope(|threads| -> Result<(), Error> {
            let slow: Vec<_> = (SlowClient::ALL.iter().cycle().take(SLOW_EACH * SlowClient::ALL.len()))
                .map(|slow| (*slow, threads.spawn(move || slow::run_slow_client(world, serving, *slow))))
                .collect();
            let mut order = [
                FaultKind::Unplugged,
                FaultKind::DeadLine,
                FaultKind::AnswersLost,
                FaultKind::RequestsLost,
                FaultKind::RubbishToBoard,
                FaultKind::RubbishToHost,
                FaultKind::DaemonSuspended,
            ];
            self.random.shuffle(&mut order);
            for kind in order {
                eprintln!("fault: {kind}");
                match kind {
                    FaultKind::Unplugged => self.unplug_board_and_record_detection_and_recovery()?,
                    FaultKind::DeadLine => self.cut_line_several_times_recording_detection_and_recovery(
                        CUTS,
                        kind,
                        &[Direction::ToBoard, Direction::ToHost],
                    )?,
                    FaultKind::AnswersLost => self.cut_line_several_times_recording_detection_and_recovery(
                        CUTS_ONE_WAY,
                        kind,
                        &[Direction::ToHost],
                    )?,
                    FaultKind::RequestsLost => self.cut_line_several_times_recording_detection_and_recovery(
                        CUTS_ONE_WAY,
                        kind,
                        &[Direction::ToBoard],
                    )?,
                    FaultKind::RubbishToBoard => self
                        .insert_rubbish_at_each_frame_byte_recording_detection_and_recovery(Direction::ToBoard, kind),
                    FaultKind::RubbishToHost => {
                        self.insert_rubbish_at_each_frame_byte_recording_detection_and_recovery(Direction::ToHost, kind)
                    }
                    _ => self.pause_daemon_and_record_detection_and_recovery()?,
                }
            }
            eprintln!("fault: waiting for the end of {} slow clients", slow.len());
            for (slow, thread) in slow {
                let end = thread.join().unwrap_or(SlowClientEnd::Unknown);
                self.record_end_of_slow_client_and_recovery(slow, end);
            }
            Ok(())
        })?;
        eprintln!("fault: {}", FaultKind::Killed);
        self.kill_and_restart_daemon_recording_voltage_off_time_and_recovery()
    }

    fn find_serving_daemon(&self) -> Result<ServingDaemon, Error> {
        self.world.current_daemon().ok_or_else(|| Error::Answer("no daemon serves".into()))
    }

    pub(super) fn sim_control(&self) -> SimControl {
        self.bench.sim_control()
    }

    pub(super) fn new_http_client(&self) -> Http {
        Http::new(Endpoint::Tcp(self.daemon.address))
    }

    /// Drives something, so that there is high voltage to be lost.
    pub(super) fn post_touches_until_high_voltage_is_on(&self) -> Result<(), String> {
        let mut http = self.new_http_client();
        let mut last = String::new();
        for _ in 0..TRIES {
            match http.post("/v1/touch", LONG_TOUCH) {
                Ok(answer) if answer.status == 200 && self.sim_control().observations_since_start().energised => {
                    return Ok(());
                }
                Ok(answer) => last = format!("{} {}", answer.status, answer.parse_json_body_or_null()["detail"]),
                Err(error) => last = error.to_string(),
            }
            std::thread::sleep(LOOK);
        }
        Err(format!("no touch could be driven before the fault: {last}"))
    }

    /// Waits until a touch is driven.
    fn retry_touch_and_measure_time_until_driven(&self) -> SeenAfter {
        let (begun, mut http) = (Instant::now(), self.new_http_client());
        let mut last = String::new();
        while begun.elapsed() < AGAIN {
            match http.post("/v1/touch", LONG_TOUCH) {
                Ok(answer) if answer.status == 200 => return Ok(begun.elapsed()),
                Ok(answer) => last = format!("{} {}", answer.status, answer.parse_json_body_or_null()["detail"]),
                Err(error) => last = error.to_string(),
            }
            std::thread::sleep(LOOK);
        }
        Err(format!("no touch was driven for {} s: {last}", AGAIN.as_secs()))
    }

    /// Waits until the board has switched high voltage off.
    fn await_high_voltage_off(&self) -> SeenAfter {
        wait_until(OFF, || !self.sim_control().observations_since_start().energised)
            .ok_or_else(|| format!("the board's high voltage was still on after {} ms", OFF.as_millis()))
    }

    /// Waits until a metric is as wanted.
    fn await_condition_on_metrics_text(&self, failure_message: &str, is_seen: impl Fn(&str) -> bool) -> SeenAfter {
        let mut http = self.new_http_client();
        let mut text = || http.get("/metrics").map(|answer| String::from_utf8_lossy(&answer.body).into_owned());
        wait_until(NOTICED, || text().is_ok_and(|text| is_seen(&text)))
            .ok_or_else(|| format!("{failure_message} within {} s", NOTICED.as_secs()))
    }

    fn fetch_metrics_text_or_empty(&self) -> String {
        self.new_http_client()
            .get("/metrics")
            .map(|answer| String::from_utf8_lossy(&answer.body).into_owned())
            .unwrap_or_default()
    }

    /// Doubts, outages and faults that the daemon has counted so far.
    fn sum_doubt_outage_and_fault_counts_in_metrics(text: &str) -> f64 {
        let names = ["era_device_doubts_total", "era_device_outages_total", "era_device_faults_total"];
        names.iter().filter_map(|name| find_metric(text, name)).sum()
    }

    /// Takes the board away by `remove_board`; says after how long that was told.
    pub(super) fn remove_board_record_loss_time_and_get_later_of_loss_and_off_time(
        &mut self,
        remove_board: impl FnOnce(&mut Bench) -> Result<(), Error>,
    ) -> Result<SeenAfter, Error> {
        let (address, watched) = (self.daemon.address, mpsc::channel());
        let watcher = std::thread::spawn(move || {
            let mut http = Http::new(Endpoint::Tcp(address));
            let mut is_told = || {
                let text = http.get("/metrics").map(|answer| String::from_utf8_lossy(&answer.body).into_owned());
                text.is_ok_and(|text| find_metric(&text, "era_device_connected") == Some(0.0))
            };
            // The board is there before it is lost, and this connection open.
            wait_until(NOTICED, || !is_told())?;
            let _ = watched.0.send(());
            poll_until(LOOK_FOR_LOSS, NOTICED, is_told).map(|_| Instant::now())
        });
        let _ = watched.1.recv_timeout(NOTICED);
        let begun = Instant::now();
        let lost = remove_board(&mut self.bench);
        let off = self.await_high_voltage_off();
        let told = watcher.join().ok().flatten().map(|told| told.saturating_duration_since(begun));
        lost?;
        if let Some(after) = told {
            self.ledger.losses.add_time(after);
        }
        let told = told.ok_or_else(|| format!("the daemon did not report the loss within {} s", NOTICED.as_secs()));
        Ok(later_if_both_seen(off, told))
    }

    fn unplug_board_and_record_detection_and_recovery(&mut self) -> Result<(), Error> {
        let driven = self.post_touches_until_high_voltage_is_on();
        let before = find_metric(&self.fetch_metrics_text_or_empty(), "era_device_outages_total");
        let seen = self.remove_board_record_loss_time_and_get_later_of_loss_and_off_time(Bench::unplug)?;
        let off = driven.and(seen);
        let noticed = self.await_condition_on_metrics_text("the outage was not counted", |text| {
            find_metric(text, "era_device_outages_total") > before
                && find_metric(text, "era_device_connected") == Some(0.0)
        });
        std::thread::sleep(Duration::from_millis(self.random.u64(0..2000)));
        self.bench.plug_in()?;
        self.ledger.record_fault_and_print_misses(
            FaultKind::Unplugged,
            later_if_both_seen(off, noticed),
            self.retry_touch_and_measure_time_until_driven(),
        );
        Ok(())
    }

    fn cut_line_several_times_recording_detection_and_recovery(
        &mut self,
        count: usize,
        kind: FaultKind,
        directions: &[Direction],
    ) -> Result<(), Error> {
        (0..count).try_for_each(|_| self.cut_line_and_record_detection_and_recovery(kind, directions))
    }

    pub(super) fn cut_line_and_record_detection_and_recovery(
        &mut self,
        kind: FaultKind,
        directions: &[Direction],
    ) -> Result<(), Error> {
        let driven = self.post_touches_until_high_voltage_is_on();
        let before = Self::sum_doubt_outage_and_fault_counts_in_metrics(&self.fetch_metrics_text_or_empty());
        let seen = self.remove_board_record_loss_time_and_get_later_of_loss_and_off_time(|bench| {
            bench.set_blocked_directions(directions);
            Ok(())
        })?;
        let lasts = Duration::from_millis(self.random.u64(0..CUT_MS));
        let stays_off = check_high_voltage_stays_off_returning_zero_time(lasts, || {
            self.sim_control().observations_since_start().energised
        });
        // One that did not go off is named for that.
        let stays_off = if seen.is_ok() { stays_off } else { Ok(Duration::ZERO) };
        let off = driven.and(later_if_both_seen(seen, stays_off));
        self.bench.set_blocked_directions(&[]);
        let noticed = self.await_condition_on_metrics_text("neither doubt, outage nor fault was counted", |text| {
            Self::sum_doubt_outage_and_fault_counts_in_metrics(text) > before
        });
        self.ledger.record_fault_and_print_misses(
            kind,
            later_if_both_seen(off, noticed),
            self.retry_touch_and_measure_time_until_driven(),
        );
        Ok(())
    }

    fn insert_rubbish_at_each_frame_byte_recording_detection_and_recovery(
        &mut self,
        direction: Direction,
        kind: FaultKind,
    ) {
        for at in 0..BYTES {
            let Some(mut noticed) = self.insert_rubbish_into_first_long_enough_frame_and_await_detection(direction, at)
            else {
                continue;
            };
            if noticed.is_err() {
                // On a busy machine it may have been a frame that was sent again while its answer was on the way: nobody misses that.
                noticed = self
                    .insert_rubbish_into_first_long_enough_frame_and_await_detection(direction, at)
                    .unwrap_or(noticed);
            }
            let again = self.retry_touch_and_measure_time_until_driven();
            self.ledger.record_fault_and_print_misses(kind, noticed, again);
        }
    }

    /// Puts rubbish into a frame, before the byte `before_byte_index`; `None` if no frame was long enough.
    fn insert_rubbish_into_first_long_enough_frame_and_await_detection(
        &mut self,
        direction: Direction,
        before_byte_index: usize,
    ) -> Option<SeenAfter> {
        let links = |text: &str| {
            let names = ["era_link_repeats_total", "era_link_bad_frames_total", "era_device_outages_total"];
            names.map(|name| find_metric(text, name))
        };
        let before = links(&self.fetch_metrics_text_or_empty());
        let length = self.random.usize(1..16);
        let bytes = (0..length).map(|_| self.random.u8(1..)).collect();
        self.bench.insert_rubbish_into_next_fitting_frame(Rubbish { direction, at: before_byte_index, bytes });
        let taken = wait_until(FRAME, || self.bench.has_no_pending_rubbish()).is_some();
        if !taken && self.bench.withdraw_pending_rubbish() {
            return None;
        }
        Some(self.await_condition_on_metrics_text(
            &format!("neither repeat nor bad frame for byte {before_byte_index}"),
            |text| {
                let now = links(text);
                now.iter().all(Option::is_some) && now != before
            },
        ))
    }

    fn pause_daemon_and_record_detection_and_recovery(&mut self) -> Result<(), Error> {
        let mut driven = Err("every pause came after a stop".to_owned());
        let mut before = 0.0;
        for _ in 0..TRIES {
            driven = self.post_touches_until_high_voltage_is_on();
            before = Self::sum_doubt_outage_and_fault_counts_in_metrics(&self.fetch_metrics_text_or_empty());
            self.daemon.set_paused(true)?;
            // A stop of another client may have come first. Then the rails are discharged by now, and a board that is off misses nobody.
            std::thread::sleep(DISCHARGED_WITHIN);
            if driven.is_err() || self.sim_control().observations_since_start().energised {
                break;
            }
            self.daemon.set_paused(false)?;
        }
        let off = driven.and_then(|()| self.await_high_voltage_off());
        std::thread::sleep(Duration::from_millis(self.random.u64(0..3000)));
        self.daemon.set_paused(false)?;
        let noticed = self.await_condition_on_metrics_text("neither outage nor fault was counted", |text| {
            Self::sum_doubt_outage_and_fault_counts_in_metrics(text) > before
        });
        self.ledger.record_fault_and_print_misses(
            FaultKind::DaemonSuspended,
            later_if_both_seen(off, noticed),
            self.retry_touch_and_measure_time_until_driven(),
        );
        Ok(())
    }

    fn record_end_of_slow_client_and_recovery(&mut self, slow: SlowClient, end: SlowClientEnd) {
        let kind = match slow {
            SlowClient::Nothing => FaultKind::SlowNothing,
            SlowClient::HalfHeader => FaultKind::SlowHeader,
            SlowClient::HalfBody => FaultKind::SlowBody,
            SlowClient::Unread => FaultKind::SlowReader,
        };
        let detected = match end {
            SlowClientEnd::Ended(after) => Ok(after),
            SlowClientEnd::Borne => Err("the daemon still serves this client".into()),
            SlowClientEnd::NotConnected => Err("this client could not connect to the daemon".into()),
            SlowClientEnd::Unknown => return,
        };
        let again = self.retry_touch_and_measure_time_until_driven();
        self.ledger.record_fault_and_print_misses(kind, detected, again);
    }

    fn kill_and_restart_daemon_recording_voltage_off_time_and_recovery(&mut self) -> Result<(), Error> {
        let driven = self.post_touches_until_high_voltage_is_on();
        self.outages += self.fetch_metric_count_or_zero("era_device_outages_total");
        self.faults += self.fetch_metric_count_or_zero("era_device_faults_total");
        self.before_kill = Some(self.daemon.read_memory_threads_and_handles_or_zeros());
        self.world.clear_daemon();
        self.daemon.kill();
        let off = driven.and_then(|()| self.await_high_voltage_off());
        self.daemon = Daemon::start(&self.plan)?;
        self.world.set_serving_daemon_incrementing_generation(self.daemon.address);
        self.ledger.record_fault_and_print_misses(
            FaultKind::Killed,
            off,
            self.retry_touch_and_measure_time_until_driven(),
        );
        Ok(())
    }

    /// What the present daemon has counted of something.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count")]
    pub fn fetch_metric_count_or_zero(&self, name: &str) -> u64 {
        find_metric(&self.fetch_metrics_text_or_empty(), name).unwrap_or(0.0) as u64
    }
}

/// The later of two, both of which have to be seen.
fn later_if_both_seen(one: SeenAfter, other: SeenAfter) -> SeenAfter {
    match (one, other) {
        (Ok(one), Ok(other)) => Ok(one.max(other)),
        (Err(one), Err(other)) => Err(format!("{one}; {other}")),
        (Err(one), Ok(_)) | (Ok(_), Err(one)) => Err(one),
    }
}

/// Looks for as long as that whether high voltage is on again: a board that hears, and that nobody hears, must not be armed.
pub(super) fn check_high_voltage_stays_off_returning_zero_time(
    duration: Duration,
    is_on: impl FnMut() -> bool,
) -> SeenAfter {
    match wait_until(duration, is_on) {
        Some(after) => Err(format!("the board's high voltage was on again {} ms later", after.as_millis())),
        None => Ok(Duration::ZERO),
    }
}

/// After how long something is so, if that comes in time.
pub(super) fn wait_until(time_limit: Duration, is_reached: impl FnMut() -> bool) -> Option<Duration> {
    poll_until(LOOK, time_limit, is_reached)
}

/// The same with another time between two looks.
fn poll_until(interval: Duration, time_limit: Duration, mut is_reached: impl FnMut() -> bool) -> Option<Duration> {
    let begun = Instant::now();
    loop {
        if is_reached() {
            return Some(begun.elapsed());
        }
        if begun.elapsed() >= time_limit {
            return None;
        }
        std::thread::sleep(interval);
    }
}
