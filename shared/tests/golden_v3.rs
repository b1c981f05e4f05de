//! The bytes of what protocol version 3 adds. What it shares with versions 1 and 2 has the bytes of `golden_v1.rs` and
//! `golden_v2.rs`, but for the version and the checksum.
//!
//! **If a test here fails, do not change the test**: a released host or board speaks these bytes. Change the code so
//! that it still does, and give new messages new variants at the end and lines here.

mod support;

use era_shared::link::{FrameKind, MAX_ENCODED, encode_frame};
use era_shared::protocol::*;
use heapless::Vec as Short;
use support::golden::check_message_bytes;

const VERSION: u8 = 3;

fn check_request_bytes(message: Request, expected: &str) {
    check_message_bytes(VERSION, FrameKind::Request, message, expected);
}

fn check_reply_bytes(message: Reply, expected: &str) {
    check_message_bytes(VERSION, FrameKind::Reply, message, expected);
}

#[test]
fn requests() {
    check_request_bytes(Request::Credit, "0a0301341211c5f7180800");
}

#[test]
fn replies() {
    let channels = [
        ChannelCredit { left_ms: 60_000, charge_ppm: 0 },
        ChannelCredit { left_ms: 0, charge_ppm: 1_000_000 },
        ChannelCredit { left_ms: 1_234, charge_ppm: 46_876 },
    ];
    let credit = |rule, channels: &[ChannelCredit]| {
        let channels = Short::from_slice(channels).unwrap();
        Reply::Credit(CreditReply { rule, earned_ppm: 100_000, channels })
    };
    check_reply_bytes(
        credit(ChargeRule::ForceSquared, &channels),
        "0e030234121301a08d0603e0d403010dc0843dd2099cee021c01908c00",
    );
    check_reply_bytes(credit(ChargeRule::Time, &[]), "06030234121304a08d0605f66d13a000");
    let most = [ChannelCredit { left_ms: u32::MAX, charge_ppm: u32::MAX }; 4];
    let mut out = [0; MAX_ENCODED];
    assert!(encode_frame(VERSION, FrameKind::Reply, 0, &credit(ChargeRule::ForceSquared, &most), &mut out).is_ok());
}

/// What lasts as long as the answer says, by hand.
#[test]
fn what_credit_lasts_for() {
    let channels = [(60_000, 0), (60_000, 100_000), (60_000, 100_001), (9_000, 1_000_000), (0, 500_000)];
    let of = |(left_ms, charge_ppm)| ChannelCredit { left_ms, charge_ppm };
    let (first, second) = channels.split_at(4);
    let lasts = |channels: &[(u32, u32)]| {
        let channels = channels.iter().copied().map(of).collect();
        let credit = CreditReply { rule: ChargeRule::ForceSquared, earned_ppm: 100_000, channels };
        (0..5).map(|channel| credit.drive_time_ms_until_credit_runs_out_if_ever(channel)).collect::<Vec<_>>()
    };
    assert_eq!(lasts(first), [None, None, Some(60_000_000_000), Some(10_000), None]);
    assert_eq!(lasts(second), [Some(0), None, None, None, None]);
}
