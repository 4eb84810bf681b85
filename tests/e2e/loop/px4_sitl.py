"""PX4 itself, as built for its own simulator (SITL) with the aircraft inside (SIH): how it is started, provisioned and
troubled, and the parameters that it flies with.

SIH has aerodynamics, an airspeed sensor, a barometer and a compass, but no wind, and its GPS can only be switched off. The
receiver is therefore ours: HIL_GPS, which PX4 takes for its own receiver, as from any simulator outside (MAV_USEHILGPS).
"""
import collections
import math
import os
import pathlib
import random
import select
import socket
import sys
import threading
import time

from pymavlink.dialects.v20 import ardupilotmega as dialect

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "support"))
from simulated_autopilot.px4_projection import MapProjection
from simulated_autopilot.receiver import Receiver

from .link_endpoint import signing_time
from .ports import free_port
from .sitl_track import CONST_POSITION, FIX_3D, GLITCHING, POSITION_KNOWN, Track

AUTO_MAIN, AUTO_MISSION = 4, 4  # modes: src/modules/commander/px4_custom_mode.h
TAKEOFF_M, PITCH_DEG = 40, 15
LAPS = 1000
TRUTH_HZ = 50

PARAMETERS = {
    "RWTO_TKOFF": 0,  # thrown: on the ground SIH drags its belly
    "SENS_EN_GPSSIM": 0, "MAV_USEHILGPS": 1,
    "MIS_TKO_LAND_REQ": 0,  # a circuit has no landing
    "COM_RC_IN_MODE": 4, "NAV_DLL_ACT": 0, "SYS_FAILURE_EN": 0,  # no sticks, and no ground station that it would miss
    "FW_R_LIM": 40,  # as ArduPlane's: more would show the camera the horizon
    "SDLOG_MODE": -1,
}
# ESTIMATOR_STATUS, and what it says in the flags of EKF_STATUS_REPORT.
FLAGS = ((dialect.ESTIMATOR_POS_HORIZ_ABS, POSITION_KNOWN), (dialect.ESTIMATOR_CONST_POS_MODE, CONST_POSITION),
         (dialect.ESTIMATOR_GPS_GLITCH, GLITCHING))

Place = collections.namedtuple("Place", "north east altitude velocity")


class Px4Track(Track):
    """Our position is what nadird sends (a listener of its --logger), the receiver GPS_RAW_INT."""

    version = "unknown"

    def _begin(self):
        super()._begin()
        self.origin = None  # of PX4's local frame

    def _hil_state_quaternion(self, message, now):
        if not self._clock:
            return
        self._true_attitude = (self.boot_s(now), euler(message.attitude_quaternion),
                               (message.rollspeed, message.pitchspeed, message.yawspeed))
        self.truth.append((self.boot_s(now), *self.local.to_plane(message.lat * 1e-7, message.lon * 1e-7),
                           message.alt / 1000, message.vx / 100, message.vy / 100))

    def _gps_raw_int(self, message, _now):
        self._receiver(self.own, message)

    def _gps_global_origin(self, message, _now):
        self.origin = MapProjection(message.latitude * 1e-7, message.longitude * 1e-7)

    def _autopilot_version(self, message, _now):
        major, minor, patch, _kind = message.flight_sw_version.to_bytes(4, "big")
        commit = bytes(message.flight_custom_version)[::-1].hex()[:10]
        self.version = f"PX4 {major}.{minor}.{patch} ({commit})"

    def _estimator_status(self, message, now):
        flags = sum(ours for theirs, ours in FLAGS if message.flags & theirs)
        self.filter.append((self.boot_s(now), flags, message.pos_horiz_ratio))

    def give(self, message, now):
        """A position that nadird sent."""
        if not self._clock:
            return
        if message.get_type() == "GLOBAL_POSITION_SENSOR":
            place, sigma = (message.lat * 1e-7, message.lon * 1e-7), message.eph
        elif message.get_type() == "ODOMETRY" and self.origin is not None:
            place, sigma = self.origin.reproject(message.x, message.y), math.sqrt(message.pose_covariance[0])
        else:
            return
        self.given.append((self.boot_s(now), FIX_3D, *self.local.to_plane(*place), sigma, None))


