//! A device under test: a client on its link, and what can be done to it from outside.

use crate::outputs::{ChannelOutputs, CheckRecord, OutputCheck, convert_simulated_outputs, read_emulated_outputs};
use era::device::sim::{SimControl, SimKnobs, SimPanel};
use era::device::{Client, LinkError, OpenDevice, Target};
use era::planner::softening::Transducer;
use era::transient::reduced::ModalSystem;
use era_shared::MAX_CHANNELS;
use era_shared::limits::{BURST_MAX_MS, REST_MS};
use era_shared::link::{Decoder, Frame, FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::{
    AchievedDrive, CURRENT_VERSION, ChannelDrive, DetailsReply, MIN_VERSION, Refusal, Reply, Request, StatusReply,
    WelcomeReply,
};
use era_shared::safety::SafetyState;
use nalgebra::{DMatrix, DVector};
use serde_json::json;
use std::cell::RefCell;
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// What a case comes to: `Err` says what was wrong.
pub type CaseResult = Result<(), String>;

/// Voltage of all drives of the suite in mV: harmless on a real board with a real supply.
pub const VOLTAGE_MILLIVOLTS: u32 = 50_000;

/// A device under test.
#[derive(Debug)]
pub struct Bench {
    pub(crate) device: OpenDevice,
    pub(crate) checks: RefCell<CheckRecord>,
}

impl Bench {
    /// A simulated device over a panel of one mode.
    ///
    /// # Errors
    /// If the system gives no pseudo-terminal.
    pub fn start_simulated() -> Result<Self, String> {
        Self::open_target(&Target::Sim, make_one_mode_panel)
    }

    pub(crate) fn start_emulated() -> Result<Self, String> {
        Self::open_target(&Target::Emulated, make_empty_panel)
    }

    /// A board at this serial port.
    ///
    /// # Errors
    /// If the port cannot be opened.
    pub fn open_board(port: &str) -> Result<Self, String> {
        Self::open_target(&Target::Serial(port.into()), make_empty_panel)
    }

    fn open_target(target: &Target, panel: impl FnOnce() -> (SimPanel, Vec<f64>)) -> Result<Self, String> {
        let device = OpenDevice::open(target, panel).map_err(|error| error.to_string())?;
        Ok(Self { device, checks: RefCell::default() })
    }

    /// A fresh client, on a device that is safe, rested and without a fault.
    ///
    /// # Errors
    /// If the device does not answer.
    pub fn begin_session(&self) -> Result<TestSession<'_>, String> {
        let mut session = TestSession { client: self.open_client()?, bench: self };
        session.send_request(&Request::Stop)?;
        match session.client.request(&Request::ClearFaults) {
            Ok(Reply::FaultsCleared) => {}
            other => return Err(format!("clear-faults was answered with {other:?}")),
        }
        session.await_state(SafetyState::Safe)?;
        // What was driven in an earlier case does not count as part of this one's burst.
        self.wait_silently(Duration::from_millis(u64::from(REST_MS) + 20))?;
        Ok(session)
    }

    fn open_client(&self) -> Result<Client, String> {
        self.device.open_client().map_err(|error| error.to_string())
    }

    /// The checks of outputs since the last call, and whether each was observed.
    pub(crate) fn take_check_record(&self) -> CheckRecord {
        self.checks.take()
    }

    /// The simulated device's knobs.
    #[must_use]
    pub fn sim_control(&self) -> Option<SimControl> {
        self.device.sim_control_if_simulated()
    }

    /// Turns the simulated device's knobs, back when the guard is dropped.
    #[must_use]
    pub fn set_knobs_until_dropped(control: &SimControl, knobs: SimKnobs) -> KnobsGuard<'_> {
        control.set_knobs(knobs);
        KnobsGuard(control)
    }

    /// Resets the device from outside.
    ///
    /// # Errors
    /// If the emulator fails, or the target cannot be reset.
    pub fn reset_device(&self) -> CaseResult {
        if let Some(control) = self.device.sim_control_if_simulated() {
            control.request_restart();
            // The device looks at its knobs every ms.
            std::thread::sleep(Duration::from_millis(50));
            return Ok(());
        }
        let board = self.device.emulated_board_if_emulated().ok_or("this target cannot be reset from here")?;
        board
            .send_bridge_command_and_await_answer(&json!({"op": "inject", "reset": "pin"}))
            .map(|_| ())
            .map_err(|error| error.to_string())
    }

    /// The outputs of all channels, for this check. If they cannot be observed, this is `None`, and the check is recorded
    /// as not observed.
    ///
    /// # Errors
    /// If the emulator fails.
    pub fn observe_outputs_for(&self, check: OutputCheck) -> Result<Option<Vec<ChannelOutputs>>, String> {
        let emulated = self.device.emulated_board_if_emulated().map(read_emulated_outputs).transpose();
        let simulated =
            || self.sim_control().map(|control| convert_simulated_outputs(&control.last_timer_outputs_at_electrodes()));
        let outputs = emulated.map_err(|error| error.to_string())?.or_else(simulated);
        self.checks.borrow_mut().insert(check, outputs.is_some());
        Ok(outputs)
    }

    /// Lets `time` pass on the device's own clock without a word to it.
    ///
    /// # Errors
    /// If the emulator fails.
    pub fn wait_silently(&self, time: Duration) -> CaseResult {
        match self.device.emulated_board_if_emulated() {
            Some(board) => {
                let command = json!({"op": "run_for", "seconds": time.as_secs_f64()});
                board.send_bridge_command_and_await_answer(&command).map(|_| ()).map_err(|error| error.to_string())
            }
            None => {
                let sim_time_s = || self.sim_control().map(|control| control.last_timer_outputs_at_electrodes().time_s);
                let (begun, end_s) = (Instant::now(), sim_time_s().map(|now_s| now_s + time.as_secs_f64()));
                std::thread::sleep(time);
                // The simulated device's clock stands still while the computer does.
                while sim_time_s() < end_s && begun.elapsed() < time + Duration::from_secs(10) {
                    std::thread::sleep(Duration::from_millis(1));
                }
                Ok(())
            }
        }
    }

    /// Writes bytes to the device's port and returns the frames that come back until it is quiet.
    ///
    /// # Errors
    /// If the port fails.
    pub fn exchange_raw_bytes(&self, pieces: &[&[u8]]) -> Result<Vec<(u8, u16, Reply)>, String> {
        let mut port = self.device.open_transport().map_err(|error| error.to_string())?;
        for piece in pieces {
            port.write_all(piece).and_then(|()| port.flush()).map_err(|error| error.to_string())?;
        }
        let mut decoder = Decoder::new();
        let mut replies = Vec::new();
        let quiet = if self.device.emulated_board_if_emulated().is_some() {
            Duration::from_secs(2)
        } else {
            Duration::from_millis(300)
        };
        let mut last = Instant::now();
        let mut buffer = [0; 512];
        while last.elapsed() < quiet {
            match port.read(&mut buffer) {
                Ok(length) => {
                    last = Instant::now();
                    let take = |frame: Frame<'_>| {
                        let reply = postcard::from_bytes(frame.body).ok()?;
                        Some((frame.version, frame.sequence, reply))
                    };
                    decoder.feed_bytes(buffer.get(..length).unwrap_or_default(), |result| {
                        replies.extend(result.ok().and_then(take));
                    });
                }
                Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => {}
                Err(error) => return Err(error.to_string()),
            }
        }
        Ok(replies)
    }
}

