#!/usr/bin/env python3
"""A set of 100 000 tiles and 10 GB, valid in every respect except its images: quick and full verification (beside the digest
alone, by openssl), coverage and freshness, entry into a catalogue and the gaps that it finds.

  tests/bench/large.py [--side-km 14] [--tile-bytes 100000] [--tries 2] [--threads 1 2] [--only verify]"""
import argparse
import pathlib
import re
import tempfile

from measured import AT, BUILD, best, make_keys, must, run, tool


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nadir", type=pathlib.Path, default=BUILD / "nadir")
    parser.add_argument("--side-km", type=float, default=14)
    parser.add_argument("--tile-bytes", type=int, default=100_000)
    parser.add_argument("--tries", type=int, default=2)
    parser.add_argument("--threads", type=int, nargs="+", default=[1], help="of full verification")
    parser.add_argument("--only", choices=["verify"])
    options = parser.parse_args()

    def row(what, taken, more=""):
        print(f"{what:<32} {taken.cpu_s:>8.2f} {taken.wall_s:>8.2f} {taken.peak_mb:>8.0f}   {more}", flush=True)

    with tempfile.TemporaryDirectory(prefix="nadir-bench.") as folder:
        work = pathlib.Path(folder)
        make_keys(options.nadir, work)
        package, catalogue = work / "package", work / "fleet.sqlite"
        print(must([BUILD / "bench_make_large_package", package, work / "signer.key.pem", options.side_km,
                    options.tile_bytes]).output, end="")
        size = sum(f.stat().st_size for f in package.rglob("*") if f.is_file())
        print(f"{'':<32} {'CPU s':>8} {'wall s':>8} {'peak MB':>8}")
        command = [options.nadir, "cache", "verify", package, "--trust", work / "root.json", "--at", AT, "--quiet"]
        row("verify, quick", best(options.tries, lambda: None, [*command, "--depth", "quick"]))
        for threads in options.threads:
            taken = best(options.tries, lambda: None, [*command, "--depth", "full", "--threads", threads])
            row(f"verify, full, {threads} threads", taken,
                f"{size / 1e9 / taken.cpu_s:.2f} GB per CPU second, {size / 1e9 / taken.wall_s:.2f} per second")
        if tool("openssl"):
            speed = must(["openssl", "speed", "-evp", "sha256", "-seconds", 2, "-bytes", options.tile_bytes]).output
            print(f"openssl speed -evp sha256: {float(re.search(r'^sha256 +([0-9.]+)k', speed, re.M)[1]) / 1e6:.2f} GB per CPU second")
        if options.only == "verify":
            return
        judged = best(options.tries, lambda: None, [BUILD / "bench_judge_tiles", package])
        print(judged.output, end="")
        row("catalogue add", best(options.tries, lambda: catalogue.unlink(missing_ok=True), [
            options.nadir, "catalogue", "add", package, "--to", catalogue, "--quiet"]))
        row("catalogue gaps", run([options.nadir, "catalogue", "gaps", catalogue, "--mission",
                                   package / "mission/mission.yaml", "--out", work / "gaps.geojson", "--quiet"]))


if __name__ == "__main__":
    main()
