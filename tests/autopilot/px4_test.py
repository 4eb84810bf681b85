#!/usr/bin/env python3
"""The simulated PX4: what it lets in, when it resets, its parameters and its signing key."""
import math
import random
import struct
import unittest

import support
from support import dialect

from simulated_autopilot.px4_projection import MapProjection, RADIUS_M
from simulated_autopilot.scenario import parse_event

READY = {"EKF2_AGP0_ID": 1, "EKF2_AGP0_CTRL": 1, "EKF2_AGP0_GATE": 5.0, "EKF2_EV_CTRL": 1, "EKF2_HGT_REF": 0}


def nan(*indices, size=21, value=0.0):
    return [value if i in indices else math.nan for i in range(size)]


class Flight:
    """A PX4 that gets the truth with noise and an offset ten times a second."""

    def __init__(self, *events, version=(1, 18), **parameters):
        self.vehicle, self.companion = support.vehicle([parse_event(text) for text in events], px4_version=version)
        known = self.vehicle.protocol.parameters
        known.update({name: value for name, value in {**READY, **parameters}.items() if name in known})
        self.noise, self.offset, self.sigma, self.silent = random.Random(1), (0.0, 0.0), 3.0, False
        self.reset_counter, self.position_variance = 0, None

    def fly(self, seconds):
        until = self.vehicle.now_s + seconds
        while self.vehicle.now_s < until:
            if not self.silent and self.vehicle.steps % 5 == 0:
                self.give()
            self.vehicle.step()
        self.messages = self.companion.read()
        return self

    def give(self):
        v = self.vehicle
        place = [p + o + self.noise.gauss(0, 1) for p, o in zip((v.plane.north, v.plane.east), self.offset)]
        lat, lon = v.local.to_degrees(*place)
        if v.options.px4_version >= (1, 18):
            self.companion.send(dialect.MAVLink_global_position_sensor_message(
                1, 1, 1, 0, 0, dialect.GLOBAL_POSITION_SRC_VISION, 0, round(lat * 1e7), round(lon * 1e7), math.nan, math.nan,
                self.sigma, math.nan))
        elif v.navigation.origin is not None:
            origin = v.navigation.origin  # near enough on the plane, for a test of the filter
            north = math.radians(lat - origin.lat_deg) * RADIUS_M
            east = math.radians(lon - origin.lon_deg) * RADIUS_M * math.cos(math.radians(lat))
            covariance = nan(0, 6, 11)
            covariance[0] = covariance[6] = self.sigma ** 2
            covariance[11] = 1e6 if self.position_variance is None else self.position_variance
            self.companion.send(dialect.MAVLink_odometry_message(
                0, dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_BODY_FRD, north, east, 0, [math.nan] * 4, *[math.nan] * 6,
                covariance, nan(), self.reset_counter, dialect.MAV_ESTIMATOR_TYPE_VISION))

    def error(self):
        v = self.vehicle
        return math.dist(v.navigation.filter.position, (v.plane.north, v.plane.east))

    def resets(self):
        return [(source, reason) for _, source, reason, _ in self.vehicle.navigation.filter.resets]


