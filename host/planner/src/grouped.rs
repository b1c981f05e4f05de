//! Plans whose forces come from elsewhere than the search: one frequency for all actuators or for groups of them, with
//! phases, and one setting for the whole surface.

use super::allocate::{Allocation, Prices};
use super::candidates::Judge;
use super::chosen::Chosen;
use super::phased::{self, Field, PerActuator, PerPair};
use super::reach::{Region, schemes};
use super::refine::Selection;
use super::request::{Grouping, PlanError};
use super::table::{PlanTable, Width, at_point};
use super::{MIN_SPACING_HZ, MOST_CONDITION};
use crate::scene::MAX_ACTUATORS;
use num_complex::Complex64;

/// Part of a wish that is met.
const MET: f64 = 1.0 - 1e-9;
/// Times as much that stronger pulses have to reach to be taken: their harmonics move the panel more.
const MORE: f64 = 1.0 + 1e-3;

impl PlanTable {
    /// The drives for one target with the least energy elsewhere, in groups that share a frequency.
    pub(super) fn grouped(
        &self,
        judge: &Judge<'_>,
        grouping: Grouping,
        wanted: &[f64],
    ) -> Result<Selection, PlanError> {
        let grouping = match grouping {
            Grouping::Shared => phased::Grouping::Shared,
            _ => phased::Grouping::Mixed,
        };
        let wanted = wanted.first().copied().unwrap_or(0.0);
        // All with their quieter pulses, or, if that does not reach, all with their stronger ones; harmonics are those of the
        // pulses taken.
        let best = |strong: bool| {
            let data = Data::new(self, judge, strong);
            phased::best(&data.field(self), grouping, wanted, MIN_SPACING_HZ).ok_or(PlanError::NoFrequencies)
        };
        let (mut found, mut strong) = (best(false)?, false);
        if found.reached < wanted * MET {
            let stronger = best(true)?;
            if stronger.reached > found.reached * MORE {
                (found, strong) = (stronger, true);
            }
        }
        let mut drives: Vec<Option<Chosen>> = vec![None; self.entries.len()];
        for group in &found.groups {
            for (i, drive) in drives.iter_mut().enumerate().filter(|(i, _)| group.members >> i & 1 == 1) {
                let force = group.forces_n.get(i).copied().unwrap_or_default();
                let row = self.grid_row(group.frequency);
                let width = row.get(i).map_or_else(Width::default, |entry| *entry.pulse(strong));
                *drive = Some(Chosen {
                    frequency_hz: self.frequencies_hz[group.frequency],
                    on_grid: Some(group.frequency),
                    row,
                    width,
                    force_n: force.norm(),
                    phase_rad: if force.norm() > 0.0 { force.arg() } else { 0.0 },
                });
            }
        }
        let drives: Vec<Chosen> = drives.into_iter().collect::<Option<_>>().ok_or(PlanError::NoFrequencies)?;
        let met = if wanted > 0.0 { (found.reached / wanted).min(1.0) } else { 1.0 };
        let mut forces_n = [0.0; MAX_ACTUATORS];
        forces_n.iter_mut().zip(&drives).for_each(|(force, drive)| *force = drive.force_n);
        let allocation = Allocation { forces_n, met, cost: found.energy, prices: Prices::default() };
        Ok(Selection {
            drives,
            allocation,
            binding: Vec::new(),
            gap: if found.proven_gap > 1e-8 { found.proven_gap } else { 0.0 },
        })
    }
}

