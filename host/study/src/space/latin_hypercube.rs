//! Latin hypercubes: samples that cover each dimension evenly.

use era_model::scene::random::RandomSequence;

/// Draws `count` points of the unit cube, each with `dimensions` coordinates from 0 to 1: of each dimension, every one of `count` equal parts has
/// exactly one point, at a random place within the part (McKay, Beckman and Conover 1979).
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "counts of designs")]
pub fn draw_latin_hypercube(dimensions: usize, count: usize, random: &mut RandomSequence) -> Vec<Vec<f64>> {
    let mut points = vec![Vec::with_capacity(dimensions); count];
    for _ in 0..dimensions {
        let mut order: Vec<usize> = (0..count).collect();
        // Fisher and Yates.
        for last in (1..count).rev() {
            let other = u32::try_from(last + 1).map_or(0, |below| random.next_below(below) as usize);
            order.swap(last, other);
        }
        for (point, part) in points.iter_mut().zip(order) {
            point.push((part as f64 + random.next_unit_number()) / count as f64);
        }
    }
    points
}
