//! The circuit outside a fake board: two rails with their supply, electrodes with their switches, and the current between them.
//!
//! Worked out from the parts alone, in f64 and from edge to edge of the timers; nothing of it is shared with what it judges but the
//! periods that the timers go through.

use era_shared::supply::{RAILS, SupplyCommand};
use era_shared::waveform::{Electrode, IDLE, TimerPeriod, TimerPreload};
use std::collections::VecDeque;

/// Clocks of a timer in a us.
const CLOCKS_PER_US: f64 = 170.0;
/// How fast a quick supply follows its set-point, and how fast a rail follows the supply: 47 kohm and 1.8 nF; in us.
const FOLLOW_US: f64 = 500.0;
const SOURCE_US: f64 = 85.0;
/// A closed discharge switch: 1 Mohm.
const DISCHARGE_OHMS: f64 = 1e6;
/// An electrode's lower switch.
const LOWER_OHMS: f64 = 1e5;
/// The filter of the average current, and the time of the converter's mean behind it, in us.
const FILTER_US: f64 = 1_000.0;
const MEAN_US: f64 = 1_000.0;
/// The channel whose electrodes are low without the permit, whatever its timer does.
const GATED_CHANNEL: usize = 3;
/// Longest step while something changes, in us.
const STEP_US: f64 = 50.0;

/// How an electrode is broken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ElectrodeState {
    #[default]
    Works,
    /// Its cable, or its upper switch, is open.
    Open,
    /// It has a short to earth behind its resistor of 1 Mohm.
    Shorted,
    /// Its lower switch never closes.
    LowerOpen,
    /// Its lower switch never opens.
    LowerStuck,
}

/// Values of the parts.
#[derive(Clone, Copy, Debug)]
pub struct Parts {
    pub rail_picofarads: f64,
    pub electrode_picofarads: [f64; 4],
    pub electrode_ohms: f64,
    /// Of both bleeders together.
    pub bleeder_ohms: f64,
    pub leakage_ohms: f64,
    /// What is measured of 1 uA, and of nothing, in uA.
    pub current_gain: f64,
    pub current_offset_microamps: f64,
    /// Time constant in us with which the supply follows its set-point, up and down.
    pub follow_us: f64,
}

impl Default for Parts {
    fn default() -> Self {
        Self {
            rail_picofarads: 1_800.0,
            electrode_picofarads: [116.0; 4],
            electrode_ohms: 1e6,
            bleeder_ohms: 50e6,
            leakage_ohms: f64::INFINITY,
            current_gain: 1.0,
            current_offset_microamps: 0.0,
            follow_us: FOLLOW_US,
        }
    }
}

/// A channel's timer: what it does from `boundary` on, in clocks since the start.
#[derive(Clone, Copy, Debug)]
struct Track {
    period: TimerPeriod,
    boundary: u64,
    pending: Option<(TimerPeriod, u64)>,
}

impl Track {
    const IDLE: Self = Self { period: IDLE, boundary: 0, pending: None };

    /// Goes on to the period that `clock` lies in.
    fn advance_to_clock(&mut self, clock: u64) {
        if let Some((period, at)) = self.pending.filter(|(_, at)| *at <= clock) {
            (self.period, self.boundary, self.pending) = (period, at, None);
        }
        let length = self.period.length_clocks();
        self.boundary += (clock - self.boundary) / length * length;
    }

    /// Whether A and B are on at `clock`, in the period that it lies in, and the next clock at which that may change.
    fn electrodes_on_and_next_edge(&self, clock: u64) -> ([bool; 2], u64) {
        let mut next = self.boundary + self.period.length_clocks();
        let on = [self.period.a, self.period.b].map(|window| {
            let edge = |tick: u16| self.boundary + u64::from(tick) * u64::from(self.period.divider);
            if window.on >= window.off {
                return false;
            }
            for at in [edge(window.on), edge(window.off)] {
                if at > clock {
                    next = next.min(at);
                }
            }
            (edge(window.on)..edge(window.off)).contains(&clock)
        });
        (on, next)
    }
}

/// The circuit and its state; voltages in mV, charges in fC, times in us.
pub struct Circuit {
    pub parts: Parts,
    pub rails: [f64; RAILS],
    pub broken: [[ElectrodeState; 2]; 4],
    /// The discharge switches do not close; the supply delivers though it is disabled.
    pub dead_discharge: bool,
    /// Their own lines say "open" for ever; without the permit they close.
    pub dead_discharge_lines: bool,
    pub stuck_enable: bool,
    /// The gates outside do not follow the permit.
    pub dead_permit: bool,
    electrodes: [[f64; 2]; 4],
    follows: [f64; RAILS],
    tracks: [Track; 4],
    /// The electrode that is held high as a plain output.
    held: Option<(usize, usize)>,
    time_us: f64,
    /// What the filter shows in uA, and its sum over time up to some moments of the last ms.
    filtered: f64,
    sums: VecDeque<(f64, f64)>,
}

