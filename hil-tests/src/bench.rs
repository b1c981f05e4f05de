//! A device under test: a client on its link, and what can be done to it from outside.

use era::device::emulated::CHANNEL_TIMERS;
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
use era_shared::waveform::TimerRegisters;
use nalgebra::{DMatrix, DVector};
use serde_json::json;
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
}

impl Bench {
    /// A simulated device over a panel of one mode.
    pub(crate) fn start_simulated() -> Result<Self, String> {
        // 100 Hz, 5 % damping, a force for each channel: the suite is about the device, not about the panel.
        let omega = std::f64::consts::TAU * 100.0;
        let system = ModalSystem {
            lambda: DVector::from_element(1, omega * omega),
            damping: DMatrix::from_element(1, 1, 0.1 * omega),
            force: DMatrix::from_element(1, MAX_CHANNELS, 1.0),
        };
        let panel = || {
            (SimPanel::new(&system, vec![Transducer::with_fixed_force(3e-8); MAX_CHANNELS]), vec![2000.0; MAX_CHANNELS])
        };
        Self::open_target(&Target::Sim, panel)
    }

    pub(crate) fn start_emulated() -> Result<Self, String> {
        Self::open_target(&Target::Emulated, make_empty_panel)
    }

    pub(crate) fn open_board(port: &str) -> Result<Self, String> {
        Self::open_target(&Target::Serial(port.into()), make_empty_panel)
    }

    fn open_target(target: &Target, panel: impl FnOnce() -> (SimPanel, Vec<f64>)) -> Result<Self, String> {
        Ok(Self { device: OpenDevice::open(target, panel).map_err(|error| error.to_string())? })
    }

