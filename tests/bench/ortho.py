#!/usr/bin/env python3
"""The same frames with the same poses through Nadir and through Orthority: displacement between their results, and
CPU time.

usage: ./run bench ortho [--frames N] [--zoom Z] [--flight-frames N]

Orthority (PyPI: orthority, opencv-python-headless) is taken from NADIR_BENCH_VENV. Each frame of a simulated flight is
orthorectified by both over flat ground with the same camera and pose: Orthority onto a transverse Mercator plane at half
the tile's pixel, from there by GDAL onto each tile. The displacement between the two tiles is measured by correlation to
a fraction of a pixel; times are CPU times, the least of several.

Then a whole flight, one zoom coarser, so that few frames show a complete tile: replayed once, made into tiles with and
without mosaics of several frames, and each tile located in the world's own raster by correlation.
"""
import argparse
import csv
import json
import math
import os
import pathlib
import resource
import sqlite3
import subprocess
import sys
import tempfile
import time

try:
    import cv2
    import numpy as np
    import rasterio
    from orthority.camera import create_camera
    from orthority.ortho import Ortho
    from rasterio.transform import from_origin
    from rasterio.warp import Resampling, reproject
except ImportError as missing:
    print(f"NOT RUN: {missing}; pip install orthority opencv-python-headless into NADIR_BENCH_VENV")
    sys.exit(0)

cv2.setNumThreads(1)
CIRCUMFERENCE = 2 * math.pi * 6378137.0
BIN = pathlib.Path("build/bin")


def rotation(heading, pitch, roll):
    """East-north-up from the camera (x right, y down, z forwards): yaw, pitch, roll as in aviation."""
    ch, sh, cp, sp, cr, sr = (f(a) for a in (heading, pitch, roll) for f in (math.cos, math.sin))
    yaw = np.array([[ch, -sh, 0], [sh, ch, 0], [0, 0, 1]])
    nose = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    wing = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    enu_from_ned = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    body_from_camera = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    return enu_from_ned @ yaw @ nose @ wing @ body_from_camera


def omega_phi_kappa(enu_from_camera):
    r = enu_from_camera @ np.diag([1, -1, -1])  # PATB's camera: y up, z backwards
    return math.atan2(-r[1, 2], r[2, 2]), math.asin(r[0, 2]), math.atan2(-r[0, 1], r[0, 0])


def camera_of(path):
    values = {}
    for text in path.read_text().splitlines():
        key, _, value = text.split("#")[0].partition(":")
        if value.strip():
            values[key.strip()] = value.strip()
    distortion = json.loads(values.get("distortion", "[]")) or [0, 0, 0, 0, 0]
    return {k: float(values[k]) for k in ("width", "height", "fx", "fy", "cx", "cy")} | {"distortion": distortion}


