"""Plates with two opposite sides pinned, whose equation has a solution for every sine along them: no mesh, and nothing to converge but the series.

With w = sum of W_m(v) sin(k u), k = m pi / a, u from the one pinned side to the other, D22 W'''' - 2 (D12 + 2 D66) k^2 W'' + (D11 k^4 - mu omega^2) W =
q_m is an ordinary equation with the four exponentials e^(-s v), s^2 = [H k^2 +- sqrt(H^2 k^4 - D22 (D11 k^4 - mu omega^2))] / D22 (Levy; Timoshenko and
Woinowsky-Krieger, Theory of Plates and Shells). The other two sides may be free, pinned, clamped or on springs. What is attached at points, and
sealed air on the mean deflection, acts through the receptance between these few motions; all modes and curves follow from it. The series' terms
go with m^-3 at a point and with m^-5 and faster for the mean: some thousand terms, with the rest of the first by its known sum, leave 1e-12.
"""

import numpy as np
import scipy.special as special

from . import laminate

# Sines whose terms are worked out at every frequency, and all that are summed: beyond the first the frequency changes nothing
# but (omega / omega_m)^2 of a term.
TERMS, STILL_TERMS = 200, 6000
# Modes are looked for around a frequency within these parts of it, and found to the last.
NEAREST, FARTHEST, FOUND = 1e-10, 3e-3, 1e-12


