//! The board under test: asked through its serial link, looked at and disturbed through the bridge.

use super::super::bridge::{Bridge, Pace};
use super::super::link::{Link, exchange_bytes_until_first_frame};
use super::channels::CHANNELS;
use super::edges::{PinEdges, TimerChange};
use crate::error::Error;
use era_shared::protocol::{ChannelDrive, Fault, Refusal, Reply, Request, StatusReply};
use era_shared::safety::SafetyState;
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Clocks in a ms.
pub const CLOCKS_PER_MS: f64 = 170_000.0;
/// How often a state that is waited for is looked at.
const LOOKS: u32 = 100;
/// How often the host of this report says that it is there, in s: well below the dead-man time.
const KEEP_ALIVE_S: f64 = 0.05;

/// The board, paused but for what it is told to do.
pub struct EmulatedBoard {
    bridge: Bridge,
    link: Link,
    /// What the pins have done.
    pub edges: PinEdges,
}

/// Registers of one timer by name.
pub type Registers = BTreeMap<String, u32>;

#[derive(Deserialize)]
struct Timers {
    timers: BTreeMap<String, Registers>,
}

#[derive(Deserialize)]
struct History {
    history: Vec<TimerChange>,
    lost: u64,
}

/// State of one pin.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub struct Pin {
    /// `input`, `output`, `timer` or `analog`.
    pub mode: String,
    /// Level of an output.
    pub high: Option<bool>,
    /// Level outside, whatever the chip says; the windows that a timer makes are not in it.
    pub pad: bool,
}

#[derive(Deserialize)]
struct SymbolAddress {
    address: u32,
}

#[derive(Deserialize)]
struct MemoryWord {
    value: u32,
}

#[derive(Deserialize)]
struct Pins {
    pins: BTreeMap<String, Pin>,
}

/// Rails as they are.
#[derive(Clone, Debug, Deserialize)]
pub struct Rails {
    /// Codes of the set-points.
    pub rails: [u16; 2],
    /// True voltages in V.
    pub rail_volts: [f64; 2],
}