/// A panel of one mode, and the voltage limits of its channels.
#[must_use]
pub fn make_one_mode_panel() -> (SimPanel, Vec<f64>) {
    // 100 Hz, 5 % damping, a force for each channel: the suite is about the device, not about the panel.
    let omega = std::f64::consts::TAU * 100.0;
    let system = ModalSystem {
        lambda: DVector::from_element(1, omega * omega),
        damping: DMatrix::from_element(1, 1, 0.1 * omega),
        force: DMatrix::from_element(1, MAX_CHANNELS, 1.0),
    };
    (SimPanel::new(&system, vec![Transducer::with_fixed_force(3e-8); MAX_CHANNELS]), vec![2000.0; MAX_CHANNELS])
}

fn make_empty_panel() -> (SimPanel, Vec<f64>) {
    let none = ModalSystem { lambda: DVector::zeros(0), damping: DMatrix::zeros(0, 0), force: DMatrix::zeros(0, 0) };
    (SimPanel::new(&none, Vec::new()), Vec::new())
}

/// Puts the knobs back.
#[derive(Debug)]
pub struct KnobsGuard<'a>(&'a SimControl);

impl Drop for KnobsGuard<'_> {
    fn drop(&mut self) {
        self.0.set_knobs(SimKnobs::default());
    }
}