class Levy:
    """The panel of a scene of that kind. A place is (x, y) in m. `mean` in place of one is the mean deflection under a force spread evenly."""

    def __init__(self, scene):
        self.scene = scene
        pinned = {edge.side for edge in scene.edges if edge.kind == "pinned"}
        if scene.is_bar or scene.patches or scene.cutouts or scene.damping.kind == "modal_ratio":
            raise ValueError("only whole plates of one section, and damping that is a part of their own matrices")
        self.turned = not {"left", "right"} <= pinned
        if self.turned and not {"top", "bottom"} <= pinned:
            raise ValueError("two opposite sides have to be pinned")
        self.a, self.b = (scene.width, scene.length) if self.turned else (scene.length, scene.width)
        if scene.laminate:
            bending, self.weight = scene.laminate.bending, scene.laminate.weight
        else:
            m = scene.material
            rigidity = m.youngs_modulus_pa * scene.thickness**3 / (12 * (1 - m.poisson_ratio**2))
            bending, self.weight = laminate.isotropic(rigidity, m.poisson_ratio), m.density_kg_m3 * scene.thickness
        d11, self.d12, d22, self.d66 = bending
        self.d11, self.d22 = (d22, d11) if self.turned else (d11, d22)
        self.weight += scene.added_mass
        by_side = {edge.side: edge for edge in scene.edges}
        ends = ("left", "right") if self.turned else ("top", "bottom")
        self.ends = [by_side.get(side) for side in ends]
        for support in scene.supports:
            if support.rotational_stiffness > 0:
                raise ValueError("a plate has no slope at a point")
        attached = (*scene.supports, *scene.masses, *scene.actuators)
        self.places = sorted({(item.x, item.y) for item in attached})
        self.functionals = [*self.places] + (["mean"] if scene.air_stiffness > 0 else [])

    # What is attached.

    def impedances(self, omega, losses=True):
        """Force over motion at each of `functionals`, in N/m: with what dashpots and loss factors do, or without."""
        scene, lossy = self.scene, 1.0 if losses else 0.0
        total = dict.fromkeys(self.functionals, 0.0)
        for s in scene.supports:
            total[s.x, s.y] += s.stiffness * (1 + 1j * lossy * s.loss_factor) + 1j * lossy * omega * s.damping
        for mass in scene.masses:
            total[mass.x, mass.y] -= omega**2 * mass.mass
        for era in scene.actuators:
            own, inertia = era.linear_stiffness + 1j * lossy * omega * era.damping, omega**2 * era.moving_mass
            moving = -own * inertia / (own - inertia) if era.inertial else own - inertia
            total[era.x, era.y] += moving - omega**2 * era.housing_mass
        if scene.air_stiffness > 0:
            total["mean"] = scene.air_stiffness
        values = np.array([total[key] for key in self.functionals], dtype=complex)
        return values if losses else values.real

    def drives(self, omega):
        """What 1 N at an ERA pushes the surface with: all of it, or of an inertial one what its mass does not take."""
        factors = []
        for era in self.scene.actuators:
            own, inertia = era.linear_stiffness + 1j * omega * era.damping, omega**2 * era.moving_mass
            factors.append(-inertia / (own - inertia) if era.inertial else 1.0)
        return np.array(factors)

    # The bare surface.

    def receptance(self, omega, functionals, losses=True):
        """Motion of each functional per newton at each other one, of the surface and its edges alone, [n, n] m/N."""
        damping = self.scene.damping if losses else None
        stiffer = 1.0 + 0j
        lighter = 1.0 + 0j
        if damping and damping.kind == "loss_factor":
            stiffer = 1 + 1j * damping.loss_factor
        elif damping and damping.kind == "rayleigh":
            stiffer, lighter = 1 + 1j * omega * damping.rayleigh_beta, 1 - 1j * damping.rayleigh_alpha / omega
        key = tuple(functionals)
        if getattr(self, "_still_of", None) != key:
            # Of the real stiffness at a frequency low against those sines' own, and high enough that the two roots are apart.
            slow = np.sqrt(self.d11 / self.weight) * (np.pi / self.a) ** 2 * 10.0
            self._still = self._terms(slow, functionals, np.arange(TERMS + 1, STILL_TERMS + 1), 1.0, 1.0, False).real + self._rest(functionals)
            self._still_of = key
        near = self._terms(omega, functionals, np.arange(1, TERMS + 1), stiffer, lighter, losses)
        result = near + self._still / stiffer
        return result if losses else result.real

    def _terms(self, omega, functionals, m, stiffer, lighter, losses):
        a, b = self.a, self.b
        k = m * np.pi / a
        d11, d12, d22, d66 = (stiffer * d for d in (self.d11, self.d12, self.d22, self.d66))
        h, rest = (d12 + 2 * d66) * k**2, d11 * k**4 - lighter * self.weight * omega**2
        root = np.sqrt(h * h - d22 * rest + 0j)
        first = (h + root) / d22
        # Their product is known, and their difference.
        second = rest / d22 / first
        s = np.sqrt(np.stack([first, second], 1))
        s = np.where(s.real < 0, -s, s)
        apart = (2 * root / d22)[:, None]

        def free_space(eta, derivative, sign):
            """e^(-s2 eta) / s2 - e^(-s1 eta) / s1 over 2 D22 (s1^2 - s2^2), and its derivatives along v."""
            parts = (-s * sign) ** derivative * np.exp(-s * eta) / s
            return (parts[:, 1:] - parts[:, :1])[:, 0] / (2 * d22 * apart[:, 0])

        places = [f if f == "mean" else ((f[1], f[0]) if self.turned else f) for f in functionals]
        along = []
        for place in places:
            # sin(k u), or its mean.
            along.append((1 - np.cos(m * np.pi)) / (k * a) if place == "mean" else np.sin(k * place[0]))

        def jet_at_end(place, end):
            """Value and three derivatives of a source's own solution at v = 0 (end 0) or b."""
            if place == "mean":
                return [1 / (b * rest), 0 * rest, 0 * rest, 0 * rest]
            eta, sign = (place[1], -1.0) if end == 0 else (b - place[1], 1.0)
            return [free_space(eta, n, sign) for n in range(4)]

        # e^(-s v), e^(-s (b - v)): [m, 4].
        signs, decay = np.concatenate([-s, s], 1), np.exp(-s * b)
        at_ends = [np.concatenate([np.ones_like(s), decay], 1), np.concatenate([decay, np.ones_like(s)], 1)]
        homogeneous = [[values * signs**n for n in range(4)] for values in at_ends]

        def conditions(jet, end):
            """Two numbers that are zero where the edge holds: as the energy's variation leaves them."""
            w, w1, w2, w3 = jet
            kk = (k**2).reshape((-1,) + (1,) * (w.ndim - 1))
            edge, outwards = self.ends[end], -1.0 if end == 0 else 1.0
            kind = "free" if edge is None else edge.kind
            if kind == "clamped":
                return w, w1
            if kind == "pinned":
                return w, w2
            springs = 0.0, 0.0
            if kind == "elastic":
                lossy = 1 + 1j * edge.loss_factor if losses else 1.0
                springs = lossy * edge.stiffness, lossy * edge.rotational_stiffness
            shear = -outwards * (d22 * w3 - (d12 + 4 * d66) * kk * w1)
            moment = outwards * (d22 * w2 - d12 * kk * w)
            return shear + springs[0] * w, moment + springs[1] * w1

        matrix = np.stack([row for end in (0, 1) for row in conditions(homogeneous[end], end)], 1)
        size = np.abs(matrix).max(axis=2, keepdims=True)
        loads = np.stack([np.stack([row for end in (0, 1) for row in conditions(jet_at_end(place, end), end)], 1) for place in places], 2)
        amplitudes = -np.linalg.solve(matrix / size, loads / size)
        result = np.zeros((len(places), len(places)), dtype=complex)
        for i, here in enumerate(places):
            if here == "mean":
                row = np.concatenate([(1 - decay) / s, (1 - decay) / s], 1) / b
            else:
                row = np.concatenate([np.exp(-s * here[1]), np.exp(-s * (b - here[1]))], 1)
            for j, source in enumerate(places):
                if here == "mean" and source != "mean":
                    continue
                own = 1 / (b * rest) if source == "mean" else free_space(abs(here[1] - source[1]), 0, 1.0)
                profile = own + np.einsum("mk,mk->m", row, amplitudes[:, :, j])
                result[i, j] = 2 / a * (along[i] * along[j] * profile).sum()
        if "mean" in places:
            at = places.index("mean")
            others = [i for i in range(len(places)) if i != at]
            result[at, others] = result[others, at]
        return result

    def _rest(self, functionals):
        """What the series of a place with itself lacks beyond `STILL_TERMS`: 2 sin^2 / (a k^3 2 D22 s1 s2 (s1 + s2)), s over k."""
        h = self.d12 + 2 * self.d66
        first, second = (h + sign * np.sqrt(h * h - self.d22 * self.d11 + 0j) for sign in (1, -1))
        s1, s2 = np.sqrt(first / self.d22), np.sqrt(second / self.d22)
        each = (1 / (2 * self.d22 * s1 * s2 * (s1 + s2))).real
        # The mean of sin^2 is a half; what its cosine leaves is smaller by the number of terms.
        sums = special.zeta(3, STILL_TERMS + 1) / 2 * 2 / self.a * (self.a / np.pi) ** 3 * each
        return np.diag([0.0 if f == "mean" else sums for f in functionals])

    # Answers.

    def accelerance(self, place, frequencies_hz):
        """Acceleration at a place per newton at each actuator alone: [frequency, actuator], m/s^2 per N."""
        eras = [(era.x, era.y) for era in self.scene.actuators]
        own = list(self.functionals)
        functionals = own + ([place] if place not in own else [])
        at, from_ = functionals.index(place), [functionals.index(era) for era in eras]
        result = []
        for hz in np.atleast_1d(frequencies_hz):
            omega = 2 * np.pi * hz
            bare = self.receptance(omega, functionals)
            held = np.zeros(len(functionals), dtype=complex)
            held[: len(own)] = self.impedances(omega)
            coupled = np.linalg.solve(np.eye(len(functionals)) + bare * held[None, :], bare)
            result.append(-(omega**2) * coupled[at, from_] * self.drives(omega))
        return np.array(result)

    def _excess(self, hz):
        """How many of the motions of what is attached push back more than they are pushed: it grows by one at each mode, and falls by one at each of
        the bare surface's and of the attachments' own."""
        omega = 2 * np.pi * hz
        held = self.impedances(omega, False)
        there = np.flatnonzero(held)
        bare = self.receptance(omega, self.functionals, False)[np.ix_(there, there)]
        bare = (bare + bare.T) / 2 + np.diag(1 / held[there])
        scale = 1 / np.sqrt(np.abs(np.diagonal(bare)))
        return int((np.linalg.eigvalsh(bare * scale[:, None] * scale[None, :]) > 0).sum())

    def mode_near(self, hz):
        """The undamped mode nearest to a frequency, in Hz, with all attached; None where there is none to be told apart."""
        part = NEAREST
        while part <= FARTHEST:
            low, high = hz * (1 - part), hz * (1 + part)
            at_low, at_high = self._excess(low), self._excess(high)
            if at_high == at_low + 1:
                while high - low > FOUND * hz:
                    middle = (low + high) / 2
                    if self._excess(middle) > at_low:
                        high = middle
                    else:
                        low = middle
                return (low + high) / 2
            if at_high != at_low:
                return None
            part *= 8
        return None
