//! Travel of the actuators while an effect plays, and what keeps it within bounds.
//!
//! Stepped in time, as the electrodes' force depends on the travel: a plateau P while an electrode is on is P / (1 - u)^2
//! towards it at a travel u of the gap, and P / (1 + u)^2 away from it.
//!
//! A long effect brings nothing new after a while. The motion is the steady one of the present level and free motions of
//! the levels before, which decay. Once they have, a level that is held longer moves nothing further, a repetition is like
//! the one before, and a slower ramp is nearer to the steady motions of its levels, which plans keep within the limits at every
//! level ([`crate::planner`]). So segments, and the repetitions together, are cut to the
//! time in which the free motions decay, and what is then stepped, [`ShortenedDrives`], is stepped to its end. What they have
//! left where they decay too slowly for that is added to the travel found.

use super::effect_drive::EffectDrive;
use super::envelope::{ShortenedEffect, effect_duration_s, level_in_each_period};
use super::motion::Channel;
use super::supply::highest_voltage_needed_on_rail_of_actuator_v;
use crate::PlanTable;
use crate::physics::charging::ChargingElectrode;
use crate::physics::limits::{Electrodes, Limit};
use crate::physics::rise::{PanelPoles, Stepper, TransientResponse};
use crate::scene::Actuator;
use era_shared::waveform::{Effect, Segment};
use nalgebra::DVector;
use num_complex::Complex64;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Step in s: some sixty in a period of 400 Hz.
const TRAVEL_STEP_S: f64 = 40e-6;
/// Least time to which segments and repetitions are cut, in s: five beats of the least spacing of 20 Hz, in which all phases
/// of the drives to each other come by.
const LEAST_S: f64 = 0.25;
/// Longest, in s.
const LONGEST_CUT_S: f64 = 1.5;
/// Factor from one length that is tried to the next.
const LONGER: f64 = 1.3;
/// Fraction of the travel allowed that free motions may have left when they count as decayed.
const DECAYED: f64 = 0.02;
/// After the end, in s: half a period of the slowest drives.
const AFTER_S: f64 = 0.01;
/// Fraction of the travel allowed that may be used, for the steps and for cycles that fall together otherwise.
const USED: f64 = 0.92;
/// Times over its period at which each drive may begin, of effects that are over within a few beats; in longer ones the
/// beats try them all, and two are enough for how the drives begin.
const START_DELAYS: u32 = 2;
/// What harmonics make of a small travel, as a rule.
const WITH_HARMONICS: f64 = 2.0;
/// Fraction of the travel allowed below which a travel is small: of a third of the gap this is 1/50 of it, where an electrode's force differs
/// from that in the middle by 4 %.
const SMALL_TRAVEL: f64 = 0.06;
/// Halvings in the search for a strength that fits: to 1/64.
const STRENGTH_HALVINGS: usize = 6;

/// The result of limiting the travel of an effect.
pub struct TravelOutcome {
    /// What made it necessary to lower them.
    pub limited: Option<(usize, Limit)>,
    /// Bound of every actuator's travel in m.
    pub travel_m: Vec<f64>,
}

