#!/usr/bin/env python3
"""Predicted against flown: simulated flights over worlds that the model was fitted to or not, and recorded ones.

usage: navigability.py PROGRAMS [--seeds FIRST LAST] [--flights N] [--spacing-m M] [--work DIR] [--stretches] [--fit] [--recorded NAME PREDICTION ESTIMATES TRUTH SPACING_M]...

Each seed is a world with a package; over it, flights along random routes at random heights, replayed with the localizer, and predicted by
`nadir mission predict`. A frame is compared with the predicted look that lies nearest, within half of the spacing; the protection level of its estimate
with the predicted one, which nine flights of ten should stay below: how often it does, and how many of the frames beyond a limit were predicted so. Frames that are farther off than their level says are counted.
--stretches: each world has a stretch of 400 to 800 m in its middle, and its routes lead across it: a lake, where nothing matches and nothing can be tracked, or land
that has changed since the map, where odometry tracks and nothing matches. Seeds below a million fit (--fit prints coefficients for
navigability_parameters.hpp), those from a million on judge. What a work folder holds already is not made again, so that a bench that was interrupted goes on.
"""
import argparse
import csv
import json
import math
import pathlib
import random
import subprocess
import sys

SPEED_MPS, INTERVAL_S = 22, 2  # of the simulated flights
SPACING_M = SPEED_MPS * INTERVAL_S  # of the predicted looks: one for each frame. Farther apart, a look has the worst level of several
BACK_M, AHEAD_M = 100, 500  # along the route, where the next frame's look is sought: corners are cut
CAMERA = """model: pinhole
width: 640
height: 360
fx: 501.2
fy: 500.9
cx: 321.6
cy: 178.4
distortion: [-0.085, 0.032, 0.0004, -0.0003, 0.0]
uncertainty:
  heading_deg: 2.5
  agl_relative: 0.03
  tilt_deg: 0.8
"""


def run(programs, *args, good=(0, 1)):
    result = subprocess.run([programs / "nadir", *map(str, args)], capture_output=True, text=True)
    if result.returncode not in good:
        sys.exit(f"nadir {' '.join(map(str, args))}: {result.returncode}\n{result.stderr}")
    return result.stdout


