#!/usr/bin/env python3
"""Kills `nadir cache build` at random moments: never a package under the final name, and --resume ends identical.

usage: kill_resume.py NADIR MISSION.yaml MAP.tif [TIMES] [SEED]
"""
import filecmp
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time


def files_of(folder):
    return sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())


def same(a, b):
    return files_of(a) == files_of(b) and all(filecmp.cmp(a / f, b / f, shallow=False) for f in files_of(a))


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    nadir, mission, imagery = sys.argv[1:4]
    times = int(sys.argv[4]) if len(sys.argv) > 4 else 50
    generator = random.Random(int(sys.argv[5]) if len(sys.argv) > 5 else 1)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        key = folder / "key.pem"
        subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", key], check=True)
        os.chmod(key, 0o600)

        def command(out, *more):
            return [nadir, "cache", "build", "--mission", mission, "--imagery", imagery, "--key", key, "--out", out,
                    "--quiet", *more]

        begun = time.monotonic()
        subprocess.run(command(folder / "whole"), check=True, stdout=subprocess.DEVNULL)
        took_s = time.monotonic() - begun
        killed = 0
        for run in range(times):
            out = folder / "package"
            process = subprocess.Popen(command(out), stdout=subprocess.DEVNULL)
            time.sleep(generator.uniform(0, took_s))
            process.kill()
            process.wait()
            if process.returncode == 0 or out.exists():
                if not same(out, folder / "whole"):
                    sys.exit(f"run {run}: another package under the final name")
            else:
                killed += 1
                subprocess.run(command(out, "--resume"), check=True, stdout=subprocess.DEVNULL)
                if not same(out, folder / "whole"):
                    sys.exit(f"run {run}: the resumed package differs")
            shutil.rmtree(out)
        print(f"{times} runs of {took_s:.1f} s, {killed} killed before their end: every package whole and identical")


if __name__ == "__main__":
    main()
