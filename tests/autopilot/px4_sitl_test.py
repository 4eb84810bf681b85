#!/usr/bin/env python3
"""What ./run bench px4 puts around PX4's own simulator, without PX4: the renderer's poses, the GPS receiver, the links, and
what is compared."""
import math
import pathlib
import socket
import sys
import unittest

import support
from support import dialect

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "e2e"))
from loop.px4_sitl import Px4Track, World, euler, link_lines
from loop.sitl_track import GLITCHING, POSITION_KNOWN
from simulated_autopilot.geo import LocalPlane
from simulated_autopilot.px4_projection import MapProjection
from simulated_autopilot.scenario import parse_event

CORNERS = [(48.79, 14.02), (48.79, 14.04), (48.80, 14.04)]
YAW, PITCH = math.radians(60), math.radians(10)


def quaternion(roll, pitch, yaw):
    c, s = zip(*((math.cos(angle / 2), math.sin(angle / 2)) for angle in (roll, pitch, yaw)))
    return [c[0] * c[1] * c[2] + s[0] * s[1] * s[2], s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
            c[0] * s[1] * c[2] + s[0] * c[1] * s[2], c[0] * c[1] * s[2] - s[0] * s[1] * c[2]]


def truth(lat=48.7912345, lon=14.0254321):
    return dialect.MAVLink_hil_state_quaternion_message(
        0, quaternion(0.1, PITCH, YAW), 0.01, 0.02, 0.03, round(lat * 1e7), round(lon * 1e7), 640_000, 750, 1299, -20, 0, 0, 0, 0, 0)


def end():
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", 0))
    link.settimeout(5)
    return link


class Around(unittest.TestCase):
    def setUp(self):
        self.renderer, self.px4, self.seen = end(), end(), []
        self.world = World(self.renderer.getsockname()[1], LocalPlane(*CORNERS[0]), lambda message, now: self.seen.append(message))
        self.world.start()
        self.codec = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self.reader = dialect.MAVLink(None)

    def tearDown(self):
        self.world.stop()
        self.renderer.close()
        self.px4.close()

    def fly(self):
        self.px4.sendto(truth().pack(self.codec), ("127.0.0.1", self.world.port))

    def received(self, link):
        return self.reader.parse_buffer(link.recv(65536))[0]

    def gps(self):
        self.world.next_gps_s = 0.0
        self.fly()
        return self.received(self.px4)

    def test_the_renderer_gets_the_truth(self):
        self.fly()
        pose = self.received(self.renderer)
        self.assertEqual(("SIM_STATE", 487912345, 140254321), (pose.get_type(), pose.lat_int, pose.lon_int))
        for expected, found in zip((0.1, PITCH, YAW, 640, 7.5, 12.99, -0.2), (
                pose.roll, pose.pitch, pose.yaw, pose.alt, pose.vn, pose.ve, pose.vd)):
            self.assertAlmostEqual(expected, found, 4)
        self.assertEqual(["HIL_STATE_QUATERNION"], [message.get_type() for message in self.seen])

    def test_a_dark_camera_gets_none(self):
        self.world.happen(parse_event("1:camera-cut"))
        self.gps()
        self.renderer.settimeout(0.1)
        self.assertRaises(TimeoutError, self.received, self.renderer)
        self.world.happen(parse_event("2:camera-restore"))
        self.gps()
        self.assertEqual("SIM_STATE", self.received(self.renderer).get_type())

    def test_px4_gets_its_receiver_from_its_own_system(self):
        fix = self.gps()
        self.assertEqual(("HIL_GPS", 1, 3), (fix.get_type(), fix.get_srcSystem(), fix.fix_type))
        self.assertLess(math.dist(self.world.local.to_plane(fix.lat * 1e-7, fix.lon * 1e-7),
                                  self.world.local.to_plane(48.7912345, 14.0254321)), 8)
        self.assertAlmostEqual(15.0, fix.vel / 100, delta=1)
        self.assertAlmostEqual(60.0, fix.cog / 100, delta=5)

    def test_the_receiver_is_denied_and_moved(self):
        self.world.happen(parse_event("1:gps-step=300@0"))
        fix = self.gps()
        north, _ = self.world.local.to_plane(fix.lat * 1e-7, fix.lon * 1e-7)
        self.assertAlmostEqual(300, north - self.world.local.to_plane(48.7912345, 14.0254321)[0], delta=8)
        self.world.happen(parse_event("2:gps-denied"))
        self.assertEqual((1, 0), (self.gps().fix_type, 0))


