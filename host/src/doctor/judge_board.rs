//! What a board's own words mean.

use super::facts::{Clock, Heard, Supply};
use super::finding::Finding;
use era_shared::protocol::CURRENT_VERSION;

/// The board's oscillator is within 1 % (10 000 ppm) of its value.
const RATE_PPM: f64 = 10_000.0;
/// A board's time that is known worse than this lets effects begin later, in s.
const KNOWN_S: f64 = 5e-3;
/// Rails above this are charged, in V: extra-low voltage ends there.
const CHARGED_V: f64 = 60.0;
/// More of the frames than this sent again, and the cable is bad.
const REPEATS: u64 = 100;

/// Every check of what was heard.
pub fn judge(heard: &Heard) -> Vec<Finding> {
    let mut all = vec![judge_firmware(heard)];
    all.push(judge_fault(heard));
    if heard.waits_to_be_armed {
        let found = "the board had an outage, and waits to be armed";
        all.push(Finding::warning("armed", found, "check that nobody touches board or panel, then run `era arm`"));
    }
    all.extend(heard.supply.as_ref().map(judge_loops));
    all.extend(heard.supply.as_ref().map(|supply| judge_rails(supply, heard.state.as_deref())));
    all.extend(heard.clock.map(judge_clock));
    let (sent, again) = heard.frames;
    if again > 0 {
        let found = format!("{again} of {sent} frames had to be sent again");
        all.push(if again.saturating_mul(REPEATS) > sent {
            Finding::warning("link", found, "use another or shorter cable, or another USB port")
        } else {
            Finding::ok("link", found)
        });
    }
    all
}

fn judge_firmware(heard: &Heard) -> Finding {
    let Heard { firmware, protocol, .. } = heard;
    match protocol {
        Some(spoken) if *spoken < CURRENT_VERSION => Finding::warning(
            "firmware",
            format!("{firmware}, protocol version {spoken}; this program also speaks version {CURRENT_VERSION}"),
            "`era flash` updates the firmware: effects, the clock and measurements of the supply need the newer version",
        ),
        Some(spoken) => Finding::ok("firmware", format!("{firmware}, protocol version {spoken}")),
        None => Finding::ok("firmware", format!("{firmware}, protocol version not known")),
    }
}

/// The fault of the daemon's device, where another one than the daemon's has been asked itself.
pub fn judge_other(heard: &Heard) -> Option<Finding> {
    let fault = heard.fault.as_ref()?;
    let found = format!("{} ({}) is latched on the daemon's device", fault.code, fault.name);
    Some(Finding::problem("daemon-fault", found, format!("{} `era clear` clears the fault", fault.advice)))
}

fn judge_fault(heard: &Heard) -> Finding {
    let state = heard.state.as_deref().unwrap_or("not known");
    match (&heard.fault, &heard.failure) {
        (Some(fault), _) => {
            let found = format!("{} ({}) is latched", fault.code, fault.name);
            Finding::problem("fault", found, format!("{} `era clear` clears the fault", fault.advice))
        }
        (None, Some(failure)) => Finding::warning(
            "fault",
            format!("no fault is latched; the previous run of the firmware failed: {failure}"),
            "keep the log (`era monitor`) and report it",
        ),
        (None, None) if heard.was_watchdog => Finding::warning(
            "fault",
            "no fault is latched; the watchdog has restarted the firmware",
            "keep the log (`era monitor`) and report it",
        ),
        (None, None) => Finding::ok("fault", format!("no fault is latched; the board's state is {state}")),
    }
}

fn judge_loops(supply: &Supply) -> Finding {
    let open: Vec<(&str, &str)> = [
        (supply.interlock_closed, ("the enclosure is open", "close it")),
        (supply.stop_released, ("the emergency stop is pressed", "release it")),
        (supply.earth_bonded, ("panel or masses are not bonded to earth", "do not touch the panel; repair the bond")),
    ]
    .into_iter()
    .filter(|(is_well, _)| !is_well)
    .map(|(_, open)| open)
    .collect();
    if open.is_empty() {
        return Finding::ok("interlock", "enclosure closed, emergency stop released, earth bonded");
    }
    let found: Vec<&str> = open.iter().map(|(found, _)| *found).collect();
    let advice: Vec<&str> = open.iter().map(|(_, advice)| *advice).collect();
    Finding::problem(
        "interlock",
        found.join(", "),
        format!("{}; or the wire of its loop is broken. Then clear the fault", advice.join("; ")),
    )
}

fn judge_rails(supply: &Supply, state: Option<&str>) -> Finding {
    let volts: Vec<String> = supply.rail_v.iter().map(|volts| format!("{volts:.0} V")).collect();
    let found = format!("rails at {}", volts.join(" and "));
    let is_off = matches!(state, Some("safe" | "fault" | "boot"));
    if is_off && supply.rail_v.iter().any(|volts| *volts > CHARGED_V) {
        return Finding::problem(
            "supply",
            format!("{found}, although the board is off"),
            "do not open the enclosure; switch the supply off at its own switch, wait a minute and measure",
        );
    }
    if is_off {
        return Finding::ok("supply", format!("{found}; the supply is tested when the board is armed"));
    }
    Finding::ok("supply", format!("{found}; the board is {}", state.unwrap_or("in an unknown state")))
}

fn judge_clock(clock: Clock) -> Finding {
    let Clock { rate_ppm, half_round_trip_s, worst_s } = clock;
    let known_s = half_round_trip_s.max(worst_s);
    let rate = rate_ppm.map_or_else(String::new, |rate| format!("{rate:+.0} ppm, "));
    let found = format!("{rate}known to {:.2} ms", known_s * 1e3);
    if rate_ppm.is_some_and(|rate| rate.abs() > RATE_PPM) {
        return Finding::problem(
            "clock",
            format!("{found}: a working oscillator of the board is within 1 %"),
            "compare its frequencies with a counter; power the board down and up; if this does not help, replace the board",
        );
    }
    if known_s > KNOWN_S {
        return Finding::warning(
            "clock",
            format!("{found}: effects keep their shape, but begin later"),
            "the machine or the link is busy: allow real-time priority, and use a USB port without a hub",
        );
    }
    Finding::ok("clock", found)
}
