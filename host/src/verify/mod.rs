//! Prediction against measurement: the planner works in the frequency domain, the simulated device in time. Both are told
//! the same plan, the device by the same frames that a board would get, and its accelerometer is read.

use crate::device::convert::{achieved_drive_from_wire, drive_to_wire_zeroing_too_narrow_pulses};
use crate::device::sim::{LargestTravel, SimPanel};
use crate::model::ReducedModel;
use crate::planner::drive::assign_channels_in_order_of_drives;
use crate::planner::softening::{MotionError, Transducer};
use crate::planner::{self, Plan, PlanError, PlanTable, STANDARD_GRAVITY, Target};
use crate::response;
use crate::scene::Scene;
use crate::transient::reduced::{
    make_viscous_and_silence_fast_modes_unless_all_modes_are_slow, with_viscous_damping_if_hysteretic,
};
use bench::{Bench, convert_to_shared_rails, fit_amplitudes};
use era_model::stop::StopRequest;
use era_shared::MAX_CHANNELS;
use era_shared::limits::BURST_MAX_MS;
use era_shared::protocol::{Reply, Request};
use nalgebra::DVector;
use rayon::prelude::*;
use serde::Serialize;

pub mod bench;
mod waveform;

pub use waveform::{HIGHEST_LINE, Waveform, compute_sum_of_fundamentals_m_per_s2};

/// Part of the predicted peak to which the motion of switching on must have fallen before the record starts.
const SETTLED: f64 = 1e-4;
/// Part at which the longest settling time will do; less than half the difference that is allowed, as all modes are taken to
/// add up.
const NEARLY_SETTLED: f64 = 2e-2;
/// Longest settling time in s: with soft start and record it fills the longest burst that the board drives, 10 s. A mode at
/// 40 Hz with a damping ratio of 2e-3 has 1.4e-2 left.
const LONGEST_SETTLE_S: f64 = 8.5;
/// From the drives' frame to steady drives, in s: the self-test takes 10 ms, the soft start to 2 kV 100 ms, the supply's own
/// 2 ms leave nothing after 40 more, and a channel at 20 Hz may wait for its phase for 150 ms.
const SOFT_START_S: f64 = 0.3;
/// Shortest settling time in s, for the accelerometer's own low-pass.
const SHORTEST_SETTLE_S: f64 = 0.1;
/// Length of the record in s: several dozen periods, twenty beats at the least spacing of 20 Hz, and a common period of
/// drives on the planner's grid of 1 Hz.
const RECORD_S: f64 = 1.0;

/// Why a point could not be verified.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// No plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// No response at a harmonic.
    #[error(transparent)]
    Response(#[from] response::ResponseError),
    /// There is no steady state to compare with.
    #[error(
        "the prediction and the simulation cannot be compared, because there is no steady state: the motion of the \
        panel has not settled {LONGEST_SETTLE_S} s after the drives were switched on, and the board drives for at \
        most 10 s. Give the scene more damping (such as surface.damping.loss_factor)"
    )]
    NeverSettles,
    /// The electrodes leave no steady state, or none within their gap.
    #[error("the prediction and the simulation cannot be compared, because the panel has no steady motion: {0}")]
    NotSafe(#[from] MotionError),
    /// No force moves the place.
    #[error("the plan drives nothing: the requested peak is 0, or no actuator moves the panel at the target")]
    Nothing,
    /// The simulated device did not do as told.
    #[error("the simulated device did not answer as expected: {0}")]
    Device(String),
}

/// How far an actuator's mass goes from its middle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Travel {
    /// The actuator's `id`.
    pub actuator: String,
    /// Sum of the moduli of its steady motion, as a part of the gap.
    pub predicted: f64,
    /// Most from switching on to the record's end, as a part of the gap.
    pub simulated: f64,
    /// Whether it has met a stop: an electrode has pulled it in.
    pub snapped_in: bool,
}

