"""The package's tile file corrupted and truncated in flight: what is reported, and how the position goes on."""
import dataclasses
import shutil
import time

from .evidence import Finding, fresh_fixes, judged_right, longest_pause_s, within
from .flight import Flight, Setup
from .hands import spoil_tiles

DENIED_S, MINUTES = 12, 2.6
EACH_S, PATIENCE_S = 17, 15  # of a fault, at least; how much longer it lasts until a tile is read where it is
KEPT_SHARE = 5  # of the file, when it is cut off: one fifth
BACK_WITHIN_S = 5


class TileFile:
    """The largest tile set of a package."""

    def __init__(self, package):
        self.package = package
        self.path = max((path for path in package.rglob("*") if path.suffix in (".mbtiles", ".tif")), key=lambda path: path.stat().st_size)
        self.data = self.path.read_bytes()

    def corrupt(self):
        spoil_tiles(self.package)

    def cut(self):
        with open(self.path, "r+b") as file:
            file.truncate(len(self.data) // KEPT_SHARE)

    def restore(self):
        with open(self.path, "r+b") as file:
            file.write(self.data)


def corrupt_tiles(state):
    return state.get("map", {}).get("corrupt_tiles", 0)


def fly_on(flight, seconds, until=lambda: True, patience_s=0):
    """Flies on for so many seconds, and for at most patience_s more until the condition holds. Whether it does."""
    begun_s = flight.elapsed_s()
    while flight.autopilot.running():
        flight.must_be_running()
        holds, flown_s = until(), flight.elapsed_s() - begun_s
        if flown_s >= seconds and (holds or flown_s >= seconds + patience_s):
            return holds
        time.sleep(0.05)
    return until()


def fly(args, inputs, run):
    """The findings."""
    package = run / "package"
    shutil.copytree(inputs.package, package)
    tiles, faults = TileFile(package), []
    setup = Setup(inputs, run, args.nadir, args.nadird, [f"{DENIED_S}:gps-denied"], MINUTES, signed=True, package=package)
    with Flight(setup) as flight:
        flight.start()

        def state():
            return dict(flight.watch.state)
        fly_on(flight, DENIED_S + 13)
        for name, begin in (("tiles corrupted in flight", tiles.corrupt), ("tile file cut off in flight", tiles.cut)):
            before, begun_s = state(), flight.elapsed_s()
            begin()
            fly_on(flight, EACH_S, lambda: corrupt_tiles(state()) > corrupt_tiles(before), PATIENCE_S)
            meanwhile, end_s = state(), flight.elapsed_s()
            tiles.restore()
            fly_on(flight, EACH_S - 3)
            faults.append(Fault(name, (begun_s, end_s), before, meanwhile, state()))
        flight.wait()
        summary, _ = flight.finish()
        events = [dict(event, at=event["at"] - flight.begun_flying) for _, event in sorted(flight.watch.events.items())]
    return judge(summary, setup.rows(), events, faults)


@dataclasses.dataclass
class Fault:
    name: str
    window: tuple  # seconds of flight
    before: dict  # the service's states
    meanwhile: dict
    after: dict


def judge(summary, rows, events, faults):
    findings = []
    for fault in faults:
        (begun_s, end_s), part = fault.window, within(rows, *fault.window)
        anchors = [state.get("anchors", {}).get("accepted", 0) for state in (fault.before, fault.meanwhile, fault.after)]
        spoilt = corrupt_tiles(fault.meanwhile) - corrupt_tiles(fault.before)
        event = next((event for event in events if event.get("kind") == "tile" and begun_s <= event["at"] <= end_s + 2), None)
        pause, fixes = longest_pause_s(part), fresh_fixes(part)
        worst = max((float(row["given_error_m"]) / float(row["given_accuracy_m"]) for row in fixes), default=0.0)
        findings += [
            Finding(fault.name, "anchored before it", f"{anchors[0]} anchors", anchors[0] > 0),
            Finding(fault.name, "the tiles that cannot be read are counted", f"{spoilt}", spoilt > 0),
            Finding(fault.name, "a critical event", "none" if event is None else f"{event['at'] - begun_s:.1f} s after: {event['text'][:60]}",
                    event is not None and event.get("severity") == "critical"),
            Finding(fault.name, "fixes go on, or degrade honestly", f"longest pause {pause:.2f} s; {len(fixes)} fixes, worst {worst:.1f} of their sigmas",
                    pause <= 0.3 and bool(fixes)),
            Finding(fault.name, "whole again: matched to the map again", f"{anchors[2] - anchors[1]} anchors", anchors[2] > anchors[1]),
            Finding(fault.name, f"whole again: a position again within {BACK_WITHIN_S} s", back(rows, end_s),
                    bool(fresh_fixes(within(rows, end_s, end_s + BACK_WITHIN_S))))]
    reported = next((item for item in summary["events"] if item["kind"] == "statustext" and "CORRUPT MAP TILES" in item["text"]), None)
    findings.append(Finding(faults[0].name, "operator: corrupt map tiles", "not reported" if reported is None else
                            f"reported {reported['time_s'] - faults[0].window[0]:.1f} s after", reported is not None))
    return findings + [judged_right("tiles corrupted and cut off", rows)]


def back(rows, at):
    row = next(iter(fresh_fixes(within(rows, at, float("inf")))), None)
    return "never" if row is None else f"{float(row['time_s']) - at:.1f} s, {float(row['given_error_m']):.1f} m off"
