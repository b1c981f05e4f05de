//! An effect for a plan: voltages, envelopes and what they will do.
//!
//! A click is too short for the steady peak, so its drives are stronger than the plan's in proportion, each up to its own
//! limit, and its push has as few cycles as reach the wanted peak (pushes of all drives last about equally long). Other
//! effects hold the plan's strength.
//!
//! Channels begin at the first boundary of their own period after the common start, so how the drives' cycles fall
//! together is not known beforehand: peaks are given as the mean over all offsets, with the least and the most.

use super::click::{self, level_in_thousandths};
use super::effect_drive::{
    EffectDrive, PREDICTED_S, PeakMeanAndRange, STEP_S, build_effect_drives,
    find_mean_least_and_most_peak_over_cycle_offsets, sample_acceleration_per_n_of_each_drive,
};
use super::effect_window::EffectWindow;
use super::envelope::{ShortenedEffect, effect_duration_s, level_in_each_period};
use super::error::DesignError;
use super::motion::Channel;
use super::named::{EffectRequest, NamedEffect, Shape};
use super::quiet::{QUIET_FOR_S, quiet_start_index_unless_always_or_never_quiet};
use super::supply::{derate_drives_to_supply_current_if_exceeded, highest_voltage_needed_on_rail_of_actuator_v};
use super::travel::{TravelOutcome, derate_drives_to_travel_limits};
use crate::click::measures::measure_motion;
use crate::drive::{Drive, SiDrive, assign_channels_in_order_of_drives};
use crate::motion::plan_motion::{EffectForce, PlanMotion};
use crate::motion::plan_motion::{
    build_motion_of_effect_with_known_travel_if_poles_known,
    build_motion_of_voltage_windows_with_known_travel_if_poles_known,
};
use crate::physics::limits::Electrodes;
use crate::physics::rise::PanelPoles;
use crate::plan::limitation::{self, Limitation, add_limitation_if_new};
use crate::scene::MAX_ACTUATORS;
use crate::{Plan, PlanTable, STANDARD_GRAVITY};
use era_shared::supply::{RAILS, rail_index_of_channel};
use era_shared::waveform::{Effect, FULL_LEVEL, Segment};

/// Most cycles of a push, of the drive of the highest frequency.
const MOST_PUSH: u16 = 8;
/// How long after an effect's end motion is looked at, in s.
const AFTER_S: f64 = 0.3;
/// How long after an effect's end its peak may come, in s: some periods of the lowest drives.
const AFTER_PEAK_S: f64 = 0.05;
/// Fraction of the peak below which a target is quiet.
const QUIET: f64 = 0.1;
/// Steps of bisections.
const BISECTIONS: usize = 24;
/// Fraction of the wished peak that counts as reached; fingers tell a tenth at best, and peaks of several drives, which equation
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

