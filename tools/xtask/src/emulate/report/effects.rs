//! Envelopes that the board plays by itself.

use super::bench::{Bench, CLOCKS_PER_MS};
use super::drives::{drive, merged};
use super::edges::letter;
use super::expected::programmed;
use super::table::Table;
use crate::error::Error;
use era_shared::protocol::{ChannelDrive, Reply, Request};
use era_shared::waveform::{Effect, Segment};
use std::f64::consts::PI;

/// What is played on: 200 Hz, so that a cycle takes 5 ms.
const CLICK: ChannelDrive = drive(0, 200_000, 800_000, 0, 600_000);
const RAMP: ChannelDrive = drive(1, 400_000, 600_000, 0, 500_000);
/// How far ahead the effects are set, in us of the board's time.
const LEAD_US: u64 = 30_000;
/// What the board's clock and the electrodes' timers may differ by, in ms: a few ticks of a microsecond.
const CLOCKS_APART_MS: f64 = 0.01;
const RAMP_MS: u16 = 100;
/// How far the force's fundamental may be from the level commanded, as a part of full force: a thousandth is the level's own
/// step, a tick of the width at 400 Hz is another ten-thousandth.
const LEVEL_TOLERANCE: f64 = 0.002;

/// A click with its brake on one channel, a ramp on another.
///
/// # Errors
/// If the board does not answer.
pub fn steps(bench: &mut Bench, table: &mut Table) -> Result<(), Error> {
    let prepared = bench.request(&Request::Prepare { drives: [CLICK, RAMP].into_iter().collect() })?;
    let is_prepared = matches!(prepared, Reply::Prepared { .. });
    table.row("prepare", "Prepared", &format!("{prepared:?}").chars().take(8).collect::<String>(), is_prepared);
    bench.keep_alive(0.15)?;
    bench.follow_edges()?;
    bench.edges.begin();
    bench.keep_alive(0.05)?;
    bench.follow_edges()?;
    table.same("prepared: pulses before the start", "0", &bench.edges.total().2.to_string());

    // The board looks at its clock at some time between these two; its answer is read up to one tick of its task later.
    let before = bench.clock()?;
    let Reply::Clock { now_us } = bench.request(&Request::Clock)? else {
        return Err(Error::NoReply("Clock".to_owned()));
    };
    let start = [before, bench.clock()?].map(|clock| clock + LEAD_US * 170);
    let ramp = Segment::Ramp { from: 0, to: 1000, milliseconds: RAMP_MS };
    let swell = Effect { segments: [ramp].into_iter().collect(), times: 1 };
    for (channel, effect) in [(0, Effect::new_click(4, 2)), (1, swell)] {
        let reply = bench.request(&Request::Play { channel, start_us: now_us + LEAD_US, effect })?;
        table.same(&format!("play on channel {channel}"), "Playing", &format!("{reply:?}"));
    }
    bench.keep_alive(0.25)?;
    bench.follow_edges()?;
    let (overlap, guard, _) = bench.edges.total();
    let guard_us = guard.map_or(f64::NAN, |clocks| clocks as f64 / 170.0);
    let seen = format!("overlap {overlap}, guard {guard_us:.1} us");
    table.row("effects: pins", "overlap 0, guard >= 200 us", &seen, overlap == 0 && guard_us >= 200.0);
    click(bench, table, start)?;
    level(bench, table)
}

/// Four cycles, two reversed ones, then nothing; from the first boundary after the start.
fn click(bench: &Bench, table: &mut Table, start: [u64; 2]) -> Result<(), Error> {
    let [track, ..] = &bench.edges.tracks;
    let pulses = merged(&track.pulses);
    let order: String = pulses.iter().map(|pulse| letter(pulse.electrode)).collect();
    table.same("click: electrodes in order", "ABABABABBABA", &order);
    let program = programmed(&CLICK)?;
    let period_ms = program.period_clocks() as f64 / CLOCKS_PER_MS;
    let [earliest, latest] = start;
    let unsure_ms = (latest - earliest) as f64 / CLOCKS_PER_MS;
    let late = pulses.first().map(|first| {
        let boundary = first.from - u64::from(program.full_level_period().a.on) * u64::from(program.divider);
        (boundary as f64 - earliest as f64) / CLOCKS_PER_MS
    });
    let expected = format!("0 to {:.1} ms after it, which is known to {unsure_ms:.1} ms", period_ms);
    let seen = late.map_or("never".to_owned(), |late| format!("{late:.2} ms after its earliest"));
    let possible = -CLOCKS_APART_MS..=period_ms + unsure_ms + CLOCKS_APART_MS;
    let right = late.is_some_and(|late| possible.contains(&late));
    table.row("click: boundary against the start set", &expected, &seen, right);
    Ok(())
}

/// The fundamental of the force goes with sin(pi w / 2), w the part of a half period that a window takes.
fn level(bench: &Bench, table: &mut Table) -> Result<(), Error> {
    let [_, track, ..] = &bench.edges.tracks;
    let program = programmed(&RAMP)?;
    let clocks = program.period_clocks();
    let force = |width: u64| (PI * width as f64 / clocks as f64).sin();
    let full = force(u64::from(program.width) * u64::from(program.divider));
    let Some((origin, _, _)) = track.lattice() else { return Err(Error::NoReply("pulses of the ramp".to_owned())) };
    let pulses = merged(&track.pulses);
    let Some(first) = pulses.first() else { return Err(Error::NoReply("pulses of the ramp".to_owned())) };
    // Period of a pulse, counted from that of the first one, which begins at the ramp's start or one period later.
    let period = |at: u64| ((at + clocks - origin % clocks) / clocks) as f64;
    let cycles = f64::from(RAMP_MS) * CLOCKS_PER_MS / clocks as f64;
    let mut worst: f64 = 0.0;
    for pulse in &pulses {
        let wanted = (period(pulse.from) - period(first.from) + 0.5) / cycles;
        worst = worst.max((force(pulse.to - pulse.from) / full - wanted).abs());
    }
    let seen = format!("{} pulses, worst {:.4} of full force", pulses.len(), worst);
    let expected = format!("{} pulses, each within {LEVEL_TOLERANCE} of its level", (2.0 * cycles).round());
    let right = pulses.len() == (2.0 * cycles).round() as usize && worst <= LEVEL_TOLERANCE;
    table.row("ramp: fundamental of the force", &expected, &seen, right);
    Ok(())
}
