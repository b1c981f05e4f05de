//! What a panel does: scenes, finite elements, responses, motion in time.
//!
//! Data flows one way: [`scene`] (what is there) -> [`model`] (finite elements, modes) -> [`response`] (how it answers a harmonic
//! force), and beside that [`transient`] (how it moves in time). [`stop`] ends what takes too long, [`text_file`] reads files of text. SI units throughout; phasors are those of e^(+j w t), deflection
//! towards the user.
//!
//! From a scene to a response with a bound on its error:
//!
//! ```
//! use era_model::model::Accuracy;
//! use era_model::response::compute_acceleration_curves_per_newton_with_error_bounds;
//! use era_model::scene::{EXAMPLE_PLATE, Scene};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = Scene::parse("plate.toml", EXAMPLE_PLATE)?;
//! // Acceleration at (0.1, 0.05) m for 1 N at each actuator alone, at two frequencies.
//! let found = compute_acceleration_curves_per_newton_with_error_bounds(&scene, Accuracy::BALANCED, (0.1, 0.05), &[120.0, 180.0])?;
//! for (actuator, (curve, bound)) in scene.actuators.iter().zip(found.answer.iter().zip(&found.bounds)) {
//!     println!("{}: {:.3} m/s^2/N at 120 Hz, {bound:?}", actuator.id, curve[0].norm());
//!     assert!(bound.limit_if_known().is_some_and(|bound| bound <= 1e-3));
//! }
//! # Ok(())
//! # }
//! ```

mod kernel;
pub mod model;
pub mod response;
pub mod scene;
pub mod stop;
pub mod text_file;
pub mod transient;
