"""Between the chip and the supply: what the chip's pins ask of the supply, and what its converter and comparators see."""

from chip import (
    ADC1, ADC2, ADC3, ADC4, ADSTART, CALFACT, CFGR, CFGR2, CLOCK_HZ, CONT, CONVERTER_CLOCKS, CONVERTING, CR, DAC1, DR, EOC_SET, FULL_SCALE_CODE,
    JDR1, JSQR, JSQR_PLACES, OVSR_SHIFT, OVSS_SHIFT, ROVSE, SAMPLING, SMP_BITS, SMPR1, SQR1, SQR1_PLACES, STARTED, STARTED_INJECTED,
    STARTED_REGULAR, SUPPLY_V, VREFINT_V, dac_code, dac_volts,
)
from pins import DISCHARGE_OPEN, HIGH_VOLTAGE_ENABLE

# What 3.3 V at an input stands for: rails in V, average current and fast shunt in A.
RAIL_FULL_SCALE_V = 2500.0
AVERAGE_FULL_SCALE_A = 2e-3
SHUNT_FULL_SCALE_A = 20e-3
# Input of ADC2 that carries the average current.
AVERAGE_INPUT = 7

# After a pause of a ms the first conversion may be wrong (errata sheet ES0430). The pause is judged while nothing is converted, up to a tick of the
# firmware's before the next conversion: half a ms is as long as one that may reach a ms by then.
PAUSE_CLOCKS = CLOCK_HZ // 2000
# For so long the result of a sequence stays as it is, in clocks: the firmware has read it by then.
READ_CLOCKS = CLOCK_HZ // 20_000
# A converter that was not calibrated is off by its offset, in codes: as far as CALFACT_S, 7 bits with a sign, can correct (RM0440, section 21.4.8).
UNCALIBRATED_CODES = 63
# A wrong code differs by half of the scale.
WRONG_BY = (FULL_SCALE_CODE + 1) // 2


def clamp(volts):
    return min(max(volts, 0.0), SUPPLY_V)


class Sequences:
    """When a converter's sequences are started, and so whether the first conversion of the next one is wrong."""

    def __init__(self, sim, converter):
        self.sim = sim
        self.address = converter + STARTED
        # Clock of the last start.
        self.started_at = None
        # The kinds of sequences whose first result is wrong.
        self.wrong = STARTED_REGULAR | STARTED_INJECTED

    def step(self, clock):
        started = self.sim.read_u32(self.address)
        if started:
            self.sim.write_u32(self.address, 0)
            self.started_at = clock
            # What has not been started comes soon after this, or not at all.
            self.wrong &= started
        elif self.started_at is None or clock - self.started_at > PAUSE_CLOCKS:
            self.wrong = STARTED_REGULAR | STARTED_INJECTED
        elif clock - self.started_at > READ_CLOCKS:
            self.wrong = 0


