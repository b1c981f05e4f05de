//! What a plan is asked for.

use crate::arguments::{Also, Four, Place};
use crate::errors::{Raised, Value};
use era_model::scene::Scene;
use era_planner::table::Region;
use era_planner::{Quiet, Request, Target, Work};
use serde::de::DeserializeOwned;

/// Everything that a plan may be asked for.
pub struct Wishes {
    pub at_m: Place,
    pub intensity_g: Option<f64>,
    pub also: Vec<Also>,
    pub quiet: Vec<Four>,
    pub objective: String,
    pub grouping: String,
    pub weigh: String,
    pub zone_m: Option<Four>,
}

impl Wishes {
    /// As the planner takes it.
    pub fn request(self, scene: &Scene) -> Result<Request, Raised> {
        let (x_m, y_m) = self.at_m.on(scene, "at_m")?;
        let mut request = Request::touch(&[Target { x_m, y_m, intensity_g: self.intensity_g }]);
        for (i, also) in self.also.into_iter().enumerate() {
            let ((x_m, y_m), intensity_g) = also.on(scene, &format!("also[{i}]"))?;
            request.targets.push(Target { x_m, y_m, intensity_g });
        }
        for (i, spared) in self.quiet.into_iter().enumerate() {
            let [x_m, y_m, radius_m, at_most_g] = spared.around_place(scene, &format!("quiet[{i}]"))?;
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
pub fn zone(scene: &Scene, corners: Option<Four>) -> Result<Option<Region>, Raised> {
    let Some(corners) = corners else { return Ok(None) };
    let [x0, y0, x1, y1] = corners.numbers("zone_m")?;
    let sorted = |a: f64, b: f64| if b < a { [b, a] } else { [a, b] };
    let region = Region::on(scene, sorted(x0, x1), sorted(y0, y1));
    let allowed = || format!("within 0 to {} m by 0 to {} m", scene.surface.length_m, scene.surface.width_m);
    region.map(Some).map_err(|_| Raised::argument("zone_m", Value::Corners([x0, y0, x1, y1]), allowed()))
}
