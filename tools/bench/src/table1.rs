//! (d): the thesis' Table 1, with matrices stated.

use crate::clock::measure_median_time_s;
use crate::environment::Environment;
use crate::error::Error;
use crate::process::run_and_parse_json;
use crate::table::{Table, format_factor, format_relative_error, format_time};
use era_model::transient::{
    HarmonicForce, InitialState, MotionQuantity, OutputRows, Propagator, SecondOrderSystem, TimeGrid, TransientError,
    as_published, solve_steady_state,
};
use nalgebra::{DMatrix, DVector};
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::PathBuf;

/// 0 to 5 s.
const GRID: TimeGrid = TimeGrid { step_s: 1e-3, count: 5001 };
/// Of the excitation.
const OMEGA_RAD_S: f64 = 60.0;
/// The thesis' numbers of unknowns, and its times in s: ode45 and its analytical solution.
const THESIS: [(usize, f64, f64); 6] =
    [(4, 0.141, 0.01), (8, 0.230, 0.02), (16, 0.906, 0.04), (20, 6.098, 0.06), (40, 36.32, 0.09), (60, 151.23, 0.12)];
/// What the systems are.
const MATRICES: &str = "The program computes the full response of n unknowns from rest at 5001 times (0 to 5 s, 1 ms). \
    Unit forces sin(60 t) act on the first and on the last unknown. The thesis does not state its matrices \
    (\"random\"). Here the system is a chain of masses between two walls, with n + 1 links of a spring and a dashpot. \
    Each mass is (1 + u) kg, each spring (500 + 500 u) N/m, and each dashpot (1 + 4 u) N s/m, where u is a new random \
    number from 0 to 1. The generator of random numbers replaces x by 6364136223846793005 x + 1442695040888963407 mod \
    2^64, and starts with x = n. The random number u is the upper 32 bits of x divided by 2^32 - 1. The first n random \
    numbers are for the masses. The next ones are for the links, first the spring and then the dashpot of each link. \
    In the rows \"proportional\", the damping is C = 0.8 M + 0.001 K, without the dashpots. Times are medians and \
    include the decomposition.";

/// A chain of masses between two walls.
fn make_mass_spring_chain(n: usize) -> SecondOrderSystem {
    let mut seed = n as u64;
    let mut next = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        #[expect(clippy::cast_precision_loss, reason = "32 bits")]
        let upper = (seed >> 32) as f64;
        upper / f64::from(u32::MAX)
    };
    let (mut c, mut k) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
    let m = DMatrix::from_diagonal(&DVector::from_fn(n, |_, _| 1.0 + next()));
    for link in 0..=n {
        let (spring, dashpot) = (500.0 + 500.0 * next(), 1.0 + 4.0 * next());
        for (matrix, value) in [(&mut k, spring), (&mut c, dashpot)] {
            if link > 0 {
                matrix[(link - 1, link - 1)] += value;
            }
            if link < n {
                matrix[(link, link)] += value;
            }
            if link > 0 && link < n {
                matrix[(link - 1, link)] -= value;
                matrix[(link, link - 1)] -= value;
            }
        }
    }
    SecondOrderSystem { m, c, k }
}

/// One system, and what it took.
struct SystemTimes {
    n: usize,
    damping: &'static str,
    two_s: f64,
    all_s: f64,
    steady_s: f64,
    again_s: f64,
    published_s: f64,
}

/// What `peers/table1.py` prints for a system.
#[derive(Clone, Copy, Debug, Deserialize)]
struct PeerTimesAndErrors {
    explicit_s: f64,
    explicit_error: f64,
    published_s: f64,
    published_error: f64,
}

