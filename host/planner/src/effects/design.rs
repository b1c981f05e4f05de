//! An effect for a plan: voltages, envelopes and what they will do.
//!
//! A click is too short for the steady peak, so its drives are stronger than the plan's in proportion, each up to its own
//! limit, and its push has as few cycles as reach the wanted peak (pushes of all drives last about equally long). Other
//! effects hold the plan's strength.
//!
//! Channels begin at the first boundary of their own period after the common start, so how the drives' cycles fall
//! together is not known beforehand: peaks are given as the mean over all offsets, with the least and the most.

use super::click;
use super::effect_drive::{PREDICTED_S, Part, Peak, STEP_S, combined, parts, signals};
use super::envelope::{Cut, length_s, levels};
use super::error::DesignError;
use super::named::{EffectRequest, NamedEffect, Shape};
use super::supply::keep_within_supply;
use super::travel::{Within, keep_within_travel};
use crate::drive::{Drive, SiDrive, on_channels};
use crate::motion::plan_motion::predict_effect_motion;
use crate::motion::plan_motion::{PlanMotion, Push};
use crate::physics::rise::RiseTimes;
use crate::plan::limitation::{self, Limitation, add};
use crate::scene::MAX_ACTUATORS;
use crate::{Plan, PlanTable, STANDARD_GRAVITY};
use era_shared::waveform::{Effect, FULL_LEVEL, Segment};

/// Most cycles of a push, of the drive of the highest frequency.
const MOST_PUSH: u16 = 8;
/// How long after an effect's end motion is looked at, in s.
const AFTER_S: f64 = 0.3;
/// How much longer it has to stay below what counts as quiet, in s: a period of 20 Hz, half the lowest frequency of a drive. Between
/// two crests anything is quiet.
const QUIET_FOR_S: f64 = 0.05;
/// How long after an effect's end its peak may come, in s: some periods of the lowest drives.
const AFTER_PEAK_S: f64 = 0.05;
/// Part of the peak below which a target is quiet.
const QUIET: f64 = 0.1;
/// Steps of bisections.
const BISECTIONS: usize = 24;
/// Part of the wished peak that counts as reached; fingers tell a tenth at best, and peaks of several drives, which equation
/// 23 adds up, meet within some percent only in a few beats.
const REACHED: f64 = 0.95;

/// One drive's part of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignedDrive {
    /// At full level.
    pub drive: Drive,
    /// What the board plays on it.
    pub effect: Effect,
}

/// What an effect should do at the first target.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct EffectPrediction {
    /// Peak acceleration in g, harmonics of the force up to 1 kHz included: mean over how the drives' cycles may fall.
    pub peak_g: f64,
    /// Least over that.
    pub peak_least_g: f64,
    /// Most over that.
    pub peak_most_g: f64,
    /// When the peak comes, in ms after the drives' first boundary, all beginning together.
    pub peak_at_ms: f64,
    /// Residual vibration: the largest acceleration after the end, relative to the peak.
    pub residual: f64,
    /// Deprecated, for one version: the same as `residual`. An actuator may be called `left`, too.
    #[cfg_attr(feature = "schema", schema(deprecated))]
    pub left: f64,
    /// From here on it stays below a tenth of the peak, in ms; `null` if not within 300 ms of the end.
    pub quiet_ms: Option<f64>,
    /// The same for a click without its brake.
    pub quiet_unbraked_ms: Option<f64>,
}

/// An effect for a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// Which.
    pub effect: NamedEffect,
    /// One per drive of the plan, in its order.
    pub drives: Vec<DesignedDrive>,
    /// At the first target.
    pub predicted: EffectPrediction,
    /// What keeps it below what was asked for, as `voltage of left`; `None` if nothing does.
    pub limited_by: Option<String>,
    /// The same for programs; empty if nothing does.
    pub limits: Vec<Limitation>,
    /// Peak at every target of the plan in g, in their order, as [`EffectPrediction::peak_g`] is that at the first.
    pub peaks_g: Vec<f64>,
    /// How long the drives are at it, in ms.
    pub length_ms: f64,
    /// Bound of every actuator's travel in m, from rest.
    pub travel_m: Vec<f64>,
}

impl Design {
    /// How far it takes the masses and what it leaves; `None` where that cannot be told.
    #[must_use]
    pub fn motion(&self, table: &PlanTable) -> Option<PlanMotion> {
        let push = |(channel, DesignedDrive { drive, effect }): (usize, &DesignedDrive)| {
            let levels = levels(effect, 1.0 / drive.frequency_hz);
            Push { channel, frequency_hz: drive.frequency_hz, force_n: drive.force_n, levels }
        };
        let pushes: Vec<Push> = self.drives.iter().enumerate().map(push).collect();
        let mut travel_m = [0.0; MAX_ACTUATORS];
        travel_m.iter_mut().zip(&self.travel_m).for_each(|(travel, known)| *travel = *known);
        predict_effect_motion(table, &pushes, &travel_m)
    }