impl PlanTable {
    /// The drives that leave no dead zone, scaled to what the target asks for.
    pub(super) fn evened(
        &self,
        judge: &Judge<'_>,
        zone: Option<Region>,
        wanted: &[f64],
    ) -> Result<Selection, PlanError> {
        let within = zone.map(|zone| schemes::everywhere(self, Some(zone)));
        let found = within.as_ref().map_or_else(|| self.everywhere(), Option::as_ref);
        let (setting, gap) = found.ok_or(PlanError::NoFrequencies)?;
        let mut drives = Vec::with_capacity(setting.len());
        let mut peak = 0.0;
        for (i, part) in setting.iter().enumerate() {
            let row = self.grid_row(part.frequency);
            let entry = row.get(i).ok_or(PlanError::NoFrequencies)?;
            let width = *entry.pulse(part.force_n > entry.widths[0].max_force_n);
            if let Some(shape) = judge.zone.targets.first() {
                peak += at_point(shape, &entry.acceleration).norm() * part.force_n;
            }
            drives.push(Chosen {
                frequency_hz: part.frequency_hz,
                on_grid: Some(part.frequency),
                row,
                width,
                force_n: part.force_n,
                phase_rad: 0.0,
            });
        }
        let wanted = wanted.first().copied().unwrap_or(0.0);
        let scale = if peak > wanted { wanted / peak } else { 1.0 };
        let mut forces_n = [0.0; MAX_ACTUATORS];
        for (force, drive) in forces_n.iter_mut().zip(&mut drives) {
            drive.force_n *= scale;
            *force = drive.force_n;
        }
        let met = if wanted > 0.0 { (peak / wanted).min(1.0) } else { 1.0 };
        let allocation = Allocation { forces_n, met, cost: 0.0, prices: Prices::default() };
        Ok(Selection { drives, allocation, binding: Vec::new(), gap: *gap })
    }
}

/// The field at a target.
struct Data {
    gain: Vec<PerActuator>,
    energy: Vec<PerPair>,
    max_force_n: Vec<[f64; MAX_ACTUATORS]>,
    travel: Vec<PerPair>,
}

impl Data {
    /// With each entry's quiet pulse or its strong one.
    fn new(table: &PlanTable, judge: &Judge<'_>, strong: bool) -> Self {
        let (p, f) = (table.entries.len().min(MAX_ACTUATORS), table.frequencies_hz.len());
        let mut data = Self {
            gain: vec![[Complex64::ZERO; MAX_ACTUATORS]; f],
            energy: vec![[[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS]; f],
            max_force_n: vec![[0.0; MAX_ACTUATORS]; f],
            travel: vec![[[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS]; f],
        };
        let over_all = table.over_surface();
        for k in 0..f {
            let entries: Option<Vec<_>> = (0..p).map(|i| table.entry(i, k)).collect();
            let (Some(entries), Some(over_all)) = (entries, over_all.get(k)) else { continue };
            let near = judge.zone.products(&entries.iter().map(|entry| &entry.acceleration).collect::<Vec<_>>());
            let part = judge.zone.part;
            for (i, entry) in entries.iter().enumerate() {
                if let Some(shape) = judge.zone.targets.first() {
                    data.gain[k][i] = at_point(shape, &entry.acceleration);
                }
                data.max_force_n[k][i] = entry.pulse(strong).max_force_n;
                for j in 0..p {
                    data.energy[k][i][j] = (over_all[i][j] - near[i][j] * part) / (1.0 - part);
                    data.travel[k][j][i] = entry.travel[j];
                }
                // Harmonics of different actuators are not in step with each other's fundamentals; they add to each one's own.
                let floor = MOST_CONDITION * over_all[i][i].re;
                data.energy[k][i][i] += entry.pulse(strong).harmonics + floor;
            }
        }
        data
    }

    fn field<'a>(&'a self, table: &'a PlanTable) -> Field<'a> {
        let mut max_travel_m = [f64::INFINITY; MAX_ACTUATORS];
        max_travel_m
            .iter_mut()
            .zip(&table.electrodes)
            .for_each(|(most, electrodes)| *most = electrodes.most_travel_m());
        Field {
            frequencies_hz: &table.frequencies_hz,
            actuators: table.entries.len().min(MAX_ACTUATORS),
            gain: &self.gain,
            energy: &self.energy,
            max_force_n: &self.max_force_n,
            travel: &self.travel,
            max_travel_m,
        }
    }
}
