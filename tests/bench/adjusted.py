#!/usr/bin/env python3
"""Flights from pictures, adjusted as a whole: errors online, smoothed and adjusted.

usage: adjusted.py BUILD [--data DIR] [--seeds N] [--only fengyuan|arroio|simulated] [--mosaics DIR]

Real photos (shared/data, see its README) go through `nadir replay --adjust`; where they are missing it says NOT RUN. Simulated
flights through bench_adjusted_flight. Errors are given as they are, and with their median offset taken out, which is mostly
the map's own (fengyuan: about 5 m). The truth of arroio is where the middle of each picture lies, by hand and by an independent
registration on the same map, not where the camera was: what that differs by in the aircraft's axes, its median, is taken out as well.
The orthophoto of the adjusted poses is measured by bench_mosaic: seams, and steps of exposure, before and after the exposures are balanced, and
over the shape of the ground that the photos show.
--mosaics DIR keeps its pictures.
"""
import argparse
import csv
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

SETS = {
    "fengyuan": {"map": "map.tif", "start": "120.720208,24.262133", "at": "2024-11-05", "of": "camera", "shrink": 4},
    "arroio": {"map": "map_2014-01.tif", "start": None, "at": "2014-06-05", "of": "middle of the picture", "shrink": 2},
}


def run(*command):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if result.returncode not in (0, 1):
        sys.exit(f"{' '.join(map(str, command))}\n{result.stderr}")
    return result.stdout


def truths(place):
    """(name, {frame: (lat, lon)}) of each truth that the set has."""
    stated = {row["frame"]: (float(row["lat_deg"]), float(row["lon_deg"]))
              for row in csv.DictReader((place / "truth.csv").read_text().splitlines()) if row["lat_deg"]}
    found = [("truth.csv", stated)]
    if (place / "registered.csv").exists():
        # By how much the registration on this map moves the stated place; only where both maps' registrations are sound.
        moved = {}
        for row in csv.DictReader((place / "registered.csv").read_text().splitlines()):
            if row["frame"] not in stated or not all(int(row[f"{of}_inliers"] or 0) >= 15 for of in ("jan", "mar")):
                continue
            east, north = float(row["jan_east_err_m"]), float(row["jan_north_err_m"])
            if max(math.hypot(east, north), math.hypot(float(row["mar_east_err_m"]), float(row["mar_north_err_m"]))) > 20:
                continue
            lat, lon = stated[row["frame"]]
            moved[row["frame"]] = (lat + north / 111000, lon + east / (111319.49 * math.cos(math.radians(lat))))
        found.append(("registered.csv", moved))
    return found


def offsets(estimates, truth):
    """Metres east and north of the truth, by frame; the estimates' covariances beside them."""
    found = []
    for row in csv.DictReader(estimates.read_text().splitlines()):
        if not row["lat_deg"] or row["frame"] not in truth:
            continue
        lat, lon = truth[row["frame"]]
        east = (float(row["lon_deg"]) - lon) * 111319.49 * math.cos(math.radians(lat))
        north = (float(row["lat_deg"]) - lat) * 110574.0 * (1 + 0.0101 * math.sin(math.radians(lat)) ** 2)
        found.append((row["frame"], east, north))
    return found


def figures(found, frames, headings):
    if not found:
        return "| – | – | – | – | – |"
    raw = sorted(math.hypot(e, n) for _, e, n in found)
    bias_e = bias_n = right = ahead = 0
    for _ in range(30):  # medians of the map's offset and of that in the aircraft's axes, in turns
        def rest(frame, e, n):
            h = headings.get(frame, 0)
            return e - bias_e - right * math.cos(h) - ahead * math.sin(h), n - bias_n + right * math.sin(h) - ahead * math.cos(h), h
        rests = [rest(*row) for row in found]
        bias_e += statistics.median(e for e, _, _ in rests)
        bias_n += statistics.median(n for _, n, _ in rests)
        if not headings:
            continue
        rests = [rest(*row) for row in found]
        right += statistics.median(e * math.cos(h) - n * math.sin(h) for e, n, h in rests)
        ahead += statistics.median(e * math.sin(h) + n * math.cos(h) for e, n, h in rests)
    free = sorted(math.hypot(*rest(*row)[:2]) for row in found)

    def rms(values):
        return math.sqrt(sum(v * v for v in values) / len(values))

    p95 = free[min(len(free) - 1, math.ceil(0.95 * len(free)) - 1)]
    return (f"| {len(found)} of {frames} | {statistics.median(raw):.2f} / {rms(raw):.2f} | {bias_e:+.2f} {bias_n:+.2f} "
            f"| {statistics.median(free):.2f} / {rms(free):.2f} | {p95:.2f} |")


