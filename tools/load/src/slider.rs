//! How long a detent of a slider takes: from the message of a moving finger to the windows of its click at the board; and what the simulated
//! board's accelerometer shows of it under the finger.

use crate::board::Bench;
use crate::daemon::{Daemon, DaemonSetup};
use crate::error::Error;
use crate::http::{Endpoint, Http};
use crate::live::Live;
use crate::times::Times;
use clap::Args;
use era::device::sim::DriveFrame;
use serde_json::json;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Between two messages of a finger: 60 a second.
const BETWEEN_MESSAGES: Duration = Duration::from_nanos(16_666_667);
/// Messages from one detent to the next: 15, 20 and 30 detents a second.
const MESSAGES_PER_DETENT: [u32; 3] = [4, 3, 2];
/// Detents of each speed, in strokes: the longest three of so many are above the p99.
const STROKES: u32 = 10;
const DETENTS_PER_STROKE: u32 = 30;
/// Between two strokes: a board that is driven for 9.5 s without a rest takes one, and no finger slides for so long.
const BETWEEN_STROKES: Duration = Duration::from_millis(500);
/// Places along the screen, in px: the finger moves there and back.
const FROM_PX: f64 = 300.0;
const PLACES: u32 = 1300;
/// Place across the screen, in px.
const Y_PX: f64 = 640.0;
/// Strength of a detent in g.
const INTENSITY_G: f64 = 0.2;
/// Part of that which the accelerometer has to show before the next detent: clicks have 0.8 of what is asked for if they can. The accelerometer
/// shows motion up to 1 kHz, some of which is not felt.
const FELT: f64 = 0.8;
/// The time between a message and the first window that is asked for, p99, in ms.
const AIM_MS: f64 = 20.0;
/// A detent that takes longer is named.
const LATE: Duration = Duration::from_millis(20);

/// The program to measure.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// The program to start
    #[arg(long, value_name = "FILE", default_value = "target/release/era")]
    program: PathBuf,
}

/// Measures each speed and prints a table.
///
/// # Errors
/// [`Error::Missed`] if a detent of up to 20 a second is not played, is not felt, or takes too long.
pub fn measure_and_print_slider_latency_failing_if_aim_is_missed(options: &Options) -> Result<(), Error> {
    let folder = tempfile::tempdir().map_err(Error::system_error("no folder for sockets"))?;
    let link = folder.path().join("board");
    let bench = Bench::new_linked_directly_to_board(link.clone())?;
    let daemon = Daemon::start(&DaemonSetup {
        program: options.program.clone(),
        device: link,
        socket: folder.path().join("era.sock"),
        cache: folder.path().join("cache"),
        clears_silence: true,
    })?;
    daemon.await_device()?;
    // The self-test and the rise of the rails belong to the first touch after a rest, and to no detent.
    Http::new(Endpoint::Tcp(daemon.address)).post("/v1/arm", "").map_err(Error::system_error("cannot arm"))?;
    std::thread::sleep(BETWEEN_STROKES);
    let mut live = Live::open(daemon.address, "").map_err(Error::Answer)?;
    println!(
        "Times are p50 / p99 / longest, from a message with a detent to the first window of its click at the board,"
    );
    println!(
        "and the measured peak under the finger until the next detent: of {INTENSITY_G} g, felt if it is {FELT} of that"
    );
    println!(
        "{:>14} {:>9} {:>9} {:>9} {:>12} {:>27}",
        "detents a s", "detents", "played", "felt", "least peak", "to the first window"
    );
    let (mut missed, mut touches) = (Vec::new(), 0);
    for messages_per_detent in MESSAGES_PER_DETENT {
        let rate = 1.0 / (BETWEEN_MESSAGES.as_secs_f64() * f64::from(messages_per_detent));
        let control = bench.sim_control();
        control.start_recording_newest_drive_frames((STROKES * DETENTS_PER_STROKE) as usize * 2);
        let (mut sent, mut peaks_g) = (Vec::new(), Vec::new());
        for _ in 0..STROKES {
            let (sent_now, peaks_now_g) =
                slide_and_list_detent_send_times_and_peaks_g(&bench, &mut live, messages_per_detent, touches)?;
            touches += u64::from(DETENTS_PER_STROKE * messages_per_detent);
            sent.extend(sent_now);
            peaks_g.extend(peaks_now_g);
        }
        let frames = control.stop_recording_and_take_recorded_frames();
        let waits = find_wait_from_each_send_to_click_windows_before_next_send(&sent, &frames);
        let mut times = Times::default();
        for wait in &waits {
            match wait {
                Some(wait) => times.add_time(*wait),
                None => times.add_missing(),
            }
        }
        let played = waits.iter().flatten().count();
        let felt = peaks_g.iter().filter(|peak_g| **peak_g >= FELT * INTENSITY_G).count();
        let least_g = peaks_g.iter().copied().fold(f64::INFINITY, f64::min);
        let times_text = times.describe_median_p99_and_longest();
        println!(
            "{rate:>14.0} {:>9} {played:>9} {felt:>9} {:>12} {times_text:>27}",
            sent.len(),
            format!("{least_g:.3} g")
        );
        let late = waits.iter().enumerate().filter(|(_, wait)| wait.is_none_or(|wait| wait > LATE));
        let late: Vec<String> =
            late.map(|(detent, wait)| describe_delay_until_click_of_detent(detent, *wait)).collect();
        if let Some(late) = late.get(..late.len().min(10)).filter(|late| !late.is_empty()) {
            println!("  late: {}", late.join(", "));
        }
        let p99_ms = times.percentile_counting_missing_as_infinite_ms(99);
        // Faster detents cannot be told apart: of those that wait, only the newest is played.
        if rate < 20.5 && p99_ms.is_none_or(|p99_ms| p99_ms > AIM_MS) {
            missed.push(format!("a detent within {AIM_MS} ms at {rate:.0} a second"));
        }
        if rate < 20.5 && felt < peaks_g.len() {
            missed.push(format!("every detent felt at {rate:.0} a second"));
        }
    }
    if missed.is_empty() { Ok(()) } else { Err(Error::Missed(missed.join(", "))) }
}

