#!/usr/bin/env python3
"""Kills `nadir cache build` (SIGKILL) at random moments: the final name never holds a different package, and --resume
always gives the result of an undisturbed build. Every third resume is killed as well, and resumed once more.

  tests/bench/kill_resume.py [--times 50] [--seed N] [--containers mbtiles cog]
  tests/bench/kill_resume.py --mission mission.yaml --imagery map.tif [-- --dem dem.tif --threads 1]"""
import argparse
import filecmp
import pathlib
import random
import shutil
import subprocess
import tempfile
import time

from measured import BUILD, make_keys, make_world, must


def same(a, b):
    files = [sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file()) for folder in (a, b)]
    return files[0] == files[1] and all(filecmp.cmp(a / f, b / f, shallow=False) for f in files[0])


class Killer:
    def __init__(self, work, command, generator):
        self.whole, self.out = work / "whole", work / "package"
        self.command, self.generator = command, generator
        self.took_s = must([*command, "--out", self.whole]).wall_s

    def killed(self, *options):
        """Whether the kill came before the package existed; an existing package must be complete."""
        process = subprocess.Popen([str(c) for c in [*self.command, "--out", self.out, *options]],
                                   stdout=subprocess.DEVNULL)
        time.sleep(self.generator.uniform(0, self.took_s))
        process.kill()
        process.wait()
        if process.returncode == 0 and not self.out.exists():
            raise SystemExit("the build ended well without a package")
        self.check("a killed build")
        return not self.out.exists()

    def check(self, what):
        if self.out.exists() and not same(self.out, self.whole):
            raise SystemExit(f"{what} left a different package under the final name")

    def round(self, also_the_resume):
        """How many builds and how many resumes were killed before their end."""
        first = self.killed()
        second = first and also_the_resume and self.killed("--resume")
        if not self.out.exists():
            must([*self.command, "--out", self.out, "--resume"])
            self.check("a resumed build")
        shutil.rmtree(self.out)
        return first, second


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nadir", type=pathlib.Path, default=BUILD / "nadir")
    parser.add_argument("--times", type=int, default=50, help="builds killed before their end, per container")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--containers", nargs="+", default=["mbtiles", "cog"])
    parser.add_argument("--mission", type=pathlib.Path)
    parser.add_argument("--imagery", type=pathlib.Path)
    parser.add_argument("more", nargs="*", help="options of the build, after --")
    options = parser.parse_args()
    print(f"seed {options.seed}", flush=True)
    with tempfile.TemporaryDirectory(prefix="nadir-bench.") as folder:
        work = pathlib.Path(folder)
        make_keys(options.nadir, work)
        world = work / "world"
        if not options.imagery:
            make_world(options.nadir, world, 1)
            options.more += ["--dem", world / "dem.tif"]
        for container in options.containers:
            command = [options.nadir, "cache", "build", "--mission", options.mission or world / "mission.yaml",
                       "--imagery", options.imagery or world / "map.tif", "--key", work / "signer.key.pem", "--format",
                       container, "--quiet", *options.more]
            killer = Killer(work, command, random.Random(f"{options.seed} {container}"))
            begun, runs, killed, resumes_killed = time.monotonic(), 0, 0, 0
            while killed < options.times and runs < 3 * options.times:
                first, second = killer.round(runs % 3 == 0)
                runs, killed, resumes_killed = runs + 1, killed + first, resumes_killed + second
            print(f"{container}: {runs} builds of {killer.took_s:.1f} s, {killed} killed before their end, "
                  f"{resumes_killed} of them killed again while they resumed: never a different package under the final "
                  f"name, every resumed one identical ({time.monotonic() - begun:.0f} s)", flush=True)
            shutil.rmtree(killer.whole)


if __name__ == "__main__":
    main()
