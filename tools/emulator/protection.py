"""What switches the electrodes off with no software in the way: comparators, break inputs, OCREF clear, voltage detector.

Follows RM0440, sections 24 (COMP), 28.3.16 and 30.4.13 (break), 29.3.15 (clearing OCxREF) and 6.4 (PVD) for what this board connects.
A trip acts at the end of the slice in which it happens (5 us), where the chip takes tens of nanoseconds.
"""

from chip import COMP, DAC3, DAC4, EXTI, IRQ_PVD, IRQ_TIM16, PWR, SUPPLY_V, SYSCFG, VREFINT_V, dac_volts, pend
from timers import MOE, SR_SET

# COMP_CxCSR, section 24.5.
ENABLED, POLARITY, VALUE = 1 << 0, 1 << 15, 1 << 30
# INMSEL 000 to 011: quarters of VREFINT.
INMSEL_SHIFT, INMSEL_DAC = 4, 0b100

# BDTR, section 28.6.20: break enable and polarity.
BKE, BKP = 1 << 12, 1 << 13
# DIER.BIE; SR.BIF and SR.SBIF.
BIE, BIF, SBIF = 1 << 7, 1 << 7, 1 << 13
# AF1: BKCMPxE is bit x, BKCMPxP bit 9 + x for the first four.
BKCMPP_SHIFT = 9
# SYSCFG_CFGR2: lock-up, SRAM parity, PVD and flash ECC lead to the breaks.
CFGR2, PVDL = SYSCFG + 0x1C, 1 << 2

# Timers with a break input, and the interrupts of their breaks.
BREAK_INTERRUPTS = {"TIM1": 24, "TIM8": 43, "TIM20": 77}

# TIM4: OCxREF is cleared through ocref_clr_int (SMCR.OCCS = 0) from the comparator that AF2.OCRSEL counts from 0, where
# OCxCE allows it.
OCCS, OCRSEL_SHIFT, CLEAR_ENABLES = 1 << 3, 16, 1 << 7 | 1 << 15

# PWR_CR2.PVDE, PWR_SR2.PVDO; EXTI line 16.
CR2, SR2, PVDE, PVDO = PWR + 0x04, PWR + 0x14, 1 << 0, 1 << 11
IMR1, RTSR1, FTSR1, SWIER1, LINE_PVD = EXTI + 0x00, EXTI + 0x08, EXTI + 0x0C, EXTI + 0x10, 1 << 16


class Protection:
    def __init__(self, sim, sensing, supply, timers, defects):
        self.sim = sim
        self.defects = defects
        self.sensing = sensing
        self.supply = supply
        self.timers = timers
        # The board's own 3.3 V has sagged.
        self.supply_low = False
        self.low_before = False
        # Comparator -> its output.
        self.outputs = dict.fromkeys(range(1, 8), False)
        # Comparator -> the output that a broken one has.
        self.stuck = {}
        # Comparator -> the voltage that it sees in place of its input, which is not connected.
        self.disconnected = {}
        # Timers that are cleared until an update event finds the trip gone: name -> origin at the trip.
        self.cleared_at = {}

    def step(self, clock):
        self.compare()
        self.detect_voltage()
        for name, interrupt in BREAK_INTERRUPTS.items():
            if self.check_break(self.timers.timers[name], interrupt):
                self.timers.note(self.timers.timers[name], clock)
        self.check_break(self.timers.permit_timer, IRQ_TIM16)
        self.check_clear(self.timers.timers["TIM4"], clock)

    def inputs(self):
        """Comparator -> voltage at its input, with INPSEL = 0 for all of them."""
        connected = {
            1: self.sensing.rail_input(1), 3: self.sensing.rail_input(0), 4: self.sensing.shunt_input(),
            5: self.supply.interlock_v(), 7: self.supply.emergency_stop_v(),
        }
        return connected | self.disconnected

    def threshold(self, comparator, control):
        select = control >> INMSEL_SHIFT & 0b111
        if select < INMSEL_DAC:
            return VREFINT_V * (select + 1) / 4
        if select == INMSEL_DAC:
            # Table of the comparators' inverting inputs. Like every code of the chip's converters, relative to the board's own supply.
            converter, channel = {1: (DAC3, 0), 3: (DAC3, 0), 4: (DAC3, 1), 5: (DAC4, 0), 7: (DAC4, 0)}[comparator]
            return dac_volts(self.sim, converter, channel, "inside") * self.supply.reference
        # Nothing else is connected on this board: an open input is never above it.
        return SUPPLY_V

    def compare(self):
        for comparator, volts in self.inputs().items():
            address = COMP + 4 * (comparator - 1)
            control = self.sim.read_u32(address)
            output = False
            if control & ENABLED:
                output = (volts > self.threshold(comparator, control)) != bool(control & POLARITY)
                output = self.stuck.get(comparator, output)
            self.outputs[comparator] = output
            value = control & ~VALUE | (VALUE if output else 0)
            if value != control:
                self.sim.write_u32(address, value)

    def detect_voltage(self):
        low = self.supply_low and bool(self.sim.read_u32(CR2) & PVDE)
        if low == self.low_before:
            return
        self.low_before = low
        self.sim.write_u32(SR2, PVDO if low else 0)
        # PVDO rises when the supply falls.
        if self.sim.read_u32(RTSR1 if low else FTSR1) & self.sim.read_u32(IMR1) & LINE_PVD:
            self.sim.write_u32(SWIER1, LINE_PVD)
            pend(self.sim, IRQ_PVD)

    def check_break(self, timer, interrupt):
        """Whether a break has cleared the timer's main output enable now."""
        bdtr = timer.read("bdtr")
        if not bdtr & BKE or timer.name in self.defects.dead_breaks:
            return False
        flags = 0
        if self.break_requested(timer.read("af1"), active_high=bool(bdtr & BKP)):
            flags |= BIF
        if self.low_before and self.sim.read_u32(CFGR2) & PVDL:
            flags |= SBIF
        if not flags:
            return False
        # Sets the flag and clears MOE, at the next clock.
        self.sim.write_u32(timer.base + SR_SET, flags)
        if bdtr & MOE:
            timer.write("bdtr", bdtr & ~MOE)
        if timer.read("dier") & BIE:
            pend(self.sim, interrupt)
        return bool(bdtr & MOE)

    def break_requested(self, af1, active_high):
        for comparator, output in self.outputs.items():
            if af1 >> comparator & 1:
                inverted = comparator <= 4 and af1 >> (BKCMPP_SHIFT + comparator) & 1
                if (output != bool(inverted)) == active_high:
                    return True
        return False

    def check_clear(self, timer, clock):
        tripped = False
        if timer.read("smcr") & OCCS == 0 and (timer.read("ccmr1") | timer.read("ccmr2")) & CLEAR_ENABLES:
            tripped = self.outputs[(timer.read("af2") >> OCRSEL_SHIFT & 0b111) + 1]
        cleared = tripped
        if not tripped and timer.name in self.cleared_at:
            # Low until the next update event.
            cleared = timer.origin == self.cleared_at[timer.name] and timer.running
        if tripped:
            self.cleared_at[timer.name] = timer.origin
        elif not cleared:
            self.cleared_at.pop(timer.name, None)
        if cleared != self.timers.cleared[timer.name]:
            self.timers.cleared[timer.name] = cleared
            self.timers.note(timer, clock)
