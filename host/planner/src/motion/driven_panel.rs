//! Drives as forces on the panel: voltages and pulse widths, the steady motion that they make in closing gaps, and which limit it breaks.

use crate::chosen_drive::Chosen;
use crate::physics::limits::Limit;
use crate::physics::softening::{Excitation, Line, MAX_LINES, Motion, NotSafe, Transducer, settle};
use crate::scene::MAX_ACTUATORS;
use crate::table::{HARMONICS, PlanTable, harmonics_m_per_n};
use era_shared::supply::rail_index_of_channel;
use num_complex::Complex64;

/// Simulated travel over the averaged motion's, at most: 1.002 was seen on random panels.
pub(crate) const LEFT_OUT: f64 = 1.01;
/// Voltage and pulse width of one drive.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Applied {
    /// Of the electrodes, which is the rail's, in V; 0 at rest.
    pub voltage_v: f64,
    /// Part of its half period for which an electrode is on.
    pub pulse_width: f64,
}

/// What was found.
#[derive(Clone, Copy, Debug)]
pub struct Settled {
    /// Voltages and pulse widths.
    pub applied: [Applied; MAX_ACTUATORS],
    /// The fundamentals' steady motion.
    pub motion: Motion,
    /// Frequencies of its lines.
    pub(crate) frequency_of_line: [usize; MAX_LINES],
    /// Number of lines.
    pub(crate) lines: usize,
    /// By which all forces were scaled.
    pub scale: f64,
    /// What made that necessary.
    pub limited: Option<(usize, Limit)>,
    /// Whether a quiet zone did.
    pub is_quieted: bool,
}

/// What actuators do to the panel.
pub(crate) struct DrivenPanel {
    transducers: [Transducer; MAX_ACTUATORS],
    excitations: [Excitation; MAX_ACTUATORS],
    actuators: usize,
    /// The fundamentals'.
    pub lines: Vec<Line>,
    /// Of each line the first drive at its frequency.
    pub leaders: Vec<usize>,
}

impl DrivenPanel {
    /// Its steady motion.
    pub(crate) fn settled(&self) -> Result<Motion, NotSafe> {
        settle(self.transducers(), self.excitations(), &self.lines)
    }

    pub(crate) fn transducers(&self) -> &[Transducer] {
        &self.transducers[..self.actuators]
    }

    pub(crate) fn excitations(&self) -> &[Excitation] {
        &self.excitations[..self.actuators]
    }
}

/// Travel in m that the first few of [`HARMONICS`] add at most, in gaps at rest, for forces times `scale`.
pub(crate) fn harmonics_m(
    drives: &[Chosen],
    applied: &[Applied; MAX_ACTUATORS],
    scale: f64,
    numbers: &[f64],
) -> [f64; MAX_ACTUATORS] {
    let mut sums = [0.0; MAX_ACTUATORS];
    for (j, (drive, applied)) in drives.iter().zip(applied).enumerate() {
        let Some(entry) = drive.row.get(j) else { continue };
        let own = harmonics_m_per_n(entry, applied.pulse_width, numbers.len());
        sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own * drive.force_n * scale);
    }
    sums
}

/// The first limit that masses break which go as far as `travel_m` and as harmonics take them beyond that.
pub(crate) fn check_limits(
    table: &PlanTable,
    drives: &[Chosen],
    settled: &Settled,
    travel_m: &[f64; MAX_ACTUATORS],
) -> Result<(), (usize, Limit)> {
    let applied = &settled.applied;
    let harmonics = harmonics_m(drives, applied, settled.scale, &HARMONICS);
    for (i, electrodes) in table.electrodes.iter().enumerate().take(drives.len().min(MAX_ACTUATORS)) {
        let rail_v = applied.iter().enumerate().filter(|(j, _)| rail_index_of_channel(*j) == rail_index_of_channel(i));
        let rail_v = rail_v.map(|(_, applied)| applied.voltage_v).fold(0.0, f64::max);
        // To the last digits the voltage is the limit's own.
        let rail_v = rail_v * (1.0 - 1e-12);
        if let Some(limit) = electrodes.violated(LEFT_OUT * travel_m[i] + harmonics[i], rail_v) {
            return Err((i, limit));
        }
    }
    Ok(())
}

/// Which actuator an error is about: of a resonance that the softening makes unstable, the one that loses most of what holds
/// it.
pub(crate) fn locate_failure(table: &PlanTable, error: NotSafe, applied: &[Applied; MAX_ACTUATORS]) -> (usize, Limit) {
    let lost = |i: &usize| {
        let own = table.static_receptance[*i][*i];
        table.electrodes.get(*i).map_or(0.0, |electrodes| own * electrodes.softening(applied[*i].voltage_v, 0.0))
    };
    let actuator = match error {
        NotSafe::Travel { actuator } => Some(actuator),
        NotSafe::Unstable | NotSafe::Shape { .. } => {
            (0..table.electrodes.len().min(MAX_ACTUATORS)).max_by(|a, b| lost(a).total_cmp(&lost(b)))
        }
    };
    (actuator.unwrap_or(0), Limit::Travel)
}

/// What the actuators do to the panel under these voltages. Equal frequencies are one line.
pub(crate) fn build_driven_panel(
    table: &PlanTable,
    drives: &[Chosen],
    applied: [Applied; MAX_ACTUATORS],
) -> DrivenPanel {
    let p = drives.len().min(MAX_ACTUATORS);
    let mut frequency = [0; MAX_ACTUATORS];
    let mut leaders: Vec<usize> = Vec::with_capacity(p);
    for (i, drive) in drives.iter().enumerate().take(p) {
        let same = leaders.iter().position(|leader| drives[*leader].frequency_hz == drive.frequency_hz);
        frequency[i] = same.unwrap_or_else(|| {
            leaders.push(i);
            leaders.len() - 1
        });
    }
    let line = |(frequency, leader): (usize, &usize)| {
        let mut receptance = [[Complex64::ZERO; MAX_ACTUATORS]; MAX_ACTUATORS];
        for (column, entry) in drives[*leader].row.iter().enumerate().take(p) {
            for (row, travel) in receptance.iter_mut().zip(entry.travel) {
                row[column] = travel;
            }
        }
        Line { frequency, harmonic: 1, receptance }
    };
    let lines: Vec<Line> = leaders.iter().enumerate().map(line).collect();
    let mut transducers = [Transducer::fixed(0.0); MAX_ACTUATORS];
    let mut excitations =
        [Excitation { frequency: 0, voltage_v: 0.0, pulse_width: 0.5, phase_rad: 0.0 }; MAX_ACTUATORS];
    for i in 0..p {
        transducers[i] = table.transducers.get(i).copied().unwrap_or(Transducer::fixed(0.0));
        let Applied { voltage_v, pulse_width } = applied[i];
        excitations[i] = Excitation { frequency: frequency[i], voltage_v, pulse_width, phase_rad: drives[i].phase_rad };
    }
    DrivenPanel { transducers, excitations, actuators: p, lines, leaders }
}
