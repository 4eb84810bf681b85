#!/usr/bin/env python3
"""What a rolling shutter costs, and what undoing it gains: simulated flights photographed by a global and by a rolling
shutter, localized by `nadir replay`.

usage: ./run bench shutter [--seeds N] [--readout-ms MS] [--speed-mps V] [--frames N] [--keep DIR]

The rows: frames of a global shutter; of a rolling one whose row time the camera file states; of the same one whose camera
file states nothing. Positions, telemetry and noise are the same in all three. Beside them the same odometry without a map:
how far off the last position is.
"""
import argparse
import json
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

NADIR = pathlib.Path("build/bin/nadir")


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def start_of(flight):
    header, first = (line.split(",") for line in (flight / "truth.csv").read_text().splitlines()[:2])
    row = dict(zip(header, first))
    return f"{row['lon_deg']},{row['lat_deg']}"


def replay(flight, camera, out, *package):
    run(NADIR, "replay", *package, "--frames", flight / "frames", "--telemetry", flight / "telemetry.csv", "--camera", camera,
        f"--start={start_of(flight)}", "--truth", flight / "truth.csv", "--out", out)
    return json.loads((out / "summary.json").read_text())


def main():
    parser = argparse.ArgumentParser(usage="./run bench shutter [--seeds N] [--readout-ms MS] [--speed-mps V] [--frames N] [--keep DIR]")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--readout-ms", type=float, default=28)
    parser.add_argument("--speed-mps", type=float, default=25)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--keep", type=pathlib.Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="nadir-shutter.") as name:
        measure(args, args.keep or pathlib.Path(name))


def measure(args, folder):
    folder.mkdir(parents=True, exist_ok=True)
    world = folder / "world"
    run(NADIR, "simulate", "world", "--seed", 7, "--size-km", 2, "--gsd-m", 0.4, "--out", world)
    for key in ("root", "signer"):
        run(NADIR, "keys", "create", "--out", folder / key)
    run(NADIR, "keys", "root", "--root-key", folder / "root.key.pem", "--package-signer", folder / "signer.pub.pem",
        "--expires", "2035-01-01", "--out", folder / "root.json")
    created = re.search(r"(?m)^created: *\"?([^\"\n]+)", (world / "mission.yaml").read_text())[1]
    run(NADIR, "cache", "build", "--mission", world / "mission.yaml", "--imagery", world / "map.tif", "--dem", world / "dem.tif",
        "--key", folder / "signer.key.pem", "--trust", folder / "root.json", "--at", created, "--out", folder / "package")
    plain = world / "camera.yaml"
    height = int(re.search(r"(?m)^height: *(\d+)", plain.read_text())[1])
    rolling = folder / "rolling.yaml"
    rolling.write_text(plain.read_text() + f"rolling_shutter: {{row_time_s: {args.readout_ms / 1000 / height:.9f}}}\n")
    package = ("--package", folder / "package", "--trust", folder / "root.json", "--at", created)
    found = {}
    for seed in range(1, args.seeds + 1):
        flights = {}
        for shutter, camera in (("global", plain), ("rolling", rolling)):
            flights[shutter] = folder / f"{shutter}-{seed}"
            run(NADIR, "simulate", "flight", "--world", world / "ground.tif", "--dem", world / "dem.tif", "--mission",
                world / "mission.yaml", "--camera", camera, "--seed", seed, "--speed-mps", args.speed_mps, "--interval-s", 0.5,
                "--max-frames", args.frames, "--out", flights[shutter])
        for row, shutter, camera in (("global shutter", "global", plain), ("rolling, undone", "rolling", rolling),
                                     ("rolling, ignored", "rolling", plain)):
            out = f"{row.replace(', ', '-').replace(' ', '-')}-{seed}"
            found.setdefault(row, []).append((replay(flights[shutter], camera, folder / f"{out}-map", *package),
                                              replay(flights[shutter], camera, folder / f"{out}-blind")))
    print(f"{args.seeds} flights of {args.frames} frames at {args.speed_mps:g} m/s, {args.readout_ms:g} ms for {height} rows\n")
    print("| frames | median | 95 % | largest | inside 95 % ellipse | wrong anchors | odometry alone, largest |")
    print("|---|---|---|---|---|---|---|")
    for row, results in found.items():
        mean = lambda key: statistics.mean(one[key] for one, _ in results)
        print(f"| {row} | {mean('median_m'):.2f} m | {mean('p95_m'):.2f} m | {max(one['max_m'] for one, _ in results):.2f} m | "
              f"{100 * mean('inside_95_share'):.0f} % | {sum(one['wrong_anchors'] for one, _ in results)} | "
              f"{statistics.mean(blind['max_m'] for _, blind in results):.1f} m |")


if __name__ == "__main__":
    main()
