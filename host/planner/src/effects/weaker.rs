//! The same effect with a part of its forces.

use super::design::EffectDesign;

impl EffectDesign {
    /// The same windows or segments at voltages that make the part `force_fraction`, 0 to 1, of the forces. The motion is taken as
    /// proportional to the forces: gaps that move less make it weaker by less than what the design counts for them.
    #[must_use]
    pub fn scale_copy_to_force_fraction(&self, force_fraction: f64) -> Self {
        let part = force_fraction.clamp(0.0, 1.0);
        let mut weaker = self.clone();
        // A force is proportional to the square of its voltage.
        weaker.windows.iter_mut().for_each(|window| window.voltage_v = (window.voltage_v * part.sqrt()).floor());
        for designed in &mut weaker.drives {
            designed.drive.voltage_v *= part.sqrt();
            designed.drive.force_n *= part;
        }
        let predicted = &mut weaker.predicted;
        for peak_g in [&mut predicted.peak_g, &mut predicted.peak_least_g, &mut predicted.peak_most_g] {
            *peak_g *= part;
        }
        // Of a square.
        predicted.sound_db = predicted.sound_db.filter(|_| part > 0.0).map(|db| db + 20.0 * part.log10());
        weaker.peaks_g.iter_mut().chain(&mut weaker.travel_m).for_each(|value| *value *= part);
        for (most, left) in &mut weaker.pole_amplitudes {
            (*most, *left) = (*most * part, *left * part);
        }
        weaker
    }
}