/// What an effect should do at the first target; a click of single windows at the first one that is to feel something.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct EffectPrediction {
    /// Peak acceleration in g, harmonics of the force up to 1 kHz included: mean over how the drives' cycles may fall. Of a click of single
    /// windows: in the felt band, which is full to 300 Hz and ends at 500 Hz, as are its times and what is left. Of two such clicks: of the first.
    pub peak_g: f64,
    /// Least over that. Of two clicks of single windows: the peak of the weaker one, the second of which meets what is left of the first.
    pub peak_least_g: f64,
    /// Most over that. Of a click of single windows: the peak of all motion below 1 kHz, felt or not, which an accelerometer shows.
    pub peak_most_g: f64,
    /// When the peak comes, in ms after the drives' first boundary, all beginning together.
    pub peak_at_ms: f64,
    /// Residual vibration: the largest acceleration after the end, relative to the peak.
    pub residual: f64,
    /// Deprecated, for one version: the same as `residual`. An actuator may be called `left`, too.
    #[cfg_attr(feature = "schema", schema(deprecated))]
    pub left: f64,
    /// From here on it stays below a tenth of the peak, in ms after the start, also of two clicks; `null` if not within 300 ms of the end.
    pub quiet_ms: Option<f64>,
    /// Of a click of single windows, whether its peak comes within 15 ms and it is quiet within `crisp_ms`, at all targets; of two such clicks,
    /// whether both do so from their own start; `null` of other effects.
    pub crisp: Option<bool>,
    /// The same as `quiet_ms` for a click without its brake.
    pub quiet_unbraked_ms: Option<f64>,
    /// Of a click of single windows, the strongest crisp one that no drive of these actuators exceeds, in g, if it was asked for.
    pub best_possible_g: Option<f64>,
    /// Of a click, for how long it is above a tenth of its peak, in ms; of a push, all drives beginning together, as `peak_at_ms`. Of two
    /// clicks of single windows, that of the second one; `null` of two pushes.
    pub pulse_ms: Option<f64>,
    /// Root mean square of that pulse over that of what rings after it down to a hundredth of the peak, in dB.
    pub pulse_to_ring_db: Option<f64>,
    /// That ratio over the pulse's length, in dB/ms: the figure of merit for sharpness.
    pub sharpness_db_per_ms: Option<f64>,
    /// Of a click of single windows, its contrast: the mean square of the felt acceleration at the target over the mean of
    /// that over the surface, in dB.
    pub contrast_db: Option<f64>,
    /// Of a click of single windows, its sound: the mean-square velocity of the surface up to 1 kHz, A-weighted, over 1 s and all of the surface, in
    /// dB relative to 1 mm/s.
    pub sound_db: Option<f64>,
}

/// An effect designed for a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectDesign {
    /// Which.
    pub effect: NamedEffect,
    /// One per drive of the plan, in its order; none for a click or a double click of single windows.
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
    /// The windows of a click or a double click that is made of single ones; none of other effects.
    pub windows: Vec<EffectWindow>,
    /// What those windows do to each pole that vibrates: its largest amplitude while they are on, and the amplitude after them.
    pub pole_amplitudes: Vec<(f64, f64)>,
    /// The force in N of each actuator for which [`EffectPrediction::best_possible_g`] was computed; none if it was not.
    pub best_possible_forces_n: Vec<f64>,
}

impl EffectDesign {
    /// The voltage in V that each rail needs, 0 for one that feeds nothing of it.
    #[must_use]
    pub fn find_rail_voltages_v(&self) -> [f64; RAILS] {
        let of_windows = self.windows.iter().map(|window| (window.channel, window.voltage_v));
        let of_drives = self.drives.iter().enumerate().map(|(channel, designed)| (channel, designed.drive.voltage_v));
        let mut rails_v = [0.0_f64; RAILS];
        for (channel, voltage_v) in of_windows.chain(of_drives) {
            if let Some(rail_v) = rails_v.get_mut(rail_index_of_channel(channel)) {
                *rail_v = rail_v.max(voltage_v);
            }
        }
        rails_v
    }

    /// How far it takes the masses and what it leaves; `None` where that cannot be told.
    #[must_use]
    pub fn predict_travel_and_free_motion_left_by_effect_if_poles_known(
        &self,
        table: &PlanTable,
    ) -> Option<PlanMotion> {
        let mut travel_m = [0.0; MAX_ACTUATORS];
        travel_m.iter_mut().zip(&self.travel_m).for_each(|(travel, known)| *travel = *known);
        if !self.windows.is_empty() {
            let windows = self.windows.iter().map(|window| (window.channel, window.voltage_v));
            return build_motion_of_voltage_windows_with_known_travel_if_poles_known(
                table,
                windows,
                &self.pole_amplitudes,
                &travel_m,
            );
        }
        let push = |(channel, DesignedDrive { drive, effect }): (usize, &DesignedDrive)| {
            let mut levels = level_in_each_period(effect, 1.0 / drive.frequency_hz);
            if let Some(electrodes) = table.electrodes.get(channel) {
                let own = build_full_level_channel_for_drive(channel, drive, electrodes);
                levels.iter_mut().for_each(|level| *level = own.force_fraction_of_level(*level));
            }
            EffectForce { channel, frequency_hz: drive.frequency_hz, force_n: drive.force_n, levels }
        };
        let pushes: Vec<EffectForce> = self.drives.iter().enumerate().map(push).collect();
        build_motion_of_effect_with_known_travel_if_poles_known(table, &pushes, &travel_m)
    }

