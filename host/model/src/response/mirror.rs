//! Mirror symmetry: which centre lines a scene, a grid and a basis share.

use crate::model::ReducedModel;
use crate::scene::{Actuator, Scene, Side, Support};

/// Difference of places, relative to the panel's side.
const PLACE: f64 = 1e-12;
/// Points at which shapes are compared with their mirror images.
const SAMPLES: usize = 29;

/// What is known about one centre line.
#[derive(Clone, Debug, PartialEq)]
pub struct MirrorSymmetry {
    /// For each coordinate whether it is odd; `None` without symmetry.
    odd: Option<Vec<bool>>,
    /// Whether every actuator is on the centre line, where odd shapes are zero.
    is_driven_evenly: bool,
}

impl MirrorSymmetry {
    /// Whether scene, grid and shapes are symmetric about this centre line: half of the points are enough.
    pub fn are_scene_grid_and_shapes_symmetric_about_this_line(&self) -> bool {
        self.odd.is_some()
    }

    /// Whether a coordinate's shape is odd.
    pub fn is_coordinate_odd(&self, coordinate: usize) -> bool {
        self.odd.as_ref().is_some_and(|odd| odd[coordinate])
    }

    /// Whether no actuator moves what is odd. Odd coordinates are not coupled to even ones.
    pub fn is_symmetric_with_only_even_shapes_driven(&self) -> bool {
        self.are_scene_grid_and_shapes_symmetric_about_this_line() && self.is_driven_evenly
    }

    /// How many of so many lines are enough.
    pub fn count_lines_to_compute(&self, line_count: usize) -> usize {
        if self.are_scene_grid_and_shapes_symmetric_about_this_line() { line_count.div_ceil(2) } else { line_count }
    }
}

/// The symmetry about the centre in x and in y. There must be one of the scene, of the grid and of every shape: shapes of
/// one frequency may come mixed. `shape_tolerance` is the difference of a shape from its mirror image, relative to its largest value,
/// that counts as none.
pub fn find_mirror_symmetries(
    scene: &Scene,
    model: &ReducedModel,
    x_m: &[f64],
    y_m: &[f64],
    shape_tolerance: f64,
) -> [MirrorSymmetry; 2] {
    let sides = [scene.surface.length_m, scene.surface.width_m];
    [(0, x_m), (1, y_m)].map(|(axis, lines)| {
        let is_symmetric = lines.len() > 1
            && are_lines_symmetric_about_middle_of_side(lines, sides[axis])
            && is_scene_mirror_symmetric_along_axis(scene, axis);
        let middle = sides[axis] / 2.0;
        let mut places = scene.actuators.iter().map(|actuator| if axis == 0 { actuator.x_m } else { actuator.y_m });
        MirrorSymmetry {
            odd: if is_symmetric {
                flag_odd_shapes_unless_any_mixed(model, sides, axis, shape_tolerance)
            } else {
                None
            },
            is_driven_evenly: places.all(|at| (at - middle).abs() <= PLACE * sides[axis]),
        }
    })
}

/// Whether lines are their own mirror image about the middle of a side.
fn are_lines_symmetric_about_middle_of_side(lines: &[f64], side: f64) -> bool {
    lines.iter().zip(lines.iter().rev()).all(|(low, high)| (low + high - side).abs() <= PLACE * side)
}

/// Whether everything attached has an equal at the mirrored place.
fn is_scene_mirror_symmetric_along_axis(scene: &Scene, axis: usize) -> bool {
    let side = [scene.surface.length_m, scene.surface.width_m][axis];
    let is_image = |a: (f64, f64), b: (f64, f64)| {
        let image = if axis == 0 { (side - a.0, a.1) } else { (a.0, side - a.1) };
        (image.0 - b.0).abs() <= PLACE * side && (image.1 - b.1).abs() <= PLACE * side
    };
    let edge_image = |side: Side| match (side, axis) {
        (Side::Left, 0) => Side::Right,
        (Side::Right, 0) => Side::Left,
        (Side::Top, 1) => Side::Bottom,
        (Side::Bottom, 1) => Side::Top,
        (other, _) => other,
    };
    // Everything but the place and the name.
    let support = |of: &Support| Support { x_m: 0.0, y_m: 0.0, ..*of };
    let actuator = |of: &Actuator| Actuator { x_m: 0.0, y_m: 0.0, id: String::new(), ..of.clone() };
    scene.layout().is_mirror_symmetric(axis)
        && has_each_item_own_image(&scene.edges, |a, b| a.kind == b.kind && edge_image(a.side) == b.side)
        && has_each_item_own_image(&scene.supports, |a, b| {
            is_image((a.x_m, a.y_m), (b.x_m, b.y_m)) && support(a) == support(b)
        })
        && has_each_item_own_image(&scene.masses, |a, b| {
            is_image((a.x_m, a.y_m), (b.x_m, b.y_m)) && a.mass_kg == b.mass_kg
        })
        && has_each_item_own_image(&scene.actuators, |a, b| {
            is_image((a.x_m, a.y_m), (b.x_m, b.y_m)) && actuator(a) == actuator(b)
        })
}

/// Whether each item has one of its own that is its image.
fn has_each_item_own_image<T>(items: &[T], is_image: impl Fn(&T, &T) -> bool) -> bool {
    let mut left: Vec<&T> = items.iter().collect();
    items.iter().all(|item| {
        let found = left.iter().position(|other| is_image(item, other));
        found.map(|at| left.swap_remove(at)).is_some()
    })
}

/// Whether each shape is odd; `None` if one is neither even nor odd.
fn flag_odd_shapes_unless_any_mixed(
    model: &ReducedModel,
    sides: [f64; 2],
    axis: usize,
    shape_tolerance: f64,
) -> Option<Vec<bool>> {
    let n = model.count_coordinates();
    let (mut even, mut odd, mut largest) = (vec![0.0_f64; n], vec![0.0_f64; n], vec![0.0_f64; n]);
    for sample in 0..SAMPLES {
        // Multiples of the golden ratio and of the root of two: no line of symmetry of their own.
        #[expect(clippy::cast_precision_loss, reason = "a few dozen")]
        let place = |irrational: f64| (irrational * (sample as f64 + 0.5)).fract();
        let at = [place(0.618_033_988_749_894_9) * sides[0], place(std::f64::consts::SQRT_2) * sides[1]];
        let mut mirrored = at;
        mirrored[axis] = sides[axis] - at[axis];
        let (here, there) =
            (model.shape_deflections_at(at[0], at[1]), model.shape_deflections_at(mirrored[0], mirrored[1]));
        for i in 0..n {
            even[i] = even[i].max((here[i] - there[i]).abs());
            odd[i] = odd[i].max((here[i] + there[i]).abs());
            largest[i] = largest[i].max(here[i].abs());
        }
    }
    (0..n)
        .map(|i| match (even[i] <= shape_tolerance * largest[i], odd[i] <= shape_tolerance * largest[i]) {
            (true, _) => Some(false),
            (false, true) => Some(true),
            (false, false) => None,
        })
        .collect()
}