def euler(q):
    """Roll, pitch, yaw of a rotation from body to north, east, down."""
    w, x, y, z = q
    return (math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), math.asin(max(-1, min(1, 2 * (w * y - z * x)))),
            math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


class World(threading.Thread):
    """What lies between the simulated aircraft and its instruments: its truth becomes poses for the renderer (SIM_STATE) and
    measurements of its GPS receiver (HIL_GPS)."""

    def __init__(self, renderer_port, local, on_truth):
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.renderer, self.local, self.on_truth = ("127.0.0.1", renderer_port), local, on_truth
        self.receiver = Receiver(random.Random("1/px4"))
        self.camera_cut = False
        self.mav = dialect.MAVLink(None, srcSystem=1, srcComponent=dialect.MAV_COMP_ID_GPS)
        self.reader = dialect.MAVLink(None)
        self.reader.robust_parsing = True
        self.next_gps_s = 0.0
        self.stopped = threading.Event()

    def run(self):
        while not self.stopped.is_set():
            if not select.select([self.socket], [], [], 0.1)[0]:
                continue
            data, px4 = self.socket.recvfrom(65536)
            for message in self.reader.parse_buffer(data) or []:
                if message.get_type() == "HIL_STATE_QUATERNION" and message.lat != 0:
                    self._pass_on(message, time.monotonic(), px4)

    def sign(self, key):
        """Its own receiver, too: a PX4 that signs takes no GPS from a link that does not."""
        signing = self.mav.signing
        signing.secret_key, signing.link_id, signing.sign_outgoing = key, 7, True
        signing.timestamp = signing_time(ahead_s=90)

    def stop(self):
        self.stopped.set()
        self.join()
        self.socket.close()

    def happen(self, event):
        if event.action in ("camera-cut", "camera-restore"):
            self.camera_cut = event.action == "camera-cut"
        else:
            self.receiver.happen(event)

    def _pass_on(self, truth, now, px4):
        self.on_truth(truth, now)
        if not self.camera_cut:
            self._send(sim_state(truth), self.renderer)
        if now >= self.next_gps_s:
            self.next_gps_s = max(self.next_gps_s + Receiver.PERIOD, now)
            place = Place(*self.local.to_plane(truth.lat * 1e-7, truth.lon * 1e-7), truth.alt / 1000,
                          (truth.vx / 100, truth.vy / 100, truth.vz / 100))
            self._send(hil_gps(self.receiver.sample(place), self.local), px4)

    def _send(self, message, address):
        self.socket.sendto(message.pack(self.mav), address)
        self.mav.seq = (self.mav.seq + 1) % 256


def sim_state(truth):
    """As ArduPilot's simulator says it."""
    nothing = [0.0] * 3
    return dialect.MAVLink_sim_state_message(
        *truth.attitude_quaternion, *euler(truth.attitude_quaternion), *nothing, truth.rollspeed, truth.pitchspeed,
        truth.yawspeed, truth.lat * 1e-7, truth.lon * 1e-7, truth.alt / 1000, 0, 0, truth.vx / 100, truth.vy / 100,
        truth.vz / 100, truth.lat, truth.lon)


def hil_gps(sample, local):
    now_us = time.time_ns() // 1000
    if sample.fix_type < FIX_3D:
        return dialect.MAVLink_hil_gps_message(now_us, sample.fix_type, 0, 0, 0, 65535, 65535, 0, 0, 0, 0, 65535, 0)
    lat, lon = local.to_degrees(sample.north, sample.east)
    velocity = [round(100 * v) for v in sample.velocity]
    course = math.degrees(math.atan2(velocity[1], velocity[0])) % 360
    return dialect.MAVLink_hil_gps_message(
        now_us, sample.fix_type, round(lat * 1e7), round(lon * 1e7), round(1000 * sample.altitude), round(100 * sample.h_acc),
        round(100 * sample.v_acc), round(math.hypot(*velocity[:2])), *velocity, round(100 * course) % 36000,
        sample.satellites)


