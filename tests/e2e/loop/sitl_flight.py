"""One flight of an autopilot's own simulator by nadird's fixes: take-off by its own GPS, a climb to the circuit, laps, and
faults on the way."""
import csv
import math
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "support"))
from simulated_autopilot.scenario import Scenario, parse_event
from simulated_autopilot.terrain import Grid

from .flight import Flight
from .ground_station import GroundStation
from .ports import free_port
from .run_summary import run_summary
from .sitl_track import POSITION_KNOWN
from .watch import Watch

READY_S, CLIMB_S = 90, 240
CHANGE_S = 60  # for nadird to find a parameter that was changed
AT_HEIGHT_M = 15
BEFORE_RESTART_S = 2  # for what was set to be asked for and stored


def corners_of(path):
    with open(path, newline="", encoding="utf-8") as file:
        return [(float(row["lat_deg"]), float(row["lon_deg"])) for row in csv.DictReader(file)]


class SitlFlight(Flight):
    """A context, as Flight. vehicle: ArduPlane or Px4. The events count from when the circuit was reached."""

    def __init__(self, setup, vehicle):
        super().__init__(setup)
        self.vehicle = vehicle
        setup.nadird_options = [*setup.nadird_options, *vehicle.nadird_options]
        self.corners = corners_of(self.inputs.waypoints)
        self.track = vehicle.track(self.corners)
        self.scenario = Scenario([parse_event(text) for text in setup.events])
        self.station = None
        self.on_circuit_s = None  # boot seconds
        self.changed = None  # (NAME=VALUE before take-off, seconds until nadird noted it, and that it was set back)
        self.done = []  # (boot seconds, what was done to it)
        self.pace = None  # seconds of its clock in one of ours

    def __exit__(self, *error):
        if self.station is not None:
            self.station.close()
        super().__exit__(*error)
        self.vehicle.close()

    def start(self):
        self.start_camera()
        self.start_autopilot()
        if self.setup.signed or not self.vehicle.is_provisioned:
            self._provision()
        self.start_service()
        self.watch = Watch(self.url, self.service)
        self.watch.start()

    def listed_parameters(self):
        return self.vehicle.listed_parameters

    def start_autopilot(self):
        self.begun = time.monotonic()
        self.station_port = free_port()
        self.station = GroundStation(self.station_port, self.vehicle)
        self.station.listeners.append(self.track)
        self.autopilot = self.vehicle.start(self, self.station_port)
        self.station.meet()
        self.begun_flying = time.monotonic()

    def change_before_take_off(self, name, value):
        """Like a hand at a ground station: sets a parameter that was provisioned, and sets it back."""
        self._be_ready()
        self.changed = (f"{name}={value:g}", self._set_and_hear(name, value, "it was provisioned as"),
                        self._set_and_hear(name, self.listed_parameters()[name], "again, as it was provisioned"))

    def _set_and_hear(self, name, value, words):
        """Seconds until nadird noted it; None when it did not in CHANGE_S."""
        self.station.set(name, value)
        begun = time.monotonic()
        while time.monotonic() < begun + CHANGE_S:
            self.receive()
            noted = [event["at"] for event in list(self.watch.events.values())
                     if event["kind"] == "autopilot" and event["text"].startswith(f"{name} is ") and words in event["text"]]
            if noted:
                return max(0.0, min(noted) - begun)
        return None

    def fly(self, seconds):
        """Take-off, climb, and so many seconds on the circuit."""
        self._be_ready()
        self.station.upload(self.vehicle.mission(self.corners, self.inputs.altitude_m))
        self.station.fly_mission()
        self.station.arm()
        self._climb()
        self.on_circuit_s, begun = self.track.now_s, time.monotonic()
        while self.track.now_s < self.on_circuit_s + seconds:
            self.receive()
            for event in self.scenario.due(self.track.now_s - self.on_circuit_s):
                self.vehicle.happen(event, self)
                self.done.append((self.track.now_s, str(event)))
        self.pace = (self.track.now_s - self.on_circuit_s) / (time.monotonic() - begun)

    def receive(self):
        self.station.receive()
        self.vehicle.receive(self.track)
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

    def home(self):
        """The first corner, on the ground, towards the second: degrees, metres, degrees."""
        lat, lon = self.corners[0]
        north, east = self.track.corners[1]
        return lat, lon, Grid(self.inputs.terrain).height(lat, lon), math.degrees(math.atan2(east, north)) % 360

    def _provision(self):
        """Parameters, restart and key, as a user provisions them; texts are received meanwhile."""
        signed = ["--signing-key", self.inputs.key] if self.setup.signed else []
        command = self.programs.start("provision", [
            self.setup.nadir, "provision", "autopilot", "--autopilot", f"udpin:127.0.0.1:{self.link_port}", "--apply", *signed])
        waiting_s = None
        while command.running():
            self.station.receive()
            if not self.vehicle.restarts_itself and waiting_s is None and " set\n" in command.text():
                waiting_s = time.monotonic() + BEFORE_RESTART_S
            if waiting_s is not None and time.monotonic() > waiting_s:
                waiting_s = math.inf
                self.autopilot.end()
                self.autopilot = self.vehicle.start(self, self.station_port)
        if command.end() != 0:
            raise SystemExit(f"provisioning failed:\n{command.tail()}")
        if self.setup.signed:
            key = bytes.fromhex(self.inputs.key.read_text(encoding="ascii").strip())
            self.station.sign(key)
            self.vehicle.sign(key)
        self.station.ask_for_all()  # it was restarted

    def _be_ready(self):
        """Waits until its filter has a position from its own GPS."""
        self.station.wait_for("position", lambda _: self.track.filter and bool(self.track.filter[-1][1] & POSITION_KNOWN),
                              patience_s=READY_S)

    def _climb(self):
        until = time.monotonic() + CLIMB_S
        while not self.track.estimated or abs(self.track.estimated[-1][3] - self.inputs.altitude_m) > AT_HEIGHT_M:
            self.receive()
            if time.monotonic() > until:
                raise SystemExit(f"{self.vehicle.name} did not climb in {CLIMB_S} s: {self.station.texts[-4:]}")