    /// A fresh client, on a device that is safe, rested and without a fault.
    ///
    /// # Errors
    /// If the device does not answer.
    pub fn begin_session(&self) -> Result<TestSession<'_>, String> {
        let mut session = TestSession { client: self.open_client()?, bench: self };
        session.request(&Request::Stop)?;
        match session.client.request(&Request::ClearFaults) {
            Ok(Reply::FaultsCleared) => {}
            other => return Err(format!("clear-faults was answered {other:?}")),
        }
        session.await_state(SafetyState::Safe)?;
        // What was driven in an earlier case does not count as part of this one's burst.
        self.wait_silently(Duration::from_millis(u64::from(REST_MS) + 20))?;
        Ok(session)
    }

    fn open_client(&self) -> Result<Client, String> {
        self.device.open_client().map_err(|error| error.to_string())
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

    /// The timers' registers, where they can be seen: in the emulator.
    ///
    /// # Errors
    /// If the emulator fails.
    pub fn read_timer_registers(&self) -> Result<Option<Vec<TimerRegisters>>, String> {
        self.device
            .emulated_board_if_emulated()
            .map(|board| board.read_timer_registers().map_err(|error| error.to_string()))
            .transpose()
    }

    /// Counter and ticks in a period of each channel's timer, all at one moment, where they can be seen: in the emulator.
    ///
    /// # Errors
    /// If the emulator fails.
    pub fn read_counters_and_periods(&self) -> Result<Option<Vec<(u32, u32)>>, String> {
        let Some(board) = self.device.emulated_board_if_emulated() else { return Ok(None) };
        let answer =
            board.send_bridge_command_and_await_answer(&json!({"op": "timers"})).map_err(|error| error.to_string())?;
        let register = |timer: &str, key: &str| {
            let value = answer["timers"][timer][key].as_u64().and_then(|value| u32::try_from(value).ok());
            value.ok_or_else(|| format!("no register {key} of {timer}"))
        };
        let count = |timer: &&str| Ok((register(timer, "cnt")?, register(timer, "arr")? + 1));
        CHANNEL_TIMERS.iter().map(count).collect::<Result<Vec<_>, String>>().map(Some)
    }

    /// How each electrode's pin is driven, where it can be seen.
    ///
    /// # Errors
    /// If the emulator fails.
    pub fn read_pins(&self) -> Result<Option<serde_json::Value>, String> {
        let ask = |board: &era::device::emulated::EmulatedBoard| {
            board.send_bridge_command_and_await_answer(&json!({"op": "pins"}))
        };
        self.device.emulated_board_if_emulated().map(|board| ask(board).map_err(|error| error.to_string())).transpose()
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
                std::thread::sleep(time);
                Ok(())
            }
        }
    }

    /// Lets `time` pass where the timers can be looked at, and where a slow drive would otherwise be looked at too early.
    ///
    /// # Errors
    /// If the emulator fails.
    pub fn wait_if_emulated(&self, time: Duration) -> CaseResult {
        if self.device.emulated_board_if_emulated().is_some() { self.wait_silently(time) } else { Ok(()) }
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
    pub fn request(&mut self, request: &Request) -> Result<Reply, String> {
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
    pub fn arm(&mut self) -> CaseResult {
        match self.request(&Request::ArmWith { deadman_ms: Some(1000), burst_ms: Some(BURST_MAX_MS) })? {
            Reply::ArmedWith { deadman_ms: 1000, burst_ms: BURST_MAX_MS } => {}
            other => return Err(format!("arm was answered {other:?}")),
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
            let state = match self.request(&Request::KeepAlive)? {
                Reply::Alive { state } => state,
                other => return Err(format!("keep-alive was answered {other:?}")),
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
        match self.request(&Request::Details)? {
            Reply::Details(details) => Ok(details),
            other => Err(format!("details was answered {other:?}")),
        }
    }

    /// The board's time in us.
    ///
    /// # Errors
    /// As the link.
    pub fn request_clock_us(&mut self) -> Result<u64, String> {
        match self.request(&Request::Clock)? {
            Reply::Clock { now_us } => Ok(now_us),
            other => Err(format!("clock was answered {other:?}")),
        }
    }

    /// Number of channels of the device.
    ///
    /// # Errors
    /// As the link.
    pub fn channel_count(&mut self) -> Result<u8, String> {
        u8::try_from(self.request_hello()?.channels.len()).map_err(|error| error.to_string())
    }

    /// Disarms, or stops with [`TestSession::request`], and waits until the device says that it is safe.
    ///
    /// # Errors
    /// As the link, or if it does not become safe.
    pub fn disarm(&mut self) -> CaseResult {
        self.request(&Request::Disarm)?;
        self.await_state(SafetyState::Safe)
    }

    /// Sets drives and returns what is achieved.
    ///
    /// # Errors
    /// As the link.
    pub fn set_drives(&mut self, drives: &[ChannelDrive]) -> Result<Vec<AchievedDrive>, String> {
        let drives = heapless::Vec::from_slice(drives).map_err(|_| "too many drives")?;
        match self.request(&Request::SetDrives { drives })? {
            Reply::DrivesSet { achieved } => Ok(achieved.to_vec()),
            other => Err(format!("set-drives was answered {other:?}")),
        }
    }

    /// The device's status.
    ///
    /// # Errors
    /// As the link.
    pub fn request_status(&mut self) -> Result<StatusReply, String> {
        match self.request(&Request::Status)? {
            Reply::Status(status) => Ok(status),
            other => Err(format!("status was answered {other:?}")),
        }
    }

    /// The status, which must show this state and, in the emulator, outputs to match.
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
        if let Some(timers) = self.bench.read_timer_registers()? {
            let energised = timers.iter().any(TimerRegisters::is_counting_with_outputs_enabled);
            check_equal("some timer energises electrodes", energised, wanted == SafetyState::Running)?;
        }
        Ok(status)
    }

    /// The identity of the device.
    ///
    /// # Errors
    /// As the link.
    pub fn request_hello(&mut self) -> Result<WelcomeReply, String> {
        match self.request(&Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION })? {
            Reply::Welcome(welcome) => Ok(welcome),
            other => Err(format!("hello was answered {other:?}")),
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

/// In the emulator: no electrode's pin is left to a timer, and none is high.
///
/// # Errors
/// With the pin.
pub fn check_pins_low(bench: &Bench) -> CaseResult {
    let Some(pins) = bench.read_pins()? else { return Ok(()) };
    for name in (1..=4).flat_map(|era| [format!("era{era}_a"), format!("era{era}_b")]) {
        let pin = &pins["pins"][&name];
        check_equal(
            &format!("{name} is an output held low: {pin}"),
            pin["mode"] == "output" && pin["high"] == false,
            true,
        )?;
    }
    Ok(())
}
