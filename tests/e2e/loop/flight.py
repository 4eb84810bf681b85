"""One flight of the closed loop: camera, service and autopilot, started in order and always stopped."""
import csv
import dataclasses
import json
import pathlib
import socket
import sys
import time

from .ports import free_port
from .processes import Programs
from .run_summary import run_summary
from .watch import Watch

# The simulated autopilots, and the parameters that `nadir provision autopilot` would set: {r} is the receiver that we play.
AUTOPILOTS = {
    "ardupilot": ([], {"GPS{r}_TYPE": 14, "GPS{r}_DELAY_MS": 10, "EK3_SRC1_POSXY": 3, "EK3_SRC1_VELXY": 3, "EK3_SRC1_POSZ": 1,
                       "EK3_SRC1_YAW": 1}),
    "px4": (["--px4", "1.18"], {"EKF2_AGP0_ID": 1, "EKF2_AGP0_CTRL": 1, "EKF2_AGP0_GATE": 5, "EKF2_HGT_REF": 0}),
    "px4-1.17": (["--px4", "1.17"], {"EKF2_EV_CTRL": 1, "EKF2_HGT_REF": 0}),
}
# "SECONDS:ACTION[=VALUE[@BEARING]]": simulated_autopilot/scenario.py.
SCENARIOS = {
    "denied": ["60:gps-denied"],
    "spoofed": ["60:gps-step=300@70"],
    "dragged": ["60:gps-drag=2@70"],
    "blackout": ["60:gps-denied", "120:camera-cut", "135:camera-restore"],
    "recovery": ["60:gps-step=300@70", "150:gps-recover"],
    "link": ["60:gps-denied", "120:link-cut", "128:link-restore"],
    "clock": ["60:gps-denied", "120:clock-step=3600", "180:clock-step=-7200"],
    "compass": ["0:compass=9", "60:gps-denied"],
    "demo": ["60:gps-step=300@70", "80:camera-cut", "92:camera-restore", "105:gps-recover"],
}
HERE = pathlib.Path(__file__).resolve().parent
AUTOPILOT = HERE.parent.parent / "support" / "autopilot.py"


@dataclasses.dataclass
class Setup:
    """The setup of a flight: inputs, options and events."""
    inputs: object  # Inputs
    run: pathlib.Path  # for frames, state, record, logs and results; is there and empty
    nadir: object
    nadird: object
    events: list
    minutes: float
    fps: float = 3
    delay_s: float = 0.25
    seed: int = 1
    own_receiver: str = "second"
    signed: bool = False
    stand_in: float = None  # no nadird: the truth, so many metres off
    favoured: bool = True
    nadird_options: list = dataclasses.field(default_factory=list)
    package: pathlib.Path = None  # another one than the inputs'
    record: pathlib.Path = None  # another folder than run/record
    speed: float = 1  # times real time; nadird must have a clock that goes as fast
    environment: dict = dataclasses.field(default_factory=dict)  # of nadird, besides ours
    autopilot: str = "ardupilot"  # of AUTOPILOTS
    processor: object = None  # nadird's ProcessorShare
    as_of_creation: bool = True  # nadird judges as of the package's creation; then it remembers nothing, and resumes nothing

    def rows(self):
        """The autopilot's log, ten rows a second."""
        with open(self.run / "flight" / "track.csv", newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))