/// One point, predicted and measured. "Fundamentals" is equation 23 over the drives' own frequencies; "band" is the largest
/// acceleration of the whole waveform, odd harmonics of the square-edged force included, through the accelerometer's 1 kHz
/// low-pass.
///
/// Equation 23 is predicted several times, each time with one thing more of what the device really does, so that what a
/// difference comes from can be told: `linear_g` and `predicted_g` are the plan's own figures; `rounded_g`, `achieved_g`,
/// `causal_g` and `kept_g` are worked out here.
#[derive(Clone, Debug, Serialize)]
pub struct SimulationComparison {
    /// The point in mm.
    pub x_mm: f64,
    /// The point in mm.
    pub y_mm: f64,
    /// The drives.
    pub drives: Vec<crate::planner::Drive>,
    /// The plan's `target_peak_g`: the force of the masses at rest, in g.
    pub linear_g: f64,
    /// The plan's `softened_peak_g`: the force of the moving masses, in g.
    pub predicted_g: f64,
    /// As `predicted_g`, of the frequencies, voltages and pulse widths that the board's registers achieve.
    pub rounded_g: f64,
    /// And the harmonics' motion is among what closes the gaps.
    pub achieved_g: f64,
    /// And with the viscous damping that stands in for a loss factor in time; as `achieved_g` without a loss factor.
    pub causal_g: f64,
    /// And of those modes only that the simulation steps; as `causal_g` where it steps all.
    pub kept_g: f64,
    /// Sum of the amplitudes at the drives' frequencies in the record, in g.
    pub simulated_g: f64,
    /// Relative difference of `simulated_g` from `predicted_g`.
    pub difference: f64,
    /// The same from `linear_g`.
    pub linear_difference: f64,
    /// The same from `achieved_g`.
    pub achieved_difference: f64,
    /// The same from `causal_g`.
    pub causal_difference: f64,
    /// Relative difference of the plan's `predicted_g` from `achieved_g`: what the plan leaves out.
    pub plan_difference: f64,
    /// Sum of the amplitudes of harmonics, and of sums and differences of frequencies, that coincide with a drive's
    /// frequency, relative to `predicted_g`. They are in the record's amplitude at it, and not in equation 23.
    pub coinciding: f64,
    /// Peak of the whole waveform, in g.
    pub predicted_band_g: f64,
    /// Largest magnitude in the record, in g.
    pub simulated_band_g: f64,
    /// Relative difference of the two.
    pub band_difference: f64,
    /// The plan's bound on the relative error of its model.
    pub error_bound: Option<f64>,
    /// What the plan says keeps it below what was asked for.
    pub limited_by: Option<String>,
    /// How far each actuator's mass goes.
    pub travel: Vec<Travel>,
    /// Upper bound on what is left of the motion of switching on when the record starts, as a part of the peak.
    pub unsettled: f64,
}

impl SimulationComparison {
    /// Most that any mass is predicted to travel, as a part of its gap.
    #[must_use]
    pub fn predicted_travel(&self) -> f64 {
        self.travel.iter().map(|travel| travel.predicted).fold(0.0, f64::max)
    }

    /// Most that any mass has travelled in the simulation, as a part of its gap.
    #[must_use]
    pub fn simulated_travel(&self) -> f64 {
        self.travel.iter().map(|travel| travel.simulated).fold(0.0, f64::max)
    }
}

/// Runs a plan for `target` on the simulated device, faster than real time, and compares.
///
/// # Errors
/// [`VerifyError`].
pub fn compare_plan_with_simulation(
    table: &PlanTable,
    panel: &SimPanel,
    target: Target,
) -> Result<SimulationComparison, VerifyError> {
    compare_planned_request_with_simulation(table, panel, &planner::Request::for_touch(&[target]))
}

