//! The session's stops and orders, by what it sends over a line: which goes first, which are one, which are not carried out any more.

use crate::line::Line;
use crate::support::still_panel;
use era::device::client::WaitHooks;
use era::device::session::policy::{SceneNeeds, SessionPolicy};
use era::device::sim::{SimDevice, SimKnobs};
use era::device::timing::{LinkTiming, REAL_TIME, RetryPolicy};
use era::device::{AskedAt, Client, DeviceSnapshot, DriveContent, DriveOrder, LinkError, Session, SessionError};
use era_shared::protocol::{ChannelDrive, Reply, Request};
use era_shared::safety::SafetyState;
use era_shared::waveform::Effect;
use std::pin::Pin;
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

/// Only stops that somebody asks for, and a board that is not given up.
const FOREVER: LinkTiming = link_timing_with_tries(3000);
/// One that is given up soon.
const SHORT: LinkTiming = link_timing_with_tries(3);
/// No person stands between a board that comes back and the next order.
const POLICY: SessionPolicy =
    SessionPolicy { idle: SessionPolicy::IDLE, clears_silence: false, arms_after_outage: true };
/// How long is waited for what comes at once.
const WAIT: Duration = Duration::from_secs(30);

const fn link_timing_with_tries(tries: u32) -> LinkTiming {
    LinkTiming { retry_policy: RetryPolicy { tries, stop: Duration::MAX, ..REAL_TIME.retry_policy }, ..REAL_TIME }
}

type Answer<'a, T> = Pin<Box<dyn Future<Output = Result<T, SessionError>> + 'a>>;

/// Gives an order, whose answer is not there yet.
#[track_caller]
fn given<'a, T>(order: impl Future<Output = Result<T, SessionError>> + 'a) -> Answer<'a, T> {
    let mut order: Answer<'a, T> = Box::pin(order);
    let Poll::Pending = order.as_mut().poll(&mut Context::from_waker(Waker::noop())) else {
        panic!("answered before anything could be done");
    };
    order
}

fn in_time<T>(future: impl Future<Output = T>) -> T {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
    runtime.block_on(async { tokio::time::timeout(WAIT, future).await.expect("no answer") })
}

fn until(session: &Session, wanted: impl Fn(&DeviceSnapshot) -> bool) {
    let mut snapshots = session.subscribe_snapshots();
    drop(in_time(async { snapshots.wait_for(|snapshot| wanted(snapshot)).await.unwrap().clone() }));
}

fn start_line_to_still_panel() -> Line {
    Line::to(SimDevice::start(still_panel(), vec![2000.0; 2]).unwrap())
}

/// A session with a board that answers, and the line between them.
fn session(timing: LinkTiming) -> (Session, Line) {
    let line = start_line_to_still_panel();
    let session = Session::start(line.device(timing), SceneNeeds::default(), POLICY).unwrap();
    until(&session, |snapshot| snapshot.connected && snapshot.state() == Some(SafetyState::Safe));
    (session, line)
}

fn drives() -> Vec<ChannelDrive> {
    let drive = |channel| ChannelDrive {
        channel,
        frequency_millihertz: 150_000,
        pulse_width_ppm: 900_000,
        phase_microturns: 0,
        voltage_millivolts: 500_000,
    };
    vec![drive(0), drive(1)]
}

fn drive(session: &Session) -> impl Future<Output = Result<era::device::session::DriveResult, SessionError>> + '_ {
    let content = DriveContent::Steady { drives: drives(), hold: Duration::from_secs(9), from_zero: false };
    let asked_at = AskedAt { stops: session.stop_count(), interruptions: None };
    session.begin_drive_arming_if_needed(DriveOrder { id: 1, asked_at, start: None, content })
}

/// The same, once the board drives.
fn driving(timing: LinkTiming) -> (Session, Line) {
    let (session, line) = session(timing);
    in_time(drive(&session)).unwrap();
    (session, line)
}

fn stops_since(line: &Line, since: usize) -> usize {
    line.ear().asked[since..].iter().filter(|request| **request == Request::Stop).count()
}

/// All that a line has taken since then, until it was opened anew.
fn before_hello(line: &Line, since: usize) -> Vec<Request> {
    let is_hello = |request: &Request| matches!(request, Request::Hello { .. });
    line.ear().asked[since..].split(is_hello).next().unwrap().to_vec()
}