    /// Adds a reason why it is weaker than was asked for.
    pub fn add_limit(&mut self, limit: Limitation) {
        add(&mut self.limits, limit);
        self.limited_by = limitation::text(&self.limits);
    }

    /// Its drives with their channels: actuator i of the scene is on channel i of the board.
    #[must_use]
    pub fn wire_drives(&self) -> Vec<SiDrive> {
        on_channels(self.drives.iter().map(|designed| &designed.drive))
    }
}

/// The effect for `plan`, of which the drives' frequencies and the proportions of their strength are taken.
///
/// # Errors
/// [`DesignError`].
pub fn design(table: &PlanTable, rise: &RiseTimes, plan: &Plan, request: EffectRequest) -> Result<Design, DesignError> {
    let (shape, fixed) = (request.shape()?, request.envelope()?);
    let mut parts = parts(table, rise, plan)?;
    let wanted: Vec<f64> = plan.targets.iter().map(|target| target.wanted_g * STANDARD_GRAVITY).collect();
    let mut limits = plan.limits.clone();
    let (effects, unbraked) = match shape {
        Shape::Fixed => (vec![fixed; parts.len()], None),
        Shape::Clicks { count, period_ms } => {
            let (pushes, reaches) = overdrive(&mut parts, &wanted);
            // A click may reach what the steady plan could not, and the other way round.
            limits.clear();
            let all = |segments: &[Vec<Segment>]| -> Vec<Effect> {
                segments.iter().zip(&parts).map(|(s, part)| repeated(s, count, period_ms, part)).collect()
            };
            let plain: Vec<Vec<Segment>> =
                pushes.iter().map(|push| vec![Segment::Cycles { level: FULL_LEVEL, count: *push }]).collect();
            let braked: Vec<Vec<Segment>> = parts
                .iter()
                .zip(&pushes)
                .map(|(part, push)| {
                    click::segments(&part.quiet(QUIET, &wanted, parts.len()), part.channel.period_s(), *push)
                })
                .collect();
            // What each drive's brake gains may be lost in the sum.
            let quiet = |segments: &[Vec<Segment>]| {
                let effects: Vec<Effect> =
                    segments.iter().zip(&parts).map(|(s, part)| repeated(s, 1, 0, part)).collect();
                predict(&parts, &effects, None).quiet_ms.unwrap_or(f64::INFINITY)
            };
            let segments = if quiet(&braked) < quiet(&plain) { braked } else { plain.clone() };
            let (effects, plain) = (all(&segments), all(&plain));
            // The brake's beginning may add to the peak.
            if !reaches | adjust(&mut parts, &effects, &wanted) {
                parts.iter().filter_map(|part| at_its_limit(table, part)).for_each(|limit| add(&mut limits, limit));
            }
            (effects, Some(plain))
        }
    };
    if let Some((actuator, limit)) = keep_within_supply(table, &mut parts) {
        add(&mut limits, Limitation::of(table, limit, actuator));
    }
    let Within { limited, travel_m } = keep_within_travel(table, rise, &mut parts, &effects);
    if let Some((actuator, limit)) = limited {
        add(&mut limits, Limitation::of(table, limit, actuator));
    }
    let predicted = predict(&parts, &effects, unbraked.as_deref());
    let others_g = (1..plan.targets.len()).map(|target| peak_g(&parts, &effects, target));
    let peaks_g = std::iter::once(predicted.peak_g).chain(others_g).collect();
    let length_ms = 1e3 * longest_s(&parts, &effects);
    let falls_short = wanted.first().is_some_and(|wanted| predicted.peak_most_g * STANDARD_GRAVITY < REACHED * wanted);
    if limits.is_empty() && falls_short {
        limits = if plan.limits.is_empty() { vec![Limitation::TooShort] } else { plan.limits.clone() };
    }
    let drives = plan
        .drives
        .iter()
        .zip(parts.iter().zip(effects))
        .map(|(drive, (part, effect))| {
            let electrodes = table.electrodes.get(part.drive.actuator);
            let force_n = part.drive.force_n;
            let voltage_v = electrodes.map_or(drive.voltage_v, |electrodes| {
                electrodes.voltage_for(force_n, drive.pulse_width).min(electrodes.max_voltage_v)
            });
            DesignedDrive { drive: Drive { voltage_v, force_n, ..drive.clone() }, effect }
        })
        .collect();
    let limited_by = limitation::text(&limits);
    Ok(Design { effect: request.effect, drives, predicted, limited_by, limits, peaks_g, length_ms, travel_m })
}

