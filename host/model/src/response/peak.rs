//! Peak of a sum of sines.

use num_complex::Complex64;

/// Frequencies nearer to each other than this part count as one: their beat would last longer than any effect
/// (2 s / 1e-9 of a period at 200 Hz is months).
const SAME: f64 = 1e-9;

/// One sine: its frequency and phasor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SineComponent {
    /// In Hz.
    pub frequency_hz: f64,
    /// Amplitude and phase.
    pub phasor: Complex64,
}

/// Largest value that the sum reaches: equation 23, the sum of the moduli, with the phasors of equal frequencies added
/// before the modulus is taken. Equation 23 as printed takes each modulus by itself and then overstates what two
/// actuators at one frequency do, up to hiding a dead zone.
#[must_use]
pub fn peak_of_sines_merging_equal_frequencies(components: &[SineComponent]) -> f64 {
    let mut groups: Vec<SineComponent> = Vec::with_capacity(components.len());
    for component in components {
        let same = |group: &&mut SineComponent| {
            (group.frequency_hz - component.frequency_hz).abs() <= SAME * component.frequency_hz.abs()
        };
        match groups.iter_mut().find(same) {
            Some(group) => group.phasor += component.phasor,
            None => groups.push(*component),
        }
    }
    groups.iter().map(|group| group.phasor.norm()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_frequencies_cancel_and_distinct_ones_add() {
        let at = |frequency_hz: f64, re: f64| SineComponent { frequency_hz, phasor: Complex64::from(re) };
        assert_eq!(peak_of_sines_merging_equal_frequencies(&[at(100.0, 1.0), at(100.0, -1.0)]), 0.0);
        assert_eq!(peak_of_sines_merging_equal_frequencies(&[at(100.0, 1.0), at(120.0, -1.0)]), 2.0);
        assert_eq!(peak_of_sines_merging_equal_frequencies(&[at(100.0, 1.0), at(120.0, 0.5), at(100.0, 2.0)]), 3.5);
    }
}
