"""Which electrodes are switched to their rails, and when: by the windows of their timers, or as plain outputs of their ports.

Follows RM0440, section 28.3.13: with an output channel in combined PWM mode 2 and the other one of its pair in PWM mode 1, the output is
on while the count is not below its own compare value and below the other one's.
"""

from pins import ELECTRODES

# The other channel of each channel's pair.
OTHER = {1: 2, 2: 1, 3: 4, 4: 3}


class Electrodes:
    def __init__(self, timers, pins):
        self.timers = timers
        self.pins = pins

    def levels(self, since, until):
        """The stretches of the time from `since` to `until`, in clocks: the end of each, and the electrodes that are high in it."""
        if since >= until:
            return []
        held = self.held_high()
        windows = list(self.windows(since, until))
        if not windows:
            return [(until, frozenset(held))]
        edges = sorted({edge for _, begin, end in windows for edge in (begin, end) if since < edge < until} | {until})
        result, before = [], since
        for edge in edges:
            middle = (before + edge) / 2
            result.append((edge, frozenset(held + [key for key, begin, end in windows if begin <= middle < end])))
            before = edge
        return result

    def held_high(self):
        """Electrodes whose pads are high without their timers. Without the permit a gate outside holds those of TIM4 low."""
        return [
            (era, electrode)
            for era, (timer, *pins) in enumerate(ELECTRODES.values())
            for electrode, (port, number, *_) in zip("ab", pins)
            if self.pins.is_high(port, number) and (timer != "TIM4" or self.pins.permit)
        ]

    def windows(self, since, until):
        """Every window between these clocks, of the timers whose outputs reach their pins: electrode, begin, end."""
        for era, (timer_name, *pins) in enumerate(ELECTRODES.values()):
            timer = self.timers.timers[timer_name]
            if not self.timers.outputs(timer):
                continue
            for origin, shadow, begins, ends in timer.stretches(since, until):
                tick, period = shadow["psc"] + 1, (shadow["psc"] + 1) * (shadow["arr"] + 1)
                for electrode, (_, _, _, channel) in zip("ab", pins):
                    on, off = shadow["ccr"][channel - 1], min(shadow["ccr"][OTHER[channel] - 1], shadow["arr"] + 1)
                    if on >= off:
                        continue
                    zero = origin + (begins - origin) // period * period
                    while zero < ends:
                        yield (era, electrode), max(zero + on * tick, begins), min(zero + off * tick, ends)
                        zero += period