class Flight:
    """A context. start() starts all three programs; `camera`, `service` and `autopilot` are the latest of each."""

    def __init__(self, setup):
        self.setup, self.inputs, self.run = setup, setup.inputs, setup.run
        self.record = setup.record or self.run / "record"
        self.link_port, self.truth_port, self.other_port = free_port(), free_port(), free_port()
        self.api_port = free_port(socket.SOCK_STREAM)
        self.url = f"http://127.0.0.1:{self.api_port}"
        self.programs = Programs(self.run, setup.favoured)
        self.camera = self.service = self.autopilot = self.watch = None
        self.begun = self.begun_flying = None  # monotonic seconds: the autopilot was started; it flew

    def listed_parameters(self):
        """Of a provisioned autopilot, {name: value}; its airframe file lists them."""
        receiver = 2 if self.setup.own_receiver == "first" else 1
        return {name.format(r=receiver): value for name, value in AUTOPILOTS[self.setup.autopilot][1].items()}

    def __enter__(self):
        self.programs.__enter__()
        for folder in (self.run / "frames", self.run / "state", self.record):
            folder.mkdir(exist_ok=True)
        return self

    def __exit__(self, *error):
        if self.watch is not None and self.watch.is_alive():
            self.watch.stop()
        self.programs.__exit__(*error)

    def start(self):
        self.start_camera()
        self.start_service()
        self.start_autopilot()
        if self.setup.stand_in is None:
            self.watch = Watch(self.url, self.service)
            self.watch.start()

    def start_camera(self):
        self.camera = self.painter("camera", self.truth_port, self.setup.fps)
        self.programs.wait_until_says(self.camera, "waiting for poses")

    def painter(self, name, port, fps, out=None):
        """A renderer that writes into the folder of frames or another, at the poses received on that port."""
        setup, inputs = self.setup, self.inputs
        return self.programs.start(name, [
            setup.nadir, "simulate", "camera", "--world", inputs.world / "ground.tif", "--dem", inputs.world / "dem.tif",
            "--camera", inputs.camera, "--pose-from", f"udpin:127.0.0.1:{port}", "--out", out or self.run / "frames", "--fps",
            fps, "--keep", 30, "--delay-s", setup.delay_s / setup.speed])

    def start_service(self, name="service"):
        """nadird, or the stand-in. The name selects the log."""
        command = self._service_command()
        if self.setup.processor is not None:
            command = self.setup.processor.words(command)
        self.service = self.programs.start(name, command, self.setup.environment)
        if self.setup.stand_in is not None:
            self.programs.wait_until_says(self.service, "listening")

    def start_autopilot(self):
        setup, inputs = self.setup, self.inputs
        self.begun = time.monotonic()
        words = AUTOPILOTS[setup.autopilot][0]
        self.autopilot = self.programs.start("autopilot", [
            sys.executable, "-B", AUTOPILOT, "--link", f"udpout:127.0.0.1:{self.link_port}", "--truth",
            f"udpout:127.0.0.1:{self.truth_port}", "--truth", f"udpout:127.0.0.1:{self.other_port}", "--waypoints",
            inputs.waypoints, "--altitude-m", inputs.altitude_m, "--terrain", inputs.terrain, "--duration",
            setup.minutes * 60, "--speed", setup.speed, "--seed", setup.seed, "--own-receiver", setup.own_receiver, "--log", self.run / "flight",
            *words, *(f"--parameter={name}={value}" for name, value in self.listed_parameters().items()), *self._key("--key-file"), *(word for event in setup.events for word in ("--event", event))])
        self.programs.wait_until_says(self.autopilot, " s  ")
        self.begun_flying = time.monotonic()

    def elapsed_s(self):
        """Approximate seconds of flight: the autopilot reports its start."""
        return time.monotonic() - self.begun_flying

    def must_be_running(self):
        """SystemExit when service or camera has ended by itself."""
        for program in (self.service, self.camera):
            if not program.running():
                raise SystemExit(f"{program.name} ended with {program.process.returncode}:\n{program.tail()}")

    def wait(self):
        """Waits until the autopilot has flown its minutes. SystemExit when a program ends before."""
        self.programs.wait_for(self.autopilot, self.setup.minutes * 60 * 2 + 60)

    def finish(self):
        """Ends service and camera in order. (the autopilot's summary, nadird's own summary or None)"""
        if self.watch is not None:
            self.watch.stop()
        code = self.service.end()
        self.camera.end()
        if code != 0:
            raise SystemExit(f"service ended with {code}:\n{self.service.tail()}")
        summary = json.loads((self.run / "flight" / "summary.json").read_text(encoding="utf-8"))
        return summary, run_summary(self.service.text())

    def _key(self, option):
        return [option, self.inputs.key] if self.setup.signed else []

    def _link_key(self):
        if "--signing-key" in self.setup.nadird_options:
            return []
        return self._key("--signing-key") or ["--unsigned-link"]

    def _service_command(self):
        setup, inputs, run = self.setup, self.inputs, self.run
        if setup.stand_in is not None:
            return [sys.executable, "-B", HERE / "stand_in.py", self.link_port, self.other_port, "--offset-m",
                    setup.stand_in, *self._key("--key-file")]
        airframe = inputs.airframe_with(run / "airframe.json", self.listed_parameters())
        return [setup.nadird, "--package", setup.package or inputs.package, "--airframe", airframe, "--trust",
                inputs.root, *(["--at", inputs.created] if setup.as_of_creation else []), "--state", run / "state", "--camera", f"folder:{run / 'frames'}",
                "--autopilot", f"udpin:127.0.0.1:{self.link_port}", "--record", self.record, "--listen",
                f"127.0.0.1:{self.api_port}", *self._link_key(), *setup.nadird_options]