/// One host's time with the device.
pub struct TestSession<'a> {
    /// Its end of the link.
    pub client: Client,
    bench: &'a Bench,
}

impl TestSession<'_> {
    /// The reply to a request; a refusal is an error.
    ///
    /// # Errors
    /// As the link.
    pub fn send_request(&mut self, request: &Request) -> Result<Reply, String> {
        self.client.request(request).map_err(|error| error.to_string())
    }

    /// The refusal of a request; anything else is an error.
    ///
    /// # Errors
    /// If it was not refused.
    pub fn expect_refusal(&mut self, request: &Request) -> Result<Refusal, String> {
        match self.client.request(request) {
            Err(LinkError::Refused(refusal)) => Ok(refusal),
            other => Err(format!("expected a refusal, got {other:?}")),
        }
    }

    /// Arms with the longest dead-man time and burst, so that a slow machine does not end the session, and waits for the self-test.
    ///
    /// # Errors
    /// As the link, or if the self-test fails.
    pub fn arm_and_await_armed(&mut self) -> CaseResult {
        match self.send_request(&Request::ArmWith { deadman_ms: Some(1000), burst_ms: Some(BURST_MAX_MS) })? {
            Reply::ArmedWith { deadman_ms: 1000, burst_ms: BURST_MAX_MS } => {}
            other => return Err(format!("arm was answered with {other:?}")),
        }
        self.await_state(SafetyState::Armed)
    }

    /// Waits for a state, over those that pass by themselves: self-test and discharge.
    ///
    /// # Errors
    /// If another state comes, or none within the time that an emulated board may need.
    pub fn await_state(&mut self, wanted: SafetyState) -> CaseResult {
        self.await_state_over(wanted, |state| {
            matches!(state, SafetyState::Boot | SafetyState::Arming | SafetyState::Discharging)
        })
    }

    /// Waits for a fault, over everything else.
    ///
    /// # Errors
    /// If none comes within the time that an emulated board may need.
    pub fn await_fault(&mut self) -> CaseResult {
        self.await_state_over(SafetyState::Fault, |_| true)
    }

    fn await_state_over(&mut self, wanted: SafetyState, passing: impl Fn(SafetyState) -> bool) -> CaseResult {
        let begun = Instant::now();
        loop {
            let state = match self.send_request(&Request::KeepAlive)? {
                Reply::Alive { state } => state,
                other => return Err(format!("keep-alive was answered with {other:?}")),
            };
            if state == wanted {
                return Ok(());
            }
            if !passing(state) || begun.elapsed() > Duration::from_secs(20) {
                return Err(format!("waited for {}, but the device is {}", wanted.name(), state.name()));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// What is measured, and what is still allowed.
    ///
    /// # Errors
    /// As the link.
    pub fn request_details(&mut self) -> Result<DetailsReply, String> {
        match self.send_request(&Request::Details)? {
            Reply::Details(details) => Ok(details),
            other => Err(format!("details was answered with {other:?}")),
        }
    }

    /// The board's time in us.
    ///
    /// # Errors
    /// As the link.
    pub fn request_clock_us(&mut self) -> Result<u64, String> {
        match self.send_request(&Request::Clock)? {
            Reply::Clock { now_us } => Ok(now_us),
            other => Err(format!("clock was answered with {other:?}")),
        }
    }

    /// Number of channels of the device.
    ///
    /// # Errors
    /// As the link.
    pub fn request_channel_count(&mut self) -> Result<u8, String> {
        u8::try_from(self.request_hello()?.channels.len()).map_err(|error| error.to_string())
    }

    /// Disarms, or stops with [`TestSession::send_request`], and waits until the device says that it is safe.
    ///
    /// # Errors
    /// As the link, or if it does not become safe.
    pub fn disarm_and_await_safe(&mut self) -> CaseResult {
        self.send_request(&Request::Disarm)?;
        self.await_state(SafetyState::Safe)
    }

    /// Sets drives and returns what is achieved.
    ///
    /// # Errors
    /// As the link.
    pub fn set_drives(&mut self, drives: &[ChannelDrive]) -> Result<Vec<AchievedDrive>, String> {
        let drives = heapless::Vec::from_slice(drives).map_err(|_| "too many drives")?;
        match self.send_request(&Request::SetDrives { drives })? {
            Reply::DrivesSet { achieved } => Ok(achieved.to_vec()),
            other => Err(format!("set-drives was answered with {other:?}")),
        }
    }

    /// The device's status.
    ///
    /// # Errors
    /// As the link.
    pub fn request_status(&mut self) -> Result<StatusReply, String> {
        match self.send_request(&Request::Status)? {
            Reply::Status(status) => Ok(status),
            other => Err(format!("status was answered with {other:?}")),
        }
    }

    /// The status, which must show this state, and outputs to match.
    ///
    /// # Errors
    /// If it does not.
    pub fn expect_state(&mut self, wanted: SafetyState) -> Result<StatusReply, String> {
        let status = self.request_status()?;
        check_equal("state", status.state, wanted)?;
        let driving = status.channels.iter().any(|channel| channel.drive.is_some());
        check_equal("some channel drives", driving, wanted == SafetyState::Running)?;
        if wanted == SafetyState::Armed {
            // Drives that were taken off end with their periods; the electrodes are then disconnected.
            self.bench.wait_silently(Duration::from_millis(20))?;
        }
        if let Some(outputs) = self.bench.observe_outputs_for(OutputCheck::Energised)? {
            let energised = outputs.iter().any(|channel| channel.energised);
            check_equal("some timer energises electrodes", energised, wanted == SafetyState::Running)?;
        }
        Ok(status)
    }

    /// The identity of the device.
    ///
    /// # Errors
    /// As the link.
    pub fn request_hello(&mut self) -> Result<WelcomeReply, String> {
        match self.send_request(&Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION })? {
            Reply::Welcome(welcome) => Ok(welcome),
            other => Err(format!("hello was answered with {other:?}")),
        }
    }
}

/// A drive of the suite.
#[must_use]
pub const fn make_drive(channel: u8, frequency_millihertz: u32) -> ChannelDrive {
    ChannelDrive {
        channel,
        frequency_millihertz,
        pulse_width_ppm: 666_667,
        phase_microturns: 0,
        voltage_millivolts: VOLTAGE_MILLIVOLTS,
    }
}

/// One encoded request.
///
/// # Errors
/// If it does not fit a frame.
pub fn encode_request_frame(version: u8, sequence: u16, request: &Request) -> Result<Vec<u8>, String> {
    let mut out = [0; MAX_ENCODED];
    let length =
        encode_frame(version, FrameKind::Request, sequence, request, &mut out).map_err(|error| format!("{error:?}"))?;
    Ok(out.get(..length).unwrap_or_default().to_vec())
}

/// `Err` unless the two are equal.
///
/// # Errors
/// With both values.
pub fn check_equal<T: PartialEq + std::fmt::Debug>(quantity: &str, found: T, wanted: T) -> CaseResult {
    if found == wanted { Ok(()) } else { Err(format!("{quantity}: found {found:?}, wanted {wanted:?}")) }
}

/// No electrode's pin is left to a timer, and none is high.
///
/// # Errors
/// With the pins.
pub fn check_pins_low(bench: &Bench) -> CaseResult {
    let Some(outputs) = bench.observe_outputs_for(OutputCheck::PinsLow)? else { return Ok(()) };
    let not_low: Vec<String> = outputs.into_iter().flat_map(|channel| channel.pins_not_low).collect();
    check_equal("pins of electrodes that are not held low", not_low, Vec::new())
}