/// Derates all drives until no actuator travels beyond a third of its gap, or closes it so far that its voltage
/// breaks it down. Returns the limit that made it necessary, and the travel.
pub fn derate_drives_to_travel_limits(
    table: &PlanTable,
    rise: &PanelPoles,
    effect_drives: &mut [EffectDrive],
    effects: &[Effect],
) -> TravelOutcome {
    let rows: Vec<DVector<f64>> =
        (0..table.electrodes.len()).map(|actuator| table.model.actuator_mass_travel_row(actuator)).collect();
    let free: Vec<Option<Vec<TransientResponse>>> = effect_drives
        .iter()
        .map(|part| travel_response_per_n_of_each_actuator_unless_undamped(rise, &rows, part))
        .collect();
    let shortened = ShortenedDrives::new(&table.electrodes, effect_drives, effects, &free);
    if let Some(travel_m) =
        bound_travel_of_each_actuator_if_small_m(&table.electrodes, effect_drives, &shortened.levels, &free)
    {
        return TravelOutcome { limited: None, travel_m };
    }
    let rest = rise.build_stepper(&rows, TRAVEL_STEP_S);
    let counted_n_per_m: Vec<f64> = table.scene.actuators.iter().map(Actuator::softening_n_per_m).collect();
    let most = START_DELAYS.pow(u32::try_from(effect_drives.len().saturating_sub(1)).unwrap_or(0));
    let combinations = if shortened.does_any_drive_last_longer_than_minimum_shortened_time(effect_drives) {
        most.min(START_DELAYS)
    } else {
        most
    };
    // How far the masses go, or the first limit that is broken, if any is.
    let tried = |scale: f64| -> Result<Vec<f64>, (usize, Limit)> {
        let mut largest_m = vec![0.0_f64; table.electrodes.len()];
        for combination in 0..combinations {
            let travels = simulate_largest_travel_of_each_actuator_m(
                rest.clone(),
                &table.electrodes,
                &counted_n_per_m,
                effect_drives,
                &shortened.levels,
                scale,
                combination,
            );
            let added = travels.iter().zip(&shortened.left_m).map(|(travel, left)| travel + left * scale);
            let all = table.electrodes.iter().zip(added).zip(&mut largest_m).enumerate();
            for (actuator, ((electrodes, travel), largest)) in all {
                let allowed = USED * electrodes.max_travel_m();
                let volts =
                    highest_voltage_needed_on_rail_of_actuator_v(&table.electrodes, effect_drives, actuator, scale);
                if travel > allowed {
                    return Err((actuator, Limit::Travel));
                }
                if volts > electrodes.breakdown_voltage_of_remaining_gap_with_margin_v(travel / USED) {
                    return Err((actuator, Limit::Breakdown));
                }
                *largest = largest.max(travel / USED);
            }
        }
        Ok(largest_m)
    };
    let mut limited = match tried(1.0) {
        Ok(travel_m) => return TravelOutcome { limited: None, travel_m },
        Err(limited) => limited,
    };
    let (mut low, mut high, mut travel_m) = (0.0, 1.0, vec![0.0; table.electrodes.len()]);
    for _ in 0..STRENGTH_HALVINGS {
        let middle = 0.5 * (low + high);
        match tried(middle) {
            Err(limit) => (limited, high) = (limit, middle),
            Ok(found_m) => (travel_m, low) = (found_m, middle),
        }
    }
    effect_drives.iter_mut().for_each(|part| part.drive.force_n *= low);
    TravelOutcome { limited: Some(limited), travel_m }
}

/// The transient travel of every actuator under 1 N of a drive's fundamental from rest; `None` at an undamped
/// resonance.
fn travel_response_per_n_of_each_actuator_unless_undamped(
    rise: &PanelPoles,
    rows: &[DVector<f64>],
    drive: &EffectDrive,
) -> Option<Vec<TransientResponse>> {
    rows.iter()
        .map(|row| {
            Some(
                rise.transient_response_per_n_of_each_drive_if_finite(row, &[drive.drive])?
                    .pop()?
                    .acceleration_to_displacement(),
            )
        })
        .collect()
}

/// What is stepped in place of effects.
struct ShortenedDrives {
    /// Levels of every drive, period by period.
    levels: Vec<Vec<f64>>,
    /// Bound on what the free motions still have left of each actuator's travel where that was cut, in m.
    left_m: Vec<f64>,
}

impl ShortenedDrives {
    fn new(
        electrodes: &[Electrodes],
        effect_drives: &[EffectDrive],
        effects: &[Effect],
        free: &[Option<Vec<TransientResponse>>],
    ) -> Self {
        let left_m = |after_s: f64| -> Vec<f64> {
            let drives = || effect_drives.iter().zip(effects).zip(free);
            let of =
                |actuator: usize,
                 ((part, effect), free): ((&EffectDrive, &Effect), &Option<Vec<TransientResponse>>)| {
                    let ringing = free.as_ref().and_then(|free| free.get(actuator))?;
                    Some(part.drive.force_n * bound_free_motion_left_m_per_n(effect, part.channel, ringing, after_s))
                };
            // An undamped mode has all of it left, which cannot be told: nothing but stepping the whole would do.
            (0..electrodes.len()).map(|actuator| drives().filter_map(|drive| of(actuator, drive)).sum()).collect()
        };
        let is_decayed = |left_m: &[f64]| {
            left_m.iter().zip(electrodes).all(|(left, electrodes)| *left <= DECAYED * electrodes.max_travel_m())
        };
        let mut enough_s = LEAST_S;
        while enough_s < LONGEST_CUT_S && !is_decayed(&left_m(enough_s)) {
            enough_s = (enough_s * LONGER).min(LONGEST_CUT_S);
        }
        let cut: Vec<ShortenedEffect> = effect_drives
            .iter()
            .zip(effects)
            .map(|(part, effect)| ShortenedEffect::new(effect, part.channel.period_s(), enough_s))
            .collect();
        let is_cut = cut.iter().zip(effects).any(|(cut, effect)| cut.effect != *effect);
        let of =
            |(part, cut): (&EffectDrive, &ShortenedEffect)| level_in_each_period(&cut.effect, part.channel.period_s());
        Self {
            levels: effect_drives.iter().zip(&cut).map(of).collect(),
            left_m: if is_cut { left_m(enough_s) } else { vec![0.0; electrodes.len()] },
        }
    }

