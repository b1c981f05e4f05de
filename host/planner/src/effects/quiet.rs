//! From when on a motion is quiet.

/// How much longer it has to stay below what counts as quiet, in s: a period of 20 Hz, half the lowest frequency of a drive. Between
/// two crests anything is quiet.
pub const QUIET_FOR_S: f64 = 0.05;

/// The index of the sample from which on a motion stays below a limit, if it does so for the last [`QUIET_FOR_S`];
/// `None` also if it always did.
pub fn quiet_start_index_unless_always_or_never_quiet(motion: &[f64], limit: f64, step_s: f64) -> Option<usize> {
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
        assert_eq!(quiet_start_index_unless_always_or_never_quiet(&ringing(0.0), 0.1, step_s), None);
        // Below a tenth from ln 10 / 20 s on, within half a period, and before the record is shown to be over.
        let quiet_s = f64::from(
            u32::try_from(quiet_start_index_unless_always_or_never_quiet(&ringing(20.0), 0.1, step_s).unwrap())
                .unwrap(),
        ) * step_s;
        assert!((10_f64.ln() / 20.0 - 0.012..10_f64.ln() / 20.0).contains(&quiet_s), "{quiet_s}");
        assert_eq!(quiet_start_index_unless_always_or_never_quiet(&ringing(6.0), 0.1, step_s), None);
        assert_eq!(quiet_start_index_unless_always_or_never_quiet(&ringing(20.0), 2.0, step_s), None);
    }
}