    /// Adds a reason why it is weaker than was asked for.
    pub fn add_limitation_if_new(&mut self, limit: Limitation) {
        add_limitation_if_new(&mut self.limits, limit);
        self.limited_by = limitation::join_limitations_as_text_if_any(&self.limits);
    }

    /// Its drives with their channels: actuator i of the scene is on channel i of the board.
    #[must_use]
    pub fn drives_with_board_channels(&self) -> Vec<SiDrive> {
        assign_channels_in_order_of_drives(self.drives.iter().map(|designed| &designed.drive))
    }
}

/// Designs the effect for `plan`. The frequencies and the proportions of the drives' strengths are those of the plan.
///
/// # Errors
/// [`DesignError`].
pub fn design_effect(
    table: &PlanTable,
    rise: &PanelPoles,
    plan: &Plan,
    request: EffectRequest,
) -> Result<EffectDesign, DesignError> {
    let (shape, fixed) = (
        request.check_parameters_and_choose_clicks_or_fixed_envelope()?,
        request.build_envelope_or_plain_push_if_click()?,
    );
    design_effect_of_clicks_or_fixed_envelope(table, rise, plan, (request.effect, shape, fixed))
}

/// Designs an envelope of its own for `plan`. Its design has the name [`NamedEffect::Buzz`]: a drive that is held, at levels of its own.
///
/// # Errors
/// [`DesignError`].
pub fn design_effect_with_given_envelope(
    table: &PlanTable,
    rise: &PanelPoles,
    plan: &Plan,
    envelope: Effect,
) -> Result<EffectDesign, DesignError> {
    design_effect_of_clicks_or_fixed_envelope(table, rise, plan, (NamedEffect::Buzz, Shape::Fixed, envelope))
}

