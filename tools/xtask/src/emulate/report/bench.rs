//! The board under test: asked through its serial link, looked at and disturbed through the bridge.

use super::super::bridge::{Bridge, Pace};
use super::super::link::{Link, exchange_bytes};
use super::channels::CHANNELS;
use super::edges::{Edges, Record};
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
pub struct Bench {
    bridge: Bridge,
    link: Link,
    /// What the pins have done.
    pub edges: Edges,
}

/// Registers of one timer by name.
pub type Registers = BTreeMap<String, u32>;

#[derive(Deserialize)]
struct Timers {
    timers: BTreeMap<String, Registers>,
}

#[derive(Deserialize)]
struct History {
    history: Vec<Record>,
    lost: u64,
}

/// State of one pin.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub struct Pin {
    /// `input`, `output`, `timer` or `analog`.
    pub mode: String,
    /// Level of an output.
    pub high: Option<bool>,
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

impl Bench {
    /// Powers the board up.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn start(image: &Path) -> Result<Self, Error> {
        Ok(Self { bridge: Bridge::start(image, Pace::Paused)?, link: Link::default(), edges: Edges::default() })
    }

    /// Power off and on, everything healed, nothing known of the pins.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn restart(&mut self) -> Result<(), Error> {
        self.bridge.ask(&json!({"op": "restart"}))?;
        self.edges = Edges::default();
        Ok(())
    }

    /// One request.
    ///
    /// # Errors
    /// [`Error::NoReply`], [`Error::Bridge`].
    pub fn request(&mut self, request: &Request) -> Result<Reply, Error> {
        self.link.request(&mut self.bridge, request)
    }

    /// One request in the words of another protocol version.
    ///
    /// # Errors
    /// As [`Self::request`].
    pub fn request_as(&mut self, version: u8, request: &Request) -> Result<Reply, Error> {
        self.link.request_as(&mut self.bridge, version, request)
    }

    /// Bytes that need not be a frame, and what comes back within `seconds`.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn raw(&mut self, bytes: &[u8], seconds: f64) -> Result<Vec<u8>, Error> {
        exchange_bytes(&mut self.bridge, bytes, seconds)
    }

    /// State and fault.
    ///
    /// # Errors
    /// As [`Self::request`].
    pub fn status(&mut self) -> Result<StatusReply, Error> {
        match self.request(&Request::Status)? {
            Reply::Status(status) => Ok(status),
            other => Err(Error::NoReply(format!("Status: {other:?}"))),
        }
    }

    /// The latched fault.
    ///
    /// # Errors
    /// As [`Self::request`].
    pub fn fault(&mut self) -> Result<Option<Fault>, Error> {
        Ok(self.status()?.fault)
    }

    /// Waits for a state, looking a hundred times; tells how long it took in ms, or the state that it was in at the end.
    ///
    /// # Errors
    /// As [`Self::request`].
    pub fn wait_for(&mut self, state: SafetyState, limit_ms: u32) -> Result<Result<f64, SafetyState>, Error> {
        let begin = self.clock()?;
        for _ in 0..LOOKS {
            if self.status()?.state == state {
                return Ok(Ok(self.milliseconds_since(begin)?));
            }
            self.run(f64::from(limit_ms) / 1e3 / f64::from(LOOKS))?;
        }
        Ok(Err(self.status()?.state))
    }

    /// From power-up or a clear to armed.
    ///
    /// # Errors
    /// [`Error::NoReply`] with what the board said if it does not come to that.
    pub fn arm(&mut self) -> Result<(), Error> {
        self.wait_for(SafetyState::Safe, 1_500)?
            .map_err(|state| Error::NoReply(format!("safe: it is {}", state.name())))?;
        let reply = self.request(&Request::ArmWith { deadman_ms: None, burst_ms: Some(10_000) })?;
        if !matches!(reply, Reply::ArmedWith { .. }) {
            return Err(Error::NoReply(format!("ArmWith: {reply:?}")));
        }
        match self.wait_for(SafetyState::Armed, 1_500)? {
            Ok(_) => Ok(()),
            Err(state) => Err(Error::NoReply(format!("armed: it is {} {:?}", state.name(), self.fault()?))),
        }
    }

    /// Sets drives; the refusal, if that is the answer.
    ///
    /// # Errors
    /// As [`Self::request`].
    pub fn drive(&mut self, drives: &[ChannelDrive]) -> Result<Option<Refusal>, Error> {
        match self.request(&Request::SetDrives { drives: drives.iter().copied().collect() })? {
            Reply::DrivesSet { .. } => Ok(None),
            Reply::Refused(refusal) => Ok(Some(refusal)),
            other => Err(Error::NoReply(format!("SetDrives: {other:?}"))),
        }
    }

    /// Lets time pass without a word, in s.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn run(&mut self, seconds: f64) -> Result<(), Error> {
        self.bridge.ask(&json!({"op": "run_for", "seconds": seconds})).map(|_| ())
    }

    /// Lets time pass with a keep-alive often enough, in s.
    ///
    /// # Errors
    /// As [`Self::request`].
    pub fn keep_alive(&mut self, seconds: f64) -> Result<(), Error> {
        let mut left = seconds;
        while left > 0.0 {
            self.run(left.min(KEEP_ALIVE_S))?;
            self.request(&Request::KeepAlive)?;
            left -= KEEP_ALIVE_S;
        }
        Ok(())
    }

    /// Clocks since power-up.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn clock(&mut self) -> Result<u64, Error> {
        Ok(self.bridge.time()?.clock)
    }

    /// Time since `clock`, in ms.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn milliseconds_since(&mut self, clock: u64) -> Result<f64, Error> {
        Ok(self.clock()?.saturating_sub(clock) as f64 / CLOCKS_PER_MS)
    }

    /// Faults, see `tools/emulator/faults.py`.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn inject(&mut self, fault: &Value) -> Result<(), Error> {
        let mut command = fault.clone();
        command["op"] = json!("inject");
        self.bridge.ask(&command).map(|_| ())
    }

    /// Writes a word of the chip's memory.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn write(&mut self, address: u32, value: u32) -> Result<(), Error> {
        self.bridge.ask(&json!({"op": "write", "address": address, "value": value})).map(|_| ())
    }

    /// Registers of the electrodes' timers as they read back, in the order of the channels.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn timers(&mut self) -> Result<Vec<Registers>, Error> {
        let Timers { mut timers } = self.bridge.ask_for(&json!({"op": "timers"}))?;
        Ok(CHANNELS.iter().map(|channel| timers.remove(channel.timer).unwrap_or_default()).collect())
    }

    /// Pins by name.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn pins(&mut self) -> Result<BTreeMap<String, Pin>, Error> {
        let Pins { pins } = self.bridge.ask_for(&json!({"op": "pins"}))?;
        Ok(pins)
    }

    /// Set-points and rails.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn rails(&mut self) -> Result<Rails, Error> {
        self.bridge.ask_for(&json!({"op": "rails"}))
    }

    /// Why the chip has been reset since power-up.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn resets(&mut self) -> Result<Vec<String>, Error> {
        let answer = self.bridge.ask(&json!({"op": "resets"}))?;
        let causes = answer["resets"].as_array().map(Vec::as_slice).unwrap_or_default();
        Ok(causes.iter().filter_map(|reset| reset["cause"].as_str().map(str::to_owned)).collect())
    }

    /// Share of the processor's time that is taken over `seconds`.
    ///
    /// # Errors
    /// [`Error::Bridge`].
    pub fn load(&mut self, seconds: f64) -> Result<(f64, f64), Error> {
        let answer = self.bridge.ask(&json!({"op": "load", "seconds": seconds}))?;
        Ok((answer["busy"].as_f64().unwrap_or(f64::NAN), answer["total"].as_f64().unwrap_or(f64::NAN)))
    }

    /// Brings [`Self::edges`] up to now.
    ///
    /// # Errors
    /// [`Error::Bridge`], also if records are missing.
    pub fn follow_edges(&mut self) -> Result<(), Error> {
        let History { history, lost } = self.bridge.ask_for(&json!({"op": "history"}))?;
        if lost > 0 {
            return Err(Error::Bridge(format!("{lost} records of the history are lost")));
        }
        let now = self.clock()?;
        self.edges.follow(&history, now)
    }
}