    #[expect(clippy::cast_precision_loss, reason = "small counts")]
    fn does_any_drive_last_longer_than_minimum_shortened_time(&self, effect_drives: &[EffectDrive]) -> bool {
        self.levels
            .iter()
            .zip(effect_drives)
            .any(|(levels, part)| levels.len() as f64 * part.channel.period_s() > LEAST_S)
    }
}

/// Bound, in m/N, on how much the free motions of what was before may still add `since_start_s` after an effect's start: those of
/// the changes of level in one repetition, and, where it is repeated, of all the repetitions that it would take for the
/// motion to be periodic, sum over n of e^(-r (t + n T)).
fn bound_free_motion_left_m_per_n(
    effect: &Effect,
    channel: Channel,
    ringing: &TransientResponse,
    since_start_s: f64,
) -> f64 {
    let once = Effect { times: 1, ..effect.clone() };
    let once_s = effect_duration_s(&once, channel.period_s());
    let mut last = 0.0;
    let mut changes = 0.0;
    for segment in &effect.segments {
        let part = |level: i16| {
            channel.force_fraction_of_level(f64::from(level) / f64::from(era_shared::waveform::FULL_LEVEL))
        };
        let (from, to) = match *segment {
            Segment::Hold { level, .. } | Segment::Cycles { level, .. } => (part(level), part(level)),
            Segment::Ramp { from, to, .. } => (part(from), part(to)),
        };
        changes += f64::abs(from - last) + f64::abs(to - from);
        last = to;
    }
    let of = |(s, c): &(Complex64, Complex64)| {
        let again = if effect.times > 1 { 1.0 / (1.0 - (s.re * once_s).exp()).max(1e-9) } else { 1.0 };
        c.norm() * (s.re * since_start_s).exp() * again.min(f64::from(effect.times))
    };
    changes * ringing.free.iter().map(of).sum::<f64>()
}

/// A bound of all travels in m if they are so small that nothing has to be stepped: of the fundamentals' travel, from the
/// steady motion and what is left, at its most, of the free motion that every change of level adds, below [`SMALL_TRAVEL`]. The
/// factor of sixteen from there to what is allowed is for harmonics, of a third of the fundamental at most and a resonance of
/// their own at worst; the bound itself has [`WITH_HARMONICS`].
fn bound_travel_of_each_actuator_if_small_m(
    all_electrodes: &[Electrodes],
    effect_drives: &[EffectDrive],
    levels: &[Vec<f64>],
    responses: &[Option<Vec<TransientResponse>>],
) -> Option<Vec<f64>> {
    let travel = |(actuator, electrodes): (usize, &Electrodes)| {
        let bounds = effect_drives.iter().zip(levels).zip(responses).map(|((part, levels), responses)| {
            let ringing = responses.as_ref()?.get(actuator)?;
            let levels: Vec<f64> = levels.iter().map(|level| part.channel.force_fraction_of_level(*level)).collect();
            let highest = levels.iter().fold(0.0_f64, |most, level| most.max(level.abs()));
            let free: f64 = ringing
                .free
                .iter()
                .map(|(s, c)| {
                    c.norm() * largest_decaying_sum_of_level_change_magnitudes(&levels, s.re * part.channel.period_s())
                })
                .sum();
            Some(part.drive.force_n * (ringing.steady.norm() * highest + free))
        });
        let travel = bounds.sum::<Option<f64>>()?;
        let volts = highest_voltage_needed_on_rail_of_actuator_v(all_electrodes, effect_drives, actuator, 1.0);
        let is_small = travel < SMALL_TRAVEL * electrodes.max_travel_m()
            && volts <= electrodes.breakdown_voltage_of_remaining_gap_with_margin_v(travel);
        is_small.then_some(WITH_HARMONICS * travel)
    };
    all_electrodes.iter().enumerate().map(travel).collect()
}

