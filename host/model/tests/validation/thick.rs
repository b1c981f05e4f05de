//! Where thin-plate theory ends: NAFEMS FV52 (a pinned plate of 10 x 10 x 1 m) beside Mindlin's plate.
//!
//! A scene's surface is at most 100 mm thick, so the plate is modelled at a tenth of its size; frequencies are then ten times as high.

use super::closed;
use super::scenes::SceneText;
use super::table::{TOLERANCE, digits_of, percent};
use era_model::model::{Accuracy, compute_modes_with_error_bounds};

/// Bending modes of FV52 in Hz: the target of its sheet, a solid of 20-node bricks.
const SOLID_HZ: [f64; 4] = [44.762, 110.52, 110.52, 169.08];

#[test]
fn a_plate_of_a_tenth_of_its_side() {
    let mut plate = SceneText::plate(1.0, 1.0, 0.3).thickness(0.1).all_edges("pinned");
    (plate.young, plate.density) = (200e9, 8000.0);
    let highest = plate.plate_hz(closed::navier(4)[3]);
    let found =
        compute_modes_with_error_bounds(&plate.scene(), Accuracy::from_tolerance(TOLERANCE).unwrap(), 1.01 * highest)
            .unwrap();
    let mut lines = vec![
        "FV52, pinned plate with h/a = 0.1, Hz:".to_owned(),
        "| mode | published | Mindlin | era | era to published | era to Mindlin |".to_owned(),
        "|---|---|---|---|---|---|".to_owned(),
    ];
    for (k, (waves, published)) in
        [[1.0, 1.0], [1.0, 2.0], [2.0, 1.0], [2.0, 2.0]].into_iter().zip(SOLID_HZ).enumerate()
    {
        let value = found.answer[k].frequency_hz / 10.0;
        let thick = closed::mindlin(200e9, 0.3, 8000.0, 10.0, 1.0, waves);
        let (to_published, to_thick) = (value / published - 1.0, value / thick - 1.0);
        lines.push(format!(
            "| {} | {published} | {} | {} | {} | {} |",
            k + 1,
            digits_of(thick),
            digits_of(value),
            percent(to_published, 1),
            percent(to_thick, 1)
        ));
        // Thin-plate theory is what the program says it solves: exactly Navier's frequency, and too stiff here by as much as the
        // series of Mindlin's equation in (h k)^2 says to first order, with half as much for what the series leaves out.
        let thin = plate.plate_hz(std::f64::consts::PI.powi(2) * (waves[0] * waves[0] + waves[1] * waves[1])) / 10.0;
        assert!((value / thin - 1.0).abs() < 1e-6, "{value} Hz for {thin} Hz");
        let square = (std::f64::consts::PI / 10.0).powi(2) * (waves[0] * waves[0] + waves[1] * waves[1]);
        let shear_and_rotation = square / 24.0 * (1.0 + 2.0 / (5.0 / 6.0 * (1.0 - 0.3)));
        assert!((0.5..1.0).contains(&(to_thick / shear_and_rotation)), "{to_thick} for {shear_and_rotation}");
    }
    super::on_the_page(&lines);
}
