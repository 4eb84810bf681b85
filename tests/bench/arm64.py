#!/usr/bin/env python3
"""The cross build for arm64 under qemu, beside this machine's own build: tests, bytes, and instructions per frame.

  tests/bench/arm64.py [--only tests|bytes|instructions] [--quick] [--frames N] [--keep DIR] [--limit-s S] [--resume FILE]

Tests: of the libraries, suite by suite, each with a limit of CPU time; what is too slow under qemu is excluded by name.
Bytes: a world, a map package with its place index, a flight, a replay with its recording; each step is given the same inputs on both
machines (those of amd64), so that one difference is not counted again in all that follows. Then each replays what the other
recorded, and compares every estimate bit for bit. Instructions: counted by a plug-in of qemu, all threads, over a replay of N frames
less one of fewer. NADIR_PRESET=arm64 ./run build makes the cross build. --quick: only the tests of base, trust and geodesy, and whether
our libraries hold fused products. Exit code 1: something differs or fails, 77: there is no cross build."""
import argparse
import csv
import hashlib
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

from measured import BUILD, make_keys, must, run

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
ARM = ROOT / "build-arm64/bin"
SYSROOT = ROOT / "build-arm64-sysroot"
QEMU = ["qemu-aarch64", "-L", SYSROOT]
TESTS = ["base", "geodesy", "imagery", "trust", "package", "vision", "estimation"]
AT = "2025-09-20"
# Suites that are not run under qemu, and why. Everything else must pass.
EXCLUDED = {"trust.TokenKeyTest": "SoftHSM is a library of this PC, which a program for arm64 cannot load"}


class TestResults:
    """What each suite did under qemu, kept in a file of CSV from which a run that was stopped goes on."""

    FIELDS = ("program", "suite", "passed", "failed", "skipped", "ended", "cpu_s", "failures")

    def __init__(self, path):
        self.path = path
        self.rows = {}
        if path and path.exists():
            self.rows = {(row["program"], row["suite"]): row for row in csv.DictReader(path.open())}

    def __contains__(self, key):
        return key in self.rows

    def add(self, row):
        self.rows[row["program"], row["suite"]] = row
        if not self.path:
            return
        new = not self.path.exists()
        with self.path.open("a", newline="") as file:
            writer = csv.DictWriter(file, self.FIELDS)
            if new:
                writer.writeheader()
            writer.writerow(row)

    def of(self, program):
        return [row for row in self.rows.values() if row["program"] == program]


def suites_of(program):
    listed = must([*QEMU, program, "--gtest_list_tests"]).output
    return [line.split(".")[0] for line in listed.splitlines() if re.match(r"[A-Za-z]\S*\.", line)]


def run_suite(name, suite, limit_s):
    """A row of TestResults. limit_s: of CPU, so that other work on this machine decides nothing."""
    command = ["prlimit", f"--cpu={limit_s}", *QEMU, ARM / f"test_{name}", f"--gtest_filter={suite}.*", "--gtest_brief=1"]
    taken = run(command)
    count = {what: int(found[1]) if (found := re.search(rf"\[ *{what} *\] (\d+) test", taken.output)) else 0
             for what in ("PASSED", "FAILED", "SKIPPED")}
    failed = re.findall(r"^\[  FAILED  \] (\S+\.[^\s,]+) \(", taken.output, re.M)
    ended = re.search(r"^\[=+\] \d+ tests? from .* ran\.", taken.output, re.M)
    return {"program": name, "suite": suite, "passed": count["PASSED"], "failed": count["FAILED"], "skipped": count["SKIPPED"],
            "ended": "yes" if ended else "late" if taken.cpu_s >= limit_s - 1 else "crashed", "cpu_s": round(taken.cpu_s, 1),
            "failures": " ".join(failed)}


def test_programs(names, limit_s, results):
    """Suite by suite, and a row for each program; True when nothing failed or was late that is not excluded by name."""
    fine = True
    print(f"{'tests under qemu':<18} {'passed':>7} {'failed':>7} {'skipped':>8} {'excluded':>9} {'CPU s':>8}")
    for name in names:
        program = ARM / f"test_{name}"
        if not program.exists():
            print(f"{name:<18} NOT RUN: {program.relative_to(ROOT)} is not built")
            fine = False
            continue
        suites = suites_of(program)
        for suite in suites:
            if f"{name}.{suite}" not in EXCLUDED and (name, suite) not in results:
                results.add(run_suite(name, suite, limit_s))
        rows = results.of(name)
        bad = [row for row in rows if int(row["failed"]) or row["ended"] != "yes"]
        total = {what: sum(float(row[what]) for row in rows) for what in ("passed", "failed", "skipped", "cpu_s")}
        excluded = sum(f"{name}.{suite}" in EXCLUDED for suite in suites)
        print(f"{name:<18} {total['passed']:>7.0f} {total['failed']:>7.0f} {total['skipped']:>8.0f} {excluded:>9} {total['cpu_s']:>8.0f}  "
              + " ".join(row["failures"] or f"{row['suite']}: {row['ended']}" for row in bad), flush=True)
        fine = fine and not bad
    for suite, reason in EXCLUDED.items():
        if suite.split(".")[0] in names:
            print(f"excluded: {suite}: {reason}")
    return fine


