#!/usr/bin/env python3
"""An autopilot that flies a circuit by the position that it is given, for tests and for the closed loop.

It sends its telemetry on --link, receives GPS_INPUT there, and sends the truth (SIM_STATE) on --truth. Prints its events,
and at the end its figures; --log keeps track.csv and summary.json. docs/closed-loop.md.
"""
import argparse
import csv
import json
import pathlib
import signal
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from simulated_autopilot.flight_log import FlightLog
from simulated_autopilot.link import Link, open_transport
from simulated_autopilot.scenario import ACTIONS, parse_event
from simulated_autopilot.terrain import Flat, Grid
from simulated_autopilot.vehicle import Options, Vehicle

FALLS_BEHIND_S = 1.0


def arguments(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--link", required=True, metavar="URL", help="udpout:HOST:PORT or file:PATH of a terminal")
    parser.add_argument("--truth", action="append", default=[], metavar="URL", help="where SIM_STATE goes, unsigned")
    parser.add_argument("--waypoints", required=True, metavar="FILE.csv", help="lat_deg,lon_deg of the circuit's corners")
    parser.add_argument("--altitude-m", type=float, required=True, help="above the sea")
    parser.add_argument("--terrain", metavar="M|FILE.asc", default="0", help="height of the ground, or a grid in degrees")
    parser.add_argument("--duration", type=float, default=600, metavar="S", help="simulated seconds")
    parser.add_argument("--speed", type=float, default=1, metavar="N", help="times real time; 0 as fast as it goes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--airspeed", type=float, default=22, metavar="M/S")
    parser.add_argument("--wind", type=float, nargs=2, default=(3, -2), metavar=("NORTH", "EAST"), help="blowing to")
    parser.add_argument("--event", action="append", default=[], metavar="S:ACTION[=VALUE[@BEARING]]",
                        help="one of " + ", ".join(ACTIONS))
    parser.add_argument("--key-file", metavar="FILE", help="64 hexadecimal digits: sign, and refuse what is not signed")
    parser.add_argument("--own-receiver", choices=("first", "second"), default="second",
                        help="which of the two GPS instances is real; GPS_INPUT plays the other")
    parser.add_argument("--fault", action="append", default=[], help="misbehave: see simulated_autopilot/protocol.py")
    parser.add_argument("--parameter", action="append", default=[], metavar="NAME=VALUE", help="as it is at the start")
    parser.add_argument("--px4", metavar="VERSION", help="PX4 of this version, such as 1.18, instead of ArduPilot")
    parser.add_argument("--disarmed", action="store_true", help="say so: as on the ground, for provisioning")
    parser.add_argument("--epoch-us", type=int, help="UTC at the start; now without")
    parser.add_argument("--log", metavar="DIR", help="for track.csv and summary.json")
    parser.add_argument("--quiet", action="store_true")
    return parser.parse_args(argv)


def waypoints(path):
    with open(path, newline="", encoding="utf-8") as file:
        return [(float(row["lat_deg"]), float(row["lon_deg"])) for row in csv.DictReader(file)]


def build(args):
    try:
        terrain = Flat(float(args.terrain))
    except ValueError:
        terrain = Grid(args.terrain)
    options = Options(
        corners=waypoints(args.waypoints), altitude=args.altitude_m, seed=args.seed, airspeed=args.airspeed,
        wind=tuple(args.wind), terrain=terrain, events=[parse_event(text) for text in args.event],
        gps_input_instance=0 if args.own_receiver == "second" else 1, faults=tuple(args.fault),
        unix_us=args.epoch_us if args.epoch_us is not None else time.time_ns() // 1000)
    if args.px4:
        options.px4_version = tuple(int(number) for number in args.px4.split("."))[:2]
    key = bytes.fromhex(pathlib.Path(args.key_file).read_text(encoding="ascii").strip()) if args.key_file else None
    echo = None if args.quiet else lambda line: print(line, flush=True)
    truth = [Link(open_transport(url)) for url in args.truth]
    vehicle = Vehicle(options, Link(open_transport(args.link), key), truth, FlightLog(args.log, echo))
    vehicle.armed = not args.disarmed
    for text in args.parameter:
        name, value = text.split("=")
        vehicle.protocol.set_text(name, value)
    return vehicle


def fly(vehicle, duration, speed, stopped):
    begun = time.monotonic()
    while vehicle.now_s < duration and not stopped():
        vehicle.step()
        if speed <= 0:
            continue
        ahead = vehicle.now_s / speed - (time.monotonic() - begun)
        if ahead > 0:
            time.sleep(ahead)
        elif ahead < -FALLS_BEHIND_S:
            vehicle.log.event(vehicle.now_s, "late", seconds=round(-ahead, 2))
            begun -= ahead


def main():
    args = arguments()
    try:
        vehicle = build(args)
    except (OSError, ValueError, KeyError, IndexError) as error:
        print(f"autopilot: {error}", file=sys.stderr)
        return 2
    stop = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.append(True))
    fly(vehicle, args.duration, args.speed, lambda: bool(stop))
    summary = vehicle.summary()
    vehicle.log.close(summary)
    print(json.dumps(summary, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
