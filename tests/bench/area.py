#!/usr/bin/env python3
"""Twenty square kilometres at zoom 19, with overviews and terrain: built on one and on two threads, verified at both
depths, indexed, verified again, and read tile by tile as the aircraft does, beside GDAL. For MBTiles and for COG.

  tests/bench/area.py [--size-km 5.5] [--tries 2]
  tests/bench/area.py --world DIR     a folder that `nadir simulate world` made"""
import argparse
import json
import pathlib
import shutil
import tempfile

from measured import AT, BUILD, best, build_command, make_keys, make_world, must


class Area:
    def __init__(self, options, work):
        self.options, self.work, self.nadir = options, work, options.nadir
        make_keys(self.nadir, work)
        self.world = options.world or work / "world"
        if not options.world:
            make_world(self.nadir, self.world, options.size_km)

    def row(self, what, taken, more=""):
        print(f"{what:<32} {taken.cpu_s:>8.2f} {taken.wall_s:>8.2f} {taken.peak_mb:>8.0f}   {more}", flush=True)

    def build(self, container, threads):
        out = self.work / container
        taken = best(self.options.tries, lambda: shutil.rmtree(out, ignore_errors=True), build_command(
            self.nadir, self.world, self.work, out, "--format", container, "--threads", threads))
        self.row(f"build, {threads} thread{'s' * (threads - 1)}", taken)
        return out, taken

    def verify(self, package, depth, more=""):
        command = [self.nadir, "cache", "verify", package, "--trust", self.work / "root.json", "--depth", depth, "--at",
                   AT, "--quiet"]
        taken = best(self.options.tries, lambda: None, command)
        size = sum(f.stat().st_size for f in package.rglob("*") if f.is_file())
        self.row(f"verify, {depth}{more}", taken, f"{size / 1e6:.0f} MB, {size / 1e9 / taken.wall_s:.2f} GB/s")

    def container(self, container):
        print(f"\n{container:<32} {'CPU s':>8} {'wall s':>8} {'peak MB':>8}")
        _, one = self.build(container, 1)
        package, two = self.build(container, 2)
        print(f"{'':<32} two threads are {one.wall_s / two.wall_s:.2f} times as fast as one")
        self.verify(package, "quick")
        self.verify(package, "full")
        indexed = must([self.nadir, "cache", "index", package, "--camera", self.world / "camera.yaml", "--key",
                        self.work / "signer.key.pem", "--threads", 2, "--quiet"])
        self.row("index, 2 threads", indexed)
        self.verify(package, "full", ", with index")
        print(must([BUILD / "bench_read_tiles", package, self.work / "root.json", 2000, AT]).output, end="", flush=True)
        shutil.rmtree(package)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nadir", type=pathlib.Path, default=BUILD / "nadir")
    parser.add_argument("--size-km", type=float, default=5.5, help="side of the land; the mission needs less")
    parser.add_argument("--world", type=pathlib.Path)
    parser.add_argument("--tries", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="nadir-bench.") as folder:
        area = Area(options, pathlib.Path(folder))
        plan = json.loads(must([area.nadir, "mission", "plan", area.world / "mission.yaml", "--json"]).output)
        print(f"{plan['needed_km2']:.1f} km² of ground, {plan['tiles']} tiles")
        for container in ("mbtiles", "cog"):
            area.container(container)


if __name__ == "__main__":
    main()