def no_fused_products():
    """Our own code rounds products before it adds them, as amd64's does."""
    fused = {}
    for library in sorted((ARM.parent / "lib").glob("libnadir_*.a")):
        code = must(["aarch64-linux-gnu-objdump", "-d", "--no-show-raw-insn", library]).output
        if found := len(re.findall(r"\t(?:fmla|fmls|fmadd|fmsub|fnmadd|fnmsub)\t", code)):
            fused[library.name] = found
    print("fused products in our libraries: " + (", ".join(f"{k} {v}" for k, v in fused.items()) or "none"))
    return not fused


class Job:
    """The steps of a package and a flight, each by either program."""

    def __init__(self, work, frames):
        self.work, self.frames = work, frames
        for machine in ("amd64", "arm64"):
            (work / machine).mkdir(parents=True)
        make_keys(BUILD / "nadir", work)
        self.programs = {"amd64": [BUILD / "nadir"], "arm64": [*QEMU, ARM / "nadir"]}

    def nadir(self, machine, *arguments):
        return must([*self.programs[machine], *arguments, "--quiet"])

    def world(self, machine):
        out = self.work / machine / "world"
        self.nadir(machine, "simulate", "world", "--seed", 3, "--size-km", 1, "--gsd-m", 0.6, "--out", out)
        return out

    def package(self, machine):
        world, out = self.work / "amd64/world", self.work / machine / "package"
        self.nadir(machine, "cache", "build", "--mission", world / "mission.yaml", "--imagery", world / "map.tif", "--dem",
                   world / "dem.tif", "--key", self.work / "signer.key.pem", "--out", out)
        return out

    def index(self, machine):
        out = self.work / machine / "indexed"
        shutil.copytree(self.work / "amd64/package", out)
        self.nadir(machine, "cache", "index", out, "--key", self.work / "signer.key.pem", "--camera", self.work / "amd64/world/camera.yaml")
        self.nadir(machine, "cache", "verify", out, "--trust", self.work / "root.json", "--depth", "full", "--at", AT)
        return out

    def flight(self, machine):
        world, out = self.work / "amd64/world", self.work / machine / "flight"
        self.nadir(machine, "simulate", "flight", "--world", world / "ground.tif", "--dem", world / "dem.tif", "--mission",
                   world / "mission.yaml", "--camera", world / "camera.yaml", "--max-frames", self.frames, "--out", out)
        return out

    def replay_command(self, machine, out, telemetry=None):
        world, flight = self.work / "amd64/world", self.work / "amd64/flight"
        first = next(csv.DictReader((flight / "truth.csv").open()))
        return [*self.programs[machine], "replay", "--package", self.work / "amd64/indexed", "--trust", self.work / "root.json", "--at", AT,
                "--frames", flight / "frames", "--telemetry", telemetry or flight / "telemetry.csv", "--camera", world / "camera.yaml",
                f"--start={first['lon_deg']},{first['lat_deg']}", "--out", out, "--quiet"]

    def replay(self, machine):
        out = self.work / machine / "result"
        must([*self.replay_command(machine, out), "--record", self.work / machine / "recording"])
        return out

    def replay_of(self, machine, recorded):
        """What `machine` makes of the flight that `recorded` has recorded: identical estimates, all of them."""
        out = self.work / machine / f"again-{recorded}"
        taken = run([*self.programs[machine], "replay", "--recorder", self.work / recorded / "recording", "--frames",
                     self.work / "amd64/flight/frames", "--package", self.work / "amd64/indexed", "--trust", self.work / "root.json", "--at", AT,
                     "--out", out, "--json", "--quiet"])
        if not taken.output.lstrip().startswith("{"):
            raise SystemExit(taken.output[-400:])
        return taken.output


def without_clock(path):
    """The content of a file, without what states how long something took here."""
    content = path.read_bytes()
    if path.name == "estimates.csv":
        rows = list(csv.DictReader(content.decode().splitlines()))
        return "\n".join(",".join(v for k, v in row.items() if k != "latency_ms") for row in rows).encode()
    if path.name == "summary.json":
        return json.dumps({k: v for k, v in json.loads(content).items() if "latency" not in k and "memory" not in k}).encode()
    return content


def compare(one, other):
    """(files, those that differ)."""
    files = sorted(p.relative_to(one) for p in one.rglob("*") if p.is_file() and p.name != "report.html")
    different = [f for f in files if not (other / f).exists()
                 or hashlib.sha256(without_clock(one / f)).digest() != hashlib.sha256(without_clock(other / f)).digest()]
    more = [p.relative_to(other) for p in other.rglob("*") if p.is_file() and not (one / p.relative_to(other)).exists()]
    return len(files), different + more