/// What keeps a drive from more force, if it has all there is.
fn at_its_limit(table: &PlanTable, part: &Part) -> Option<Limitation> {
    let is = part.drive.force_n > 0.0 && part.drive.force_n >= part.max_force_n * (1.0 - 1e-6);
    is.then(|| Limitation::of(table, part.limit, part.drive.actuator))
}

/// Raises the drives in proportion until every target reaches what is wanted, with the shortest push that does; the cycles
/// of each drive's push, and whether they do.
fn overdrive(parts: &mut [Part], wanted: &[f64]) -> (Vec<u16>, bool) {
    let highest_hz = parts.iter().map(|part| part.channel.frequency_hz).fold(1.0, f64::max);
    let (mut best, mut best_share) = ((vec![1; parts.len()], 1.0), -1.0);
    for cycles in 1..=MOST_PUSH {
        let pushes: Vec<u16> = parts
            .iter()
            .map(|part| {
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to MOST_PUSH")]
                let push = (f64::from(cycles) * part.channel.frequency_hz / highest_hz).round().max(1.0) as u16;
                push
            })
            .collect();
        let effects: Vec<Effect> = pushes.iter().map(|push| Effect::new_click(*push, 0)).collect();
        let signals: Vec<Vec<Vec<f64>>> =
            (0..wanted.len()).map(|target| signals(parts, &effects, target, 2.0 / highest_hz)).collect();
        // Least over the targets of what is reached of the wish, with drives raised by `raise`, each up to its limit.
        let share = |raise: f64| -> f64 {
            let peak = |(signals, wanted): (&Vec<Vec<f64>>, &f64)| {
                if *wanted <= 0.0 {
                    return f64::INFINITY;
                }
                combined(signals, parts, |part| (part.drive.force_n * raise).min(part.max_force_n)).mean / wanted
            };
            signals.iter().zip(wanted).map(peak).fold(f64::INFINITY, f64::min)
        };
        let room = parts
            .iter()
            .filter(|part| part.drive.force_n > 0.0)
            .map(|part| part.max_force_n / part.drive.force_n)
            .fold(0.0, f64::max);
        let most = share(room);
        if most >= 1.0 {
            let (mut low, mut high) = (0.0, room);
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (low + high);
                *(if share(middle) >= 1.0 { &mut high } else { &mut low }) = middle;
            }
            (best, best_share) = ((pushes, if most.is_finite() { high } else { 0.0 }), 1.0);
            break;
        }
        if most > best_share {
            (best, best_share) = ((pushes, room), most);
        }
    }
    let (pushes, raise) = best;
    for part in parts {
        part.drive.force_n = (part.drive.force_n * raise).min(part.max_force_n);
    }
    (pushes, best_share >= 1.0)
}

/// Scales all drives to the wish, as far as their limits go; says whether these keep it below.
fn adjust(parts: &mut [Part], effects: &[Effect], wanted: &[f64]) -> bool {
    let share = |(target, wanted): (usize, &f64)| {
        let peak = combined(&signals(parts, effects, target, AFTER_PEAK_S), parts, |part| part.drive.force_n).mean;
        if *wanted > 0.0 { peak / wanted } else { f64::INFINITY }
    };
    let reached = wanted.iter().enumerate().map(share).fold(f64::INFINITY, f64::min);
    if !reached.is_finite() || reached <= 0.0 {
        return false;
    }
    let room = parts.iter().filter(|part| part.drive.force_n > 0.0).map(|part| part.max_force_n / part.drive.force_n);
    let room = room.fold(f64::INFINITY, f64::min);
    parts.iter_mut().for_each(|part| part.drive.force_n *= (1.0 / reached).min(room));
    1.0 / reached > room * (1.0 + 1e-2)
}

/// `count` times the segments, `period_ms` from one to the next on a drive's own clock.
fn repeated(segments: &[Segment], count: u16, period_ms: u16, part: &Part) -> Effect {
    let mut effect = Effect { segments: segments.iter().copied().collect(), times: count };
    if count > 1 {
        let once = Effect { times: 1, ..effect.clone() };
        let pause_ms = f64::from(period_ms) - length_s(&once, part.channel.period_s()) * 1e3;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 500")]
        let milliseconds = pause_ms.round().max(1.0) as u16;
        // There is room: a click has at most four segments.
        let _ = effect.segments.push(Segment::Hold { level: 0, milliseconds });
    }
    effect
}

