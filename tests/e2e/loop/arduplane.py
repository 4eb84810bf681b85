"""ArduPlane itself, as built for its own simulator (SITL): how it is started, provisioned and troubled, and the parameters
that it flies with."""
import math
import pathlib
import re

from pymavlink.dialects.v20 import ardupilotmega as dialect

from .sitl_track import Track

# ArduPilot keeps the tuning of the simulated aircraft inside the program.
AIRFRAME = "@ROMFS/models/plane.parm"
GPS_CHECK = 1 << 3  # of ARMING_CHECK, and of ARMING_SKIPCHK, which newer versions have instead
OTHER_CHECKS = sum(1 << bit for bit in range(1, 21)) & ~GPS_CHECK
METRES_PER_DEGREE = 111_320
AUTO = 10  # ArduPlane's number of the mode
TAKEOFF_M, PITCH_DEG = 40, 15

PARAMETERS = {
    "SERIAL1_PROTOCOL": 2, "SERIAL2_PROTOCOL": 2,
    # GPS_INPUT plays the first receiver and leads while it has a 3-D fix; the simulated real one is the second.
    "GPS1_TYPE": 14, "GPS1_DELAY_MS": 10, "GPS2_TYPE": 1, "GPS_PRIMARY": 0, "GPS_AUTO_SWITCH": 4,
    "EK3_SRC1_POSXY": 3, "EK3_SRC1_VELXY": 3, "EK3_SRC1_POSZ": 1, "EK3_SRC1_YAW": 1,
    # A camera on the ground sees no map, and every receiver must have a fix before ArduPilot arms.
    "ARMING_CHECK": OTHER_CHECKS, "ARMING_SKIPCHK": GPS_CHECK,
    # The simulated aircraft's usual 65° would show the camera the horizon.
    "ROLL_LIMIT_DEG": 40,
    "SIM_WIND_SPD": 4, "SIM_WIND_DIR": 300, "FS_GCS_ENABL": 0, "TERRAIN_ENABLE": 0,
}
# What `nadir provision autopilot` is there to change.
UNPROVISIONED = {"GPS1_TYPE": 1, "GPS1_DELAY_MS": 0}


class ArduPlane:
    name = "ArduPlane"
    autopilot = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    mode = (AUTO,)  # that flies the mission
    rates = {"SIM_STATE": 25, "GLOBAL_POSITION_INT": 10, "GPS_RAW_INT": 10, "GPS2_RAW": 5, "EKF_STATUS_REPORT": 5,
             "ATTITUDE": 10, "SYSTEM_TIME": 1}
    track = Track
    # Of its attitude while it flies by our fix, one sigma: measured, docs/closed-loop.md.
    uncertainty = {"heading_deg": 5.0, "tilt_deg": 2.0}
    ask_for_version = (dialect.MAV_CMD_DO_SEND_BANNER,)  # among the texts
    actions = ("gps-denied", "gps-step")
    nadird_options = ()
    is_provisioned = True  # by PARAMETERS
    listed_parameters = {name: PARAMETERS[name] for name in ("GPS1_TYPE", "GPS1_DELAY_MS", "EK3_SRC1_POSXY", "EK3_SRC1_VELXY",
                                                             "EK3_SRC1_POSZ", "EK3_SRC1_YAW")}
    restarts_itself = True

    def __init__(self, program, changed=None):
        """program: `build/sitl/bin/arduplane`. changed: parameters beside PARAMETERS."""
        self.program, self.changed = pathlib.Path(program).resolve(), changed or {}

    def start(self, flight, station_port):
        folder = flight.run / "arduplane"
        folder.mkdir()
        # ArduPilot treats link 0 as a cable and accepts it unsigned: the renderer uses it.
        return flight.programs.start("arduplane", command(
            self.program, folder, flight.home(), (flight.truth_port, station_port, flight.link_port),
            {**(UNPROVISIONED if flight.setup.signed else {}), **self.changed}))

    def mission(self, corners, altitude_m):
        """Home, take-off, then the circuit without end."""
        above_sea, above_home = dialect.MAV_FRAME_GLOBAL, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT
        waypoint = dialect.MAV_CMD_NAV_WAYPOINT
        return [(waypoint, above_sea, 0, 0, *corners[0], altitude_m),
                (dialect.MAV_CMD_NAV_TAKEOFF, above_home, PITCH_DEG, 0, *corners[1], TAKEOFF_M),
                *((waypoint, above_sea, 0, 0, *corner, altitude_m) for corner in [*corners[1:], corners[0]]),
                (dialect.MAV_CMD_DO_JUMP, above_sea, 2, -1, 0, 0, 0)]

    def sign(self, key):
        """Its receiver is inside it."""

    def happen(self, event, flight):
        """With one receiver of its own, ArduPilot's second is the simulator's first: GPS_INPUT needs no port."""
        if event.action == "gps-denied":
            flight.station.set("SIM_GPS1_ENABLE", 0)
        elif event.action == "gps-step":
            north, east = event.value * math.cos(event.bearing), event.value * math.sin(event.bearing)
            flight.station.set("SIM_GPS1_GLTCH_X", north / METRES_PER_DEGREE)  # degrees of latitude and of longitude
            flight.station.set("SIM_GPS1_GLTCH_Y", east / (METRES_PER_DEGREE * math.cos(math.radians(flight.home()[0]))))

    def version(self, flight):
        found = [match.group(0) for _, _, text in flight.station.texts if (match := re.match(r"ArduPlane V\S+ \(\w+\)", text))]
        return found[0] if found else "unknown"

    def receive(self, track):
        """GPS_RAW_INT is our fix."""

    def close(self):
        pass


def command(program, folder, home, ports, changed):
    """The command line. folder: for its memory and its logs; empty, so that it begins as new. home: (lat_deg, lon_deg,
    height_m, heading_deg). ports: to whom its links 0, 1 and 2 speak, UDP. changed: parameters beside PARAMETERS."""
    defaults = folder / "nadir.parm"
    defaults.write_text("".join(f"{name} {value}\n" for name, value in {**PARAMETERS, **changed}.items()), encoding="ascii")
    links = [word for number, port in enumerate(ports) for word in (f"--serial{number}", f"udpclient:127.0.0.1:{port}")]
    return ["env", "-C", folder, program, "--model", "plane", "--speedup", 1, "--home",
            "{:.7f},{:.7f},{:.2f},{:.1f}".format(*home), "--defaults", f"{AIRFRAME},{defaults}", *links]
