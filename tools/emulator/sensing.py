"""Between the chip and the supply: what the chip's pins ask of the supply, and what its converter and comparators see."""

from chip import ADC1, CLOCK_HZ, DAC1, FULL_SCALE_CODE, JDR1, SUPPLY_V, dac_code, is_driven_high
from pins import DISCHARGE_OPEN, HIGH_VOLTAGE_ENABLE

# What 3.3 V at an input stands for: rails in V, average current and fast shunt in A.
RAIL_FULL_SCALE_V = 2500.0
AVERAGE_FULL_SCALE_A = 2e-3
SHUNT_FULL_SCALE_A = 20e-3


def clamp(volts):
    return min(max(volts, 0.0), SUPPLY_V)


class Sensing:
    def __init__(self, sim, supply):
        self.sim = sim
        self.supply = supply
        self.clock = None
        self.written = None

    def step(self, clock):
        """Advances the supply to `clock` and puts its voltages where the next conversion finds them."""
        elapsed = 0 if self.clock is None else clock - self.clock
        self.clock = clock
        codes = self.set_points()
        self.supply.step(
            elapsed / CLOCK_HZ, [code / FULL_SCALE_CODE for code in codes],
            is_driven_high(self.sim, *HIGH_VOLTAGE_ENABLE), [is_driven_high(self.sim, *pin) for pin in DISCHARGE_OPEN],
        )
        volts = [self.rail_input(0), self.rail_input(1), self.average_input(), self.supply.bond_v()]
        results = [round(volt / SUPPLY_V * FULL_SCALE_CODE) for volt in volts]
        if results != self.written:
            for place, result in enumerate(results):
                self.sim.write_u32(ADC1 + JDR1 + 4 * place, result)
            # The converter takes writes only once its clock is on; the last result is never 0.
            self.written = results if self.sim.read_u32(ADC1 + JDR1 + 12) == results[3] else None

    def set_points(self):
        """Codes of the two rail set-points, 0 to 4095."""
        return [dac_code(self.sim, DAC1, channel) for channel in (0, 1)]

    # Voltages at the chip's inputs.

    def rail_input(self, rail):
        return clamp(self.supply.measured_rail(rail) / RAIL_FULL_SCALE_V * SUPPLY_V)

    def average_input(self):
        return clamp(self.supply.measured_current() / AVERAGE_FULL_SCALE_A * SUPPLY_V)

    def shunt_input(self):
        return clamp(self.supply.shunt_a / SHUNT_FULL_SCALE_A * SUPPLY_V)