/// How long the drive that is at it for longest is, in s.
fn longest_s(parts: &[Part], effects: &[Effect]) -> f64 {
    parts.iter().zip(effects).map(|(part, effect)| length_s(effect, part.channel.period_s())).fold(0.0, f64::max)
}

/// Effects cut to what is new in them.
fn cut(parts: &[Part], effects: &[Effect]) -> Vec<Cut> {
    parts.iter().zip(effects).map(|(p, e)| Cut::new(e, p.channel.period_s(), PREDICTED_S)).collect()
}

/// Peak at a target in g, as the mean over how the drives' cycles may fall.
fn peak_g(parts: &[Part], effects: &[Effect], target: usize) -> f64 {
    let effects: Vec<Effect> = cut(parts, effects).iter().map(|cut| cut.effect.clone()).collect();
    let alone = signals(parts, &effects, target, AFTER_S + QUIET_FOR_S);
    combined(&alone, parts, |part| part.drive.force_n).mean / STANDARD_GRAVITY
}

#[expect(clippy::cast_precision_loss, reason = "sample numbers")]
fn predict(parts: &[Part], effects: &[Effect], unbraked: Option<&[Effect]>) -> EffectPrediction {
    // Times are told by the drive that is at it for longest.
    let cuts = cut(parts, effects);
    let effects: Vec<Effect> = cuts.iter().map(|cut| cut.effect.clone()).collect();
    let effects = effects.as_slice();
    let force = |part: &Part| part.drive.force_n;
    let alone = signals(parts, effects, 0, AFTER_S + QUIET_FOR_S);
    let Peak { mean, least, most } = combined(&alone, parts, force);
    let together = |signals: &[Vec<f64>]| -> Vec<f64> {
        let mut sum = vec![0.0_f64; signals.first().map_or(0, Vec::len)];
        for (signal, part) in signals.iter().zip(parts) {
            sum.iter_mut().zip(signal).for_each(|(sum, x)| *sum += x * force(part));
        }
        sum
    };
    let motion = together(&alone);
    let ends_s = longest_s(parts, effects);
    let peak_at = motion.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).map_or(0, |(i, _)| i);
    let ms = |i: usize| cuts.iter().map(|cut| cut.whole_s(i as f64 * STEP_S)).fold(0.0, f64::max) * 1e3;
    let after = motion.iter().enumerate().filter(|(i, _)| *i as f64 * STEP_S >= ends_s).map(|(_, x)| x.abs());
    let residual = if mean > 0.0 { after.fold(0.0, f64::max) / mean } else { 0.0 };
    let quiet = |motion: &[f64]| stays_below(motion, QUIET * mean, STEP_S).map(ms);
    EffectPrediction {
        peak_g: mean / STANDARD_GRAVITY,
        peak_least_g: if least.is_finite() { least / STANDARD_GRAVITY } else { 0.0 },
        peak_most_g: most / STANDARD_GRAVITY,
        peak_at_ms: ms(peak_at),
        residual,
        left: residual,
        quiet_ms: quiet(&motion),
        quiet_unbraked_ms: unbraked
            .and_then(|effects| quiet(&together(&signals(parts, effects, 0, AFTER_S + QUIET_FOR_S)))),
    }
}

/// The sample from which on a motion stays below a limit, if it does so for the last [`QUIET_FOR_S`]; `None` also if it always was.
fn stays_below(motion: &[f64], limit: f64, step_s: f64) -> Option<usize> {
    let last = motion.iter().rposition(|x| x.abs() > limit)?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred samples")]
    let least = (QUIET_FOR_S / step_s).round() as usize;
    (motion.len() - (last + 1) >= least).then_some(last + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motion that goes on is not quiet after its record's last crest.
    #[test]
    fn between_crests_nothing_is_quiet() {
        let step_s = 1e-4;
        let ringing = |rate_per_s: f64| -> Vec<f64> {
            let times = (0..4000).map(|i| f64::from(i) * step_s);
            times.map(|t| (-rate_per_s * t).exp() * (std::f64::consts::TAU * 43.0 * t).cos()).collect()
        };
        assert_eq!(stays_below(&ringing(0.0), 0.1, step_s), None);
        // Below a tenth from ln 10 / 20 s on, within half a period, and before the record is shown to be over.
        let quiet_s = f64::from(u32::try_from(stays_below(&ringing(20.0), 0.1, step_s).unwrap()).unwrap()) * step_s;
        assert!((10_f64.ln() / 20.0 - 0.012..10_f64.ln() / 20.0).contains(&quiet_s), "{quiet_s}");
        assert_eq!(stays_below(&ringing(6.0), 0.1, step_s), None);
        assert_eq!(stays_below(&ringing(20.0), 2.0, step_s), None);
    }
}