/// Moves a finger and lifts it, with touches that are numbered from `first_touch` on: when each message with a detent was sent, and the peak in g
/// that was measured from there to the next.
fn slide_and_list_detent_send_times_and_peaks_g(
    bench: &Bench,
    live: &mut Live,
    messages_per_detent: u32,
    first_touch: u64,
) -> Result<(Vec<Instant>, Vec<f64>), Error> {
    let begun = Instant::now();
    let mut sent = Vec::new();
    for message in 0..DETENTS_PER_STROKE * messages_per_detent {
        std::thread::sleep((begun + BETWEEN_MESSAGES * message).saturating_duration_since(Instant::now()));
        let x_px = FROM_PX + f64::from(message * 10 % PLACES);
        let touches = json!([{"id": 1, "x_px": x_px, "y_px": Y_PX}]);
        let is_detent = message % messages_per_detent == 0;
        let body = if is_detent {
            json!({"type": "touch", "touches": touches, "effect": "click", "intensity_g": INTENSITY_G})
        } else {
            json!({"type": "touch", "touches": touches, "intensity_g": 0})
        };
        if is_detent {
            bench.place_accelerometer_for_touch_at_px(first_touch + u64::from(message), x_px, Y_PX)?;
            sent.push(Instant::now());
        }
        live.send(&body).map_err(Error::Answer)?;
    }
    live.send(&json!({"type": "touch", "touches": []})).map_err(Error::Answer)?;
    std::thread::sleep(BETWEEN_STROKES);
    let detents = (0..DETENTS_PER_STROKE).map(|detent| first_touch + u64::from(detent * messages_per_detent));
    let peaks_g = detents.map(|id| bench.measured_peak_of_touch_or_zero_g(id)).collect();
    Ok((sent, peaks_g))
}

/// From each message to the first window of the click that the board has accepted before the next message with a detent; `None` where there is
/// none.
fn find_wait_from_each_send_to_click_windows_before_next_send(
    sent: &[Instant],
    frames: &[DriveFrame],
) -> Vec<Option<Duration>> {
    let find_wait = |(detent, at): (usize, &Instant)| {
        let next = sent.get(detent + 1);
        let own = frames.iter().filter(|frame| frame.at >= *at && next.is_none_or(|next| frame.at < *next));
        own.filter_map(|frame| Some(frame.at.duration_since(*at) + frame.windows_begin_after?)).next()
    };
    sent.iter().enumerate().map(find_wait).collect()
}

fn describe_delay_until_click_of_detent(detent: usize, wait: Option<Duration>) -> String {
    let wait = wait.map_or_else(|| "not played".to_owned(), |wait| format!("{:.1} ms", wait.as_secs_f64() * 1e3));
    format!("detent {} {wait}", detent + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_detent_has_the_first_frame_before_the_next_one() {
        let begun = Instant::now();
        let at = |ms| begun + Duration::from_millis(ms);
        let frame = |ms, window_count| DriveFrame {
            at: at(ms),
            drives: Vec::new(),
            window_count,
            windows_begin_after: (window_count > 0).then_some(Duration::ZERO),
        };
        let frames = [frame(1, 0), frame(3, 5), frame(4, 5), frame(27, 5)];
        let waits = find_wait_from_each_send_to_click_windows_before_next_send(&[at(0), at(10), at(20)], &frames);
        assert_eq!(waits, [Some(Duration::from_millis(3)), None, Some(Duration::from_millis(7))]);
    }
}
