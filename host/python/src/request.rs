//! What a plan is asked for.

use crate::arguments::Place;
use crate::errors::{Raised, Value};
use crate::scene::on;
use era_model::scene::Scene;
use era_planner::table::Region;
use era_planner::{Quiet, Request, Target, Work};
use pyo3::prelude::*;
use serde::de::DeserializeOwned;

/// Another target: a place, and its peak in g.
#[derive(Clone, Copy, FromPyObject)]
pub enum Also {
    /// With a peak.
    Wanted(f64, f64, Option<f64>),
    /// Without.
    Place(f64, f64),
}

/// A quiet zone: a place, its radius in m, the most peak acceleration there in g.
#[derive(Clone, Copy, FromPyObject)]
pub struct Spared(f64, f64, f64, f64);

/// A rectangle: two opposite corners in m.
pub type Corners = (f64, f64, f64, f64);

/// Everything that a plan may be asked for.
pub struct Wishes {
    pub at_m: Place,
    pub intensity_g: Option<f64>,
    pub also: Vec<Also>,
    pub quiet: Vec<Spared>,
    pub objective: String,
    pub grouping: String,
    pub weigh: String,
    pub zone_m: Option<Corners>,
}

impl Wishes {
    /// As the planner takes it.
    pub fn request(self, scene: &Scene) -> Result<Request, Raised> {
        let (x_m, y_m) = on(scene, self.at_m)?;
        let mut request = Request::touch(&[Target { x_m, y_m, intensity_g: self.intensity_g }]);
        for (i, also) in self.also.into_iter().enumerate() {
            let (at, intensity_g) = match also {
                Also::Wanted(x_m, y_m, intensity_g) => ((x_m, y_m), intensity_g),
                Also::Place(x_m, y_m) => ((x_m, y_m), None),
            };
            let (x_m, y_m) = Place::Plane(at.0, at.1).on(scene, &format!("also[{i}]"))?;
            request.targets.push(Target { x_m, y_m, intensity_g });
        }
        for (i, Spared(x_m, y_m, radius_m, at_most_g)) in self.quiet.into_iter().enumerate() {
            let (x_m, y_m) = Place::Plane(x_m, y_m).on(scene, &format!("quiet[{i}]"))?;
            request.quiet.push(Quiet { x_m, y_m, radius_m, at_most_g });
        }
        request.objective = word("objective", &self.objective, "\"contrast\", \"reach\" or \"power\"")?;
        request.grouping = word("grouping", &self.grouping, "\"distinct\" or \"shared\"")?;
        request.weigh = word("weigh", &self.weigh, "\"equal\" or \"felt\"")?;
        request.zone = zone(scene, self.zone_m)?;
        // As `era plan` plans: thoroughly, where a touch has some milliseconds.
        request.work = Work::Study;
        Ok(request)
    }
}

fn word<T: DeserializeOwned>(field: &str, given: &str, allowed: &str) -> Result<T, Raised> {
    serde_json::from_value(given.into()).map_err(|_| Raised::argument(field, given, allowed))
}

/// A rectangle on the surface, its corners in any order.
pub fn zone(scene: &Scene, corners: Option<Corners>) -> Result<Option<Region>, Raised> {
    let Some((x0, y0, x1, y1)) = corners else { return Ok(None) };
    let sorted = |a: f64, b: f64| if b < a { [b, a] } else { [a, b] };
    let region = Region::on(scene, sorted(x0, x1), sorted(y0, y1));
    let allowed = || format!("within 0 to {} m by 0 to {} m", scene.surface.length_m, scene.surface.width_m);
    region.map(Some).map_err(|_| Raised::argument("zone_m", Value::Corners([x0, y0, x1, y1]), allowed()))
}