impl Circuit {
    pub fn new(now_us: u64) -> Self {
        Self {
            parts: Parts::default(),
            rails: [0.0; RAILS],
            broken: Default::default(),
            dead_discharge: false,
            dead_discharge_lines: false,
            stuck_enable: false,
            dead_permit: false,
            electrodes: [[0.0; 2]; 4],
            follows: [0.0; RAILS],
            tracks: [Track::IDLE; 4],
            held: None,
            time_us: now_us as f64,
            filtered: 0.0,
            sums: VecDeque::from([(now_us as f64, 0.0)]),
        }
    }

    pub fn stop_timers(&mut self) {
        self.tracks = [Track::IDLE; 4];
    }

    pub fn schedule_preload(&mut self, preload: &TimerPreload) {
        let track = &mut self.tracks[preload.channel];
        if let Some((period, at)) = track.pending.filter(|(_, at)| *at < preload.at) {
            (track.period, track.boundary) = (period, at);
        }
        track.pending = Some((preload.period, preload.at));
    }

    pub fn set_held_electrode(&mut self, electrode: Option<(usize, Electrode)>) {
        self.held = electrode.map(|(channel, electrode)| (channel, usize::from(electrode == Electrode::B)));
    }

    /// What the converter shows of the average current, in uA.
    pub fn measured_microamps(&self) -> f64 {
        let (end_us, end) = *self.sums.back().unwrap();
        let from_us = end_us - MEAN_US;
        let (before, after) = match self.sums.iter().position(|(at, _)| *at > from_us) {
            Some(0) | None => (self.sums[0], self.sums[0]),
            Some(place) => (self.sums[place - 1], self.sums[place]),
        };
        let part = if after.0 > before.0 { ((from_us - before.0) / (after.0 - before.0)).max(0.0) } else { 0.0 };
        let begin = before.1 + (after.1 - before.1) * part;
        let mean = (end - begin) / MEAN_US;
        (mean * self.parts.current_gain + self.parts.current_offset_microamps).max(0.0)
    }

    /// Goes on to `now_us`; `started_us` and `connected` tell whether the timers reach the electrodes.
    pub fn advance_to_time(&mut self, now_us: u64, supply: &SupplyCommand, started_us: Option<u64>, connected: bool) {
        let end_us = now_us as f64;
        while self.time_us < end_us {
            let mut next_us = end_us;
            let mut on = [[false; 2]; 4];
            if let Some(started_us) = started_us.map(|us| us as f64) {
                // Rounded, so that a step that ends at an edge is beyond it.
                let clock = ((self.time_us - started_us) * CLOCKS_PER_US).round().max(0.0) as u64;
                for (track, on) in self.tracks.iter_mut().zip(&mut on) {
                    track.advance_to_clock(clock);
                    let (is_on, edge) = track.electrodes_on_and_next_edge(clock);
                    if connected {
                        *on = is_on;
                    }
                    next_us = next_us.min(started_us + edge as f64 / CLOCKS_PER_US);
                }
            }
            if let Some((channel, electrode)) = self.held {
                on[channel][electrode] = true;
            }
            if !self.is_permitted(supply) {
                on[GATED_CHANNEL] = [false; 2];
            }
            let step_us = (next_us - self.time_us).max(1.0 / CLOCKS_PER_US);
            let step_us = if self.is_settled(&on, supply) { step_us } else { step_us.min(STEP_US) };
            self.advance_without_switching(step_us, &on, supply);
        }
    }

    fn is_permitted(&self, supply: &SupplyCommand) -> bool {
        supply.permitted || self.dead_permit
    }

    /// Whether the supply delivers to a rail, and whether its discharge switch is closed.
    fn feeds_and_discharges(&self, supply: &SupplyCommand, rail: usize) -> (bool, bool) {
        let is_permitted = self.is_permitted(supply);
        let feeds = supply.enabled && is_permitted || self.stuck_enable;
        let line_closes = supply.discharge[rail] && !self.dead_discharge_lines;
        (feeds, (line_closes || !is_permitted) && !self.dead_discharge)
    }

