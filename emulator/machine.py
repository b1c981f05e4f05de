"""The emulated board: the firmware image in labwired, with the time that the processor would sleep passed over.

labwired carries out every cycle, also those of a sleeping processor, which makes a second of this firmware last over a
minute. The firmware says when it has nothing to do (its symbol ERA_CPU_IDLE). All its time comes from TIM2, so this
module then sets TIM2's counter to just before its next event: what the firmware sees is the same, only sooner.
"""

import os
import pathlib

from labwired import Sim

BOARD = pathlib.Path(__file__).resolve().parent / "board" / "system.yaml"

# What runs at a time before the machine is looked at again. Longer than one tick of the firmware's device task takes,
# so that most ticks need one slice.
SLICE = "5us"

# The firmware is up within a millisecond; one that is not hangs.
BOOT_LIMIT_S = 0.1

# RM0440, section 2.2.2.
TIM2 = 0x4000_0000
CONTROL_BLOCKS = {"TIM1": 0x4001_2C00, "TIM8": 0x4001_3400}
GPIO = {"A": 0x4800_0000, "C": 0x4800_0800}
DAC1 = 0x5000_0800
RNG_DATA = 0x5006_0808
# RM0440, section 7.4.29: SFTRSTF and, as every reset pulls the pin low, PINRSTF.
RCC_CSR = 0x4002_1094
RESET_BY_SOFTWARE = 1 << 28 | 1 << 26
NVIC_ISPR = 0xE000_E200

# RM0440, section 28.6: offsets of the timer registers that decide what the electrodes do.
TIMER_REGISTERS = {
    "cr1": 0x00, "ccmr1": 0x18, "ccer": 0x20, "cnt": 0x24, "psc": 0x28, "arr": 0x2C,
    "ccr1": 0x34, "ccr2": 0x38, "bdtr": 0x44,
}

# Time base: one tick a microsecond, a 16-bit counter with events at half and full count, and an alarm in CCR2.
TICK_S = 1e-6
HALF_COUNT = 0x8000
FULL_COUNT = 0x10000
DIER, SR, CNT, CCR2 = 0x0C, 0x10, 0x24, 0x38
ALARM_ENABLED = 1 << 2
# The counter is set this many ticks before an event, as the model raises it when the counter passes it.
MARGIN_TICKS = 2

# RM0440, section 38.7: the receive register is not empty.
LPUART1_ISR = 0x4000_801C
RXNE = 1 << 5
LPUART1_INTERRUPT = 91

# What stack memory holds until the firmware writes there: a word that it hardly ever writes itself.
STACK_PAINT = 0x57AC_C01A

# firmware/src/pins.rs
PINS = {
    "era1_a": ("A", 8), "era1_b": ("A", 9), "era2_a": ("C", 6), "era2_b": ("C", 7),
    "high_voltage_enable": ("C", 10), "heartbeat": ("C", 12),
}
PIN_MODES = ("input", "output", "timer", "analog")