class Sensing:
    def __init__(self, sim, supply, pins, electrodes, defects):
        self.sim = sim
        self.pins = pins
        self.defects = defects
        self.sequences = {converter: Sequences(sim, converter) for converter in (ADC1, ADC3, ADC4)}
        self.supply = supply
        self.electrodes = electrodes
        self.clock = None
        self.written = None
        # When ADC2's mean began, and the sum of the current over time then.
        self.mean_began = None
        # Converter and input -> its voltage (DS12288, pin table; RM0440, connectivity of the converters).
        self.inputs = {
            (ADC1, 1): lambda: self.rail_input(0), (ADC1, 2): lambda: self.rail_input(1), (ADC1, 6): supply.bond_v,
            (ADC1, 7): self.average_input, (ADC1, 18): lambda: VREFINT_V,
            # PB13, and PB14, which is also input 5 of ADC1.
            (ADC3, 5): supply.interlock_v, (ADC4, 4): supply.emergency_stop_v, (ADC1, 5): supply.emergency_stop_v,
        }

    def step(self, clock):
        """Advances the supply to `clock` and puts its voltages where the next conversion finds them."""
        since = clock if self.clock is None else self.clock
        self.clock = clock
        asked = (
            [dac_volts(self.sim, DAC1, channel, "pin") / SUPPLY_V for channel in (0, 1)],
            self.pins.is_high(*HIGH_VOLTAGE_ENABLE), [self.pins.is_high(*pin) for pin in DISCHARGE_OPEN], self.pins.permit,
        )
        for until, high in self.electrodes.levels(since, clock):
            self.supply.step((until - since) / CLOCK_HZ, *asked, high)
            since = until
        self.convert_average(clock)
        for sequences in self.sequences.values():
            sequences.step(clock)
        results = {converter: self.injected_codes(converter) for converter in self.sequences}
        if not results[ADC1]:
            # Its clock is off, or it has not been set up.
            return
        last = self.regular_code(ADC1)
        if (results, last) != self.written:
            for converter, codes in results.items():
                for place, code in enumerate(codes):
                    self.sim.write_u32(converter + JDR1 + 4 * place, code)
            self.sim.write_u32(ADC1 + DR, last)
            self.written = (results, last)

    def convert_average(self, clock):
        """ADC2 in continuous mode with its oversampler (RM0440, section 21.4.31): the sum of 2^(OVSR + 1) conversions, shifted by OVSS."""
        read = self.sim.read_u32
        if not read(ADC2 + CR) & ADSTART or not read(ADC2 + CFGR) & CONT or not self.defects.average_is_converted:
            self.mean_began = None
            return
        now = (clock, self.supply.average_sum)
        if self.mean_began is None:
            self.mean_began = now
        control, channel = read(ADC2 + CFGR2), read(ADC2 + SQR1) >> SQR1_PLACES[0] & 0x1F
        ratio, shift = (2 << (control >> OVSR_SHIFT & 0b111), control >> OVSS_SHIFT & 0b1111) if control & ROVSE else (1, 0)
        sampling = SAMPLING[read(ADC2 + SMPR1) >> SMP_BITS * channel & 0b111]
        began, before = self.mean_began
        if clock - began < ratio * (sampling + CONVERTING) * CONVERTER_CLOCKS:
            return
        self.mean_began = now
        mean = self.supply.measured_current((now[1] - before) / ((clock - began) / CLOCK_HZ)) if channel == AVERAGE_INPUT else 0.0
        code = self.convert(ADC2, clamp(mean / AVERAGE_FULL_SCALE_A * SUPPLY_V), ratio)
        self.sim.write_u32(ADC2 + DR, code >> shift)
        self.sim.write_u32(ADC2 + EOC_SET, 1)

    def injected_codes(self, converter):
        """What a converter's injected sequence gives; empty if it has not been set up."""
        sequence = self.sim.read_u32(converter + JSQR)
        places = JSQR_PLACES[:(sequence & 0b11) + 1] if sequence else ()
        codes = [self.code(converter, sequence >> shift & 0x1F) for shift in places]
        if codes and self.sequences[converter].wrong & STARTED_INJECTED:
            codes[0] ^= WRONG_BY
        return codes

    def regular_code(self, converter):
        """What the data register holds: the last conversion of the regular sequence."""
        sequence = self.sim.read_u32(converter + SQR1)
        length = sequence & 0xF
        code = self.code(converter, sequence >> SQR1_PLACES[length] & 0x1F)
        return code ^ WRONG_BY if length == 0 and self.sequences[converter].wrong & STARTED_REGULAR else code

    def code(self, converter, channel):
        """What a conversion of an input gives."""
        # An input that nothing drives reads as nothing.
        volts = self.inputs[converter, channel]() if (converter, channel) in self.inputs else 0.0
        return self.convert(converter, volts, 1)

    def convert(self, converter, volts, count):
        """The sum of so many conversions. Every code is relative to the board's own supply."""
        full_scale = count * FULL_SCALE_CODE
        offset = 0 if self.sim.read_u32(converter + CALFACT) else count * UNCALIBRATED_CODES
        return min(round(volts / (SUPPLY_V * self.supply.reference) * full_scale) + offset, full_scale)

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
