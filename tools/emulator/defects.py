"""What is wrong with the board's parts, apart from its high-voltage supply (supply.py). No reset of the chip changes any of it."""

# FLASH_OPTR as the factory delivers it (RM0440, section 3.4.1).
OPTION_BYTES = 0xFFEF_F8AA


class Defects:
    def __init__(self):
        self.heal()

    def heal(self):
        """No faults."""
        # Port and number of a pin -> the level that its pad has, whatever drives it.
        self.stuck_pins = {}
        # Pairs of pins whose pads touch: high if one of them is driven high.
        self.joined_pins = []
        # The resistors that hold a pin low that nothing drives.
        self.pull_downs_work = True
        self.watchdog_works = True
        # It takes no settings after it has reset the chip, and keeps its longest time.
        self.watchdog_is_slow = False
        # ADC2 delivers the average current.
        self.average_is_converted = True
        # Timers that no break reaches.
        self.dead_breaks = set()
        # Frequency of the watchdog's oscillator as a share of 32 kHz; 0: it stands still.
        self.lsi = 1.0
        # What a reset loads into FLASH_OPTR.
        self.option_bytes = OPTION_BYTES