fn design_effect_of_clicks_or_fixed_envelope(
    table: &PlanTable,
    rise: &PanelPoles,
    plan: &Plan,
    (effect, shape, fixed): (NamedEffect, Shape, Effect),
) -> Result<EffectDesign, DesignError> {
    let mut effect_drives = build_effect_drives(table, rise, plan)?;
    let wanted: Vec<f64> = plan.targets.iter().map(|target| target.wanted_g * STANDARD_GRAVITY).collect();
    let mut limits = plan.limits.clone();
    let (effects, unbraked) = match shape {
        Shape::Fixed => (vec![fixed; effect_drives.len()], None),
        Shape::Clicks { count, period_ms } => {
            // Of a drive, in one click of several: the next one begins in time.
            let most_cycles = |frequency_hz: f64| match count {
                1 => u16::MAX,
                _ => count_periods_of_repetition(period_ms, frequency_hz).saturating_sub(1).max(1),
            };
            let (pushes, reaches) =
                raise_drives_together_to_target_wishes_with_shortest_push(&mut effect_drives, &wanted, most_cycles);
            // A click may reach what the steady plan could not, and the other way round.
            limits.clear();
            let all = |segments: &[Vec<Segment>]| -> Vec<Effect> {
                segments
                    .iter()
                    .zip(&effect_drives)
                    .map(|(s, part)| repeat_segments(s, count, period_ms, part))
                    .collect()
            };
            let plain: Vec<Vec<Segment>> =
                pushes.iter().map(|push| vec![Segment::Cycles { level: FULL_LEVEL, count: *push }]).collect();
            let braked: Vec<Vec<Segment>> = effect_drives
                .iter()
                .zip(&pushes)
                .map(|(part, push)| {
                    click::design_push_and_brake_segments(
                        &part.fundamental_response_and_quiet_level_at_each_target_per_n(
                            QUIET,
                            &wanted,
                            effect_drives.len(),
                        ),
                        part.channel,
                        *push,
                        most_cycles(part.channel.frequency_hz),
                    )
                })
                .collect();
            // What each drive's brake gains may be lost in the sum.
            let quiet = |segments: &[Vec<Segment>]| {
                let effects: Vec<Effect> =
                    segments.iter().zip(&effect_drives).map(|(s, part)| repeat_segments(s, 1, 0, part)).collect();
                predict_peak_and_quiet_time_at_first_target(&effect_drives, &effects, None)
                    .quiet_ms
                    .unwrap_or(f64::INFINITY)
            };
            let segments = if quiet(&braked) < quiet(&plain) { braked } else { plain.clone() };
            let (effects, plain) = (all(&segments), all(&plain));
            // The brake's beginning may add to the peak.
            if !reaches
                | scale_all_drives_by_one_factor_and_tell_if_limits_keep_below_wanted(
                    &mut effect_drives,
                    &effects,
                    &wanted,
                )
            {
                effect_drives
                    .iter()
                    .filter_map(|part| limitation_if_drive_at_max_force(table, part))
                    .for_each(|limit| add_limitation_if_new(&mut limits, limit));
            }
            (effects, Some(plain))
        }
    };
    if let Some(limit) = derate_drives_to_supply_current_if_exceeded(table, &mut effect_drives) {
        // The supply feeds all actuators: the limitation names none, whatever number is given.
        add_limitation_if_new(&mut limits, Limitation::for_actuator(table, limit, 0));
    }
    let TravelOutcome { limited, travel_m } = derate_drives_to_travel_limits(table, rise, &mut effect_drives, &effects);
    if let Some((actuator, limit)) = limited {
        add_limitation_if_new(&mut limits, Limitation::for_actuator(table, limit, actuator));
    }
    let predicted = predict_peak_and_quiet_time_at_first_target(&effect_drives, &effects, unbraked.as_deref());
    let others_g =
        (1..plan.targets.len()).map(|target| mean_peak_over_cycle_offsets_g(&effect_drives, &effects, target));
    let peaks_g = std::iter::once(predicted.peak_g).chain(others_g).collect();
    let length_ms = 1e3 * longest_drive_duration_s(&effect_drives, &effects);
    let falls_short = wanted.first().is_some_and(|wanted| predicted.peak_most_g * STANDARD_GRAVITY < REACHED * wanted);
    if limits.is_empty() && falls_short {
        limits = if plan.limits.is_empty() { vec![Limitation::TooShort] } else { plan.limits.clone() };
    }
    let drives = plan
        .drives
        .iter()
        .zip(effect_drives.iter().zip(effects))
        .map(|(drive, (part, effect))| {
            let electrodes = table.electrodes.get(part.drive.actuator);
            let force_n = part.drive.force_n;
            let voltage_v = electrodes.map_or(drive.voltage_v, |electrodes| {
                let voltage_v = electrodes.voltage_for_force_v(force_n, drive.frequency_hz, drive.pulse_width);
                voltage_v.min(electrodes.max_voltage_v)
            });
            let designed = DesignedDrive { drive: Drive { voltage_v, force_n, ..drive.clone() }, effect };
            let rail_v = highest_voltage_needed_on_rail_of_actuator_v(
                &table.electrodes,
                &effect_drives,
                part.drive.actuator,
                1.0,
            );
            match electrodes.filter(|own| !own.charging.is_instant() && force_n > 0.0 && rail_v > voltage_v) {
                Some(electrodes) => {
                    narrow_windows_to_keep_force_at_higher_rail_voltage(designed, part.channel, electrodes, rail_v)
                }
                None => designed,
            }
        })
        .collect();
    let limited_by = limitation::join_limitations_as_text_if_any(&limits);
    Ok(EffectDesign {
        effect,
        drives,
        predicted,
        limited_by,
        limits,
        peaks_g,
        length_ms,
        travel_m,
        windows: Vec::new(),
        pole_amplitudes: Vec::new(),
        best_possible_forces_n: Vec::new(),
    })
}