def real(programs, data, name, folder, mosaics):
    nadir = programs / "nadir"
    place, options = data / name, SETS[name]
    if not (place / "telemetry.csv").exists():
        print(f"{name}: NOT RUN, {place} is missing")
        return
    work = folder / name
    work.mkdir()
    run(nadir, "keys", "create", "--out", work / "root")
    run(nadir, "keys", "create", "--out", work / "signer")
    run(nadir, "keys", "root", "--root-key", work / "root.key.pem", "--package-signer", work / "signer.pub.pem", "--expires", "2035-01-01",
        "--out", work / "root.json")
    run(nadir, "cache", "build", "--mission", place / "mission.yaml", "--imagery", place / options["map"], "--key", work / "signer.key.pem",
        "--out", work / "package")
    start = [] if options["start"] is None else [f"--start={options['start']}"]
    summary = json.loads(run(nadir, "replay", "--package", work / "package", "--trust", work / "root.json", "--at", options["at"], "--frames",
                             place / "frames", "--telemetry", place / "telemetry.csv", "--camera", place / "camera.yaml", *start, "--truth",
                             place / "truth.csv", "--adjust", "--out", work / "out", "--json", "--quiet"))
    headings = {}
    if options["of"] != "camera":
        headings = {row["frame"]: math.radians(float(row["heading_deg"])) for row in csv.DictReader((place / "telemetry.csv").read_text().splitlines())}
    for source, truth in truths(place):
        for kind, file in (("online", "estimates.csv"), ("smoothed", "refined.csv"), ("adjusted", "adjusted.csv")):
            print(f"| {name}, {source} | {kind} {figures(offsets(work / 'out' / file, truth), summary['frames'], headings)}")
    a = summary["adjustment"]
    c = a["calibration"]
    boresight = ", ".join(f"{math.degrees(b['value']):+.2f} ± {math.degrees(b['sigma']):.2f}°" for b in c["boresight_rad"])
    print(f"  {a['tie_points']} tie points, {a['observations']} observations, {a['pairs_matched']} of {a['pairs_compared']} pairs, reprojection "
          f"{a['mean_reprojection_px']:.2f} px at {a['picture_width_px']} px, anchors {a['anchors']}, switched off {len(a['anchors_switched_off'])}, "
          f"floating {a['floating_frames']}, {a['outcome']}; focal {100 * c['log_focal']['value']:+.2f} ± {100 * c['log_focal']['sigma']:.2f} %, "
          f"boresight {boresight}")
    shown = json.loads(run(programs / "bench_mosaic", work / "out/poses.json", place / "frames", place / "telemetry.csv", place / "camera.yaml",
                           options["shrink"], (mosaics or work) / name))
    made = shown.pop("surface")
    print(f"  shape of the ground from {made['pairs']} pairs, {made['measured']} parts of {made['pixel_m']:.2f} m a pixel; left: {made['along_px']:.2f} px "
          f"along, {made['across_px']:.2f} px across the direction of heights")
    for kind, m in shown.items():
        print(f"  orthophoto {kind}: {m['measured']} of {m['seams']} seams {m['median_px']:.2f} px median, {m['p95_px']:.2f} 95 %, pixels of "
              f"{m['pixel_m']:.2f} m; steps {m['median_step']:.2f} grey levels median, {m['p95_step']:.2f} 95 %")


def simulated(program, seeds):
    for seed in range(1, seeds + 1):
        result = json.loads(run(program, seed))
        for kind in ("online", "refined", "adjusted"):
            f = result[kind]
            print(f"| seed {seed} | {kind} | {f['positions']} of {result['frames']} | {f['median_m']:.2f} / {f['rms_m']:.2f} | {f['p95_m']:.2f} "
                  f"| {100 * f['within_20_m_share']:.1f} % | {f['nees']:.2f} | {f['nees_without_map_error']:.2f} |")
        a = result["adjustment"]
        print(f"  {a['tie_points']} tie points, {a['observations']} observations, reprojection {a['mean_reprojection_px']:.2f} px, anchors {a['anchors']}, "
              f"switched off {len(a['anchors_switched_off'])}, floating {a['floating_frames']}, {a['outcome']}, {result['cpu_s']:.0f} s of CPU", flush=True)
        for kind in ("adjusted", "adjusted_balanced", "adjusted_level_ground", "adjusted_own_surface"):
            m = result["seams"][kind]
            print(f"  orthophoto {kind}: {m['measured']} seams {m['median_px']:.2f} px median, {m['p95_px']:.2f} 95 %; steps {m['median_step']:.2f} "
                  f"grey levels median, {m['p95_step']:.2f} 95 %", flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--data", type=pathlib.Path, default=pathlib.Path(os.environ.get("NADIR_DATA", "../shared/data")))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", choices=[*SETS, "simulated"])
    parser.add_argument("--mosaics", type=pathlib.Path)
    wanted = parser.parse_args()
    names = [wanted.only] if wanted.only else [*SETS, "simulated"]
    if names != ["simulated"]:
        print("| photos | track | frames | error, median / rms m | median offset east, north m | without it, median / rms m | 95 % |")
        print("|---|---|---|---|---|---|---|")
        with tempfile.TemporaryDirectory() as folder:
            for name in names:
                if name in SETS:
                    real(wanted.build / "bin", wanted.data, name, pathlib.Path(folder), wanted.mosaics)
    if "simulated" in names:
        print("| simulated | track | frames | error, median / rms m | 95 % | within 20 m | NEES (2 is right) | … without the map's error |")
        print("|---|---|---|---|---|---|---|---|")
        simulated(wanted.build / "bin/bench_adjusted_flight", wanted.seeds)


if __name__ == "__main__":
    main()