/// Most that the changes of `levels` add up to when each loses its part e^`exponent` in every period.
fn largest_decaying_sum_of_level_change_magnitudes(levels: &[f64], exponent: f64) -> f64 {
    let (kept, mut before, mut sum, mut most) = (exponent.exp(), 0.0, 0.0_f64, 0.0_f64);
    for level in levels.iter().chain(&[0.0]) {
        sum = sum * kept + f64::abs(level - before);
        (before, most) = (*level, most.max(sum));
    }
    most
}

/// Largest travel of every actuator in m; not looked at any further once one is beyond a third of its gap. The digits of
/// `start_delay_combination` say when within its period each drive but the first begins.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "small counts"
)]
fn simulate_largest_travel_of_each_actuator_m(
    mut stepper: Stepper,
    electrodes: &[Electrodes],
    counted_n_per_m: &[f64],
    effect_drives: &[EffectDrive],
    levels: &[Vec<f64>],
    force_scale: f64,
    start_delay_combination: u32,
) -> Vec<f64> {
    let mut rest = start_delay_combination;
    let delays_s: Vec<f64> = (0..)
        .zip(effect_drives)
        .map(|(i, part)| {
            let digit = if i == 0 { 0 } else { rest % START_DELAYS };
            rest /= if i == 0 { 1 } else { START_DELAYS };
            f64::from(digit) / f64::from(START_DELAYS) * part.channel.period_s()
        })
        .collect();
    let ends =
        effect_drives.iter().zip(levels).zip(&delays_s).map(|((p, l), d)| d + l.len() as f64 * p.channel.period_s());
    let steps = ((ends.fold(0.0, f64::max) + AFTER_S) / TRAVEL_STEP_S).ceil() as usize;
    let (mut travel, mut most) = (vec![0.0; electrodes.len()], vec![0.0_f64; electrodes.len()]);
    let mut forces = vec![0.0; electrodes.len()];
    let mut charged = vec![[ChargingElectrode::default(); 2]; effect_drives.len()];
    for i in 0..steps {
        if most.iter().zip(electrodes).any(|(most, electrodes)| *most > electrodes.max_travel_m()) {
            break;
        }
        let time_s = i as f64 * TRAVEL_STEP_S;
        forces.fill(0.0);
        for (((part, levels), delay_s), charged) in effect_drives.iter().zip(levels).zip(&delays_s).zip(&mut charged) {
            let actuator = part.drive.actuator;
            let on = step_start_and_on_interval_of_each_electrode_in_periods(part, levels, time_s - delay_s);
            let (width, charging) = (part.channel.pulse_width, part.channel.charging);
            let step = TRAVEL_STEP_S * part.channel.frequency_hz;
            let [mut a, mut b] = on.map(|on| on.map_or(0.0, |[_, begin, end]| (end - begin) / step));
            let plateau_n = if charging.is_instant() {
                part.drive.force_n * force_scale * FRAC_PI_4 / (FRAC_PI_2 * width).sin()
            } else {
                let [on_a, on_b] = charged;
                let times = charging.times();
                let period_s = part.channel.period_s();
                let on_s =
                    on.map(|on| on.map(|[from, begin, end]| ((begin - from) * period_s, (end - from) * period_s)));
                a = on_a.advance_step_and_get_mean_square_v2(times, 1.0, on_s[0], TRAVEL_STEP_S);
                b = on_b.advance_step_and_get_mean_square_v2(times, 1.0, on_s[1], TRAVEL_STEP_S);
                part.drive.force_n * force_scale
                    / charging.force_harmonic_phasor_per_n_at_rail_voltage(1.0, width).norm()
            };
            let u = (travel[actuator] / electrodes[actuator].gap_m).clamp(-0.5, 0.5);
            forces[actuator] += plateau_n * (a / ((1.0 - u) * (1.0 - u)) - b / ((1.0 + u) * (1.0 + u)));
        }
        // What a bias takes off the springs in the model is given back: the forces above have all of the softening.
        let counted = counted_n_per_m.iter().zip(&travel);
        forces.iter_mut().zip(counted).for_each(|(force, (counted, travel))| *force -= counted * travel);
        stepper.advance_one_step(&forces, &mut travel);
        most.iter_mut().zip(&travel).for_each(|(most, travel)| *most = most.max(travel.abs()));
    }
    most
}

