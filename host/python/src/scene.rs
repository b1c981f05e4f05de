//! The class `Scene`.

use crate::document;
use crate::errors::{Raised, build_scene_exception};
use era_model::scene::{EXAMPLE_BAR, EXAMPLE_PLATE, PixelError, Scene, SurfaceKind};
use era_model::text_file::read_text_file;
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple, PyType};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::PathBuf;
use std::sync::Arc;
use toml::Table;

/// What messages call a scene that was made from keywords.
const KEYWORDS: &str = "Scene";
/// What is said to whoever gives no surface: most have the text of a file, or its path.
const NO_SURFACE: &str = "Scene() needs the argument `surface` (the table [surface] of a scene). To read a scene \
                          file instead, use Scene.from_file(path) or Scene.from_toml(text); for an example, use \
                          Scene.example(\"plate\") or Scene.example(\"bar\")";

/// A panel with everything that holds, loads and drives it; never changes.
///
/// The keywords are the tables of a scene file (`docs/src/scene.md`), with its keys and units: mappings for `surface`, `screen`,
/// `press`, `finger`, `air` and `electronics`, sequences of mappings for the others. Two scenes are equal if they mean the same, whatever they were made from; equal
/// ones have one hash, and they can be pickled.
///
/// Parameters
/// ----------
/// name : str
///     Its name.
/// surface : mapping
///     `kind` ("plate" or "bar"), `length_mm`, `width_mm`, `thickness_mm`, `material` (both left out where there are
///     layers), optionally `damping`.
/// screen, press, finger, air, electronics : mapping, optional
///     Which pixels lie where; the press that gaps have to bear; what rests on the place that is touched; the air around; the
///     resistors between rails and electrodes.
/// layer, patch, cutout, support, edge, mass, actuator : sequence of mappings, optional
///     What there is any number of.
///
/// Raises
/// ------
/// SceneError
///     With every mistake, in `mistakes`.
/// TypeError
///     There is no surface. `Scene.from_toml` takes a file's text.
///
/// Examples
/// --------
/// >>> import era
/// >>> aluminium = {"youngs_modulus_pa": 70e9, "poisson_ratio": 0.33, "density_kg_m3": 2700.0}
/// >>> beam = era.Scene(
/// ...     "beam",
/// ...     {"kind": "bar", "length_mm": 500.0, "width_mm": 30.0, "thickness_mm": 3.0, "material": aluminium},
/// ...     edge=[{"side": "left", "kind": "clamped"}],
/// ... )
/// >>> beam.kind, beam.length_m
/// ('bar', 0.5)
/// >>> thick = beam.with_(surface={"thickness_mm": 6.0})
/// >>> thick == beam, thick.with_(surface={"thickness_mm": 3.0}) == beam
/// (False, True)
#[pyclass(frozen, module = "era", name = "Scene")]
pub struct PyScene {
    scene: Arc<Scene>,
    /// What it was read from.
    text: String,
    /// Of the SI numbers.
    hash: u64,
}

impl PyScene {
    /// The scene, shared with whoever works with it.
    pub fn shared_scene(&self) -> Arc<Scene> {
        self.scene.clone()
    }

    /// The text that it was read from.
    pub fn source_text(&self) -> &str {
        &self.text
    }

    fn parse_scene(py: Python<'_>, source: &str, text: String, has_lines: bool) -> PyResult<Self> {
        let scene = Scene::parse(source, &text).map_err(|error| build_scene_exception(py, error, has_lines))?;
        let hash = hash_scene(&scene);
        Ok(Self { scene: Arc::new(scene), text, hash })
    }

    fn from_toml_table(py: Python<'_>, table: &Table) -> PyResult<Self> {
        let text =
            toml::to_string(table).map_err(|error| Raised::wrong_argument(KEYWORDS, &*error.to_string(), "TOML"))?;
        Self::parse_scene(py, KEYWORDS, text, false)
    }

    fn parse_toml_table(&self) -> Table {
        // It was read before.
        self.text.parse().unwrap_or_default()
    }
}