/// A drive as its effect plays it.
pub(super) fn build_full_level_channel_for_drive(actuator: usize, drive: &Drive, electrodes: &Electrodes) -> Channel {
    let Drive { frequency_hz, pulse_width, .. } = *drive;
    Channel { actuator, frequency_hz, pulse_width, charging: electrodes.charging_at(frequency_hz) }
}

/// The same forces at the voltage of a rail that stands higher, with narrower windows: the board would narrow them as electrodes that charge
/// at once need it. The levels are those of the narrower windows.
fn narrow_windows_to_keep_force_at_higher_rail_voltage(
    designed: DesignedDrive,
    wide: Channel,
    electrodes: &Electrodes,
    rail_v: f64,
) -> DesignedDrive {
    let DesignedDrive { mut drive, mut effect } = designed;
    let force_fraction = (drive.voltage_v / rail_v).powi(2);
    drive.pulse_width = wide.charging.find_pulse_width_for_force_fraction(wide.pulse_width, force_fraction);
    drive.voltage_v = rail_v;
    let narrow = build_full_level_channel_for_drive(wide.actuator, &drive, electrodes);
    let map = |level: i16| {
        let force_fraction = wide.force_fraction_of_level(f64::from(level) / f64::from(FULL_LEVEL));
        level_in_thousandths(narrow.level_for_force_fraction(force_fraction))
    };
    for segment in &mut effect.segments {
        match segment {
            Segment::Hold { level, .. } | Segment::Cycles { level, .. } => *level = map(*level),
            Segment::Ramp { from, to, .. } => (*from, *to) = (map(*from), map(*to)),
        }
    }
    DesignedDrive { drive, effect }
}

/// What keeps a drive from more force, if it has all there is.
fn limitation_if_drive_at_max_force(table: &PlanTable, drive: &EffectDrive) -> Option<Limitation> {
    let is = drive.drive.force_n > 0.0 && drive.drive.force_n >= drive.max_force_n * (1.0 - 1e-6);
    is.then(|| Limitation::for_actuator(table, drive.limit, drive.drive.actuator))
}

/// Raises the drives in proportion until every target reaches its wish, with the shortest push that does, of at most `most_cycles` of each drive's
/// frequency. Returns the number of cycles of each drive's push, and whether the wishes are reached.
fn raise_drives_together_to_target_wishes_with_shortest_push(
    effect_drives: &mut [EffectDrive],
    wanted_m_per_s2: &[f64],
    most_cycles: impl Fn(f64) -> u16,
) -> (Vec<u16>, bool) {
    let highest_hz = effect_drives.iter().map(|part| part.channel.frequency_hz).fold(1.0, f64::max);
    let (mut best, mut best_share) = ((vec![1; effect_drives.len()], 1.0), -1.0);
    for cycles in 1..=MOST_PUSH {
        let pushes: Vec<u16> = effect_drives
            .iter()
            .map(|part| {
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to MOST_PUSH")]
                let push = (f64::from(cycles) * part.channel.frequency_hz / highest_hz).round().max(1.0) as u16;
                push.min(most_cycles(part.channel.frequency_hz))
            })
            .collect();
        let effects: Vec<Effect> = pushes.iter().map(|push| Effect::new_click(*push, 0)).collect();
        let signals: Vec<Vec<Vec<f64>>> = (0..wanted_m_per_s2.len())
            .map(|target| sample_acceleration_per_n_of_each_drive(effect_drives, &effects, target, 2.0 / highest_hz))
            .collect();
        // Least over the targets of what is reached of the wish, with drives raised by `raise`, each up to its limit.
        let share = |raise: f64| -> f64 {
            let peak = |(signals, wanted): (&Vec<Vec<f64>>, &f64)| {
                if *wanted <= 0.0 {
                    return f64::INFINITY;
                }
                find_mean_least_and_most_peak_over_cycle_offsets(signals, effect_drives, |part| {
                    (part.drive.force_n * raise).min(part.max_force_n)
                })
                .mean
                    / wanted
            };
            signals.iter().zip(wanted_m_per_s2).map(peak).fold(f64::INFINITY, f64::min)
        };
        let headroom = effect_drives
            .iter()
            .filter(|part| part.drive.force_n > 0.0)
            .map(|part| part.max_force_n / part.drive.force_n)
            .fold(0.0, f64::max);
        let most = share(headroom);
        if most >= 1.0 {
            let (mut low, mut high) = (0.0, headroom);
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (low + high);
                *(if share(middle) >= 1.0 { &mut high } else { &mut low }) = middle;
            }
            (best, best_share) = ((pushes, if most.is_finite() { high } else { 0.0 }), 1.0);
            break;
        }
        if most > best_share {
            (best, best_share) = ((pushes, headroom), most);
        }
    }
    let (pushes, raise) = best;
    for part in effect_drives {
        part.drive.force_n = (part.drive.force_n * raise).min(part.max_force_n);
    }
    (pushes, best_share >= 1.0)
}