def largest_differences(one, other):
    """Of tables: the largest difference of each column of numbers."""
    result = {}
    for a, b in zip(csv.DictReader(one.open()), csv.DictReader(other.open())):
        for column in a:
            try:
                off = abs(float(a[column]) - float(b[column]))
            except (TypeError, ValueError):
                off = 0 if a[column] == b[column] else float("inf")
            if off and column != "latency_ms":
                result[column] = max(result.get(column, 0), off)
    return result


STEPS = ("world", "package", "index", "flight", "replay")


def all_bytes(job):
    """A row for each step; True when all bytes are the same."""
    same = True
    print(f"{'bytes':<18} {'files':>7} {'differ':>7}")
    for name in STEPS:
        folder, other = getattr(job, name)("amd64"), getattr(job, name)("arm64")
        files, different = compare(folder, other)
        same = same and not different
        print(f"{name:<18} {files:>7} {len(different):>7}  {' '.join(str(f) for f in different[:6])}{' …' if len(different) > 6 else ''}")
        for table in different:
            if table.suffix == ".csv":
                print("   " + ", ".join(f"{k} {v:.3g}" for k, v in largest_differences(folder / table, other / table).items()))
    for machine, recorded in (("amd64", "arm64"), ("arm64", "amd64")):
        output = job.replay_of(machine, recorded)
        reproduced = json.loads(output)["reproduced"]
        same = same and reproduced["same"] == reproduced["compared"]
        print(f"{machine} replays what {recorded} recorded: {reproduced['same']} of {reproduced['compared']} estimates bit for bit")
    return same


def instructions(job):
    """Executed per frame, and the peak memory of the emulated program beside that of amd64's."""
    plugin = job.work / "count_instructions.so"
    must(["cc", "-O2", "-shared", "-fPIC", "-o", plugin, HERE / "count_instructions.c"])
    lines = (job.work / "amd64/flight/telemetry.csv").read_text().splitlines()
    counts = {}
    few, many = 4, len(lines) - 1
    for frames in (few, many):
        telemetry = job.work / f"telemetry-{frames}.csv"
        telemetry.write_text("\n".join(lines[:frames + 1]) + "\n")
        command = job.replay_command("arm64", job.work / f"counted-{frames}", telemetry)
        counted = job.work / f"count-{frames}"
        must([QEMU[0], "-plugin", f"{plugin},out={counted}", *QEMU[1:], *command[len(QEMU):]])
        counts[frames] = int(counted.read_text())
    per_frame = (counts[many] - counts[few]) / (many - few)
    native = must(job.replay_command("amd64", job.work / "counted-amd64"))
    print(f"instructions per frame on arm64: {per_frame / 1e6:.0f} million ({many} frames {counts[many]:,}, {few} frames {counts[few]:,}); "
          f"the same replay on amd64: {native.cpu_s:.1f} CPU s, {native.peak_mb:.0f} MB")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("tests", "bytes", "instructions"))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--limit-s", type=int, default=600, help="CPU seconds of a test suite under qemu")
    parser.add_argument("--resume", type=pathlib.Path, help="keep what test suites did in this CSV file, and go on where it ends")
    parser.add_argument("--keep", type=pathlib.Path, help="a folder for what is made; it stays")
    options = parser.parse_args()
    for needed, to_do in ((ARM / "nadir", "NADIR_PRESET=arm64 ./run build"), (SYSROOT / "made-from", "NADIR_PRESET=arm64 ./run build")):
        if not needed.exists():
            print(f"NOT TESTED: arm64: {needed.relative_to(ROOT)} is missing; to do: {to_do}")
            return 77
    if not shutil.which(QEMU[0]):
        print("NOT TESTED: arm64: qemu-aarch64 is missing; to do: apt-get install qemu-user")
        return 77
    fine = True
    names = ["base", "trust", "geodesy"] if options.quick else TESTS
    if options.quick and not any((ARM / f"test_{name}").exists() for name in names):  # `./run package` builds the programs alone
        print(f"NOT TESTED: arm64: no tests in {ARM.relative_to(ROOT)}; to do: NADIR_PRESET=arm64 ./run build")
        return 77 if no_fused_products() else 1
    if options.only in (None, "tests"):
        fine = test_programs(names, options.limit_s, TestResults(options.resume))
        fine = no_fused_products() and fine
    if options.quick or options.only == "tests":
        return 0 if fine else 1
    with tempfile.TemporaryDirectory(prefix="nadir-arm64-") as folder:
        job = Job(options.keep or pathlib.Path(folder), options.frames)
        if options.only != "instructions":
            fine = all_bytes(job) and fine
        else:
            for name in STEPS[:-1]:
                getattr(job, name)("amd64")
        if options.only != "bytes":
            instructions(job)
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
