//! From events to what a board plays one after the other: clicks, and envelopes of up to eight segments.
//!
//! A panel plays one thing at a time. Vibrations at one place are added; two places at the same time, and what a click interrupts, are left out
//! with a warning.

use super::error::ReadError;
use super::events::{EventKind, EventList, HapticEvent, envelope_level_at};
use era_shared::waveform::{FULL_LEVEL, SEGMENTS, Segment};

/// Time that belongs to a click alone, in ms: windows for some 30 ms, and what rings after them. More than 20 clicks per second run into each other.
const CLICK_MS: usize = 50;
/// From this sharpness on a pulse is a tick.
const TICK_FROM: f64 = 2.0 / 3.0;
/// From this sharpness on a pulse is a click, and below it a thud.
const CLICK_FROM: f64 = 1.0 / 3.0;
/// Level below which nothing is felt.
const NOTHING: f64 = 0.02;
/// How far the segments of an envelope may be from it at first.
const TOLERANCE: f64 = 0.03;
/// A difference between one ms and the next that is a step.
const STEP: f64 = 0.2;
/// A pause in ms that ends an envelope; a shorter one is a segment of it.
const PAUSE_MS: usize = 80;
/// Longest line, and length from which on an envelope ends, in ms: with the next line it stays within a burst of the board, 10 s.
const LONG_MS: usize = 4000;
/// Most places at which an effect has vibrations: each needs 30 000 levels. Players take at most 100 parts.
const MAX_PLACES: usize = 100;
/// Most envelopes of an effect; beyond it they are coarser.
const MAX_ENVELOPES: usize = 64;

/// How a pulse is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PulseKind {
    /// Windows that leave nothing after 30 ms, even if they are weaker.
    Tick,
    /// Windows that leave nothing after 45 ms.
    Click,
    /// A push of a few cycles with a brake.
    Thud,
}

/// What is played at a time.
#[derive(Clone, Debug, PartialEq)]
pub enum PartContent {
    /// One pulse, 0 to 1 strong.
    Pulse(PulseKind, f64),
    /// A vibration.
    Envelope(Vec<Segment>),
}

/// A part of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// When it begins, in ms.
    pub begin_ms: usize,
    /// To the right of the touched place, and below it, in mm.
    pub offset_mm: (f64, f64),
    /// Strength, 0 to 1; of an envelope the largest level.
    pub intensity: f64,
    /// 0 to 1.
    pub sharpness: f64,
    /// What it is.
    pub content: PartContent,
}

/// How a pulse of a sharpness is made.
#[must_use]
pub fn choose_pulse_kind(sharpness: f64) -> PulseKind {
    match sharpness {
        sharp if sharp >= TICK_FROM => PulseKind::Tick,
        middle if middle >= CLICK_FROM => PulseKind::Click,
        _ => PulseKind::Thud,
    }
}