/// Scales all drives to the wish, as far as their limits allow; returns whether the limits keep them below it.
fn scale_all_drives_by_one_factor_and_tell_if_limits_keep_below_wanted(
    effect_drives: &mut [EffectDrive],
    effects: &[Effect],
    wanted_m_per_s2: &[f64],
) -> bool {
    let share = |(target, wanted): (usize, &f64)| {
        let peak = find_mean_least_and_most_peak_over_cycle_offsets(
            &sample_acceleration_per_n_of_each_drive(effect_drives, effects, target, AFTER_PEAK_S),
            effect_drives,
            |part| part.drive.force_n,
        )
        .mean;
        if *wanted > 0.0 { peak / wanted } else { f64::INFINITY }
    };
    let reached = wanted_m_per_s2.iter().enumerate().map(share).fold(f64::INFINITY, f64::min);
    if !reached.is_finite() || reached <= 0.0 {
        return false;
    }
    let headroom =
        effect_drives.iter().filter(|part| part.drive.force_n > 0.0).map(|part| part.max_force_n / part.drive.force_n);
    let headroom = headroom.fold(f64::INFINITY, f64::min);
    effect_drives.iter_mut().for_each(|part| part.drive.force_n *= (1.0 / reached).min(headroom));
    1.0 / reached > headroom * (1.0 + 1e-2)
}

/// `count` times the segments, `period_ms` from one to the next: as many whole periods of the drive as are nearest to that, because it begins at
/// the boundaries of its periods.
fn repeat_segments(segments: &[Segment], count: u16, period_ms: u16, drive: &EffectDrive) -> Effect {
    let mut effect = Effect { segments: segments.iter().copied().collect(), times: count };
    if count > 1 {
        let (once, period_s) = (Effect { times: 1, ..effect.clone() }, drive.channel.period_s());
        let every_s = f64::from(count_periods_of_repetition(period_ms, drive.channel.frequency_hz)) * period_s;
        // The pause ends within the last period, whose end is the next boundary: a period is longer than 1 ms.
        let pause_ms = (every_s - effect_duration_s(&once, period_s)) * 1e3;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 500")]
        let milliseconds = pause_ms.floor().max(1.0) as u16;
        // There is headroom: a click has at most four segments.
        let _ = effect.segments.push(Segment::Hold { level: 0, milliseconds });
    }
    effect
}

/// From one of several clicks to the next, in periods of a drive.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred; `as` saturates")]
fn count_periods_of_repetition(period_ms: u16, frequency_hz: f64) -> u16 {
    (f64::from(period_ms) * 1e-3 * frequency_hz).round() as u16
}

/// How long the drive that is at it for longest is, in s.
fn longest_drive_duration_s(effect_drives: &[EffectDrive], effects: &[Effect]) -> f64 {
    effect_drives
        .iter()
        .zip(effects)
        .map(|(part, effect)| effect_duration_s(effect, part.channel.period_s()))
        .fold(0.0, f64::max)
}

/// Effects cut to what is new in them.
fn shorten_effects_for_prediction(effect_drives: &[EffectDrive], effects: &[Effect]) -> Vec<ShortenedEffect> {
    effect_drives.iter().zip(effects).map(|(p, e)| ShortenedEffect::new(e, p.channel.period_s(), PREDICTED_S)).collect()
}

