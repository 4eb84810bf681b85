#!/usr/bin/env python3
"""The aircraft flies its plan by the position that it is given, and the scenarios have their described effects."""
import math
import random
import unittest

import support
from simulated_autopilot.plan import Plan
from simulated_autopilot.plane import MAX_BANK, Plane, rotate_to_body
from simulated_autopilot.scenario import parse_event
from simulated_autopilot.gauss_markov import GaussMarkov


def events(*texts):
    return [parse_event(text) for text in texts]


class Flight(unittest.TestCase):
    def test_with_its_own_receiver_it_follows_the_plan(self):
        aircraft, _ = support.vehicle(wind=(4, -3))
        support.fly(aircraft, 300)
        summary = aircraft.summary()
        self.assertLess(summary["deviation_m"]["median"], 4)
        self.assertLess(summary["deviation_m"]["max"], 20)
        self.assertEqual([], summary["resets"])
        self.assertEqual(aircraft.navigation.source, "own")

    def test_the_same_seed_is_the_same_flight(self):
        def track(seed):
            aircraft, _ = support.vehicle(seed=seed)
            support.fly(aircraft, 20)
            return aircraft.plane.north, aircraft.plane.east, aircraft.navigation.filter.position
        self.assertEqual(track(3), track(3))
        self.assertNotEqual(track(3), track(4))

    def test_denied_it_navigates_by_the_given_position(self):
        aircraft, companion = support.vehicle(events("20:gps-denied"))
        support.fly(aircraft, 240, support.TruthfulCompanion(aircraft, companion))
        summary = aircraft.summary()
        self.assertEqual("gps_input", aircraft.navigation.source)
        self.assertLess(summary["deviation_m"]["max"], 20)
        self.assertEqual([], summary["resets"])
        self.assertLess(summary["fix_error_m"]["max"], 3)
        self.assertGreater(aircraft.log.verdicts["accepted"], 2300)

    def test_a_given_position_is_delayed_by_default(self):
        for delay_ms, metres in ((0, 4.4), (10, 0.2)):  # 22 m/s
            aircraft, companion = support.vehicle()
            aircraft.protocol.parameters["GPS1_DELAY_MS"] = delay_ms
            support.fly(aircraft, 60, support.TruthfulCompanion(aircraft, companion))
            late = aircraft.filter_errors[-300:]
            self.assertAlmostEqual(metres, sum(late) / len(late), delta=0.6)

    def test_an_inaccurate_speed_is_reported_as_a_glitch(self):
        for accuracy, glitch in ((0.5, False), (2.0, True)):
            aircraft, companion = support.vehicle()
            giver = support.TruthfulCompanion(aircraft, companion)
            giver.speed_accuracy = accuracy
            support.fly(aircraft, 5, giver)
            report = [m for m in companion.read() if m.get_type() == "EKF_STATUS_REPORT"][-1]
            self.assertEqual(glitch, bool(report.flags & support.dialect.EKF_GPS_GLITCHING))
            self.assertEqual([], aircraft.summary()["resets"])

    def test_it_follows_a_companion_with_false_positions(self):
        aircraft, companion = support.vehicle(events("20:gps-denied"))
        giver = support.TruthfulCompanion(aircraft, companion)
        support.fly(aircraft, 60, giver)
        for _ in range(200):  # 1 m/s to the side is let in
            giver.offset[1] += 0.5
            support.fly(aircraft, 0.5, giver)
        self.assertGreater(max(aircraft.deviations), 60)
        self.assertEqual([], aircraft.summary()["resets"])

    def test_a_jump_of_what_is_given_is_rejected_and_then_resets(self):
        aircraft, companion = support.vehicle(events("20:gps-denied"))
        giver = support.TruthfulCompanion(aircraft, companion)
        support.fly(aircraft, 60, giver)
        giver.offset[0] = 300
        support.fly(aircraft, 15, giver)
        self.assertGreater(aircraft.log.verdicts["innovation"], 80)
        self.assertEqual(1, aircraft.summary()["resets_by_gps_input"])
        self.assertIn("reset", [event["kind"] for event in aircraft.log.events])

    def test_without_any_position_it_drifts(self):
        aircraft, _ = support.vehicle(events("20:gps-denied"), wind=(6, 0))
        support.fly(aircraft, 120)
        self.assertEqual("none", aircraft.navigation.source)
        self.assertGreater(aircraft.navigation.filter.sigma(), 15)

    def test_a_step_of_its_own_receiver_is_seen_only_by_the_filter(self):
        aircraft, companion = support.vehicle(events("20:gps-step=300@90"))
        support.fly(aircraft, 25)
        report = [m for m in companion.read() if m.get_type() == "EKF_STATUS_REPORT"][-1]
        self.assertTrue(report.flags & support.dialect.EKF_GPS_GLITCHING)
        self.assertLess(aircraft.deviations[-1], 30)
        support.fly(aircraft, 30)
        self.assertEqual("own", aircraft.summary()["resets"][0]["source"])
        self.assertGreater(max(aircraft.filter_errors), 250)

    def test_the_given_position_has_precedence_while_it_has_a_fix(self):
        aircraft, companion = support.vehicle(events("20:gps-drag=3@0"))
        giver = support.TruthfulCompanion(aircraft, companion)
        support.fly(aircraft, 80, giver)
        self.assertLess(max(aircraft.deviations), 20)
        giver.fix_type = 0
        support.fly(aircraft, 40, giver)
        self.assertEqual("own", aircraft.navigation.source)

    def test_a_drag_is_followed_when_uncontradicted(self):
        aircraft, _ = support.vehicle(events("20:gps-drag=2@0", "120:gps-recover"))
        support.fly(aircraft, 110)
        self.assertGreater(aircraft.filter_errors[-1], 120)
        self.assertEqual([], aircraft.summary()["resets"])
        support.fly(aircraft, 40)
        self.assertEqual(1, len(aircraft.summary()["resets"]))

    def test_the_clock_steps_and_a_reboot_restarts_it(self):
        aircraft, companion = support.vehicle(events("5:clock-step=-100", "10:reboot"))
        support.fly(aircraft, 4.9)
        companion.read()
        support.fly(aircraft, 2)
        late = [m for m in companion.read() if m.get_type() == "SYSTEM_TIME"][-1]
        self.assertLess(late.time_unix_usec, support.UNIX_US - 90_000_000)
        self.assertGreater(late.time_boot_ms, 30_000)
        support.fly(aircraft, 5)
        self.assertLess([m for m in companion.read() if m.get_type() == "SYSTEM_TIME"][-1].time_boot_ms, 3_000)

    def test_an_invalid_event_is_rejected(self):
        for text in ("gps-denied", "5:nothing", "x:gps-denied", "5:gps-denied=3", "5:gps-step=nan", "-1:gps-denied"):
            with self.assertRaises(ValueError, msg=text):
                parse_event(text)


