"""The package's tile file corrupted and truncated in flight: what is told, and how the position goes on."""
import shutil
import time

from .evidence import Finding, fresh_fixes, judged_right, longest_pause_s, within
from .flight import Flight, Setup
from .hands import spoil_tiles

DENIED_S, MINUTES = 12, 1.6
CORRUPT, CUT = (25, 42), (56, 73)
KEPT_SHARE = 5  # of the file, when it is cut off: one fifth
BACK_WITHIN_S = 5
STEP_M = 30  # nothing may jump by more while it degrades


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


def fly(args, inputs, run):
    """The findings."""
    package = run / "package"
    shutil.copytree(inputs.package, package)
    tiles, notes = TileFile(package), {}
    setup = Setup(inputs, run, args.nadir, args.nadird, [f"{DENIED_S}:gps-denied"], MINUTES, signed=True, package=package)
    with Flight(setup) as flight:
        flight.start()

        def note(name):
            return lambda: notes.update({name: dict(flight.watch.state)})
        for at, act in ((CORRUPT[0] - 1, note("before")), (CORRUPT[0], tiles.corrupt), (CORRUPT[1] - 0.5, note("corrupt")), (CORRUPT[1], tiles.restore),
                        (CUT[0] - 1, note("between")), (CUT[0], tiles.cut), (CUT[1] - 0.5, note("cut")), (CUT[1], tiles.restore),
                        (MINUTES * 60 - 3, note("end"))):
            while flight.elapsed_s() < at:
                flight.must_be_running()
                time.sleep(0.02)
            act()
        flight.wait()
        summary, _ = flight.finish()
        events = [dict(event, at=event["at"] - flight.begun_flying) for _, event in sorted(flight.watch.events.items())]
        anchored = [at - flight.begun_flying for at, what, _, now, _ in flight.watch.changes if what == "source" and now == "satellite_anchored"]
    return judge(summary, setup.rows(), events, anchored, notes)


def judge(summary, rows, events, anchored, notes):
    def corrupt_tiles(name):
        return notes[name].get("map", {}).get("corrupt_tiles", 0)

    def accepted(name):
        return notes[name]["anchors"]["accepted"]

    findings = []
    event = next((event for event in events if event.get("kind") == "tile" and event["at"] >= CORRUPT[0] - 1), None)
    told = next((item for item in summary["events"] if item["kind"] == "statustext" and "CORRUPT MAP TILES" in item["text"]), None)
    findings += [
        Finding("tiles corrupted in flight", "anchored before it", f"{accepted('before')} anchors", accepted("before") > 0),
        Finding("tiles corrupted in flight", "a critical event", "none" if event is None else f"{event['at'] - CORRUPT[0]:.1f} s after: {event['text'][:60]}",
                event is not None and event.get("severity") == "critical"),
        Finding("tiles corrupted in flight", "they are counted", f"{corrupt_tiles('corrupt')}", corrupt_tiles("corrupt") > 0),
        Finding("tiles corrupted in flight", "operator: corrupt map tiles", "not told" if told is None else
                f"told {told['time_s'] - CORRUPT[0]:.1f} s after", told is not None)]
    for fault, window, before, after in (("tiles corrupted in flight", CORRUPT, "corrupt", "between"), ("tile file cut off in flight", CUT, "cut", "end")):
        part = within(rows, *window)
        pause, fixes = longest_pause_s(part), fresh_fixes(part)
        worst = max((float(row["given_error_m"]) / float(row["given_accuracy_m"]) for row in fixes), default=0.0)
        again = next((at for at in anchored if at >= window[1]), None)
        findings += [
            Finding(fault, "fixes go on, or degrade honestly", f"longest pause {pause:.2f} s; {len(fixes)} fixes, worst {worst:.1f} of their sigmas",
                    pause <= 0.3 and bool(fixes)),
            Finding(fault, "whole again: matched to the map again", f"{accepted(after) - accepted(before)} anchors"
                    + ("" if again is None else f", the first {again - window[1]:.1f} s after"), accepted(after) > accepted(before)),
            Finding(fault, f"whole again: a position again within {BACK_WITHIN_S} s", back(rows, window[1]),
                    bool(fresh_fixes(within(rows, window[1], window[1] + BACK_WITHIN_S))))]
    spoken = [event for event in events if CUT[0] <= event["at"] <= CUT[1] + 5 and event.get("kind") in ("tile", "matcher", "state", "anchor", "map")]
    findings.append(Finding("tile file cut off in flight", "an event tells of it", spoken[0]["text"][:80] if spoken else "none", bool(spoken)))
    return findings + [judged_right("tiles corrupted and cut off", rows)]


def back(rows, at):
    row = next(iter(fresh_fixes(within(rows, at, float("inf")))), None)
    return "never" if row is None else f"{float(row['time_s']) - at:.1f} s, {float(row['given_error_m']):.1f} m off"