/// Peak at a target in g: the mean over all offsets between the drives' cycles.
fn mean_peak_over_cycle_offsets_g(effect_drives: &[EffectDrive], effects: &[Effect], target: usize) -> f64 {
    let effects: Vec<Effect> =
        shorten_effects_for_prediction(effect_drives, effects).iter().map(|cut| cut.effect.clone()).collect();
    let alone = sample_acceleration_per_n_of_each_drive(effect_drives, &effects, target, AFTER_S + QUIET_FOR_S);
    find_mean_least_and_most_peak_over_cycle_offsets(&alone, effect_drives, |part| part.drive.force_n).mean
        / STANDARD_GRAVITY
}

#[expect(clippy::cast_precision_loss, reason = "sample numbers")]
fn predict_peak_and_quiet_time_at_first_target(
    effect_drives: &[EffectDrive],
    effects: &[Effect],
    unbraked: Option<&[Effect]>,
) -> EffectPrediction {
    // Times are told by the drive that is at it for longest.
    let cuts = shorten_effects_for_prediction(effect_drives, effects);
    let effects: Vec<Effect> = cuts.iter().map(|cut| cut.effect.clone()).collect();
    let effects = effects.as_slice();
    let force = |part: &EffectDrive| part.drive.force_n;
    let alone = sample_acceleration_per_n_of_each_drive(effect_drives, effects, 0, AFTER_S + QUIET_FOR_S);
    let PeakMeanAndRange { mean, least, most } =
        find_mean_least_and_most_peak_over_cycle_offsets(&alone, effect_drives, force);
    let together = |signals: &[Vec<f64>]| -> Vec<f64> {
        let mut sum = vec![0.0_f64; signals.first().map_or(0, Vec::len)];
        for (signal, part) in signals.iter().zip(effect_drives) {
            sum.iter_mut().zip(signal).for_each(|(sum, x)| *sum += x * force(part));
        }
        sum
    };
    let motion = together(&alone);
    let ends_s = longest_drive_duration_s(effect_drives, effects);
    let peak_at = motion.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).map_or(0, |(i, _)| i);
    let ms = |i: usize| cuts.iter().map(|cut| cut.time_in_full_effect_s(i as f64 * STEP_S)).fold(0.0, f64::max) * 1e3;
    let after = motion.iter().enumerate().filter(|(i, _)| *i as f64 * STEP_S >= ends_s).map(|(_, x)| x.abs());
    let residual = if mean > 0.0 { after.fold(0.0, f64::max) / mean } else { 0.0 };
    let quiet = |motion: &[f64]| quiet_start_index_unless_always_or_never_quiet(motion, QUIET * mean, STEP_S).map(ms);
    // Of a click alone: a double click has two pulses.
    let is_one_push = unbraked.is_some() && effects.iter().all(|effect| effect.times == 1);
    let measures = is_one_push.then(|| measure_motion(&motion, STEP_S)).filter(|own| own.peak > 0.0);
    EffectPrediction {
        peak_g: mean / STANDARD_GRAVITY,
        peak_least_g: if least.is_finite() { least / STANDARD_GRAVITY } else { 0.0 },
        peak_most_g: most / STANDARD_GRAVITY,
        peak_at_ms: ms(peak_at),
        residual,
        left: residual,
        quiet_ms: quiet(&motion),
        quiet_unbraked_ms: unbraked.and_then(|effects| {
            quiet(&together(&sample_acceleration_per_n_of_each_drive(effect_drives, effects, 0, AFTER_S + QUIET_FOR_S)))
        }),
        crisp: None,
        best_possible_g: None,
        pulse_ms: measures.map(|own| 1e3 * own.pulse_s),
        pulse_to_ring_db: measures.and_then(|own| own.pulse_to_ring_db),
        sharpness_db_per_ms: measures.and_then(|own| own.sharpness_db_per_ms_if_pulse_to_ring_ratio_known()),
        contrast_db: None,
        sound_db: None,
    }
}
