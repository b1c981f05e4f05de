"""Pulses of the electrodes, rebuilt from what is written to their timers' registers, and judged by what a request means.

This is an oracle of its own: it shares nothing with the firmware and its crates, nor with timers.py and electrodes.py. It gets the
registers as they are written, and the requests as physical quantities, and keeps preload and active registers itself.

The rules are those of RM0440, chapters "Advanced-control timers" and "General-purpose timers", by their sections:
- Time-base unit, Upcounting mode, Downcounting mode: PSC, ARR, ARPE, UDIS, EGR.UG, update events;
- Repetition counter; One-pulse mode;
- PWM mode, Combined PWM mode, Forced output mode, and the preload of the compare values (OCxPE);
- Using the break function; table "Output control bits for complementary tim_ocx and tim_ocxn channels with break feature": MOE, OSSI,
  OSSR, AOE, CCxE, CCxNE, CCxP and the idle levels OISx, without dead time;
- Timer synchronization, slave mode: trigger mode.
Other modes (centre-aligned, dithering, asymmetric, output compare, preloaded control bits) are refused.
"""

from collections import namedtuple
from itertools import pairwise

CLOCK_HZ = 170_000_000
# Timer -> the outputs that are electrodes A and B (DS12288, table 13).
OUTPUTS = {"TIM1": (1, 3), "TIM8": (1, 4), "TIM20": (1, 3), "TIM4": (1, 4)}
BASES = {"TIM1": 0x4001_2C00, "TIM8": 0x4001_3400, "TIM20": 0x4001_5000, "TIM4": 0x4000_0800, "TIM3": 0x4000_0400}
# Section "TIMx registers"; what changed between two looks is carried out in this order.
REGISTERS = {
    "cr2": 0x04, "smcr": 0x08, "ccmr1": 0x18, "ccmr2": 0x1C, "psc": 0x28, "arr": 0x2C, "rcr": 0x30, "ccr1": 0x34, "ccr2": 0x38,
    "ccr3": 0x3C, "ccr4": 0x40, "egr": 0x14, "ccer": 0x20, "bdtr": 0x44, "cr1": 0x00,
}
CEN, UDIS, OPM, DIR, CMS, ARPE, DITHEN = 1 << 0, 1 << 1, 1 << 3, 1 << 4, 0b11 << 5, 1 << 7, 1 << 12
OSSI, OSSR, BKE, AOE, MOE = 1 << 10, 1 << 11, 1 << 12, 1 << 14, 1 << 15
UG = 1 << 0
CCPC = 1 << 0
# TIM3's CR2.MMS = 0001 tells of its CEN; SMCR: SMS = 0110 is trigger mode, TS = 00010 is ITR2, which is TIM3.
SLAVE_MASK, SLAVE_OF_TIM3, MASTER_MASK, MASTER_TELLS_ENABLE = 0x31_0077, 0x26, 0x200_0070, 0x10
# Where OCxPE and OCxM of a register's first channel are.
OCPE_SHIFT, OCM_SHIFT, OCM_3_SHIFT = 3, 4, 16
# OCxM; the combined modes join a channel's own reference, which is that of PWM mode 1 or 2, with that of its neighbour.
FROZEN, FORCED, PWM_1, PWM_2, COMBINED = 0b0000, (0b0100, 0b0101), (0b0110, 0b1100), (0b0111, 0b1101), {0b1100: any, 0b1101: all}