class Parts(unittest.TestCase):
    def test_turns_are_coordinated_and_bank_is_limited(self):
        plane = Plane(random.Random(1), 0, 0, 500, 0, 20)
        plane.gusts = (GaussMarkov(random.Random(1), 0, 1), GaussMarkov(random.Random(1), 0, 1))
        for _ in range(1000):
            plane.step(0.02, 100, 500)
        self.assertAlmostEqual(MAX_BANK, plane.bank, places=3)
        # v²/r = g·tan(bank): the force is straight down the body's axis.
        force = rotate_to_body((plane.acceleration[0], plane.acceleration[1], -9.80665), plane.bank, 0, plane.heading)
        self.assertAlmostEqual(0, force[1], delta=0.2)
        self.assertAlmostEqual(-9.80665 / math.cos(MAX_BANK), force[2], delta=0.2)
        self.assertAlmostEqual(20, math.hypot(*plane.velocity), delta=0.01)

    def test_a_circuit_is_rounded_and_even(self):
        plan = Plan([(0, 0), (0, 1000), (1000, 1000), (1000, 0)], 100)
        gaps = [math.dist(plan.point(i), plan.point(i + 1)) for i in range(len(plan))]
        self.assertLess(max(gaps), 4.01)
        self.assertAlmostEqual(4000 - 4 * (200 - 50 * math.pi), plan.length(), delta=2)
        # The corner is (√2 − 1)·r away.
        self.assertAlmostEqual((math.sqrt(2) - 1) * 100, plan.deviation(0, 0)[0], delta=0.1)
        self.assertAlmostEqual(30, plan.deviation(-30, 500)[0], delta=1e-6)

    def test_a_plan_needs_three_places(self):
        with self.assertRaises(ValueError):
            Plan([(0, 0), (1, 1)], 10)
        with self.assertRaises(ValueError):
            Plan([(0, 0), (0, 0), (100, 0)], 10)


if __name__ == "__main__":
    unittest.main(verbosity=2)
