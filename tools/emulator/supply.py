"""The high-voltage circuit outside the chip: two rails, their discharge switches, the electrodes, the current, the loops and the earth bond.

Everything is a first-order lag, advanced exactly for any step in which nothing is switched, so the step's length does not matter much. It
knows nothing of the chip: sensing.py tells it what the pins ask for and tells the chip what it answers. Faults are attributes: faults.py.

A supply can only push. It follows its set-point with a lag and feeds its rail through a resistor; an electrode takes its charge from the
rail's capacitance, which the supply then replaces.
"""

import math

FULL_SCALE_V = 2000.0
# How fast the supply follows its set-point (from 10 to 90 % of a step in 5 ms), and a rail its supply through this resistor.
FOLLOW_S = 5e-3 / math.log(9)
RAIL_FARADS = 1.8e-9
SOURCE_OHM = 47e3
# One electrode with its cable and switches in F; what charges and discharges it, and what a short behind it leaves, in ohm.
ELECTRODE_FARADS, UPPER_OHM, LOWER_OHM = 116e-12, 1e6, 100e3
# What a closed discharge switch leads to ground through, in ohm. How fast a rail falls with it closed, and with it open and the supply off (divider
# and bleeder of 100 Mohm each), in s.
DISCHARGE_OHM = 1e6
DISCHARGE_S = DISCHARGE_OHM * RAIL_FARADS
LEAKAGE_S = 50e6 * RAIL_FARADS
# Divider and bleeder of one rail.
BLEEDERS_OHM = 50e6
# Both loops are fed by the 3.3 V of the board. Closed, their end resistor of 5.1 kohm and 10 kohm to ground divide them. The bond, with 10 ohm in series, pulls the earth input low against 330 ohm.
LOOP_OPEN_V, LOOP_CLOSED_V, LOOP_SHORTED_V = 0.0, 3.3 * 10e3 / (10e3 + 5.1e3), 3.3
BOND_FED_V, BOND_ABOVE_OHM, BOND_BELOW_OHM = 3.3, 330.0, 10.0
# The current averages over this long, in s.
AVERAGE_S = 1e-3