class Machine:
    """One board, powered up."""

    def __init__(self, elf):
        self.sim = Sim(elf, system=BOARD, uart="lpuart1")
        self.stir()
        self.paint_stack()
        self.idle_address = self.sim.symbol("ERA_CPU_IDLE")
        self.skipped_s = 0.0
        self.waiting = bytearray()

    def close(self):
        self.sim.close()

    def boot(self):
        """Runs until the firmware has nothing to do for the first time: its links are then open."""
        while not self.is_idle():
            if self.time_s > BOOT_LIMIT_S:
                raise RuntimeError(f"the firmware is not up after {BOOT_LIMIT_S} s of its own time")
            self.sim.run_for(SLICE)
        # From here on only the firmware itself can reset the processor; these are the flags that it then finds.
        self.sim.write_u32(RCC_CSR, RESET_BY_SOFTWARE)

    def stir(self):
        """Puts a fresh number into the hardware random number generator, from which the firmware takes one at every
        start. 0 would mean that it failed."""
        self.sim.write_u32(RNG_DATA, int.from_bytes(os.urandom(4), "little") | 1)

    def paint_stack(self):
        """Fills the memory that the stack can grow into, before the first instruction."""
        # cortex-m-rt: the stack grows down from _stack_start, and _stack_end is where variables end.
        self.stack_top = self.sim.symbol("_stack_start")
        self.stack_bottom = self.sim.symbol("_stack_end")
        for address in range(self.stack_bottom, self.stack_top, 4):
            self.sim.write_u32(address, STACK_PAINT)

    def stack(self):
        """Bytes of stack there are, and the most that were in use at once since power-up: down to the lowest word that
        was written."""
        words = self.sim.read_memory(self.stack_bottom, self.stack_top - self.stack_bottom)
        paint = STACK_PAINT.to_bytes(4, "little")
        untouched = 0
        while words[untouched:untouched + 4] == paint:
            untouched += 4
        return {"size": len(words), "used": len(words) - untouched}

    @property
    def time_s(self):
        """Virtual time since power-up in s."""
        return self.sim.time + self.skipped_s

    @property
    def cycles(self):
        """Cycles that were carried out; those that were passed over are not in it."""
        return self.sim.cycles

    def receive(self, data):
        """Bytes from the host to the board's UART."""
        self.waiting += data

    def transmitted(self):
        """Bytes that the board's UART has sent since the last call."""
        return self.sim.read_uart_bytes()

    def advance(self, until_s):
        """Runs one slice, then passes over idle time, but not beyond `until_s`."""
        if self.waiting:
            # The UART model takes a byte but raises no interrupt, so it is raised here, byte by byte. The next byte
            # waits until the firmware has taken this one, so a burst never overruns it; this is faster than a real line
            # at 115 200 baud, which would take 87 us for each.
            if not self.sim.read_u32(LPUART1_ISR) & RXNE:
                self.sim.send_bytes(self.waiting[:1])
                del self.waiting[0]
            word, bit = divmod(LPUART1_INTERRUPT, 32)
            self.sim.write_u32(NVIC_ISPR + 4 * word, 1 << bit)
        self.sim.run_for(SLICE)
        if not self.waiting and self.is_idle():
            self.pass_over_idle_time(until_s)
            self.stir()

    def is_idle(self):
        return self.sim.read_u32(self.idle_address) & 0xFF != 0

    def pass_over_idle_time(self, until_s):
        read = self.sim.read_u32
        enabled = read(TIM2 + DIER)
        if read(TIM2 + SR) & enabled:
            return  # An event is about to be served.
        count = read(TIM2 + CNT) & 0xFFFF
        events = [HALF_COUNT, FULL_COUNT]
        if enabled & ALARM_ENABLED:
            events.append(read(TIM2 + CCR2) & 0xFFFF)
        distance = min((event - count) % FULL_COUNT or FULL_COUNT for event in events)
        ticks = min(distance - MARGIN_TICKS, int((until_s - self.time_s) / TICK_S))
        if ticks > 0:
            self.sim.write_u32(TIM2 + CNT, (count + ticks) % FULL_COUNT)
            self.skipped_s += ticks * TICK_S

    def timers(self):
        """The registers of the electrodes' timers. CNT is the model's, which counts up only and stands still while time
        is passed over."""
        return {
            name: {register: self.sim.read_u32(base + offset) for register, offset in TIMER_REGISTERS.items()}
            for name, base in CONTROL_BLOCKS.items()
        }

    def pins(self):
        """Mode of each pin and, for an output, its level."""
        result = {}
        for name, (port, number) in PINS.items():
            mode = PIN_MODES[self.sim.read_u32(GPIO[port]) >> (2 * number) & 0b11]
            level = self.sim.read_u32(GPIO[port] + 0x14) >> number & 1
            result[name] = {"mode": mode, "high": bool(level) if mode == "output" else None}
        return result

    def rails(self):
        """Codes of the two rail set-points, 0 to 4095."""
        return [self.sim.read_u32(DAC1 + offset) & 0xFFF for offset in (0x08, 0x14)]
