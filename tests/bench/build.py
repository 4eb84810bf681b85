#!/usr/bin/env python3
"""The cost of a clean build: CPU seconds of every compiler call without ccache, by folder, and the slowest units.

usage: ./run bench build [--against COMMIT] [--demo] [--jobs N] [--keep DIR]

--against COMMIT  builds that commit too, one after the other on this machine, and prints the ratios
--demo            builds what `./run demo` needs, and not the tests
--jobs N          compilers at a time (all cores)
--keep DIR        keep sources, builds and measurements there
"""
import argparse
import collections
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = ["nadir", "nadird", "nadir-candidates"]
# In the place of ccache: a line "user system output" for each call of the compiler.
LAUNCHER = """#!/usr/bin/env bash
output=""
for ((i = 1; i < $#; i++)); do [[ ${!i} == -o ]] && { next=$((i + 1)); output=${!next}; }; done
TIMEFORMAT='%U %S'
exec 3>&2
seconds=$({ time "$@" 2>&3; } 2>&1 >/dev/null)
code=$?
echo "$seconds $output" >>"$NADIR_COMPILE_TIMES"
exit $code
"""


def call(*command, **more):
    subprocess.run([str(part) for part in command], check=True, **more)


def build(source, folder, jobs, demo):
    """Seconds of CPU by unit."""
    times = folder / "times.txt"
    times.unlink(missing_ok=True)
    launcher = folder / "launcher.sh"
    launcher.write_text(LAUNCHER)
    launcher.chmod(0o755)
    output = folder / "build"
    shutil.rmtree(output, ignore_errors=True)
    call("cmake", "-G", "Ninja", "-S", source, "-B", output, "-DCMAKE_BUILD_TYPE=Release", f"-DCCACHE_PROGRAM={launcher}",
         f"-DNADIR_VENV={ROOT / 'build-venv'}", stdout=subprocess.DEVNULL)
    targets = ["--target", *PROGRAMS] if demo else []
    call("cmake", "--build", output, "-j", jobs, *targets, env={**os.environ, "NADIR_COMPILE_TIMES": str(times)},
         stdout=subprocess.DEVNULL)
    units = {}
    for line in times.read_text().splitlines():
        user, system, unit = line.split(" ", 2)
        units[unit] = float(user) + float(system)
    return units


def folder_of(unit):
    parts = unit.split("/CMakeFiles/")[0].split("/")
    return "/".join(parts[:2])


def table(units):
    folders = collections.Counter()
    counts = collections.Counter()
    for unit, seconds in units.items():
        folders[folder_of(unit)] += seconds
        counts[folder_of(unit)] += 1
    print(f"{'CPU s':>8}  {'units':>5}  folder")
    for name, seconds in folders.most_common():
        print(f"{seconds:8.1f}  {counts[name]:5}  {name}")
    print(f"{sum(units.values()):8.1f}  {len(units):5}  all\n\nslowest units")
    for unit, seconds in collections.Counter(units).most_common(10):
        print(f"{seconds:8.1f}  {unit.replace('CMakeFiles/', '')}")


def main():
    parser = argparse.ArgumentParser(prog="./run bench build", description=__doc__.split("\n\n")[0])
    parser.add_argument("--against", metavar="COMMIT")
    parser.add_argument("--demo", action="store_true")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--keep", metavar="DIR", type=pathlib.Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = options.keep.resolve() if options.keep else pathlib.Path(temporary)
        (work / "now").mkdir(parents=True, exist_ok=True)
        now = build(ROOT, work / "now", options.jobs, options.demo)
        table(now)
        if not options.against:
            return 0
        source = work / "against" / "source"
        source.mkdir(parents=True, exist_ok=True)
        archive = subprocess.run(["git", "-C", ROOT, "archive", options.against], check=True, capture_output=True).stdout
        subprocess.run(["tar", "-x", "-C", source], input=archive, check=True)
        # What `./run demo` built before it built the programs alone was everything; so compare with all of it.
        before = build(source, work / "against", options.jobs, False)
        print(f"\n{options.against}")
        table(before)
        print(f"\nratio {sum(now.values()) / sum(before.values()):.2f}: {sum(now.values()):.0f} CPU s "
              f"{'for the programs ' if options.demo else ''}now, {sum(before.values()):.0f} CPU s for everything at {options.against}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
