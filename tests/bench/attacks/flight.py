"""What befalls the map in flight: one flight in the closed loop, judged by several rows. Tiles are corrupted, then the file is
cut off; then it is whole again."""
import json
import sqlite3
import subprocess
import threading
import time

from .registry import attack

from loop.evidence import fresh_fixes, wrong_and_sure  # noqa: E402  (shared.py has put its folder on the path)
from loop.flight import Flight, Setup  # noqa: E402
from loop.hands import spoil_tiles  # noqa: E402
from loop.inputs import Inputs, must  # noqa: E402

COARSE_CE90_M = 60
DENIED, SPOILT, MENDED, CUT, WHOLE, MINUTES = 12, 20, 32, 38, 50, 1.0


class PatchedMap(Inputs):
    """The inputs of a closed loop whose package has one coarse scene, in a corner that the circuit does not cross."""

    def _make_package(self):
        whole, coarse = self.world / "map.tif", self.folder / "coarse.tif"
        info = json.loads(must("gdalinfo", "-json", whole))
        side = info["size"][0] // 8
        must("gdal_translate", "-q", "-srcwin", 0, 0, side, side, whole, coarse)
        item = json.loads((self.world / "map.json").read_text())
        item["properties"]["nadir:ce90_m"] = COARSE_CE90_M
        (self.folder / "coarse.json").write_text(json.dumps(item))
        for name in ("root", "signer", "hangar"):
            must(self.nadir, "keys", "create", "--out", self.folder / name)
        must(self.nadir, "keys", "root", "--root-key", self.folder / "root.key.pem", "--package-signer", self.folder / "signer.pub.pem",
             "--airframe-signer", self.folder / "hangar.pub.pem", "--expires", "2035-01-01", "--out", self.root)
        must(self.nadir, "cache", "build", "--mission", self.world / "mission.yaml", "--imagery", coarse, whole, "--dem",
             self.world / "dem.tif", "--key", self.folder / "signer.key.pem", "--out", self.package)
        must(self.nadir, "cache", "index", self.package, "--key", self.folder / "signer.key.pem")


