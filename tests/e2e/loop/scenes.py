"""Short flights that trigger the rules of docs/onboard.md one after the other."""
import dataclasses
import shutil
import time

from . import camera_faults
from .flight import Flight, Setup
from .held_thread import held

KILLED_FOR_S = 0.2  # as systemd waits before it starts the service again


@dataclasses.dataclass
class Scene:
    what: str
    seconds: float
    events: list  # done by the autopilot
    hands: list = dataclasses.field(default_factory=list)  # (seconds, f(Stage)): done from outside
    autopilot_signs: bool = True  # nadird wants it
    spoilt_package: bool = False


class Stage:
    """A flight in progress and the faults to inject. missed: what this machine does not permit, by the fault's name."""

    def __init__(self, flight, width, height):
        self.flight, self.frames, self.size = flight, flight.run / "frames", (width, height)
        self.done, self.missed = {}, {}

    def black_picture(self):
        self.note("black")
        camera_faults.black(self.frames, *self.size)

    def same_picture(self):
        camera_faults.again(self.frames)
        self.note("again")

    def backlog(self):
        self.note("backlog")
        camera_faults.backlog(self.frames, 12)

    def hold_localizer(self):
        try:
            with held(self.flight.service.pid, "localizer"):
                self.note("held")
                time.sleep(2)
        except OSError as error:
            self.missed["held"] = str(error)

    def kill(self):
        self.note("killed")
        self.flight.service.process.kill()
        self.flight.service.end()
        time.sleep(KILLED_FOR_S)
        self.flight.start_service("service-2")
        self.flight.watch.program = self.flight.service

    def note(self, name):
        self.done[name] = self.flight.elapsed_s()


SCENES = {
    "camera": Scene("every camera fault; GPS is good", 132, [
        "48:camera-cut", "56:camera-restore", "66:camera-cut", "99:camera-restore"], [
        (20, Stage.black_picture), (28, Stage.same_picture), (36, Stage.hold_localizer), (54, Stage.backlog)]),
    "failsafe": Scene("no GPS, no frames, no link", 104, [
        "15:gps-denied", "20:camera-cut", "57:camera-restore", "88:link-cut", "96:link-restore"]),
    "spoofing": Scene("a GPS that jumps, recovers, and is dragged off", 78, [
        "20:gps-step=300@70", "32:gps-recover", "52:gps-drag=4@70"]),
    "silence": Scene("GPS is denied and comes back while there are no frames", 104, [
        "18:camera-cut", "20:gps-denied", "32:gps-recover"]),
    "restart": Scene("killed in flight", 45, ["15:gps-denied"], [(25, Stage.kill)]),
    "first": Scene("in flight without any position", 32, ["0:gps-denied", "0:camera-cut", "10:camera-restore"]),
    "refused": Scene("a package that does not verify", 14, [], spoilt_package=True),
    "unsigned_autopilot": Scene("an autopilot that does not sign", 14, [], autopilot_signs=False),
}


def fly(scene, inputs, run, nadir, nadird, width):
    """(Setup, Flight, Stage, the autopilot's summary), when it is over."""
    package, options = None, []
    if scene.spoilt_package:
        package = run / "package"
        shutil.copytree(inputs.package, package)
        manifest = package / "manifest.json"
        manifest.write_bytes(manifest.read_bytes().replace(b"1", b"2", 1))
    if not scene.autopilot_signs:
        options = ["--signing-key", inputs.key]
    setup = Setup(inputs, run, nadir, nadird, scene.events, scene.seconds / 60, signed=scene.autopilot_signs,
                  package=package, nadird_options=options)
    with Flight(setup) as flight:
        flight.start()
        stage = Stage(flight, width, round(width * 9 / 16))
        for at, act in sorted(scene.hands, key=lambda step: step[0]):
            while flight.elapsed_s() < at:
                flight.must_be_running()
                time.sleep(0.02)
            act(stage)
        while flight.autopilot.running():
            flight.must_be_running()
            time.sleep(0.2)
        summary, _ = flight.finish()
    return setup, flight, stage, summary
