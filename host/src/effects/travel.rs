//! Travel of the actuators while an effect plays, and what keeps it within bounds.

use super::motion::samples_of;
use super::part::Part;
use crate::planner::PlanTable;
use crate::planner::limits::{BREAKDOWN_MARGIN, TRAVEL_PART, breakdown_v};
use crate::planner::rise::Ringing;
use era_shared::waveform::Effect;

/// Travel over the gap, linear, that stays below a third of the gap when the force grows with the closing gap: with the
/// force against the spring and the gap at u, u (1 - u)^2 = linear travel, and 4/27 at u = 1/3, the static pull-in.
const SAFE_TRAVEL: f64 = 4.0 / 27.0;
/// Steps of bisections.
const BISECTIONS: usize = 24;

/// Lowers all drives until no actuator travels too far, or closes its gap below what its voltage takes; says whether it
/// had to.
///
/// What the plan's steady drives travel is allowed, as the plan keeps its own limits. Beyond that a third of the gap is,
/// with the force growing as the gap closes ([`SAFE_TRAVEL`]), and what the air then holds. Travels by different drives
/// are added up.
pub fn keep_within_travel(table: &PlanTable, parts: &mut [Part], effects: &[Effect]) -> bool {
    let peak = |part: &Part, effect: &Effect, ringing: &Ringing| {
        let (samples, _) = samples_of(ringing, &part.levels(effect), part.channel.period_s(), 0.0);
        samples.iter().fold(0.0_f64, |most, x| most.max(x.abs()))
    };
    let travels: Vec<Vec<f64>> = parts
        .iter()
        .zip(effects)
        .map(|(part, effect)| part.travel.iter().map(|ringing| peak(part, effect, ringing)).collect())
        .collect();
    let fits = |scale: f64| {
        table.electrodes.iter().enumerate().all(|(actuator, electrodes)| {
            let of_each = parts.iter().zip(&travels);
            let travel: f64 = of_each.map(|(part, all)| all[actuator] * part.drive.force_n * scale).sum();
            let steady: f64 = parts.iter().map(|part| part.travel[actuator].steady.norm() * part.planned_force_n).sum();
            let own = parts.iter().find(|part| part.drive.actuator == actuator);
            if travel <= steady && own.is_none_or(|part| part.drive.force_n * scale <= part.planned_force_n) {
                return true;
            }
            let linear = travel / electrodes.gap_m;
            if linear > SAFE_TRAVEL {
                return false;
            }
            let Some(part) = own else { return true };
            let closed = electrodes.gap_m * (1.0 - closing(linear));
            electrodes.voltage_for(part.drive.force_n * scale, part.channel.pulse_width)
                <= BREAKDOWN_MARGIN * breakdown_v(closed)
        })
    };
    if fits(1.0) {
        return false;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        *(if fits(middle) { &mut low } else { &mut high }) = middle;
    }
    parts.iter_mut().for_each(|part| part.drive.force_n *= low);
    true
}

/// The u up to a third with u (1 - u)^2 = `linear`, from above.
fn closing(linear: f64) -> f64 {
    let (mut low, mut high) = (0.0, TRAVEL_PART);
    for _ in 0..BISECTIONS {
        let middle: f64 = 0.5 * (low + high);
        *(if middle * (1.0 - middle).powi(2) < linear { &mut low } else { &mut high }) = middle;
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closing_gap() {
        for u in [0.01, 0.1, 0.2, 0.3] {
            assert!((closing(u * (1.0 - u) * (1.0 - u)) - u).abs() < 1e-6, "{u}");
        }
        assert_eq!(closing(1.0), TRAVEL_PART);
    }
}
