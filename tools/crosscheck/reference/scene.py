"""Scene files: what they say, in SI units, with the defaults of the scene reference (`docs/src/scene.md`)."""

import tomllib
from dataclasses import dataclass, field, replace

import numpy as np

from . import laminate as layered

VACUUM_PERMITTIVITY_F_PER_M = 8.8541878128e-12


@dataclass(frozen=True)
class Material:
    """Of the surface or of a patch; a bar has no use for Poisson's ratio."""

    youngs_modulus_pa: float
    density_kg_m3: float
    poisson_ratio: float = 0.0


@dataclass(frozen=True)
class Damping:
    """Of the surface's own material. `kind` is none, loss_factor, modal_ratio or rayleigh; a modal ratio is one number, or pairs of a frequency in Hz and one."""

    kind: str = "none"
    loss_factor: float = 0.0
    modal_ratio: float | tuple[tuple[float, float], ...] = 0.0
    rayleigh_alpha: float = 0.0
    rayleigh_beta: float = 0.0


@dataclass(frozen=True)
class Patch:
    """A rectangle of other thickness or material. For a bar `width` is the bar's own width within the step."""

    x: float
    y: float
    length: float
    width: float
    thickness: float
    material: Material


@dataclass(frozen=True)
class Cutout:
    """A rectangle without surface."""

    x: float
    y: float
    length: float
    width: float


@dataclass(frozen=True)
class Support:
    """A point spring-damper to ground."""

    x: float
    y: float
    stiffness: float
    damping: float = 0.0
    rotational_stiffness: float = 0.0
    # Of both springs: stiffness times 1 + j eta.
    loss_factor: float = 0.0


@dataclass(frozen=True)
class Edge:
    """A line support. Elastic: stiffnesses per metre of edge for a plate, of the end for a bar."""

    side: str
    kind: str
    stiffness: float = 0.0
    rotational_stiffness: float = 0.0
    # Of both springs.
    loss_factor: float = 0.0


@dataclass(frozen=True)
class PointMass:
    """A mass fixed to the surface."""

    x: float
    y: float
    mass: float


@dataclass(frozen=True)
class Finger:
    """What rests on the touched place: a mass that moves with it, a spring and a dashpot to ground."""

    mass: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0


@dataclass(frozen=True)
class Actuator:
    """An electrostatic resonant actuator (ERA)."""

    id: str
    x: float
    y: float
    mount: str
    moving_mass: float
    stiffness: float
    damping: float
    housing_mass: float
    electrode_area: float
    air_gap: float
    max_voltage: float
    bias_voltage: float = 0.0
    # Where a stop holds the mass, from its middle, or None.
    stop: float | None = None
    # Of what hangs on one electrode, its cable and its switches, in F.
    cable: float = 81e-12
    # Resistances in ohm through which an electrode charges and discharges, and the time from a window's end until it discharges.
    charging_ohm: float = 0.0
    discharging_ohm: float = 0.0
    delay: float = 0.0

    @property
    def capacitance(self):
        """Of one electrode with its cable, in F."""
        return VACUUM_PERMITTIVITY_F_PER_M * self.electrode_area / self.air_gap + self.cable

    @property
    def times(self):
        """(time constant of charging, delay, time constant of discharging) in s."""
        return self.charging_ohm * self.capacitance, self.delay, self.discharging_ohm * self.capacitance

    @property
    def inertial(self):
        """Whether the moving mass hangs inside a housing that rides on the surface."""
        return self.mount == "inertial"

    @property
    def softening(self):
        """What the bias takes from the springs, in N/m: eps0 A V^2 / g^3."""
        return VACUUM_PERMITTIVITY_F_PER_M * self.electrode_area * self.bias_voltage**2 / self.air_gap**3

    @property
    def linear_stiffness(self):
        """Stiffness of the springs in the linear model, in N/m."""
        return self.stiffness - self.softening

    def force(self, voltage_v):
        """Pull of one electrode on the mass at rest in N: eps0 A V^2 / (2 g^2)."""
        return VACUUM_PERMITTIVITY_F_PER_M * self.electrode_area * voltage_v**2 / (2 * self.air_gap**2)


@dataclass(frozen=True)
class Screen:
    """Which pixels lie where: `x`, `y`, `length`, `width` in metres are the active area."""

    width_px: float
    height_px: float
    x: float
    y: float
    length: float
    width: float

    def to_m(self, x_px, y_px):
        """The place of a pixel on the surface."""
        return self.x + x_px * self.length / self.width_px, self.y + y_px * self.width / self.height_px

    def to_px(self, x_m, y_m):
        """The pixel of a place on the surface."""
        return (x_m - self.x) * self.width_px / self.length, (y_m - self.y) * self.height_px / self.width