class Px4:
    name = "PX4"
    autopilot = dialect.MAV_AUTOPILOT_PX4
    mode = (AUTO_MAIN, AUTO_MISSION)
    rates = {"GLOBAL_POSITION_INT": 10, "GPS_RAW_INT": 5, "ESTIMATOR_STATUS": 5, "ATTITUDE": 10, "SYSTEM_TIME": 1,
             "GPS_GLOBAL_ORIGIN": 1}
    track = Px4Track
    uncertainty = {"heading_deg": 5.0, "tilt_deg": 2.0}
    ask_for_version = (dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    actions = ("gps-denied", "gps-step", "gps-drag", "gps-recover", "camera-cut", "camera-restore")
    is_provisioned = False
    listed_parameters = {"EKF2_AGP0_ID": 1, "EKF2_AGP0_CTRL": 1, "EKF2_AGP0_MODE": 0, "EKF2_AGP0_DELAY": 0, "EKF2_AGP0_GATE": 5,
                         "EKF2_HGT_REF": 0}
    restarts_itself = False  # its simulator does not know the command

    def __init__(self, program, changed=None):
        """program: `build/px4_sitl_default/bin/px4`. changed: parameters beside PARAMETERS."""
        self.program = pathlib.Path(program).resolve()
        self.parameters = {**PARAMETERS, **(changed or {})}
        self.world = None
        self.sent = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # what nadird sends, from its --logger
        self.sent.bind(("127.0.0.1", 0))
        self.sent.setblocking(False)
        self.reader = dialect.MAVLink(None)
        self.reader.robust_parsing = True

    @property
    def nadird_options(self):
        return ("--logger", f"udpout:127.0.0.1:{self.sent.getsockname()[1]}")

    def start(self, flight, station_port):
        folder = flight.run / "px4"
        if self.world is None:
            folder.mkdir()
            self.world = World(flight.truth_port, flight.track.local, flight.track)
            self.world.start()
            links = [(station_port, "onboard", True), (flight.link_port, "onboard", True), (self.world.port, "custom", False)]
            # PX4's start script looks for these two on PATH, and finds ours first.
            (folder / "px4-rc.mavlink").write_text("\n".join(link_lines(links)) + "\n", encoding="ascii")
            (folder / "px4-rc.simulator").write_text("".join(
                f"param set {name} {value:g}\n" for name, value in self.parameters.items())
                + ". etc/init.d-posix/px4-rc.simulator\n", encoding="ascii")
        lat, lon, height_m, _ = flight.home()
        environment = {"PX4_SIM_MODEL": "sihsim_airplane", "PX4_HOME_LAT": f"{lat:.7f}", "PX4_HOME_LON": f"{lon:.7f}",
                       "PX4_HOME_ALT": f"{height_m:.2f}", "PATH": f"{folder}:{os.environ['PATH']}"}
        return flight.programs.start("px4", ["env", "-C", folder, self.program, "-d", self.program.parent.parent / "etc"],
                                     environment)

    def mission(self, corners, altitude_m):
        """Take-off, then the circuit."""
        above_sea, above_home = dialect.MAV_FRAME_GLOBAL, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT
        return [(dialect.MAV_CMD_NAV_TAKEOFF, above_home, PITCH_DEG, 0, *corners[1], TAKEOFF_M),
                *((dialect.MAV_CMD_NAV_WAYPOINT, above_sea, 0, 0, *corner, altitude_m)
                  for corner in [*corners[1:], corners[0]]),
                (dialect.MAV_CMD_DO_JUMP, dialect.MAV_FRAME_MISSION, 1, LAPS, 0, 0, 0)]

    def sign(self, key):
        self.world.sign(key)

    def happen(self, event, _flight):
        self.world.happen(event)

    def version(self, flight):
        return flight.track.version

    def receive(self, track):
        """What nadird has sent since."""
        while True:
            try:
                data = self.sent.recv(65536)
            except BlockingIOError:
                return
            for message in self.reader.parse_buffer(data) or []:
                track.give(message, time.monotonic())

    def close(self):
        self.sent.close()
        if self.world is not None:
            self.world.stop()


def link_lines(links):
    """links: [(to whom, mode, whether it is forwarded to the others)]; the last one carries the truth."""
    for to, mode, forwards in links:
        here = free_port()
        yield f"mavlink start -u {here} -o {to} -m {mode} -r 4000000{' -f' if forwards else ''}"
    yield f"mavlink stream -r {TRUTH_HZ} -s HIL_STATE_QUATERNION -u {here}"
