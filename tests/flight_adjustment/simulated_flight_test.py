#!/usr/bin/env python3
"""A simulated flight of 160 frames, adjusted as a whole: sharp turns without pictures, five pictures of another place, a
fifth of each leg without a map. No person helps.

usage: simulated_flight_test.py PATH_TO_BENCH_ADJUSTED_FLIGHT
"""
import json
import pathlib
import subprocess
import sys
import unittest


class SimulatedFlight(unittest.TestCase):
    def test_is_placed_as_a_whole(self):
        run = subprocess.run([PROGRAM, "6", "160"], capture_output=True, text=True, check=True)
        flight = json.loads(run.stdout)
        adjusted, block = flight["adjusted"], flight["adjustment"]
        self.assertEqual(adjusted["positions"], 160, "each frame has a place")
        self.assertGreaterEqual(adjusted["within_20_m_share"], 0.95, adjusted)
        self.assertLess(adjusted["rms_m"], flight["online"]["rms_m"])
        self.assertLess(block["mean_reprojection_px"], 1)
        self.assertEqual(block["outcome"], "converged")
        self.assertLess(adjusted["nees"], 2.2, "the stated covariance has room for the map's error")
        self.assertLess(adjusted["nees_without_map_error"], 5, "one flight: about 2 on average")
        self.assertGreaterEqual(adjusted["nees_without_map_error"], 0.4)
        seams = flight["seams"]
        self.assertGreater(seams["adjusted"]["measured"], 300, seams)
        self.assertLessEqual(seams["adjusted"]["median_px"], 1, seams)
        self.assertLess(seams["adjusted"]["median_px"], seams["online"]["median_px"], seams)
        self.assertGreater(seams["adjusted"]["median_step"], 5, "each frame is exposed differently")
        self.assertLess(seams["adjusted_balanced"]["p95_step"], 2, seams)
        self.assertLessEqual(seams["adjusted_own_surface"]["median_px"], 1, "where no terrain is known")
        self.assertLess(seams["adjusted_own_surface"]["median_px"], seams["adjusted_level_ground"]["median_px"] / 2, seams)


if __name__ == "__main__":
    PROGRAM = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main()
