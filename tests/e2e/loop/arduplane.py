"""ArduPlane itself, as built for its own simulator (SITL): how it is started, and the parameters that it flies with."""
import pathlib
import re

# ArduPilot keeps the tuning of the simulated aircraft inside the program.
AIRFRAME = "@ROMFS/models/plane.parm"
GPS_CHECK = 1 << 3  # of ARMING_CHECK, and of ARMING_SKIPCHK, which newer versions have instead
OTHER_CHECKS = sum(1 << bit for bit in range(1, 21)) & ~GPS_CHECK
METRES_PER_DEGREE = 111_320

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
# Of its attitude while it flies by our fix, one sigma: measured, docs/closed-loop.md.
UNCERTAINTY = {"heading_deg": 5.0, "tilt_deg": 2.0}
# With one receiver of its own, ArduPilot's second is the simulator's first: GPS_INPUT needs no port.
DENY = {"SIM_GPS1_ENABLE": 0}


# What `nadir provision autopilot` is there to change.
UNPROVISIONED = {"GPS1_TYPE": 1, "GPS1_DELAY_MS": 0}


def spoof(metres):
    """Moves the real receiver north."""
    return {"SIM_GPS1_GLTCH_X": metres / METRES_PER_DEGREE}


def command(program, folder, home, ports, changed=None):
    """The command line. folder: for its memory and its logs; empty, so that it begins as new. home: (lat_deg, lon_deg,
    height_m, heading_deg). ports: to whom its links 0, 1 and 2 speak, UDP. changed: parameters beside PARAMETERS."""
    defaults = folder / "nadir.parm"
    defaults.write_text("".join(f"{name} {value}\n" for name, value in {**PARAMETERS, **(changed or {})}.items()),
                        encoding="ascii")
    links = [word for number, port in enumerate(ports) for word in (f"--serial{number}", f"udpclient:127.0.0.1:{port}")]
    return ["env", "-C", folder, pathlib.Path(program).resolve(), "--model", "plane", "--speedup", 1, "--home",
            "{:.7f},{:.7f},{:.2f},{:.1f}".format(*home), "--defaults", f"{AIRFRAME},{defaults}", *links]


def version(text):
    """As the program says it in a STATUSTEXT; None in any other."""
    found = re.match(r"ArduPlane V\S+ \(\w+\)", text)
    return found.group(0) if found else None