#[pymethods]
impl PyScene {
    #[new]
    // The surface has a default here, so that its lack is told in words that help; to those who ask for the signature it has none.
    #[pyo3(
        signature = (name, surface=None, *, screen=None, layer=None, patch=None, cutout=None, support=None, edge=None, mass=None,
            actuator=None, press=None, finger=None, air=None, electronics=None),
        text_signature = "(name, surface, *, screen=None, layer=None, patch=None, cutout=None, support=None, edge=None, mass=None, \
            actuator=None, press=None, finger=None, air=None, electronics=None)"
    )]
    #[expect(clippy::too_many_arguments, reason = "the tables of a scene file")]
    fn new<'py>(
        py: Python<'py>,
        name: &Bound<'py, PyAny>,
        surface: Option<&Bound<'py, PyAny>>,
        screen: Option<&Bound<'py, PyAny>>,
        layer: Option<&Bound<'py, PyAny>>,
        patch: Option<&Bound<'py, PyAny>>,
        cutout: Option<&Bound<'py, PyAny>>,
        support: Option<&Bound<'py, PyAny>>,
        edge: Option<&Bound<'py, PyAny>>,
        mass: Option<&Bound<'py, PyAny>>,
        actuator: Option<&Bound<'py, PyAny>>,
        press: Option<&Bound<'py, PyAny>>,
        finger: Option<&Bound<'py, PyAny>>,
        air: Option<&Bound<'py, PyAny>>,
        electronics: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        if surface.is_none() {
            return Err(PyTypeError::new_err(NO_SURFACE));
        }
        let keywords = PyDict::new(py);
        let all = [
            ("name", Some(name)),
            ("surface", surface),
            ("screen", screen),
            ("layer", layer),
            ("patch", patch),
            ("cutout", cutout),
            ("support", support),
            ("edge", edge),
            ("mass", mass),
            ("actuator", actuator),
            ("press", press),
            ("finger", finger),
            ("air", air),
            ("electronics", electronics),
        ];
        for (key, value) in all {
            keywords.set_item(key, value)?;
        }
        Self::from_toml_table(py, &document::scene_table_with_version_from_keywords(&keywords)?)
    }

    /// A scene from the text of a scene file.
    ///
    /// Parameters
    /// ----------
    /// text : str
    ///     TOML.
    ///
    /// Returns
    /// -------
    /// Scene
    ///
    /// Raises
    /// ------
    /// SceneError
    ///     With every mistake and its line.
    #[classmethod]
    fn from_toml(_class: &Bound<'_, PyType>, py: Python<'_>, text: String) -> PyResult<Self> {
        Self::parse_scene(py, "scene", text, true)
    }

    /// A scene from a file.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///
    /// Returns
    /// -------
    /// Scene
    ///
    /// Raises
    /// ------
    /// OSError
    ///     The file cannot be read.
    /// SceneError
    ///     With every mistake and its line.
    #[classmethod]
    fn from_file(_class: &Bound<'_, PyType>, py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let text = read_text_file(&path).map_err(|error| Raised::unusable_file("read", &path, &error))?;
        Self::parse_scene(py, &path.display().to_string(), text, true)
    }

    /// An example: the plate or the bar that the program comes with.
    ///
    /// Parameters
    /// ----------
    /// name : {"plate", "bar"}
    ///
    /// Returns
    /// -------
    /// Scene
    ///
    /// Examples
    /// --------
    /// >>> import era
    /// >>> era.Scene.example("plate").actuator_ids
    /// ('left', 'right')
    #[classmethod]
    fn example(_class: &Bound<'_, PyType>, py: Python<'_>, name: &str) -> PyResult<Self> {
        let text = match name {
            "plate" => EXAMPLE_PLATE,
            "bar" => EXAMPLE_BAR,
            _ => return Err(Raised::wrong_argument("name", name, "\"plate\" or \"bar\"").into()),
        };
        Self::parse_scene(py, name, text.into(), true)
    }

    /// A changed copy.
    ///
    /// Mappings change the keys that they name and leave the others; entries of lists are named by their index from 0 (-1 is the
    /// last), actuators also by their `id` and edges by their `side`. `None` takes away. Everything else, a list too, replaces what is there.
    ///
    /// Parameters
    /// ----------
    /// **changes
    ///     The keywords of `Scene`.
    ///
    /// Returns
    /// -------
    /// Scene
    ///
    /// Raises
    /// ------
    /// SceneError
    ///     The changed scene is none.
    /// RequestError
    ///     An entry of a list is not there.
    ///
    /// Examples
    /// --------
    /// >>> import era
    /// >>> plate = era.Scene.example("plate")
    /// >>> moved = plate.with_(actuator={"left": {"x_mm": 40.0}})
    /// >>> moved.actuator_xy_m.tolist()[0][0]
    /// 0.04
    /// >>> plate.with_(actuator={"right": None}).actuator_ids
    /// ('left',)
    #[pyo3(name = "with_", signature = (**changes))]
    fn with_changes(&self, py: Python<'_>, changes: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut table = self.parse_toml_table();
        if let Some(changes) = changes {
            document::merge_keywords_into_table_removing_keys_set_to_none(&mut table, changes)?;
        }
        Self::from_toml_table(py, &table)
    }

    /// The text that it was read from; that of a scene file for one made from keywords.
    ///
    /// Returns
    /// -------
    /// str
    fn to_toml(&self) -> &str {
        &self.text
    }

    /// The tables of its file, in the file's units.
    ///
    /// Returns
    /// -------
    /// dict
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        document::table_to_python_dict(py, &self.parse_toml_table())
    }

    /// The place on the surface under a pixel of the screen.
    ///
    /// Parameters
    /// ----------
    /// x_px, y_px : float
    ///     From the screen's top left corner.
    ///
    /// Returns
    /// -------
    /// (float, float)
    ///     In m.
    ///
    /// Raises
    /// ------
    /// RequestError
    ///     The screen, or the surface, has no such place.
    #[pyo3(name = "point_m")]
    fn surface_point_at_px(&self, x_px: f64, y_px: f64) -> Result<(f64, f64), Raised> {
        match self.scene.surface_point_at_px(x_px, y_px) {
            Ok(place) => Ok(place.coordinates_m()),
            Err(PixelError::Screen(error)) => {
                Err(Raised::wrong_argument(error.field, error.value, format!("{} to {}", error.min, error.max)))
            }
            Err(PixelError::Place(error)) => {
                let at = self.scene.screen.convert_px_to_surface_m(x_px, y_px).unwrap_or((f64::NAN, f64::NAN));
                Err(Raised::place_off_surface("point", at, error))
            }
        }
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.scene.name
    }

    /// "plate" or "bar".
    #[getter]
    fn kind(&self) -> &'static str {
        match self.scene.surface.kind {
            SurfaceKind::Plate => "plate",
            SurfaceKind::Bar => "bar",
        }
    }

    /// Side along x in m.
    #[getter]
    fn length_m(&self) -> f64 {
        self.scene.surface.length_m
    }

    /// Side along y in m.
    #[getter]
    fn width_m(&self) -> f64 {
        self.scene.surface.width_m
    }

    /// Of the surface, patches apart, in m.
    #[getter]
    fn thickness_m(&self) -> f64 {
        self.scene.surface.thickness_m
    }

    /// Mass of the surface in kg, without anything that is attached to it, and with the air that moves with it.
    #[getter(mass_kg)]
    fn bare_surface_mass_with_air_kg(&self) -> f64 {
        self.scene.surface_mass_with_air_kg()
    }

    /// The actuators' ids, in the order of all arrays.
    #[getter]
    fn actuator_ids<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.scene.actuators.iter().map(|actuator| &actuator.id))
    }

    /// Where the actuators are in m: float64 [actuator, 2].
    #[getter]
    fn actuator_xy_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        positions_as_array(py, self.scene.actuators.iter().map(|actuator| [actuator.x_m, actuator.y_m]))
    }

    /// Where the supports are in m: float64 [support, 2].
    #[getter]
    fn support_xy_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        positions_as_array(py, self.scene.supports.iter().map(|support| [support.x_m, support.y_m]))
    }

    fn __repr__(&self) -> String {
        let surface = &self.scene.surface;
        let [length, width, thickness] = [surface.length_m, surface.width_m, surface.thickness_m].map(|m| m * 1e3);
        let parts: String = [
            ("patches", self.scene.patches.len()),
            ("cut-outs", self.scene.cutouts.len()),
            ("supports", self.scene.supports.len()),
            ("edges", self.scene.edges.len()),
            ("masses", self.scene.masses.len()),
            ("actuators", self.scene.actuators.len()),
        ]
        .into_iter()
        .filter(|(_, count)| *count > 0)
        .map(|(what, count)| format!(", {what}: {count}"))
        .collect();
        format!("<Scene {:?}: {} of {length:.1} x {width:.1} x {thickness:.2} mm{parts}>", self.name(), self.kind())
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| other.get().scene == self.scene)
    }

    fn __hash__(&self) -> u64 {
        self.hash
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (&str,))> {
        Ok((py.get_type::<Self>().getattr("from_toml")?, (&self.text,)))
    }
}

