"""The high-voltage supply outside the chip: two rails, their discharge switches, the current, the loops and the earth bond.

Everything is a first-order lag, advanced exactly for any step, so the step's length does not matter. It knows nothing of
the chip: sensing.py tells it what the pins ask for and tells the chip what it answers. Faults are attributes: faults.py.
"""

import math

FULL_SCALE_V = 2000.0
# How fast a rail follows its set-point, and how fast it falls with the discharge switch closed (the rail is shorted through
# the bleeder) and with it open and the supply off (leakage alone), all in s.
FOLLOW_S = 2e-3
DISCHARGE_S = 5e-3
LEAKAGE_S = 100e-3
# Smoothing and electrodes of one rail, in F: charged at the firmware's 20 V/ms it takes 20 uA.
RAIL_FARADS = 1e-9
# Divider and bleeder, in A for each rail at full voltage.
LOAD_A = 20e-6
# Both loops carry the 3.3 V of the board when closed. The bond pulls the earth input low against 330 ohm.
LOOP_CLOSED_V, LOOP_OPEN_V = 3.3, 0.0
BOND_CLOSED_V, BOND_OPEN_V = 0.05, 3.3
# The current averages over this long, in s.
AVERAGE_S = 1e-3


class Supply:
    """Rails in V, average current in A."""

    def __init__(self):
        self.rails = [0.0, 0.0]
        self.average_a = 0.0
        self.heal()

    def heal(self):
        """No faults."""
        self.interlock_closed = True
        self.emergency_stop_pressed = False
        self.bond_closed = True
        self.discharge_works = True
        # Rail -> the voltage that it is held at, whatever is asked of it.
        self.held = [None, None]
        # Rail -> its voltage as a share of the set-point; the measurement as a share of the voltage.
        self.gain = [1.0, 1.0]
        self.measurement = [1.0, 1.0]
        # Current through the fast shunt in A; the average current if it is not that of the rails.
        self.shunt_a = 0.0
        self.forced_average_a = None

    def step(self, seconds, set_points, enabled, discharge_open):
        """Advances by `seconds` with these set-points (0 to 1 of full scale), and the switches of supply and discharge."""
        charge = 0.0
        for rail, set_point in enumerate(set_points):
            before = self.rails[rail]
            if not discharge_open[rail] and self.discharge_works:
                target, lag = 0.0, DISCHARGE_S
            elif enabled and discharge_open[rail]:
                target, lag = set_point * FULL_SCALE_V * self.gain[rail], FOLLOW_S
            else:
                target, lag = 0.0, LEAKAGE_S
            after = target + (before - target) * math.exp(-seconds / lag)
            if self.held[rail] is not None:
                after = self.held[rail]
            self.rails[rail] = after
            if enabled:
                charge += max(after - before, 0.0) * RAIL_FARADS + LOAD_A * after / FULL_SCALE_V * seconds
        if seconds > 0.0:
            share = 1.0 - math.exp(-seconds / AVERAGE_S)
            self.average_a += (charge / seconds - self.average_a) * share

    def measured_rail(self, rail):
        """What the divider shows, in V."""
        return self.rails[rail] * self.measurement[rail]

    def measured_current(self):
        """In A."""
        return self.average_a if self.forced_average_a is None else self.forced_average_a

    def interlock_v(self):
        return LOOP_CLOSED_V if self.interlock_closed else LOOP_OPEN_V

    def emergency_stop_v(self):
        return LOOP_OPEN_V if self.emergency_stop_pressed else LOOP_CLOSED_V

    def bond_v(self):
        return BOND_CLOSED_V if self.bond_closed else BOND_OPEN_V
