#!/usr/bin/env python3
"""The closed loop: autopilot -> frame -> nadird -> position -> autopilot.

The simulated autopilot flies a circuit over a simulated world by the position that it receives; `nadir simulate camera`
renders what its camera sees; `nadird` localizes the frames. Prints how far the true track was from the plan,
how far the fixes were from the truth, the filter's resets, and a timeline. With --check the exit code is 1 when something
is out of bounds. docs/closed-loop.md.
"""
import argparse
import contextlib
import json
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from loop import harness
from loop.bad_readers import BadReaders
from loop.flight import AUTOPILOTS, SCENARIOS, Flight, Setup
from loop.inputs import Inputs
from loop.page import write_page
from loop.processor_share import ProcessorShare
from loop.rules import judge, lines_of
from loop.verdict import Verdict, timeline


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", choices=SCENARIOS, default="denied")
    parser.add_argument("--autopilot", choices=AUTOPILOTS, default="ardupilot",
                        help="px4: with GLOBAL_POSITION_SENSOR; px4-1.17: with ODOMETRY")
    parser.add_argument("--event", action="append", metavar="S:ACTION[=VALUE]", help="instead of a scenario's")
    parser.add_argument("--minutes", type=float, default=11)
    parser.add_argument("--fps", type=float, default=3)
    parser.add_argument("--delay-s", type=float, default=0.25, help="from exposure to frame, as airframe.json says")
    parser.add_argument("--seed", type=int, default=1, help="of the flight")
    parser.add_argument("--world-seed", type=int, default=7)
    parser.add_argument("--size-km", type=float, default=2)
    parser.add_argument("--airframe", default="any", help="its id; the package must be made for it")
    parser.add_argument("--report", metavar="FILE.html", help="a page with map, timeline and rules")
    parser.add_argument("--readers", type=int, default=0, help="slow and dead readers of the API's events meanwhile")
    parser.add_argument("--own-receiver", choices=("first", "second"), default="second",
                        help="which GPS instance is real; GPS_INPUT plays the other")
    parser.add_argument("--signed", action="store_true", help="sign the link")
    parser.add_argument("--unfavoured", action="store_true",
                        help="the CPU weight of an ordinary program instead of a service's")
    parser.add_argument("--processor", type=ProcessorShare, metavar="MS/PERIOD_MS", help="nadird gets so many milliseconds of processor in each period (as root)")
    parser.add_argument("--check", nargs="?", const="all", choices=("rules", "all"),
                        help="exit code 1 when a limit is violated; rules: of docs/onboard.md and of the track, whatever else "
                             "keeps the machine busy; all: how quick it was and how much memory it took as well")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--nadird-option", action="append", default=[], metavar="WORD", help="one more word for nadird")
    parser.add_argument("--stand-in", metavar="OFFSET_M", type=float, help="no nadird: the truth with this offset as fixes")
    harness.add_words(parser, width=1920)
    args = parser.parse_args()
    if args.autopilot != "ardupilot" and (args.stand_in is not None or args.own_receiver != "second"):
        parser.error("--stand-in and --own-receiver are ArduPilot's")
    if args.autopilot == "px4-1.17" and args.signed:
        parser.error("PX4 signs its link from 1.18 on")
    return args


def report(args, flight, verdict, rules, readers, camera):
    watch = flight.watch
    found = verdict.shortfalls(everything=args.check != "rules") + [f"{rule.name}: {rule.found}, allowed: {rule.allowed}" for rule in rules
                                    if rule.met is False]
    if args.json:
        print(json.dumps({"figures": dict(verdict.figures()), "shortfalls": found, "summary": verdict.summary,
                          "service": verdict.service, "rules": [vars(rule) for rule in rules],
                          "memory_growth_percent": verdict.memory_growth_percent}, indent=1))
        return found
    print("\n".join(timeline(verdict.summary, watch.changes if watch else [], flight.begun_flying)) + "\n")
    for name, text in verdict.figures():
        print(f"{name:22}{text}")
    if verdict.memory_growth_percent is not None:
        print(f"{'memory of nadird':22}{max(mb for _, mb in watch.memory):.0f} MB, {verdict.memory_growth_percent:.1f} % "
              "growth after a minute")
    if args.readers:
        print(f"{'bad readers':22}{args.readers} at a time, {readers.opened} in all")
    print(f"{'load of the machine':22}{', '.join(f'{load:.1f}' for load in os.getloadavg())} (1, 5, 15 minutes)")
    print("\n".join(f"{'camera: ' + line.strip()}" for line in camera.splitlines()))
    if rules:
        print("\n" + "\n".join(lines_of(rules)) + "\n")
    print("\n".join(f"FALLS SHORT  {text}" for text in found) if found else "all as it should be")
    return found


def main():
    args = arguments()
    with harness.output(args, "loop") as out:
        run = harness.fresh(out / "run")
        inputs = Inputs(harness.inputs_folder(args, out), args.nadir, args.world_seed, args.size_km, width=args.width,
                        delay_s=args.delay_s, gps_id=0 if args.own_receiver == "second" else 1,
                        with_package=args.stand_in is None, airframe=args.airframe)
        events = args.event if args.event is not None else SCENARIOS[args.scenario]
        setup = Setup(inputs, run, args.nadir, args.nadird, events, args.minutes, args.fps, args.delay_s, args.seed,
                      args.own_receiver, args.signed, args.stand_in, not args.unfavoured, args.nadird_option,
                      autopilot=args.autopilot)
        with args.processor or contextlib.nullcontext() as setup.processor, Flight(setup) as flight, BadReaders(args.readers) as readers:
            flight.start()
            readers.begin(flight.api_port)
            flight.wait()
            summary, service = flight.finish()
        first = min((float(event.partition(":")[0]) for event in events), default=0.0)
        verdict = Verdict(summary, run / "flight" / "track.csv", first, service)
        verdict.memory_growth_percent = flight.watch.memory_growth() if flight.watch else None
        rules = judge(summary, verdict.rows, service, flight.watch.changes, 1 / args.fps) if service else []
        found = report(args, flight, verdict, rules, readers, flight.camera.tail(7))
        if args.report:
            write_page(args.report, inputs, verdict, rules)
    return 1 if args.check and found else 0


if __name__ == "__main__":
    sys.exit(main())
