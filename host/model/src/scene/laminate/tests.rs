//! What layers are together, against closed forms.

use super::*;

const GLASS: PlyElasticity = PlyElasticity { ex_pa: 70e9, ey_pa: 70e9, g_pa: 70e9 / 2.44, poisson_xy: 0.22 };
const BIRCH: PlyElasticity = PlyElasticity { ex_pa: 15.1e9, ey_pa: 0.8e9, g_pa: 0.73e9, poisson_xy: 0.43 };

fn ply(thickness_m: f64, elastic: PlyElasticity) -> Ply {
    Ply { thickness_m, elastic, density_kg_m3: 1000.0, loss_factor: 0.0, slips: false }
}

fn plate(plies: &[Ply]) -> PlateRigidities {
    Laminate::from_plies(SurfaceKind::Plate, plies).rigidities
}

#[track_caller]
fn same(a: PlateRigidities, b: PlateRigidities) {
    for (a, b) in [(a.d11, b.d11), (a.d12, b.d12), (a.d22, b.d22), (a.d66, b.d66)] {
        assert!((a - b).abs() <= 1e-14 * (a.abs() + b.abs()), "{a} {b}");
    }
}

/// E h^3 / (12 (1 - nu^2)) and G h^3 / 12, and for a bar E h^3 / 12 alone.
#[test]
fn one_layer_is_a_plate() {
    let cube = 1.3e-3_f64.powi(3) / 12.0;
    let d = 70e9 / (1.0 - 0.22 * 0.22) * cube;
    same(plate(&[ply(1.3e-3, GLASS)]), PlateRigidities { d11: d, d12: 0.22 * d, d22: d, d66: 70e9 / 2.44 * cube });
    assert!(plate(&[ply(1.3e-3, PlyElasticity::from_isotropic_moduli(70e9, 0.22))]).is_isotropic());
    assert!(!plate(&[ply(1.3e-3, BIRCH)]).is_isotropic());
    let bar = Laminate::from_plies(SurfaceKind::Bar, &[ply(1.3e-3, BIRCH)]);
    assert!((bar.rigidities.d11 / (15.1e9 * cube) - 1.0).abs() < 1e-15);
}

#[test]
fn layers_of_one_material_are_one_layer() {
    for elastic in [GLASS, BIRCH, BIRCH.turn_by_90_degrees()] {
        let parts = [0.31e-3, 0.07e-3, 0.9e-3, 0.4e-3];
        let whole = ply(parts.iter().sum(), elastic);
        same(plate(&parts.map(|part| ply(part, elastic))), plate(&[whole]));
    }
}

/// A pair of two materials bends alike whichever is below, and as Timoshenko's two strips do: with E1 = n E2 and equal thicknesses h
/// E2 h^3 / 12 (n + 1 + 12 n / (n + 1) / ... ) is written out by the neutral plane.
#[test]
fn pairs_bend_about_their_neutral_plane() {
    let (a, b) = (
        ply(0.8e-3, PlyElasticity::from_isotropic_moduli(70e9, 0.3)),
        ply(1.7e-3, PlyElasticity::from_isotropic_moduli(3e9, 0.3)),
    );
    same(plate(&[a, b]), plate(&[b, a]));
    let (ea, eb, ha, hb) = (70e9, 3e9, 0.8e-3_f64, 1.7e-3_f64);
    let neutral = (ea * ha * ha / 2.0 + eb * hb * (ha + hb / 2.0)) / (ea * ha + eb * hb);
    let third = |e: f64, from: f64, to: f64| e * ((to - neutral).powi(3) - (from - neutral).powi(3)) / 3.0;
    let expected = third(ea, 0.0, ha) + third(eb, ha, ha + hb);
    let bar = Laminate::from_plies(SurfaceKind::Bar, &[a, b]).rigidities.d11;
    assert!((bar / expected - 1.0).abs() < 1e-13, "{bar} {expected}");
    // With one Poisson's ratio a plate has the same, over 1 - nu^2.
    assert!((plate(&[a, b]).d11 * (1.0 - 0.09) / expected - 1.0).abs() < 1e-13);
}

