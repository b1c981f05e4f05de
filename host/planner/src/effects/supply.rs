//! What the supply's mean current leaves of an effect's drives.

use super::effect_drive::EffectDrive;
use crate::PlanTable;
use crate::physics::limits::{Electrodes, Limit, max_mean_supply_current_a, mean_supply_current_with_bleeders_a};
use era_shared::supply::rail_index_of_channel;

/// Derates all drives until together they draw no more than the supply delivers continuously: pushes of some cycles
/// last longer than the 8 ms over which the board averages the current. Returns the limit if it was necessary.
pub fn derate_drives_to_supply_current_if_exceeded(
    table: &PlanTable,
    effect_drives: &mut [EffectDrive],
) -> Option<Limit> {
    let drawn_a = mean_supply_current_of_effect_a(&table.electrodes, effect_drives);
    (drawn_a > max_mean_supply_current_a()).then(|| {
        let part_left = max_mean_supply_current_a() / drawn_a;
        // Charge and bleeders go with the voltage, the force with its square.
        effect_drives.iter_mut().for_each(|part| part.drive.force_n *= part_left * part_left);
        Limit::Supply
    })
}

/// Mean current in A of all drives that make a force, at full level.
fn mean_supply_current_of_effect_a(electrodes: &[Electrodes], effect_drives: &[EffectDrive]) -> f64 {
    let driven = effect_drives.iter().filter(|part| part.drive.force_n > 0.0);
    let charged = driven.map(|part| {
        let actuator = part.drive.actuator;
        let volts = highest_voltage_needed_on_rail_of_actuator_v(electrodes, effect_drives, actuator, 1.0);
        (actuator, volts, part.channel.frequency_hz)
    });
    mean_supply_current_with_bleeders_a(electrodes, charged)
}

/// Voltage in V across an actuator's gap for forces times `force_scale`: the highest one that a drive on its rail needs.
pub fn highest_voltage_needed_on_rail_of_actuator_v(
    electrodes: &[Electrodes],
    effect_drives: &[EffectDrive],
    actuator: usize,
    force_scale: f64,
) -> f64 {
    let on_its_rail = effect_drives
        .iter()
        .filter(|part| rail_index_of_channel(part.drive.actuator) == rail_index_of_channel(actuator));
    let volts = |part: &EffectDrive| {
        let electrodes = electrodes.get(part.drive.actuator)?;
        Some(electrodes.voltage_for_force_v(
            part.drive.force_n * force_scale,
            part.channel.frequency_hz,
            part.channel.pulse_width,
        ))
    };
    on_its_rail.filter_map(volts).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::effect_drive::build_effect_drives;
    use crate::model::{Accuracy, PanelModel};
    use crate::scene::{STARTING_PLATE, Scene};
    use crate::{TableOptions, Target};

    /// The drives of a touch on the example plate, with their table.
    fn touch() -> (PlanTable, Vec<EffectDrive>) {
        let scene = Scene::parse("plate", STARTING_PLATE).unwrap();
        let options = TableOptions { from_hz: 330.0, to_hz: 400.0, step_hz: 2.0 };
        let model = PanelModel::build(&scene, Accuracy::FAST, 400.0)
            .unwrap()
            .reduce_with_residual_shapes_of_actuators_damping_and_points(400.0, &[])
            .unwrap();
        let table = PlanTable::build(&scene, model, options).unwrap();
        let plan = table.plan(&[Target { x_m: 0.1, y_m: 0.1, intensity_g: Some(0.02) }]).unwrap();
        let effect_drives = build_effect_drives(&table, table.panel_poles().unwrap(), &plan).unwrap();
        (table, effect_drives)
    }

    /// Where no actuator moves the target, all forces are 0: there is no current to share.
    #[test]
    fn drives_that_are_off_stay_off() {
        let (table, mut effect_drives) = touch();
        effect_drives.iter_mut().for_each(|part| part.drive.force_n = 0.0);
        assert_eq!(derate_drives_to_supply_current_if_exceeded(&table, &mut effect_drives), None);
        assert!(effect_drives.iter().all(|part| part.drive.force_n == 0.0));
    }

    #[test]
    fn pushes_draw_no_more_than_there_is() {
        let (table, mut effect_drives) = touch();
        assert!(derate_drives_to_supply_current_if_exceeded(&table, &mut effect_drives).is_none());
        effect_drives.iter_mut().for_each(|part| part.drive.force_n = 40.0 * part.max_force_n);
        assert!(matches!(derate_drives_to_supply_current_if_exceeded(&table, &mut effect_drives), Some(Limit::Supply)));
        let amps = mean_supply_current_of_effect_a(&table.electrodes, &effect_drives);
        assert!((amps / max_mean_supply_current_a() - 1.0).abs() < 1e-9);
    }
}