def flight(folder, frames):
    """A world and a flight over it; all that matters is that the frames have texture."""
    world, out = folder / "world", folder / "flight"
    for args in (["simulate", "world", "--seed", "5", "--size-km", "1", "--gsd-m", "0.3", "--out", world],
                 ["simulate", "flight", "--world", world / "ground.tif", "--dem", world / "dem.tif", "--mission",
                  world / "mission.yaml", "--camera", world / "camera.yaml", "--frames", str(frames), "--out", out]):
        subprocess.run([BIN / "nadir", *args], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    truth = {row["frame"]: row for row in csv.DictReader(open(out / "truth.csv"))}
    for row in csv.DictReader(open(out / "telemetry.csv")):
        yield out / "frames" / row["frame"], row, truth[row["frame"]]


def ours(folder, camera, frame, telemetry, truth, zoom):
    out = folder / "ours"
    out.mkdir(exist_ok=True)
    for old in out.glob("*.png"):
        old.unlink()
    answer = subprocess.run(
        [BIN / "bench_ortho_frame", "--camera", camera, "--frame", frame, "--out", out, "--lon=" + truth["lon_deg"],
         "--lat=" + truth["lat_deg"], "--agl-m", telemetry["agl_m"], "--heading-deg=" + telemetry["heading_deg"],
         "--pitch-deg=" + telemetry["pitch_deg"], "--roll-deg=" + telemetry["roll_deg"], "--zoom", str(zoom)],
        check=True, capture_output=True, text=True).stdout
    return out, json.loads(answer)


def theirs(folder, model, frame, telemetry, truth, gsd):
    crs = f"+proj=tmerc +lat_0={truth['lat_deg']} +lon_0={truth['lon_deg']} +k=1 +ellps=WGS84 +units=m +no_defs"
    dem = folder / "dem.tif"
    with rasterio.open(dem, "w", driver="GTiff", width=200, height=200, count=1, dtype="float32", crs=crs,
                       transform=from_origin(-1000, 1000, 10, 10)) as target:
        target.write(np.zeros((200, 200), "float32"), 1)
    w, h = int(model["width"]), int(model["height"])
    k1, k2, p1, p2, k3 = model["distortion"]
    angles = [math.radians(float(telemetry[k])) for k in ("heading_deg", "pitch_deg", "roll_deg")]
    camera = create_camera("opencv", (w, h), (model["fx"], model["fy"]), sensor_size=(w, h),
                           cx=(model["cx"] - (w - 1) / 2) / max(w, h), cy=(model["cy"] - (h - 1) / 2) / max(w, h),
                           k1=k1, k2=k2, p1=p1, p2=p2, k3=k3, xyz=(0, 0, float(telemetry["agl_m"])),
                           opk=omega_phi_kappa(rotation(*angles)))
    out, least = folder / "ortho.tif", 1e9
    for _ in range(3):
        before = time.process_time()
        Ortho(frame, dem, camera, crs=crs).process(out, resolution=(gsd, gsd), interp="bilinear", build_ovw=False,
                                                   compress="deflate", overwrite=True, write_mask=True)
        least = min(least, time.process_time() - before)
    return out, least * 1000


def on_tile(ortho, x, y, zoom):
    side = CIRCUMFERENCE / 2**zoom
    tile = np.zeros((3, 256, 256), "uint8")
    valid = np.zeros((256, 256), "uint8")
    place = from_origin(x * side - CIRCUMFERENCE / 2, CIRCUMFERENCE / 2 - y * side, side / 256, side / 256)
    with rasterio.open(ortho) as source:
        reproject(source.read([1, 2, 3]), tile, src_transform=source.transform, src_crs=source.crs, dst_transform=place,
                  dst_crs="EPSG:3857", resampling=Resampling.average)
        reproject(source.dataset_mask(), valid, src_transform=source.transform, src_crs=source.crs, dst_transform=place,
                  dst_crs="EPSG:3857", resampling=Resampling.nearest)
    return cv2.cvtColor(np.moveaxis(tile, 0, 2), cv2.COLOR_RGB2GRAY), valid


def displacement(one, other):
    """The displacement by correlation, in pixels, and the correlation."""
    window = cv2.createHanningWindow((256, 256), cv2.CV_32F)
    (dx, dy), _ = cv2.phaseCorrelate(one.astype("float32"), other.astype("float32"), window)
    return math.hypot(dx, dy), float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def nadir(*args):
    """CPU seconds of a command that must succeed, and its output."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    result = subprocess.run([BIN / "nadir", *map(str, args)], capture_output=True, text=True)
    if result.returncode != 0:
        sys.exit(f"nadir {args[0]}: {result.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, result.stdout


def whole_flight(f, frames):
    """A package, a flight over it and the poses of its replay: what nadir ortho takes, as options."""
    nadir("simulate", "world", "--seed", 3, "--size-km", 1, "--gsd-m", 0.3, "--out", f / "world")
    for key in ("root", "signer", "tile"):
        nadir("keys", "create", "--out", f / key)
    nadir("keys", "root", "--root-key", f / "root.key.pem", "--package-signer", f / "signer.pub.pem", "--tile-signer",
          f"mini-07={f}/tile.pub.pem", "--expires", "2035-01-01", "--out", f / "root.json")
    nadir("cache", "build", "--mission", f / "world/mission.yaml", "--imagery", f / "world/map.tif", "--dem",
          f / "world/dem.tif", "--key", f / "signer.key.pem", "--out", f / "package")
    nadir("simulate", "flight", "--world", f / "world/ground.tif", "--dem", f / "world/dem.tif", "--mission",
          f / "world/mission.yaml", "--camera", f / "world/camera.yaml", "--frames", frames, "--out", f / "flight")
    first = next(csv.DictReader(open(f / "flight/truth.csv")))
    common = ["--package", f / "package", "--trust", f / "root.json", "--at", "2025-09-20", "--frames", f / "flight/frames",
              "--telemetry", f / "flight/telemetry.csv", "--camera", f / "world/camera.yaml"]
    spent, _ = nadir("replay", *common, f"--start={first['lon_deg']},{first['lat_deg']}", "--out", f / "result")
    return spent, [*common, "--estimates", f / "result/poses.json", "--key", f / "tile.key.pem", "--airframe", "mini-07",
                   "--captured", "2025-09-20T10:00:00Z"]


def several_frames(f, frames, zoom):
    """Tiles of one frame and of several, and how far from the world's own raster they lie."""
    flown_s, options = whole_flight(f, frames)
    print(f"a flight of {frames} frames at zoom {zoom}; replay {flown_s:.1f} s CPU")
    print("| | tiles | of several frames | off the raster, m: median, worst | stated sigma, m: median | seams, m: median, worst "
          "| CPU ms a frame |")
    print("|---|---|---|---|---|---|---|")
    for name, more in (("one frame", ["--single-frame"]), ("several", [])):
        out = f / name.replace(" ", "-")
        spent, _ = nadir("ortho", *options, "--zoom", zoom, *more, "--out", out)
        off, sigma, seams = [], [], []
        database = sqlite3.connect(f"file:{out}/tiles.mbtiles?mode=ro", uri=True)
        for text, data in database.execute("SELECT c.sidecar, t.tile_data FROM nadir_candidates c JOIN tiles t USING "
                                           "(zoom_level, tile_column, tile_row)"):
            sidecar = json.loads(text)
            tile = cv2.imdecode(np.frombuffer(data, "uint8"), cv2.IMREAD_GRAYSCALE)
            real, valid = on_tile(f / "world/ground.tif", sidecar["x"], sidecar["y"], zoom)
            if not valid.all():
                continue
            latitude = math.radians(sidecar["pose"]["lat_e7"] * 1e-7)
            off.append(displacement(tile, real)[0] * CIRCUMFERENCE / 2**zoom / 256 * math.cos(latitude))
            sigma.append(sidecar["pose"]["sigma_mm"] / 1000)
            if "seam_mm" in sidecar:
                seams.append(sidecar["seam_mm"] / 1000)
        figures = lambda values: f"{np.median(values):.2f}, {max(values):.2f}" if values else "none"
        print(f"| {name} | {len(off)} | {len(seams)} | {figures(off)} | {np.median(sigma) if sigma else 0:.2f} | {figures(seams)} "
              f"| {1000 * spent / frames:.0f} |")


def main():
    options = argparse.ArgumentParser(prog="ortho", description=__doc__.split("\n\n")[0])
    options.add_argument("--frames", type=int, default=6)
    options.add_argument("--zoom", type=int, default=19)
    options.add_argument("--flight-frames", type=int, default=24, help="of the flight for tiles of several frames; 0: none")
    asked = options.parse_args()
    moved, alike, our_ms, decode_ms, their_ms, tiles = [], [], [], [], [], 0
    with tempfile.TemporaryDirectory(prefix="nadir-ortho.") as name:
        folder = pathlib.Path(name)
        for frame, telemetry, truth in flight(folder, asked.frames):
            camera = folder / "world/camera.yaml"
            gsd = CIRCUMFERENCE / 2**asked.zoom / 256 * math.cos(math.radians(float(truth["lat_deg"])))
            out, answer = ours(folder, camera, frame, telemetry, truth, asked.zoom)
            ortho, spent = theirs(folder, camera_of(camera), frame, telemetry, truth, gsd / 2)
            _, whole = theirs(folder, camera_of(camera), frame, telemetry, truth, gsd)
            our_ms.append(answer["ortho_ms"] + answer["decode_ms"]), decode_ms.append(answer["decode_ms"])
            their_ms.append(whole)
            for tile in answer["tiles"]:
                other, valid = on_tile(ortho, tile["x"], tile["y"], asked.zoom)
                if not valid.all():
                    continue
                px, like = displacement(cv2.imread(str(out / tile["file"]), cv2.IMREAD_GRAYSCALE), other)
                moved.append(px), alike.append(like)
                tiles += 1
    if not tiles:
        print("no tile to compare")
        return 2
    print(f"frames {asked.frames}, tiles {tiles} at zoom {asked.zoom}")
    print(f"displacement, pixels of the tile: median {np.median(moved):.3f}, worst {max(moved):.3f}  (bar: 1)")
    print(f"correlation of the two: median {np.median(alike):.4f}, worst {min(alike):.4f}")
    print(f"CPU ms a frame, decoding included: Nadir {np.median(our_ms):.1f} (decoding {np.median(decode_ms):.1f}), "
          f"Orthority {np.median(their_ms):.1f}: {np.median(their_ms) / np.median(our_ms):.1f} times")
    if asked.flight_frames:
        with tempfile.TemporaryDirectory(prefix="nadir-ortho.") as name:
            several_frames(pathlib.Path(name), asked.flight_frames, asked.zoom - 1)
    return 0 if max(moved) <= 1 else 1


if __name__ == "__main__":
    sys.exit(main())