class Supply:
    """Rails in V, average current in A."""

    def __init__(self):
        self.rails = [0.0, 0.0]
        # What each supply delivers at its output, behind its lag.
        self.followed = [0.0, 0.0]
        # ERA and electrode -> its voltage. The rails feed the odd and the even ERAs.
        self.electrodes = {(era, electrode): 0.0 for era in range(4) for electrode in "ab"}
        self.average_a = 0.0
        # Its sum over time, in As.
        self.average_sum = 0.0
        self.heal()

    def heal(self):
        """No faults."""
        # Capacitance of a rail in F, and the resistances behind an electrode relative to their nominal values.
        self.rail_farads, self.electrode_ohms = RAIL_FARADS, 1.0
        # Levels of the loops in V, with 3.3 V of supply.
        self.interlock_level_v = LOOP_CLOSED_V
        self.emergency_stop_level_v = LOOP_CLOSED_V
        # Resistance of panel and masses to protective earth in ohm; None: open. Whether what feeds the loop is there.
        self.bond_ohm = 5.0
        self.bond_fed = True
        self.discharge_works = True
        # Whether the switches follow their own lines; where they do not, these say "open".
        self.discharge_lines_work = True
        # Rail -> the voltage that it is held at, whatever is asked of it.
        self.held = [None, None]
        # Rail -> its voltage as a share of the set-point; the measurement as a share of the voltage.
        self.gain = [1.0, 1.0]
        self.measurement = [1.0, 1.0]
        # The board's own supply at VREF+ as a share of 3.3 V: every code of the converters is relative to it.
        self.reference = 1.0
        # The supply delivers though it is disabled; the measurements of the rails are exchanged.
        self.enable_stuck = False
        # The gates outside that do not follow the permit: of "enable" and "discharge".
        self.permit_ignored = ()
        self.crossed = False
        # Electrode -> how it is broken: see faults.py.
        self.broken = {}
        # Current through the fast shunt in A; the average current if it is not that of the rails.
        self.shunt_a = 0.0
        self.forced_average_a = None

    def step(self, seconds, set_points, enabled, discharge_open, permitted, high=frozenset()):
        """Advances by `seconds` with these set-points (0 to 1 of full scale), the switches of supply and discharge, the permit that gates
        both, and these electrodes switched to their rails."""
        if seconds <= 0.0:
            return
        if not self.discharge_lines_work:
            discharge_open = [True] * len(discharge_open)
        if not permitted and "discharge" not in self.permit_ignored:
            discharge_open = [False] * len(discharge_open)
        enabled = (enabled and (permitted or "enable" in self.permit_ignored)) or self.enable_stuck
        # What flows through broken electrodes all the time, in A.
        drawn_a = [0.0, 0.0]
        for electrode in self.electrodes:
            self.step_electrode(electrode, electrode in high, seconds, drawn_a)
        charge = 0.0
        for rail, set_point in enumerate(set_points):
            before, load_a = self.rails[rail], drawn_a[rail]
            wanted = set_point * FULL_SCALE_V * self.gain[rail]
            self.followed[rail] = approach(self.followed[rail], wanted, seconds, FOLLOW_S) if enabled else before
            discharges = not discharge_open[rail] and self.discharge_works
            if enabled and self.followed[rail] >= before:
                # A closed switch does not stop the supply: 47 kohm against 1 Mohm.
                closed_siemens = 1 / DISCHARGE_OHM if discharges else 0.0
                siemens = 1 / SOURCE_OHM + closed_siemens
                after = approach(before, (self.followed[rail] / SOURCE_OHM - load_a) / siemens, seconds, self.rail_farads / siemens)
                leaving_a = before * (1 / BLEEDERS_OHM + closed_siemens) + load_a
                charge += max((after - before) * self.rail_farads + leaving_a * seconds, 0.0)
            elif discharges:
                after = approach(before, 0.0, seconds, DISCHARGE_OHM * self.rail_farads)
            else:
                after = approach(before, 0.0, seconds, BLEEDERS_OHM * self.rail_farads) - load_a * seconds / self.rail_farads
            if self.held[rail] is not None:
                after = self.held[rail]
            self.rails[rail] = max(after, 0.0)
        current = charge / seconds
        before, self.average_a = self.average_a, approach(self.average_a, current, seconds, AVERAGE_S)
        self.average_sum += current * seconds + (before - current) * AVERAGE_S * (1.0 - math.exp(-seconds / AVERAGE_S))

    def step_electrode(self, electrode, high, seconds, drawn_a):
        """Charges or discharges one electrode. Its charge comes from its rail's capacitance; what flows on and on is added to `drawn_a`."""
        is_broken = self.broken.get(electrode)
        rail, volts = electrode[0] % 2, self.electrodes[electrode]
        if is_broken == "open":
            return
        if high and is_broken in ("shorted", "lower_stuck"):
            resistance = self.electrode_ohms * (UPPER_OHM + (LOWER_OHM if is_broken == "lower_stuck" else 0.0))
            drawn_a[rail] += self.rails[rail] / resistance
        elif high:
            both = ELECTRODE_FARADS * self.rail_farads / (ELECTRODE_FARADS + self.rail_farads)
            charge = (self.rails[rail] - volts) * both * (1.0 - math.exp(-seconds / (self.electrode_ohms * UPPER_OHM * both)))
            self.electrodes[electrode] = volts + charge / ELECTRODE_FARADS
            self.rails[rail] -= charge / self.rail_farads
        elif volts and is_broken != "lower_open":
            self.electrodes[electrode] = approach(volts, 0.0, seconds, self.electrode_ohms * LOWER_OHM * ELECTRODE_FARADS) if volts > 1e-3 else 0.0

    def measured_rail(self, rail):
        """What the divider shows, in V."""
        return self.rails[1 - rail if self.crossed else rail] * self.measurement[rail]

    def measured_current(self, average_a=None):
        """In A: the present average, or another mean of it."""
        if self.forced_average_a is not None:
            return self.forced_average_a
        return self.average_a if average_a is None else average_a

    def interlock_v(self):
        return self.interlock_level_v * self.reference

    def emergency_stop_v(self):
        return self.emergency_stop_level_v * self.reference

    def bond_v(self):
        if self.bond_ohm is None:
            return BOND_FED_V if self.bond_fed else 0.0
        below = self.bond_ohm + BOND_BELOW_OHM
        return BOND_FED_V * below / (below + BOND_ABOVE_OHM) if self.bond_fed else 0.0


def approach(value, target, seconds, lag):
    """A first-order lag."""
    return target + (value - target) * math.exp(-seconds / lag)
