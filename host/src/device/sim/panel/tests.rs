use super::*;
use crate::scene::ChargingTimes;
use era_shared::supply::SupplyCommand;
use era_shared::waveform::TimerPeriod;
use nalgebra::DMatrix;

/// One mode of w rad/s and the viscous damping c in 1/s.
fn panel(omega: f64, c: f64) -> SimPanel {
    let system = ModalSystem {
        lambda: DVector::from_element(1, omega * omega),
        damping: DMatrix::from_element(1, 1, c),
        force: DMatrix::from_element(1, 1, 1.0),
    };
    SimPanel::new(&system, vec![Transducer::with_fixed_force(1.0)])
}

#[test]
fn settling_follows_the_slowest_pole() {
    let part = 1e-4_f64;
    let one = DVector::from_element(1, 1.0);
    // Weak damping: exp(-c t / 2). Strong: one pole at -c, the slow one at -w^2 / c.
    for (omega, c, rate) in [(600.0, 12.0, 6.0), (100.0, 2000.0, 5.01)] {
        let mut panel = panel(omega, c);
        panel.place_accelerometer(&one);
        let (found, left) =
            panel.settling_time_s_and_acceleration_after_it_m_per_s2(&one, &(0.0 * &one), part * omega * omega, 20.0);
        let rough = -part.ln() / rate;
        assert!((found - rough).abs() < 0.2 * rough, "{omega} {c}: {found} s, about {rough} s");
        assert!(left <= part * omega * omega);
    }
    let mut undamped = panel(600.0, 0.0);
    undamped.place_accelerometer(&one);
    let (_, left) = undamped.settling_time_s_and_acceleration_after_it_m_per_s2(&one, &one, 1.0, 20.0);
    assert!((left - 600.0 * 600.0_f64.hypot(1.0)).abs() < 1e-6 * left);
    let mut free = panel(0.0, 0.0);
    free.place_accelerometer(&one);
    assert_eq!(
        free.settling_time_s_and_acceleration_after_it_m_per_s2(&one, &one, 0.0, 20.0),
        (0.0, 0.0),
        "a drift is no acceleration"
    );
}

const ERA: Transducer = Transducer {
    newtons_per_volt_squared: 3.477e-8,
    gap_m: 0.5e-3,
    counted_n_per_m: 0.0,
    charging: ChargingTimes { rise_s: 0.0, hold_s: 0.0, fall_s: 0.0 },
};

/// An ERA of 10 g and 5 kN/m on the ground (112.5 Hz), driven with windows of 2/3 at `period_ticks` of 1 us, its rail on
/// the way to `volts`.
fn driven_era(step_s: f64, period_ticks: u32, volts: u32) -> SimPanel {
    driven_transducer(ERA, step_s, period_ticks, volts)
}

fn driven_transducer(era: Transducer, step_s: f64, period_ticks: u32, volts: u32) -> SimPanel {
    let (mass, stiffness, damping) = (0.01_f64, 5000.0, 0.7);
    let system = ModalSystem {
        lambda: DVector::from_element(1, stiffness / mass),
        damping: DMatrix::from_element(1, 1, damping / mass),
        force: DMatrix::from_element(1, 1, 1.0 / mass.sqrt()),
    };
    let mut panel = SimPanel::with_step(&system, vec![era], step_s);
    let mut source = SimTimer::new(0.0).expect("idle");
    source
        .preload_repeating_period_and_drop_later_ones(
            &TimerPeriod::with_windows(170, period_ticks, period_ticks / 3, false),
            0.0,
            0.0,
        )
        .expect("a period");
    panel.set_channel_timer(0, Some(source));
    panel.set_timers_connected_to_electrodes(true);
    let mut supply =
        SupplyCommand { enabled: true, discharge: [false; RAILS], permitted: true, ..SupplyCommand::default() };
    supply.set_point_millivolts[0] = volts * 1000;
    let mut rail = SimRail::new_discharging_since(0.0, 0.0);
    rail.apply_supply_command(0.0, &supply, 0, false);
    panel.set_rail(0, rail);
    panel
}

