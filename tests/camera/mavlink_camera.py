#!/usr/bin/env python3
"""A camera on MAVLink (Camera Protocol v2), by pymavlink: says where its video streams are when it is asked.

    mavlink_camera.py PORT KEY [STREAMS]

Sends heartbeats to 127.0.0.1:PORT as the autopilot 1/1, and as the camera 1/100 what it is asked for; both sign with KEY, 64
hexadecimal digits, or "none". STREAMS: a list in JSON of {"type", "width", "height", "uri", "flags"}; without it the camera
has none. Prints a line for each request. Until it is killed.
"""
import json
import math
import socket
import sys
import time

from pymavlink.dialects.v20 import ardupilotmega as dialect

NAMES = {dialect.MAVLINK_MSG_ID_CAMERA_INFORMATION: "information",
         dialect.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION: "streams"}


class Wire:
    def __init__(self, port):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(0.1)
        self.target = ("127.0.0.1", port)

    def write(self, data):
        self.socket.sendto(data, self.target)


def component(wire, number, key, link):
    mav = dialect.MAVLink(wire, srcSystem=1, srcComponent=number)
    mav.robust_parsing = True
    if key != "none":
        mav.signing.secret_key = bytes.fromhex(key)
        mav.signing.sign_outgoing = True
        mav.signing.link_id = link
        mav.signing.timestamp = int((time.time() - 1420070400) * 1e5)
    return mav


def information(has_streams):
    name = lambda text: [*text.encode().ljust(32, b"\0")]
    flags = dialect.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM if has_streams else dialect.CAMERA_CAP_FLAGS_CAPTURE_IMAGE
    return dialect.MAVLink_camera_information_message(0, name("Example"), name("Eye 1"), 0, math.nan, math.nan, math.nan, 0, 0, 0,
                                                      flags, 0, b"")


def stream_information(number, count, stream):
    return dialect.MAVLink_video_stream_information_message(
        number, count, stream.get("type", 0), stream.get("flags", 1), 5.0, stream.get("width", 0), stream.get("height", 0), 1000, 0,
        60, f"stream {number}".encode(), stream["uri"].encode())


def main():
    wire = Wire(int(sys.argv[1]))
    key = sys.argv[2]
    streams = json.loads(sys.argv[3]) if len(sys.argv) > 3 else []
    autopilot, camera = component(wire, 1, key, 0), component(wire, 100, key, 1)
    beat_s = 0.0
    while True:
        if time.monotonic() - beat_s > 0.5:
            beat_s = time.monotonic()
            autopilot.heartbeat_send(dialect.MAV_TYPE_FIXED_WING, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 4)
            camera.heartbeat_send(dialect.MAV_TYPE_CAMERA, dialect.MAV_AUTOPILOT_INVALID, 0, 0, 4)
        try:
            data = wire.socket.recv(4096)
        except TimeoutError:
            continue
        for message in camera.parse_buffer(data) or []:
            if message.get_type() != "COMMAND_LONG" or message.target_component != 100:
                continue
            asked = NAMES.get(int(message.param1)) if message.command == dialect.MAV_CMD_REQUEST_MESSAGE else None
            result = dialect.MAV_RESULT_ACCEPTED if asked else dialect.MAV_RESULT_UNSUPPORTED
            camera.command_ack_send(message.command, result)
            print(asked, flush=True)
            if asked == "information":
                camera.send(information(bool(streams)))
            elif asked == "streams":
                for number, stream in enumerate(streams, 1):
                    camera.send(stream_information(number, len(streams), stream))


if __name__ == "__main__":
    main()