    fn is_settled(&self, on: &[[bool; 2]; 4], supply: &SupplyCommand) -> bool {
        let near = |is: f64, wanted: f64| (is - wanted).abs() <= 1e-4 * wanted.abs() + 0.1;
        let electrodes = (0..4).all(|channel| {
            (0..2).all(|electrode| {
                let broken = self.broken[channel][electrode];
                let is_held = matches!(broken, ElectrodeState::LowerOpen) && !on[channel][electrode];
                let draws = matches!(broken, ElectrodeState::Shorted | ElectrodeState::LowerStuck);
                let goal = if on[channel][electrode] { self.rails[channel % RAILS] } else { 0.0 };
                is_held
                    || broken == ElectrodeState::Open
                    || !(draws && on[channel][electrode]) && near(self.electrodes[channel][electrode], goal)
            })
        });
        let rails = (0..RAILS).all(|rail| {
            // Without the supply it falls exponentially, which is exact for any step.
            let (feeds, discharges) = self.feeds_and_discharges(supply, rail);
            !feeds || discharges || near(self.rails[rail], f64::from(supply.set_point_millivolts[rail]))
        });
        electrodes && rails
    }

    /// One step in which nothing is switched.
    fn advance_without_switching(&mut self, step_us: f64, on: &[[bool; 2]; 4], supply: &SupplyCommand) {
        let parts = self.parts;
        // pF times ohm is 1e-6 us.
        let after = |us: f64| 1.0 - (-step_us / us).exp();
        for (channel, on) in on.iter().enumerate() {
            let capacitance = parts.electrode_picofarads[channel];
            let rail = &mut self.rails[channel % RAILS];
            for (electrode, is_on) in on.iter().enumerate() {
                let (volts, broken) = (&mut self.electrodes[channel][electrode], self.broken[channel][electrode]);
                let resistance = match broken {
                    ElectrodeState::Open => continue,
                    ElectrodeState::Shorted => parts.electrode_ohms,
                    _ => parts.electrode_ohms + LOWER_OHMS,
                };
                match (*is_on, broken) {
                    (true, ElectrodeState::Shorted | ElectrodeState::LowerStuck) => {
                        *rail *= (-step_us / (resistance * parts.rail_picofarads * 1e-6)).exp();
                    }
                    (true, _) => {
                        // From one capacitor to the other.
                        let both = capacitance * parts.rail_picofarads / (capacitance + parts.rail_picofarads);
                        let charge = (*rail - *volts) * both * after(parts.electrode_ohms * both * 1e-6);
                        *volts += charge / capacitance;
                        *rail -= charge / parts.rail_picofarads;
                    }
                    (false, ElectrodeState::LowerOpen) => {}
                    (false, _) => *volts -= *volts * after(LOWER_OHMS * capacitance * 1e-6),
                }
            }
        }
        let mut delivered = 0.0;
        for rail in 0..RAILS {
            let (feeds, closed) = self.feeds_and_discharges(supply, rail);
            let (volts, follows) = (&mut self.rails[rail], &mut self.follows[rail]);
            let set = f64::from(supply.set_point_millivolts[rail]);
            *follows = if feeds { *follows + (set - *follows) * after(parts.follow_us) } else { *volts };
            let bleeds = 1.0 / (1.0 / parts.bleeder_ohms + 1.0 / parts.leakage_ohms);
            if closed && !(feeds && *follows >= *volts) {
                *volts -= *volts * after(DISCHARGE_OHMS * parts.rail_picofarads * 1e-6);
            } else if feeds && *follows >= *volts {
                // A closed switch does not hold a supply: 47 kohm against 1 Mohm.
                let charge = (*follows - *volts) * parts.rail_picofarads * after(SOURCE_US);
                *volts += charge / parts.rail_picofarads;
                // mV over ohm and times us is 1e6 fC.
                let switch = if closed { 1.0 / DISCHARGE_OHMS } else { 0.0 };
                delivered += charge + *volts * (1.0 / bleeds + switch) * step_us * 1e6;
            } else {
                *volts -= *volts * after(bleeds * parts.rail_picofarads * 1e-6);
            }
        }
        // fC in a us is nA.
        let current = delivered / step_us / 1e3;
        let (_, sum) = *self.sums.back().unwrap();
        let before = self.filtered;
        self.filtered += (current - before) * after(FILTER_US);
        let part = current * step_us + (before - current) * FILTER_US * after(FILTER_US);
        self.time_us += step_us;
        self.sums.push_back((self.time_us, sum + part));
        while self.sums.len() > 2 && self.sums[1].0 < self.time_us - MEAN_US {
            self.sums.pop_front();
        }
    }
}