/// The same for any request, at its first target.
///
/// # Errors
/// [`VerifyError`].
pub fn compare_planned_request_with_simulation(
    table: &PlanTable,
    panel: &SimPanel,
    request: &planner::Request,
) -> Result<SimulationComparison, VerifyError> {
    let plan = table.plan_request(request)?;
    if plan.drives.iter().all(|drive| drive.voltage_v == 0.0) {
        return Err(VerifyError::Nothing);
    }
    let [x_m, y_m] = plan.target_m;
    let shape = table.model.shape_deflections_at(x_m, y_m);
    let mut panel = panel.clone();
    panel.place_accelerometer(&shape);
    let SimulatedRecord { waveform, fundamentals, samples, step_s, predicted_peak, unsettled, largest_travels } =
        record_simulated_plan(table, panel, &shape, &plan)?;
    let masses = table.scene.actuators.iter().zip(&waveform.motion.largest_m).zip(&largest_travels);
    let travel = masses
        .map(|((actuator, predicted_m), largest_travel)| Travel {
            actuator: actuator.id.clone(),
            predicted: predicted_m / actuator.air_gap_m,
            simulated: largest_travel.travel_m / actuator.air_gap_m,
            snapped_in: largest_travel.snapped_in,
        })
        .collect();
    let in_g = |acceleration: f64| acceleration / STANDARD_GRAVITY;
    let (coinciding, beside_hz) = waveform.coinciding_amplitude_and_neighbour_frequencies_hz();
    let simulated_g =
        in_g(fit_amplitudes(&samples, step_s, &waveform.frequencies_hz(), &beside_hz).iter().sum::<f64>());
    let simulated_band_g = in_g(samples.iter().fold(0.0_f64, |most, a| most.max(a.abs())));
    let (linear_g, predicted_g) = (plan.predicted.target_peak_g, plan.predicted.softened_peak_g);
    let [rounded_g, causal_g, kept_g] = fundamentals.map(in_g);
    let (achieved_g, predicted_band_g) = (in_g(waveform.sum_of_fundamentals_m_per_s2()), in_g(predicted_peak));
    let relative = |found: f64, predicted: f64| (found - predicted) / predicted.max(f64::MIN_POSITIVE);
    Ok(SimulationComparison {
        x_mm: x_m * 1e3,
        y_mm: y_m * 1e3,
        linear_g,
        predicted_g,
        rounded_g,
        achieved_g,
        causal_g,
        kept_g,
        simulated_g,
        difference: relative(simulated_g, predicted_g),
        linear_difference: relative(simulated_g, linear_g),
        achieved_difference: relative(simulated_g, achieved_g),
        causal_difference: relative(simulated_g, causal_g),
        plan_difference: relative(predicted_g, achieved_g),
        coinciding: in_g(coinciding) / predicted_g.max(f64::MIN_POSITIVE),
        predicted_band_g,
        simulated_band_g,
        band_difference: relative(simulated_band_g, predicted_band_g),
        error_bound: plan.error_bound,
        limited_by: plan.limited_by,
        travel,
        unsettled,
        drives: plan.drives,
    })
}

/// Compares at every point, as many at a time as there are processors.
///
/// # Errors
/// That of a point, or [`PlanError::Stopped`].
pub fn compare_plans_at_points_with_simulation(
    table: &PlanTable,
    targets: &[Target],
) -> Result<Vec<SimulationComparison>, VerifyError> {
    let panel = SimPanel::from_plan_table(table);
    let stop = StopRequest::current_request_of_thread();
    let compared = |target: &Target| {
        if stop.is_stop_requested_or_deadline_over() {
            Err(PlanError::Stopped.into())
        } else {
            stop.run_with_self_as_current_stop_request_of_thread(|| {
                compare_plan_with_simulation(table, &panel, *target)
            })
        }
    };
    targets.par_iter().map(compared).collect()
}

/// `count` points spread over a scene's surface, fewer where there are cut-outs, in m.
#[must_use]
pub fn spread_points_over(scene: &Scene, count: u32) -> Vec<(f64, f64)> {
    let mut points = spread_points(count, scene.surface.length_m, scene.surface.width_m);
    points.retain(|(x_m, y_m)| scene.surface_or_bar_axis_point_outside_cutouts(*x_m, *y_m).is_ok());
    points
}

/// Points spread over the surface by a low-discrepancy sequence (Roberts' R2, the plastic number), none on an edge.
#[must_use]
pub fn spread_points(count: u32, length_m: f64, width_m: f64) -> Vec<(f64, f64)> {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    (0..count)
        .map(|i| {
            let at = |step: f64| (0.5 + step * f64::from(i + 1)).fract();
            (length_m * at(1.0 / PLASTIC), width_m * at(1.0 / (PLASTIC * PLASTIC)))
        })
        .collect()
}

