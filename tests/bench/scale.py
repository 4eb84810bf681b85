#!/usr/bin/env python3
"""A build shared by 1, 2, 4 and 8 shards on the cores of this machine, one thread each: wall and CPU seconds, efficiency,
the largest shard's memory, and whether the merged package has the bytes of the one that one process builds. Then the rates
that docs/scale.md reckons with; and the same for matchability map and place index, where camera.yaml lies beside the
mission.

  tests/bench/scale.py [--size-km 4] [--shards 1 2 4 8] [--threads 2] [--tries 2] [--object-storage]
  tests/bench/scale.py --mission mission.yaml --imagery map.tif [-- --dem dem.tif --captured 2024-06-01 ...]

Speed-up: wall seconds of one process with one thread, by those of the shards. Efficiency: its CPU seconds by those of all
shards together, which other load on the machine does not change. The one process also writes the package, so both are a
little too good for few shards; the merge is listed beside them, because it is the part that does not get faster.

--object-storage: the imagery as a COG in an S3 server on this machine besides (tests/support/object_store.py, with the build's
Python): requests and bytes that pin, build and shards ask it for."""
import argparse
import concurrent.futures
import dataclasses
import filecmp
import json
import math
import os
import pathlib
import shutil
import sqlite3
import sys
import tempfile
import time

from measured import AT, BUILD, make_keys, make_world, must


def same(a, b):
    files = [sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file()) for folder in (a, b)]
    return files[0] == files[1] and all(filecmp.cmp(a / f, b / f, shallow=False) for f in files[0])


def size_of(folder):
    return sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())


def square_km(package):
    """Of the tiles of the finest zoom, on the ground; and their number."""
    with sqlite3.connect(f"file:{package / 'imagery/base.mbtiles'}?mode=ro&immutable=1", uri=True) as database:
        zoom, count, row = database.execute("SELECT zoom_level, count(*), avg(tile_row) FROM tiles WHERE zoom_level = "
                                            "(SELECT max(zoom_level) FROM tiles) GROUP BY 1").fetchone()
    north = math.pi * (2 * (row + 0.5) / 2**zoom - 1)
    side_km = 40075.017 / 2**zoom * math.cos(2 * math.atan(math.exp(north)) - math.pi / 2)
    return count * side_km**2, count


class Bench:
    def __init__(self, options, work, inputs):
        self.nadir, self.work, self.inputs, self.options = options.nadir, work, inputs, options
        self.sign = ["--key", work / "signer.key.pem", "--quiet"]
        self.whole = work / "whole"

    def one_process(self, out, threads=1):
        """The least wall and CPU seconds, and the memory, of a build by one process."""
        taken = []
        for _ in range(self.options.tries):
            shutil.rmtree(out, ignore_errors=True)
            taken.append(must([self.nadir, "cache", "build", *self.inputs, *self.sign, "--threads", threads, "--out", out]))
        return min(t.wall_s for t in taken), min(t.cpu_s for t in taken), max(t.peak_mb for t in taken)

    def shards(self, count, cores):
        plan, merged = self.work / f"plan-{count}", self.work / "merged"
        planned = must([self.nadir, "cache", "plan-shards", *self.inputs, "--shards", count, "--out", plan, "--quiet"])
        best = None
        for _ in range(self.options.tries):
            for folder in plan.glob("shard-*"):
                shutil.rmtree(folder)
            begun = time.monotonic()
            with concurrent.futures.ThreadPoolExecutor(cores) as workers:
                taken = list(workers.map(lambda i: must([self.nadir, "cache", "build", "--plan", plan, "--shard",
                                                         f"{i}/{count}", "--threads", 1, "--quiet"]), range(1, count + 1)))
            wall_s = time.monotonic() - begun
            if best is None or wall_s < best[0]:
                best = wall_s, sum(t.cpu_s for t in taken), max(t.peak_mb for t in taken)
        handed_on = size_of(plan)
        shutil.rmtree(merged, ignore_errors=True)
        merge = must([self.nadir, "cache", "merge", "--plan", plan, *self.sign, "--out", merged])
        identical = same(self.whole, merged)
        shutil.rmtree(plan)
        return planned, best, merge, identical, handed_on

    def surveys(self, count, camera):
        """Matchability map and place index of the package, made alone and by shards: Markdown rows. Returns how many differ."""
        wrong = 0
        for verb, options, into in (("matchability", ["--step-m", 50], ["--into-package"]), ("index", [], [])):
            shards, alone, taken = self.work / verb, self.work / "alone", self.work / "taken"
            shards.mkdir()
            command = [self.nadir, "cache", verb, "--camera", camera, *options, "--threads", 1]
            for package in (alone, taken):
                shutil.copytree(self.whole, package)
            one = must([*command, alone, *into, *self.sign])
            parts = [must([*command, self.whole, "--shards", shards, "--quiet", "--shard", f"{i}/{count}"]) for i in
                     range(1, count + 1)]
            take = must([*command, taken, "--shards", shards, *into, *self.sign])
            identical = same(alone, taken)
            wrong += not identical
            print(f"| {verb} | {one.cpu_s:.1f}, {one.peak_mb:.0f} | {sum(p.cpu_s for p in parts):.1f} | "
                  f"{max(p.peak_mb for p in parts):.0f} | {size_of(shards) / 1e6:.1f} MB | {take.cpu_s:.1f}, {take.peak_mb:.0f} | "
                  f"{'identical' if identical else 'DIFFERENT'} |", flush=True)
            for folder in (shards, alone, taken):
                shutil.rmtree(folder)
        return wrong


