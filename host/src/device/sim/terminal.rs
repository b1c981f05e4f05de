//! The simulated device behind a pseudo-terminal, with the knobs that tests turn.

use super::board::{Clock, Defects, Mistakes, SimBoard};
use super::drive_frames::{DriveFrame, DriveFrameRecord};
use super::outputs::SimOutputs;
use super::panel::SimPanel;
use super::peaks::{TouchPeak, TouchPeaks};
use crate::device::port::{SerialPort as Line, open_pseudo_terminal};
use crate::device::priority;
use era_shared::board::Board;
use era_shared::device::{Device, LinkReceiver};
use era_shared::limits::DEADMAN_DEFAULT_MS;
use era_shared::link::{Decoder, Frame, FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::{CURRENT_VERSION, Reply, Request};
use era_shared::safety::LinkId;
use nalgebra::DVector;
use std::io::{ErrorKind, Read, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often the device's loop runs when nothing comes in: the firmware's safety tick.
const TICK: Duration = Duration::from_millis(1);

/// Ways in which the simulated device can misbehave.
#[derive(Clone, Copy, Debug, Default)]
pub struct SimKnobs {
    /// Answers nothing (and hears nothing), but keeps running: a dead line.
    pub silent: bool,
    /// Answers nothing, but hears and does everything: a line that is dead one way.
    pub mute: bool,
    /// Waits this long before each answer.
    pub reply_delay: Duration,
    /// Changes one byte of every n-th answer.
    pub corrupt_every: Option<u32>,
    /// What is wrong with its hardware.
    pub defects: Defects,
    /// What it does wrong.
    pub mistakes: Mistakes,
}

/// Over the dead-man time, before high voltage that is still on counts as late: two ticks of the device's loop.
const LATE: Duration = Duration::from_millis(2);

/// What the simulated device has seen of itself since it was started, whatever its own checks say.
#[derive(Clone, Copy, Debug, Default)]
pub struct SimObservations {
    /// Greatest travel of a mass, as a part of its gap.
    pub travel_part: f64,
    /// Steps of the simulation in which both electrodes of an actuator had voltage.
    pub overlaps: u64,
    /// Looks at which high voltage was enabled though nobody had been heard for the dead-man time.
    pub late: u64,
    /// Whether high voltage is enabled now.
    pub energised: bool,
    /// Longest time between two whole frames while high voltage was enabled.
    pub silence: Duration,
}

/// The dead-man time of a host that asks for none.
const DEADMAN_DEFAULT: Duration = Duration::from_millis(DEADMAN_DEFAULT_MS as u64);

#[derive(Debug, Default)]
struct SimRequests {
    knobs: SimKnobs,
    restart: bool,
    /// Where the accelerometer is to be, for which touch.
    probe: Option<(u64, DVector<f64>)>,
    peaks: TouchPeaks,
    drives_received: Option<Instant>,
    stop_received: Option<Instant>,
    frames: DriveFrameRecord,
    watch: SimObservations,
    outputs: SimOutputs,
    quit: bool,
}

/// Turns the simulated device's knobs, from any thread.
#[derive(Clone, Debug, Default)]
pub struct SimControl(Arc<Mutex<SimRequests>>);

impl SimControl {
    /// Sets the knobs.
    pub fn set_knobs(&self, knobs: SimKnobs) {
        self.lock_requests().knobs = knobs;
    }

    /// Resets the device as its reset pin would: drives end, the session is forgotten, the boot identifier changes.
    pub fn request_restart(&self) {
        self.lock_requests().restart = true;
    }

    /// Puts the accelerometer where the mode shapes have these values, under the finger of touch `plan_id`: what it shows from then on is that
    /// touch's, until another one's place is set.
    pub fn move_accelerometer_to_touch(&self, plan_id: u64, shape: DVector<f64>) {
        self.lock_requests().probe = Some((plan_id, shape));
    }

    /// What the accelerometer has shown under each of the last `max_count` touches, the newest first. Reading it changes nothing.
    #[must_use]
    pub fn peaks_of_newest_touches(&self, max_count: usize) -> Vec<TouchPeak> {
        self.lock_requests().peaks.newest_peaks(max_count)
    }

    /// The peak of one of the last 256 touches.
    #[must_use]
    pub fn peak_of_touch_if_kept(&self, plan_id: u64) -> Option<TouchPeak> {
        self.lock_requests().peaks.find_peak_of_touch_if_kept(plan_id)
    }

    /// When the last byte of the last frame that set drives was received.
    #[must_use]
    pub fn last_drives_received_at(&self) -> Option<Instant> {
        self.lock_requests().drives_received
    }

    /// When the last byte of the last frame that stops everything was received.
    #[must_use]
    pub fn last_stop_received_at(&self) -> Option<Instant> {
        self.lock_requests().stop_received
    }

    /// Keeps every frame that sets drives or has windows from now on, but no more than the last `max_frames`, for [`Self::stop_recording_and_take_recorded_frames`].
    pub fn start_recording_newest_drive_frames(&self, max_frames: usize) {
        self.lock_requests().frames = DriveFrameRecord::new(max_frames);
    }

    /// The frames that were kept, in their order; they are kept no more.
    #[must_use]
    pub fn stop_recording_and_take_recorded_frames(&self) -> Vec<DriveFrame> {
        self.lock_requests().frames.stop_recording_and_take_frames()
    }

    /// What the simulation has observed of the device.
    #[must_use]
    pub fn observations_since_start(&self) -> SimObservations {
        self.lock_requests().watch
    }

    /// What the timers did at the electrodes when the device last ran: at most a ms ago, and after everything that it has answered.
    #[must_use]
    pub fn last_timer_outputs_at_electrodes(&self) -> SimOutputs {
        self.lock_requests().outputs
    }

    fn lock_requests(&self) -> MutexGuard<'_, SimRequests> {
        // Wishes stay whole whatever thread panicked while it held them: every change is one assignment.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A running simulated device; it ends when this is dropped.
#[derive(Debug)]
pub struct SimDevice {
    path: String,
    control: SimControl,
    thread: Option<JoinHandle<()>>,
}

impl SimDevice {
    /// Starts the device in a thread of its own.
    ///
    /// # Errors
    /// If the system gives no pseudo-terminal.
    pub fn start(panel: SimPanel, max_voltages_v: Vec<f64>) -> std::io::Result<Self> {
        Self::start_with_board_id(panel, max_voltages_v, SimBoard::ID)
    }

    /// The same with an identifier of its own: another board of its kind.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn start_with_board_id(panel: SimPanel, max_voltages_v: Vec<f64>, board_id: [u8; 12]) -> std::io::Result<Self> {
        let (mut terminal, path) = open_pseudo_terminal()?;
        let control = SimControl::default();
        let wishes = control.clone();
        let thread = std::thread::Builder::new().name("simulated-device".into()).spawn(move || {
            // A board keeps its time whatever else the computer does.
            priority::raise_thread_priority();
            DeviceLoop::new(panel, &max_voltages_v, board_id, wishes).run_until_quit_even_without_host(&mut terminal);
        })?;
        Ok(Self { path, control, thread: Some(thread) })
    }

    /// Path of the serial port to open.
    #[must_use]
    pub fn port_path(&self) -> &str {
        &self.path
    }

    /// The knobs.
    #[must_use]
    pub fn control(&self) -> SimControl {
        self.control.clone()
    }
}

impl Drop for SimDevice {
    fn drop(&mut self) {
        self.control.lock_requests().quit = true;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct DeviceLoop {
    device: Device,
    board: SimBoard,
    port: LinkReceiver,
    /// Listens along for frames that ask for drives.
    listener: Decoder,
    /// Takes stops out of what the device hears, where it is made to miss them.
    filter: Decoder,
    control: SimControl,
    answers: u32,
    /// When the last whole frame came in, and after how much silence the host is given up.
    heard: Instant,
    deadman: Duration,
    watch: SimObservations,
}

impl DeviceLoop {
    fn new(panel: SimPanel, max_voltages_v: &[f64], board_id: [u8; 12], control: SimControl) -> Self {
        let mut board = SimBoard::new(panel, max_voltages_v, Clock::Wall(Instant::now())).with_board_id(board_id);
        let mut device = Device::new();
        device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut board);
        Self {
            device,
            board,
            port: LinkReceiver::new(LinkId(0)),
            listener: Decoder::new(),
            filter: Decoder::new(),
            control,
            answers: 0,
            heard: Instant::now(),
            deadman: DEADMAN_DEFAULT,
            watch: SimObservations::default(),
        }
    }

    fn run_until_quit_even_without_host(mut self, terminal: &mut Line) {
        let mut buffer = [0_u8; 512];
        let mut due_us = 0_u64;
        loop {
            // While an envelope plays the board wants to be asked before the next tick.
            terminal.set_io_timeout(TICK.min(Duration::from_micros(due_us.saturating_sub(self.board.now_us()))));
            let length = match terminal.read(&mut buffer) {
                Ok(length) => length,
                Err(error)
                    if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) =>
                {
                    0
                }
                // No host has the line open.
                Err(_) => {
                    std::thread::sleep(TICK);
                    0
                }
            };
            // The board's time is this moment until the loop waits again: a computer that keeps the thread waiting in between delays the next round,
            // which does at its time what was due then, and no time passes within what the board does at once.
            let now_us = self.board.now_us();
            self.poll_at_missed_due_times(due_us, now_us);
            self.board.hold_time_at_us(Some(now_us));
            // After the wait for bytes: a knob that was turned before they were sent counts for them.
            let knobs = {
                let mut wishes = self.control.lock_requests();
                if wishes.quit {
                    return;
                }
                if let Some((plan_id, shape)) = wishes.probe.take() {
                    // What has been until now is of the touch before.
                    self.board.advance_panel_to_now();
                    wishes
                        .peaks
                        .raise_peak_of_newest_touch(self.board.panel_mut().accelerometer.peak_since_placed_m_per_s2());
                    wishes.peaks.begin_touch_or_continue_kept_one(plan_id);
                    self.board.panel_mut().place_accelerometer(&shape);
                }
                let restart = std::mem::take(&mut wishes.restart);
                let knobs = wishes.knobs;
                drop(wishes);
                if restart {
                    self.restart_board();
                }
                knobs
            };
            let received_at = Instant::now();
            self.board.set_defects(knobs.defects);
            self.board.set_mistakes(knobs.mistakes);
            if knobs.mistakes.deaf_to_silence {
                self.feed_uncounted_keep_alive();
            }
            // What has been sent is heard before the silence is judged: a computer that is busy may come late to both.
            if length == 0 || knobs.silent {
                due_us = self.device.do_due_work_and_tell_next_due_us(&mut self.board);
                self.board.advance_panel_to_now();
                self.board.hold_time_at_us(None);
                self.update_observations(received_at);
                continue;
            }
            let mut answers: Vec<Vec<u8>> = Vec::new();
            let received = buffer.get(..length).unwrap_or_default();
            let missed =
                knobs.mistakes.deaf_to_stops.then(|| replace_stops_with_keep_alives(&mut self.filter, received));
            let heard = missed.as_deref().unwrap_or(received);
            let received_us = self.board.now_us();
            self.device.receive_bytes(&mut self.board, &mut self.port, heard, |answer| answers.push(answer.to_vec()));
            due_us = self.device.do_due_work_and_tell_next_due_us(&mut self.board);
            self.board.advance_panel_to_now();
            self.board.hold_time_at_us(None);
            if self.board.has_entered_bootloader() {
                self.restart_board();
            }
            let begin_after: Vec<Duration> = find_window_starts_in_accepting_answers_us(&answers)
                .map(|start_us| Duration::from_micros(start_us.saturating_sub(received_us)))
                .collect();
            self.note_request_times_drive_frames_and_deadman(received, received_at, &begin_after);
            self.update_observations(received_at);
            for answer in answers.into_iter().filter(|_| !knobs.mute) {
                self.send_answer_delayed_or_corrupted_by_knobs(terminal, answer, knobs);
            }
        }
    }

    /// Does at its time what was due while the computer kept this thread waiting: a board would have, and windows that are given one by one
    /// need each of their periods prepared in time.
    fn poll_at_missed_due_times(&mut self, mut due_us: u64, now_us: u64) {
        while due_us < now_us {
            self.board.hold_time_at_us(Some(due_us));
            due_us = self.device.do_due_work_and_tell_next_due_us(&mut self.board).max(due_us + 1);
        }
    }

    fn send_answer_delayed_or_corrupted_by_knobs(&mut self, terminal: &mut Line, mut answer: Vec<u8>, knobs: SimKnobs) {
        self.answers = self.answers.wrapping_add(1);
        let until = Instant::now() + knobs.reply_delay;
        while Instant::now() < until {
            std::thread::sleep(TICK.min(knobs.reply_delay));
            // It is the board that is slow, and its time goes on.
            self.board.now_us();
        }
        if knobs.corrupt_every.is_some_and(|every| self.answers.is_multiple_of(every.max(1)))
            && let Some(byte) = answer.first_mut()
        {
            *byte ^= 0x10;
        }
        if let Err(error) = terminal.write_all(&answer) {
            tracing::debug!(%error, "the simulated device could not answer");
        }
    }

    /// Notes when frames that set drives, or stop everything, have become complete.
    fn note_request_times_drive_frames_and_deadman(
        &mut self,
        bytes: &[u8],
        received_at: Instant,
        windows_begin_after: &[Duration],
    ) {
        let (mut sets, mut windows, mut stops) = (Vec::new(), Vec::new(), false);
        self.heard += self.board.take_stalled_time_since_last_call();
        let (heard, deadman, watch) = (&mut self.heard, &mut self.deadman, &mut self.watch);
        // The device's logic has just heard it: where this thread came late to that, the silence began later than `at`.
        let now = Instant::now();
        self.listener.feed_bytes(bytes, |result| {
            let Some(frame) = result.ok().filter(|frame| frame.kind == FrameKind::Request as u8) else { return };
            if watch.energised {
                watch.silence = watch.silence.max(now.saturating_duration_since(*heard));
            }
            *heard = now;
            match postcard::from_bytes(frame.body) {
                Ok(Request::SetDrives { drives } | Request::Prepare { drives }) if !drives.is_empty() => {
                    let drives = drives.to_vec();
                    sets.push(DriveFrame { at: received_at, drives, window_count: 0, windows_begin_after: None });
                }
                Ok(Request::PlayWindows(sequence)) => {
                    let window_count = sequence.windows.len();
                    let windows_begin_after = windows_begin_after.get(windows.len()).copied();
                    windows.push(DriveFrame { at: received_at, drives: Vec::new(), window_count, windows_begin_after });
                }
                Ok(Request::Stop) => stops = true,
                Ok(Request::Arm { deadman_ms } | Request::ArmWith { deadman_ms, .. }) => {
                    *deadman = deadman_ms.map_or(DEADMAN_DEFAULT, |ms| Duration::from_millis(ms.into()));
                }
                _ => {}
            }
        });
        if !sets.is_empty() || !windows.is_empty() || stops {
            let mut wishes = self.control.lock_requests();
            wishes.drives_received = if sets.is_empty() { wishes.drives_received } else { Some(received_at) };
            wishes.stop_received = if stops { Some(received_at) } else { wishes.stop_received };
            wishes.frames.add_frames(sets);
            wishes.frames.add_frames(windows);
        }
    }

    /// Gives the device's logic a sign of life that [`Self::note_request_times_drive_frames_and_deadman`] does not count.
    fn feed_uncounted_keep_alive(&mut self) {
        let mut frame = [0; MAX_ENCODED];
        if let Ok(length) = encode_frame(CURRENT_VERSION, FrameKind::Request, 0, &Request::KeepAlive, &mut frame) {
            let frame = frame.get(..length).unwrap_or_default();
            self.device.receive_bytes(&mut self.board, &mut self.port, frame, |_| {});
        }
    }

    /// Updates the observations of the board, after the device's logic was polled at `at`.
    fn update_observations(&mut self, polled_at: Instant) {
        // What the board stood still was no silence of its host.
        self.heard += self.board.take_stalled_time_since_last_call();
        let energised = self.board.is_high_voltage_enabled();
        let silent = polled_at.saturating_duration_since(self.heard);
        let panel = self.board.panel_mut();
        self.watch = SimObservations {
            travel_part: self.watch.travel_part.max(panel.take_largest_travel_as_fraction_of_gap_since_last_call()),
            overlaps: panel.count_steps_with_both_electrodes_on(),
            late: self.watch.late + u64::from(energised && silent > self.deadman + LATE),
            energised,
            silence: self.watch.silence,
        };
        let (outputs, here_m_per_s2) =
            (panel.timer_outputs_at_electrodes_now(), panel.accelerometer.peak_since_placed_m_per_s2());
        let mut wishes = self.control.lock_requests();
        wishes.watch = self.watch;
        wishes.outputs = outputs;
        wishes.peaks.raise_peak_of_newest_touch(here_m_per_s2);
    }

    /// The same panel under a board that has just started.
    fn restart_board(&mut self) {
        self.board.hold_time_at_us(None);
        self.board.restart_keeping_panel_motion_and_rail_voltages();
        self.device = Device::new();
        self.device.restore_credit_and_complete_boot_to_discharging_or_fault(&mut self.board);
        self.port.discard_partial_frame();
    }
}

/// The complete requests in these bytes, with every stop replaced by a sign of life.
fn replace_stops_with_keep_alives(decoder: &mut Decoder, bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    decoder.feed_bytes(bytes, |result| {
        let Ok(Frame { version, sequence, body, .. }) = result else { return };
        let request = match postcard::from_bytes(body) {
            Ok(Request::Stop) => Request::KeepAlive,
            Ok(request) => request,
            Err(_) => return,
        };
        let mut frame = [0; MAX_ENCODED];
        if let Ok(length) = encode_frame(version, FrameKind::Request, sequence, &request, &mut frame) {
            out.extend_from_slice(frame.get(..length).unwrap_or_default());
        }
    });
    out
}

/// When the windows begin that answers accept, in us of the board's time, in their order.
fn find_window_starts_in_accepting_answers_us(answers: &[Vec<u8>]) -> impl Iterator<Item = u64> {
    let mut starts_us = Vec::new();
    let mut decoder = Decoder::new();
    for answer in answers {
        decoder.feed_bytes(answer, |frame| {
            if let Ok(frame) = frame
                && let Ok(Reply::WindowsPlaying { start_us }) = postcard::from_bytes(frame.body)
            {
                starts_us.push(start_us);
            }
        });
    }
    starts_us.into_iter()
}
