#!/usr/bin/env python3
"""Every rule of docs/onboard.md in real time: eight short flights that trigger each of them, and a table of what was
seen, and when. The exit code is 1 when a rule was not seen, or too late. docs/closed-loop.md.
"""
import argparse
import json
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from loop import harness, scenes
from loop.inputs import Inputs
from loop.proofs import PROOFS, Seen
from loop.rules import Happened


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=scenes.SCENES, help="one flight; may be given several times")
    parser.add_argument("--list", action="store_true", help="list which flight proves what, and exit")
    parser.add_argument("--json", action="store_true")
    harness.add_words(parser, width=1280)
    return parser.parse_args()


def seen_in(setup, flight, stage, summary):
    events = sorted((event["at"] - flight.begun_flying, event["kind"], event["text"])
                    for event in flight.watch.events.values())
    return Seen(Happened(summary, setup.rows(), flight.watch.changes), events, stage.done)


def judged(proof, seen, missed):
    """(verdict, seconds): "yes", "NO", "LATE", or why it could not be tested. missed: the faults that could not be injected, and why."""
    if proof.needs in missed:
        return f"NOT TESTED: {missed[proof.needs]}", None
    seconds = proof.look(seen)
    if seconds is None:
        return "NO", None
    return ("yes" if proof.within_s is None or seconds <= proof.within_s else "LATE"), seconds


def line(proof, verdict, seconds):
    allowed = "" if proof.within_s is None else f"{proof.within_s:.1f} s"
    return (f"{proof.row:50}  {proof.scene:9} {proof.asked:46} {allowed:>7}  {verdict:5}"
            + ("" if seconds is None else f"{seconds:8.2f} s"))


def main():
    args = arguments()
    if args.list:
        for proof in PROOFS:
            print(line(proof, "", None).rstrip())
        return 0
    results = []
    with harness.output(args, "rules") as out:
        inputs = Inputs(harness.inputs_folder(args, out), args.nadir, width=args.width)
        for name in args.only or scenes.SCENES:
            scene = scenes.SCENES[name]
            print(f"-- {name}: {scene.what} ({scene.seconds:.0f} s)", file=sys.stderr, flush=True)
            flown = scenes.fly(scene, inputs, harness.fresh(out / name), args.nadir, args.nadird, args.width)
            seen, missed = seen_in(*flown), flown[2].missed
            results += [(proof, *judged(proof, seen, missed)) for proof in PROOFS if proof.scene == name]
    if args.json:
        print(json.dumps([{"rule": proof.row, "scene": proof.scene, "asked": proof.asked, "within_s": proof.within_s,
                           "seen": verdict, "seconds": seconds} for proof, verdict, seconds in results], indent=1))
    else:
        print("\n".join(line(*result) for result in results))
        print(f"{sum(verdict == 'yes' for _, verdict, _ in results)} of {len(results)} seen; load of the machine: "
              f"{', '.join(f'{load:.1f}' for load in os.getloadavg())} (1, 5, 15 minutes)")
    return 1 if any(verdict in ("NO", "LATE") for _, verdict, _ in results) else 0


if __name__ == "__main__":
    sys.exit(main())
