//! Boards of other protocol versions: an older one is spoken to in its own, a newer one is refused by name.

use crate::support;
use era::device::{Client, LinkError};
use era_shared::protocol::{CURRENT_VERSION, MIN_VERSION, Reply, Request};
use era_shared::safety::SafetyState;
use std::time::Duration;
use support::old_board::Board;

fn client(min: u8, current: u8) -> Client {
    Client::new(Box::new(Board::speaking(min, current)), Duration::from_millis(500))
}

fn hello() -> Request {
    Request::Hello { host_min: MIN_VERSION, host_current: CURRENT_VERSION }
}

#[test]
fn the_newest_common_version_is_spoken() {
    let mut client = client(MIN_VERSION, CURRENT_VERSION);
    assert!(matches!(client.request(&hello()), Ok(Reply::Welcome(_))));
    assert_eq!(client.protocol_version(), CURRENT_VERSION);
}

#[test]
fn a_board_of_version_1_is_driven_in_version_1() {
    let mut client = client(1, 1);
    assert!(matches!(client.request(&hello()), Ok(Reply::Hello(_))));
    assert_eq!(client.protocol_version(), 1);
    let drives = [era_shared::protocol::ChannelDrive {
        channel: 0,
        frequency_millihertz: 150_000,
        pulse_width_ppm: 666_667,
        phase_microturns: 0,
        voltage_millivolts: 50_000,
    }];
    assert!(matches!(client.request(&Request::Arm { deadman_ms: Some(1000) }), Ok(Reply::Armed { .. })));
    let set = client.request(&Request::SetDrives { drives: drives.into_iter().collect() });
    assert!(matches!(set, Ok(Reply::DrivesSet { .. })), "{set:?}");
    // What version 1 does not have is not sent, and told by name.
    let error = client.request(&Request::Clock).expect_err("version 1 has no clock");
    assert!(matches!(error, LinkError::TooOld { request: "clock", needed: 2, spoken: 1 }), "{error:?}");
    assert!(error.to_string().contains("update the board's firmware"), "{error}");
    assert!(matches!(client.request(&Request::Stop), Ok(Reply::Stopped)));
    let alive = client.request(&Request::KeepAlive);
    assert!(matches!(alive, Ok(Reply::Alive { state: SafetyState::Boot | SafetyState::Safe })), "{alive:?}");
}

#[test]
fn a_board_of_version_2_is_driven_in_version_2() {
    let mut client = client(1, 2);
    assert!(matches!(client.request(&hello()), Ok(Reply::Welcome(_))));
    assert_eq!(client.protocol_version(), 2);
    assert!(matches!(client.request(&Request::Details), Ok(Reply::Details(_))));
    let error = client.request(&Request::Credit).expect_err("version 2 does not tell what it charges");
    assert!(matches!(error, LinkError::TooOld { request: "credit", needed: 3, spoken: 2 }), "{error:?}");
}

#[test]
fn without_a_common_version_the_older_side_is_named() {
    let newer = CURRENT_VERSION + 1;
    let error = client(newer, newer + 4).request(&hello()).expect_err("nothing in common").to_string();
    let versions = [format!("{MIN_VERSION} to {CURRENT_VERSION}"), format!("{newer} to {}", newer + 4)];
    assert!(versions.iter().all(|versions| error.contains(versions)), "{error}");
    assert!(error.ends_with("update this program"), "{error}");
    let error = client(0, 0).request(&hello()).expect_err("nothing in common").to_string();
    assert!(error.contains("0 to 0") && error.ends_with("update the board's firmware"), "{error}");
}