@dataclass(frozen=True)
class Scene:
    """A panel and all that is attached to it. `kind` is plate or bar; a bar lies along x at y = width / 2."""

    name: str
    kind: str
    length: float
    width: float
    thickness: float
    material: Material
    damping: Damping = field(default_factory=Damping)
    screen: Screen | None = None
    patches: tuple[Patch, ...] = ()
    cutouts: tuple[Cutout, ...] = ()
    supports: tuple[Support, ...] = ()
    edges: tuple[Edge, ...] = ()
    masses: tuple[PointMass, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    # The hardest press that gaps have to bear, in N.
    press: float = 5.0
    finger: Finger | None = None
    # Sealed air behind the panel, in m, and mass of air that moves with it, in kg/m^2.
    sealed_depth: float | None = None
    added_mass: float = 0.0
    # What its layers are together, where it has some; thickness and material are then of their height, weight and mean stiffness.
    laminate: layered.Laminate | None = None

    @property
    def air_stiffness(self):
        """Of sealed air against the mean deflection, gamma p A / depth, in N/m; 0 without."""
        if self.sealed_depth is None:
            return 0.0
        area = self.length * self.width - sum(cutout.length * cutout.width for cutout in self.cutouts)
        return 1.4 * 101325.0 * area / self.sealed_depth

    @property
    def is_bar(self):
        """Whether the surface is a beam."""
        return self.kind == "bar"

    def in_cutout(self, x, y):
        """Whether a place lies inside a cut-out, its border not counted."""
        return any(c.x < x < c.x + c.length and c.y < y < c.y + c.width for c in self.cutouts)

    def has_surface(self, x, y):
        """Whether there is surface at a place or at its border: some of what is next to it is neither cut out nor outside."""
        step = 1e-7 * max(self.length, self.width)
        beside = [(x + dx, y + dy) for dx in (-step, step) for dy in (-step, step)]
        within = lambda u, v: 0 < u < self.length and (self.is_bar or 0 < v < self.width)
        cut = lambda u, v: any(c.x < u < c.x + c.length and c.y < v < c.y + c.width for c in self.cutouts)
        return any(within(u, v) and not cut(u, v) for u, v in beside)

    def touched(self, x, y):
        """The panel with the finger at a place, as a part of it."""
        finger = self.finger or Finger()
        masses = (*self.masses, PointMass(x, y, finger.mass))
        return replace(self, masses=masses, supports=(*self.supports, Support(x, y, finger.stiffness, finger.damping)), finger=None)

    def without_actuators(self):
        """The same panel without its ERAs, housings included."""
        return replace(self, actuators=())


class _Table(dict):
    """A table of a scene file that records which of its keys are read: a key that nobody reads would be compared by no check."""

    def __init__(self, table, path=""):
        wrap = lambda key, value: _Table(value, f"{path}{key}.") if isinstance(value, dict) else value
        inner = lambda key, value: [wrap(key, each) for each in value] if isinstance(value, list) else wrap(key, value)
        super().__init__({key: inner(key, value) for key, value in table.items()})
        self.path, self.read = path, set()

    def __getitem__(self, key):
        self.read.add(key)
        return super().__getitem__(key)

    def get(self, key, default=None):
        self.read.add(key)
        return super().get(key, default)

    def items(self):
        self.read.update(self)
        return super().items()

    def find_unread(self, ignored):
        """The paths of the keys that were not read, of this table and those in it."""
        unread = [self.path + key for key in self if key not in self.read | ignored]
        for value in self.values():
            for each in value if isinstance(value, list) else [value]:
                unread += each.find_unread(ignored) if isinstance(each, _Table) else []
        return unread


def _material(table, base=None):
    take = lambda key, default: float(table.get(key, default))
    if base is None:
        return Material(float(table["youngs_modulus_pa"]), float(table["density_kg_m3"]), take("poisson_ratio", 0.0))
    return Material(
        take("youngs_modulus_pa", base.youngs_modulus_pa),
        take("density_kg_m3", base.density_kg_m3),
        take("poisson_ratio", base.poisson_ratio),
    )


def _damping(table):
    number = lambda value: tuple((float(hz), float(ratio)) for hz, ratio in value) if isinstance(value, list) else float(value)
    numbers = {key: number(value) for key, value in table.items()}
    if "loss_factor" in numbers:
        return Damping("loss_factor", **numbers)
    if "modal_ratio" in numbers:
        return Damping("modal_ratio", **numbers)
    if numbers:
        return Damping("rayleigh", **numbers)
    return Damping()


def _finger(table):
    if table is None:
        return None
    number = lambda key: float(table.get(key, 0.0))
    return Finger(number("mass_g") * 1e-3, number("damping_n_s_per_m"), number("stiffness_n_per_m"))


def parse(text):
    """The scene of a TOML text. A key that the reference does not know is an error: ValueError."""
    data = _Table(tomllib.loads(text))
    if data["version"] != 1:
        raise ValueError(f"the reference does not know version {data['version']} of scene files")
    surface = data["surface"]
    mm = lambda table, key, default=None: float(table[key] if default is None else table.get(key, default)) * 1e-3
    length, width = (mm(surface, key) for key in ("length_mm", "width_mm"))
    bar = surface["kind"] == "bar"
    damping = _damping(surface.get("damping", {}))
    laminate = None
    if "layer" in data:
        layers = [layered.read(table) for table in data["layer"]]
        laminate = layered.Laminate.of(layers, bar)
        thickness = laminate.thickness
        # For scales only.
        material = Material(12 * laminate.softest(bar) / thickness**3, laminate.weight / thickness)
        if any(layer.loss_factor > 0 for layer in layers):
            damping = Damping("loss_factor", laminate.loss_factor)
    else:
        thickness = mm(surface, "thickness_mm")
        material = _material(surface["material"])
    place = lambda table: {"x": mm(table, "x_mm"), "y": width / 2 if bar else mm(table, "y_mm")}

    screen = data.get("screen")
    if screen is None:
        # 1 px per mm, to whole pixels, halves upwards.
        pixels = [max(1.0, float(np.floor(side * 1e3 + 0.5))) for side in (length, width)]
        screen = Screen(*pixels, 0.0, 0.0, length, width)
    else:
        area = [mm(screen, "x_mm", 0.0), mm(screen, "y_mm", 0.0)]
        area += [mm(screen, "width_mm", length * 1e3), mm(screen, "height_mm", width * 1e3)]
        screen = Screen(float(screen["width_px"]), float(screen["height_px"]), *area)

    patches = []
    for table in data.get("patch", []):
        own_width = mm(table, "width_mm", width * 1e3) if bar else mm(table, "width_mm")
        patches.append(
            Patch(
                mm(table, "x_mm"),
                0.0 if bar else mm(table, "y_mm"),
                mm(table, "length_mm"),
                own_width,
                mm(table, "thickness_mm", thickness * 1e3),
                _material(table.get("material", {}), material),
            )
        )
    cutouts = [Cutout(*(mm(table, key) for key in ("x_mm", "y_mm", "length_mm", "width_mm"))) for table in data.get("cutout", [])]
    supports = [
        Support(
            **place(table),
            stiffness=float(table["stiffness_n_per_m"]),
            damping=float(table.get("damping_n_s_per_m", 0.0)),
            rotational_stiffness=float(table.get("rotational_stiffness_n_m_per_rad", 0.0)),
            loss_factor=float(table.get("loss_factor", 0.0)),
        )
        for table in data.get("support", [])
    ]
    keys = ("stiffness_n_per_m", "rotational_stiffness_n_m_per_rad") if bar else ("stiffness_n_per_m2", "rotational_stiffness_n_per_rad")
    keys += ("loss_factor",)
    edges = [Edge(table["side"], table["kind"], *(float(table.get(key, 0.0)) for key in keys)) for table in data.get("edge", [])]
    masses = [PointMass(**place(table), mass=float(table["mass_g"]) * 1e-3) for table in data.get("mass", [])]
    electronics = data.get("electronics", {})
    ohm = float(electronics["charging_resistance_ohm"]) if "electronics" in data else 0.0
    resistors = {
        "charging_ohm": ohm,
        "discharging_ohm": float(electronics.get("discharging_resistance_ohm", ohm)),
        "delay": float(electronics.get("discharging_delay_us", 0.0)) * 1e-6,
    }
    actuators = [
        Actuator(
            id=table["id"],
            **place(table),
            mount=table["mount"],
            moving_mass=float(table["moving_mass_g"]) * 1e-3,
            stiffness=float(table["stiffness_n_per_m"]),
            damping=float(table.get("damping_n_s_per_m", 0.0)),
            housing_mass=float(table.get("housing_mass_g", 0.0)) * 1e-3,
            electrode_area=float(table["electrode_area_mm2"]) * 1e-6,
            air_gap=float(table["air_gap_um"]) * 1e-6,
            max_voltage=float(table["max_voltage_v"]),
            bias_voltage=float(table.get("bias_voltage_v", 0.0)),
            stop=float(table["stop_um"]) * 1e-6 if "stop_um" in table else None,
            cable=float(table.get("cable_capacitance_pf", 81.0)) * 1e-12,
            **resistors,
        )
        for table in data.get("actuator", [])
    ]
    air = data.get("air", {})
    scene = Scene(
        name=data["name"],
        kind=surface["kind"],
        length=length,
        width=width,
        thickness=thickness,
        material=material,
        damping=damping,
        screen=screen,
        patches=tuple(patches),
        cutouts=tuple(cutouts),
        supports=tuple(supports),
        edges=tuple(edges),
        masses=tuple(masses),
        actuators=tuple(actuators),
        press=float(data.get("press", {}).get("force_n", 5.0)),
        finger=_finger(data.get("finger")),
        sealed_depth=float(air["sealed_depth_mm"]) * 1e-3 if "sealed_depth_mm" in air else None,
        added_mass=float(air.get("added_mass_kg_per_m2", 0.0)),
        laminate=laminate,
    )
    # A bar has one dimension; its attachments may still name the other.
    unread = data.find_unread({"y_mm"} if bar else set())
    if unread:
        raise ValueError(f"the reference does not know {', '.join(sorted(set(unread)))}: no check would compare it")
    return scene


def load(path):
    """The scene of a file."""
    with open(path, encoding="utf-8") as file:
        return parse(file.read())
