"""One flight of ArduPlane's simulator by nadird's fixes: take-off by its own GPS, a climb to the circuit, laps, and faults
of its GPS on the way."""
import csv
import math
import pathlib
import sys
import time

from pymavlink.dialects.v20 import ardupilotmega as dialect

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "support"))
from simulated_autopilot.terrain import Grid

from . import arduplane
from .flight import Flight, free_port
from .ground_station import GroundStation
from .run_summary import run_summary
from .sitl_track import POSITION_KNOWN, Track
from .watch import Watch

TAKEOFF_M, PITCH_DEG = 40, 15
READY_S, CLIMB_S = 90, 240
AT_HEIGHT_M = 15


def corners_of(path):
    with open(path, newline="", encoding="utf-8") as file:
        return [(float(row["lat_deg"]), float(row["lon_deg"])) for row in csv.DictReader(file)]


def mission(corners, altitude_m):
    """Take-off, then the circuit without end."""
    above_sea, above_home = dialect.MAV_FRAME_GLOBAL, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT
    waypoint = dialect.MAV_CMD_NAV_WAYPOINT
    return [(waypoint, above_sea, 0, 0, *corners[0], altitude_m),
            (dialect.MAV_CMD_NAV_TAKEOFF, above_home, PITCH_DEG, 0, *corners[1], TAKEOFF_M),
            *((waypoint, above_sea, 0, 0, *corner, altitude_m) for corner in [*corners[1:], corners[0]]),
            (dialect.MAV_CMD_DO_JUMP, above_sea, 2, -1, 0, 0, 0)]


class SitlFlight(Flight):
    """A context, as Flight. `setup.events` are [(seconds after the circuit was reached, {parameter: value})]."""

    def __init__(self, setup, program, parameters=None):
        super().__init__(setup)
        self.program, self.parameters = program, parameters or {}
        self.corners = corners_of(self.inputs.waypoints)
        self.track = Track(self.corners)
        self.station = None
        self.on_circuit_s = None  # boot seconds; the events count from here
        self.done = []  # (boot seconds, what was done to it)

    def __exit__(self, *error):
        if self.station is not None:
            self.station.close()
        super().__exit__(*error)

    def start(self):
        self.start_camera()
        self.start_autopilot()
        if self.setup.signed:
            self._provision()
        self.start_service()
        self.watch = Watch(self.url, self.service)
        self.watch.start()

    def start_autopilot(self):
        self.begun = time.monotonic()
        folder = self.run / "arduplane"
        folder.mkdir()
        port = free_port()
        # ArduPilot treats link 0 as a cable and accepts it unsigned: the renderer uses it.
        self.autopilot = self.programs.start("arduplane", arduplane.command(
            self.program, folder, self._home(), (self.truth_port, port, self.link_port),
            {**(arduplane.UNPROVISIONED if self.setup.signed else {}), **self.parameters}))
        self.station = GroundStation(port)
        self.station.listeners.append(self.track)
        self.station.meet()
        self.begun_flying = time.monotonic()

    def fly(self, seconds):
        """Take-off, climb, and so many seconds on the circuit."""
        self._be_ready()
        self.station.upload(mission(self.corners, self.inputs.altitude_m))
        self.station.fly_mission()
        self.station.arm()
        self._climb()
        self.on_circuit_s = self.track.now_s
        waiting = sorted(self.setup.events, key=lambda event: event[0])
        while self.track.now_s < self.on_circuit_s + seconds:
            self.receive()
            if waiting and self.track.now_s >= self.on_circuit_s + waiting[0][0]:
                for name, value in waiting.pop(0)[1].items():
                    self.station.set(name, value)
                    self.done.append((self.track.now_s, f"{name} {value:g}"))

    def receive(self):
        self.station.receive()
        for program in (self.service, self.camera, self.autopilot):
            if not program.running():
                raise SystemExit(f"{program.name} ended with {program.process.returncode}:\n{program.tail()}")

    def finish(self):
        """nadird's own summary."""
        self.watch.stop()
        code = self.service.end()
        self.camera.end()
        if code != 0:
            raise SystemExit(f"service ended with {code}:\n{self.service.tail()}")
        return run_summary(self.service.text())

    def _provision(self):
        """Parameters, restart and key, as a user provisions them; texts are received meanwhile."""
        command = self.programs.start("provision", [
            self.setup.nadir, "provision", "autopilot", "--autopilot", f"udpin:127.0.0.1:{self.link_port}", "--apply",
            "--signing-key", self.inputs.key])
        while command.running():
            self.station.receive()
        if command.end() != 0:
            raise SystemExit(f"provisioning failed:\n{command.tail()}")
        self.station.sign(bytes.fromhex(self.inputs.key.read_text(encoding="ascii").strip()))
        self.station.ask_for_all()  # it was restarted

    def _home(self):
        """The first corner, on the ground, towards the second."""
        lat, lon = self.corners[0]
        north, east = self.track.corners[1]
        return lat, lon, Grid(self.inputs.terrain).height(lat, lon), math.degrees(math.atan2(east, north)) % 360

    def _be_ready(self):
        """Waits until its filter has a position from its own GPS."""
        self.station.wait_for("position", lambda _: self.track.filter and bool(self.track.filter[-1][1] & POSITION_KNOWN),
                              patience_s=READY_S)

    def _climb(self):
        until = time.monotonic() + CLIMB_S
        while not self.track.estimated or abs(self.track.estimated[-1][3] - self.inputs.altitude_m) > AT_HEIGHT_M:
            self.receive()
            if time.monotonic() > until:
                raise SystemExit(f"ArduPlane did not climb in {CLIMB_S} s: {self.station.texts[-4:]}")
