#!/usr/bin/env python3
"""The position filter: what passes its gate, when it is reset, how its uncertainty grows."""
import math
import random
import unittest

import support  # noqa: F401 (finds the package)
from simulated_autopilot.position_filter import PositionFilter
from simulated_autopilot.receiver import GpsSample


def sample(north, east=0.0, h_acc=2.0, velocity=(20.0, 0.0, 0.0)):
    return GpsSample(3, north, east, 600, velocity, h_acc, 3, 0.4, 1, 10)


class Filter(unittest.TestCase):
    """An aircraft that flies north at 20 m/s, without any acceleration."""

    def setUp(self):
        self.filter = PositionFilter(0, 0, (20.0, 0.0, 0.0))
        self.t = 0.0

    def fly(self, seconds, offset=0.0, receiver=True, h_acc=2.0, air=20.0):
        """True when every sample was let in."""
        passed = []
        for i in range(round(seconds * 50)):
            self.t += 0.02
            self.filter.predict(0.02, (0.0, 0.0))
            if i % 10 == 0:
                self.filter.hold_airspeed(self.t, (air, 0.0))
            if receiver and i % 5 == 4:
                passed.append(self.filter.fuse(self.t, sample(20 * self.t + offset, h_acc=h_acc), "test"))
        return all(passed)

    def test_follows_a_good_receiver(self):
        self.assertTrue(self.fly(30))
        self.assertAlmostEqual(20 * self.t, self.filter.position[0], delta=0.5)
        self.assertEqual([], self.filter.resets)
        self.assertLess(self.filter.sigma(), 2)

    def test_a_jump_is_kept_out_for_ten_seconds_and_then_taken(self):
        self.fly(20)
        self.assertFalse(self.fly(9.5, offset=300))
        self.assertAlmostEqual(20 * self.t, self.filter.position[0], delta=5)
        self.assertEqual([], self.filter.resets)
        self.fly(2, offset=300)
        self.assertEqual(1, len(self.filter.resets))
        self.assertEqual(("test", "out of the gate"), self.filter.resets[0][1:3])
        self.assertAlmostEqual(300, self.filter.resets[0][3], delta=10)

    def test_another_receiver_is_used_immediately_at_any_distance(self):
        self.fly(20)
        place = self.filter.position[0]
        self.assertTrue(self.filter.fuse(self.t, sample(place + 300), "other"))
        self.assertEqual(("other", "another receiver"), self.filter.resets[0][1:3])
        self.assertAlmostEqual(place + 300, self.filter.position[0], delta=0.1)
        self.assertFalse(self.filter.fuse(self.t, sample(place), "other"))

    def reasons(self):
        return [reset[2] for reset in self.filter.resets]

    def test_an_unsure_receiver_resets_it_until_it_is_sure(self):
        self.fly(20)
        place = self.filter.position[0]
        for step in range(3):
            self.assertTrue(self.filter.fuse(self.t, sample(place + 15, h_acc=18), "other"))
        self.assertEqual(["another receiver"] + 2 * ["another receiver, still unsure"], self.reasons())
        self.filter.fuse(self.t, sample(place + 15, h_acc=10), "other")  # from here on it is sure
        self.filter.fuse(self.t, sample(place + 15, h_acc=10), "other")
        self.assertEqual(4, len(self.filter.resets))
        self.filter.pp = 400.0  # unsure by itself, not by who takes over
        self.filter.fuse(self.t, sample(place + 15, h_acc=10), "other")
        self.assertEqual("too unsure", self.reasons()[-1])

    def test_the_gate_is_five_sigmas(self):
        self.fly(30, h_acc=10)
        limit = 5 * math.sqrt(2 * (self.filter.pp + 100))
        before = self.filter.position[0]
        self.assertFalse(self.filter.fuse(self.t, sample(before + 1.01 * limit, h_acc=10), "test"))
        self.assertTrue(self.filter.fuse(self.t, sample(before + 0.99 * limit, h_acc=10), "test"))

    def test_slow_drift_is_followed(self):
        self.fly(20)
        for step in range(100):  # 1 m/s
            self.assertTrue(self.fly(0.5, offset=step * 0.5))
        # The velocities deny it, so that it lags.
        self.assertAlmostEqual(20 * self.t + 49.5, self.filter.position[0], delta=8)

    def test_without_fixes_its_uncertainty_grows_and_it_is_reset_afterwards(self):
        self.fly(30)
        sigma = self.filter.sigma()
        for _ in range(8):
            self.fly(5, receiver=False)
            self.assertGreater(self.filter.sigma(), sigma)
            sigma = self.filter.sigma()
        self.assertLess(abs(self.filter.position[0] - 20 * self.t), 3 * sigma)
        self.fly(1)
        self.assertEqual("ten seconds without", self.filter.resets[0][2])

    def test_without_fixes_it_uses_the_wind(self):
        self.fly(120, air=14.0)  # 6 m/s from behind
        self.assertAlmostEqual(6, self.filter.wind[0], delta=0.5)
        self.fly(30, receiver=False, air=14.0)
        self.assertAlmostEqual(20, self.filter.velocity[0], delta=1)

    def test_its_uncertainty_is_consistent_with_random_receivers(self):
        generator = random.Random(4)
        normalized = []
        for _ in range(40):
            self.setUp()
            for i in range(200):
                self.t += 0.1
                self.filter.predict(0.1, (generator.gauss(0, 0.35 / math.sqrt(0.1)), 0))
                truth = 20 * self.t
                self.filter.fuse(self.t, sample(truth + generator.gauss(0, 2), generator.gauss(0, 2),
                                                velocity=(20 + generator.gauss(0, 0.4), generator.gauss(0, 0.4), 0)), "test")
            normalized.append((self.filter.position[0] - 20 * self.t) ** 2 / self.filter.pp)
        self.assertLess(sum(normalized) / len(normalized), 1.8)
        self.assertGreater(sum(normalized) / len(normalized), 0.4)


if __name__ == "__main__":
    unittest.main(verbosity=2)
