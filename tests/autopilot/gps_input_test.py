#!/usr/bin/env python3
"""GPS_INPUT is handled as by ArduPilot: instance, spacing, numbers, fix type, and the checks before arming."""
import math
import unittest

import support
from simulated_autopilot.geo import LocalPlane
from simulated_autopilot.gps_input import (IGNORE_ALT, IGNORE_HORIZONTAL_ACCURACY, IGNORE_VEL_HORIZ, IGNORE_VEL_VERT,
                                           GpsInputReceiver, alignment_refusals)


class GpsInput(unittest.TestCase):
    def setUp(self):
        self.receiver = GpsInputReceiver(0, LocalPlane(48.79, 14.02))

    def receive(self, times, **fields):
        return [self.receiver.receive(support.gps_input(**fields), t) is not None for t in times]

    def test_ten_a_second_are_used(self):
        self.assertTrue(all(self.receive([i * 0.1 for i in range(100)])))
        self.assertAlmostEqual(0.1, self.receiver.longest_s)
        self.assertEqual(0, self.receiver.late)

    def test_another_instance_is_ignored(self):
        self.assertEqual([False], self.receive([0], gps_id=1))
        self.assertEqual({"gps_id": 1}, self.receiver.refused)
        self.assertEqual(0, self.receiver.count)

    def test_without_a_fix_it_is_reported_and_not_used(self):
        self.assertEqual([True, True], self.receive([0, 0.1]))
        for fix_type in (0, 1, 2):
            self.assertEqual([False], self.receive([0.2], fix_type=fix_type))
            self.assertEqual(fix_type, self.receiver.status)
        self.assertEqual({"no_fix": 3}, self.receiver.refused)

    def test_two_late_ones_in_a_row_are_unhealthy(self):
        self.receive([i * 0.1 for i in range(20)])
        # 246 ms apart: unhealthy at the second in a row, healthy again at the first message in time.
        late = [1.9 + 0.246 * (i + 1) for i in range(3)]
        self.assertEqual([True, False, False], self.receive(late))
        self.assertEqual([True], self.receive([late[-1] + 0.1]))
        self.assertEqual(3, self.receiver.late)

    def test_an_average_that_is_too_slow_is_unhealthy(self):
        # Every second one late, never two in a row: the average decides.
        times, t = [], 0.0
        for i in range(400):
            t += 0.2 if i % 2 else 0.4
            times.append(t)
        used = self.receive(times)
        self.assertFalse(used[-1])
        self.assertGreater(self.receiver.average_s, 0.215)

    def test_spacing_just_inside_is_well(self):
        self.assertTrue(all(self.receive([i * 0.214 for i in range(300)])))
        self.assertFalse(all(self.receive([300 * 0.214 + i * 0.22 for i in range(300)])))

    def test_after_four_seconds_of_silence_it_is_lost(self):
        self.receive([0, 0.1])
        self.assertFalse(self.receiver.gone(4.0))
        self.assertTrue(self.receiver.gone(4.2))
        self.assertFalse(self.receiver.gone(9.0))
        self.assertEqual(0, self.receiver.status)
        self.assertEqual([True], self.receive([9.1]))

    def test_invalid_numbers(self):
        for fields in ({"alt": math.nan}, {"h_acc": math.inf}, {"velocity": (math.nan, 0, 0)}, {"lat_deg": 91}):
            self.assertEqual([False], self.receive([0], **fields), fields)
        self.assertEqual({"numbers": 4}, self.receiver.refused)

    def test_ignored_fields_are_unknown(self):
        self.receive([0], ignore=IGNORE_ALT | IGNORE_VEL_HORIZ | IGNORE_HORIZONTAL_ACCURACY)
        sample = self.receiver.sample
        self.assertEqual((None, None, None), (sample.altitude, sample.velocity, sample.h_acc))
        self.receive([0.1], ignore=IGNORE_VEL_VERT, velocity=(1, 2, 3))
        self.assertEqual((1, 2, 0), self.receiver.sample.velocity)

    def test_arming_asks_for_more(self):
        self.receive([0])
        self.assertEqual([], alignment_refusals(self.receiver.sample))
        cases = [({"h_acc": 5.1}, "h_acc"), ({"vert_accuracy": 7.6}, "v_acc"), ({"speed_accuracy": 1.1}, "s_acc"),
                 ({"hdop": 2.6}, "hdop"), ({"satellites_visible": 5}, "satellites"), ({"fix_type": 2}, "fix")]
        for fields, word in cases:
            self.receive([0], **fields)
            self.assertEqual([word], alignment_refusals(self.receiver.sample))


if __name__ == "__main__":
    unittest.main(verbosity=2)