/// The parts of a list, by their begins, and what was left out.
///
/// # Errors
/// [`ReadError::NothingFelt`], or [`ReadError::Field`]: vibrations at too many places.
pub fn cut_events_into_parts(list: &EventList) -> Result<(Vec<Part>, Vec<String>), ReadError> {
    let mut warnings = Vec::new();
    let mut parts = choose_pulses(list, &mut warnings);
    let pulses: Vec<usize> = parts.iter().map(|part| part.begin_ms).collect();
    let mut curves = draw_curves(list, &mut warnings)?;
    let mut interrupted = 0;
    for curve in &mut curves {
        for begin in &pulses {
            curve.pulses.push(*begin);
            let taken = curve.levels.get_mut(*begin..).unwrap_or_default();
            let taken: Vec<&mut f64> = taken.iter_mut().take(CLICK_MS).collect();
            interrupted += usize::from(taken.iter().any(|level| **level >= NOTHING));
            taken.into_iter().for_each(|level| *level = 0.0);
        }
    }
    if interrupted > 0 {
        warnings.push(format!(
            "interruptions of a vibration: {interrupted}. A vibration stops for {CLICK_MS} ms at each pulse, because the \
             board plays one event at a time"
        ));
    }
    let mut tolerance = TOLERANCE;
    let envelopes = loop {
        let envelopes: Vec<Part> = curves.iter().flat_map(|curve| curve.cut_into_parts(tolerance)).collect();
        if envelopes.len() <= MAX_ENVELOPES || tolerance > 1.0 {
            break envelopes;
        }
        tolerance *= 2.0;
    };
    if tolerance > TOLERANCE {
        warnings.push(format!(
            "changes in intensity over time are played with an error of up to {:.0} %, because a \
            smaller error would need too many segments",
            1e2 * tolerance
        ));
    }
    parts.extend(envelopes);
    parts.sort_by_key(|part| part.begin_ms);
    if parts.is_empty() {
        return Err(ReadError::NothingFelt { least: NOTHING });
    }
    Ok((parts, warnings))
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 30000 ms")]
fn round_to_ms(time_s: f64) -> usize {
    (1e3 * time_s).round().max(0.0) as usize
}

/// The pulses that are far enough from each other; of two that are closer the stronger one.
fn choose_pulses(list: &EventList, warnings: &mut Vec<String>) -> Vec<Part> {
    let mut pulses: Vec<Part> = Vec::new();
    let mut left_out = 0;
    for event in list.events.iter().filter(|event| event.kind == EventKind::Transient) {
        let part = Part {
            begin_ms: round_to_ms(event.time_s),
            offset_mm: (event.dx_mm, event.dy_mm),
            intensity: event.intensity,
            sharpness: event.sharpness,
            content: PartContent::Pulse(choose_pulse_kind(event.sharpness), event.intensity),
        };
        match pulses.last_mut() {
            Some(before) if part.begin_ms < before.begin_ms + CLICK_MS => {
                left_out += 1;
                if part.intensity > before.intensity {
                    *before = part;
                }
            }
            _ => pulses.push(part),
        }
    }
    if left_out > 0 {
        warnings.push(format!(
            "pulses left out: {left_out}. A stronger pulse is less than {CLICK_MS} ms away from each of them"
        ));
    }
    // A stronger one that took an earlier one's place may be too close to the next.
    pulses.dedup_by(|later, earlier| later.begin_ms < earlier.begin_ms + CLICK_MS);
    pulses
}

/// Intensity over time at one place.
struct Curve {
    offset_mm: (f64, f64),
    /// From each ms on.
    sharpness: Vec<(usize, f64)>,
    /// For every ms.
    levels: Vec<f64>,
    /// When pulses begin, in ms.
    pulses: Vec<usize>,
}

fn draw_curves(list: &EventList, warnings: &mut Vec<String>) -> Result<Vec<Curve>, ReadError> {
    let mut curves: Vec<Curve> = Vec::new();
    // For every ms the place whose vibration is felt then: there is one at most.
    let mut felt_at: Vec<Option<usize>> = Vec::new();
    let (mut elsewhere, mut clipped) = (0, false);
    for event in &list.events {
        let HapticEvent {
            time_s,
            intensity,
            sharpness,
            dx_mm,
            dy_mm,
            kind: EventKind::Continuous { duration_s, envelope },
        } = event
        else {
            continue;
        };
        let (begin, offset_mm) = (round_to_ms(*time_s), (*dx_mm, *dy_mm));
        let end = round_to_ms(time_s + duration_s).max(begin + 1);
        let place = curves.iter().position(|own| own.offset_mm == offset_mm).unwrap_or(curves.len());
        let mut felt = felt_at.iter().skip(begin).take(end - begin).flatten();
        if felt.any(|other| *other != place) {
            elsewhere += 1;
            continue;
        }
        if place == MAX_PLACES {
            let allowed = format!("at most {MAX_PLACES}");
            return Err(ReadError::new_field_error("the number of places with vibrations", place + 1, allowed));
        }
        if place == curves.len() {
            curves.push(Curve { offset_mm, sharpness: Vec::new(), levels: Vec::new(), pulses: Vec::new() });
        }
        let Some(own) = curves.get_mut(place) else { continue };
        felt_at.resize(felt_at.len().max(end), None);
        own.sharpness.push((begin, *sharpness));
        own.levels.resize(own.levels.len().max(end), 0.0);
        let levels = own.levels.get_mut(begin..end).unwrap_or_default().iter_mut();
        let felt = felt_at.get_mut(begin..end).unwrap_or_default().iter_mut();
        for ((ms, level), felt) in (0_u32..).zip(levels).zip(felt) {
            *level += intensity * envelope_level_at(envelope, 1e-3 * (f64::from(ms) + 0.5)).clamp(0.0, 1.0);
            clipped |= *level > 1.0;
            *level = level.min(1.0);
            if *level >= NOTHING {
                *felt = Some(place);
            }
        }
    }
    if elsewhere > 0 {
        warnings.push(format!(
            "number of vibrations left out: {elsewhere}. Each of them overlaps in time with a vibration of the effect at another place"
        ));
    }
    if clipped {
        warnings
            .push("the intensities of simultaneous vibrations add up to more than 1; the effect uses 1 instead".into());
    }
    Ok(curves)
}

/// A straight line over some ms.
struct Line {
    begin: usize,
    end: usize,
    from: f64,
    to: f64,
}

impl Line {
    fn is_silent(&self) -> bool {
        self.from < NOTHING && self.to < NOTHING
    }

    #[expect(clippy::cast_possible_truncation, reason = "levels of 0 to 1000, lengths of up to 30000 ms")]
    fn to_segment(&self) -> Segment {
        let level = |level: f64| (level * f64::from(FULL_LEVEL)).round() as i16;
        let milliseconds = u16::try_from(self.end - self.begin).unwrap_or(u16::MAX);
        if (self.from - self.to).abs() < NOTHING {
            Segment::Hold { level: level(0.5 * (self.from + self.to)), milliseconds }
        } else {
            Segment::Ramp { from: level(self.from), to: level(self.to), milliseconds }
        }
    }
}

impl Curve {
    fn cut_into_parts(&self, tolerance: f64) -> Vec<Part> {
        let mut parts = Vec::new();
        let mut open: Vec<Line> = Vec::new();
        for line in fit_lines(&self.levels, tolerance) {
            let has_pulse = self.pulses.iter().any(|pulse| (line.begin..line.end).contains(pulse));
            if line.is_silent() && (open.is_empty() || has_pulse || line.end - line.begin >= PAUSE_MS) {
                parts.extend(self.close_part(&mut open));
                continue;
            }
            open.push(line);
            let length_ms: usize = open.iter().map(|line| line.end - line.begin).sum();
            if open.len() == SEGMENTS || length_ms >= LONG_MS {
                parts.extend(self.close_part(&mut open));
            }
        }
        parts.extend(self.close_part(&mut open));
        parts
    }

    fn close_part(&self, open: &mut Vec<Line>) -> Option<Part> {
        while open.last().is_some_and(Line::is_silent) {
            open.pop();
        }
        let lines = std::mem::take(open);
        let begin_ms = lines.first()?.begin;
        let sharpness = self.sharpness.iter().rev().find(|(begin, _)| *begin <= begin_ms);
        Some(Part {
            begin_ms,
            offset_mm: self.offset_mm,
            intensity: lines.iter().fold(0.0, |most, line| line.from.max(line.to).max(most)),
            sharpness: sharpness.map_or(0.0, |(_, sharpness)| *sharpness),
            content: PartContent::Envelope(lines.iter().map(Line::to_segment).collect()),
        })
    }
}

/// Lines that are within a tolerance of the levels: each goes on from its first level for as long as one slope fits all. One sample stands for
/// the ms that begins with it.
#[expect(clippy::cast_precision_loss, reason = "up to 30000 ms")]
fn fit_lines(levels: &[f64], tolerance: f64) -> Vec<Line> {
    let mut lines = Vec::new();
    let mut begin = 0;
    while let Some(from) = levels.get(begin).copied() {
        let (mut least, mut most) = (f64::NEG_INFINITY, f64::INFINITY);
        let mut end = begin + 1;
        while let (Some(before), Some(now)) = (levels.get(end - 1), levels.get(end)) {
            let is_step = (now - before).abs() > STEP.max(2.0 * tolerance);
            let changes_silence = (*before < NOTHING) != (*now < NOTHING);
            let along = (end - begin) as f64;
            let (low, high) = (least.max((now - tolerance - from) / along), most.min((now + tolerance - from) / along));
            if is_step || changes_silence || low > high || end - begin >= LONG_MS {
                break;
            }
            (least, most, end) = (low, high, end + 1);
        }
        let slope = if least.is_finite() { 0.5 * (least + most) } else { 0.0 };
        let to = (from + slope * (end - begin) as f64).clamp(0.0, 1.0);
        lines.push(Line { begin, end, from: from.clamp(0.0, 1.0), to });
        begin = end;
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect_files::events::EnvelopePoint;
    use crate::effect_files::format::FileFormat;

    fn make_event_list(events: Vec<HapticEvent>) -> EventList {
        let mut list = EventList::new(FileFormat::Json, None);
        events.into_iter().for_each(|event| list.add_event_within_limits("event", event));
        list.finish().unwrap()
    }

    fn make_vibration(begin_s: f64, duration_s: f64, intensity: f64, points: &[(f64, f64)]) -> HapticEvent {
        let envelope = points.iter().map(|(time_s, level)| EnvelopePoint { time_s: *time_s, level: *level }).collect();
        HapticEvent::new_continuous((begin_s, duration_s), intensity, 0.5, envelope)
    }

    /// The level of parts at a time, as the board plays them.
    fn played(parts: &[Part], ms: usize) -> f64 {
        for part in parts {
            let PartContent::Envelope(segments) = &part.content else { continue };
            let mut begin = part.begin_ms;
            for segment in segments {
                let (from, to, length) = match *segment {
                    Segment::Hold { level, milliseconds } => (level, level, usize::from(milliseconds)),
                    Segment::Ramp { from, to, milliseconds } => (from, to, usize::from(milliseconds)),
                    Segment::Cycles { .. } => panic!("envelopes have no cycles"),
                };
                if (begin..begin + length).contains(&ms) {
                    let along = (ms - begin) as f64 / length as f64;
                    return 1e-3 * (f64::from(from) + along * f64::from(to - from));
                }
                begin += length;
            }
        }
        0.0
    }

    #[test]
    fn a_ramp_and_a_hold_are_few_segments() {
        let (parts, warnings) = cut_events_into_parts(&make_event_list(vec![make_vibration(
            0.1,
            0.6,
            0.8,
            &[(0.0, 0.0), (0.2, 1.0), (0.5, 1.0), (0.5, 0.25)],
        )]))
        .unwrap();
        assert_eq!((parts.len(), &warnings[..]), (1, &[][..]));
        let PartContent::Envelope(segments) = &parts[0].content else { panic!("an envelope") };
        assert!(segments.len() <= 5, "{segments:?}");
        for (ms, level) in [(110, 0.04), (200, 0.4), (400, 0.8), (590, 0.8), (610, 0.2), (690, 0.2), (705, 0.0)] {
            assert!((played(&parts, ms) - level).abs() < 0.05, "{ms}: {} {segments:?}", played(&parts, ms));
        }
    }

    #[test]
    fn pulses_interrupt_and_are_dropped() {
        let pulse = HapticEvent::new_transient;
        let events =
            vec![pulse(0.0, 0.5, 0.9), pulse(0.02, 0.8, 0.5), pulse(0.2, 1.0, 0.0), make_vibration(0.1, 0.3, 1.0, &[])];
        let (parts, warnings) = cut_events_into_parts(&make_event_list(events)).unwrap();
        let kinds: Vec<(usize, Option<PulseKind>)> = parts
            .iter()
            .map(|part| (part.begin_ms, if let PartContent::Pulse(kind, _) = part.content { Some(kind) } else { None }))
            .collect();
        assert_eq!(kinds, [(20, Some(PulseKind::Click)), (100, None), (200, Some(PulseKind::Thud)), (250, None)]);
        assert_eq!((played(&parts, 199), played(&parts, 220), played(&parts, 260)), (1.0, 0.0, 1.0));
        let said = warnings.join("\n");
        assert!(said.contains("pulses left out: 1.") && said.contains("interruptions of a vibration: 1."), "{said}");
    }

    #[test]
    fn places_do_not_play_at_the_same_time() {
        let beside = HapticEvent { dx_mm: 20.0, ..make_vibration(0.1, 0.3, 1.0, &[]) };
        let later = HapticEvent { dx_mm: 20.0, ..make_vibration(0.5, 0.1, 0.6, &[]) };
        let (parts, warnings) = cut_events_into_parts(&make_event_list(vec![
            make_vibration(0.0, 0.2, 0.7, &[]),
            make_vibration(0.1, 0.1, 0.7, &[]),
            beside,
            later,
        ]))
        .unwrap();
        let places: Vec<(usize, f64)> = parts.iter().map(|part| (part.begin_ms, part.offset_mm.0)).collect();
        assert_eq!(places, [(0, 0.0), (500, 20.0)]);
        assert!((played(&parts, 50) - 0.7).abs() < 1e-9 && played(&parts, 150) == 1.0);
        assert_eq!(warnings.len(), 2, "{warnings:?}");
    }

    /// Weak vibrations at one place more than are allowed, each at the same time: nothing keeps them from being counted.
    #[test]
    fn vibrations_at_too_many_places_are_refused() {
        let weak = |k: usize| HapticEvent { dx_mm: k as f64, ..make_vibration(0.0, 30.0, 0.01, &[]) };
        let error = cut_events_into_parts(&make_event_list((0..=MAX_PLACES).map(weak).collect())).unwrap_err();
        assert_eq!(error.to_string(), "the number of places with vibrations is 101, but must be at most 100");
        let (parts, _) = cut_events_into_parts(&make_event_list(
            (1..MAX_PLACES).map(weak).chain([make_vibration(1.0, 1.0, 0.5, &[])]).collect(),
        ))
        .unwrap();
        assert_eq!(parts.len(), 1);
    }

    #[test]
    fn what_is_too_weak_is_refused() {
        let error =
            cut_events_into_parts(&make_event_list(vec![make_vibration(0.0, 1.0, 0.01, &[])])).unwrap_err().to_string();
        assert_eq!(error, "no event of the effect reaches the intensity 0.02, below which nothing is felt");
    }

    #[test]
    fn what_changes_all_the_time_is_coarser() {
        let points: Vec<(f64, f64)> =
            (0..3000).map(|k| (0.01 * f64::from(k), 0.1 + 0.4 * f64::from(k * 7919 % 100) / 99.0)).collect();
        let (parts, warnings) =
            cut_events_into_parts(&make_event_list(vec![make_vibration(0.0, 30.0, 1.0, &points)])).unwrap();
        assert!(parts.len() <= MAX_ENVELOPES && !parts.is_empty(), "{}", parts.len());
        assert!(
            warnings.iter().any(|warning| warning.contains("a smaller error would need too many segments")),
            "{warnings:?}"
        );
        assert!(parts.iter().all(|part| matches!(&part.content, PartContent::Envelope(own) if own.len() <= SEGMENTS)));
    }
}