impl EmulatedBoard {
    /// Powers the board up.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn start(image: &Path) -> Result<Self, Error> {
        Ok(Self { bridge: Bridge::start(image, Pace::Paused)?, link: Link::default(), edges: PinEdges::default() })
    }

    /// Power off and on, everything healed, nothing known of the pins.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn power_cycle_healing_faults(&mut self) -> Result<(), Error> {
        self.power_cycle_with_fault_and_time_boot_ms(&json!({})).map(|_| ())
    }

    /// Power off and on, with this fault there from the beginning; the time in ms until the firmware is up.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn power_cycle_with_fault_and_time_boot_ms(&mut self, fault: &Value) -> Result<f64, Error> {
        Ok(self.restart_with_fault(fault)?["boot_virtual_s"].as_f64().unwrap_or(f64::NAN) * 1e3)
    }

    /// Power off and on, with resistors missing that hold pins low; for how long after a reset a pad that can energise something was high, in ms.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn power_cycle_without_pull_downs_and_time_high_pads_ms(&mut self) -> Result<f64, Error> {
        let answer = self.restart_with_fault(&json!({"pull_downs": "missing"}))?;
        Ok(answer["high_after_reset_s"].as_f64().unwrap_or(f64::NAN) * 1e3)
    }

    fn restart_with_fault(&mut self, fault: &Value) -> Result<Value, Error> {
        let answer = self.bridge.send_command(&json!({"op": "restart", "inject": fault}))?;
        self.edges = PinEdges::default();
        Ok(answer)
    }

    /// One request.
    ///
    /// # Errors
    /// [`Error::NoReply`], [`Error::Bridge`].
    pub fn send_request(&mut self, request: &Request) -> Result<Reply, Error> {
        self.link.send_request(&mut self.bridge, request)
    }

    /// One request in the words of another protocol version.
    ///
    /// # Errors
    /// As [`Self::send_request`].
    pub fn send_request_as_version(&mut self, version: u8, request: &Request) -> Result<Reply, Error> {
        self.link.send_request_as_version(&mut self.bridge, version, request)
    }

    /// Bytes that need not be a frame, and what comes back within `limit_s`.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn exchange_raw_bytes_until_first_frame(&mut self, bytes: &[u8], limit_s: f64) -> Result<Vec<u8>, Error> {
        exchange_bytes_until_first_frame(&mut self.bridge, bytes, limit_s)
    }

    /// State and fault.
    ///
    /// # Errors
    /// As [`Self::send_request`].
    pub fn read_status(&mut self) -> Result<StatusReply, Error> {
        match self.send_request(&Request::Status)? {
            Reply::Status(status) => Ok(status),
            other => Err(Error::NoReply(format!("the reply to Status is {other:?}"))),
        }
    }

    /// The latched fault.
    ///
    /// # Errors
    /// As [`Self::send_request`].
    pub fn read_latched_fault(&mut self) -> Result<Option<Fault>, Error> {
        Ok(self.read_status()?.fault)
    }

    /// Waits for a state, looking a hundred times; tells how long it took in ms, or the state that it was in at the end.
    ///
    /// # Errors
    /// As [`Self::send_request`].
    pub fn await_state_and_measure_ms(
        &mut self,
        state: SafetyState,
        limit_ms: u32,
    ) -> Result<Result<f64, SafetyState>, Error> {
        let begin = self.read_clock_cycles()?;
        for _ in 0..LOOKS {
            if self.read_status()?.state == state {
                return Ok(Ok(self.milliseconds_since(begin)?));
            }
            self.advance_time(f64::from(limit_ms) / 1e3 / f64::from(LOOKS))?;
        }
        Ok(Err(self.read_status()?.state))
    }

    /// From power-up or a clear to armed.
    ///
    /// # Errors
    /// [`Error::NoReply`] with what the board said if it does not come to that.
    pub fn arm_and_wait(&mut self) -> Result<(), Error> {
        self.await_state_and_measure_ms(SafetyState::Safe, 1_500)?
            .map_err(|state| Error::NoReply(format!("the state must be safe, but is {}", state.name())))?;
        let reply = self.send_request(&Request::ArmWith { deadman_ms: None, burst_ms: Some(10_000) })?;
        if !matches!(reply, Reply::ArmedWith { .. }) {
            return Err(Error::NoReply(format!("the reply to ArmWith is {reply:?}")));
        }
        match self.await_state_and_measure_ms(SafetyState::Armed, 1_500)? {
            Ok(_) => Ok(()),
            Err(state) => {
                let fault = self.read_latched_fault()?;
                Err(Error::NoReply(format!("the state must be armed, but is {} (fault: {fault:?})", state.name())))
            }
        }
    }

    /// Sets drives; the refusal, if that is the answer.
    ///
    /// # Errors
    /// As [`Self::send_request`].
    pub fn set_drives(&mut self, drives: &[ChannelDrive]) -> Result<Option<Refusal>, Error> {
        match self.send_request(&Request::SetDrives { drives: drives.iter().copied().collect() })? {
            Reply::DrivesSet { .. } => Ok(None),
            Reply::Refused(refusal) => Ok(Some(refusal)),
            other => Err(Error::NoReply(format!("the reply to SetDrives is {other:?}"))),
        }
    }

    /// Lets time pass without a word, in s.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn advance_time(&mut self, seconds: f64) -> Result<(), Error> {
        self.bridge.send_command(&json!({"op": "run_for", "seconds": seconds})).map(|_| ())
    }

    /// Lets time pass with a keep-alive often enough, in s.
    ///
    /// # Errors
    /// As [`Self::send_request`].
    pub fn advance_time_with_keep_alives(&mut self, seconds: f64) -> Result<(), Error> {
        let mut left = seconds;
        while left > 0.0 {
            self.advance_time(left.min(KEEP_ALIVE_S))?;
            self.send_request(&Request::KeepAlive)?;
            left -= KEEP_ALIVE_S;
        }
        Ok(())
    }

    /// Clocks since power-up.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn read_clock_cycles(&mut self) -> Result<u64, Error> {
        Ok(self.bridge.read_emulated_and_wall_times()?.clock)
    }

    /// Time since `clock`, in ms.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn milliseconds_since(&mut self, clock: u64) -> Result<f64, Error> {
        Ok(self.read_clock_cycles()?.saturating_sub(clock) as f64 / CLOCKS_PER_MS)
    }

    /// Faults, see `tools/emulator/faults.py`.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn inject_fault(&mut self, fault: &Value) -> Result<(), Error> {
        let mut command = fault.clone();
        command["op"] = json!("inject");
        self.bridge.send_command(&command).map(|_| ())
    }

    /// Writes a word of the chip's memory, as the processor would: what is locked keeps its value.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn write_memory_word(&mut self, address: u32, value: u32) -> Result<(), Error> {
        self.bridge.send_command(&json!({"op": "write", "address": address, "value": value})).map(|_| ())
    }

    /// A word of the chip's memory.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn read_memory_word(&mut self, address: u32) -> Result<u32, Error> {
        let MemoryWord { value } = self.bridge.send_command_and_parse(&json!({"op": "read", "address": address}))?;
        Ok(value)
    }

    /// The address of a symbol of the image.
    ///
    /// # Errors
    /// [`Error::Bridge`], also if there is none of this name.
    pub fn find_symbol_address(&mut self, name: &str) -> Result<u32, Error> {
        let SymbolAddress { address } = self.bridge.send_command_and_parse(&json!({"op": "symbol", "name": name}))?;
        Ok(address)
    }

    /// Registers of the electrodes' timers as they read back, in the order of the channels.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn read_timer_registers(&mut self) -> Result<Vec<Registers>, Error> {
        let Timers { mut timers } = self.bridge.send_command_and_parse(&json!({"op": "timers"}))?;
        Ok(CHANNELS.iter().map(|channel| timers.remove(channel.timer).unwrap_or_default()).collect())
    }

    /// Pins by name.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn read_pins(&mut self) -> Result<BTreeMap<String, Pin>, Error> {
        let Pins { pins } = self.bridge.send_command_and_parse(&json!({"op": "pins"}))?;
        Ok(pins)
    }

    /// Set-points and rails.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn read_set_points_and_rail_voltages(&mut self) -> Result<Rails, Error> {
        self.bridge.send_command_and_parse(&json!({"op": "rails"}))
    }

    /// Why the chip has been reset since it was first up.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn read_cause_of_each_reset_after_firmware_was_up(&mut self) -> Result<Vec<String>, Error> {
        self.read_reset_causes("resets")
    }

    /// Why the chip has been reset between power-up and its being up.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn read_cause_of_each_reset_until_firmware_was_up(&mut self) -> Result<Vec<String>, Error> {
        self.read_reset_causes("start")
    }

    fn read_reset_causes(&mut self, which: &str) -> Result<Vec<String>, Error> {
        let answer = self.bridge.send_command(&json!({"op": "resets"}))?;
        let causes = answer[which].as_array().map(Vec::as_slice).unwrap_or_default();
        Ok(causes.iter().filter_map(|reset| reset["cause"].as_str().map(str::to_owned)).collect())
    }

    /// Share of the processor's time that is taken over `seconds`.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn measure_busy_and_total_clocks(&mut self, seconds: f64) -> Result<(f64, f64), Error> {
        let answer = self.bridge.send_command(&json!({"op": "load", "seconds": seconds}))?;
        Ok((answer["busy"].as_f64().unwrap_or(f64::NAN), answer["total"].as_f64().unwrap_or(f64::NAN)))
    }

    /// Brings [`Self::edges`] up to now.
    ///
    /// # Errors
    /// [`Error::Bridge`], also if records are missing.
    pub fn update_pin_edges_until_now(&mut self) -> Result<(), Error> {
        let History { history, lost } = self.bridge.send_command_and_parse(&json!({"op": "history"}))?;
        if lost > 0 {
            return Err(Error::Bridge(format!("{lost} records of the history are lost")));
        }
        let now = self.read_clock_cycles()?;
        self.edges.apply_timer_changes(&history, now)
    }
}
