#!/usr/bin/env python3
"""The link: signatures, parameters, commands, telemetry rates, damage."""
import collections
import random
import unittest

import support
from simulated_autopilot.scenario import parse_event
from support import dialect

KEY = bytes(range(32))


def kinds(messages):
    return collections.Counter(message.get_type() for message in messages)


class LinkTest(unittest.TestCase):
    def test_sends_each_message_at_its_rate(self):
        aircraft, companion = support.vehicle()
        support.fly(aircraft, 1)
        companion.read()
        support.fly(aircraft, 10)
        received = kinds(companion.read())
        for name, count in (("HEARTBEAT", 10), ("ATTITUDE", 250), ("RAW_IMU", 500), ("GPS_RAW_INT", 50),
                            ("EKF_STATUS_REPORT", 50)):
            self.assertAlmostEqual(count, received[name], delta=1, msg=name)
        self.assertNotIn("BAD_DATA", received)
        self.assertNotIn("SIM_STATE", received)

    def test_the_receivers_stand_where_the_parameters_say(self):
        for instance in (0, 1):
            aircraft, companion = support.vehicle(gps_input_instance=instance)
            companion.send(support.gps_input(gps_id=instance, h_acc=7))
            support.fly(aircraft, 1)
            last = {message.get_type(): message for message in companion.read()}
            given, own = ("GPS_RAW_INT", "GPS2_RAW") if instance == 0 else ("GPS2_RAW", "GPS_RAW_INT")
            self.assertEqual(7000, last[given].h_acc)
            self.assertEqual((3, 14), (last[own].fix_type, last[own].satellites_visible))

    def test_the_truth_goes_its_own_way(self):
        aircraft, _ = support.vehicle()
        wire = support.Wire()
        aircraft.truth_links = [support.Link(wire)]
        support.fly(aircraft, 2)
        messages = support.Companion(wire).read()
        self.assertEqual(kinds(messages), {"SIM_STATE": 50, "SYSTEM_TIME": 50})
        lat, lon = aircraft.local.to_degrees(aircraft.plane.north, aircraft.plane.east)
        self.assertAlmostEqual(lat, messages[-1].lat_int * 1e-7, places=6)
        self.assertAlmostEqual(lon, messages[-1].lon_int * 1e-7, places=6)

    def test_signed_it_accepts_only_holders_of_the_key(self):
        aircraft, companion = support.vehicle(key=KEY)
        foreign, unsigned = support.Companion(companion.wire, bytes(32)), support.Companion(companion.wire)
        for sender in (foreign, unsigned):
            sender.send(support.gps_input())
        support.fly(aircraft, 0.1)
        self.assertEqual({}, aircraft.protocol.received)
        self.assertEqual(2, aircraft.link.refused)
        companion.mav.signing.timestamp = aircraft.link.mav.signing.timestamp + 10
        companion.send(support.gps_input())
        support.fly(aircraft, 0.1)
        self.assertEqual({"GPS_INPUT": 1}, aircraft.protocol.received)
        self.assertNotIn("BAD_DATA", kinds(companion.read()))

    def test_a_key_is_installed_and_then_asked_for(self):
        aircraft, companion = support.vehicle()
        companion.send(dialect.MAVLink_setup_signing_message(1, 1, KEY, 5))
        support.fly(aircraft, 0.1)
        self.assertFalse(aircraft.link.signed)  # armed
        aircraft.armed = False
        companion.send(dialect.MAVLink_setup_signing_message(1, 1, KEY, 5))
        support.fly(aircraft, 0.1)
        self.assertTrue(aircraft.link.signed)
        companion.send(support.gps_input())
        support.fly(aircraft, 0.1)
        self.assertNotIn("GPS_INPUT", aircraft.protocol.received)
        self.assertNotIn(KEY.hex(), repr(aircraft.log.events))

    def test_a_cut_link_passes_nothing(self):
        aircraft, companion = support.vehicle([parse_event("2:link-cut"), parse_event("4:link-restore")])
        support.fly(aircraft, 2)
        companion.read()
        companion.send(support.gps_input())
        support.fly(aircraft, 1.9)
        self.assertEqual([], companion.read())
        self.assertEqual({}, aircraft.protocol.received)
        support.fly(aircraft, 0.2)
        companion.send(support.gps_input())
        support.fly(aircraft, 1)
        self.assertEqual({"GPS_INPUT": 1}, aircraft.protocol.received)
        self.assertGreater(len(companion.read()), 50)

    def test_parameters_are_listed_read_and_set(self):
        aircraft, companion = support.vehicle()
        companion.send(dialect.MAVLink_param_request_list_message(1, 1))
        support.fly(aircraft, 0.1)
        values = [m for m in companion.read() if m.get_type() == "PARAM_VALUE"]
        self.assertEqual(len(aircraft.protocol.parameters), len(values))
        self.assertEqual({len(values)}, {m.param_count for m in values})
        companion.send(dialect.MAVLink_param_set_message(1, 1, b"EK3_SRC1_YAW", 8, 9))
        companion.send(dialect.MAVLink_param_request_read_message(1, 1, b"EK3_SRC1_YAW", -1))
        companion.send(dialect.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
        companion.send(dialect.MAVLink_param_request_read_message(1, 1, b"", 999))
        support.fly(aircraft, 0.1)
        answers = [(m.param_id, m.param_value) for m in companion.read() if m.get_type() == "PARAM_VALUE"]
        self.assertEqual([("EK3_SRC1_YAW", 8.0)] * 2, answers)

    def test_faults_match_their_names(self):
        def answers(fault, message):
            aircraft, companion = support.vehicle(faults=(fault,))
            companion.send(message)
            support.fly(aircraft, 0.1)
            return [m for m in companion.read() if m.get_type() in ("PARAM_VALUE", "COMMAND_ACK")]
        set_one = dialect.MAVLink_param_set_message(1, 1, b"GPS1_TYPE", 2, 9)
        self.assertEqual([], answers("param-silent", set_one))
        self.assertEqual(14, answers("param-refuses", set_one)[0].param_value)
        arm = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, 0, 0, 0, 0, 0)
        self.assertEqual([], answers("command-silent", arm))

    def test_commands_are_answered(self):
        aircraft, companion = support.vehicle()
        interval = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
        for command, first, second in ((interval, 27, 20_000), (interval, 30, -1), (interval, 5, 1000),
                                       (dialect.MAV_CMD_REQUEST_MESSAGE, 148, 0), (dialect.MAV_CMD_DO_JUMP, 0, 0)):
            companion.send(dialect.MAVLink_command_long_message(1, 1, command, 0, first, second, 0, 0, 0, 0, 0))
        support.fly(aircraft, 0.02)
        messages = companion.read()
        results = [m.result for m in messages if m.get_type() == "COMMAND_ACK"]
        self.assertEqual([0, 0, dialect.MAV_RESULT_DENIED, 0, dialect.MAV_RESULT_UNSUPPORTED], results)
        self.assertEqual(1, kinds(messages)["AUTOPILOT_VERSION"])
        support.fly(aircraft, 5)
        self.assertNotIn("ATTITUDE", kinds(companion.read()))

    def test_an_external_position_is_logged(self):
        aircraft, companion = support.vehicle()
        companion.send(dialect.MAVLink_command_int_message(
            1, 1, 0, dialect.MAV_CMD_EXTERNAL_POSITION_ESTIMATE, 0, 0, 0, 0.1, 12, 0, 487900000, 140200000, 0))
        support.fly(aircraft, 0.1)
        event = next(e for e in aircraft.log.events if e["kind"] == "external_position")
        self.assertEqual((48.79, 14.02, 12), (round(event["lat"], 6), round(event["lon"], 6), event["accuracy_m"]))

    def test_noise_on_the_wire_harms_nothing(self):
        aircraft, companion = support.vehicle()
        generator = random.Random(9)
        for _ in range(50):
            companion.wire.back += generator.randbytes(100)
            support.fly(aircraft, 0.1)
        companion.wire.back += bytes(300)  # so that a false start ends
        support.fly(aircraft, 0.1)
        companion.send(support.gps_input())
        support.fly(aircraft, 0.1)
        self.assertEqual(1, aircraft.protocol.received.get("GPS_INPUT"))


if __name__ == "__main__":
    unittest.main(verbosity=2)
