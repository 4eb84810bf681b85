#!/usr/bin/env python3
"""Bytes on the wire for a map in which a part has changed: a patch of Nadir, and what others would send.

usage: ./run bench patch [--size-km N] [--share PERCENT] [--format mbtiles|cog] [--new-format mbtiles|cog]
"""
import argparse
import math
import pathlib
import sys
import tempfile

from measured import BUILD, must, tool

NADIR = BUILD / "nadir"


def size_of(path):
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) if path.is_dir() else path.stat().st_size


def make_packages(folder, size_km, share, container, new_container):
    world = folder / "world"
    must([NADIR, "simulate", "world", "--seed", "9", "--size-km", size_km, "--gsd-m", "0.5", "--out", world])
    for name in ("root", "planner"):
        must([NADIR, "keys", "create", "--out", folder / name])
    must([NADIR, "keys", "root", "--root-key", folder / "root.key.pem", "--package-signer", folder / "planner.pub.pem",
          "--expires", "2035-01-01", "--out", folder / "root.json"])
    mission = (world / "mission.yaml").read_text().replace("max: 18", "max: 19")
    for sequence in (1, 2):
        (folder / f"{sequence}.yaml").write_text(mission.replace("sequence: 1", f"sequence: {sequence}"))
    usual = ["--key", folder / "planner.key.pem", "--at", "2025-09-18"]
    must([NADIR, "cache", "build", "--mission", folder / "1.yaml", "--imagery", world / "map.tif", "--dem", world / "dem.tif", "--format",
          container, *usual, "--out", folder / "old"])
    pixels = round(1000 * size_km / 0.5)
    side = round(pixels * math.sqrt(share / 100))
    must(["gdal_translate", "-q", "-srcwin", pixels // 3, pixels // 3, side, side, "-scale", 0, 255, 20, 250, world / "map.tif",
          folder / "newer.tif"])
    must([NADIR, "cache", "update", folder / "old", "--trust", folder / "root.json", "--mission", folder / "2.yaml", "--imagery",
          folder / "newer.tif", "--format", new_container, "--captured", "2025-09-10", "--gsd-m", "0.5", "--ce90-m", "3", "--provider", "bench", *usual, "--out",
          folder / "new"])


def row(name, size, whole, note=""):
    print(f"| {name} | {size / 1e6:.3f} | {100 * size / whole:.1f} % | {note} |")


def main():
    parser = argparse.ArgumentParser(prog="./run bench patch", description=__doc__.split("\n\n")[0])
    parser.add_argument("--size-km", type=float, default=3)
    parser.add_argument("--share", type=float, default=2, help="of the area that is new, in percent")
    parser.add_argument("--format", choices=("mbtiles", "cog"), default="mbtiles")
    parser.add_argument("--new-format", choices=("mbtiles", "cog"), help="another one for the new package: the patch then is all of it")
    options = parser.parse_args()
    new_format = options.new_format or options.format
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        make_packages(folder, options.size_km, options.share, options.format, new_format)
        old, new, patch = folder / "old", folder / "new", folder / "patch"
        made = must([NADIR, "cache", "diff", old, new, "--patch", patch, "--key", folder / "planner.key.pem"])
        applied = must([NADIR, "cache", "apply", old, patch, "--trust", folder / "root.json", "--at", "2025-09-18", "--out", folder / "made"])
        must(["diff", "-r", new, folder / "made"])
        whole = size_of(new)
        print(made.output.splitlines()[0])
        print("| sent | MB | of the package | |\n|---|---|---|---|")
        row("the package", whole, whole)
        row("a patch", size_of(patch), whole, f"made in {made.cpu_s:.2f} s of CPU and {made.peak_mb:.0f} MB, applied in "
            f"{applied.cpu_s:.2f} s and {applied.peak_mb:.0f} MB; the result is the same, byte for byte")
        imagery = "imagery/base.mbtiles" if options.format == "mbtiles" else "imagery/base.tif"
        if new_format != options.format:
            return 0  # others compare one file with another
        if tool("rsync"):
            copy = folder / "copy"
            must(["cp", "-a", old, copy])
            sent = must(["rsync", "-a", "--no-whole-file", "--checksum", "--compress", "--stats", f"{new}/", f"{copy}/"]).output
            total = next(line for line in sent.splitlines() if line.startswith("Total bytes sent"))
            back = next(line for line in sent.splitlines() if line.startswith("Total bytes received"))
            size = sum(int("".join(filter(str.isdigit, line))) for line in (total, back))
            row("rsync --compress", size, whole, "both ways; needs a connection to the receiver, and is not signed")
        else:
            print("NOT RUN: rsync is missing")
        if tool("xdelta3"):
            must(["xdelta3", "-e", "-f", "-9", "-s", old / imagery, new / imagery, folder / "x"])
            row("xdelta3 -9", size_of(folder / "x"), whole, "the tiles alone")
        else:
            print("NOT RUN: xdelta3 is missing")
        must(["zstd", "-q", "-f", "-19", "--long=27", f"--patch-from={old / imagery}", new / imagery, "-o", folder / "z"])
        row("zstd -19 --patch-from", size_of(folder / "z"), whole, "the tiles alone; both files in memory, below 2 GB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
