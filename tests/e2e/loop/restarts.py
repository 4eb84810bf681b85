"""nadird killed in flight and started again on what flights do to a computer meanwhile: a state disk that is full, a taken
port, a clock that is wrong, a torn file, another package in the folder."""
import contextlib
import shutil
import socket
import time

from .evidence import Finding, judged_right, within
from .flight import Flight, Setup
from .hands import HostClock
from .kills import BACK_WITHIN_S, RESTART_AFTER_S, back_after_s
from .small_disk import SmallDisk

DENIED_S, FIRST_S, EVERY_S = 20, 35, 20
STATE_MB = 1
YEAR_S = 365 * 86400
DAY_S = 86400


class Faults:
    """Each a context that is entered while nadird is dead and left before the next."""

    def __init__(self, flight, clock, state, packages, valid_s):
        self.flight, self.clock, self.state, self.packages, self.valid_s = flight, clock, state, packages, valid_s

    def list(self):
        faults = []
        if self.state.folder:
            faults.append(("state disk full", self.disk_full, "Nadir: state directory failed, trying again"))
        faults += [("port of the API taken", self.port_taken, "Nadir: API failed, trying again")]
        if self.clock.works:
            faults += [("clock -10 min", lambda: self.clock_set(-600), None),
                       ("clock +2 years", lambda: self.clock_set(2 * YEAR_S), None)]
        return faults + [("signing-time torn", self.signing_time_torn, "Nadir: signing time failed, trying again"),
                         ("package swapped", self.package_swapped, "Nadir: package swapped, flying the accepted one")]

    @contextlib.contextmanager
    def disk_full(self):
        ballast = self.state.folder / "ballast"
        with open(ballast, "wb", buffering=0) as file, contextlib.suppress(OSError):
            while True:
                file.write(bytes(4096))
        yield
        ballast.unlink()

    @contextlib.contextmanager
    def port_taken(self):
        with socket.socket() as other:
            other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            other.bind(("127.0.0.1", self.flight.api_port))
            other.listen()
            yield

    @contextlib.contextmanager
    def clock_set(self, seconds):
        self.clock.set(self.valid_s + seconds)
        yield
        self.clock.set(self.valid_s)

    @contextlib.contextmanager
    def signing_time_torn(self):
        path = self.flight.run / "state" / "signing-time"
        path.write_bytes(path.read_bytes()[:5])
        yield

    @contextlib.contextmanager
    def package_swapped(self):
        other, link = self.packages / "other", self.packages / "current"
        shutil.copytree(self.packages / "accepted", other)
        with open(other / "manifest.json", "ab") as file:
            file.write(b" ")
        link.unlink()
        link.symlink_to("other")
        yield


def fly(args, inputs, run):
    """The findings."""
    packages = run / "packages"
    packages.mkdir()
    shutil.copytree(inputs.package, packages / "accepted")
    (packages / "current").symlink_to("accepted")
    clock = HostClock(run)
    created_s = time.mktime(time.strptime(inputs.created, "%Y-%m-%dT%H:%M:%SZ")) - time.timezone
    valid_s = round(created_s + DAY_S - time.time())
    clock.set(valid_s)
    minutes = (FIRST_S + 6 * EVERY_S + 10) / 60
    with SmallDisk(run / "state", STATE_MB) as state:
        setup = Setup(inputs, run, args.nadir, args.nadird, [f"{DENIED_S}:gps-denied"], minutes, signed=True,
                      package=packages / "current", environment=clock.environment(), as_of_creation=not clock.works)
        killed = []  # (fault, operator's text, seconds since 1970, seconds of flight)
        with Flight(setup) as flight:
            flight.start()
            faults = Faults(flight, clock, state, packages, valid_s).list()
            for number, (name, fault, text) in enumerate(faults):
                while flight.elapsed_s() < FIRST_S + number * EVERY_S:
                    flight.must_be_running()
                    time.sleep(0.05)
                killed.append((name, text, time.time(), flight.elapsed_s()))
                flight.service.process.kill()
                flight.service.end()
                with fault():
                    time.sleep(RESTART_AFTER_S)
                    flight.start_service(f"service-{number + 1}")
                    flight.watch.program = flight.service
                    while flight.elapsed_s() < FIRST_S + number * EVERY_S + EVERY_S / 2:
                        flight.must_be_running()
                        time.sleep(0.05)
            while flight.autopilot.running():
                flight.must_be_running()
                time.sleep(0.2)
            summary, _ = flight.finish()
    return judge(summary, setup.rows(), killed, state, clock)


def judge(summary, rows, killed, state, clock):
    def reported_after_s(text, from_s):
        return next((event["time_s"] - from_s for event in summary["events"] if event["kind"] == "statustext"
                     and event["text"] == text and from_s <= event["time_s"] <= from_s + EVERY_S), None)

    findings = []
    for name, text, at_unix_s, at_s in killed:
        fault = f"restart: {name}"
        after_s, row = back_after_s(rows, at_unix_s)
        found = "never" if after_s is None else f"{after_s:.1f} s, {float(row['given_error_m']):.1f} m off"
        findings.append(Finding(fault, f"a position again within {BACK_WITHIN_S:.0f} s", found,
                                after_s is not None and after_s <= BACK_WITHIN_S))
        if text is not None:
            reported_s = reported_after_s(text, at_s - 1)
            findings.append(Finding(fault, f"operator: {text.removeprefix('Nadir: ')}",
                                    "not reported" if reported_s is None else f"reported {reported_s - 1:.1f} s after", reported_s is not None))
        if text is not None and text.endswith("trying again"):
            part = text.removeprefix("Nadir: ").removesuffix(" failed, trying again")
            reported_s = reported_after_s(f"Nadir: {part} works again", at_s - 1)
            findings.append(Finding(fault, f"operator: {part} works again", "not reported" if reported_s is None else
                                    f"reported {reported_s - 1:.1f} s after", reported_s is not None))
    for missing, there in (("a small disk for the state", state.folder), ("another clock", clock.works)):
        if not there:
            findings.append(Finding("restarts", missing, "NOT RUN: not allowed here", True))
    return findings + [judged_right("restarts", within(rows, FIRST_S, float("inf")))]
