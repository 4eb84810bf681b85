"""Runs commands and measures them: CPU seconds of the command and its children, wall seconds, peak memory of the
largest process. Also the few things that every script here needs."""
import os
import pathlib
import shutil
import sqlite3
import subprocess
import tempfile
import time
from dataclasses import dataclass

HERE = pathlib.Path(__file__).resolve().parent
BUILD = HERE.parent.parent / "build/bin"
AT = "2025-09-17"  # a date on which simulated worlds are fresh


@dataclass
class Taken:
    cpu_s: float
    wall_s: float
    peak_mb: float
    ok: bool
    output: str


def run(command, **environment):
    """A command as a list; shell scripts as ["bash", "-c", …]."""
    with tempfile.TemporaryFile("w+") as output:
        begun = time.monotonic()
        process = subprocess.Popen([str(c) for c in command], stdin=subprocess.DEVNULL, stdout=output,
                                   stderr=subprocess.STDOUT, env={**os.environ, **environment})
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall_s = time.monotonic() - begun
        output.seek(0)
        return Taken(usage.ru_utime + usage.ru_stime, wall_s, usage.ru_maxrss / 1024, process.returncode == 0,
                     output.read())


def must(command, **environment):
    taken = run(command, **environment)
    if not taken.ok:
        raise SystemExit(f"{' '.join(str(c) for c in command)}: {taken.output.strip()[-400:]}")
    return taken


def best(times, prepare, command):
    """The least CPU and wall time of several runs: other load on the machine can only add to them."""
    all_taken = []
    for _ in range(times):
        prepare()
        all_taken.append(must(command))
    return Taken(min(t.cpu_s for t in all_taken), min(t.wall_s for t in all_taken),
                 max(t.peak_mb for t in all_taken), True, all_taken[-1].output)


def wall_pairs(times, prepare, one, two):
    """Two commands, one after the other, several times: the pair that took least wall time together."""
    pairs = []
    for _ in range(times):
        pair = []
        for command in (one, two):
            prepare()
            pair.append(must(command))
        pairs.append(pair)
    return min(pairs, key=lambda pair: pair[0].wall_s + pair[1].wall_s)


def tool(name):
    """From PATH, or from the virtual environment that NADIR_BENCH_VENV names; None when it is missing."""
    venv = os.environ.get("NADIR_BENCH_VENV")
    return shutil.which(name, path=f"{venv}/bin:{os.environ['PATH']}" if venv else None)


def tiles_in(mbtiles):
    database = sqlite3.connect(f"file:{mbtiles}?mode=ro&immutable=1", uri=True)
    return database.execute("SELECT count(*), sum(length(tile_data)) FROM tiles").fetchone()


def make_keys(nadir, work):
    """signer.key.pem and root.json in `work`."""
    for name in ("signer", "root"):
        must([nadir, "keys", "create", "--out", work / name])
    must([nadir, "keys", "root", "--root-key", work / "root.key.pem", "--package-signer", work / "signer.pub.pem",
          "--expires", "2035-01-01", "--out", work / "root.json"])


def make_world(nadir, out, size_km, gsd_m=0.3):
    return must([nadir, "simulate", "world", "--seed", 1, "--size-km", size_km, "--gsd-m", gsd_m, "--out", out,
                 "--quiet"])


def build_command(nadir, world, work, out, *options):
    return [nadir, "cache", "build", "--mission", world / "mission.yaml", "--imagery", world / "map.tif", "--dem",
            world / "dem.tif", "--key", work / "signer.key.pem", "--out", out, "--quiet", *options]
