//! What the supply's mean current leaves of an effect's drives.

use super::effect_drive::Part;
use crate::PlanTable;
use crate::physics::limits::{Electrodes, Limit, most_mean_current_a};
use era_shared::supply::rail_index_of_channel;

/// Lowers all drives until together they draw no more than the supply delivers for long: pushes of some cycles last longer than
/// the 10 ms after which the board switches off. Says what made that necessary.
pub fn keep_within_supply(table: &PlanTable, parts: &mut [Part]) -> Option<(usize, Limit)> {
    let current = |part: &Part| {
        let electrodes = table.electrodes.get(part.drive.actuator)?;
        (part.drive.force_n > 0.0).then(|| {
            let volts = rail_v(&table.electrodes, parts, part.drive.actuator, 1.0);
            electrodes.mean_current_a(volts, part.channel.frequency_hz)
        })
    };
    let drawn_a: f64 = parts.iter().filter_map(current).sum();
    // The sum of no currents is -0: nothing is divided by it.
    (drawn_a > most_mean_current_a()).then(|| {
        let part_left = most_mean_current_a() / drawn_a;
        // The charge goes with the voltage, the force with its square.
        parts.iter_mut().for_each(|part| part.drive.force_n *= part_left * part_left);
        (0, Limit::Supply)
    })
}

/// Voltage across an actuator's gap, forces times `scale`: the highest that is asked of its rail.
pub fn rail_v(electrodes: &[Electrodes], parts: &[Part], actuator: usize, scale: f64) -> f64 {
    let on_its_rail =
        parts.iter().filter(|part| rail_index_of_channel(part.drive.actuator) == rail_index_of_channel(actuator));
    let volts = |part: &Part| {
        let electrodes = electrodes.get(part.drive.actuator)?;
        Some(electrodes.voltage_for(part.drive.force_n * scale, part.channel.pulse_width))
    };
    on_its_rail.filter_map(volts).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::effect_drive::parts;
    use crate::model::{Accuracy, PanelModel};
    use crate::scene::{EXAMPLE_PLATE, Scene};
    use crate::{TableOptions, Target};

    /// The drives of a touch on the example plate, with their table.
    fn touch() -> (PlanTable, Vec<Part>) {
        let scene = Scene::parse("plate", EXAMPLE_PLATE).unwrap();
        let options = TableOptions { from_hz: 330.0, to_hz: 400.0, step_hz: 2.0 };
        let model = PanelModel::build(&scene, Accuracy::FAST, 400.0).unwrap().reduce(400.0, &[]).unwrap();
        let table = PlanTable::build(&scene, model, options).unwrap();
        let plan = table.plan(&[Target { x_m: 0.1, y_m: 0.1, intensity_g: Some(0.02) }]).unwrap();
        let parts = parts(&table, table.rise().unwrap(), &plan).unwrap();
        (table, parts)
    }

    /// Where no actuator moves the target, all forces are 0: there is no current to share.
    #[test]
    fn drives_that_are_off_stay_off() {
        let (table, mut parts) = touch();
        parts.iter_mut().for_each(|part| part.drive.force_n = 0.0);
        assert_eq!(keep_within_supply(&table, &mut parts), None);
        assert!(parts.iter().all(|part| part.drive.force_n == 0.0));
    }

    #[test]
    fn pushes_draw_no_more_than_there_is() {
        let (table, mut parts) = touch();
        assert!(keep_within_supply(&table, &mut parts).is_none());
        parts.iter_mut().for_each(|part| part.drive.force_n = 40.0 * part.max_force_n);
        assert!(matches!(keep_within_supply(&table, &mut parts), Some((_, Limit::Supply))));
        let amps = parts.iter().map(|part| {
            let volts = rail_v(&table.electrodes, &parts, part.drive.actuator, 1.0);
            table.electrodes[part.drive.actuator].mean_current_a(volts, part.channel.frequency_hz)
        });
        assert!((amps.sum::<f64>() / most_mean_current_a() - 1.0).abs() < 1e-9);
    }
}
