#!/usr/bin/env python3
"""Kills `nadir cache build` at random moments: never a package under the final name, and --resume ends identical.

Every third run the resume is killed as well, and resumed once more. Whatever lies under the final name must be the whole
package. More options of the build come after "--":

  kill_resume.py NADIR MISSION.yaml MAP.tif [TIMES] [SEED] [-- --dem dem.tif --format cog]
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
    own, more = sys.argv[1:], []
    if "--" in own:
        own, more = own[:own.index("--")], own[own.index("--") + 1:]
    if len(own) < 3:
        sys.exit(__doc__)
    nadir, mission, imagery = own[:3]
    times = int(own[3]) if len(own) > 3 else 50
    generator = random.Random(int(own[4]) if len(own) > 4 else 1)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        key = folder / "key.pem"
        subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", key], check=True)
        os.chmod(key, 0o600)
        whole, out = folder / "whole", folder / "package"

        def command(to, *options):
            return [nadir, "cache", "build", "--mission", mission, "--imagery", imagery, "--key", key, "--out", to,
                    "--quiet", *more, *options]

        def killed(run, *options):
            """Whether the kill came before the package was there; what is there must be whole."""
            process = subprocess.Popen(command(out, *options), stdout=subprocess.DEVNULL)
            time.sleep(generator.uniform(0, took_s))
            process.kill()
            process.wait()
            if process.returncode == 0 and not out.exists():
                sys.exit(f"run {run}: the build ended well without a package")
            if out.exists() and not same(out, whole):
                sys.exit(f"run {run}: another package under the final name")
            return not out.exists()

        begun = time.monotonic()
        subprocess.run(command(whole), check=True, stdout=subprocess.DEVNULL)
        took_s = time.monotonic() - begun
        first = second = 0
        for run in range(times):
            if killed(run):
                first += 1
                if run % 3 == 0 and killed(run, "--resume"):
                    second += 1
            if not out.exists():
                subprocess.run(command(out, "--resume"), check=True, stdout=subprocess.DEVNULL)
                if not same(out, whole):
                    sys.exit(f"run {run}: the resumed package differs")
            shutil.rmtree(out)
        print(f"{times} runs of {took_s:.1f} s, {first} killed before their end, {second} of them killed again while they "
              "resumed: never another package under the final name, every resumed one identical")


if __name__ == "__main__":
    main()
