//! The published cases.

#![expect(clippy::approx_constant, reason = "published numbers have the digits that were printed")]

use super::closed;
use super::ritz::{Plate, Side};
use super::scenes::SceneText;
use super::table::Case;
use Side::{Clamped as C, Free as F, Pinned as S};

/// Relative rounding of a closed equation's root.
const CLOSED: f64 = 1e-9;

/// Sides as in the scene and the reference: left, right, top, bottom.
fn held(mut scene: SceneText, sides: [Side; 4]) -> SceneText {
    for (name, side) in ["left", "right", "top", "bottom"].into_iter().zip(sides) {
        scene = match side {
            Side::Free => scene,
            Side::Pinned => scene.edge(name, "pinned"),
            Side::Clamped => scene.edge(name, "clamped"),
        };
    }
    scene
}

/// What is left of a Ritz value after the last step: errors fall at least with the fifth power of the number of
/// polynomials, of which the last step of 2 in 16 shows (16/14)^5 - 1 = 0.95 of what is left; three times that. And rounding, 16 n^8
/// eps of lambda^2.
fn ritz(plate: Plate, count: usize, unit: f64) -> Vec<(f64, f64)> {
    let rounding = |lambda: f64| 16.0 * 16_f64.powi(8) * f64::EPSILON / (lambda * lambda);
    plate.frequencies(count).into_iter().map(|(value, step)| (value * unit, 3.0 * step + rounding(value))).collect()
}

fn exactly(values: Vec<f64>) -> Vec<(f64, f64)> {
    values.into_iter().map(|value| (value, CLOSED)).collect()
}

/// The plate of NAFEMS FV12, FV13 and FV16.
fn nafems() -> SceneText {
    let mut plate = SceneText::plate(10.0, 10.0, 0.3).thickness(0.05);
    (plate.young, plate.density) = (200e9, 8000.0);
    plate
}

fn square(sides: [Side; 4]) -> Plate {
    Plate { sides, poisson: 0.3, aspect: 1.0, corners: false }
}

/// NAFEMS, Selected Benchmarks for Natural Frequency Analysis (R0015), in Hz.
pub fn nafems_cases() -> Vec<Case> {
    let unit = nafems().plate_hz(1.0);
    let pinned: Vec<f64> = closed::navier(8).into_iter().map(|lambda| lambda * unit).collect();
    vec![
        Case {
            title: "FV12, free square plate, Hz",
            published: &[1.622, 2.360, 2.922, 4.233, 4.233, 7.416],
            reference: ritz(square([F; 4]), 6, unit),
            hz: 1.0,
            rigid: 3,
            publication: 1.05e-2,
            scene: nafems().scene(),
        },
        Case {
            title: "FV13, square plate pinned all round, Hz",
            published: &[2.377, 5.942, 5.942, 9.507, 11.884, 11.884, 15.449, 15.449],
            reference: exactly(pinned),
            hz: 1.0,
            rigid: 0,
            publication: 2.2e-4,
            scene: held(nafems(), [S; 4]).scene(),
        },
        Case {
            title: "FV16, cantilevered square plate, Hz",
            published: &[0.421, 1.029, 2.582, 3.306, 3.753, 6.555],
            reference: ritz(square([C, F, F, F]), 6, unit),
            hz: 1.0,
            rigid: 0,
            publication: 1e-2,
            scene: held(nafems(), [C, F, F, F]).scene(),
        },
    ]
}

