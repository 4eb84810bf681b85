#!/usr/bin/env python3
"""ArduPlane itself by nadird's fixes: the autopilot's real code in its own simulator (SITL), over a simulated world.

--arduplane PATH is the program that ArduPilot's sources build (`build/sitl/bin/arduplane`); without it nothing is flown.
It takes off with its own GPS, climbs to the circuit, and its GPS is denied or moved. Prints how far the true track was
from the plan, how far the filter and the fixes were from the truth, and the status texts. docs/closed-loop.md.
"""
import argparse
import json
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from loop import arduplane, harness
from loop.flight import Setup
from loop.inputs import Inputs
from loop.sitl_flight import SitlFlight
from loop.sitl_verdict import SitlVerdict

SCENARIOS = {"denied": arduplane.DENY, "spoofed": arduplane.spoof(300), "none": None}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arduplane", metavar="PATH", help="ArduPilot's program, built for SITL")
    parser.add_argument("--scenario", choices=SCENARIOS, default="denied")
    parser.add_argument("--at-s", type=float, default=60, help="when that happens, from when the circuit was reached")
    parser.add_argument("--minutes", type=float, default=4, help="on the circuit")
    parser.add_argument("--fps", type=float, default=3)
    parser.add_argument("--delay-s", type=float, default=0.25, help="from exposure to frame, as airframe.json says")
    parser.add_argument("--signed", action="store_true", help="first `nadir provision autopilot`, with a key for the link")
    parser.add_argument("--parameter", action="append", default=[], metavar="NAME=VALUE", help="one more of ArduPlane's")
    parser.add_argument("--check", action="store_true", help="exit code 1 when a limit is violated")
    parser.add_argument("--json", metavar="FILE", help="write every position that was compared")
    harness.add_words(parser, width=1920)
    return parser.parse_args()


def write_rows(path, track):
    rows = {name: getattr(track, name) for name in ("truth", "estimated", "given", "own", "filter", "attitude")}
    pathlib.Path(path).write_text(json.dumps(rows), encoding="utf-8")


def main():
    args = arguments()
    if args.arduplane is None or not os.access(args.arduplane, os.X_OK):
        print("NOT RUN: --arduplane must name ArduPilot's program for its simulator (build/sitl/bin/arduplane)")
        return 0
    changed = {name: float(value) for name, value in (word.split("=") for word in args.parameter)}
    with harness.output(args, "sitl") as out:
        run = harness.fresh(out / "run")
        inputs = Inputs(harness.inputs_folder(args, out), args.nadir, width=args.width, delay_s=args.delay_s,
                        uncertainty=arduplane.UNCERTAINTY)
        trouble = SCENARIOS[args.scenario]
        setup = Setup(inputs, run, args.nadir, args.nadird, [] if trouble is None else [(args.at_s, trouble)], args.minutes,
                      args.fps, args.delay_s, signed=args.signed)
        with SitlFlight(setup, args.arduplane, changed) as flight:
            flight.start()
            flight.fly(args.minutes * 60)
            verdict = SitlVerdict(flight, flight.finish())
        print("\n".join(verdict.timeline()) + "\n")
        for name, text in verdict.figures():
            print(f"{name:26}{text}")
        found = verdict.shortfalls()
        print("\n".join(f"FALLS SHORT  {text}" for text in found) if found else "all as it should be")
        if args.json:
            write_rows(args.json, flight.track)
    return 1 if args.check and found else 0


if __name__ == "__main__":
    sys.exit(main())
