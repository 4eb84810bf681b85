#!/usr/bin/env python3
"""Tile sets from one raster, side by side: nadir cache build (MBTiles and COG, one and two threads), gdal_translate +
gdaladdo, gdal2tiles.py, rio-mbtiles and rio-cogeo. CPU seconds, wall, peak memory, bytes and PSNR against the raster
that gdalwarp makes on the same grid. Then memory for one and for four times the area.

  tests/bench/package.py [--size-km 2] [--tries 3] [--skip-slow]
  tests/bench/package.py --imagery map.tif --mission mission.yaml     (map.json beside the map)

What is not installed says NOT RUN. NADIR_BENCH_VENV=DIR: a virtual environment with rio-mbtiles and rio-cogeo."""
import argparse
import json
import math
import os
import pathlib
import re
import shutil
import tempfile

from measured import BUILD, best, build_command, make_keys, make_world, must, run, tiles_in, tool, wall_pairs

QUALITY = 75
HALF_WORLD_M = 20037508.342789244


class Bench:
    def __init__(self, options, work):
        self.options, self.work, self.nadir = options, work, options.nadir
        self.rows = []
        make_keys(self.nadir, work)
        if options.imagery:
            self.map, self.mission = options.imagery.resolve(), options.mission.resolve()
        else:
            make_world(self.nadir, work / "world", options.size_km)
            self.map, self.mission = work / "world/map.tif", work / "world/mission.yaml"
        zooms = re.search(r"^zoom: *\{min: *(\d+), *max: *(\d+)\}", self.mission.read_text(), re.M)
        self.coarsest, self.finest = int(zooms[1]), int(zooms[2])
        self.reference = self.warp()

    def warp(self):
        """Aligned with the pixels of the finest zoom, lossless, alpha outside the raster."""
        pixel_m = 2 * HALF_WORLD_M / (256 << self.finest)
        out = self.work / "reference.tif"
        must(["gdalwarp", "-q", "-t_srs", "EPSG:3857", "-tr", repr(pixel_m), repr(pixel_m), "-tap", "-r", "bilinear",
              "-dstalpha", "-co", "COMPRESS=LZW", "-co", "TILED=YES", "-co", "BIGTIFF=IF_SAFER", self.map, out])
        return out

    def psnr(self, tiles):
        taken = run([BUILD / "bench_psnr", self.reference, tiles])
        return f"{float(taken.output.split()[0]):.2f}" if taken.ok else taken.output.strip()[-60:]

    def row(self, name, taken, tiles, size, psnr):
        self.rows.append((name, taken, tiles, size))
        print(f"{name:<34} {tiles:>7} {taken.cpu_s:>8.1f} {taken.wall_s:>8.1f} {taken.peak_mb:>8.0f} "
              f"{size / tiles:>8.0f} {tiles / taken.cpu_s:>9.1f} {psnr:>8}", flush=True)

    def command(self, container, threads, out):
        command = [self.nadir, "cache", "build", "--mission", self.mission, "--imagery", self.map, "--quality", QUALITY,
                   "--key", self.work / "signer.key.pem", "--format", container, "--threads", threads, "--out", out,
                   "--quiet"]
        return command + (["--dem", dem] if (dem := self.map.parent / "dem.tif").exists() else [])

    def two_threads(self):
        """Against one worker: the same program with one thread on one core, which then does the main thread's work too.
        Pairs, one after the other, so that other load meets both."""
        out = self.work / "pair"
        for container in ("mbtiles", "cog"):
            one, two = wall_pairs(self.options.tries, lambda: shutil.rmtree(out, ignore_errors=True),
                                  ["taskset", "--cpu-list", "0", *self.command(container, 1, out)],
                                  self.command(container, 2, out))
            shutil.rmtree(out)
            print(f"two threads, {container}: {one.wall_s / two.wall_s:.2f} times as fast as one worker on one core "
                  f"({one.wall_s:.2f} s, {two.wall_s:.2f} s; load {os.getloadavg()[0]:.1f}); CPU seconds {one.cpu_s:.2f} and "
                  f"{two.cpu_s:.2f}, so at most {2 * one.cpu_s / two.cpu_s:.2f} times")

    def build(self, container, threads):
        out = self.work / f"package-{container}"
        command = self.command(container, threads, out)
        taken = best(self.options.tries, lambda: shutil.rmtree(out, ignore_errors=True), command)
        return taken, out / "imagery" / ("base.tif" if container == "cog" else "base.mbtiles")

    def ours(self):
        for container in ("mbtiles", "cog"):
            for threads in (1, 2):
                taken, file = self.build(container, threads)
                if container == "mbtiles":
                    self.tiles, self.bytes = tiles_in(file)
                self.row(f"nadir, {container}, {threads} thread{'s' * (threads - 1)}", taken, self.tiles, self.bytes,
                         self.psnr(file))
        files = {c: sum(f.stat().st_size for f in (self.work / f"package-{c}/imagery").iterdir()) for c in ("mbtiles", "cog")}
        print(f"imagery: MBTiles {files['mbtiles'] / 1e6:.2f} MB, COG with sidecars {files['cog'] / 1e6:.2f} MB: "
              f"{100 * (files['mbtiles'] / files['cog'] - 1):+.1f} %")

    def strategy(self):
        """Of the two zooms around the raster's resolution, the one with which GDAL's finest tiles are the mission's."""
        warped = self.work / "warped.vrt"
        must(["gdalwarp", "-q", "-of", "VRT", "-t_srs", "EPSG:3857", self.map, warped])
        pixel_m = json.loads(must(["gdalinfo", "-json", warped]).output)["geoTransform"][1]
        return "UPPER" if self.finest > math.log2(2 * HALF_WORLD_M / (256 * pixel_m)) else "LOWER"

    def gdal(self):
        out = self.work / "gdal.mbtiles"
        levels = " ".join(str(2 << i) for i in range(self.finest - self.coarsest))
        taken = best(self.options.tries, lambda: out.unlink(missing_ok=True), [
            "bash", "-c", f"gdal_translate -q -of MBTILES -co TILE_FORMAT=JPEG -co QUALITY={QUALITY} "
            f"-co ZOOM_LEVEL_STRATEGY={self.strategy()} '{self.map}' '{out}' && gdaladdo -q -r average '{out}' {levels}"])
        self.row("gdal_translate + gdaladdo", taken, *tiles_in(out), self.psnr(out))

    def gdal2tiles(self):
        if not tool("gdal2tiles.py"):
            return print("gdal2tiles.py: NOT RUN: not installed (python3-gdal)")
        out = self.work / "gdal2tiles"
        taken = run([tool("gdal2tiles.py"), "-q", "--xyz", "-r", "bilinear", "-w", "none", "--processes=2", "-z",
                     f"{self.coarsest}-{self.finest}", self.map, out])
        if not taken.ok:
            return print(f"gdal2tiles.py: NOT RUN: {taken.output.strip()[-200:]}")
        files = list(out.rglob("*.png"))
        self.row("gdal2tiles.py, PNG, 2 processes", taken, len(files), sum(f.stat().st_size for f in files),
                 self.psnr(out))

    def rio_mbtiles(self):
        out = self.work / "rio.mbtiles"
        taken = self.rio("rio-mbtiles", ["mbtiles", self.map, out, "-f", "JPEG", "--co", f"QUALITY={QUALITY}",
                                         "--resampling", "bilinear", "--zoom-levels",
                                         f"{self.coarsest}..{self.finest}", "-j", "2"], "mbtiles")
        if taken:
            self.row("rio-mbtiles, 2 workers", taken, *tiles_in(out), self.psnr(out))

    def rio_cogeo(self):
        out = self.work / "rio.tif"
        taken = self.rio("rio-cogeo", ["cogeo", "create", self.map, out, "--web-optimized", "-p", "jpeg", "--blocksize",
                                       "256", "--add-mask", "-r", "bilinear", "--overview-resampling", "average",
                                       "--overview-level", str(self.finest - self.coarsest), "--zoom-level",
                                       str(self.finest), "--co", f"QUALITY={QUALITY}", "-q"], "cogeo")
        if taken:  # blocks are its tiles; the file size includes masks and tables
            count = int(must([self.nadir, "cache", "inspect", out, "--get", "tiles"]).output or 0)
            self.row("rio-cogeo", taken, max(count, 1), out.stat().st_size, self.psnr(out))

    def rio(self, name, arguments, verb):
        program = tool("rio")
        if not program or not run([program, verb, "--help"]).ok:
            return print(f"{name}: NOT RUN: not installed")
        taken = run([program, *arguments])
        return taken if taken.ok else print(f"{name}: NOT RUN: {taken.output.strip()[-200:]}")

    def memory(self):
        """The same ground sample distance over one and over four times the area."""
        for size_km in (self.options.size_km / 2, self.options.size_km):
            world = self.work / f"world-{size_km}"
            make_world(self.nadir, world, size_km)
            for container in ("mbtiles", "cog"):
                out = self.work / "memory"
                taken = must(build_command(self.nadir, world, self.work, out, "--format", container, "--threads", 2))
                shutil.rmtree(out)
                print(f"{size_km:g} km x {size_km:g} km, {container}: peak {taken.peak_mb:.0f} MB")

    def ratios(self):
        by_name = {name: (taken, tiles, size) for name, taken, tiles, size in self.rows}
        ours, tiles, size = by_name["nadir, mbtiles, 1 thread"]
        print()
        for name, (taken, count, their_size) in by_name.items():
            if not name.startswith("nadir"):
                print(f"tiles per CPU second, against {name}: {tiles / ours.cpu_s / (count / taken.cpu_s):.1f} times; "
                      f"bytes a tile: {size / tiles / (their_size / count):.3f} times")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nadir", type=pathlib.Path, default=BUILD / "nadir")
    parser.add_argument("--size-km", type=float, default=2)
    parser.add_argument("--tries", type=int, default=3)
    parser.add_argument("--imagery", type=pathlib.Path)
    parser.add_argument("--mission", type=pathlib.Path)
    parser.add_argument("--skip-slow", action="store_true", help="without gdal2tiles.py and rio")
    options = parser.parse_args()
    os.environ.pop("GDAL_NUM_THREADS", None)
    with tempfile.TemporaryDirectory(prefix="nadir-bench.") as folder:
        bench = Bench(options, pathlib.Path(folder))
        print(f"{'':<34} {'tiles':>7} {'CPU s':>8} {'wall s':>8} {'peak MB':>8} {'B/tile':>8} {'tiles/CPU':>9} "
              f"{'PSNR dB':>8}")
        bench.ours()
        bench.gdal()
        if not options.skip_slow:
            bench.gdal2tiles()
            bench.rio_mbtiles()
            bench.rio_cogeo()
        bench.ratios()
        bench.two_threads()
        if not options.imagery:
            bench.memory()


if __name__ == "__main__":
    main()