class Flown:
    """The flight's outcome. It is begun when the module is first asked for, and flown beside the other rows."""

    def __init__(self, scene):
        self.shared = scene.shared
        self.folder = scene.shared.folder / "flown"
        self.folder.mkdir()
        self.error, self.thread = None, threading.Thread(target=self._fly, daemon=True)
        self.memory_mb = 0.0
        self.thread.start()

    def _fly(self):
        try:
            self._fly_through()
        except BaseException as error:
            self.error = error

    def _fly_through(self):
        programs = self.shared.programs
        inputs = PatchedMap(self.folder / "inputs", programs / "nadir", size_km=1.2, width=960)
        self.created = inputs.created
        with sqlite3.connect(f"file:{inputs.package / 'imagery' / 'base.mbtiles'}?mode=ro", uri=True) as database:
            (self.coarse_tiles,) = database.execute("SELECT count(*) FROM nadir_sidecars WHERE ce90_mm >= ?", (1000 * COARSE_CE90_M,)).fetchone()
        run = self.folder / "run"
        run.mkdir()
        package = run / "package"
        subprocess.run(["cp", "-r", inputs.package, package], check=True)
        setup = Setup(inputs, run, programs / "nadir", programs / "nadird", [f"{DENIED}:gps-denied"], MINUTES, signed=True, package=package)
        plan = [(SPOILT, self.note("before")), (SPOILT, lambda: spoil_tiles(package)), (MENDED - 1, self.note("spoilt")),
                (MENDED, lambda: spoil_tiles(package)), (CUT - 1, self.note("mended")), (CUT, lambda: self.cut(package)),
                (WHOLE - 1, self.note("cut")), (WHOLE, self.restore), (MINUTES * 60 - 2, self.note("end"))]
        self.notes = {}
        with Flight(setup) as flight:
            self.flight = flight
            flight.start()
            for at, act in plan:
                while flight.elapsed_s() < at and flight.autopilot.running():
                    flight.must_be_running()
                    self.memory_mb = max(self.memory_mb, flight.service.memory_mb() or 0)
                    time.sleep(0.02)
                act()
            flight.wait()
            self.summary, _ = flight.finish()
            self.changes = list(flight.watch.changes)
            self.events = [event for _, event in sorted(flight.watch.events.items())]
        self.rows, self.record = setup.rows(), flight.record

    def note(self, name):
        def act():
            self.notes[name] = dict(self.flight.watch.state)
        return act

    def cut(self, package):
        self.path = max((path for path in package.rglob("*") if path.suffix in (".mbtiles", ".tif")), key=lambda path: path.stat().st_size)
        self.data = self.path.read_bytes()
        with open(self.path, "r+b") as file:
            file.truncate(len(self.data) // 5)

    def restore(self):
        with open(self.path, "r+b") as file:
            file.write(self.data)

    def wait(self, scene):
        self.thread.join(240)
        scene.attacked(not self.thread.is_alive() and self.error is None, f"the flight did not end in order: {self.error}")
        scene.peak_mb, scene.code = self.memory_mb, 0
        return self

    def told(self, words, from_s=0.0):
        return next((event["text"] for event in self.summary["events"] if event["kind"] == "statustext" and words in event["text"]
                     and event["time_s"] >= from_s), None)

    def fixes(self, from_s, to_s):
        return fresh_fixes([row for row in self.rows if from_s <= float(row["time_s"]) <= to_s])


FLOWN = []


def flown(scene):
    """The flight, begun now if it has not been. attacks.py begins it first, so that it is over when its rows come."""
    if not FLOWN:
        FLOWN.append(Flown(scene))
    return FLOWN[0]


@attack("FS", seconds=240, memory_mb=600)
def tiles_corrupted_in_flight(scene):
    """Every second kilobyte of the tile set is inverted while the aircraft flies over it."""
    done = flown(scene).wait(scene)
    before, spoilt = done.notes["before"], done.notes["spoilt"]
    scene.attacked(before["anchors"]["accepted"] > 0, f"it never anchored before: {before['anchors']}")
    corrupt = spoilt.get("map", {}).get("corrupt_tiles", 0)
    scene.holds(corrupt > 0, "nothing counts the corrupt tiles")
    scene.holds(any(event.get("kind") == "tile" and event.get("severity") == "critical" for event in done.events), "there is no event")
    text = done.told("CORRUPT MAP TILES")
    scene.holds(text, "nothing is reported to the operator")
    return f"{corrupt} counted; event; operator: {text}"


@attack("FS", seconds=240, memory_mb=600)
def tile_file_cut_off_in_flight(scene):
    """The tile set is cut off to a fifth in flight, so that every read fails; then it is whole again."""
    done = flown(scene).wait(scene)
    fixes = done.fixes(CUT + 1, WHOLE)
    scene.holds(fixes, "there is no fix while the file is cut off")
    wrong = wrong_and_sure(done.rows)
    scene.holds(not wrong, f"{len(wrong)} fixes are wrong and sure")
    cut, end = done.notes["cut"]["anchors"], done.notes["end"]["anchors"]
    scene.attacked(cut["accepted"] - done.notes["mended"]["anchors"]["accepted"] <= 12, "the cut had no effect")
    scene.holds(end["accepted"] > cut["accepted"], "it does not match the map again once the file is whole")
    return f"{len(fixes)} fixes meanwhile, 0 wrong and sure; {end['accepted'] - cut['accepted']} anchors after it"


@attack("FS", seconds=240, memory_mb=600)
def corrupt_tiles_leave_no_record(scene):
    """After the flight the recording is asked what happened to the map."""
    done = flown(scene).wait(scene)
    out = scene.folder / "export"
    ran = scene.run("nadir", "recorder", "export", done.record, "--format", "csv", "--out", out)
    scene.attacked(ran.code == 0, ran.said[:200])
    files = [out] if out.is_file() else [path for path in out.rglob("*") if path.is_file()]
    text = "\n".join(path.read_text(errors="replace") for path in files)
    scene.holds("artifact.hash" in text or "sqlite.corrupt" in text, "no tile event is recorded")
    return "artifact.hash in the recording's events"


@attack("FS", seconds=240, memory_mb=600)
def health_that_is_never_measured(scene):
    """The recording's health records are asked for what their format promises: memory, CPU, temperature."""
    from mcap.reader import NonSeekingReader
    done = flown(scene).wait(scene)
    found, records = set(), 0
    for segment in sorted(done.record.glob("*.flight.mcap")):
        with open(segment, "rb") as file:
            for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                if channel.topic == "/health":
                    records += 1
                    found |= {name for name in (b"memory_mb", b"cpu_percent", b"memory_available_mb", b"load_1min") if name in message.data}
    scene.attacked(records, "there is no health record")
    scene.holds(len(found) >= 3, f"measured: {sorted(found)}")
    return ", ".join(sorted(name.decode() for name in found))


@attack("FS", seconds=240, memory_mb=600)
def matcher_that_throws(scene):
    """While every read of the map fails, the service must say so and not look like "nothing was due"."""
    done = flown(scene).wait(scene)
    anchors = done.notes["cut"]["anchors"]
    said = [event for event in done.events if "match" in event.get("text", "").lower() or event.get("kind") == "tile"]
    scene.holds("failed" in anchors, "failed matches are not counted")
    scene.holds(said, "there is no event")
    return f"{anchors.get('failed')} failed, {len(said)} events: {said[-1]['text'][:60]}"


@attack("FS", seconds=240, memory_mb=600)
def coarse_scene_elsewhere(scene):
    """One scene of the package, which the aircraft never crosses, is known to 60 m alone: it must not make every position vague."""
    done = flown(scene).wait(scene)
    inspected = scene.run("nadir", "cache", "verify", done.folder / "inputs" / "package", "--trust", done.folder / "inputs" / "root.json", "--at",
                          done.created)
    scene.attacked(inspected.code == 0 and done.coarse_tiles > 0, f"no coarse tile is in the package: {inspected.said[:150]}")
    sigmas = [float(row["given_accuracy_m"]) for row in done.fixes(0, SPOILT)]
    scene.attacked(sigmas, "there is no fix before the tiles are corrupted")
    scene.holds(min(sigmas) < COARSE_CE90_M / 2.146 / 1.5, f"the best sigma is {min(sigmas):.1f} m")
    return f"{done.coarse_tiles} coarse tiles elsewhere; sigma {min(sigmas):.1f} m"
