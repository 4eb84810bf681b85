"""What the end-to-end tests share: running the programs, small inputs, and checks that nothing was left behind."""
import atexit
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

NADIR = sys.argv[1] if len(sys.argv) > 1 else "build/bin/nadir"
NADIRD = sys.argv[2] if len(sys.argv) > 2 else "build/bin/nadird"

# The area of the small missions: 400 m square, 0.5 m/px.
WEST, SOUTH, EAST, NORTH = 8.4970, 47.3980, 8.5030, 47.4020

MISSION = """schema: nadir.mission/1
id: small
series: small
sequence: {sequence}
created: 2024-10-30T00:00:00Z
expires: 2024-11-30T00:00:00Z
takeoff: {{lon_deg: 8.5, lat_deg: 47.4}}
terrain: {{mode: flat}}
zoom: {{min: 16, max: 18}}
min_resolution_m: 1.0
budget_mb: 50
freshness_days: {{stable: 730, active: 400}}
airframes: [mini-07]
sectors:
  - {{id: field, class: stable, polygon: [[8.4985, 47.3990], [8.5015, 47.3990], [8.5015, 47.4010], [8.4985, 47.4010], [8.4985, 47.3990]]}}
route: {{corridor_half_width_m: 40, agl_m: 100, points: [[8.4990, 47.4000], [8.5010, 47.4000]]}}
"""
STAC = {"type": "Feature", "stac_version": "1.0.0", "id": "map", "geometry": None,
        "properties": {"datetime": "2024-06-01T00:00:00Z", "gsd": 0.5, "providers": [{"name": "test"}], "license": "CC0-1.0",
                       "nadir:ce90_m": 4.0}, "assets": {}, "links": []}
CAMERA = """model: pinhole
width: {width}
height: {height}
fx: 250.0
fy: 250.0
cx: 160.0
cy: 120.0
distortion: []
uncertainty: {{heading_deg: 3.0, agl_relative: 0.03, tilt_deg: 1.0}}
"""
AT = "2024-11-05T00:00:00Z"


def run(*args, program=None, timeout=300):
    """Runs nadir (or another program) without a terminal and without input."""
    return subprocess.run([program or NADIR, *map(str, args)], stdin=subprocess.DEVNULL, capture_output=True, text=True,
                          timeout=timeout)


MADE = {}


def made_once(name, make):
    """A folder that make(folder) fills the first time that it is asked for. Tests copy from it and never write to it."""
    if name not in MADE:
        folder = pathlib.Path(tempfile.mkdtemp(prefix="nadir-e2e."))
        atexit.register(shutil.rmtree, folder, True)
        make(folder)
        MADE[name] = folder
    return MADE[name]