class PulseTimer:
    """One timer. Clocks are those of its input."""

    def __init__(self, has_break):
        self.has_break = has_break
        self.written = dict.fromkeys(REGISTERS, 0) | {"arr": 0xFFFF}
        self.psc, self.arr, self.ccr, self.repetitions = 0, 0xFFFF, [0] * 4, 0
        # Now, the count, and clocks of the present tick.
        self.clock = self.count = self.part = 0
        self.is_broken = False
        self.references = [False] * 4
        # For each channel since when its output has which level: 0, 1, or None while the timer does not drive it.
        self.levels = [[(0, None)] for _ in range(4)]

    def write_register(self, register, value):
        self.written[register] = value
        cr1 = self.written["cr1"]
        if cr1 & (CMS | DITHEN) or self.written["cr2"] & CCPC:
            raise ValueError(f"{register} = {value:#x}: a mode that is not rebuilt")
        if register == "egr" and value & UG:
            self.part = 0
            self.begin_period()
        self.set_break(self.is_broken)
        if not cr1 & ARPE:
            self.arr = self.written["arr"]
        for channel in range(4):
            if not self.read_compare_mode(channel)[1]:
                self.ccr[channel] = self.written[f"ccr{channel + 1}"]

    def set_break(self, is_active):
        """The break input; while it is active MOE is not kept."""
        self.is_broken = is_active
        if is_active and self.written["bdtr"] & BKE:
            self.written["bdtr"] &= ~MOE

    def read_compare_mode(self, channel):
        """OCxM, whose highest bit lies apart, and OCxPE."""
        bits = self.written["ccmr1" if channel < 2 else "ccmr2"] >> 8 * (channel % 2)
        return bits >> OCM_SHIFT & 0b111 | (bits >> OCM_3_SHIFT & 1) << 3, bits >> OCPE_SHIFT & 1

    def begin_period(self, is_due=True):
        """The counter begins anew, with an update event if it is due."""
        if is_due and not self.written["cr1"] & UDIS:
            self.psc, self.arr, self.repetitions = (self.written[name] for name in ("psc", "arr", "rcr"))
            self.ccr = [self.written[f"ccr{channel}"] for channel in (1, 2, 3, 4)]
            if self.written["bdtr"] & AOE and not self.is_broken:
                self.written["bdtr"] |= MOE
        self.count = self.arr if self.written["cr1"] & DIR else 0

    def pass_overflow(self):
        is_due = self.repetitions == 0
        self.repetitions -= not is_due
        self.begin_period(is_due)
        if is_due and self.written["cr1"] & OPM:
            self.written["cr1"] &= ~CEN

    def run_until(self, until):
        while self.clock < until:
            if not self.written["cr1"] & CEN or self.arr == 0:
                self.clock = until
                break
            step = -1 if self.written["cr1"] & DIR else 1
            # A counter that is beyond a smaller ARR goes on to its last value.
            overflow = self.count + 1 if step < 0 else (self.arr + 1 if self.count <= self.arr else 0x1_0000) - self.count
            ahead = min(ticks for ticks in (overflow, *((compare - self.count) * step for compare in self.ccr)) if ticks > 0)
            clocks = min(ahead * (self.psc + 1) - self.part, until - self.clock)
            self.clock += clocks
            ticks, self.part = divmod(self.part + clocks, self.psc + 1)
            self.count += ticks * step
            if ticks == overflow:
                self.pass_overflow()
            self.note_levels()

    def note_levels(self):
        down = self.written["cr1"] & DIR
        for channel, compare in enumerate(self.ccr):
            mode, _ = self.read_compare_mode(channel)
            is_below = self.count <= compare if down else self.count < compare
            if mode in FORCED:
                self.references[channel] = mode == FORCED[1]
            elif mode in PWM_1 or mode in PWM_2:
                self.references[channel] = is_below == (mode in PWM_1)
            elif mode != FROZEN:
                raise ValueError(f"compare mode {mode:04b} is not rebuilt")
        for channel, noted in enumerate(self.levels):
            level = self.compute_output_level(channel)
            if noted[-1][1] != level:
                noted.append((self.clock, level))

    def compute_output_level(self, channel):
        enabled, low_active, other_enabled = (self.written["ccer"] >> 4 * channel + bit & 1 for bit in (0, 1, 2))
        bdtr = self.written["bdtr"] if self.has_break else MOE
        if not bdtr & MOE:
            return self.written["cr2"] >> 8 + 2 * channel & 1 if bdtr & OSSI and (enabled or other_enabled) else None
        if not enabled:
            return low_active if bdtr & OSSR and other_enabled else None
        combine = COMBINED.get(self.read_compare_mode(channel)[0])
        pair = self.references[channel], self.references[channel ^ 1]
        return (combine(pair) if combine else pair[0]) ^ low_active


def record_registers(machine):
    """A list that grows with every change of the timers' registers: clock, and timer -> register -> value. They are looked at once in a
    slice (5 us), so what is written counts up to that much later; CEN after a trigger and MOE after a break are the emulator's."""
    snapshots, step = [], machine.timers.step

    def record_and_step(clock):
        read = machine.sim.read_u32
        snapshot = {timer: {name: read(base + offset) for name, offset in REGISTERS.items()} for timer, base in BASES.items()}
        if not snapshots or snapshots[-1][1] != snapshot:
            snapshots.append((clock, snapshot))
        step(clock)

    machine.timers.step = record_and_step
    return snapshots


def rebuild_levels(snapshots, until):
    """For each timer the levels of its electrodes A and B, each a list of the clocks of changes with the level from then on."""
    timers = {name: PulseTimer(has_break=name != "TIM4") for name in OUTPUTS}
    last = {name: {} for name in BASES}
    for clock, snapshot in snapshots:
        was_running, master = last["TIM3"].get("cr1", 0) & CEN, snapshot["TIM3"]
        for name, timer in timers.items():
            timer.run_until(clock)
            for register in REGISTERS:
                if snapshot[name][register] != last[name].get(register):
                    timer.write_register(register, snapshot[name][register])
            is_slave = timer.written["smcr"] & SLAVE_MASK == SLAVE_OF_TIM3 and master["cr2"] & MASTER_MASK == MASTER_TELLS_ENABLE
            if is_slave and master["cr1"] & CEN and not was_running:
                timer.written["cr1"] |= CEN
            timer.note_levels()
        last = snapshot
    for timer in timers.values():
        timer.run_until(until)
    return {name: {key: timers[name].levels[output - 1] for key, output in zip("ab", outputs)} for name, outputs in OUTPUTS.items()}


