//! What a board's own words mean.

use super::facts::{BoardReport, Clock, Supply};
use super::finding::Finding;
use era_shared::circuit::BLEEDER_OHMS;
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
pub fn judge_board_report(report: &BoardReport) -> Vec<Finding> {
    let mut all = vec![judge_protocol_version_of_firmware(report)];
    all.push(judge_fault_and_previous_failure(report));
    if report.waits_to_be_armed {
        let found = "the board had an outage, and waits to be armed";
        all.push(Finding::warning(
            "armed",
            found,
            "check that nobody touches the board or the panel, then run `era arm`",
        ));
    }
    all.extend(report.supply.as_ref().map(judge_whether_safety_loops_are_closed));
    all.extend(report.supply.as_ref().map(|supply| judge_rails(supply, report.state.as_deref())));
    all.extend(report.clock.map(judge_clock));
    let (sent, again) = report.frames;
    if again > 0 {
        let found = format!("{again} of {sent} frames had to be sent again");
        all.push(if again.saturating_mul(REPEATS) > sent {
            Finding::warning("link", found, "use another cable, a shorter cable, or another USB port")
        } else {
            Finding::ok("link", found)
        });
    }
    all
}

fn judge_protocol_version_of_firmware(report: &BoardReport) -> Finding {
    let BoardReport { firmware, protocol, .. } = report;
    match protocol {
        Some(spoken) if *spoken < CURRENT_VERSION => Finding::warning(
            "firmware",
            format!(
                "{firmware}, protocol version {spoken}; this program also supports the newer version {CURRENT_VERSION}"
            ),
            "`era flash` updates the firmware: effects, the clock and measurements of the supply need the newer version",
        ),
        Some(spoken) => Finding::ok("firmware", format!("{firmware}, protocol version {spoken}")),
        None => Finding::ok("firmware", format!("{firmware}, protocol version not known")),
    }
}

/// The fault of the daemon's device, where another one than the daemon's has been asked itself.
pub fn judge_fault_of_daemon_device(report: &BoardReport) -> Option<Finding> {
    let fault = report.fault.as_ref()?;
    let found = format!("the fault {} ({}) is latched on the daemon's device", fault.code, fault.name);
    Some(Finding::problem("daemon-fault", found, format!("{} `era clear` clears the fault", fault.advice)))
}

fn judge_fault_and_previous_failure(report: &BoardReport) -> Finding {
    let state = report.state.as_deref().unwrap_or("not known");
    match (&report.fault, &report.failure) {
        (Some(fault), _) => {
            let found = format!("the fault {} ({}) is latched", fault.code, fault.name);
            Finding::problem("fault", found, format!("{} `era clear` clears the fault", fault.advice))
        }
        (None, Some(failure)) => Finding::warning(
            "fault",
            format!("no fault is latched; the previous run of the firmware failed: {failure}"),
            "save the log (`era monitor`), and report the failure with the log",
        ),
        (None, None) if report.was_watchdog => Finding::warning(
            "fault",
            "no fault is latched; the watchdog has restarted the firmware",
            "save the log (`era monitor`), and report the restart with the log",
        ),
        (None, None) => Finding::ok("fault", format!("no fault is latched; the board's state is {state}")),
    }
}

fn judge_whether_safety_loops_are_closed(supply: &Supply) -> Finding {
    let open: Vec<(&str, &str)> = [
        (supply.interlock_closed, ("the enclosure is open", "close the enclosure")),
        (supply.stop_released, ("the emergency stop is pressed", "release the emergency stop")),
        (supply.earth_bonded, ("panel or masses are not bonded to earth", "do not touch the panel; repair the bond")),
    ]
    .into_iter()
    .filter(|(is_well, _)| !is_well)
    .map(|(_, open)| open)
    .collect();
    if open.is_empty() {
        return Finding::ok("interlock", "enclosure closed, emergency stop released, panel and masses bonded to earth");
    }
    let found: Vec<&str> = open.iter().map(|(found, _)| *found).collect();
    let advice: Vec<&str> = open.iter().map(|(_, advice)| *advice).collect();
    Finding::problem(
        "interlock",
        found.join(", "),
        format!(
            "{}; then clear the fault (`era clear`). If the fault occurs again while the enclosure is closed \
            and the emergency stop is released, a wire of a safety loop is broken",
            advice.join("; ")
        ),
    )
}

fn judge_rails(supply: &Supply, state: Option<&str>) -> Finding {
    let volts: Vec<String> = supply.rail_v.iter().map(|volts| format!("{volts:.0} V")).collect();
    let found = format!("rails at {}", volts.join(" and "));
    let is_off = matches!(state, Some("safe" | "fault" | "boot"));
    if is_off && supply.rail_v.iter().any(|volts| *volts > CHARGED_V) {
        return Finding::problem(
            "supply",
            format!("{found}, although the board has switched the high voltage off"),
            "do not open the enclosure; switch the supply off with the switch on the supply, wait a minute and measure \
             the rails",
        );
    }
    if is_off {
        let cost = "the next touch arms the board, and vibrates about 0.14 s later: the board tests the supply, and \
                    the rails rise; `era serve --idle-s` keeps the board armed and the rails charged for longer";
        return Finding::ok("supply", format!("{found}; {cost}"));
    }
    let state = state.unwrap_or("in an unknown state");
    if supply.rail_v.iter().any(|volts| *volts > CHARGED_V) {
        // Two bleeders for each rail, one of which is its divider: 2 V^2 / R in W.
        let bleeders_mw: f64 = supply.rail_v.iter().map(|volts| 2e3 * volts * volts / f64::from(BLEEDER_OHMS)).sum();
        let cost = format!(
            "the rails stay charged until the board is disarmed, and lose {bleeders_mw:.0} mW in their bleeders; \
             `era serve --idle-s` sets after how many seconds without a touch the daemon disarms the board"
        );
        return Finding::ok("supply", format!("{found}; the board is {state}; {cost}"));
    }
    Finding::ok("supply", format!("{found}; the board is {state}"))
}

fn judge_clock(clock: Clock) -> Finding {
    let Clock { rate_ppm, half_round_trip_s, worst_s } = clock;
    let known_s = half_round_trip_s.max(worst_s);
    if let Some(rate) = rate_ppm.filter(|rate| rate.abs() > RATE_PPM) {
        return Finding::problem(
            "clock",
            format!(
                "the rate of the board's clock differs from the rate of this computer's clock by {:+.1} % ({rate:+.0} \
                 ppm; + means faster); the error of a working \
                 oscillator is at most 1 %",
                rate / 1e4
            ),
            "measure the frequencies of the drives with a frequency counter; switch the board's power off and on; if \
             this does \
             not help, replace the board",
        );
    }
    let known_ms = known_s * 1e3;
    let found = match rate_ppm {
        Some(rate) => format!(
            "the rate of the board's clock differs from the rate of this computer's clock by {rate:+.0} ppm (+ means \
             faster); the error of the estimated board time is at most {known_ms:.2} ms"
        ),
        None => format!("the error of the estimated board time is at most {known_ms:.2} ms"),
    };
    if known_s > KNOWN_S {
        return Finding::warning(
            "clock",
            format!("{found}: effects keep their shape, but can begin late"),
            "the computer or the USB link is busy: give the daemon real-time priority (see the check \"realtime\"), \
             and use a USB port without a hub",
        );
    }
    Finding::ok("clock", found)
}
