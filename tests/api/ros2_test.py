#!/usr/bin/env python3
"""The node of docs/with-ros2.md, as it stands there, against the API, in each state. Debian 12 has no ROS 2: a stand-in for what the
node uses of rclpy and sensor_msgs takes its place, as strict about types as those are.

usage: ros2_test.py TEST_API_SERVER SOURCE_TREE
"""
import math
import pathlib
import re
import sys
import time
import types
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from scripted_service import ScriptedService  # noqa: E402

SERVER = sys.argv[1]
PAGE = pathlib.Path(sys.argv[2], "docs/with-ros2.md").read_text()
URL_OF_PAGE = "http://127.0.0.1:8750"


class Message:
    """Takes the fields it is made with, and values of their types alone."""

    def __init__(self, **fields):
        self.__dict__.update(fields)

    def __setattr__(self, name, value):
        before = self.__dict__[name]
        assert type(value) is type(before), f"{name} is a {type(before).__name__}, not {value!r}"
        if isinstance(before, list):
            assert len(value) == len(before) and all(type(v) is float for v in value), f"{name}: {value!r}"
        self.__dict__[name] = value


class Duration:
    def __init__(self, *, seconds):
        self.seconds = float(seconds)


class Time:
    def __init__(self, seconds):
        self.seconds = seconds

    def __sub__(self, duration):
        return Time(self.seconds - duration.seconds)

    def to_msg(self):
        return Message(sec=int(self.seconds), nanosec=int(self.seconds % 1 * 1e9))


def seconds_of(stamp):
    return stamp.sec + stamp.nanosec / 1e9


def nav_sat_status():
    return Message(status=0, service=0)


nav_sat_status.STATUS_NO_FIX, nav_sat_status.STATUS_FIX = -1, 0


def nav_sat_fix():
    return Message(header=Message(stamp=Time(0).to_msg(), frame_id=""), status=nav_sat_status(), latitude=0.0, longitude=0.0, altitude=0.0,
                   position_covariance=[0.0] * 9, position_covariance_type=0)


nav_sat_fix.COVARIANCE_TYPE_KNOWN = 3


class Node:
    made = None

    def __init__(self, name):
        Node.made, self.published, self.warnings = self, [], []

    def create_publisher(self, kind, topic, depth):
        assert (kind, topic, type(depth)) == (nav_sat_fix, "nadir/fix", int)
        return types.SimpleNamespace(publish=self.published.append)

    def create_timer(self, period_s, callback):
        self.timer = (period_s, callback)

    def get_clock(self):
        return types.SimpleNamespace(now=lambda: Time(time.time()))

    def get_logger(self):
        return types.SimpleNamespace(warning=lambda text, throttle_duration_sec: self.warnings.append(text))


def module(name, **members):
    made = types.ModuleType(name)
    made.__dict__.update(members)
    sys.modules[name] = made


def node_of_page(url):
    """What the page's program makes, with its timer in our hands."""
    module("rclpy", init=lambda: None, spin=lambda node: None)
    module("rclpy.duration", Duration=Duration)
    module("rclpy.node", Node=Node)
    module("sensor_msgs")
    module("sensor_msgs.msg", NavSatFix=nav_sat_fix, NavSatStatus=nav_sat_status)
    text = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL).group(1)
    assert URL_OF_PAGE in text
    exec(compile(text.replace(URL_OF_PAGE, url), "with-ros2.md", "exec"), {"__name__": "__main__"})
    return Node.made


class PublishedFixes(unittest.TestCase):
    def setUp(self):
        self.service = ScriptedService(SERVER)
        self.addCleanup(self.service.stop)
        self.node = node_of_page(self.service.url)

    def next_message(self, wanted=lambda message: True):
        """Ticks until a message comes that is wanted."""
        for _ in range(300):
            self.node.published.clear()
            self.node.timer[1]()
            for message in self.node.published:
                if wanted(message):
                    return message
            time.sleep(0.05)
        self.fail("no such message")

    def no_fix(self):
        return self.next_message(lambda message: message.status.status == nav_sat_status.STATUS_NO_FIX)

    def assert_no_position(self, message):
        self.assertTrue(all(math.isnan(v) for v in (message.latitude, message.longitude, message.altitude)))

    def test_a_usable_position(self):
        before = time.time()
        fix = self.next_message()
        self.assertEqual(nav_sat_status.STATUS_FIX, fix.status.status)
        self.assertAlmostEqual(47.4, fix.latitude, delta=0.01)
        self.assertAlmostEqual(8.5, fix.longitude, delta=0.01)
        self.assertTrue(math.isnan(fix.altitude))
        # Row by row, east north up: the script's covariance is 1.6, 0.3, 0.6 times the square of its σ.
        self.assertEqual([round(v, 3) for v in (12.544, 2.352, 0, 2.352, 4.704, 0, 0, 0)], [round(v, 3) for v in fix.position_covariance[:8]])
        self.assertGreater(fix.position_covariance[8], 1e5)
        self.assertEqual(nav_sat_fix.COVARIANCE_TYPE_KNOWN, fix.position_covariance_type)
        self.assertEqual("base_link", fix.header.frame_id)
        self.assertLess(abs(seconds_of(fix.header.stamp) - before), 1)

    def test_a_position_is_published_once(self):
        self.service.command("stall")
        for _ in range(20):
            self.node.timer[1]()
        places = [(m.latitude, m.longitude) for m in self.node.published if m.status.status == nav_sat_status.STATUS_FIX]
        self.assertEqual(len(set(places)), len(places))

    def test_what_is_not_usable_is_no_fix(self):
        self.service.command("degraded")  # with a protection level beyond the alert limit
        self.assert_no_position(self.no_fix())

    def test_no_fix_is_none(self):
        self.service.command("no_fix")
        self.assert_no_position(self.no_fix())
        self.assertEqual([], self.node.warnings)

    def test_an_old_state_is_no_fix(self):
        self.service.command("stall")
        self.assert_no_position(self.no_fix())

    def test_a_service_that_is_gone_is_no_fix_and_said(self):
        self.next_message()
        self.service.stop()
        self.assert_no_position(self.no_fix())
        self.assertTrue(self.node.warnings)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