# The electrodes of one ERA, each on for `width` of its half period, centred in it, B half a period after A. The force pulls towards A
# and follows cos(2 pi (frequency t + phase)), with one t for all ERAs.
Drive = namedtuple("Drive", "frequency_hz width phase_turns volts")
Pulse = namedtuple("Pulse", "electrode begin end")
GUARD = CLOCK_HZ * 200e-6
# Two ticks of a timer, which makes at least 40 000 in a period, as part of the period; how exact a frequency is; the tick of windows.
TWO_TICKS, FREQUENCY_ERROR, WINDOW_TICK = 2 / 40_000, 20e-6, 17


def compute_centre(pulse):
    return (pulse.begin + pulse.end) / 2


def list_pulses(levels, since, until):
    """The pulses of one ERA that lie wholly between these clocks, by time."""
    pulses = [Pulse(key, begin, end) for key, changes in levels.items() for (begin, level), (end, _) in pairwise(changes) if level == 1]
    return sorted((pulse for pulse in pulses if since <= pulse.begin < pulse.end <= until), key=lambda pulse: pulse.begin)


def judge_pins(levels, since, until):
    """What is wrong with the pins of one ERA whatever was requested: they float, or are high together or too soon after each other."""
    ended = {key: [*(change for change in changes if change[0] < until), (until, 0)] for key, changes in levels.items()}
    return [
        f"{key} floats at {begin}" for key, changes in ended.items() for (begin, level), (end, _) in pairwise(changes)
        if level is None and end > since
    ] + [
        f"{'together' if second.begin < first.end else 'guard too short'} at {second.begin}"
        for first, second in pairwise(list_pulses(ended, 0, until)) if second.begin < first.end + GUARD
    ]


def judge_pair(drive, a, b):
    """What is wrong with a pulse of A and the following one of B."""
    half = CLOCK_HZ / drive.frequency_hz / 2
    wanted_and_seen = {
        "width of A": (half * drive.width, a.end - a.begin), "width of B": (half * drive.width, b.end - b.begin),
        "half period": (half, compute_centre(b) - compute_centre(a)), "guard": (half * (1 - drive.width), b.begin - a.end),
    }
    return [
        f"{name} is {seen}, not {wanted:.1f} clocks at {a.begin}" for name, (wanted, seen) in wanted_and_seen.items()
        if abs(seen - wanted) > 2 * half * TWO_TICKS
    ]


def judge_drives(pulses, drives):
    """What is wrong with the pulses of an ERA that went from one of these drives to the next: every A with its B belongs to one of them,
    and from B to the next A there is what both leave of their periods, and more only where the drive changes."""
    if pulses and pulses[0].electrode == "b":
        pulses = pulses[1:]
    pairs = list(zip(pulses[::2], pulses[1::2]))
    if len(pairs) < 2 or any(a.electrode + b.electrode != "ab" for a, b in pairs):
        return [f"A and B do not take turns in {len(pulses)} pulses"]
    judged = [min(((judge_pair(drive, *pair), place) for place, drive in enumerate(drives)), key=lambda of: len(of[0])) for pair in pairs]
    wrong, used = [text for texts, _ in judged for text in texts], [place for _, place in judged]
    if used != sorted(used) or used[-1] != len(drives) - 1:
        wrong.append("the drives do not follow each other")
    for (before, after), (pair, following) in zip(pairwise(used), pairwise(pairs)):
        quarters = [CLOCK_HZ / drives[place].frequency_hz / 4 for place in (before, after)]
        late, allowed = compute_centre(following[0]) - compute_centre(pair[1]) - sum(quarters), 4 * max(quarters) * TWO_TICKS
        if late < -allowed or before == after and late > allowed:
            wrong.append(f"next half period is {late:.1f} clocks late at {pair[1].begin}")
    period = (pairs[-1][0].begin - pairs[0][0].begin) / (len(pairs) - 1)
    if len(drives) == 1 and abs(period * drives[0].frequency_hz / CLOCK_HZ - 1) > FREQUENCY_ERROR:
        wrong.append(f"period is {period:.1f} clocks")
    return wrong


def judge_phase(drives, pulses):
    """What is wrong with the phase of two ERAs at one frequency: each pulls most towards A where frequency t + phase is whole."""
    last = [[compute_centre(pulse) for pulse in some if pulse.electrode == "a"][-1:] for some in pulses]
    if not all(last):
        return ["no phase without pulses"]
    turns = (last[1][0] - last[0][0]) * drives[0].frequency_hz / CLOCK_HZ + drives[1].phase_turns - drives[0].phase_turns
    off = (turns + 0.5) % 1 - 0.5
    return [f"phase is off by {off:.5f} turns"] if abs(off) > TWO_TICKS else []


def judge_windows(windows, pulses, start):
    """What is wrong with the pulses of an ERA that got windows, each an electrode, ticks of wait and ticks of width, from `start` on."""
    at, wanted = start, []
    for electrode, wait, width in windows:
        begin, at = at + WINDOW_TICK * wait, at + WINDOW_TICK * (wait + width)
        wanted.append(Pulse(electrode, begin, at))
    return [] if pulses == wanted else [f"windows are {pulses}, not {wanted}"]
