#!/usr/bin/env python3
"""The estimated attitude has the errors of a real one: they depend on the course, and on the fix that aids the filter."""
import math
import random
import unittest

import support
from simulated_autopilot.attitude import AttitudeEstimate
from simulated_autopilot.geo import wrap
from simulated_autopilot.plane import Plane

STEP_S = 0.02
TURN = math.radians(6)  # to the right, every second


def yaw_error(attitude, plane):
    return math.degrees(wrap(attitude.estimate(plane)[2] - plane.yaw))


def turned(velocity, angle):
    """Clockwise; north and east."""
    n, e = velocity[:2]
    return n * math.cos(angle) - e * math.sin(angle), n * math.sin(angle) + e * math.cos(angle)


class Attitude(unittest.TestCase):
    def setUp(self):
        self.plane = Plane(random.Random(1), 0, 0, 300, 0)
        self.attitude = AttitudeEstimate(random.Random(2))
        self.usual = self.attitude.estimate(self.plane)

    def fly(self, seconds, estimated):
        """In a steady turn; estimated(velocity, time since the beginning): what the position filter takes it for."""
        acceleration = self.plane.airspeed * TURN
        for i in range(round(seconds / STEP_S)):
            self.plane.step(STEP_S, acceleration, 300)
            self.attitude.step(STEP_S, self.plane, estimated(self.plane.velocity, i * STEP_S))

    def test_the_compass_error_depends_on_the_course(self):
        self.attitude.deviate(math.radians(9), math.radians(90))
        errors = {}
        for course in (0, 90, 180, 270):
            self.plane.yaw = math.radians(course)
            errors[course] = yaw_error(self.attitude, self.plane)
        self.assertAlmostEqual(18, errors[90] - errors[270], delta=1e-6)
        self.assertAlmostEqual(errors[0], errors[180], delta=1e-6)

    def test_with_the_true_velocity_it_has_no_tilt_error(self):
        self.attitude.deviate(0, 0)
        before = yaw_error(self.attitude, self.plane)
        self.fly(40, lambda velocity, _: velocity)
        self.assertAlmostEqual(before, yaw_error(self.attitude, self.plane), delta=1e-6)

    def test_a_fix_whose_course_runs_off_in_a_turn_takes_the_heading_with_it(self):
        self.attitude.deviate(0, 0)
        before = yaw_error(self.attitude, self.plane)
        self.fly(40, lambda velocity, time_s: turned(velocity, min(math.radians(8), math.radians(0.4) * time_s)))
        self.assertAlmostEqual(8, yaw_error(self.attitude, self.plane) - before, delta=2.5)

    def test_a_fix_that_runs_off_ahead_tilts_it_up_or_down(self):
        self.attitude.deviate(0, 0)
        for _ in range(round(30 / STEP_S)):
            self.plane.step(STEP_S, 0, 300)
            seconds = self.plane.north / self.plane.airspeed
            self.attitude.step(STEP_S, self.plane, (self.plane.velocity[0] + 0.5 * seconds, self.plane.velocity[1]))
        roll, pitch, _ = self.attitude.estimate(self.plane)
        self.assertAlmostEqual(-math.degrees(0.5 / 9.8), math.degrees(pitch - self.plane.pitch), delta=1.5)
        self.assertLess(abs(math.degrees(roll - self.plane.roll)), 1.5)


if __name__ == "__main__":
    unittest.main(verbosity=2)
