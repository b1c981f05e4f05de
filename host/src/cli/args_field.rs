//! Arguments of `era field`.

use super::args::{Keep, Panel, Unit};
use super::values::{Point, parse_finite, parse_png, parse_point, parse_tolerances};
use crate::design::tolerances::Tolerances;
use clap::Args;
use std::path::PathBuf;

#[derive(Clone, Debug, Args)]
pub struct Field {
    #[command(flatten)]
    pub panel: Panel,
    #[command(flatten)]
    pub keep: Keep,
    /// The touched point
    #[arg(
        long, value_name = "X,Y", value_parser = parse_point, allow_hyphen_values = true,
        required_unless_present_any = ["reach", "schemes"]
    )]
    pub at: Option<Point>,
    /// Unit of --at
    #[arg(long, value_enum, default_value_t = Unit::Px)]
    pub unit: Unit,
    /// Peak acceleration wanted, in g
    #[arg(long, value_name = "A", allow_negative_numbers = true)]
    pub intensity_g: Option<f64>,
    /// Instead of a touch's field: for every point, the strongest possible peak, the contrast of the quietest drive, and the
    /// frequencies of both
    #[arg(long, conflicts_with_all = ["at", "intensity_g", "schemes"])]
    pub reach: bool,
    /// Instead of a touch's field: compare the lowest peak on the surface for one frequency, for phases, and for distinct
    /// frequencies
    #[arg(long, conflicts_with_all = ["at", "intensity_g"])]
    pub schemes: bool,
    /// For --reach and --schemes: a rectangle in mm instead of the whole surface; on a bar only x counts
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = parse_corners, conflicts_with = "at", allow_hyphen_values = true)]
    pub zone: Option<Corners>,
    /// For --schemes: use dB above the threshold of feeling at each frequency instead of g
    #[arg(long, conflicts_with_all = ["at", "reach"])]
    pub felt: bool,
    /// Lowest frequency for --reach and --schemes in Hz [default: all that the planner uses]
    #[arg(long, value_name = "F", conflicts_with = "at", allow_negative_numbers = true, value_parser = parse_finite)]
    pub from: Option<f64>,
    /// Highest frequency for --reach and --schemes in Hz [default: all that the planner uses]
    #[arg(long, value_name = "F", conflicts_with = "at", allow_negative_numbers = true, value_parser = parse_finite)]
    pub to: Option<f64>,
    /// For a touch: compute the effect of tolerances at the target, by default 20 % for springs, 10 % for Young's modulus, 5 % for
    /// thickness, 1 mm for places; takes some seconds
    #[arg(long, alias = "tolerances", value_name = "SPRINGS,MODULUS,THICKNESS,MM", num_args = 0..=1, require_equals = true,
        default_missing_value = "0.2,0.1,0.05,1", value_parser = parse_tolerances, conflicts_with_all = ["reach", "schemes"])]
    pub spread: Option<Tolerances>,
    /// Write a picture, of the type PNG
    #[arg(long, value_name = "FILE.png", value_parser = parse_png)]
    pub png: Option<PathBuf>,
    /// Write the values, a line x_mm,y_mm,... per point; `-` is standard output, which also gets a touch's field if neither
    /// --png nor --csv is given
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Opposite corners of a rectangle as written on the command line, in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corners {
    pub x: [f64; 2],
    pub y: [f64; 2],
}

pub(super) fn parse_corners(text: &str) -> Result<Corners, String> {
    let numbers = text.split(',').map(parse_finite).collect::<Result<Vec<_>, _>>()?;
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
        assert_eq!(parse_corners("30,5,10,20"), Ok(corners));
        assert!(parse_corners("30,5,10").is_err() && parse_corners("1,2,3,x").is_err());
    }

    #[test]
    fn pictures_are_png() {
        assert!(parse_png("a/map.PNG").is_ok());
        assert!(parse_png("map.jpg").is_err() && parse_png("png").is_err());
    }
}