/// What the device did, and what the frequency domain has for it.
struct SimulatedRecord {
    /// Of the drives as the registers achieve them, their phases counted from the panel's time zero.
    waveform: Waveform,
    /// Fundamentals in m/s^2: without harmonics; with harmonics and the damping in time; and with the modes in time.
    fundamentals: [f64; 3],
    /// Peak of `waveform` over the same window, in m/s^2.
    predicted_peak: f64,
    /// The accelerometer's samples in m/s^2, `step_s` apart.
    samples: Vec<f64>,
    step_s: f64,
    /// Part of the peak that may be left of the motion of switching on.
    unsettled: f64,
    /// How far each mass has been.
    largest_travels: [LargestTravel; MAX_CHANNELS],
}

/// The accelerometer's record after the panel has settled.
fn record_simulated_plan(
    table: &PlanTable,
    panel: SimPanel,
    shape: &DVector<f64>,
    plan: &Plan,
) -> Result<SimulatedRecord, VerifyError> {
    let step_s = panel.step_s();
    let actuators = &table.scene.actuators;
    let volts: Vec<f64> = actuators.iter().map(|actuator| actuator.max_voltage_v).collect();
    let transducers: Vec<Transducer> = actuators.iter().map(Transducer::from_actuator).collect();
    let mut bench = Bench::new(panel, &volts);
    bench.send_request(&Request::ArmWith { deadman_ms: None, burst_ms: Some(BURST_MAX_MS) })?;
    let drives =
        assign_channels_in_order_of_drives(&plan.drives).iter().map(drive_to_wire_zeroing_too_narrow_pulses).collect();
    let Reply::DrivesSet { achieved } = bench.send_request(&Request::SetDrives { drives })? else {
        return Err(VerifyError::Device("it did not confirm the drives".into()));
    };
    // The device holds the drives until its self-test has passed, and brings the rails up.
    bench.run_for(SOFT_START_S)?;
    let achieved = bench.find_drives_from_panel_time_zero(&convert_to_shared_rails(
        achieved.iter().map(achieved_drive_from_wire).collect(),
    ))?;
    let waveform = Waveform::new(&table.model, &transducers, shape, &achieved)?;
    let of = |model: &ReducedModel, highest| {
        compute_sum_of_fundamentals_m_per_s2(model, &transducers, shape, &achieved, highest)
    };
    let in_time =
        |parts: Option<ReducedModel>, otherwise: f64| parts.map_or(Ok(otherwise), |model| of(&model, HIGHEST_LINE));
    let causal_sum =
        in_time(with_viscous_damping_if_hysteretic(&table.model), waveform.sum_of_fundamentals_m_per_s2())?;
    let fundamentals = [
        of(&table.model, 1)?,
        causal_sum,
        in_time(make_viscous_and_silence_fast_modes_unless_all_modes_are_slow(&table.model), causal_sum)?,
    ];
    // From rest, the motion is the steady one and a free one that cancels it at first.
    let peak = waveform.peak_m_per_s2(0.0, step_s, count_samples(RECORD_S, step_s));
    let (settling_s, left) = bench.panel_mut().settling_time_s_and_acceleration_after_it_m_per_s2(
        &waveform.displacement,
        &waveform.velocity,
        SETTLED * peak,
        LONGEST_SETTLE_S,
    );
    if left > NEARLY_SETTLED * peak {
        return Err(VerifyError::NeverSettles);
    }
    bench.run_for(settling_s.max(SHORTEST_SETTLE_S))?;
    // A sample is the mean over a step and stands for the step's middle.
    let from_s = bench.panel_mut().time_s() + 0.5 * step_s;
    bench.accelerometer_mut().start_record();
    bench.run_for(RECORD_S)?;
    let samples = bench.accelerometer_mut().stop_and_take_record();
    let largest_travels = bench.panel_mut().take_largest_travels_since_last_call();
    bench.send_request(&Request::Stop)?;
    Ok(SimulatedRecord {
        predicted_peak: waveform.peak_m_per_s2(from_s, step_s, samples.len()),
        waveform,
        fundamentals,
        samples,
        step_s,
        unsettled: left / peak.max(f64::MIN_POSITIVE),
        largest_travels,
    })
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a second or so")]
fn count_samples(seconds: f64, step_s: f64) -> usize {
    (seconds / step_s) as usize
}