#[test]
fn halves_that_slip_have_a_quarter() {
    for elastic in [GLASS, BIRCH] {
        let (whole, half) = (ply(2.0e-3, elastic), ply(1.0e-3, elastic));
        let quarter = |d: f64| 0.25 * d;
        let PlateRigidities { d11, d12, d22, d66 } = plate(&[whole]);
        let expected = PlateRigidities { d11: quarter(d11), d12: quarter(d12), d22: quarter(d22), d66: quarter(d66) };
        same(plate(&[half, Ply { slips: true, ..half }]), expected);
    }
}

#[test]
fn turned_layers_exchange_the_axes() {
    let layers = [ply(0.5e-3, BIRCH), ply(1.1e-3, BIRCH.turn_by_90_degrees()), ply(0.3e-3, GLASS)];
    let turned = layers.map(|ply| Ply { elastic: ply.elastic.turn_by_90_degrees(), ..ply });
    let (as_it_is, turned) = (plate(&layers), plate(&turned));
    same(turned, PlateRigidities { d11: as_it_is.d22, d22: as_it_is.d11, ..as_it_is });
    // Crossed layers of one thickness stretch alike along both axes and bend differently; twice crossed they are symmetrical.
    assert!(as_it_is.d11 > as_it_is.d12 && as_it_is.d66 > 0.0);
}

/// Reduced, an unsymmetrical stack is softer than about its middle; its stiffness is the least over all planes for one Poisson's ratio.
#[test]
fn uniform_materials_of_isotropic_layers_are_exact() {
    let layers = [
        ply(0.7e-3, PlyElasticity::from_isotropic_moduli(70e9, 0.22)),
        ply(0.4e-3, PlyElasticity::from_isotropic_moduli(3e9, 0.4)),
    ];
    let laminate = Laminate::from_plies(SurfaceKind::Plate, &layers);
    assert!(laminate.rigidities.is_isotropic());
    let uniform = laminate.to_uniform_material(SurfaceKind::Plate);
    let again = plate(&[ply(
        laminate.thickness_m,
        PlyElasticity::from_isotropic_moduli(uniform.youngs_modulus_pa, uniform.poisson_ratio),
    )]);
    same(again, laminate.rigidities);
}

/// Damping goes with energy: a lossy core in the middle has (1/3)^3 of it; a slipping half has half.
#[test]
fn losses_go_with_energy() {
    let lossy = Ply { loss_factor: 0.3, ..ply(1e-3, BIRCH) };
    let loss = |plies: &[Ply]| Laminate::from_plies(SurfaceKind::Plate, plies).loss_factor;
    let core = loss(&[ply(1e-3, BIRCH), lossy, ply(1e-3, BIRCH)]);
    assert!((core / (0.3 / 27.0) - 1.0).abs() < 1e-13, "{core}");
    assert!((loss(&[lossy, lossy]) / 0.3 - 1.0).abs() < 1e-14);
    assert!((loss(&[ply(1e-3, BIRCH), Ply { slips: true, ..lossy }]) / 0.15 - 1.0).abs() < 1e-13);
}

/// One layer's shear is 6/5 over G h, its inertia h^2 / 12; a soft core between stiff faces shears by what it has of the lever.
#[test]
fn shear_of_a_layer_and_of_a_sandwich() {
    let laminate = Laminate::from_plies(
        SurfaceKind::Bar,
        &[
            ply(2e-3, PlyElasticity::from_isotropic_moduli(70e9, 0.25)),
            ply(1e-3, PlyElasticity::from_isotropic_moduli(70e9, 0.25)),
        ],
    );
    let h = 3e-3_f64;
    assert!((laminate.shear_m2 / (0.1 * 2.5 * h * h) - 1.0).abs() < 1e-12);
    assert!((laminate.turning_m2 / (h * h / 12.0) - 1.0).abs() < 1e-12);
    let (face, core, soft) = (1e-3, 8e-3, PlyElasticity::from_isotropic_moduli(1e6, 0.25));
    let faces = ply(face, PlyElasticity::from_isotropic_moduli(70e9, 0.25));
    let sandwich = Laminate::from_plies(SurfaceKind::Bar, &[faces, ply(core, soft), faces]);
    // G d^2 / c for the core, d between the middles of the faces.
    let stiffness = soft.g_pa * (core + face).powi(2) / core;
    assert!((sandwich.shear_m2 * stiffness / sandwich.rigidities.d11 - 1.0).abs() < 0.05);
}
