"""The inputs of a closed loop: a world, its signed package, a camera, an airframe, a circuit."""
import json
import pathlib
import re
import subprocess

from .signing import airframe_signer, sign_airframe

# The circuit in the mission's sector, as shares of its box (east, north): turns of 20° to 110°, left and right.
CIRCUIT = [(0.20, 0.20), (0.80, 0.22), (0.78, 0.50), (0.50, 0.60), (0.75, 0.82), (0.22, 0.80)]
CAMERA = {"model": "pinhole", "width": 1920, "height": 1080, "fx": 1500.0, "fy": 1500.0, "cx": 959.5, "cy": 539.5,
          "distortion": [-0.08, 0.03, 0.0004, -0.0003, 0.0]}
UNCERTAINTY = {"heading_deg": 2.5, "agl_relative": 0.03, "tilt_deg": 0.8}


def must(*command):
    result = subprocess.run([str(word) for word in command], stdin=subprocess.DEVNULL, capture_output=True, text=True,
                            check=False)
    if result.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, command))}: {(result.stderr or result.stdout).strip()[-600:]}")
    return result.stdout


class Inputs:
    """Files under `folder`, created once: an existing folder is used unchanged."""

    def __init__(self, folder, nadir, seed=7, size_km=2.0, gsd_m=0.4, width=1920, delay_s=0.25, gps_id=0,
                 with_package=True, airframe="any", uncertainty=None):
        """uncertainty: of the telemetry, beside or instead of UNCERTAINTY."""
        self.folder, self.nadir, self.airframe_id = pathlib.Path(folder), nadir, airframe
        self.uncertainty = {**UNCERTAINTY, **(uncertainty or {})}
        self.folder.mkdir(parents=True, exist_ok=True)
        self.world, self.package = self.folder / "world", self.folder / "package"
        self.root, self.camera = self.folder / "root.json", self.folder / "camera.yaml"
        self.waypoints = self.folder / "waypoints.csv"
        self.terrain, self.key = self.folder / "terrain.asc", self.folder / "link.key"
        if not self.world.exists():
            must(nadir, "simulate", "world", "--seed", seed, "--size-km", size_km, "--gsd-m", gsd_m, "--out", self.world)
        mission = (self.world / "mission.yaml").read_text(encoding="utf-8")
        self.created = re.search(r"^created: *(\S+)", mission, re.M).group(1)
        self.altitude_m = float(re.search(r"height_m: *([-\d.]+)", mission).group(1)) + float(
            re.search(r"agl_m: *([\d.]+)", mission).group(1))
        if with_package and not self.package.exists():
            self._make_package()
        self._write_camera(width, delay_s, gps_id)
        self._write_circuit(mission)
        if not self.terrain.exists():
            self._write_terrain()
        if not self.key.exists():
            self.key.write_text("5a" * 32 + "\n", encoding="ascii")
            self.key.chmod(0o600)

    def _make_package(self):
        for name in ("root", "signer", "hangar"):
            must(self.nadir, "keys", "create", "--out", self.folder / name)
        must(self.nadir, "keys", "root", "--root-key", self.folder / "root.key.pem", "--package-signer",
             self.folder / "signer.pub.pem", "--airframe-signer", self.folder / "hangar.pub.pem", "--expires", "2035-01-01",
             "--out", self.root)
        must(self.nadir, "cache", "build", "--mission", self.world / "mission.yaml", "--imagery", self.world / "map.tif",
             "--dem", self.world / "dem.tif", "--key", self.folder / "signer.key.pem", "--out", self.package)
        must(self.nadir, "cache", "index", self.package, "--key", self.folder / "signer.key.pem")

    def _write_camera(self, width, delay_s, gps_id):
        scale = width / CAMERA["width"]
        camera = dict(CAMERA, width=width, height=round(CAMERA["height"] * scale), fx=CAMERA["fx"] * scale,
                      fy=CAMERA["fy"] * scale, cx=(CAMERA["cx"] + 0.5) * scale - 0.5,
                      cy=(CAMERA["cy"] + 0.5) * scale - 0.5, uncertainty=self.uncertainty)
        self.camera.write_text("".join(f"{key}: {json.dumps(value)}\n" for key, value in camera.items()), encoding="utf-8")
        self.airframe = {"format": "nadir.airframe/1", "airframe": self.airframe_id, "camera": camera,
                         "capture_delay_s": delay_s, "mavlink": {"gps_id": gps_id}}

    def airframe_with(self, file, parameters):
        """Writes the airframe file of an autopilot with these parameters, signed where the root names a signer; returns `file`."""
        listed = [{"name": name, "value": value} for name, value in parameters.items()]
        document = {**self.airframe, "mavlink": {**self.airframe["mavlink"], "parameters": listed}}
        file.write_text(json.dumps(document, indent=1), encoding="utf-8")
        if self.root.exists() and airframe_signer(self.root) is not None:
            sign_airframe(file, self.folder / "hangar.key.pem", self.root)
        return file

    def _write_circuit(self, mission):
        ring = re.search(r"polygon: *(\[\[.*\]\])", mission).group(1)
        points = json.loads(ring)
        west, east = (choose(p[0] for p in points) for choose in (min, max))
        south, north = (choose(p[1] for p in points) for choose in (min, max))
        rows = [f"{south + y * (north - south):.7f},{west + x * (east - west):.7f}\n" for x, y in CIRCUIT]
        self.waypoints.write_text("lat_deg,lon_deg\n" + "".join(rows), encoding="utf-8")

    def _write_terrain(self):
        warped = self.folder / "terrain.tif"
        must("gdalwarp", "-q", "-overwrite", "-t_srs", "EPSG:4326", "-r", "bilinear", "-ts", 200, 200, "-dstnodata", -9999,
             self.world / "dem.tif", warped)
        must("gdal_translate", "-q", "-of", "AAIGrid", warped, self.terrain)
