//! A finger on one live socket: one thread sends its places when they are due, another reads what comes. A finger that comes seldom taps;
//! one that comes often moves.

use super::touches::{Touch, TouchEnd};
use super::{Pace, distinct_x_px_of_touch};
use crate::live::Live;
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::time::{Duration, Instant};

/// Time for the last plans to come.
const LAST: Duration = Duration::from_millis(300);

/// Moves the finger when that is due.
///
/// # Errors
/// What is wrong with the socket.
pub fn send_touches_over_live(address: SocketAddr, pace: Pace) -> Result<Vec<Touch>, String> {
    let mut reader = Live::open(address, "plan")?;
    let mut writer = reader.clone_writer()?;
    let until = pace.until + LAST;
    let (sent, messages) = std::thread::scope(|threads| {
        let reads = threads.spawn(move || read_messages(&mut reader, until));
        let sent = send_finger_places_and_list_due_times(&mut writer, pace);
        let messages =
            reads.join().unwrap_or_else(|_| Err("the thread that reads the live socket has panicked".into()));
        // Lifted when all is read: what the daemon says of that is nobody's place.
        let lifted = writer.send(&json!({"type": "touch", "touches": []}));
        Ok::<_, String>((sent.and_then(|sent| lifted.map(|()| sent))?, messages?))
    })?;
    Ok(tell_outcome_of_each_touch_from_messages(pace.first, &sent, &messages))
}

/// How long a finger that taps is down: as long as a touch of the other ways in.
const TAP: Duration = Duration::from_millis(100);
/// Time between two places from which on the finger is lifted in between. One that stays down is a drag, which the board interrupts every
/// 9.5 s for a rest: a place that comes in it waits for its end, 115 ms, by the board's own rule.
const TAPS: Duration = Duration::from_millis(500);

/// When each place was due.
fn send_finger_places_and_list_due_times(writer: &mut Live, pace: Pace) -> Result<Vec<Instant>, String> {
    let mut sent = Vec::new();
    for k in 0.. {
        let Some(due) = pace.due_time_unless_past_end(k) else { break };
        pace.sleep_until_due(due);
        let finger = json!({"id": 1, "x_px": pace.touch_x_px(k), "y_px": 640, "intensity_g": 0.3});
        writer.send(&json!({"type": "touch", "touches": [finger]}))?;
        sent.push(due);
        if pace.every >= TAPS {
            std::thread::sleep(TAP);
            writer.send(&json!({"type": "touch", "touches": []}))?;
        }
    }
    Ok(sent)
}

fn read_messages(reader: &mut Live, until: Instant) -> Result<Vec<(Instant, Value)>, String> {
    let mut all = Vec::new();
    while Instant::now() < until {
        if let Some(message) = reader.read_next_json_message_until_none_if_late_or_not_text(until)? {
            all.push((Instant::now(), message));
        }
    }
    Ok(all)
}

/// What became of each place, of which the first has the number `first_number`. The daemon takes them in their order: a plan for one says that those before it are driven no more.
fn tell_outcome_of_each_touch_from_messages(
    first_number: u32,
    due: &[Instant],
    messages: &[(Instant, Value)],
) -> Vec<Touch> {
    let mut all: Vec<Touch> = Vec::with_capacity(due.len());
    for (at, message) in messages {
        if message["type"] == "error" {
            // It does not say for which: the oldest that may have been meant.
            if let Some(due) = due.get(all.len()).filter(|due| **due <= *at) {
                all.push(Touch {
                    due: *due,
                    ended: *at,
                    end: TouchEnd::overtaken_if_problem_is_superseded_else_refused(&message["problem"]),
                });
            }
            continue;
        }
        let Some(place) = message["touches"][0]["x_px"].as_f64() else { continue };
        let begun = due.iter().zip(0_u32..).skip(all.len()).take_while(|(due, _)| **due <= *at);
        let Some(found) =
            begun.map(|(_, k)| k).find(|k| distinct_x_px_of_touch(first_number.wrapping_add(*k)) == place)
        else {
            continue;
        };
        while let Some((due, k)) = due.get(all.len()).zip(u32::try_from(all.len()).ok())
            && k <= found
        {
            let end = if k < found {
                TouchEnd::Overtaken
            } else {
                TouchEnd::driven_from_plan_or_refused_if_unreadable(&message["plan"])
            };
            all.push(Touch { due: *due, ended: *at, end });
        }
    }
    let last = messages.last().map(|(at, _)| *at);
    let untold = due.iter().skip(all.len()).map(|due| Touch {
        due: *due,
        ended: last.unwrap_or(*due).max(*due),
        end: TouchEnd::Refused("neither plan nor error came".into()),
    });
    let untold: Vec<Touch> = untold.collect();
    all.extend(untold);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_says_what_became_of_the_places_before_it() {
        let zero = Instant::now();
        let ms = |ms| zero + Duration::from_millis(ms);
        let due: Vec<Instant> = (0..6).map(ms).collect();
        let plan =
            |k: u32| json!({"type": "plan", "touches": [{"x_px": distinct_x_px_of_touch(k)}], "plan": {"drives": []}});
        let error = json!({"type": "error", "problem": {"type": "urn:era:problem:device-refused"}});
        let messages = [(ms(3), plan(0)), (ms(4), plan(2)), (ms(5), error), (ms(6), plan(2)), (ms(7), plan(4))];
        let ends: Vec<(u128, TouchEnd)> = tell_outcome_of_each_touch_from_messages(0, &due, &messages)
            .into_iter()
            .map(|touch| ((touch.ended - touch.due).as_millis(), touch.end))
            .collect();
        let driven = || TouchEnd::Driven(Vec::new());
        assert_eq!(
            ends,
            [
                (3, driven()),
                (3, TouchEnd::Overtaken),
                (2, driven()),
                (2, TouchEnd::Refused("device-refused".into())),
                (3, driven()),
                (2, TouchEnd::Refused("neither plan nor error came".into())),
            ]
        );
    }

    /// A place that has not been sent yet cannot have been driven.
    #[test]
    fn a_plan_for_a_place_that_is_not_due_yet_is_another_ones() {
        let zero = Instant::now();
        let due = [zero, zero + Duration::from_millis(5)];
        let early = json!({"type": "plan", "touches": [{"x_px": distinct_x_px_of_touch(1)}], "plan": {"drives": []}});
        let ends = tell_outcome_of_each_touch_from_messages(0, &due, &[(zero + Duration::from_millis(1), early)]);
        assert!(ends.iter().all(|touch| matches!(touch.end, TouchEnd::Refused(_))), "{ends:?}");
    }
}