#[test]
fn the_steps_error_is_below_1e_4() {
    // At 100, 105 and 167 Hz, the first two of them up to a fifth of the gap. At 400 Hz it is 4e-4, from the windows' edges.
    for (period_ticks, volts) in [(10_000, 1300), (9_524, 1200), (6_000, 1900)] {
        let mut panels = [STEP_S, STEP_S / 2.0, STEP_S / 8.0].map(|step_s| driven_era(step_s, period_ticks, volts));
        let (mut most, mut errors) = (0.0_f64, [0.0_f64; 2]);
        for i in 1..=16_000_u32 {
            let [coarse, half, fine] = panels.each_mut().map(|panel| {
                panel.advance_to(f64::from(i) * STEP_S + 1e-9);
                panel.state[0] * 10.0
            });
            most = most.max(fine.abs());
            errors = [errors[0].max((coarse - fine).abs()), errors[1].max((half - fine).abs())];
        }
        let [coarse, half] = errors.map(|error| error / most);
        println!("{volts} V: {:.3} of the gap, error {coarse:.1e}, with half the step {half:.1e}", most / ERA.gap_m);
        assert!(coarse < 1e-4 && half < 0.5 * coarse, "{coarse} {half}");
    }
}

/// Fourier sums of the pull over 40 periods, with the edges where the timer has them: level and lag of the formulas, which have no steps.
/// The electrodes discharge when the timer goes.
#[test]
fn electrodes_behind_resistors_pull_as_the_formulas_say() {
    use crate::planner::charging::PeriodicCharging;
    use num_complex::Complex64;
    let times = ChargingTimes { rise_s: 116e-6, hold_s: 15e-6, fall_s: 11.6e-6 };
    // Even, so that both windows are in the middle of their half periods.
    for period_ticks in [5_000, 2_504] {
        let era = Transducer { charging: times, gap_m: f64::INFINITY, ..ERA };
        let mut panel = driven_transducer(era, STEP_S, period_ticks, 1_000);
        let hz = 1e6 / f64::from(period_ticks);
        panel.advance_to(0.2);
        let middle_s =
            panel.channel_timer_mut(0).and_then(|timer| timer.time_s_of_force_peak_in_last_preload_unless_blank());
        let (mut sum, steps) = (Complex64::ZERO, (40.0 / hz / STEP_S).round() as u32);
        for _ in 0..steps {
            let at_s = panel.time_s() + 0.5 * STEP_S;
            panel.advance_to(panel.time_s() + STEP_S + 1e-9);
            let turn = std::f64::consts::TAU * hz * (at_s - middle_s.unwrap());
            sum += Complex64::cis(-turn) * (2.0 / f64::from(steps) * panel.forces[0]);
        }
        let width = 2.0 * f64::from(period_ticks / 3) / f64::from(period_ticks);
        let expected = PeriodicCharging::new(times, hz).force_harmonic_phasor_per_n_at_rail_voltage(1.0, width)
            * ERA.newtons_per_volt_squared
            * 1e6;
        assert!((sum - expected).norm() < 5e-4 * expected.norm(), "{sum} {expected}");
        panel.set_channel_timer(0, None);
        panel.advance_to(panel.time_s() + 2e-3);
        assert_eq!(panel.charging_electrodes[0].map(|electrode| electrode.volts()), [0.0; 2]);
    }
}

#[test]
fn an_era_that_is_driven_too_hard_snaps_in_and_stays_between_its_stops() {
    let mut panel = driven_era(STEP_S, 9_524, 1200);
    panel.advance_to(0.5);
    let [largest_travel, ..] = panel.take_largest_travels_since_last_call();
    assert!(
        !largest_travel.snapped_in
            && largest_travel.travel_m > 0.1 * ERA.gap_m
            && largest_travel.travel_m < ERA.gap_m / 3.0
    );
    let mut panel = driven_era(STEP_S, 9_524, 4000);
    panel.advance_to(0.5);
    let [largest_travel, ..] = panel.take_largest_travels_since_last_call();
    assert!(largest_travel.snapped_in && largest_travel.travel_m < ERA.gap_m, "{largest_travel:?}");
    panel.set_timers_connected_to_electrodes(false);
    panel.advance_to(1.0);
    panel.take_largest_travels_since_last_call();
    panel.advance_to(1.5);
    let [largest_travel, ..] = panel.take_largest_travels_since_last_call();
    assert!(!largest_travel.snapped_in && largest_travel.travel_m < 0.01 * ERA.gap_m, "{largest_travel:?}");
}