fn positions_as_array<'py>(
    py: Python<'py>,
    places: impl ExactSizeIterator<Item = [f64; 2]>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let count = places.len();
    let flat: Vec<f64> = places.flatten().collect();
    use numpy::PyArrayMethods;
    PyArray1::from_vec(py, flat).reshape([count, 2])
}

/// Equal scenes have equal numbers, so that it is enough to hash these; zeros are equal whatever their sign.
fn hash_scene(scene: &Scene) -> u64 {
    fn hash_json_value(value: &serde_json::Value, hasher: &mut DefaultHasher) {
        match value {
            serde_json::Value::Number(number) => (number.as_f64().unwrap_or(f64::NAN) + 0.0).to_bits().hash(hasher),
            serde_json::Value::String(text) => text.hash(hasher),
            serde_json::Value::Bool(flag) => flag.hash(hasher),
            serde_json::Value::Null => 0_u8.hash(hasher),
            serde_json::Value::Array(list) => list.iter().for_each(|value| hash_json_value(value, hasher)),
            serde_json::Value::Object(map) => map.values().for_each(|value| hash_json_value(value, hasher)),
        }
    }
    let mut hasher = DefaultHasher::new();
    hash_json_value(&serde_json::to_value(scene).unwrap_or_default(), &mut hasher);
    hasher.finish()
}