/// A look at the board is four requests. What is ordered while the first one's answer is on its way goes before the others, and they are asked
/// after it all the same.
#[test]
fn an_order_waits_for_one_answer_and_not_for_a_whole_look() {
    let (session, line) = driving(FOREVER);
    line.set(|ear| ear.holds_at = Some(Request::Status));
    drop(line.wait_for(|ear| ear.is_held && ear.waiting > 0));
    let order = given(drive(&session));
    let since = line.mark(|ear| ear.is_held = false);
    in_time(order).unwrap();
    let rest = [Request::Telemetry, Request::Details, Request::Credit];
    let ear = line.wait_for(|ear| rest.iter().all(|request| ear.asked[since..].contains(request)));
    assert_eq!(
        ear.asked[since],
        Request::SetDrives { drives: drives().into_iter().collect() },
        "{:?}",
        &ear.asked[since..]
    );
    drop(ear);
    until(&session, |snapshot| snapshot.state() == Some(SafetyState::Running));
}

/// It says that rails have been measured below 60 V: nobody is told so beside rails that were measured before.
#[test]
fn nobody_is_told_that_it_is_safe_beside_voltage_on_the_rails() {
    const SAFE_MV: u32 = 60_000;
    for _ in 0..5 {
        let (session, _line) = driving(FOREVER);
        until(&session, |snapshot| rails_mv(snapshot) > SAFE_MV);
        let mut stop = Box::pin(session.stop_and_disarm_board());
        // It may be answered at once.
        let is_answered = stop.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_ready();
        let deadline = Instant::now() + WAIT;
        loop {
            let known = session.current_snapshot_marked_disconnected_if_thread_hung();
            let is_safe = known.state() == Some(SafetyState::Safe);
            assert!(!is_safe || rails_mv(&known) < SAFE_MV, "safe, with {} mV", rails_mv(&known));
            if is_safe {
                break;
            }
            assert!(Instant::now() < deadline, "still {:?}", known.state());
        }
        if !is_answered {
            in_time(stop).unwrap();
        }
    }
}

/// A stop that comes while a board is arming, and that while it is looked at: that it was safe before the arming does not answer the stop.
#[test]
fn a_stop_is_answered_with_what_was_seen_after_it() {
    let (session, line) = session(FOREVER);
    line.set(|ear| ear.holds_at = Some(Request::Status));
    drop(line.wait_for(|ear| ear.is_held && ear.waiting > 0));
    let arm = given(session.arm_on_person_request_unless_stopped_since(session.stop_count(), Instant::now()));
    line.set(|ear| (ear.is_held, ear.holds_at) = (false, Some(Request::KeepAlive)));
    let ear = line.wait_for(|ear| ear.is_held && ear.waiting > 0);
    assert!(
        matches!(ear.asked[..], [.., Request::Status, Request::ArmWith { .. }, Request::KeepAlive]),
        "{:?}",
        ear.asked
    );
    drop(ear);
    assert_eq!(session.current_snapshot_marked_disconnected_if_thread_hung().state(), Some(SafetyState::Arming));
    let stop = given(session.stop_and_disarm_board());
    let since = line.mark(|ear| ear.is_held = false);
    in_time(stop).unwrap();
    let asked = line.ear().asked[since..].to_vec();
    let stopped = asked.iter().position(|request| *request == Request::Stop).unwrap();
    assert!(asked[stopped..].contains(&Request::Status), "{asked:?}");
    in_time(arm).unwrap_err();
    assert_eq!(stops_since(&line, since), 1, "{asked:?}");
    until(&session, |snapshot| snapshot.state() == Some(SafetyState::Safe));
}

/// The higher of what is told of the rails.
fn rails_mv(snapshot: &DeviceSnapshot) -> u32 {
    let told = snapshot.telemetry.iter().flat_map(|telemetry| telemetry.rail_millivolts.iter());
    told.chain(snapshot.details.iter().flat_map(|details| details.rail_millivolts.iter())).copied().max().unwrap_or(0)
}

