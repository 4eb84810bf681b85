"""A ground station's end of a link to ArduPlane or PX4, with pymavlink: parameters, a mission, arming, and status texts."""
import math
import pathlib
import sys
import time

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "support"))
from simulated_autopilot import px4_protocol

PATIENCE_S = 30
SIGNING_EPOCH = 1420070400  # 2015-01-01


class GroundStation:
    def __init__(self, port, vehicle):
        """vehicle: ArduPlane or Px4."""
        self.vehicle = vehicle
        self.link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255, dialect="ardupilotmega")
        self.listeners = []
        self.texts = []  # (monotonic seconds, severity, text)

    def sign(self, key):
        """key: 32 bytes. ArduPilot begins a minute ahead of the time that it was given with it."""
        ahead = int((time.time() - SIGNING_EPOCH + 90) * 1e5)
        self.link.setup_signing(key, sign_outgoing=True, allow_unsigned_callback=lambda *_: True, initial_timestamp=ahead)

    def close(self):
        self.link.close()

    def receive(self, patience_s=0.02):
        """The next message, given to all listeners; None when none came."""
        message = self.link.recv_match(blocking=True, timeout=patience_s)
        if message is None or message.get_type() == "BAD_DATA":
            return None
        if message.get_type() == "STATUSTEXT":
            self.texts.append((time.monotonic(), message.severity, message.text))
        for listener in self.listeners:
            listener(message, time.monotonic())
        return message

    def wait_for(self, what, wanted, say=None, patience_s=PATIENCE_S):
        """The first message for which `wanted` is true. say: called at once, and again every second."""
        until, next_say = time.monotonic() + patience_s, 0.0
        while time.monotonic() < until:
            if say is not None and time.monotonic() >= next_say:
                next_say = time.monotonic() + 1
                say()
            message = self.receive()
            if message is not None and wanted(message):
                return message
        last = "; ".join(text for _, _, text in self.texts[-5:])
        raise SystemExit(f"{self.vehicle.name}: no {what} in {patience_s} s; it said last: {last or 'nothing'}")

    def meet(self):
        """Its first heartbeat; then asks for what is watched."""
        def beats(message):
            return message.get_type() == "HEARTBEAT" and message.autopilot == self.vehicle.autopilot
        beat = self.wait_for("heartbeat", beats)
        self.link.target_system, self.link.target_component = beat.get_srcSystem(), beat.get_srcComponent()
        self.ask_for_all()

    def ask_for_all(self):
        for name, rate in self.vehicle.rates.items():
            self.ask_for(name, rate)
        self.command(*self.vehicle.ask_for_version)

    def ask_for(self, name, rate_hz):
        self.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, getattr(dialect, f"MAVLINK_MSG_ID_{name}"), round(1e6 / rate_hz))

    def set(self, name, value):
        def ask():
            self.link.mav.param_request_read_send(*self._target(), name.encode(), -1)

        def send():
            self.link.mav.param_set_send(*self._target(), name.encode(), sent, kind)
        kind = self.wait_for(name, lambda m: m.get_type() == "PARAM_VALUE" and m.param_id == name, ask).param_type
        bytewise = self.vehicle.autopilot == dialect.MAV_AUTOPILOT_PX4 and kind == px4_protocol.INT
        sent = px4_protocol.to_wire(round(value)) if bytewise else value
        self.wait_for(f"answer about {name}", lambda m: m.get_type() == "PARAM_VALUE" and m.param_id == name
                      and math.isclose(m.param_value, sent, rel_tol=1e-6, abs_tol=0 if bytewise else 1e-6), send)

    def command(self, number, *values):
        """Until it is taken; SystemExit when it is not."""
        def send():
            self.link.mav.command_long_send(*self._target(), number, 0, *values, *[0] * (7 - len(values)))
        self.wait_for(f"taking of command {number}", lambda m: m.get_type() == "COMMAND_ACK" and m.command == number
                      and m.result == dialect.MAV_RESULT_ACCEPTED, send)

    def upload(self, items):
        """items: (command, frame, param1, param2, lat_deg, lon_deg, altitude_m)."""
        self.link.mav.mission_count_send(*self._target(), len(items))
        while True:
            message = self.wait_for("request for the mission", lambda m: m.get_type() in (
                "MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK"))
            if message.get_type() == "MISSION_ACK":
                if message.type != dialect.MAV_MISSION_ACCEPTED:
                    raise SystemExit(f"{self.vehicle.name} refuses the mission ({message.type})")
                return
            number, frame, first, second, lat, lon, height = items[message.seq]
            self.link.mav.mission_item_int_send(*self._target(), message.seq, frame, number, 0, 1, first, second, 0, 0,
                                                round(lat * 1e7), round(lon * 1e7), height)

    def arm(self):
        """Asks until it is armed; what it finds wrong before comes as texts."""
        self.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def fly_mission(self):
        self.command(dialect.MAV_CMD_DO_SET_MODE, dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, *self.vehicle.mode)

    def _target(self):
        return self.link.target_system, self.link.target_component