class AuxiliaryPosition(unittest.TestCase):
    def test_navigates_by_it_while_gps_is_denied(self):
        flight = Flight("10:gps-denied").fly(50)
        self.assertLess(flight.error(), 8)
        self.assertEqual("gps_input", flight.vehicle.navigation.source)
        self.assertEqual([], flight.resets())
        self.assertEqual(0, flight.vehicle.summary()["resets_by_gps_input"])

    def test_a_spoofed_step_is_outside_the_gate_and_does_not_reset(self):
        flight = Flight("10:gps-step=300@70").fly(40)
        self.assertLess(flight.error(), 8)
        self.assertEqual("gps_input", flight.vehicle.navigation.source)
        self.assertEqual([], flight.resets())
        self.assertTrue(flight.vehicle.navigation.gnss.rejected)
        self.assertEqual({"agp"}, flight.vehicle.navigation.filter.active, "after seven seconds the receiver is faulty")

    def test_a_faulty_receiver_is_taken_again_when_it_agrees(self):
        flight = Flight("10:gps-step=300@70", "30:gps-recover").fly(35)
        self.assertEqual({"agp", "gnss"}, flight.vehicle.navigation.filter.active)
        self.assertEqual([], flight.resets())
        self.assertLess(flight.error(), 8)

    def test_a_slow_drift_of_gps_wins_while_it_is_fused(self):
        """It is the more accurate of the two, and ours is in the end outside its gate."""
        self.assertGreater(Flight("5:gps-drag=3@70").fly(50).error(), 80)
        self.assertLess(Flight("5:gps-drag=3@70", EKF2_GPS_CTRL=0).fly(50).error(), 8)

    def test_gps_that_is_switched_off_late_is_left_after_the_timeout(self):
        flight = Flight("5:gps-drag=3@70").fly(35)
        flight.vehicle.protocol.parameters["EKF2_GPS_CTRL"] = 0
        flight.fly(10)
        self.assertLess(flight.error(), 8)
        self.assertIn("gps_input", [source for source, _ in flight.resets()])

    def test_without_it_the_filter_is_reset_to_the_spoofed_receiver(self):
        flight = Flight("10:gps-step=300@70")
        flight.silent = True
        flight.fly(40)
        self.assertIn(("own", "fusion timeout"), flight.resets())
        self.assertGreater(flight.error(), 250)

    def test_a_receiver_that_returns_after_a_denial_is_taken_only_when_it_agrees(self):
        spoofed = Flight("5:gps-denied", "20:gps-recover", "20.1:gps-step=300@70").fly(40)
        self.assertEqual([], spoofed.resets())
        self.assertLess(spoofed.error(), 8)
        good = Flight("5:gps-denied", "20:gps-recover").fly(30)
        self.assertEqual("own", good.vehicle.navigation.source)

    def test_without_ours_a_receiver_that_returns_is_taken_without_a_gate(self):
        flight = Flight("5:gps-denied", "20:gps-recover", "20.1:gps-step=300@70")
        flight.silent = True
        self.assertGreater(flight.fly(30).error(), 100)
        self.assertIn("own", [source for source, _ in flight.resets()])

    def test_with_gps_switched_off_the_alarm_stays_what_it_was(self):
        for version in ((1, 18), (1, 16)):
            flight = Flight("5:gps-step=300@70", "20:gps-recover", version=version).fly(10)
            self.assertTrue(flight.vehicle.navigation.gnss.rejected)
            flight.vehicle.protocol.parameters["EKF2_GPS_CTRL"] = 0
            self.assertTrue(flight.fly(20).vehicle.navigation.gnss.rejected, version)
            flight.vehicle.protocol.parameters["EKF2_GPS_CTRL"] = 7
            self.assertFalse(flight.fly(5).vehicle.navigation.gnss.rejected, version)

    def test_with_gps_switched_off_it_is_not(self):
        flight = Flight("5:gps-denied", "20:gps-recover", "20.1:gps-step=300@70", EKF2_GPS_CTRL=0).fly(30)
        self.assertEqual([], flight.resets())
        self.assertLess(flight.error(), 8)

    def test_a_jump_beyond_the_gate_is_let_in_after_the_timeout_alone(self):
        flight = Flight("5:gps-denied").fly(20)
        flight.offset = (120.0, 0.0)
        flight.fly(4)
        self.assertLess(flight.error(), 40, "within the seven seconds it is rejected")
        flight.fly(8)
        self.assertIn(("gps_input", "fusion timeout"), flight.resets())
        self.assertEqual(1, flight.vehicle.summary()["resets_by_gps_input"])

    def test_without_gps_its_first_position_is_the_origin(self):
        flight = Flight("0:gps-denied")
        flight.silent = True
        self.assertNotIn("GLOBAL_POSITION_INT", [m.get_type() for m in flight.fly(2).messages])
        flight.silent = False
        self.assertIn("GLOBAL_POSITION_INT", [m.get_type() for m in flight.fly(2).messages])
        self.assertLess(math.dist(flight.vehicle.local.to_plane(flight.vehicle.navigation.origin.lat_deg,
                                                                flight.vehicle.navigation.origin.lon_deg),
                                  (flight.vehicle.plane.north, flight.vehicle.plane.east)), 100)

    def test_silence_stops_it(self):
        flight = Flight("5:gps-denied").fly(20)
        self.assertIn("agp", flight.vehicle.navigation.filter.active)
        flight.silent = True
        flight.fly(4)
        self.assertIn("agp", flight.vehicle.navigation.filter.active)
        flight.fly(2)
        self.assertNotIn("agp", flight.vehicle.navigation.filter.active)
        self.assertEqual("none", flight.vehicle.navigation.source)
        self.assertEqual(0, flight.vehicle.navigation.given.status)

    def test_an_unknown_id_and_a_slot_that_is_off_are_ignored(self):
        self.assertEqual({"id"}, set(Flight(EKF2_AGP0_ID=7).fly(5).vehicle.log.verdicts))
        self.assertEqual({"off"}, set(Flight(EKF2_AGP0_CTRL=0).fly(5).vehicle.log.verdicts))
        self.assertEqual({"off"}, set(Flight(EKF2_SENS_EN=8191 - 16).fly(5).vehicle.log.verdicts))