/// Leissa, J. Sound Vib. 31 (1973) 257, tables of the square (and one 5:2) plate, nu = 0.3, as lambda = omega a^2 sqrt(rho h / D).
pub fn leissa_cases() -> Vec<Case> {
    let case = |title, published: &'static [f64], sides, rigid, publication| {
        let scene = SceneText::plate(0.3, 0.3, 0.3);
        let hz = scene.plate_hz(1.0);
        let reference = if sides == [S; 4] {
            exactly(closed::navier(published.len()))
        } else {
            ritz(square(sides), published.len(), 1.0)
        };
        Case { title, published, reference, hz, rigid, publication, scene: held(scene, sides).scene() }
    };
    // Two opposite sides pinned: his equations are exact, so only his rounding and what Ritz is short of here is left.
    let exact = 1e-5;
    let mut cases = vec![
        case("SSSS, lambda", &[19.7392, 49.3480, 49.3480, 78.9568, 98.6960, 98.6960], [S; 4], 0, exact),
        case("SCSC, lambda", &[28.9509, 54.7431, 69.3270, 94.5853, 102.2162, 129.0955], [S, S, C, C], 0, exact),
        case("SCSS, lambda", &[23.6463, 51.6743, 58.6464, 86.1345, 100.2698, 113.2281], [S, S, C, S], 0, exact),
        case("SFSF, lambda", &[9.6314, 16.1348, 36.7256, 38.9450, 46.7381, 70.7401], [S, S, F, F], 0, exact),
        case("CCCC, lambda", &[35.992, 73.413, 73.413, 108.27, 131.64, 132.24], [C; 4], 0, 6e-4),
        case("CFFF, lambda", &[3.4917, 8.5246, 21.429, 27.331, 31.111, 54.443], [C, F, F, F], 0, 7e-3),
        case("FFFF, lambda", &[13.489, 19.789, 24.432, 35.024, 35.024, 61.526], [F; 4], 3, 1e-2),
    ];
    let long = SceneText::plate(0.5, 0.2, 0.3);
    cases.push(Case {
        title: "FFFF with a/b = 2.5, lambda",
        published: &[21.643, 33.050, 60.137, 71.484],
        reference: ritz(Plate { aspect: 2.5, ..square([F; 4]) }, 4, 1.0),
        hz: long.plate_hz(1.0),
        rigid: 3,
        publication: 1e-2,
        scene: long.scene(),
    });
    cases
}

/// Square plate on four corner points, nu = 0.3. Supports of 1e16 N/m: 1e10 times the plate's own stiffness.
pub fn corner_case() -> Case {
    let plate = SceneText::plate(0.3, 0.3, 0.3);
    Case {
        title: "square plate on four corner points, lambda",
        published: &[7.1109, 15.7702, 15.7702, 19.5961, 38.4315, 44.3696],
        reference: ritz(Plate { corners: true, ..square([F; 4]) }, 6, 1.0),
        hz: plate.plate_hz(1.0),
        rigid: 0,
        publication: 1e-5,
        scene: plate.corner_springs(1e16).scene(),
    }
}

/// SDLL04 (VPCS, 1989): A = 1e-2 m^2, I = 3.9e-6 m^4, L = 10 m, E = 200 GPa, rho = 7800 kg/m^3, so that E I / (rho A) = 1e4 and f_i = i^2
/// pi/2; on the bar's scene as a rectangle of equal area and moment. The sprung mass is an inertial ERA: lambda times the beam's 780
/// kg, on a spring of lambda 780 pi^4 N/m.
pub fn tuned_mass_cases() -> Vec<Case> {
    let beam = |ratio: f64| {
        let (area, moment) = (1e-2_f64, 3.9e-6_f64);
        let thickness = (12.0 * moment / area).sqrt();
        let mut bar = SceneText::bar(10.0).thickness(thickness);
        (bar.width_m, bar.young, bar.density) = (area / thickness, 200e9, 7800.0);
        let bar = bar.edge("left", "pinned").edge("right", "pinned");
        let (mass, stiffness) = (780.0 * ratio, 780.0 * std::f64::consts::PI.powi(4) * ratio);
        if ratio > 0.0 { bar.era("inertial", 0.25, 0.5, mass, stiffness, 0.0).scene() } else { bar.scene() }
    };
    let case = |title, published: &'static [f64], ratio, reference, publication| Case {
        title,
        published,
        reference: exactly(reference),
        hz: 1.0,
        rigid: 0,
        publication,
        scene: beam(ratio),
    };
    let half_pi = std::f64::consts::FRAC_PI_2;
    vec![
        case("SDLL04, no mass, Hz", &[1.5708, 6.2832], 0.0, vec![half_pi, 4.0 * half_pi], 1e-5),
        // The sheet's approximations, (1 -+ 0.5 sqrt(lambda)) f1 and f2; the next term is of order lambda / 8.
        case("SDLL04, lambda = 0.001, Hz", &[1.5460, 1.5956, 6.2832], 1e-3, closed::tuned_mass(1e-3, 3), 1.25e-4),
        case("SDLL04, lambda = 0.01, Hz", &[1.4923, 1.6493, 6.2832], 1e-2, closed::tuned_mass(1e-2, 3), 1.25e-3),
    ]
}

