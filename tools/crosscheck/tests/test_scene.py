"""The reader of scene files: it knows every key of random scenes, and refuses those that it does not know."""

import unittest

from ..reference import random_scenes
from ..reference.scene import parse


class Keys(unittest.TestCase):
    def test_every_key_of_a_random_scene_is_read(self):
        for index in range(300):
            parse(random_scenes.to_toml(random_scenes.make(1, index)))

    def test_a_key_that_is_not_known_is_refused_wherever_it_is(self):
        table = random_scenes.make(1, 0)
        for where, path in ((table, "gap_um"), (table["surface"], "surface.gap_um"), (table["actuator"][0], "actuator.gap_um")):
            where["gap_um"] = 1.0
            with self.assertRaisesRegex(ValueError, f"does not know {path}:"):
                parse(random_scenes.to_toml(table))
            del where["gap_um"]


if __name__ == "__main__":
    unittest.main()
