//! Drives: their registers, and what their pins do while they change.

use super::bench::Bench;
use super::channels::CHANNELS;
use super::expected::{code, programmed, registers, told, told_as_seen};
use super::table::Table;
use crate::error::Error;
use era_shared::limits::GUARD_NANOSECONDS;
use era_shared::protocol::{ChannelDrive, Reply};
use era_shared::waveform::Pulse;

/// Two channels in step, two on their own, from slow to fast; two voltages, one for each rail.
pub const FIRST: [ChannelDrive; 4] = [
    drive(0, 200_000, 800_000, 0, 600_000),
    drive(1, 200_000, 600_000, 250_000, 500_000),
    drive(2, 61_500, 900_000, 0, 600_000),
    drive(3, 1_000_000, 500_000, 100_000, 500_000),
];

/// How long a change may take to reach the registers of all channels, in s: a soft start to 600 V takes 30 ms, a gap before
/// a common phase three periods of the slowest.
const SETTLED_S: f64 = 0.25;

/// How many changes [`many_changes`] makes.
const CHANGES: usize = 40;

/// One drive.
pub const fn drive(
    channel: u8,
    frequency_millihertz: u32,
    pulse_width_ppm: u32,
    phase_microturns: u32,
    voltage_millivolts: u32,
) -> ChannelDrive {
    ChannelDrive { channel, frequency_millihertz, pulse_width_ppm, phase_microturns, voltage_millivolts }
}

/// Sets drives and checks that the board comes to them, and what its pins do on the way.
///
/// # Errors
/// If the board does not answer.
pub fn change(
    bench: &mut Bench,
    table: &mut Table,
    name: &str,
    before: Option<&[ChannelDrive; 4]>,
    drives: &[ChannelDrive; 4],
) -> Result<(), Error> {
    bench.follow_edges()?;
    bench.edges.begin();
    let began = bench.clock()?;
    let refused = bench.drive(drives)?;
    table.same(&format!("{name}: accepted"), "None", &format!("{refused:?}"));
    bench.keep_alive(SETTLED_S)?;
    bench.follow_edges()?;
    let ended = bench.clock()?;
    drives_in_force(bench, table, name, drives)?;
    check_pulses(bench, table, name, (began, ended), &[before, Some(drives)])
}

/// Registers, rails and phases with these drives.
///
/// # Errors
/// If the board does not answer.
pub fn drives_in_force(
    bench: &mut Bench,
    table: &mut Table,
    name: &str,
    drives: &[ChannelDrive; 4],
) -> Result<(), Error> {
    for ((channel, drive), seen) in CHANNELS.into_iter().zip(drives).zip(bench.timers()?) {
        let expected = told(channel, &registers(channel, Some(drive))?, true);
        table.same(&format!("{name}: {}", channel.timer), &expected, &told_as_seen(channel, &seen));
    }
    let [one, two, ..] = drives;
    let expected = format!("DAC {}/{}", code(one.voltage_millivolts), code(two.voltage_millivolts));
    let [seen_one, seen_two] = bench.rails()?.rails;
    table.same(&format!("{name}: rails"), &expected, &format!("DAC {seen_one}/{seen_two}"));
    let (first, second) = (programmed(one)?, programmed(two)?);
    if first.period_clocks() == second.period_clocks()
        && let [track_one, track_two, ..] = &bench.edges.tracks
        && let (Some((origin_one, divider, period)), Some((origin_two, _, other))) =
            (track_one.lattice(), track_two.lattice())
    {
        table.same(&format!("{name}: clocks in a period"), &period.to_string(), &other.to_string());
        // Counter 1 minus counter 2 at any moment, in clocks; it should be the difference of their places at the origin.
        let seen = (origin_two + period - origin_one % period) % period;
        let wanted = (first.origin_clocks + period - second.origin_clocks % period) % period;
        let apart = seen.abs_diff(wanted);
        let error = apart.min(period - apart.min(period));
        let ticks = error as f64 / divider as f64;
        table.row(
            &format!("{name}: phase of 1 and 2"),
            "within 1 tick",
            &format!("{ticks:.2} ticks off"),
            ticks <= 1.0,
        );
    }
    Ok(())
}

