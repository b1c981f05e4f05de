//! The checks of outputs: made on a target that can be observed, never passed on one that cannot, and failed by a device that
//! makes a mistake.

use era::device::sim::{Mistakes, SimDevice, SimKnobs};
use hil_tests::bench::{Bench, make_one_mode_panel};
use hil_tests::cases::{CASES, Case};
use hil_tests::outputs::OutputCheck;
use hil_tests::targets::TargetKind;
use std::collections::BTreeSet;

fn find_case(name: &str) -> &'static Case {
    CASES.iter().find(|case| case.name == name).expect("a case of this name")
}

#[test]
fn every_check_is_made_by_a_case_of_each_target() {
    for kind in TargetKind::ALL {
        let cases = CASES.iter().filter(|case| kind.missing_need(case.needs).is_none());
        let checks: BTreeSet<OutputCheck> = cases.flat_map(|case| case.output_checks).copied().collect();
        assert_eq!(checks, OutputCheck::ALL.into(), "{}", kind.name());
    }
}

/// A simulated device behind a serial port, as a board would be: only its answers can be seen.
#[test]
fn a_board_passes_no_case_whose_outputs_it_does_not_show() {
    let (panel, max_voltages_v) = make_one_mode_panel();
    let device = SimDevice::start(panel, max_voltages_v).expect("a pseudo-terminal");
    let bench = Bench::open_board(device.port_path()).expect("its port");
    let is_run = |case: &&Case| TargetKind::Board.missing_need(case.needs).is_none();
    // This one asks which kind of board it is.
    for case in CASES.iter().filter(is_run).filter(|case| case.name != "hello") {
        let mut listed = case.output_checks.to_vec();
        listed.sort_unstable();
        assert_eq!(case.run_and_list_unobserved_checks(&bench), Ok(listed), "{}", case.name);
    }
}

#[test]
fn the_cases_find_a_device_that_makes_mistakes() {
    let sound = Mistakes::default();
    let planted = [
        (Mistakes { outputs_stay_on: true, ..sound }, "stop", "pins of electrodes that are not held low"),
        (Mistakes { outputs_stay_on: true, ..sound }, "silence", "some timer energises electrodes"),
        (Mistakes { outputs_stay_on: true, ..sound }, "restart", "some timer energises electrodes"),
        (Mistakes { both_electrodes: true, ..sound }, "drive_two_frequencies", "ticks with both electrodes on"),
        (Mistakes { idle_channel: Some(1), ..sound }, "change_drives", "channel 1 does not use both electrodes"),
        (Mistakes { idle_channel: Some(3), ..sound }, "effect_on_all_channels", "channels that drive during"),
        (Mistakes { long_periods: true, ..sound }, "drives_to_the_timer_step", "channel 0 is at"),
        (Mistakes { late_periods: true, ..sound }, "equal_frequencies_keep_their_phase", "the phase error of"),
    ];
    let bench = Bench::start_simulated().expect("a pseudo-terminal");
    let control = bench.sim_control().expect("knobs");
    for (mistakes, name, reason) in planted {
        let case = find_case(name);
        let result = {
            let _turned = Bench::set_knobs_until_dropped(&control, SimKnobs { mistakes, ..SimKnobs::default() });
            case.run_and_list_unobserved_checks(&bench)
        };
        let error = result.expect_err(name);
        assert!(error.contains(reason), "{name} with {mistakes:?}: {error}");
        assert_eq!(case.run_and_list_unobserved_checks(&bench), Ok(Vec::new()), "{name} without a mistake");
    }
}
