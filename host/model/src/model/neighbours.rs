//! Attachments, and which of them are very near to each other.
//!
//! Two point forces a distance d apart have functions that differ by d: next to their own sizes K has the square of that, and
//! what two rigid points so near do to a plate, which is to turn it with a compliance of d^2 log(1/d) / (8 pi D), drowns in
//! rounding and in the error of integration. (There is a limit only for d -> 0 of the logarithm: a plate's slope at a point
//! is not bounded by its energy.) So of such places the first has its deflection w and its function f, and each of the others
//! the difference quotients against its neighbour, (w' - w) r / d and (f' - f) r / d, with a length r of the mesh: a dipole's
//! function, of the size of one whatever d is.

use super::attached::{PointAttachment, all_point_attachments};
use super::mesh::MERGE;
use super::sections::choose_spectral_shift_rad2_per_s2;
use crate::scene::Scene;

/// Places nearer to each other than this part of a cell are neighbours. Where they are not, differences of functions lose up
/// to the square of this of the 1e-11 that integrals are right to.
pub(super) const NEAR: f64 = 0.02;

/// Two attachments that are not at one place, and are nearer to each other than that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CloseAttachmentPair {
    /// In m.
    pub distance_m: f64,
    /// With what they hold the slope between them over the square of their distance, in N/m: both in series.
    pub held: f64,
}

/// All pairs of attachments that are apart by more than nothing and by at most `most_m`.
pub(super) fn find_noncoincident_attachment_pairs_within(scene: &Scene, most_m: f64) -> Vec<CloseAttachmentPair> {
    let shift = choose_spectral_shift_rad2_per_s2(scene);
    let all: Vec<((f64, f64), f64)> =
        all_point_attachments(scene).map(|own| (own.at, own.stiffness_plus_shift_times_mass_n_per_m(shift))).collect();
    let mut out = Vec::new();
    for (k, (at, held)) in all.iter().enumerate() {
        for (other_at, other) in &all[k + 1..] {
            let distance_m = distance_between_points(*at, *other_at);
            if distance_m > 0.0 && distance_m <= most_m {
                out.push(CloseAttachmentPair {
                    distance_m,
                    held: held * other / (held + other).max(f64::MIN_POSITIVE),
                });
            }
        }
    }
    out
}

/// Something attached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AttachmentPlace {
    /// In m.
    pub at: (f64, f64),
    /// What resists a motion there in the matrix that is factored, in N/m: stiffness, and mass times the shift.
    pub held: f64,
}

/// All places of the scene's attachments, one for those that are within the merging distance of each other, the most firmly
/// held first. A neighbour held more firmly than what it is a neighbour of would cancel with it.
pub(super) fn merge_attachments_into_places_firmest_first(scene: &Scene) -> Vec<AttachmentPlace> {
    let shift = choose_spectral_shift_rad2_per_s2(scene);
    let place = |attached: PointAttachment| AttachmentPlace {
        at: attached.at,
        held: attached.stiffness_plus_shift_times_mass_n_per_m(shift),
    };
    let mut all: Vec<AttachmentPlace> = all_point_attachments(scene).map(place).collect();
    all.sort_by(|a, b| b.held.total_cmp(&a.held));
    let merged = MERGE * scene.surface.length_m.max(scene.surface.width_m);
    let mut out: Vec<AttachmentPlace> = Vec::new();
    for place in all {
        match out.iter_mut().find(|known| distance_between_points(known.at, place.at) <= merged) {
            Some(known) => known.held += place.held,
            None => out.push(place),
        }
    }
    out.sort_by(|a, b| b.held.total_cmp(&a.held));
    out
}

/// Distance of two points.
pub(super) fn distance_between_points(a: (f64, f64), b: (f64, f64)) -> f64 {
    (a.0 - b.0).hypot(a.1 - b.1)
}

/// Places in clusters, as they come.
#[derive(Clone, Debug)]
pub(super) struct PlaceClusters {
    /// The mesh's length that distances are measured in.
    unit: f64,
    /// Places, each with the first of its cluster.
    members: Vec<((f64, f64), usize)>,
}

/// What a place is near to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct NearestPlace {
    /// The first of the cluster, in the order in which places came.
    pub first: usize,
    /// The nearest before it.
    pub nearest: usize,
    /// Distance from that in m.
    pub distance_m: f64,
    /// The same over the mesh's length: d / r.
    pub ratio: f64,
}

impl PlaceClusters {
    /// None yet, on a mesh with cells of this width (m).
    pub(super) fn new(cell_m: f64) -> Self {
        Self { unit: cell_m, members: Vec::new() }
    }

    /// Adds a place; returns the nearest earlier one of its cluster, `None` if no place is near.
    pub(super) fn add_place_and_find_nearest_earlier_in_cluster(&mut self, at: (f64, f64)) -> Option<NearestPlace> {
        let of_cluster = |(_, (_, first)): &(usize, &((f64, f64), usize))| {
            distance_between_points(self.members[*first].0, at) <= NEAR * self.unit
        };
        let nearest = self.members.iter().enumerate().filter(of_cluster);
        let nearest = nearest
            .map(|(k, (other, first))| (k, *first, distance_between_points(*other, at)))
            .min_by(|a, b| a.2.total_cmp(&b.2))
            .map(|(nearest, first, distance_m)| NearestPlace {
                first,
                nearest,
                distance_m,
                ratio: distance_m / self.unit,
            });
        self.members.push((at, nearest.map_or(self.members.len(), |near| near.first)));
        nearest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_belongs_to_the_nearest_of_its_cluster() {
        let mut clusters = PlaceClusters::new(1.0);
        assert_eq!(clusters.add_place_and_find_nearest_earlier_in_cluster((0.0, 0.0)), None);
        assert_eq!(clusters.add_place_and_find_nearest_earlier_in_cluster((0.5, 0.0)), None, "far");
        let beside = clusters.add_place_and_find_nearest_earlier_in_cluster((0.01, 0.0)).unwrap();
        assert_eq!((beside.first, beside.nearest), (0, 0));
        let beside = clusters.add_place_and_find_nearest_earlier_in_cluster((0.01, 0.001)).unwrap();
        assert_eq!((beside.first, beside.nearest), (0, 2));
        assert!((beside.ratio - 0.001).abs() < 1e-15);
        // Within reach of a member, but not of the first: clusters do not grow along a chain.
        assert_eq!(clusters.add_place_and_find_nearest_earlier_in_cluster((0.025, 0.0)), None);
    }
}
