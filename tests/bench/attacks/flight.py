"""What befalls the map in flight: one flight in the closed loop, judged by several rows. The package's folder is exchanged; the tile
file is cut off, and corrupted; each until the service has met it, however slow the machine is, and then undone."""
import json
import shutil
import sqlite3
import threading

from .registry import attack

from loop.evidence import fresh_fixes, within, wrong_and_sure  # noqa: E402  (shared.py has put its folder on the path)
from loop.flight import Flight, Setup  # noqa: E402
from loop.torn_tiles import BACK_WITHIN_S, TileFile, corrupt_tiles, fly_on  # noqa: E402
from loop.inputs import Inputs, must  # noqa: E402

COARSE_CE90_M = 60
DENIED_S, SETTLED_S, EACH_S, PATIENCE_S = 12, 5, 8, 25  # EACH_S: of a fault, at least; PATIENCE_S: for its effect, and again for its end
MINUTES = 4  # at most: it ends when all has been seen; the aircraft then has not been anywhere twice


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
        self.package = run / "package"
        shutil.copytree(inputs.package, self.package)
        setup = Setup(inputs, run, programs / "nadir", programs / "nadird", [f"{DENIED_S}:gps-denied"], MINUTES, signed=True,
                      package=self.package)
        self.states, self.windows = {}, {}  # by name: before and after a fault, its begin and end in seconds of flight
        with Flight(setup) as flight:
            self.flight = flight
            flight.start()
            fly_on(flight, DENIED_S + SETTLED_S, self.grown("anchors"), PATIENCE_S)
            self.befall("swapped", self.swap, self.swap_back, self.grown("anchors"))
            tiles = TileFile(self.package)
            self.befall("cut", tiles.cut, tiles.restore, self.grown("corrupt tiles"))
            self.befall("corrupt", tiles.corrupt, tiles.restore, self.grown("corrupt tiles"))
            flight.autopilot.end()
            self.summary, _ = flight.finish()
            self.begun_flying = flight.begun_flying
            self.memory_mb = max((mb for _, mb in flight.watch.memory), default=0.0)
            self.events = [event for _, event in sorted(flight.watch.events.items())]
        self.rows, self.record = setup.rows(), flight.record

    def count(self, what):
        state = self.flight.watch.state
        return corrupt_tiles(state) if what == "corrupt tiles" else state.get("anchors", {}).get("accepted", 0)

    def grown(self, what):
        """Whether there are more of them since the first call."""
        before = []

        def condition():
            before.append(self.count(what))
            return before[-1] > before[0]
        return condition

    def befall(self, name, begin, undo, noticed):
        """A fault: it lasts until it is noticed; afterwards, until the map is matched again."""
        before, begun_s = dict(self.flight.watch.state), self.flight.elapsed_s()
        begin()
        fly_on(self.flight, EACH_S, noticed, PATIENCE_S)
        self.states[name] = (before, dict(self.flight.watch.state))
        undo()
        self.windows[name] = (begun_s, self.flight.elapsed_s())
        self.states["after " + name] = self.states[name][1], None
        fly_on(self.flight, SETTLED_S, self.grown("anchors"), PATIENCE_S)
        self.states["after " + name] = self.states[name][1], dict(self.flight.watch.state)

    def swap(self):
        """Another package takes the folder's place, whose tile file is empty."""
        aside = self.package.with_name("aside")
        self.package.rename(aside)
        shutil.copytree(aside, self.package)
        other = TileFile(self.package).path
        other.write_bytes(b"")
        self.swapped = other.stat()

    def swap_back(self):
        shutil.rmtree(self.package)
        self.package.with_name("aside").rename(self.package)

    def wait(self, scene):
        self.thread.join(330)
        scene.attacked(not self.thread.is_alive() and self.error is None, f"the flight did not end in order: {self.error}")
        scene.peak_mb, scene.code = self.memory_mb, 0
        return self

    def reported(self, words):
        return next((event["text"] for event in self.summary["events"] if event["kind"] == "statustext" and words in event["text"]), None)

    def anchors(self, name):
        """How many matches were accepted meanwhile."""
        before, after = self.states[name]
        return after["anchors"]["accepted"] - before["anchors"]["accepted"]

    def corrupt(self, name):
        before, after = self.states[name]
        return corrupt_tiles(after) - corrupt_tiles(before)

    def fixes(self, name):
        return fresh_fixes(within(self.rows, *self.windows[name]))


FLOWN = []


def flown(scene):
    """The flight, begun now if it has not been. attacks.py begins it first, so that it is over when its rows come."""
    if not FLOWN:
        FLOWN.append(Flown(scene))
    return FLOWN[0]