def write_map(path, seed=1):
    """A georeferenced RGB raster with structure, made by GDAL's own tools from a PPM."""
    import random
    generator = random.Random(seed)
    width, height = 912, 890
    blocks = [[generator.randrange(40, 220) for _ in range(width // 16 + 1)] for _ in range(height // 16 + 1)]
    rows = bytearray()
    for y in range(height):
        row = blocks[y // 16]
        for x in range(width):
            value = row[x // 16] + (x * 7 + y * 13) % 23
            rows += bytes((value, (value * 3) % 256, 255 - value))
    ppm = path.with_suffix(".ppm")
    ppm.write_bytes(b"P6 %d %d 255\n" % (width, height) + rows)
    subprocess.run(["gdal_translate", "-q", "-a_srs", "EPSG:4326", "-a_ullr", str(WEST), str(NORTH), str(EAST),
                    str(SOUTH), str(ppm), str(path)], check=True)
    ppm.unlink()
    path.with_suffix(".json").write_text(json.dumps(STAC))


def write_jpeg(path, width, height, seed=1):
    """A picture with structure; gdal_translate writes the JPEG."""
    import random
    generator = random.Random(seed)
    ppm = path.with_suffix(".ppm")
    blocks = [[generator.randrange(256) for _ in range(width // 8 + 1)] for _ in range(height // 8 + 1)]
    rows = [b"".join(bytes([value]) * 24 for value in row)[: 3 * width] for row in blocks]
    ppm.write_bytes(b"P6 %d %d 255\n" % (width, height) + b"".join(rows[y // 8] for y in range(height)))
    subprocess.run(["gdal_translate", "-q", "-of", "JPEG", str(ppm), str(path)], check=True)
    ppm.unlink()
    side = path.with_suffix(path.suffix + ".aux.xml")
    if side.exists():
        side.unlink()


class EndToEnd(unittest.TestCase):
    maxDiff = None

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="nadir-e2e."))
        self.addCleanup(shutil.rmtree, self.folder, True)

    def good(self, *args, **kwargs):
        result = run(*args, **kwargs)
        self.assertEqual(0, result.returncode, f"{args}\n{result.stdout}\n{result.stderr}")
        return result

    def fails(self, code, *args, mentions=(), leaves_nothing=None, **kwargs):
        """The command exits with this code and a useful message, and its output does not exist."""
        result = run(*args, **kwargs)
        self.assertEqual(code, result.returncode, f"{args}\n{result.stdout}\n{result.stderr}")
        talk = result.stderr if code == 2 else result.stdout + result.stderr
        self.assertTrue(talk.strip(), f"{args}: no message")
        for word in mentions:
            self.assertIn(word, talk, f"{args}\n{talk}")
        for word in ("terminate called", "what():", "core dumped", "unexpected error:"):
            self.assertNotIn(word, talk)
        if leaves_nothing is not None:
            out = pathlib.Path(leaves_nothing)
            left = [p.name for p in out.parent.iterdir() if p.name == out.name or p.name.startswith("." + out.name)]
            self.assertEqual([], left, f"{args} left something behind")
        return result

    def keys(self):
        shutil.copytree(made_once("keys", self.make_keys), self.folder, dirs_exist_ok=True)

    def make_keys(self, folder):
        for name in ("root", "signer"):
            self.good("keys", "create", "--out", folder / name)
        self.good("keys", "root", "--root-key", folder / "root.key.pem", "--package-signer", folder / "signer.pub.pem",
                  "--expires", "2035-01-01", "--out", folder / "root.json")

    def mission(self, name="mission.yaml", sequence=1, change=lambda text: text):
        path = self.folder / name
        path.write_text(change(MISSION.format(sequence=sequence)))
        return path

    def map(self):
        if not (self.folder / "map.tif").exists():
            shutil.copytree(made_once("map", lambda folder: write_map(folder / "map.tif")), self.folder, dirs_exist_ok=True)
        return self.folder / "map.tif"

    def build(self, out="package", name="mission.yaml", sequence=1, change=lambda text: text):
        """The small package, signed by keys()."""
        mission, picture = self.mission(name, sequence, change), self.map()
        made = made_once(mission.read_text(), lambda folder: self.good(
            "cache", "build", "--mission", mission, "--imagery", picture, "--key", self.folder / "signer.key.pem", "--out",
            folder / "package"))
        shutil.copytree(made / "package", self.folder / out)
        return self.folder / out

    def flight(self, frames=3, width=320, height=240):
        folder = self.folder / "flight"
        (folder / "frames").mkdir(parents=True)
        rows = ["frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg"]
        for i in range(frames):
            made = made_once(f"picture {i} {width} {height}", lambda made: write_jpeg(made / "frame.jpg", width, height, seed=i))
            shutil.copy(made / "frame.jpg", folder / "frames" / f"{i}.jpg")
            rows.append(f"{i}.jpg,{i}.0,100,90,0,0")
        (folder / "telemetry.csv").write_text("\n".join(rows) + "\n")
        (folder / "camera.yaml").write_text(CAMERA.format(width=width, height=height))
        return folder

    def matches_nowhere(self, *args):
        """A replay of frames of noise over a map of noise: complete, and it says that nothing was localized."""
        result = run(*args)
        self.assertEqual(1, result.returncode, f"{args}\n{result.stdout}\n{result.stderr}")
        self.assertIn("no frame was localized on the map", result.stderr)
        return result

    def replay_args(self, flight, out):
        return ["replay", "--frames", flight / "frames", "--telemetry", flight / "telemetry.csv", "--camera",
                flight / "camera.yaml", "--start", "8.499,47.4", "--out", out]


def data_set(name):
    """The folder of a real data set, or the end of this test with the code for "skipped"."""
    source = pathlib.Path(os.environ.get("NADIR_SOURCE", "."))
    for root in (os.environ.get("NADIR_DATA"), source.parent / "shared" / "data"):
        if root and (pathlib.Path(root) / name).is_dir():
            return pathlib.Path(root) / name
    print(f"SKIPPED: the data set {name} is not here; set NADIR_DATA to the folder that holds it", file=sys.stderr)
    sys.exit(77)


def main():
    unittest.main(argv=[sys.argv[0]], verbosity=2)