/// Asked for while the answer to something else is on its way, or lost.
#[test]
fn stops_that_come_together_are_one_frame_and_all_are_answered() {
    for is_lost in [false, true] {
        let (session, line) = driving(FOREVER);
        let since = line.mark(|ear| (ear.is_held, ear.is_deaf) = (true, is_lost));
        drop(line.wait_for(|ear| ear.waiting > 0));
        let stops: Vec<_> = (0..5).map(|_| given(session.stop_and_disarm_board())).collect();
        let asked = line.mark(|ear| (ear.is_held, ear.holds_at) = (false, is_lost.then_some(Request::Stop)));
        if is_lost {
            line.is_stopped_within(asked, 1);
            line.set(|ear| (ear.is_held, ear.is_deaf) = (false, false));
        }
        for stop in stops {
            in_time(stop).unwrap();
        }
        assert_eq!(stops_since(&line, since), 1, "{:?}", &line.ear().asked[since..]);
        until(&session, |snapshot| snapshot.state() == Some(SafetyState::Safe));
    }
}

/// What is asked for when a stop is on its way may have come too late for it: all of that together is one more.
#[test]
fn stops_that_come_while_one_is_under_way_are_one_more_frame() {
    let (session, line) = driving(FOREVER);
    let since = line.mark(|ear| ear.holds_at = Some(Request::Stop));
    let first = given(session.stop_and_disarm_board());
    drop(line.wait_for(|ear| ear.is_held && ear.waiting > 0));
    let others: Vec<_> = (0..4).map(|_| given(session.stop_and_disarm_board())).collect();
    line.set(|ear| ear.is_held = false);
    for stop in std::iter::once(first).chain(others) {
        in_time(stop).unwrap();
    }
    assert_eq!(stops_since(&line, since), 2, "{:?}", &line.ear().asked[since..]);
}

/// Not kept waiting by an answer that does not come, even where nobody would give it up: one try that begins at the same time may be before it.
#[test]
fn a_stop_is_sent_while_another_answer_is_waited_for() {
    let (session, line) = driving(FOREVER);
    line.set(|ear| ear.is_deaf = true);
    until(&session, |snapshot| snapshot.in_doubt);
    let stop = given(session.stop_and_disarm_board());
    let since = line.mark(|_| {});
    line.is_stopped_within(since, 1);
    line.goes_off();
    line.set(|ear| ear.is_deaf = false);
    in_time(stop).unwrap();
}

/// Everything that would drive or arm, asked for when the board was not known to be in doubt.
fn stale(session: &Session) -> [Answer<'_, ()>; 3] {
    let effects = vec![Effect::new_click(3, 1); 2];
    let content = DriveContent::Envelopes { drives: drives(), effects };
    let asked_at = AskedAt { stops: session.stop_count(), interruptions: None };
    let effect = DriveOrder { id: 2, asked_at, start: None, content };
    [
        given(async move { drive(session).await.map(drop) }),
        given(async move { session.begin_drive_arming_if_needed(effect).await.map(drop) }),
        given(session.arm_on_person_request_unless_stopped_since(session.stop_count(), Instant::now())),
    ]
}