/// The stretches of the step from `step_start_s` on, counted from the drive's start, in which its electrodes A and B are on: the step's beginning and
/// the stretch's begin and end, in periods.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small counts")]
fn step_start_and_on_interval_of_each_electrode_in_periods(
    drive: &EffectDrive,
    levels: &[f64],
    step_start_s: f64,
) -> [Option<[f64; 3]>; 2] {
    if step_start_s < 0.0 {
        return [None; 2];
    }
    let periods = step_start_s * drive.channel.frequency_hz;
    let level = levels.get(periods as usize).copied().unwrap_or(0.0);
    let step = TRAVEL_STEP_S * drive.channel.frequency_hz;
    // In periods: windows in the middle of each half, as wide as the level takes.
    let width = drive.channel.pulse_width_of_level(level);
    let from = periods.fract();
    let on = |middle: f64| {
        let (begin, end) = (from.max(middle - 0.25 * width), (from + step).min(middle + 0.25 * width));
        (end > begin).then_some([from, begin, end])
    };
    if level >= 0.0 { [on(0.25), on(0.75)] } else { [on(0.75), on(0.25)] }
}

#[cfg(test)]
mod tests {
    use super::super::effect_drive::build_effect_drives;
    use super::super::{EffectRequest, NamedEffect};
    use super::*;
    use crate::model::{Accuracy, PanelModel};
    use crate::scene::{EXAMPLE_BAR, Scene};
    use crate::{TableOptions, Target};

    #[test]
    fn what_decays_adds_up_to_little() {
        // Nothing decays: all changes. Half of it in every period: no more than twice the largest.
        assert!((largest_decaying_sum_of_level_change_magnitudes(&[1.0, 1.0, 0.0, -1.0], 0.0) - 4.0).abs() < 1e-12);
        assert!(
            largest_decaying_sum_of_level_change_magnitudes(&[1.0, 0.0].repeat(50), -std::f64::consts::LN_2) <= 2.0
        );
    }

    /// Stepped to their ends, long effects go no further than what stands for them.
    #[test]
    fn the_short_goes_as_far_as_the_long() {
        for damping in ["0.05", "1.1"] {
            let text = EXAMPLE_BAR.replace("damping_n_s_per_m = 1.1", &format!("damping_n_s_per_m = {damping}"));
            let scene = Scene::parse("bar", &text).unwrap();
            let model = PanelModel::build(&scene, Accuracy::FAST, 400.0)
                .unwrap()
                .reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[])
                .unwrap();
            let options = TableOptions { step_hz: 4.0, ..TableOptions::default() };
            let table = PlanTable::build(&scene, model, options).unwrap();
            let rise = PanelPoles::find_poles_if_converged(&table.model).unwrap();
            let plan = table.plan(&[Target { x_m: 0.06, y_m: 0.01, intensity_g: Some(0.5) }]).unwrap();
            let effect_drives = build_effect_drives(&table, &rise, &plan).unwrap();
            let rows: Vec<DVector<f64>> =
                (0..effect_drives.len()).map(|actuator| table.model.actuator_mass_travel_row(actuator)).collect();
            let free: Vec<_> = effect_drives
                .iter()
                .map(|part| travel_response_per_n_of_each_actuator_unless_undamped(&rise, &rows, part))
                .collect();
            let rest = rise.build_stepper(&rows, TRAVEL_STEP_S);
            for effect in [NamedEffect::Swell, NamedEffect::PulseTrain, NamedEffect::Texture] {
                let count = (effect == NamedEffect::PulseTrain).then_some(40);
                let duration_ms = (effect != NamedEffect::PulseTrain).then_some(6000.0);
                let request = EffectRequest { count, duration_ms, ..EffectRequest::with_defaults(effect) };
                let effects = vec![request.build_envelope_or_plain_push_if_click().unwrap(); effect_drives.len()];
                let shortened = ShortenedDrives::new(&table.electrodes, &effect_drives, &effects, &free);
                let whole: Vec<Vec<f64>> = effect_drives
                    .iter()
                    .zip(&effects)
                    .map(|(part, effect)| level_in_each_period(effect, part.channel.period_s()))
                    .collect();
                assert!(shortened.levels[0].len() < whole[0].len(), "{effect:?}");
                let step = |levels: &[Vec<f64>]| {
                    simulate_largest_travel_of_each_actuator_m(
                        rest.clone(),
                        &table.electrodes,
                        &[],
                        &effect_drives,
                        levels,
                        1.0,
                        0,
                    )
                };
                let short = step(&shortened.levels);
                for (i, whole) in step(&whole).into_iter().enumerate() {
                    let bound = short[i] * 1.03 + shortened.left_m[i];
                    assert!(whole <= bound, "{damping} {effect:?}: {whole} {} {}", short[i], shortened.left_m[i]);
                }
            }
        }
    }
}
