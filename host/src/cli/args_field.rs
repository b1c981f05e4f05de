//! Arguments of `era field`.

use super::args::{CacheOptions, Crispness, PanelOptions, Unit};
use super::headings::{EFFECT, OUTPUT, REACH, TOUCH};
use super::values::{
    Point, parse_finite_number, parse_png_path, parse_tolerances_of_springs_modulus_thickness_and_places,
    parse_unitless_point,
};
use crate::effects::NamedEffect;
use crate::study::tolerances::Tolerances;
use clap::Args;
use std::path::PathBuf;

#[derive(Clone, Debug, Args)]
pub struct Field {
    #[command(flatten)]
    pub panel: PanelOptions,
    #[command(flatten)]
    pub keep: CacheOptions,
    /// The touched point
    #[arg(
        long, value_name = "X,Y", value_parser = parse_unitless_point, allow_hyphen_values = true,
        required_unless_present_any = ["effect", "reach", "schemes"], help_heading = TOUCH
    )]
    pub at: Option<Point>,
    /// Unit of --at
    #[arg(long, value_enum, default_value_t = Unit::Px, help_heading = TOUCH)]
    pub unit: Unit,
    /// Requested peak acceleration, in g
    #[arg(long, value_name = "A", allow_negative_numbers = true, help_heading = TOUCH)]
    pub intensity_g: Option<f64>,
    /// Instead of the field of one touch, compute two values for every point: the largest peak and the highest contrast
    /// (motion near the point, relative to the rest of the surface) that a touch at this point can have while every drive
    /// stays within its limits. Also compute the drive frequencies that give each of these values
    #[arg(long, conflicts_with_all = ["at", "intensity_g", "schemes"], help_heading = REACH)]
    pub reach: bool,
    /// Compare three drive schemes (one frequency in phase, one frequency with chosen phases, distinct frequencies)
    /// by the peak at the weakest place of the surface, instead of computing the field of one touch
    #[arg(long, conflicts_with_all = ["at", "intensity_g"], help_heading = REACH)]
    pub schemes: bool,
    /// Map how long a click takes to become quiet, instead of the field of one touch. The clicks are at the centres of 12 x 8 cells
    /// (12 cells on a bar); NAME must be `click`
    #[arg(long, value_name = "NAME", hide_possible_values = true, help_heading = EFFECT,
        conflicts_with_all = ["at", "reach", "schemes", "zone", "felt", "from", "to", "spread"])]
    pub effect: Option<NamedEffect>,
    #[command(flatten)]
    pub crispness: Crispness,
    /// For --reach and --schemes: use this rectangle, in mm, instead of the whole surface; on a bar, Y0 and Y1 are ignored
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = parse_zone_corners_mm_in_any_order, conflicts_with = "at", allow_hyphen_values = true,
        help_heading = REACH)]
    pub zone: Option<Corners>,
    /// For --schemes: show peaks in dB above the threshold of feeling, instead of in g. This threshold depends on the
    /// frequency
    #[arg(long, conflicts_with_all = ["at", "reach"], help_heading = REACH)]
    pub felt: bool,
    /// Lowest frequency in Hz, for --reach and --schemes [default: the lowest frequency of the planner]
    #[arg(long, value_name = "F", conflicts_with = "at", allow_negative_numbers = true, value_parser = parse_finite_number,
        help_heading = REACH)]
    pub from: Option<f64>,
    /// Highest frequency in Hz for --reach and --schemes [default: the highest frequency of the planner]
    #[arg(long, value_name = "F", conflicts_with = "at", allow_negative_numbers = true, value_parser = parse_finite_number,
        help_heading = REACH)]
    pub to: Option<f64>,
    /// For a touch: compute how much the peak at the target changes if the panel differs from the scene within the given tolerances, by default
    /// up to 20 % in spring stiffness, 10 % in Young's modulus, 5 % in thickness and 1 mm in positions; this takes some
    /// seconds
    #[arg(long, alias = "tolerances", value_name = "SPRINGS,MODULUS,THICKNESS,MM", num_args = 0..=1, require_equals = true,
        default_missing_value = "0.2,0.1,0.05,1", value_parser = parse_tolerances_of_springs_modulus_thickness_and_places, conflicts_with_all = ["reach", "schemes"],
        help_heading = TOUCH)]
    pub spread: Option<Tolerances>,
    /// Write a picture to this PNG file
    #[arg(long, value_name = "FILE.png", value_parser = parse_png_path, help_heading = OUTPUT)]
    pub png: Option<PathBuf>,
    /// Write the values as CSV, with one line x_mm,y_mm,... per point; `-` is standard output (the default with --at
    /// and without --png)
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    pub csv: Option<PathBuf>,
    /// Print JSON
    #[arg(long, help_heading = OUTPUT)]
    pub json: bool,
}

/// Opposite corners of a rectangle as written on the command line, in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corners {
    pub x: [f64; 2],
    pub y: [f64; 2],
}

pub(super) fn parse_zone_corners_mm_in_any_order(text: &str) -> Result<Corners, String> {
    let numbers = text.split(',').map(parse_finite_number).collect::<Result<Vec<_>, _>>()?;
    match numbers.as_slice() {
        [x0, y0, x1, y1] => Ok(Corners { x: [x0.min(*x1), x0.max(*x1)], y: [y0.min(*y1), y0.max(*y1)] }),
        _ => Err(format!("{text:?} is not of the form X0,Y0,X1,Y1")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_come_in_any_order() {
        let corners = Corners { x: [10.0, 30.0], y: [5.0, 20.0] };
        assert_eq!(parse_zone_corners_mm_in_any_order("30,5,10,20"), Ok(corners));
        assert!(
            parse_zone_corners_mm_in_any_order("30,5,10").is_err()
                && parse_zone_corners_mm_in_any_order("1,2,3,x").is_err()
        );
    }

    #[test]
    fn pictures_are_png() {
        assert!(parse_png_path("a/map.PNG").is_ok());
        assert!(parse_png_path("map.jpg").is_err() && parse_png_path("png").is_err());
    }
}
