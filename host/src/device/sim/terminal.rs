//! The simulated device behind a pseudo-terminal, with the knobs that tests turn.

use super::board::{Clock, Defects, Mistakes, SimBoard};
use super::heard::{Frames, SetFrame};
use super::panel::Panel;
use super::peaks::{TouchPeak, TouchPeaks};
use crate::device::port::{Port as Line, open_pseudo_terminal};
use crate::device::priority;
use era_shared::board::Board;
use era_shared::device::{Device, Port};
use era_shared::limits::DEADMAN_DEFAULT_MS;
use era_shared::link::{Decoder, Frame, Kind, MAX_ENCODED, encode};
use era_shared::protocol::{CURRENT_VERSION, Request};
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
pub struct Knobs {
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
pub struct Watch {
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
struct Wishes {
    knobs: Knobs,
    restart: bool,
    /// Where the accelerometer is to be, for which touch.
    probe: Option<(u64, DVector<f64>)>,
    peaks: TouchPeaks,
    drives_received: Option<Instant>,
    stop_received: Option<Instant>,
    frames: Frames,
    watch: Watch,
    quit: bool,
}

/// Turns the simulated device's knobs, from any thread.
#[derive(Clone, Debug, Default)]
pub struct SimControl(Arc<Mutex<Wishes>>);

impl SimControl {
    /// Sets the knobs.
    pub fn set_knobs(&self, knobs: Knobs) {
        self.lock().knobs = knobs;
    }

    /// Resets the device as its reset pin would: drives end, the session is forgotten, the boot identifier changes.
    pub fn restart(&self) {
        self.lock().restart = true;
    }

    /// Puts the accelerometer where the mode shapes have these values, under the finger of touch `plan_id`: what it shows from then on is that
    /// touch's, until another one's place is set.
    pub fn set_probe(&self, plan_id: u64, shape: DVector<f64>) {
        self.lock().probe = Some((plan_id, shape));
    }

    /// What the accelerometer has shown under each of the last `most` touches, the newest first. Reading it changes nothing.
    #[must_use]
    pub fn touch_peaks(&self, most: usize) -> Vec<TouchPeak> {
        self.lock().peaks.newest_first(most)
    }

    /// The same of one of the last 256 touches.
    #[must_use]
    pub fn touch_peak(&self, plan_id: u64) -> Option<TouchPeak> {
        self.lock().peaks.find_peak(plan_id)
    }

    /// When the last byte of the last frame that set drives was received.
    #[must_use]
    pub fn drives_received(&self) -> Option<Instant> {
        self.lock().drives_received
    }

    /// When the last byte of the last frame that stops everything was received.
    #[must_use]
    pub fn stop_received(&self) -> Option<Instant> {
        self.lock().stop_received
    }

    /// Keeps every frame that sets drives from now on, but no more than the last `most`, for [`Self::take_frames`].
    pub fn keep_frames(&self, most: usize) {
        self.lock().frames = Frames::new(most);
    }

    /// The frames that were kept, in their order; they are kept no more.
    #[must_use]
    pub fn take_frames(&self) -> Vec<SetFrame> {
        self.lock().frames.take()
    }

    /// What the device has seen of itself.
    #[must_use]
    pub fn watch(&self) -> Watch {
        self.lock().watch
    }

    fn lock(&self) -> MutexGuard<'_, Wishes> {
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
    pub fn start(panel: Panel, max_voltages_v: Vec<f64>) -> std::io::Result<Self> {
        Self::start_named(panel, max_voltages_v, SimBoard::ID)
    }

    /// The same with an identifier of its own: another board of its kind.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn start_named(panel: Panel, max_voltages_v: Vec<f64>, board_id: [u8; 12]) -> std::io::Result<Self> {
        let (mut terminal, path) = open_pseudo_terminal()?;
        let control = SimControl::default();
        let wishes = control.clone();
        let thread = std::thread::Builder::new().name("simulated-device".into()).spawn(move || {
            // A board keeps its time whatever else the computer does.
            priority::raise();
            Loop::new(panel, &max_voltages_v, board_id, wishes).run(&mut terminal);
        })?;
        Ok(Self { path, control, thread: Some(thread) })
    }

