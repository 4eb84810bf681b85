#!/usr/bin/env python3
"""Attacks on the built programs (nadir, nadird, nadir-candidates), on loopback and real files: a table of what each got for
an answer, exit code, peak memory and time. A row that fails is exit code 1. docs/attacks.md lists what each attacker gains.
"""
import argparse
import concurrent.futures
import importlib
import json
import pathlib
import shutil
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from attacks.registry import ATTACKS, Scene, run_attack  # noqa: E402
from attacks.shared import Shared  # noqa: E402

ATTACKERS = ["card", "camera", "link", "api", "service", "keys", "clock", "flight"]
ANSWER_WIDTH = 90


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", metavar="NAME", help="an attack, or an attacker; repeatable")
    parser.add_argument("--list", action="store_true", help="name every attack, and end")
    parser.add_argument("--json", metavar="FILE", help="the rows as JSON, too")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="attacks at once (2)")
    parser.add_argument("--programs", type=pathlib.Path, default=HERE.parents[1] / "build" / "bin", metavar="DIR")
    return parser.parse_args()


def chosen(only):
    """The attacks by name, a name's beginning, or attacker."""
    found = [row for row in ATTACKS.values() if not only or any(row.name.startswith(word) for word in only)]
    if not found:
        raise SystemExit(f"no attack is named {' or '.join(only)}: see --list")
    return found


def head(width):
    return f"{'attack':{width}}  {'review':6}  {'verdict':12}  {'answer':{ANSWER_WIDTH}}  exit  memory/bound  seconds/bound"


def line(row, width):
    answer = row.answer if len(row.answer) <= ANSWER_WIDTH else row.answer[:ANSWER_WIDTH - 1] + "…"
    code = "-" if row.code is None else row.code
    return (f"{row.attack.name:{width}}  {row.attack.review:6}  {row.verdict:12}  {answer:{ANSWER_WIDTH}}  {code:>4}  "
            f"{row.peak_mb:4.0f}/{row.attack.memory_mb:4} MB  {row.seconds:5.1f}/{row.attack.seconds:3} s")


def begin_flight(rows, shared, folder):
    """The flight in real time is flown beside the other rows; its own come last."""
    if any(row.attacker == "flight" for row in rows):
        flight = importlib.import_module("attacks.flight")
        flight.flown(Scene(rows[0], shared.programs, shared, folder))


def main():
    args = arguments()
    for name in ATTACKERS:
        importlib.import_module(f"attacks.{name}")
    rows = chosen(args.only)
    if args.list:
        for row in rows:
            print(f"{row.name:44}  {row.review:6}  {row.sentence}")
        return 0
    folder = pathlib.Path(tempfile.mkdtemp(prefix="nadir-attacks."))
    width = max(len(row.name) for row in rows)
    begun, results = time.monotonic(), []
    try:
        (folder / "shared").mkdir()
        shared = Shared(args.programs.resolve(), folder / "shared")
        print(head(width), flush=True)
        begin_flight(rows, shared, folder)
        with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
            begun_rows = [pool.submit(run_attack, row, args.programs.resolve(), shared, folder) for row in rows]
            for row in begun_rows:
                results.append(row.result())
                print(line(results[-1], width), flush=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if args.json:
        pathlib.Path(args.json).write_text(json.dumps([
            {"attack": row.attack.name, "sentence": row.attack.sentence, "review": row.attack.review, "verdict": row.verdict,
             "answer": row.answer, "exit_code": row.code, "peak_mb": round(row.peak_mb, 1), "bound_mb": row.attack.memory_mb,
             "seconds": round(row.seconds, 2), "bound_s": row.attack.seconds} for row in results], indent=1) + "\n")
    fallen = [row for row in results if row.verdict in ("FALLS", "NOT ATTACKED")]
    skipped = [row for row in results if row.verdict == "NOT RUN"]
    print(f"{len(results)} attacks in {time.monotonic() - begun:.0f} s: {len(results) - len(fallen) - len(skipped)} hold, "
          f"{len(fallen)} fall, {len(skipped)} not run")
    for row in fallen:
        print(f"  {row.verdict}: {row.attack.name}: {row.answer}")
    return 1 if fallen else 0


if __name__ == "__main__":
    sys.exit(main())