@attack("FS", seconds=360, memory_mb=600)
def tiles_corrupted_in_flight(scene):
    """Every second kilobyte of the tile set is inverted while the aircraft flies over it."""
    done = flown(scene).wait(scene)
    scene.attacked(done.anchors("after cut") > 0, "it was not matched to the map before")
    corrupt = done.corrupt("corrupt")
    scene.holds(corrupt > 0, "nothing counts the corrupt tiles")
    scene.holds(any(event.get("kind") == "tile" and event.get("severity") == "critical" for event in done.events), "there is no event")
    text = done.reported("CORRUPT MAP TILES")
    scene.holds(text, "nothing is reported to the operator")
    wrong = wrong_and_sure(done.rows)
    scene.holds(not wrong, f"{len(wrong)} fixes are wrong and sure")
    scene.holds(done.anchors("after corrupt") > 0, "it does not match the map again once the tiles are whole")
    return f"{corrupt} counted; event; operator: {text}; {done.anchors('after corrupt')} anchors after it"


@attack("FS", seconds=360, memory_mb=600)
def tile_file_cut_off_in_flight(scene):
    """The tile set is cut off to a fifth in flight, until the service has read where nothing is left; then it is whole again."""
    done = flown(scene).wait(scene)
    holes = done.corrupt("cut")
    scene.attacked(holes > 0, f"no tile was read from what is cut off: {done.states['cut'][1]['anchors']}")
    fixes, end_s = done.fixes("cut"), done.windows["cut"][1]
    scene.holds(fixes, "there is no fix while the file is cut off")
    wrong = wrong_and_sure(done.rows)
    scene.holds(not wrong, f"{len(wrong)} fixes are wrong and sure")
    scene.holds(fresh_fixes(within(done.rows, end_s, end_s + BACK_WITHIN_S)), f"no position {BACK_WITHIN_S} s after the file is whole again")
    scene.holds(done.anchors("after cut") > 0, "it does not match the map again once the file is whole")
    return f"{holes} tiles not read, {len(fixes)} fixes meanwhile, 0 wrong and sure; {done.anchors('after cut')} anchors after it"


@attack("FS", seconds=360, memory_mb=600)
def package_swapped_in_flight(scene):
    """Another package, with an empty tile file, takes the folder's place while the aircraft flies by the first."""
    done = flown(scene).wait(scene)
    scene.attacked(done.swapped.st_size == 0, "the path does not lead to the empty file")
    scene.holds(done.corrupt("swapped") == 0, f"{done.corrupt('swapped')} tiles are read from the other package")
    scene.holds(done.anchors("swapped") > 0, "the map is not matched any more")
    scene.holds(done.fixes("swapped"), "there is no fix meanwhile")
    return f"{done.anchors('swapped')} anchors meanwhile, from the file that was verified; 0 corrupt tiles"


@attack("FS", seconds=360, memory_mb=600)
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


@attack("FS", seconds=360, memory_mb=600)
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


@attack("FS", seconds=360, memory_mb=600)
def matcher_that_throws(scene):
    """While every read of the map fails, the service must say so and not look like "nothing was due"."""
    done = flown(scene).wait(scene)
    anchors = done.states["cut"][1]["anchors"]
    begun_s, end_s = (done.begun_flying + at_s for at_s in done.windows["cut"])
    said = [event for event in done.events if event.get("kind") in ("match", "tile") and begun_s <= event["at"] <= end_s]
    scene.holds("failed" in anchors, "failed matches are not counted")
    scene.holds(said, "there is no event")
    return f"{anchors.get('failed')} failed, {len(said)} events: {said[-1]['text'][:60]}"


@attack("FS", seconds=360, memory_mb=600)
def coarse_scene_elsewhere(scene):
    """One scene of the package, which the aircraft never crosses, is known to 60 m alone: it must not make every position vague."""
    done = flown(scene).wait(scene)
    inspected = scene.run("nadir", "cache", "verify", done.folder / "inputs" / "package", "--trust", done.folder / "inputs" / "root.json", "--at",
                          done.created)
    scene.attacked(inspected.code == 0 and done.coarse_tiles > 0, f"no coarse tile is in the package: {inspected.said[:150]}")
    sigmas = [float(row["given_accuracy_m"]) for row in fresh_fixes(within(done.rows, 0, done.windows["cut"][0]))]
    scene.attacked(sigmas, "there is no fix before the tile file is cut off")
    scene.holds(min(sigmas) < COARSE_CE90_M / 2.146 / 1.5, f"the best sigma is {min(sigmas):.1f} m")
    return f"{done.coarse_tiles} coarse tiles elsewhere; sigma {min(sigmas):.1f} m"