    /// Path of the serial port to open.
    #[must_use]
    pub fn path(&self) -> &str {
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
        self.control.lock().quit = true;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Loop {
    device: Device,
    board: SimBoard,
    port: Port,
    /// Listens along for frames that ask for drives.
    listener: Decoder,
    /// Takes stops out of what the device hears, where it is made to miss them.
    filter: Decoder,
    control: SimControl,
    answers: u32,
    /// When the last whole frame came in, and after how much silence the host is given up.
    heard: Instant,
    deadman: Duration,
    watch: Watch,
}

impl Loop {
    fn new(panel: Panel, max_voltages_v: &[f64], board_id: [u8; 12], control: SimControl) -> Self {
        let mut board = SimBoard::new(panel, max_voltages_v, Clock::Wall(Instant::now())).named(board_id);
        let mut device = Device::new();
        device.start(&mut board);
        Self {
            device,
            board,
            port: Port::new(LinkId(0)),
            listener: Decoder::new(),
            filter: Decoder::new(),
            control,
            answers: 0,
            heard: Instant::now(),
            deadman: DEADMAN_DEFAULT,
            watch: Watch::default(),
        }
    }

    fn run(mut self, terminal: &mut Line) {
        let mut buffer = [0_u8; 512];
        let mut due_us = 0_u64;
        loop {
            // While an envelope plays the board wants to be asked before the next tick.
            terminal.set_wait(TICK.min(Duration::from_micros(due_us.saturating_sub(self.board.now_us()))));
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
            // After the wait for bytes: a knob that was turned before they were sent counts for them.
            let knobs = {
                let mut wishes = self.control.lock();
                if wishes.quit {
                    return;
                }
                if let Some((plan_id, shape)) = wishes.probe.take() {
                    // What has been until now is of the touch before.
                    self.board.advance();
                    wishes.peaks.note_peak(self.board.panel_mut().accelerometer.peak_here_m_per_s2());
                    wishes.peaks.begin_touch(plan_id);
                    self.board.panel_mut().set_probe(&shape);
                }
                let restart = std::mem::take(&mut wishes.restart);
                let knobs = wishes.knobs;
                drop(wishes);
                if restart {
                    self.restart();
                }
                knobs
            };
            let received_at = Instant::now();
            self.board.set_defects(knobs.defects);
            self.board.set_mistakes(knobs.mistakes);
            if knobs.mistakes.deaf_to_silence {
                self.pretend_life();
            }
            // What has been sent is heard before the silence is judged: a computer that is busy may come late to both.
            if length == 0 || knobs.silent {
                due_us = self.device.poll(&mut self.board);
                self.board.advance();
                self.look(received_at);
                continue;
            }
            let mut answers: Vec<Vec<u8>> = Vec::new();
            let received = buffer.get(..length).unwrap_or_default();
            let missed = knobs.mistakes.deaf_to_stops.then(|| without_stops(&mut self.filter, received));
            let heard = missed.as_deref().unwrap_or(received);
            self.device.receive(&mut self.board, &mut self.port, heard, |answer| answers.push(answer.to_vec()));
            due_us = self.device.poll(&mut self.board);
            self.board.advance();
            if self.board.is_leaving() {
                self.restart();
            }
            self.listen(received, received_at);
            self.look(received_at);
            for answer in answers.into_iter().filter(|_| !knobs.mute) {
                self.answer(terminal, answer, knobs);
            }
        }
    }

    fn answer(&mut self, terminal: &mut Line, mut answer: Vec<u8>, knobs: Knobs) {
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
    fn listen(&mut self, bytes: &[u8], at: Instant) {
        let (mut sets, mut stops) = (Vec::new(), false);
        self.heard += self.board.take_stood();
        let (heard, deadman, watch) = (&mut self.heard, &mut self.deadman, &mut self.watch);
        // The device's logic has just heard it: where this thread came late to that, the silence began later than `at`.
        let now = Instant::now();
        self.listener.feed(bytes, |result| {
            let Some(frame) = result.ok().filter(|frame| frame.kind == Kind::Request as u8) else { return };
            if watch.energised {
                watch.silence = watch.silence.max(now.saturating_duration_since(*heard));
            }
            *heard = now;
            match postcard::from_bytes(frame.body) {
                Ok(Request::SetDrives { drives } | Request::Prepare { drives }) if !drives.is_empty() => {
                    sets.push(SetFrame { at, drives: drives.to_vec() });
                }
                Ok(Request::Stop) => stops = true,
                Ok(Request::Arm { deadman_ms } | Request::ArmWith { deadman_ms, .. }) => {
                    *deadman = deadman_ms.map_or(DEADMAN_DEFAULT, |ms| Duration::from_millis(ms.into()));
                }
                _ => {}
            }
        });
        if !sets.is_empty() || stops {
            let mut wishes = self.control.lock();
            wishes.drives_received = if sets.is_empty() { wishes.drives_received } else { Some(at) };
            wishes.stop_received = if stops { Some(at) } else { wishes.stop_received };
            wishes.frames.keep(sets);
        }
    }

    /// Tells the device's logic that its host lives, which [`Self::listen`] does not hear.
    fn pretend_life(&mut self) {
        let mut frame = [0; MAX_ENCODED];
        if let Ok(length) = encode(CURRENT_VERSION, Kind::Request, 0, &Request::KeepAlive, &mut frame) {
            let frame = frame.get(..length).unwrap_or_default();
            self.device.receive(&mut self.board, &mut self.port, frame, |_| {});
        }
    }

    /// Looks at what the board does, after the device's logic had its turn at `at`.
    fn look(&mut self, at: Instant) {
        // What the board stood still was no silence of its host.
        self.heard += self.board.take_stood();
        let energised = self.board.is_energised();
        let silent = at.saturating_duration_since(self.heard);
        let panel = self.board.panel_mut();
        self.watch = Watch {
            travel_part: self.watch.travel_part.max(panel.take_travel_part()),
            overlaps: panel.overlaps(),
            late: self.watch.late + u64::from(energised && silent > self.deadman + LATE),
            energised,
            silence: self.watch.silence,
        };
        let here_m_per_s2 = panel.accelerometer.peak_here_m_per_s2();
        let mut wishes = self.control.lock();
        wishes.watch = self.watch;
        wishes.peaks.note_peak(here_m_per_s2);
    }

    /// The same panel under a board that has just started.
    fn restart(&mut self) {
        self.board.restart();
        self.device = Device::new();
        self.device.start(&mut self.board);
        self.port.reset();
    }
}

/// The whole requests in these bytes, with signs of life in the place of stops.
fn without_stops(filter: &mut Decoder, bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    filter.feed(bytes, |result| {
        let Ok(Frame { version, sequence, body, .. }) = result else { return };
        let request = match postcard::from_bytes(body) {
            Ok(Request::Stop) => Request::KeepAlive,
            Ok(request) => request,
            Err(_) => return,
        };
        let mut frame = [0; MAX_ENCODED];
        if let Ok(length) = encode(version, Kind::Request, sequence, &request, &mut frame) {
            out.extend_from_slice(frame.get(..length).unwrap_or_default());
        }
    });
    out
}