/// (k L) of beams as in every handbook (Blevins, table 8-1), squared.
pub fn beam_cases() -> Vec<Case> {
    let case = |title, published: &'static [f64], sides: [&str; 2], rigid, reference: Vec<f64>| {
        let mut bar = SceneText::bar(0.25);
        let hz = bar.bar_hz(1.0);
        for (side, kind) in ["left", "right"].into_iter().zip(sides) {
            if !kind.is_empty() {
                bar = bar.edge(side, kind);
            }
        }
        let reference = exactly(reference.into_iter().map(|kl| kl * kl).collect());
        Case { title, published, reference, hz, rigid, publication: 1e-5, scene: bar.scene() }
    };
    vec![
        case("free beam, (k L)^2", &[22.3733, 61.6728, 120.9034], ["", ""], 2, closed::free_beam(3)),
        case("cantilever beam, (k L)^2", &[3.51602, 22.0345, 61.6972], ["clamped", ""], 0, closed::cantilever(3)),
        case(
            "clamped-pinned beam, (k L)^2",
            &[15.4182, 49.9649, 104.2477],
            ["clamped", "pinned"],
            0,
            closed::propped(3),
        ),
    ]
}

/// Jones, Mechanics of Composite Materials, 2nd edition, section 5.5.1: a specially orthotropic square plate pinned all round, D11 = 10 D22 and
/// D12 + 2 D66 = D22; in pi^2 / b^2 sqrt(D22 / rho h). Here three plies of one material with axes, 25 times as stiff along the fibres, the middle one turned by a
/// right angle: with x the cube of its part of the thickness D11 is to D22 as 25 - 24 x to 1 + 24 x, which is 10 for x = 15 / 264.
pub fn laminate_case() -> Case {
    let (side_m, thickness_m, density) = (0.4, 2e-3, 1600.0);
    let (e1, e2, nu12) = (175e9, 7e9, 0.25);
    let x: f64 = 15.0 / 264.0;
    let q22 = e2 / (1.0 - nu12 * nu12 * e2 / e1);
    let g = 0.5 * q22 * (1.0 + 24.0 * x - nu12);
    let d22: f64 = q22 * (1.0 + 24.0 * x) * f64::powi(thickness_m, 3) / 12.0;
    let (middle, outer) = (x.cbrt() * thickness_m * 1e3, 0.5 * (1.0 - x.cbrt()) * thickness_m * 1e3);
    let ply = |thickness_mm: f64, angle: u32| {
        format!(
            "[[layer]]\nthickness_mm = {thickness_mm:?}\nangle_deg = {angle}\n[layer.material]\nex_pa = {e1:?}\ney_pa = {e2:?}\ng_pa = {g:?}\n\
             poisson_ratio = {nu12}\ndensity_kg_m3 = {density:?}\n"
        )
    };
    let edges =
        ["left", "right", "top", "bottom"].map(|side| format!("[[edge]]\nside = \"{side}\"\nkind = \"pinned\"\n"));
    let text = format!(
        "version = 1\nname = \"three plies\"\n[surface]\nkind = \"plate\"\nlength_mm = 400.0\nwidth_mm = 400.0\n{}{}{}{}",
        ply(outer, 0),
        ply(middle, 90),
        ply(outer, 0),
        edges.concat()
    );
    Case {
        title: "three plies, square plate pinned all round, in pi^2 / b^2 sqrt(D22 / rho h)",
        published: &[3.605_55, 5.830_95, 10.440_31, 13.0],
        reference: exactly(closed::orthotropic(10.0, 1.0, 4)),
        hz: (std::f64::consts::PI / side_m).powi(2) * (d22 / (density * thickness_m)).sqrt() / std::f64::consts::TAU,
        rigid: 0,
        publication: 1e-6,
        scene: era_model::scene::Scene::parse("plies", &text).unwrap(),
    }
}