class Compared(unittest.TestCase):
    def setUp(self):
        self.track = Px4Track(CORNERS)
        self.codec = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self.hear(dialect.MAVLink_attitude_message(10_000, 0.1, PITCH, YAW, 0, 0, 0))

    def received(self, message):
        return dialect.MAVLink(None).parse_buffer(message.pack(self.codec))[0]

    def hear(self, message, now=100.0):
        self.track(self.received(message), now)

    def error(self):
        self.hear(truth())
        (_, metres), = self.track.fix_errors(self.track.given, 9.9, 10.1)
        return metres

    def test_our_position_as_it_is_sent(self):
        lat, lon = LocalPlane(48.7912345, 14.0254321).to_degrees(3, 4)
        self.track.give(self.received(dialect.MAVLink_global_position_sensor_message(
            1, 1, 1, 0, 0, dialect.GLOBAL_POSITION_SRC_VISION, 0, round(lat * 1e7), round(lon * 1e7), 0, 640, 2.5, 10)), 100.0)
        self.assertAlmostEqual(5.0, self.error(), 1)
        self.assertEqual(2.5, self.track.given[0][4])

    def test_odometry_counts_from_the_origin_and_is_nothing_without_one(self):
        covariance = [4.0] + [math.nan] * 20
        odometry = dialect.MAVLink_odometry_message(0, dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_BODY_FRD, 200, -100, 0,
                                                    [math.nan] * 4, *[math.nan] * 6, covariance, covariance)
        self.track.give(self.received(odometry), 100.0)
        self.assertEqual([], self.track.given)
        self.hear(dialect.MAVLink_gps_global_origin_message(487900000, 140200000, 300_000))
        self.track.give(self.received(odometry), 100.0)
        place = MapProjection(48.79, 14.02).reproject(200, -100)
        self.assertAlmostEqual(0, math.dist(self.track.given[0][2:4], self.track.local.to_plane(*place)), 3)
        self.assertEqual(2.0, self.track.given[0][4])

    def test_flags_are_those_of_the_other_filter(self):
        for flags, expected in ((dialect.ESTIMATOR_POS_HORIZ_ABS, POSITION_KNOWN), (dialect.ESTIMATOR_GPS_GLITCH, GLITCHING), (
                dialect.ESTIMATOR_ATTITUDE, 0)):
            self.hear(dialect.MAVLink_estimator_status_message(0, flags, 0, 0, 0, 0, 0, 0, 0, 0))
            self.assertEqual(expected, self.track.filter[-1][1])

    def test_the_attitude_is_compared_with_the_truth(self):
        self.hear(truth())
        self.hear(dialect.MAVLink_attitude_message(10_000, 0.1, PITCH, YAW + math.radians(3), 0, 0, 0))
        for expected, found in zip((0, 0, 3), self.track.attitude[-1][1:]):
            self.assertAlmostEqual(expected, found, 2)

    def test_a_clock_that_falls_behind_is_followed(self):
        for second in range(1, 11):
            self.hear(dialect.MAVLink_attitude_message(10_000 + 900 * second, 0, 0, 0, 0, 0, 0), 100.0 + second)
        self.assertAlmostEqual(10.9, self.track.boot_s(101.0), delta=0.3)
        self.assertAlmostEqual(19.0, self.track.boot_s(110.0), delta=0.3)

    def test_the_version_names_the_commit(self):
        self.hear(dialect.MAVLink_autopilot_version_message(0, 0x01120040, 0, 0, 0, [8, 7, 6, 5, 4, 3, 2, 1], [0] * 8, [0] * 8, 0, 0, 1))
        self.assertEqual("PX4 1.18.0 (0102030405)", self.track.version)

    def test_angles_of_a_rotation(self):
        for expected, found in zip((0.1, -0.2, 3.0), euler(quaternion(0.1, -0.2, 3.0))):
            self.assertAlmostEqual(expected, found)

    def test_three_links_of_which_the_last_carries_the_truth(self):
        lines = list(link_lines([(1001, "onboard", True), (1002, "onboard", True), (1003, "custom", False)]))
        self.assertEqual(["-f" in line for line in lines[:3]], [True, True, False])
        self.assertTrue(all(f"-o {port} " in line for port, line in zip((1001, 1002, 1003), lines)))
        self.assertEqual(lines[2].split()[3], lines[3].split()[-1])


if __name__ == "__main__":
    unittest.main()
