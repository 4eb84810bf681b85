#!/usr/bin/env python3
"""What the tests cost: CPU seconds of every test that ctest knows, by folder, and the costliest ones.

usage: ./run bench suite [-R REGEX] [--json FILE] [--against FILE] [--jobs N]

-R REGEX        only tests whose name matches
--json FILE     writes the measurement
--against FILE  compares with such a measurement: both sides of every test that both know
--jobs N        tests at a time (1). CPU seconds hardly depend on it, nor on other work on the machine

Counted is what a test and all its processes used, those included that it killed or left behind.
"""
import argparse
import collections
import concurrent.futures
import ctypes
import json
import os
import pathlib
import re
import resource
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
PR_SET_CHILD_SUBREAPER = 36


def tests(build):
    """(name, command, environment, folder, seconds allowed, code of a skipped one, what it must print to pass)"""
    listed = subprocess.run(["ctest", "--test-dir", build, "--show-only=json-v1"], check=True, capture_output=True, text=True).stdout
    for test in json.loads(listed)["tests"]:
        if "command" not in test:
            sys.exit(f"suite: {test['name']} is not built; to do: ./run build")
        properties = {item["name"]: item["value"] for item in test["properties"]}
        environment = dict(pair.split("=", 1) for pair in properties.get("ENVIRONMENT", []))
        yield (test["name"], test["command"], environment, properties.get("WORKING_DIRECTORY", str(build)),
               float(properties.get("TIMEOUT", 900)), properties.get("SKIP_RETURN_CODE"), properties.get("PASS_REGULAR_EXPRESSION", []))


def adopt_orphans():
    """Processes that a test leaves behind become this worker's children, so that their time counts."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def measure(test):
    """(name, CPU seconds, wall seconds, outcome)"""
    name, command, environment, folder, seconds, skipped, must_print = test
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(command, cwd=folder, env={**os.environ, **environment}, stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                                   start_new_session=True)  # some kill their process group
        try:
            code = process.wait(3 * seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        output.seek(0)
        printed = output.read().decode(errors="replace") if must_print else ""
    passed = any(re.search(text, printed, re.S) for text in must_print) if must_print else code == 0
    wall_s = time.monotonic() - begun
    patience = time.monotonic() + 5
    while time.monotonic() < patience:
        try:
            if os.waitpid(-1, os.WNOHANG) == (0, 0):
                time.sleep(0.01)
        except ChildProcessError:
            break
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return name, cpu_s, wall_s, "passed" if passed else "skipped" if code == skipped else f"failed ({code})"


def main():
    parser = argparse.ArgumentParser(prog="./run bench suite", description=__doc__.split("\n\n")[0])
    parser.add_argument("-R", dest="regex", default="", metavar="REGEX")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build")
    parser.add_argument("--json", type=pathlib.Path, metavar="FILE")
    parser.add_argument("--against", type=pathlib.Path, metavar="FILE")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--top", type=int, default=30)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="nadir-tests-", dir=os.environ.get("TMPDIR") or ("/dev/shm" if os.access("/dev/shm", os.W_OK) else None)) as scratch:
        os.chmod(scratch, 0o1777)  # PostgreSQL is another user
        os.environ["TMPDIR"] = scratch
        chosen = [test for test in tests(options.build) if re.search(options.regex, test[0])]
        with concurrent.futures.ProcessPoolExecutor(options.jobs, initializer=adopt_orphans) as workers:
            found = []
            for result in workers.map(measure, chosen):
                found.append(result)
                print(f"{len(found)}/{len(chosen)}  {result[1]:.1f} CPU s  {result[0]}  {result[3]}", file=sys.stderr)
    cost = {name: cpu_s for name, cpu_s, _, _ in found}
    if options.json:
        options.json.write_text(json.dumps(cost, indent=0) + "\n")
    before = json.loads(options.against.read_text()) if options.against else {}
    folders = collections.Counter()
    for name, seconds in cost.items():
        folders[name.split(".")[0]] += seconds
    print(f"{'CPU s':>8}  folder")
    for name, seconds in folders.most_common():
        print(f"{seconds:8.1f}  {name}")
    print(f"{sum(cost.values()):8.1f}  all {len(cost)} tests\n\n{'CPU s':>8} {'wall s':>8}  test")
    for name, cpu_s, wall_s, _ in sorted(found, key=lambda test: -test[1])[:options.top]:
        print(f"{cpu_s:8.1f} {wall_s:8.1f}  {name}" + (f"  ({before[name]:.1f} before)" if name in before else ""))
    if both := cost.keys() & before.keys():
        now_s, then_s = (sum(side[name] for name in both) for side in (cost, before))
        print(f"\nratio {now_s / then_s:.2f}: {now_s:.0f} CPU s now, {then_s:.0f} CPU s before, of {len(both)} tests that both know")
    for name, _, _, outcome in found:
        if outcome != "passed":
            print(f"{outcome}: {name}", file=sys.stderr)
    return 1 if any(outcome.startswith("failed") for _, _, _, outcome in found) else 0


if __name__ == "__main__":
    sys.exit(main())