/// None of these is carried out, and the next one is.
fn are_too_late(line: &Line, since: usize, session: &Session, orders: [Answer<'_, ()>; 3]) {
    for order in orders {
        let error = in_time(order).expect_err("carried out, though it was asked for long before");
        let said = error.to_string();
        assert!(
            matches!(error, SessionError::Late { .. })
                && said.contains("the request was sent while the device did not answer"),
            "{said}"
        );
    }
    let drives = |request: &&Request| {
        use Request::{Arm, ArmWith, Play, Prepare, SetDrives};
        matches!(request, Arm { .. } | ArmWith { .. } | Play { .. } | Prepare { .. } | SetDrives { .. })
    };
    assert_eq!(line.ear().asked[since..].iter().find(drives), None);
    in_time(drive(session)).unwrap();
}

#[test]
fn what_was_asked_for_before_a_doubt_is_not_driven_after_it() {
    let (session, line) = session(FOREVER);
    let since = line.mark(|ear| (ear.is_held, ear.is_deaf) = (true, true));
    drop(line.wait_for(|ear| ear.waiting > 0));
    let orders = stale(&session);
    line.set(|ear| ear.is_held = false);
    until(&session, |snapshot| snapshot.in_doubt);
    line.set(|ear| ear.is_deaf = false);
    are_too_late(&line, since, &session, orders);
}

/// The board is being looked for, which takes as long as it takes.
#[test]
fn what_was_asked_for_before_a_board_came_back_is_not_driven_then() {
    let (session, line) = session(SHORT);
    let since = line.mark(|ear| (ear.is_deaf, ear.opening_is_held) = (true, true));
    drop(line.wait_for(|ear| ear.opened == 2 && ear.waiting > 0));
    let orders = stale(&session);
    line.set(|ear| (ear.is_deaf, ear.opening_is_held) = (false, false));
    are_too_late(&line, since, &session, orders);
}

/// The board hears, and its answers are lost: before its port is given up it is told to stop.
#[test]
fn a_line_that_is_given_up_ends_with_a_stop() {
    let (session, line) = driving(SHORT);
    let since = line.mark(|ear| ear.is_deaf = true);
    until(&session, |snapshot| snapshot.outages == 1);
    let asked = before_hello(&line, since);
    let (last, questions) = asked.split_last().unwrap();
    assert!(*last == Request::Stop && !questions.contains(last), "{asked:?}");
    line.goes_off();
}

/// Half a frame is on the line: the stop is heard all the same.
#[test]
fn the_last_stop_is_received_after_half_a_frame() {
    let (session, line) = driving(SHORT);
    let since = line.mark(|ear| ear.takes = Some(5));
    until(&session, |snapshot| snapshot.outages == 1);
    assert_eq!(before_hello(&line, since), [Request::Stop]);
}

/// A stop that is due when the last try has been sent.
#[test]
fn a_stop_that_comes_in_the_last_try_is_sent_after_it() {
    let line = start_line_to_still_panel();
    let mut client = line.device(link_timing_with_tries(1)).open_client().unwrap();
    line.set(|ear| ear.is_deaf = true);
    let attention = WaitHooks { in_doubt: &mut |_, _| {}, is_stopped: &|| true };
    let answer = client.request_sending_stop_when_ordered_or_late(&Request::KeepAlive, attention);
    assert!(matches!(answer, Err(LinkError::Silent { .. })), "{answer:?}");
    assert_eq!(line.ear().asked, [Request::KeepAlive, Request::Stop]);
}

/// With the session ends what it drives, whether the board answers or not.
#[test]
fn the_end_of_a_session_is_a_stop() {
    for is_deaf in [false, true] {
        let (session, line) = driving(SHORT);
        let since = line.mark(|ear| ear.is_deaf = is_deaf);
        drop(session);
        assert!(stops_since(&line, since) > 0, "{is_deaf}: {:?}", &line.ear().asked[since..]);
        line.goes_off();
    }
}

/// A board that another program has left live, and that does not go off by itself: signs of life would keep a sound one so, too. It is greeted and
/// looked at, and nothing else comes before the stop.
#[test]
fn a_board_that_is_live_on_connecting_is_stopped() {
    let line = start_line_to_still_panel();
    let mut knobs = SimKnobs::default();
    knobs.mistakes.deaf_to_silence = true;
    line.sim().set_knobs(knobs);
    let mut other = line.device(REAL_TIME).open_client().unwrap();
    let until_it_is = |other: &mut Client, wanted| loop {
        match other.request(&Request::KeepAlive).unwrap() {
            Reply::Alive { state } if state == wanted => return,
            Reply::Alive { state: SafetyState::Boot | SafetyState::Discharging | SafetyState::Arming } => {}
            reply => panic!("{reply:?}"),
        }
    };
    until_it_is(&mut other, SafetyState::Safe);
    other.request(&Request::Arm { deadman_ms: None }).unwrap();
    until_it_is(&mut other, SafetyState::Armed);
    drop(other);
    let since = line.mark(|_| {});
    let session = Session::start(line.device(REAL_TIME), SceneNeeds::default(), POLICY).unwrap();
    line.is_stopped_within(since, 2);
    until(&session, |snapshot| snapshot.connected && snapshot.state() == Some(SafetyState::Safe));
    let snapshot = session.subscribe_snapshots().borrow().clone();
    assert!(snapshot.outages == 0 && snapshot.status.unwrap().fault.is_none());
}