class Odometry(unittest.TestCase):
    OLD = {"version": (1, 15)}

    def test_navigates_by_it_while_gps_is_denied(self):
        flight = Flight("10:gps-denied", **self.OLD).fly(50)
        self.assertLess(flight.error(), 8)
        self.assertEqual("gps_input", flight.vehicle.navigation.source)
        self.assertLessEqual(set(flight.resets()), {("gps_input", "GNSS stopped")})

    def test_a_slow_drift_of_gps_wins(self):
        """While GNSS is fused, the position is relative to a bias that follows it."""
        self.assertGreater(Flight("5:gps-drag=3@70", **self.OLD).fly(50).error(), 80)
        self.assertLess(Flight("5:gps-drag=3@70", EKF2_GPS_CTRL=0, **self.OLD).fly(50).error(), 8)

    def test_before_1_17_a_receiver_that_returns_is_taken_without_a_gate(self):
        events = ("5:gps-denied", "20:gps-recover", "20.1:gps-step=300@70")
        flight = Flight(*events, **self.OLD).fly(30)
        self.assertIn("own", [source for source, _ in flight.resets()])
        self.assertGreater(flight.error(), 100)
        self.assertLess(Flight(*events, version=(1, 17)).fly(30).error(), 8)

    def test_an_announced_jump_resets_at_once(self):
        flight = Flight("5:gps-denied", **self.OLD).fly(20)
        flight.offset, flight.reset_counter = (120.0, 0.0), 1
        flight.fly(1)
        self.assertEqual(("gps_input", "announced"), flight.resets()[-1])
        self.assertEqual(0, flight.vehicle.summary()["resets_by_gps_input"])

    def test_a_jump_that_is_not_announced_resets_after_a_second(self):
        flight = Flight("5:gps-denied", **self.OLD).fly(20)
        flight.offset = (120.0, 0.0)
        flight.fly(3)
        self.assertEqual(("gps_input", "fusion failing"), flight.resets()[-1])
        self.assertEqual(1, flight.vehicle.summary()["resets_by_gps_input"])

    def test_one_unknown_variance_means_a_tenth_of_a_metre(self):
        flight = Flight("5:gps-denied", **self.OLD)
        flight.position_variance = math.nan
        flight.fly(30)
        self.assertLess(flight.vehicle.navigation.filter.sigma(), 0.3, "it believes EKF2_EVP_NOISE")
        flight = Flight("5:gps-denied", **self.OLD).fly(30)
        self.assertGreater(flight.vehicle.navigation.filter.sigma(), 0.5)

    def test_nothing_is_taken_without_an_origin(self):
        flight = Flight("0:gps-denied", **self.OLD)
        flight.companion.send(dialect.MAVLink_command_long_message(1, 1, 512, 0, 49, 0, 0, 0, 0, 0, 0))
        flight.fly(2)
        self.assertNotIn("GPS_GLOBAL_ORIGIN", [m.get_type() for m in flight.messages])
        flight.companion.send(dialect.MAVLink_set_gps_global_origin_message(1, 487900000, 140200000, 500_000))
        flight.fly(10)
        self.assertIn("GPS_GLOBAL_ORIGIN", [m.get_type() for m in flight.messages])
        self.assertEqual("gps_input", flight.vehicle.navigation.source)

    def test_the_projection_is_a_sphere_s(self):
        lat, lon = MapProjection(47.0, 8.0).reproject(10_000.0, 0.0)
        self.assertAlmostEqual(47.0 + math.degrees(10_000 / RADIUS_M), lat, 9)
        self.assertAlmostEqual(8.0, lon, 9)


class Protocol(unittest.TestCase):
    def answers(self, flight, *messages):
        for message in messages:
            flight.companion.send(message)
        flight.silent = True
        return [m for m in flight.fly(0.2).messages if m.get_type() == "PARAM_VALUE"]

    def set(self, name, field, kind):
        return dialect.MAVLink_param_set_message(1, 1, name.encode(), field, kind)

    def test_integers_are_bytes(self):
        one = struct.unpack("<f", struct.pack("<i", 1))[0]
        flight = Flight()
        value, = self.answers(flight, self.set("EKF2_HGT_REF", one, dialect.MAV_PARAM_TYPE_INT32))
        self.assertEqual((one, dialect.MAV_PARAM_TYPE_INT32), (value.param_value, value.param_type))
        self.assertEqual(1, flight.vehicle.protocol.parameters["EKF2_HGT_REF"])

    def test_another_type_is_not_answered(self):
        flight = Flight()
        self.assertEqual([], self.answers(flight, self.set("EKF2_HGT_REF", 2.0, dialect.MAV_PARAM_TYPE_REAL32)))
        self.assertEqual(0, flight.vehicle.protocol.parameters["EKF2_HGT_REF"])

    def test_the_auxiliary_position_exists_from_1_18_on(self):
        self.assertIn("EKF2_AGP3_GATE", Flight().vehicle.protocol.parameters)
        self.assertNotIn("EKF2_AGP0_ID", Flight(version=(1, 17)).vehicle.protocol.parameters)

    def test_no_key_while_armed_nor_before_1_18(self):
        setup = dialect.MAVLink_setup_signing_message(1, 1, list(b"k" * 32), 10)
        for version, armed, signed in (((1, 18), False, True), ((1, 18), True, False), ((1, 17), False, False)):
            flight = Flight(version=version)
            flight.vehicle.armed = armed
            flight.companion.send(setup)
            flight.vehicle.step()
            self.assertEqual(signed, flight.vehicle.link.signed, (version, armed))

    def test_the_heartbeat_is_px4_s(self):
        beat = next(m for m in Flight().fly(2).messages if m.get_type() == "HEARTBEAT")
        self.assertEqual((dialect.MAV_AUTOPILOT_PX4, 0x04040000), (beat.autopilot, beat.custom_mode))


if __name__ == "__main__":
    unittest.main()
