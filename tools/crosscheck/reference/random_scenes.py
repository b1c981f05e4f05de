"""Random scenes of any size, as dictionaries that a TOML file would be read as, and their text.

A scene follows from (seed, index) alone. Thickness follows from how many modes the bare panel is to have below 400 Hz, so
that panels from 40 mm to 3 m are as likely to be stiff as to be lively.
"""

import numpy as np

# E in Pa, rho in kg/m^3, nu.
MATERIALS = [
    (69e9, 2700.0, 0.33),  # aluminium
    (200e9, 7850.0, 0.3),  # steel
    (70e9, 2500.0, 0.22),  # glass
    (4.7e9, 1175.0, 0.37),  # PMMA
    (45e9, 1800.0, 0.29),  # magnesium
]
SIDES = ("left", "right", "top", "bottom")


def log_uniform(rng, low, high):
    """A number whose logarithm is evenly distributed."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


class _Maker:
    def __init__(self, rng):
        self.rng = rng
        self.bar = rng.random() < 0.25
        self.symmetric = not self.bar and rng.random() < 0.15
        # Whole millimetres, tenths, or any number.
        self.digits = rng.choice([0, 1, 15], p=[0.5, 0.2, 0.3])

    def chance(self, p):
        return self.rng.random() < p

    def mm(self, value):
        return float(np.round(value, int(self.digits)))

    def scene(self):
        rng = self.rng
        self.length = max(self.mm(log_uniform(rng, 40, 3000)), 40.0)
        if self.bar:
            self.width = max(self.mm(self.length * log_uniform(rng, 0.02, 0.15)), 1.0)
        else:
            self.width = min(max(self.mm(self.length * log_uniform(rng, 0.25, 1.6)), 40.0), 3000.0)
        e, rho, nu = MATERIALS[rng.integers(len(MATERIALS))]
        if self.chance(0.4):
            e, rho, nu = log_uniform(rng, 2e9, 3e11), log_uniform(rng, 900, 9000), float(rng.uniform(0.0, 0.45))
        a, b = self.length * 1e-3, self.width * 1e-3
        # Weyl's count of bending modes below 400 Hz: plate a b f sqrt(rho h / D) / 2, bar (a / pi) (rho A w^2 / E I)^(1/4).
        if self.bar:
            count = log_uniform(rng, 0.5, 8)
            thickness = np.sqrt(12 * rho / e) * 2 * np.pi * 400 * a**2 / (count * np.pi) ** 2
        else:
            count = log_uniform(rng, 0.5, 25)
            thickness = a * b * 200 * np.sqrt(12 * rho * (1 - nu**2) / e) / count
        # The format's limit is 100 mm, of a patch too.
        thickness = float(np.clip(thickness, 5e-5, min(a / 15, a if self.bar else b / 15, 0.045)))
        self.thickness = float(f"{thickness * 1e3:.3g}")
        self.weight_kg = rho * a * b * self.thickness * 1e-3
        surface = {
            "kind": "bar" if self.bar else "plate",
            "length_mm": self.length,
            "width_mm": self.width,
            "thickness_mm": self.thickness,
            "material": {"youngs_modulus_pa": e, "density_kg_m3": rho, "poisson_ratio": nu},
        }
        damping = self._damping()
        if damping:
            surface["damping"] = damping
        scene = {"version": 1, "name": "random scene", "surface": surface}
        if self.chance(0.8):
            scene["screen"] = self._screen()
        self.cutouts = [self._cutout()] if not (self.bar or self.symmetric) and self.chance(0.18) else []
        scene["patch"] = [self._patch() for _ in range(rng.integers(1, 3))] if not self.symmetric and self.chance(0.25) else []
        scene["cutout"] = self.cutouts
        scene["edge"] = self._edges()
        scene["support"] = self._supports(bool(scene["edge"]))
        scene["mass"] = self._masses()
        scene["actuator"] = self._actuators()
        # Last, so that all else is as it was before there were presses.
        if self.chance(0.5):
            scene["press"] = {"force_n": 0.0 if self.chance(0.2) else log_uniform(rng, 0.01, 20.0)}
        if self.chance(0.4):
            part = rng.uniform(0.1, 0.8)
            for actuator in scene["actuator"]:
                actuator["stop_um"] = part * actuator["air_gap_um"]
        self._losses(scene)
        self._air(scene)
        if not scene["patch"] and self.chance(0.3):
            del surface["thickness_mm"], surface["material"]
            scene["layer"] = self._layers((e, rho, nu), "damping" not in surface)
        # Again last, so that all else is as it was before.
        if self.chance(0.3):
            cable = log_uniform(rng, 20, 300)
            for actuator in scene["actuator"]:
                actuator["cable_capacitance_pf"] = cable
                if not self.symmetric and self.chance(0.5):
                    cable = log_uniform(rng, 20, 300)
        if self.chance(0.3):
            scene["electronics"] = self._electronics(scene["actuator"])
        return {key: value for key, value in scene.items() if value != []}

    def _electronics(self, actuators):
        """Resistors whose time constants are allowed: up to 0.5 ms, and no shorter than the delay."""
        own = lambda era: 8.8541878128e-12 * era["electrode_area_mm2"] / era["air_gap_um"] + era.get("cable_capacitance_pf", 81.0) * 1e-12
        farads = [own(era) for era in actuators]
        up = min(log_uniform(self.rng, 1e5, 2e6), 0.49e-3 / max(farads))
        table = {"charging_resistance_ohm": up, "discharging_resistance_ohm": up * log_uniform(self.rng, 0.05, 1.0)}
        if self.chance(0.6):
            table["discharging_delay_us"] = min(self.rng.uniform(0.0, 40.0), 0.99e6 * up * min(farads))
        return table

    def _losses(self, scene):
        """Loss factors of supports and elastic edges: tape and rubber have 0.1 to 1. One for all, or one for each."""
        springs = scene["support"] + [edge for edge in scene["edge"] if edge["kind"] == "elastic"]
        if not springs or not self.chance(0.4):
            return
        factor, is_same = log_uniform(self.rng, 0.02, 1.5), self.symmetric or self.chance(0.5)
        for spring in springs:
            spring["loss_factor"] = factor
            if not is_same:
                factor = 0.0 if self.chance(0.2) else log_uniform(self.rng, 0.02, 1.5)

    def _air(self, scene):
        """Air that is shut in, as stiff as what holds a panel, and air that moves along."""
        if not self.chance(0.2):
            return
        area = self.length * self.width * 1e-6
        depth = 1.4 * 101325.0 * area / (self.weight_kg * (2 * np.pi * log_uniform(self.rng, 10, 300)) ** 2)
        scene["air"] = {"sealed_depth_mm": float(np.clip(depth * 1e3, 0.01, 1e4))}
        if self.chance(0.5):
            scene["air"]["added_mass_kg_per_m2"] = self.weight_kg / area * log_uniform(self.rng, 0.01, 0.5)

    def _layers(self, material, may_lose):
        """One to four layers as thick as the panel was to be, of its material and of others with axes."""
        rng = self.rng
        e, rho, nu = material
        parts = rng.dirichlet(np.full(rng.integers(1, 5), 2.0)) * 0.9 + 0.02
        layers = []
        for part in parts:
            density = rho * log_uniform(rng, 0.6, 1.6)
            if self.chance(0.4):
                own = {"youngs_modulus_pa": e * log_uniform(rng, 0.3, 1.5), "density_kg_m3": density, "poisson_ratio": nu}
            else:
                ex, ey = e * log_uniform(rng, 0.5, 1.5), e * log_uniform(rng, 0.1, 1.5)
                shear = np.sqrt(ex * ey) * rng.uniform(0.06, 0.5)
                own = {"ex_pa": ex, "ey_pa": ey, "g_pa": shear, "density_kg_m3": density, "poisson_ratio": float(rng.uniform(0.0, 0.5) * np.sqrt(ex / ey))}
            layer = {"thickness_mm": self.thickness * part, "material": own}
            if self.chance(0.3):
                layer["angle_deg"] = 90
            if layers and self.chance(0.2):
                layer["bond"] = "slips"
            if may_lose and self.chance(0.5):
                layer["loss_factor"] = log_uniform(rng, 1e-3, 0.2)
            layers.append(layer)
        return layers

    def _damping(self):
        kind = self.rng.integers(4)
        if kind == 1:
            return {"loss_factor": log_uniform(self.rng, 1e-3, 0.1)}
        if kind == 2:
            ratio = log_uniform(self.rng, 1e-3, 0.05)
            # A stream of its own, so that scenes are otherwise what they were.
            own = np.random.default_rng(int(ratio * 1e12))
            if own.random() < 0.5:
                return {"modal_ratio": ratio}
            hz = np.sort(own.choice(np.arange(10, 800), int(own.integers(2, 6)), replace=False))
            return {"modal_ratio": [[float(at), log_uniform(own, 1e-3, 0.05)] for at in hz]}
        if kind == 3:
            return {"rayleigh_alpha": log_uniform(self.rng, 0.1, 20), "rayleigh_beta": log_uniform(self.rng, 1e-7, 1e-5)}
        return {}

    def _screen(self):
        rng = self.rng
        screen = {"width_px": int(rng.integers(100, 4000)), "height_px": int(rng.integers(100, 3000))}
        if self.chance(0.3):
            x, y = self.length * rng.uniform(0, 0.3), self.width * rng.uniform(0, 0.3)
            screen |= {"x_mm": x, "y_mm": y, "width_mm": self.length * rng.uniform(0.4, 0.69), "height_mm": self.width * rng.uniform(0.4, 0.69)}
        return screen

    def _box(self, low, high):
        rng = self.rng
        length, width = max(self.mm(self.length * rng.uniform(low, high)), 2.0), max(self.mm(self.width * rng.uniform(low, high)), 2.0)
        x, y = self.mm((self.length - length) * rng.random()), self.mm((self.width - width) * rng.random())
        # Slivers beside a border are cells of no use to anyone.
        x = 0.0 if x < 0.06 * self.length else x
        y = 0.0 if y < 0.06 * self.width else y
        if self.length - x - length < 0.06 * self.length:
            x = self.length - length
        if self.width - y - width < 0.06 * self.width:
            y = self.width - width
        return {"x_mm": x, "y_mm": y, "length_mm": length, "width_mm": width}

    def _cutout(self):
        return self._box(0.1, 0.35)

    def _patch(self):
        patch = self._box(0.2, 0.6)
        if self.bar:
            del patch["y_mm"]
            if self.chance(0.5):
                del patch["width_mm"]
        patch["thickness_mm"] = self.thickness * log_uniform(self.rng, 0.6, 2.0)
        if self.chance(0.5):
            patch["material"] = {"youngs_modulus_pa": log_uniform(self.rng, 1e10, 2.1e11), "density_kg_m3": log_uniform(self.rng, 1200, 8000)}
        return patch

    def _edges(self):
        if not self.chance(0.35):
            return []
        sides = SIDES[:2] if self.bar else SIDES
        chosen = self.rng.permutation(sides)[: self.rng.integers(1, len(sides) + 1)]
        edges = []
        # Rigidity per span^3, the scale on which an elastic edge is neither free nor held.
        for side in chosen:
            kind = ["pinned", "clamped", "elastic"][self.rng.integers(3)]
            edge = {"side": str(side), "kind": kind}
            if kind == "elastic":
                weight = self.weight_kg * (2 * np.pi * log_uniform(self.rng, 10, 300)) ** 2
                if self.bar:
                    edge |= {"stiffness_n_per_m": weight, "rotational_stiffness_n_m_per_rad": weight * (self.length * 1e-3) ** 2 * log_uniform(self.rng, 1e-3, 1)}
                else:
                    along = (self.width if side in ("left", "right") else self.length) * 1e-3
                    edge |= {"stiffness_n_per_m2": weight / along, "rotational_stiffness_n_per_rad": weight / along * (self.length * 1e-3) ** 2 * log_uniform(self.rng, 1e-3, 1)}
            edges.append(edge)
        return edges

    def _place(self):
        """A place on the surface, with some on borders and in corners."""
        for _ in range(1000):
            x, y = self.mm(self.length * self.rng.uniform(0.03, 0.97)), self.mm(self.width * self.rng.uniform(0.03, 0.97))
            if self.chance(0.15):
                x = [0.0, self.length][self.rng.integers(2)]
            if self.chance(0.15):
                y = [0.0, self.width][self.rng.integers(2)]
            if all(not (c["x_mm"] - 1 <= x <= c["x_mm"] + c["length_mm"] + 1 and c["y_mm"] - 1 <= y <= c["y_mm"] + c["width_mm"] + 1) for c in self.cutouts):
                return {"x_mm": x} if self.bar else {"x_mm": x, "y_mm": y}
        raise ValueError("no place found")

    def _mirrored(self, place):
        """A place and its images in both axes of symmetry."""
        xs = {place["x_mm"], self.length - place["x_mm"]}
        ys = {place["y_mm"], self.width - place["y_mm"]}
        return [{"x_mm": x, "y_mm": y} for y in sorted(ys) for x in sorted(xs)]

    def _corners(self):
        if self.bar:
            return [{"x_mm": 0.0}, {"x_mm": self.length}]
        corners = [{"x_mm": x, "y_mm": y} for y in (0.0, self.width) for x in (0.0, self.length)]
        cut = lambda p: any(c["x_mm"] <= p["x_mm"] <= c["x_mm"] + c["length_mm"] and c["y_mm"] <= p["y_mm"] <= c["y_mm"] + c["width_mm"] for c in self.cutouts)
        return [corner for corner in corners if not cut(corner)]

    def _supports(self, has_edges):
        if has_edges and self.chance(0.6) and not self.symmetric:
            return []
        if self.symmetric or self.chance(0.5):
            places = self._corners()
        else:
            places = [self._place() for _ in range(self.rng.integers(0, 6))]
        supports = []
        stiffness = self._support_stiffness()
        for place in places:
            if not self.symmetric and self.chance(0.5):
                stiffness = self._support_stiffness()
            # As a dashpot of a few percent on the panel's weight, or as one on a far slower motion where the spring is hard.
            soft = min(stiffness, self.weight_kg * (2 * np.pi * 100) ** 2)
            damping = 2 * 0.05 * np.sqrt(soft * self.weight_kg / max(len(places), 1))
            supports.append(place | {"stiffness_n_per_m": stiffness, "damping_n_s_per_m": damping})
        if self.bar and supports and self.chance(0.2):
            supports[0]["rotational_stiffness_n_m_per_rad"] = stiffness * (self.length * 1e-3) ** 2 * log_uniform(self.rng, 1e-3, 1)
        return supports

    def _support_stiffness(self):
        soft = self.weight_kg * (2 * np.pi * log_uniform(self.rng, 5, 100)) ** 2
        if self.chance(0.2):
            soft *= log_uniform(self.rng, 1e2, 1e9)
        return min(soft, 1e18)

    def _masses(self):
        if self.symmetric or not self.chance(0.4):
            return []
        return [self._place() | {"mass_g": self.weight_kg * 1e3 * log_uniform(self.rng, 1e-3, 0.5)} for _ in range(self.rng.integers(1, 4))]

    def _actuators(self):
        rng = self.rng
        if self.symmetric:
            mm = self.length * rng.uniform(0.08, 0.45), self.width * rng.uniform(0.08, 0.45)
            places = self._mirrored({"x_mm": self.mm(mm[0]), "y_mm": self.mm(mm[1])})[: [2, 4][rng.integers(2)]]
        else:
            places = [self._place() for _ in range(rng.integers(1, 5))]
        actuators = []
        own = self._actuator()
        for number, place in enumerate(places):
            if not self.symmetric and self.chance(0.5):
                own = self._actuator()
            actuators.append({"id": f"era{number}"} | place | own)
        return actuators

    def _actuator(self):
        rng = self.rng
        mass = self.weight_kg * log_uniform(rng, 0.003, 0.1)
        stiffness = mass * (2 * np.pi * log_uniform(rng, 50, 300)) ** 2
        area_mm2, gap_um = log_uniform(rng, 200, 3000), float(np.round(log_uniform(rng, 200, 1000)))
        actuator = {
            "mount": ["inertial", "grounded"][rng.integers(2)],
            "moving_mass_g": mass * 1e3,
            "stiffness_n_per_m": stiffness,
            "damping_n_s_per_m": 2 * log_uniform(rng, 0.01, 0.15) * np.sqrt(stiffness * mass),
            "electrode_area_mm2": area_mm2,
            "air_gap_um": gap_um,
            "max_voltage_v": float(np.round(log_uniform(rng, 500, 2500))),
        }
        if self.chance(0.3):
            actuator["housing_mass_g"] = mass * 1e3 * rng.uniform(0.1, 2)
        if self.chance(0.2):
            # A share of the springs' stiffness: eps0 A V^2 / g^3 = share k.
            bias = np.sqrt(rng.uniform(0.02, 0.25) * stiffness * (gap_um * 1e-6) ** 3 / (8.8541878128e-12 * area_mm2 * 1e-6))
            if bias < actuator["max_voltage_v"]:
                actuator["bias_voltage_v"] = bias
        return actuator


def make(seed, index):
    """The scene of a seed and an index, as a dictionary."""
    return _Maker(np.random.default_rng([seed, index])).scene()


def _value(value):
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, list):
        return f"[{', '.join(_value(item) for item in value)}]"
    return repr(float(value))


def to_toml(scene):
    """The text of a scene file."""
    lines = [f"{key} = {_value(value)}" for key, value in scene.items() if not isinstance(value, (dict, list))]

    def table(head, content):
        lines.append(f"\n{head}")
        lines.extend(f"{key} = {_value(value)}" for key, value in content.items() if not isinstance(value, dict))
        for key, value in content.items():
            if isinstance(value, dict):
                table(f"[{head.strip('[]')}.{key}]", value)

    for key, value in scene.items():
        if isinstance(value, dict):
            table(f"[{key}]", value)
        elif isinstance(value, list):
            for item in value:
                table(f"[[{key}]]", item)
    return "\n".join(lines) + "\n"