def object_storage(bench, mission, imagery, more, shard_counts):
    """What is read of the imagery when it is a COG in a bucket, and whether the package is the same."""
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "support"))
    from object_store import BUCKET, ObjectStore
    nadir, work = bench.nadir, bench.work
    cog, item, pinned = work / "cog.tif", work / "item.json", work / "sources.json"
    must(["gdal_translate", "-q", "-of", "COG", "-co", "COMPRESS=JPEG", "-co", "OVERVIEWS=NONE", imagery, cog])
    shutil.copy(imagery.with_suffix(".json"), cog.with_suffix(".json"))
    size = cog.stat().st_size
    store = ObjectStore()
    os.environ.update(store.environment())
    store.put("cog.tif", cog.read_bytes())
    item.write_text(json.dumps({**json.loads(cog.with_suffix(".json").read_text()), "assets": {"data": {"href": f"s3://{BUCKET}/cog.tif"}}}))

    def counted(name, run):
        store.reset()
        taken = run()
        gateway = store.gateway
        print(f"| {name} | {gateway.requests} | {gateway.bytes / 1e6:.1f} | {gateway.bytes / size:.2f} | {taken.cpu_s:.1f} |", flush=True)
        return taken

    print(f"\nThe imagery as a COG of {size / 1e6:.1f} MB in a bucket:\n\n| | requests | MB read | of the object | CPU s |\n|---|---|---|---|---|")
    pin = counted("pin", lambda: must([nadir, "cache", "pin", item, "--quiet"]))
    pinned.write_text(pin.output)
    inputs = ["--mission", mission, *more]
    must([nadir, "cache", "build", *inputs, "--imagery", cog, *bench.sign, "--threads", 1, "--out", work / "from-file"])
    counted("cache build", lambda: must([nadir, "cache", "build", *inputs, "--imagery", pinned, *bench.sign, "--threads", 1, "--out", work / "from-object"]))
    wrong = not same(work / "from-file", work / "from-object")
    for count in shard_counts:
        plan, merged = work / "object-plan", work / "object-merged"
        must([nadir, "cache", "plan-shards", *inputs, "--imagery", pinned, "--shards", count, "--out", plan, "--quiet"])

        def all_shards(count=count, plan=plan):
            taken = [must([nadir, "cache", "build", "--plan", plan, "--shard", f"{i}/{count}", "--threads", 1, "--quiet"]) for i in range(1, count + 1)]
            return dataclasses.replace(taken[0], cpu_s=sum(t.cpu_s for t in taken))
        counted(f"{count} shards together", all_shards)
        must([nadir, "cache", "merge", "--plan", plan, *bench.sign, "--out", merged])
        wrong += not same(work / "from-file", merged)
        shutil.rmtree(plan)
        shutil.rmtree(merged)
    print(f"\npackages from the bucket: {'DIFFERENT' if wrong else 'identical to that of the file'}")
    store.stop()
    return wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nadir", type=pathlib.Path, default=BUILD / "nadir")
    parser.add_argument("--size-km", type=float, default=4, help="of the simulated world")
    parser.add_argument("--shards", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--threads", type=int, nargs="*", default=[2], help="of one process, besides")
    parser.add_argument("--no-surveys", action="store_true", help="tiles alone, no matchability map and place index")
    parser.add_argument("--tries", type=int, default=2)
    parser.add_argument("--mission", type=pathlib.Path)
    parser.add_argument("--imagery", type=pathlib.Path, nargs="+")
    parser.add_argument("--object-storage", action="store_true", help="count what is read of a bucket, too")
    parser.add_argument("more", nargs="*", help="further options of cache build")
    options = parser.parse_args()
    cores = len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory(prefix="nadir-bench.") as folder:
        work = pathlib.Path(folder)
        make_keys(options.nadir, work)
        if options.mission:
            inputs = ["--mission", options.mission, "--imagery", *options.imagery, *options.more]
        else:
            make_world(options.nadir, work / "world", options.size_km)
            inputs = ["--mission", work / "world/mission.yaml", "--imagery", work / "world/map.tif", "--dem",
                      work / "world/dem.tif", "--at", AT]
        bench = Bench(options, work, inputs)
        wall_s, cpu_s, peak_mb = bench.one_process(bench.whole)
        area, tiles = square_km(bench.whole)
        print(f"{area:.1f} km² in {tiles} tiles of the finest zoom, {cores} cores, one thread a process\n")
        print("| processes at a time | shards | wall s | speed-up | CPU s | efficiency | peak MB | merge wall s, CPU s, MB | bytes |")
        print("|---|---|---|---|---|---|---|---|---|")
        print(f"| 1 | cache build | {wall_s:.1f} | 1 | {cpu_s:.1f} | 1 | {peak_mb:.0f} | | |", flush=True)
        wrong = 0
        for threads in options.threads:
            by = work / "threads"
            taken = bench.one_process(by, threads)
            identical = same(bench.whole, by)
            wrong += not identical
            print(f"| 1 | cache build, {threads} threads | {taken[0]:.1f} | {wall_s / taken[0]:.2f} | {taken[1]:.1f} | {cpu_s / taken[1]:.2f} | "
                  f"{taken[2]:.0f} | | {'identical' if identical else 'DIFFERENT'} |", flush=True)
        for count in options.shards:
            used = min(count, cores)
            planned, best, merge, identical, handed_on = bench.shards(count, cores)
            wrong += not identical
            print(f"| {used} | {count} | {best[0]:.1f} | {wall_s / best[0]:.2f} | {best[1]:.1f} | {cpu_s / best[1]:.2f} | "
                  f"{best[2]:.0f} | "
                  f"{merge.wall_s:.1f}, {merge.cpu_s:.1f}, {merge.peak_mb:.0f} | "
                  f"{'identical' if identical else 'DIFFERENT'} |", flush=True)
        size = size_of(bench.whole)
        print(f"\nper km²: {best[1] / area:.2f} CPU s to make tiles, {merge.cpu_s / area:.3f} to merge; {size / area / 1e6:.2f} MB "
              f"of package, {handed_on / area / 1e6:.2f} MB of shards; planning {planned.cpu_s:.1f} CPU s in all")
        camera = options.mission.parent / "camera.yaml" if options.mission else work / "world/camera.yaml"
        if camera.exists() and not options.no_surveys:
            print(f"\n| {count} shards | alone: CPU s, MB | all shards: CPU s | peak MB of one | shards | taking them: CPU s, MB | bytes |")
            print("|---|---|---|---|---|---|---|")
            wrong += bench.surveys(count, camera)
        if options.object_storage:
            world = work / "world"
            mission, imagery, more = (options.mission, options.imagery[0], options.more) if options.mission else \
                (world / "mission.yaml", world / "map.tif", ["--dem", world / "dem.tif", "--at", AT])
            wrong += object_storage(bench, mission, imagery, more, options.shards)
        return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
