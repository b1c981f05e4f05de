//! What a plan is asked for.

use crate::arguments::{FourNumbers, GivenPlace, GivenTarget};
use crate::errors::{ArgumentValue, Raised};
use era_model::scene::Scene;
use era_planner::table::Region;
use era_planner::{QuietZone, Request, SearchEffort, Target};
use serde::de::DeserializeOwned;

/// Everything that a plan may be asked for.
pub struct PlanArguments {
    pub at_m: GivenPlace,
    pub intensity_g: Option<f64>,
    pub also: Vec<GivenTarget>,
    pub quiet: Vec<FourNumbers>,
    pub objective: String,
    pub grouping: String,
    pub weigh: String,
    pub zone_m: Option<FourNumbers>,
}

impl PlanArguments {
    /// As the planner takes it.
    pub fn build_plan_request(self, scene: &Scene) -> Result<Request, Raised> {
        let (x_m, y_m) = self.at_m.check_place_on_surface_m(scene, "at_m")?;
        let mut request = Request::for_touch(&[Target { x_m, y_m, intensity_g: self.intensity_g }]);
        for (i, also) in self.also.into_iter().enumerate() {
            let ((x_m, y_m), intensity_g) = also.check_place_m_and_get_peak_g(scene, &format!("also[{i}]"))?;
            request.targets.push(Target { x_m, y_m, intensity_g });
        }
        for (i, spared) in self.quiet.into_iter().enumerate() {
            let [x_m, y_m, radius_m, at_most_g] =
                spared.four_numbers_checking_first_two_are_place_on_surface(scene, &format!("quiet[{i}]"))?;
            request.quiet.push(QuietZone { x_m, y_m, radius_m, at_most_g });
        }
        request.objective = parse_enum_word("objective", &self.objective, "\"contrast\", \"reach\" or \"power\"")?;
        request.grouping = parse_enum_word("grouping", &self.grouping, "\"distinct\" or \"shared\"")?;
        request.weigh = parse_enum_word("weigh", &self.weigh, "\"equal\" or \"felt\"")?;
        request.zone = check_zone_on_surface(scene, self.zone_m)?;
        // As `era plan` plans: thoroughly, where a touch has some milliseconds.
        request.work = SearchEffort::Study;
        Ok(request)
    }
}

fn parse_enum_word<T: DeserializeOwned>(field: &str, word: &str, allowed: &str) -> Result<T, Raised> {
    serde_json::from_value(word.into()).map_err(|_| Raised::wrong_argument(field, word, allowed))
}

/// A rectangle on the surface, its corners in any order.
pub fn check_zone_on_surface(scene: &Scene, corners: Option<FourNumbers>) -> Result<Option<Region>, Raised> {
    let Some(corners) = corners else { return Ok(None) };
    let [x0, y0, x1, y1] = corners.check_unmasked_numbers("zone_m")?;
    let sorted = |a: f64, b: f64| if b < a { [b, a] } else { [a, b] };
    let region = Region::on_surface(scene, sorted(x0, x1), sorted(y0, y1));
    let allowed = || {
        format!("a rectangle with x from 0 to {} m and y from 0 to {} m", scene.surface.length_m, scene.surface.width_m)
    };
    region.map(Some).map_err(|_| Raised::wrong_argument("zone_m", ArgumentValue::Corners([x0, y0, x1, y1]), allowed()))
}