/// Changes of everything but the voltages, faster than the slower channels can follow: what has not been taken over when the
/// next one comes must leave no trace.
///
/// # Errors
/// If the board does not answer.
pub fn many_changes(bench: &mut Bench, table: &mut Table, before: &[ChannelDrive; 4]) -> Result<(), Error> {
    bench.follow_edges()?;
    bench.edges.begin();
    let began = bench.clock()?;
    // Knuth's generator (MMIX): the same changes every time.
    let mut state = 1_u64;
    let mut random = |least: u32, most: u32| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        least + u32::try_from((state >> 33) % u64::from(most - least + 1)).unwrap_or(0)
    };
    let mut sets = vec![*before];
    for _ in 0..CHANGES {
        let mut drives = FIRST;
        let common = random(20_000, 400_000);
        for drive in &mut drives {
            // Two channels in step in every second set on average, so that phases are moved too.
            drive.frequency_millihertz = if random(0, 1) == 0 { common } else { random(20_000, 400_000) };
            drive.pulse_width_ppm = random(50_000, 800_000);
            drive.phase_microturns = random(0, 999_999);
        }
        if let Some(refusal) = bench.drive(&drives)? {
            return Err(Error::NoReply(format!("{drives:?}: {refusal:?}")));
        }
        bench.run(f64::from(random(1, 40)) * 1e-3)?;
        sets.push(drives);
    }
    bench.keep_alive(SETTLED_S)?;
    bench.follow_edges()?;
    let ended = bench.clock()?;
    if let Some(last) = sets.last() {
        drives_in_force(bench, table, "many changes", last)?;
    }
    let sets: Vec<_> = sets.iter().map(Some).collect();
    check_pulses(bench, table, "many changes", (began, ended), &sets)
}

/// Overlaps, guards and pulses that neither the drives before nor those after make.
fn check_pulses(
    bench: &mut Bench,
    table: &mut Table,
    name: &str,
    (began, ended): (u64, u64),
    drives: &[Option<&[ChannelDrive; 4]>],
) -> Result<(), Error> {
    let (overlap, guard, count) = bench.edges.total();
    let mut odd = 0;
    for (index, track) in bench.edges.tracks.iter().enumerate() {
        let mut widths = Vec::new();
        for drive in drives.iter().filter_map(|set| set.and_then(|set| set.get(index))) {
            let program = programmed(drive)?;
            widths.push(u64::from(program.width) * u64::from(program.divider));
        }
        let whole = merged(&track.pulses).into_iter().filter(|pulse| pulse.from > began && pulse.to < ended);
        odd += whole.filter(|pulse| !widths.contains(&(pulse.to - pulse.from))).count();
    }
    let least = u64::from(GUARD_NANOSECONDS) * 170 / 1000;
    let microseconds = guard.map_or(f64::NAN, |clocks| clocks as f64 / 170.0);
    table.row(
        &format!("{name}: pins"),
        &format!("overlap 0, guard >= {} us, runts 0", GUARD_NANOSECONDS / 1000),
        &format!("overlap {overlap}, guard {microseconds:.1} us, runts {odd} of {count} pulses"),
        overlap == 0 && guard.is_some_and(|guard| guard >= least) && odd == 0 && count > 0,
    );
    Ok(())
}

/// Pulses of which those that touch are one.
pub fn merged(pulses: &[Pulse]) -> Vec<Pulse> {
    let mut whole: Vec<Pulse> = Vec::new();
    for pulse in pulses {
        match whole.last_mut() {
            Some(last) if last.electrode == pulse.electrode && last.to == pulse.from => last.to = pulse.to,
            _ => whole.push(*pulse),
        }
    }
    whole
}

/// A row for a reply.
pub fn show(seen: Reply, expected: Reply, table: &mut Table, name: &str) {
    table.same(name, &format!("{expected:?}"), &format!("{seen:?}"));
}
