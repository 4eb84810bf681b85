#!/usr/bin/env python3
"""A simulated survey of parallel legs, adjusted by `nadir replay --adjust` and reconstructed by COLMAP's mapper: how well
the positions of the frames agree with the truth, and what that costs.

usage: ./run bench survey [--legs N] [--size-km S] [--seed N] [--keep DIR]

Both get the same pictures and the same lens. COLMAP (Debian: colmap) knows no place: its reconstruction is moved, turned
and scaled onto the truth by the best similarity, which also takes out every error that all frames share. Ours is measured
twice: as it is, and after the best similarity in the plane. Both in the plane, over the frames that each has placed.
"""
import argparse
import csv
import json
import math
import os
import pathlib
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time

try:
    import numpy
except ImportError as missing:
    print(f"NOT RUN: {missing}; apt-get install python3-numpy, or NADIR_BENCH_VENV with numpy")
    sys.exit(0)

NADIR = pathlib.Path("build/bin/nadir")


def run(*command, **options):
    """CPU seconds of a command that succeeds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False, **options)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def survey_mission(path, legs):
    """The mission of a simulated world with a route of parallel legs, north and south in turn."""
    text = path.read_text()
    west, south, east, north = area_of(path.parent)
    route = []
    for leg in range(legs):
        lon = west + (east - west) * (0.2 + 0.6 * leg / (legs - 1))
        ends = [south + (north - south) * share for share in (0.2, 0.8)]
        route += [(lon, lat) for lat in (ends if leg % 2 == 0 else reversed(ends))]
    points = ", ".join(f"[{lon:.7f}, {lat:.7f}]" for lon, lat in route)
    changed, count = re.subn(r"(?m)^( +points:).*$", rf"\1 [{points}]", text)
    if count != 1:
        sys.exit(f"{path}: one route expected, {count} found")
    path.write_text(changed)


def area_of(world):
    item = json.loads((world / "ground.json").read_text())
    return item["bbox"][0], item["bbox"][1], item["bbox"][-2], item["bbox"][-1]


def places(path, origin):
    """Metres east and north of the rows that have a position, by frame."""
    found = {}
    with open(path, newline="", encoding="utf-8") as rows:
        for row in csv.DictReader(rows):
            if row["lat_deg"]:
                lat, lon = float(row["lat_deg"]), float(row["lon_deg"])
                metres = math.pi / 180 * 6371008.8
                found[row["frame"]] = ((lon - origin[0]) * metres * math.cos(math.radians(origin[1])), (lat - origin[1]) * metres)
    return found


def similarity(points, target):
    """Umeyama 1991: scale, rotation and shift that take points onto target best."""
    mean, aim = points.mean(axis=0), target.mean(axis=0)
    covariance = (target - aim).T @ (points - mean) / len(points)
    u, spread, v = numpy.linalg.svd(covariance)
    sign = numpy.eye(points.shape[1])
    sign[-1, -1] = numpy.sign(numpy.linalg.det(u) * numpy.linalg.det(v))
    rotation = u @ sign @ v
    scale = (spread * numpy.diag(sign)).sum() / ((points - mean) ** 2).sum(axis=1).mean()
    return scale * (points - mean) @ rotation.T + aim


def figures(name, frames, of, errors, cpu_s):
    errors = numpy.sort(errors)
    rms = math.sqrt((errors ** 2).mean())
    print(f"| {name:52} | {frames:3} of {of:3} | {rms:7.3f} | {numpy.median(errors):7.3f} | {errors[-1]:7.3f} | {cpu_s:7.1f} |", flush=True)


def reconstruct(folder, frames, camera):
    """COLMAP's camera centres by frame, of its largest model, and the CPU seconds."""
    database, sparse = folder / "colmap.db", folder / "sparse"
    sparse.mkdir()
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    lens = ",".join(str(camera[key]) for key in ("fx", "fy", "cx", "cy"))
    seconds = run("colmap", "feature_extractor", "--database_path", database, "--image_path", frames, "--ImageReader.single_camera", 1,
                  "--ImageReader.camera_model", "OPENCV", "--ImageReader.camera_params",
                  lens + "," + ",".join(str(value) for value in camera["distortion"][:4]), "--SiftExtraction.use_gpu", 0, env=environment)
    seconds += run("colmap", "exhaustive_matcher", "--database_path", database, "--SiftMatching.use_gpu", 0, env=environment)
    seconds += run("colmap", "mapper", "--database_path", database, "--image_path", frames, "--output_path", sparse, env=environment)
    best = {}
    for model in sparse.iterdir():
        run("colmap", "model_converter", "--input_path", model, "--output_path", model, "--output_type", "TXT", env=environment)
        lines = [line for line in (model / "images.txt").read_text().splitlines() if not line.startswith("#")][::2]
        centres = {}
        for line in lines:
            _, qw, qx, qy, qz, tx, ty, tz, _, name = line.split()
            w, x, y, z = (float(value) for value in (qw, qx, qy, qz))
            camera_from_world = numpy.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                                             [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                                             [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
            centres[name] = -camera_from_world.T @ numpy.array([float(tx), float(ty), float(tz)])
        best = max(best, centres, key=len)
    return best, seconds


def camera_of(path):
    values = dict(re.findall(r"(?m)^(\w+):[ \t]*([^#\n]+)", path.read_text()))
    return {"distortion": json.loads(values.get("distortion", "[0, 0, 0, 0, 0]")),
            **{key: float(values[key]) for key in ("fx", "fy", "cx", "cy")}}


def main():
    parser = argparse.ArgumentParser(prog="./run bench survey", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--legs", type=int, default=5)
    parser.add_argument("--size-km", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=21)
    parser.add_argument("--keep", type=pathlib.Path, help="keep all files in this new folder")
    options = parser.parse_args()
    folder = options.keep or pathlib.Path(tempfile.mkdtemp())
    folder.mkdir(exist_ok=True)
    try:
        compare(folder, options)
    finally:
        if not options.keep:
            shutil.rmtree(folder)


def compare(folder, options):
    world, flight = folder / "world", folder / "flight"
    run(NADIR, "simulate", "world", "--seed", options.seed, "--size-km", options.size_km, "--gsd-m", 0.3, "--out", world)
    survey_mission(world / "mission.yaml", options.legs)
    run(NADIR, "simulate", "flight", "--world", world / "ground.tif", "--dem", world / "dem.tif", "--mission", world / "mission.yaml",
        "--camera", world / "camera.yaml", "--seed", options.seed + 1, "--noise", "real", "--out", flight)
    for name in ("root", "signer"):
        run(NADIR, "keys", "create", "--out", folder / name)
    run(NADIR, "keys", "root", "--root-key", folder / "root.key.pem", "--package-signer", folder / "signer.pub.pem", "--expires",
        "2035-01-01", "--out", folder / "root.json")
    run(NADIR, "cache", "build", "--mission", world / "mission.yaml", "--imagery", world / "map.tif", "--dem", world / "dem.tif", "--key",
        folder / "signer.key.pem", "--out", folder / "package")
    at = re.search(r"(?m)^created: *(\S+)", (world / "mission.yaml").read_text()).group(1)
    with open(flight / "truth.csv", encoding="utf-8") as rows:
        truth = {row["frame"]: row for row in csv.DictReader(rows)}
    first = next(iter(truth.values()))
    origin = (float(first["lon_deg"]), float(first["lat_deg"]))
    seconds = run(NADIR, "replay", "--package", folder / "package", "--trust", folder / "root.json", "--at", at, "--frames", flight / "frames",
                  "--telemetry", flight / "telemetry.csv", "--camera", flight / "camera.yaml", f"--start={origin[0]},{origin[1]}", "--adjust",
                  "--out", folder / "replay")
    true = places(flight / "truth.csv", origin)

    print(f"{len(true)} frames of {options.legs} legs; errors in metres in the plane\n")
    print("| positions                                            | frames     |     rms |  median |   worst |   CPU s |")
    print("|------------------------------------------------------|------------|---------|---------|---------|---------|")
    for kind in ("estimates", "refined", "adjusted"):
        ours = places(folder / "replay" / f"{kind}.csv", origin)
        names = sorted(ours)
        error = lambda points: numpy.linalg.norm(points - numpy.array([true[name] for name in names]), axis=1)
        points = numpy.array([ours[name] for name in names])
        figures(f"nadir, {kind}.csv", len(names), len(true), error(points), seconds)
        figures(f"nadir, {kind}.csv, after the best similarity", len(names), len(true),
                error(similarity(points, numpy.array([true[name] for name in names]))), seconds)
    if shutil.which("colmap") is None:
        print("NOT RUN: COLMAP; apt-get install colmap")
        return
    started = time.monotonic()
    centres, seconds = reconstruct(folder, flight / "frames", camera_of(flight / "camera.yaml"))
    names = sorted(centres)
    if len(names) < 3:
        print(f"COLMAP registered {len(names)} frames")
        return
    up = numpy.array([[*true[name], float(truth[name]["alt_m"])] for name in names])
    moved = similarity(numpy.array([centres[name] for name in names]), up)
    figures("colmap 3.8 mapper, after the best similarity", len(names), len(true), numpy.linalg.norm((moved - up)[:, :2], axis=1), seconds)
    print(f"\nCOLMAP: {time.monotonic() - started:.0f} s of wall time")


if __name__ == "__main__":
    main()