def tool(*args):
    subprocess.run([*map(str, args)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def add_stretch(world, draw):
    """A lake, on the map and on the day of the flight; or ground that the map shows turned by 180 degrees: none of it is there."""
    info = json.loads(subprocess.run(["gdalinfo", "-json", world / "map.tif"], check=True, capture_output=True).stdout)
    (west, north), (east, south) = info["cornerCoordinates"]["upperLeft"], info["cornerCoordinates"]["lowerRight"]
    middle = [(west + east) / 2 + draw.uniform(-80, 80), (south + north) / 2 + draw.uniform(-80, 80)]
    half = [draw.uniform(200, 400), draw.uniform(200, 400)]
    box = [middle[0] - half[0], middle[1] - half[1], middle[0] + half[0], middle[1] + half[1]]
    if draw.random() < 0.5:
        ring = [[middle[0] + half[0] * math.cos(k * math.pi / 24), middle[1] + half[1] * math.sin(k * math.pi / 24)] for k in range(49)]
        lake = world / "lake.csv"
        lake.write_text('id,wkt\n1,"POLYGON((' + ",".join(f"{x:.1f} {y:.1f}" for x, y in ring) + '))"\n')
        for raster, colour in (("map.tif", (44, 62, 68)), ("ground.tif", (38, 58, 70))):
            burn = [word for value in colour for word in ("-burn", value)]
            tool("gdal_rasterize", "-q", "-b", 1, "-b", 2, "-b", 3, *burn, "-l", "lake", lake, world / raster)
        return "lake"
    part, turned = world / "part.tif", world / "turned.tif"
    tool("gdal_translate", "-q", "-projwin", box[0], box[3], box[2], box[1], world / "map.tif", part)
    size = json.loads(subprocess.run(["gdalinfo", "-json", part], check=True, capture_output=True).stdout)["cornerCoordinates"]
    tool("gdal_translate", "-q", "-a_ullr", *size["lowerRight"], *size["upperLeft"], part, turned)
    tool("gdalwarp", "-q", turned, world / "map.tif")
    part.unlink(), turned.unlink()
    return "changed"


def across(low, high, draw):
    """A route from one side of the world through its middle to the other, and on along the edge."""
    side, forth = draw.choice([0, 1]), draw.choice([0, 1])
    def at(along, beside):
        share = [0, 0]
        share[side], share[1 - side] = (along if forth else 1 - along), beside
        return [round(low[i] + (high[i] - low[i]) * share[i], 7) for i in (0, 1)]
    beside = draw.uniform(0.4, 0.6)
    return [at(0.06, beside), at(0.94, draw.uniform(0.4, 0.6)), at(0.9, draw.choice([0.15, 0.85]))]


def fly(programs, work, seed, flights, stretches, spacing_m):
    """Makes a world, its package and its flights, unless they are there; yields the folders of the flights."""
    world = work / f"{'s' if stretches else 'w'}{seed}"
    if not (world / "mission.yaml").exists():
        run(programs, "simulate", "world", "--seed", seed, "--size-km", 1.5, "--gsd-m", 0.4, "--out", world)
    if stretches and not (world / "stretch").exists():
        (world / "stretch").write_text(add_stretch(world, random.Random(f"stretch {seed}")))
    head = (world / "mission.yaml").read_text().split("route:")[0].replace("min: 14", "min: 16")
    corners = json.loads(head.split("polygon: ")[1].split("\n")[0])
    low = [min(point[i] for point in corners) for i in (0, 1)]
    high = [max(point[i] for point in corners) for i in (0, 1)]
    draw = random.Random(seed)
    for number in range(flights):
        folder = world / f"f{number}"
        agl_m = draw.choice([60, 80, 110, 150, 200, 280])
        points = across(low, high, draw) if stretches else []
        while len(points) < 4 and not stretches:
            point = [round(low[i] + (high[i] - low[i]) * draw.uniform(0.2, 0.8), 7) for i in (0, 1)]
            if not points or math.hypot((point[0] - points[-1][0]) * 73300, (point[1] - points[-1][1]) * 111200) > 250:
                points.append(point)
        if not (folder / "out" / "summary.json").exists():
            folder.mkdir(exist_ok=True)
            mission = folder / "mission.yaml"
            mission.write_text(f"{head}route:\n  corridor_half_width_m: 60\n  agl_m: {agl_m}\n  points: {points}\n")
            if not (world / "package").exists():
                run(programs, "cache", "build", "--mission", mission, "--imagery", world / "map.tif", "--dem", world / "dem.tif", "--key",
                    work / "planner.key.pem", "--out", world / "package")
            run(programs, "simulate", "flight", "--world", world / "ground.tif", "--dem", world / "dem.tif", "--mission", mission, "--camera",
                work / "camera.yaml", "--out", folder / "flight", "--seed", seed * 10 + number, "--noise", "real", "--max-frames", 36, "--interval-s", INTERVAL_S)
            flight = folder / "flight"
            run(programs, "replay", "--package", world / "package", "--trust", work / "root.json", "--frames", flight / "frames", "--telemetry",
                flight / "telemetry.csv", "--camera", flight / "camera.yaml", "--truth", flight / "truth.csv",
                f"--start={points[0][0]},{points[0][1]}", "--at", "2025-09-18", "--out", folder / "out", "--json")
        prediction = folder / f"prediction-{spacing_m:g}.json"
        if not prediction.exists():
            prediction.write_text(run(programs, "mission", "predict", folder / "mission.yaml", world / "package", "--camera",
                                      work / "camera.yaml", "--spacing-m", spacing_m, "--speed-mps", SPEED_MPS, "--interval-s", INTERVAL_S, "--json", "--quiet"))
        yield prediction, folder / "out" / "estimates.csv", folder / "flight" / "truth.csv"


def distance_m(a, b):
    """Of two positions (longitude, latitude)."""
    return math.hypot((a[0] - b[0]) * math.cos(math.radians(a[1])) * 111320, (a[1] - b[1]) * 111200)


def misleading_frames(estimates, truth):
    """(frames that are farther off than their level says, frames with a level, the farthest of them in metres)"""
    where = {row["frame"]: (float(row["lon_deg"]), float(row["lat_deg"])) for row in csv.DictReader(truth.open())}
    with_level = [row for row in csv.DictReader(estimates.open()) if row["frame"] in where and row["hpl_m"]]
    beyond_m = []
    for row in with_level:
        off_m = distance_m(where[row["frame"]], (float(row["lon_deg"]), float(row["lat_deg"])))
        if off_m > float(row["hpl_m"]):
            beyond_m.append(off_m)
    return len(beyond_m), len(with_level), max(beyond_m, default=0)


def frames_of(prediction, estimates, truth, spacing_m):
    """[(look, anchored, protection level or None)] of a flight. Frames follow the route, so that one that crosses itself confuses nothing."""
    looks = json.loads(prediction.read_text())["looks"]
    where = {row["frame"]: (float(row["lon_deg"]), float(row["lat_deg"])) for row in csv.DictReader(truth.open())}
    frames = []
    reached_m = 0
    for row in csv.DictReader(estimates.open()):
        if row["frame"] not in where:
            continue

        def away(look, place=where[row["frame"]]):
            return distance_m(place, (look["lon_deg"], look["lat_deg"]))
        look = min((look for look in looks if reached_m - BACK_M <= look["at_m"] <= reached_m + AHEAD_M), key=away)
        if away(look) <= spacing_m / 2 + 5:
            reached_m = look["at_m"]
            frames.append((look, row["source"] == "satellite_anchored", float(row["hpl_m"]) if row["hpl_m"] else None))
    return frames


def ranks(values):
    order = sorted(range(len(values)), key=values.__getitem__)
    result, i = [0.0] * len(values), 0
    while i < len(order):
        k = i
        while k + 1 < len(order) and values[order[k + 1]] == values[order[i]]:
            k += 1
        for m in order[i:k + 1]:
            result[m] = (i + k) / 2
        i = k + 1
    return result


def spearman(a, b):
    a, b = ranks(a), ranks(b)
    mean_a, mean_b = sum(a) / len(a), sum(b) / len(b)
    cross = sum((x - mean_a) * (y - mean_b) for x, y in zip(a, b))
    spread = math.sqrt(sum((x - mean_a) ** 2 for x in a) * sum((y - mean_b) ** 2 for y in b))
    return cross / spread if spread > 0 else float("nan")


def solve(matrix, vector):
    n = len(vector)
    rows = [row[:] + [value] for row, value in zip(matrix, vector)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda k: abs(rows[k][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        for k in range(i + 1, n):
            share = rows[k][i] / rows[i][i]
            rows[k] = [x - share * y for x, y in zip(rows[k], rows[i])]
    result = [0.0] * n
    for i in reversed(range(n)):
        result[i] = (rows[i][n] - sum(rows[i][k] * result[k] for k in range(i + 1, n))) / rows[i][i]
    return result


def fit(flights):
    """Logistic regression by Newton's method, with a weak prior on the slopes."""
    data = [([1.0, look["ratio"], math.log(look["footprint_m"] / look["map_gsd_m"])], anchored)
            for flight in flights for look, anchored, _ in flight if look["valid"] >= 0.6]
    weights, prior = [0.0] * 3, 0.5
    for _ in range(50):
        gradient = [0.0] + [-prior * weight for weight in weights[1:]]
        hessian = [[(prior if i == k and i > 0 else 1e-9 if i == k else 0.0) for k in range(3)] for i in range(3)]
        for x, y in data:
            p = 1 / (1 + math.exp(-sum(w * f for w, f in zip(weights, x))))
            for i in range(3):
                gradient[i] += x[i] * (y - p)
                for k in range(3):
                    hessian[i][k] += x[i] * x[k] * p * (1 - p)
        weights = [w + step for w, step in zip(weights, solve(hessian, gradient))]
    return weights


def judge(name, flights, by="anchored_share"):
    frames = [frame for flight in flights for frame in flight]
    if not frames:
        print(f"{name}: nothing to compare")
        return
    predicted, anchored = [look[by] for look, _, _ in frames], [float(hit) for _, hit, _ in frames]
    per_flight = [(sum(look[by] for look, _, _ in flight) / len(flight), sum(hit for _, hit, _ in flight) / len(flight))
                  for flight in flights if flight]
    print(f"{name}: {len(per_flight)} flights, {len(frames)} frames, {100 * sum(anchored) / len(anchored):.1f} % anchored")
    print(f"  Spearman of frames {spearman(predicted, anchored):.2f}" +
          (f", of flights {spearman([p for p, _ in per_flight], [a for _, a in per_flight]):.2f}" if len(per_flight) > 2 else ""))
    for verdict, low, high in (("good", 0.95, 1.01), ("fair", 0.5, 0.95), ("poor", -1, 0.5)):
        part = [hit for p, hit in zip(predicted, anchored) if low <= p < high]
        print(f"  called {verdict}: {len(part)} frames" + (f", {100 * sum(part) / len(part):.1f} % anchored" if part else ""))
    # Over good ground an aircraft that is lost does not anchor either.
    knowing = [frame for flight in flights for before, frame in zip(flight, flight[1:]) if before[2] is not None and before[2] <= 100]
    for verdict, low, high in (("good", 0.95, 1.01), ("poor", -1, 0.5)):
        part = [hit for look, hit, _ in knowing if low <= look[by] < high]
        if part:
            print(f"  called {verdict}, the frame before within 100 m: {len(part)} frames, {100 * sum(part) / len(part):.1f} % anchored")
    print("  reliability: predicted, anchored, frames")
    for low in (0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95):
        high = {0.8: 0.9, 0.9: 0.95, 0.95: 1.01}.get(low, low + 0.2)
        part = [(p, hit) for p, hit in zip(predicted, anchored) if low <= p < high]
        if part:
            print(f"    {sum(p for p, _ in part) / len(part):.3f}  {sum(hit for _, hit in part) / len(part):.3f}  {len(part)}")


def judge_levels(flights):
    """Flown protection levels against predicted ones. No level, in flight or predicted, is an infinite one."""
    def known(level):
        return math.inf if level is None else level
    levels = [(known(look["hpl_m"]), known(level), look["beyond_share"]) for flight in flights for look, _, level in flight]
    if not levels:
        return
    predicted, flown = [p for p, _, _ in levels], [f for _, f, _ in levels]
    within = [p >= f for p, f in zip(predicted, flown)]
    print(f"  protection level: {len(levels)} frames, {flown.count(math.inf)} without one; {100 * sum(within) / len(within):.1f} % within the predicted level; "
          f"Spearman {spearman(predicted, flown):.2f}")
    shares = sorted(sum(known(look["hpl_m"]) >= known(level) for look, _, level in flight) / len(flight) for flight in flights if flight)
    if len(shares) > 2:
        print(f"    of a flight's frames: median {100 * shares[len(shares) // 2]:.0f} %, worst tenth {100 * shares[len(shares) // 10]:.0f} %")
    print("    predicted, flown: median, 90 %, within, frames")
    for low, high in ((0, 20), (20, 35), (35, 60), (60, 100), (100, math.inf), (math.inf, None)):
        part = [(p, f) for p, f in zip(predicted, flown) if low <= p and (high is None or p < high)]
        if part:
            sorted_flown = sorted(f for _, f in part)
            print(f"    {sum(p for p, _ in part) / len(part):6.0f} m  {sorted_flown[len(part) // 2]:6.0f} m  {sorted_flown[min(len(part) - 1, len(part) * 9 // 10)]:6.0f} m"
                  f"  {100 * sum(p >= f for p, f in part) / len(part):5.1f} %  {len(part)}")
    def begun(flight):
        """From the first frame on whose level was within 100 m: what is lost then is lost in flight, not at the start."""
        first = next((i for i, (_, _, level) in enumerate(flight) if known(level) <= 100), len(flight))
        return flight[first:]
    for name, part_of in (("all frames", lambda flight: flight), ("after a flight's first four", lambda flight: flight[4:]), ("after the start was confirmed", begun)):
        part = [(known(look["hpl_m"]), known(level)) for flight in flights for look, _, level in part_of(flight)]
        for limit in (50, 100):
            beyond, warned = [p for p, f in part if f > limit], [f for p, f in part if p > limit]
            print(f"    {name}: beyond {limit} m in flight {len(beyond)}, of them predicted {sum(p > limit for p in beyond)}; "
                  f"predicted beyond {len(warned)}; of {len(part)}")
    lost = [[known(look["hpl_m"]) > 100 for look, _, level in begun(flight) if known(level) > 100] for flight in flights]
    print(f"    flights that were lost after their start was confirmed: {sum(map(bool, lost))} of {len(flights)}, of them foreseen in some frame: {sum(map(any, lost))}")
    print("    share of flights predicted beyond the alert limit, flown beyond 100 m, frames")
    for low, high in ((0, 0.02), (0.02, 0.1), (0.1, 0.3), (0.3, 0.7), (0.7, 1.01)):
        part = [(share, f > 100) for _, f, share in levels if low <= share < high]
        if part:
            print(f"    {sum(s for s, _ in part) / len(part):.3f}  {sum(hit for _, hit in part) / len(part):.3f}  {len(part)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", type=pathlib.Path)
    parser.add_argument("--seeds", type=int, nargs=2, default=[1_000_001, 1_000_003])
    parser.add_argument("--flights", type=int, default=4, help="over each world")
    parser.add_argument("--spacing-m", type=float, default=SPACING_M, help="of the predicted looks; default: that of the frames")
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("bench-navigability"))
    parser.add_argument("--stretches", action="store_true")
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--recorded", nargs=5, action="append", default=[], metavar=("NAME", "PREDICTION", "ESTIMATES", "TRUTH", "SPACING"))
    args = parser.parse_args()
    args.programs = args.programs.resolve()
    args.work.mkdir(parents=True, exist_ok=True)
    (args.work / "camera.yaml").write_text(CAMERA)
    if not (args.work / "root.json").exists():
        run(args.programs, "keys", "create", "--out", args.work / "root")
        run(args.programs, "keys", "create", "--out", args.work / "planner")
        run(args.programs, "keys", "root", "--root-key", args.work / "root.key.pem", "--package-signer", args.work / "planner.pub.pem",
            "--expires", "2099-01-01", "--out", args.work / "root.json")
    flights, kinds, misled = [], [], {}
    if args.seeds[1] >= args.seeds[0]:
        for seed in range(args.seeds[0], args.seeds[1] + 1):
            files = list(fly(args.programs, args.work, seed, args.flights, args.stretches, args.spacing_m))
            flights += [frames_of(*one, args.spacing_m) for one in files]
            stretch = args.work / f"s{seed}" / "stretch"
            kind = stretch.read_text() if args.stretches else ""
            kinds += [kind] * len(files)
            misled.setdefault(kind, []).extend(misleading_frames(*one[1:]) for one in files)
            print(f"seed {seed}: {len(flights)} flights", file=sys.stderr)
    if args.fit:
        if args.seeds[1] >= 1_000_000:
            sys.exit("seeds from a million on judge: fit on others")
        print("kLookOffset, kLookPerRatio, kLookPerLogFootprint:", *(f"{weight:.3f}" for weight in fit(flights)))
        judge("simulated, the map alone", flights, by="probability")
    for kind, counts in sorted(misled.items()):
        print(f"{kind or 'worlds as they are'}: {sum(c[0] for c in counts)} of {sum(c[1] for c in counts)} frames with a level were farther off than it says, "
              f"in {sum(c[0] > 0 for c in counts)} of {len(counts)} flights; the farthest {max((c[2] for c in counts), default=0):.0f} m")
    judge("simulated", flights)
    judge_levels(flights)
    for kind in sorted(set(kinds)):
        part = [flight for flight, of in zip(flights, kinds) if of == kind]
        if kind:
            judge(f"simulated, {kind}", part)
            judge_levels(part)
    for name, prediction, estimates, truth, spacing in args.recorded:
        flown = [frames_of(pathlib.Path(prediction), pathlib.Path(estimates), pathlib.Path(truth), float(spacing))]
        judge(name, flown)
        judge_levels(flown)


if __name__ == "__main__":
    main()
