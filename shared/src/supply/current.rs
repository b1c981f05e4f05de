//! What drives take from the supply on average.

use super::{RAILS, rail_index_of_channel};
use crate::circuit::{ELECTRODE_PICOFARADS, both_bleeders_of_one_rail_microamps};

/// Mean current in uA, rounded up, that drives take from rails of these voltages: both electrodes of a channel are charged once in every
/// period, at most, and each rail has two bleeders. `channels_with_nanohertz` holds the channel and the frequency in 1e-9 Hz of each.
pub fn mean_current_of_drives_and_bleeders_microamps(
    rail_millivolts: [u32; RAILS],
    channels_with_nanohertz: impl Iterator<Item = (usize, u64)>,
) -> u32 {
    let charged = channels_with_nanohertz.map(|(channel, frequency_nanohertz)| {
        let millivolts = rail_millivolts.get(rail_index_of_channel(channel)).copied().unwrap_or(0);
        let picofarads = ELECTRODE_PICOFARADS.get(channel).copied().unwrap_or(0);
        // pF times mV is fC, and fC times mHz is 1e-18 A: at 2 kV and 1 kHz 4.6e14 of them.
        2 * u64::from(picofarads) * u64::from(millivolts) * frequency_nanohertz.div_ceil(1_000_000)
    });
    let charging = u32::try_from(charged.sum::<u64>().div_ceil(1_000_000_000_000)).unwrap_or(u32::MAX);
    rail_millivolts.into_iter().map(both_bleeders_of_one_rail_microamps).fold(charging, u32::saturating_add)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 2 x 116 pF x 2 kV are 0.464 uC for each cycle, and 2 kV over 50 Mohm 40 uA for each rail.
    #[test]
    fn charges_and_bleeders_by_hand() {
        let four = |hz: u64| (0..4).map(move |channel| (channel, hz * 1_000_000_000));
        assert_eq!(
            mean_current_of_drives_and_bleeders_microamps([2_000_000; RAILS], four(200)),
            372 + 80,
            "371.2 uA and 80 uA"
        );
        assert_eq!(
            mean_current_of_drives_and_bleeders_microamps([2_000_000, 0], [(0, 100_000_000_000)].into_iter()),
            47 + 40
        );
        // The other rail's voltage is what counts for a channel on it.
        assert_eq!(
            mean_current_of_drives_and_bleeders_microamps([2_000_000, 500_000], [(3, 100_000_000_000)].into_iter()),
            12 + 40 + 10
        );
        assert_eq!(mean_current_of_drives_and_bleeders_microamps([0; RAILS], core::iter::empty()), 0);
    }
}
