#!/usr/bin/env python3
"""What it costs to hand a package's imagery on, in each format of nadir cache export, beside the package's own verification.

usage: ./run bench export [--size-km N] [--max-zoom N]
"""
import argparse
import pathlib
import sys
import tempfile

from measured import AT, BUILD, build_command, make_keys, make_world, must

NADIR = BUILD / "nadir"
FORMATS = ("pmtiles", "gpkg", "mbtiles", "xyz", "mission-planner")


def size_of(path):
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) if path.is_dir() else path.stat().st_size


def main():
    parser = argparse.ArgumentParser(prog="./run bench export", description=__doc__.split("\n\n")[0])
    parser.add_argument("--size-km", type=float, default=3)
    parser.add_argument("--max-zoom", type=int, default=19)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        make_keys(NADIR, folder)
        world = folder / "world"
        make_world(NADIR, world, options.size_km)
        mission = world / "mission.yaml"
        mission.write_text(mission.read_text().replace("max: 18", f"max: {options.max_zoom}").replace("budget_mb: ", "budget_mb: 9"))
        package = folder / "package"
        must(build_command(NADIR, world, folder, package))
        trusted = ["--trust", folder / "root.json", "--at", AT]
        print("| | MB | CPU s | s | peak MB |\n|---|---|---|---|---|")
        taken = must([NADIR, "cache", "verify", package, *trusted, "--depth", "full"])
        print(f"| the package, verified in full | {size_of(package) / 1e6:.1f} | {taken.cpu_s:.2f} | {taken.wall_s:.1f} | {taken.peak_mb:.0f} |")
        for form in FORMATS:
            out = folder / form
            taken = must([NADIR, "cache", "export", package, *trusted, "--format", form, "--out", out])
            print(f"| {form} | {size_of(out) / 1e6:.1f} | {taken.cpu_s:.2f} | {taken.wall_s:.1f} | {taken.peak_mb:.0f} |")
        print("\n".join(line for line in taken.output.splitlines() if line.startswith("tiles")))
    return 0


if __name__ == "__main__":
    sys.exit(main())