/// Measures all systems, here and by the script.
///
/// # Errors
/// [`Error::Transient`], [`Error::File`], and those of the script.
pub fn build_table_of_motion_in_time(environment: &Environment) -> Result<Table, Error> {
    let columns = [
        "unknowns",
        "damping",
        "two outputs",
        "all outputs",
        "steady state",
        "another frequency",
        "as published",
        "NumPy as published",
        "its error",
        "SciPy RK45",
        "its error",
        "RK45 / all outputs",
        "thesis: ode45",
        "thesis: analytical",
    ];
    let mut table = Table::new("(d) Table 1: motion in time", &columns);
    table.above.push(String::from(MATRICES));
    let runs = if environment.quick { 11 } else { 101 };
    let (mut measured, mut systems) = (Vec::new(), Vec::new());
    for (n, ..) in THESIS {
        for damping in ["proportional", "dashpots"] {
            let mut system = make_mass_spring_chain(n);
            if damping == "proportional" {
                system.c = &system.m * 0.8 + &system.k * 1e-3;
            }
            let mut force_n = DVector::zeros(n);
            (force_n[0], force_n[n - 1]) = (1.0, 1.0);
            let drive = HarmonicForce { omega_rad_s: OMEGA_RAD_S, phase_rad: -std::f64::consts::FRAC_PI_2, force_n };
            measured.push(measure_solution_times(&system, &drive, damping, runs)?);
            let file = environment.scratch.join(format!("table1-{n}-{damping}.f64"));
            systems.push(write_answer_and_make_system_json(&system, &drive, file)?);
        }
    }
    let file = environment.scratch.join("table1.json");
    let document = json!({"step_s": GRID.step_s, "count": GRID.count, "omega_rad_s": OMEGA_RAD_S, "systems": systems});
    std::fs::write(&file, document.to_string()).map_err(Error::file_error(&file))?;
    let mut script = environment.make_script_command("table1.py");
    script.arg(&file).args(["--runs", if environment.quick { "1" } else { "3" }]);
    let peers: Vec<PeerTimesAndErrors> = run_and_parse_json(&mut script)?;
    for (own, peer) in measured.iter().zip(&peers) {
        let thesis = THESIS.iter().find(|row| row.0 == own.n);
        let published = |time: Option<f64>| time.map_or_else(String::new, format_time);
        table.add_row([
            own.n.to_string(),
            String::from(own.damping),
            format_time(own.two_s),
            format_time(own.all_s),
            format_time(own.steady_s),
            format_time(own.again_s),
            format_time(own.published_s),
            format_time(peer.published_s),
            format_relative_error(peer.published_error),
            format_time(peer.explicit_s),
            format_relative_error(peer.explicit_error),
            format_factor(peer.explicit_s / own.all_s),
            published(thesis.map(|row| row.1)),
            published(thesis.map(|row| row.2)),
        ]);
    }
    table.below.push(String::from(
        "These times do not agree with the times of the thesis. The number of steps of an explicit solver is about \
         the duration times the largest |lambda|, because longer steps are not stable. This number does not grow \
         exponentially with the number of unknowns. Each column \"its error\" is about the method \
         in the column to its left: it has the largest deviation of this method from the answer of this program, \
         relative to the largest displacement. RK45 has the default \
         tolerances of ode45 (1e-3 relative, 1e-6 absolute).",
    ));
    Ok(table)
}

fn compute_displacements_from_rest(
    system: &SecondOrderSystem,
    drive: &HarmonicForce,
    outputs: OutputRows<'_>,
) -> Result<DMatrix<f64>, TransientError> {
    let rest = InitialState::at_rest(system.count_unknowns());
    Propagator::new(system, GRID)?.compute_motion_under_harmonics_row_per_time(
        &rest,
        std::slice::from_ref(drive),
        outputs,
        MotionQuantity::Displacement,
    )
}

fn measure_solution_times(
    system: &SecondOrderSystem,
    drive: &HarmonicForce,
    damping: &'static str,
    runs: usize,
) -> Result<SystemTimes, TransientError> {
    let n = system.count_unknowns();
    // The thesis' Figure 11: fourth from the start, third from the end.
    let mut two = DMatrix::zeros(2, n);
    (two[(0, 3)], two[(1, n.max(6) - 3)]) = (1.0, 1.0);
    let ready = Propagator::new(system, GRID)?;
    let rest = InitialState::at_rest(n);
    Ok(SystemTimes {
        n,
        damping,
        two_s: measure_median_time_s(runs, || compute_displacements_from_rest(system, drive, OutputRows::Rows(&two)))?,
        all_s: measure_median_time_s(runs, || compute_displacements_from_rest(system, drive, OutputRows::All))?,
        steady_s: measure_median_time_s(10 * runs, || solve_steady_state(system, drive))?,
        again_s: measure_median_time_s(10 * runs, || ready.solve_steady_amplitudes(drive))?,
        published_s: measure_median_time_s(runs.div_ceil(20), || {
            as_published::compute_displacements_by_thesis_eigenvectors_row_per_time(
                system,
                &rest,
                std::slice::from_ref(drive),
                GRID,
            )
        })?,
    })
}

/// Writes the answer to a file, and returns the system and the name of this file as the script reads them.
fn write_answer_and_make_system_json(
    system: &SecondOrderSystem,
    drive: &HarmonicForce,
    file: PathBuf,
) -> Result<Value, Error> {
    // Row by row is time by time.
    let answer = compute_displacements_from_rest(system, drive, OutputRows::All)?;
    let raw: Vec<u8> = answer.transpose().iter().flat_map(|value| value.to_le_bytes()).collect();
    std::fs::write(&file, raw).map_err(Error::file_error(&file))?;
    let rows = |matrix: &DMatrix<f64>| -> Vec<Vec<f64>> {
        matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
    };
    Ok(json!({
        "m": rows(&system.m), "c": rows(&system.c), "k": rows(&system.k), "force": drive.force_n.as_slice(), "answer": file,
    }))
}
