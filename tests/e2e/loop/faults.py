"""One flight with a sequence of faults, and the response of nadird that each requires."""
import shutil
import time

from .evidence import Finding, States, judged_right, longest_pause_s, readable, within
from .flight import Flight, Setup
from .hands import HostClock, spoil_tiles
from .camera_faults import carried
from .small_disk import SmallDisk

DISK_MB = 6
MINUTES = 4.9
BURST_TIMES, BURST_S = 10, 10
# Seconds of flight.
STALL, LINK, AUTOPILOT_CLOCK, HOST_FORTH, HOST_BACK, BURST, TILES, DARK = (40, 46), (60, 68), 92, 101, 108, 116, (
    155, 195), (215, 252)
EVENTS = ["20:gps-denied", f"{STALL[0]}:camera-cut", f"{STALL[1]}:camera-restore", f"{LINK[0]}:link-cut", f"{LINK[1]}:link-restore", f"{AUTOPILOT_CLOCK}:clock-step=3600",
          f"{AUTOPILOT_CLOCK + 5}:clock-step=-7200", f"{DARK[0]}:camera-cut", f"{DARK[1]}:camera-restore"]


def fly(args, inputs, run):
    """The findings."""
    package = run / "package"
    shutil.copytree(inputs.package, package)
    clock = HostClock(run)
    with SmallDisk(run / "disk", DISK_MB) as disk:
        setup = Setup(inputs, run, args.nadir, args.nadird, EVENTS, MINUTES, signed=True, package=package,
                      record=disk.folder and disk.folder / "record", environment=clock.environment(),
                      nadird_options=["--keep-frames"])
        with Flight(setup) as flight:
            flight.start()
            seen = Hands(flight, clock, package, disk).work()
            summary, _ = flight.finish()
        kept = run / "kept"
        shutil.copytree(flight.record, kept)
    return judge(summary, setup.rows(), States(flight.watch.changes, flight.begun_flying), seen, args.nadir, kept, clock, disk)


class Hands:
    """Injects the faults outside the autopilot on schedule and records what nadird reported."""

    def __init__(self, flight, clock, package, disk):
        self.flight, self.disk, self.seen = flight, disk, {}
        self.plan = [
            (HOST_FORTH, lambda: clock.set(7200)), (HOST_BACK, lambda: clock.set(-86400)), (BURST, self.burst),
            (TILES[0], lambda: spoil_tiles(package)), (TILES[1] - 1, self.note("spoilt")),
            (TILES[1], lambda: spoil_tiles(package)), (DARK[0] - 1, self.note("repaired"))]

    def work(self):
        for at, act in sorted(self.plan, key=lambda step: step[0]):
            while self.flight.elapsed_s() < at:
                self.flight.must_be_running()
                self.look_at_disk()
                time.sleep(0.02)
            act()
        while self.flight.autopilot.running():
            self.flight.must_be_running()
            time.sleep(0.2)
        return self.seen

    def look_at_disk(self):
        if self.disk.folder:
            self.seen["used"] = max(self.disk.share_used(), self.seen.get("used", 0))

    def note(self, name):
        def act():
            self.seen[name] = dict(self.flight.watch.state, memory_mb=self.flight.service.memory_mb())
        return act

    def burst(self):
        """A second renderer at nine times the rate of the first; it loads the world before it starts."""
        flight, beside = self.flight, self.flight.run / "burst"
        painter = flight.painter("burst", flight.other_port, flight.setup.fps * (BURST_TIMES - 1), beside)
        flight.programs.wait_until_says(painter, "waiting for poses")
        begun = flight.elapsed_s()
        self.note("before")()
        with carried(beside, flight.run / "frames"):
            time.sleep(BURST_S)
        self.note("after")()
        painter.end()
        flight.programs.started.remove(painter)
        self.seen["burst"] = (begun, flight.elapsed_s())


