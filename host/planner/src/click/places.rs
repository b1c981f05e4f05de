//! Places of a coarse grid over a surface.

use crate::scene::{Scene, SurfaceKind};

/// The middles of the cells of a grid over a surface.
#[derive(Clone, Debug)]
pub struct CellMiddles {
    /// Columns in m.
    pub x_m: Vec<f64>,
    /// Rows in m; a bar has one.
    pub y_m: Vec<f64>,
    /// Row by row, in m; `None` in cut-outs.
    pub places_m: Vec<Option<(f64, f64)>>,
}

impl CellMiddles {
    /// Of a grid with so many columns and rows.
    #[must_use]
    pub fn find_on_surface(scene: &Scene, columns: u32, rows: u32) -> Self {
        let rows = if scene.surface.kind == SurfaceKind::Bar { 1 } else { rows };
        let list_middles = |count: u32, length_m: f64| -> Vec<f64> {
            (0..count).map(|k| (f64::from(k) + 0.5) / f64::from(count) * length_m).collect()
        };
        let (x_m, y_m) = (list_middles(columns, scene.surface.length_m), list_middles(rows, scene.surface.width_m));
        let layout = scene.layout();
        let is_there = |(x_m, y_m): &(f64, f64)| layout.layer_at_unless_cut_out(*x_m, *y_m).is_some();
        let places = y_m.iter().flat_map(|y_m| x_m.iter().map(move |x_m| (*x_m, *y_m)));
        let places_m = places.map(|place| Some(place).filter(is_there)).collect();
        Self { x_m, y_m, places_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{EXAMPLE_BAR, EXAMPLE_PLATE};

    #[test]
    fn places_are_the_middles_of_cells_outside_cutouts() {
        let cutout = "\n[[cutout]]\nx_mm = 135.0\ny_mm = 10.0\nlength_mm = 10.0\nwidth_mm = 10.0\n";
        let plate = Scene::parse("plate", &format!("{EXAMPLE_PLATE}{cutout}")).unwrap();
        let grid = CellMiddles::find_on_surface(&plate, 12, 8);
        assert_eq!((grid.x_m.len(), grid.y_m.len(), grid.places_m.len()), (12, 8, 96));
        let count = grid.places_m.iter().flatten().count();
        // Cells of 25 mm: that at 137.5 mm, 12.5 mm has its middle in the cut-out.
        assert!(grid.places_m[5].is_none() && count == 95, "{count}");
        assert_eq!(grid.places_m[13], Some((grid.x_m[1], grid.y_m[1])));
        let bar = Scene::parse("bar", EXAMPLE_BAR).unwrap();
        let grid = CellMiddles::find_on_surface(&bar, 6, 4);
        assert_eq!(grid.places_m.len(), 6);
        assert_eq!(grid.y_m, [0.5 * bar.surface.width_m]);
    }
}
