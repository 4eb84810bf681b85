#!/usr/bin/env python3
"""ArduPlane or PX4 itself by nadird's fixes: the autopilot's real code in its own simulator (SITL), over a simulated world.

--arduplane PATH is the program that ArduPilot's sources build (`build/sitl/bin/arduplane`), --px4 PATH that of PX4's
(`build/px4_sitl_default/bin/px4`); without either nothing is flown. It takes off with its own GPS, climbs to the circuit, and
its GPS is denied or moved. Prints how far the true track was from the plan, how far the filter and the fixes were from the
truth, and the status texts. docs/closed-loop.md.
"""
import argparse
import json
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from loop import harness
from loop.arduplane import ArduPlane
from loop.flight import SCENARIOS, Setup
from loop.inputs import Inputs
from loop.px4_sitl import Px4
from loop.sitl_flight import SitlFlight
from loop.sitl_verdict import SitlVerdict

FLYABLE = {"none": [], **{name: SCENARIOS[name] for name in ("denied", "spoofed", "dragged", "blackout", "recovery")}}


def assignment(word):
    """("NAME", value) of NAME=VALUE."""
    name, _, value = word.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{word}': expected NAME=VALUE with a number, as GPS1_DELAY_MS=220") from None


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    program = parser.add_mutually_exclusive_group()
    program.add_argument("--arduplane", metavar="PATH", help="ArduPilot's program, built for SITL")
    program.add_argument("--px4", metavar="PATH", help="PX4's program, built for SITL; its etc folder lies beside bin")
    parser.add_argument("--scenario", choices=FLYABLE, default="denied",
                        help="from when the circuit was reached; ArduPlane: none, denied, spoofed")
    parser.add_argument("--event", action="append", metavar="S:ACTION[=VALUE]", help="instead of a scenario's")
    parser.add_argument("--minutes", type=float, default=4, help="on the circuit")
    parser.add_argument("--fps", type=float, default=3)
    parser.add_argument("--delay-s", type=float, default=0.25, help="from exposure to frame, as airframe.json says")
    parser.add_argument("--signed", action="store_true", help="provision with a key for the link")
    parser.add_argument("--parameter", type=assignment, action="append", default=[], metavar="NAME=VALUE", help="one more of the autopilot's")
    parser.add_argument("--change", type=assignment, metavar="NAME=VALUE", help="a parameter that provisioning set: changed before take-off, and set "
                        "back; nadird must note both")
    parser.add_argument("--nadird-option", action="append", default=[], metavar="WORD", help="one more word for nadird")
    parser.add_argument("--check", action="store_true", help="exit code 1 when a limit is violated")
    parser.add_argument("--json", metavar="FILE", help="write every position that was compared")
    harness.add_words(parser, width=1920)
    args = parser.parse_args()
    vehicle = Px4 if args.px4 else ArduPlane
    if args.change and args.change[0] not in vehicle.listed_parameters:
        parser.error(f"--change {args.change[0]}: expected one of {', '.join(vehicle.listed_parameters)}")
    args.events = args.event if args.event is not None else FLYABLE[args.scenario]
    known = vehicle.actions
    for event in args.events:
        if event.partition(":")[2].partition("=")[0] not in known:
            parser.error(f"'{event}': expected one of {', '.join(known)}")
    return args


def write_rows(path, track):
    rows = {name: getattr(track, name) for name in ("truth", "estimated", "given", "own", "filter", "attitude")}
    pathlib.Path(path).write_text(json.dumps(rows), encoding="utf-8")


def main():
    args = arguments()
    program = args.px4 or args.arduplane
    if program is None or not os.access(program, os.X_OK):
        print("NOT RUN: --arduplane or --px4 must name the program that is built for the autopilot's simulator "
              "(build/sitl/bin/arduplane, build/px4_sitl_default/bin/px4)")
        return 0
    vehicle = (Px4 if args.px4 else ArduPlane)(program, dict(args.parameter))
    with harness.output(args, "sitl") as out:
        run = harness.fresh(out / "run")
        inputs = Inputs(harness.inputs_folder(args, out), args.nadir, width=args.width, delay_s=args.delay_s,
                        uncertainty=vehicle.uncertainty)
        setup = Setup(inputs, run, args.nadir, args.nadird, args.events, args.minutes, args.fps, args.delay_s,
                      signed=args.signed, nadird_options=args.nadird_option)
        with SitlFlight(setup, vehicle) as flight:
            flight.start()
            if args.change:
                flight.change_before_take_off(*args.change)
            flight.fly(args.minutes * 60)
            verdict = SitlVerdict(flight, flight.finish())
        print("\n".join(verdict.timeline()) + "\n")
        for name, text in verdict.figures():
            print(f"{name:26}{text}")
        print(f"{'load of the machine':26}{', '.join(f'{load:.1f}' for load in os.getloadavg())} (1, 5, 15 minutes)")
        found = verdict.shortfalls()
        print("\n".join(f"FALLS SHORT  {text}" for text in found) if found else "all as it should be")
        if args.json:
            write_rows(args.json, flight.track)
    return 1 if args.check and found else 0


if __name__ == "__main__":
    sys.exit(main())