def judge(summary, rows, states, seen, nadir, record, clock, disk):
    def state(fault, expected, window, allowed, ends_with):
        values = states.during(*window)
        found = " → ".join(dict.fromkeys(map(str, values)))
        return Finding(fault, expected, found, set(values) <= set(allowed) and values[-1:] == [ends_with])

    def flies_on(fault, window, pause_s=0.3):
        pause = longest_pause_s(within(rows, *window))
        return Finding(fault, "fixes go on", f"longest pause {pause:.2f} s", pause <= pause_s)

    def reported(fault, text, window):
        at = next((event["time_s"] for event in summary["events"] if event["kind"] == "statustext" and event["text"] == text
                   and window[0] <= event["time_s"] <= window[1]), None)
        return Finding(fault, f"operator: {text.removeprefix('Nadir: ')}", "not reported" if at is None else
                       f"notified {at - window[0]:.1f} s after", at is not None)

    steady = ["normal"]
    findings = [
        reported("camera stalls for 6 s", "Nadir: no camera frames, dead reckoning", STALL),
        state("camera stalls for 6 s", "dead reckoning, then normal", (STALL[0], STALL[1] + 5), ["normal", "degraded"], "normal"),
        flies_on("camera stalls for 6 s", (STALL[0], STALL[1] + 5)),
        state("link cut for 8 s", "frames without attitudes: degraded; then normal", (LINK[0], AUTOPILOT_CLOCK),
              ["normal", "degraded"], "normal"),
        reported("link restored", "Nadir: autopilot link restored", (LINK[1], LINK[1] + 5)),
        flies_on("link restored", (LINK[1] + 1, LINK[1] + 10)),
        state("autopilot's clock steps", "no rule notices", (AUTOPILOT_CLOCK, HOST_FORTH - 1), steady, "normal"),
        flies_on("autopilot's clock steps", (AUTOPILOT_CLOCK, HOST_FORTH - 1))]
    if clock.works:
        findings += [state("our clock steps", "no rule notices", (HOST_FORTH, BURST), steady, "normal"),
                     flies_on("our clock steps", (HOST_FORTH, BURST))]
    dropped = seen["after"]["frames"]["dropped"] - seen["before"]["frames"]["dropped"]
    came = seen["after"]["frames"]["received"] - seen["before"]["frames"]["received"]
    grown = 100 * (seen["after"]["memory_mb"] / seen["before"]["memory_mb"] - 1)
    burst, bursting = f"{BURST_TIMES} times the frames", seen["burst"]
    findings += [
        state(burst, "normal", (bursting[0], bursting[1] + 3), steady, "normal"),
        flies_on(burst, (bursting[0], bursting[1] + 3)),
        Finding(burst, "the latest is processed, no backlog", f"{came} received, {dropped} dropped; memory {grown:+.0f} %",
                came > 5 * 3 * BURST_S and grown < 25),
        state("tiles spoilt", "the flight continues; anchored again afterwards", (TILES[0], DARK[0]), ["normal", "degraded"], "normal"),
        flies_on("tiles spoilt", (TILES[0], DARK[0])),
        Finding("tiles whole again", "anchors again", f"{seen['repaired']['anchors']['accepted'] - seen['spoilt']['anchors']['accepted']}"
                " anchors", seen["repaired"]["anchors"]["accepted"] > seen["spoilt"]["anchors"]["accepted"]),
        reported("no frames for 37 s", "Nadir: NO FIX, blind for too long", (DARK[0] + 30, DARK[0] + 33)),
        reported("no frames for 37 s", "Nadir: FAILSAFE, no position", (DARK[0] + 33, DARK[0] + 36)),
        state("no frames for 37 s", "degraded, no fix, failsafe, then recovered", (DARK[0], MINUTES * 60),
              ["normal", "degraded", "no_fix", "failsafe"], "normal")]
    if disk.folder:
        recorder = seen["repaired"]["recorder"]
        findings.append(Finding(f"disk of {DISK_MB} MB full", "the recorder reports it, the flight continues",
                                f"{100 * seen['used']:.0f} % full; recorder {recorder['state']}, {recorder['lost_records']} "
                                "records lost", seen["used"] > 0.8 and (recorder["lost_records"] > 0
                                                                       or recorder["state"] != "recording")))
    findings.append(readable(f"disk of {DISK_MB} MB full" if disk.folder else "all of these", nadir, record))
    findings.append(Finding("all of these", "no message of ours rejected by the autopilot", str(summary["link"]["refused"]),
                            summary["link"]["refused"] == 0))
    return findings + [judged_right("all of these", rows)]
