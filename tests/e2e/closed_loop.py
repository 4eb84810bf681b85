#!/usr/bin/env python3
"""The closed loop: autopilot -> picture -> nadird -> GPS_INPUT -> autopilot.

The simulated autopilot flies a circuit over a simulated world by the position that it is given; `nadir simulate camera`
paints what its camera sees; `nadird` finds the position in the pictures. Prints how far the true track was from the plan,
how far the fixes were from the truth, the filter's resets, and a timeline. With --check the exit code is 1 when something
is not as it should be. docs/closed-loop.md.
"""
import argparse
import json
import os
import pathlib
import shutil
import socket
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from loop.inputs import Inputs
from loop.processes import Programs
from loop.run_summary import run_summary
from loop.verdict import Verdict, timeline
from loop.watch import Watch

SCENARIOS = {
    "denied": ["60:gps-denied"],
    "spoofed": ["60:gps-step=300@70"],
    "dragged": ["60:gps-drag=2@70"],
    "blackout": ["60:gps-denied", "120:camera-cut", "135:camera-restore"],
    "recovery": ["60:gps-step=300@70", "150:gps-recover"],
    "link": ["60:gps-denied", "120:link-cut", "128:link-restore"],
    "clock": ["60:gps-denied", "120:clock-step=3600", "180:clock-step=-7200"],
}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", choices=SCENARIOS, default="denied")
    parser.add_argument("--event", action="append", metavar="S:ACTION[=VALUE]", help="instead of a scenario's")
    parser.add_argument("--minutes", type=float, default=11)
    parser.add_argument("--fps", type=float, default=3)
    parser.add_argument("--width", type=int, default=1920, help="of the pictures")
    parser.add_argument("--delay-s", type=float, default=0.25, help="from exposure to picture, as airframe.json says")
    parser.add_argument("--seed", type=int, default=1, help="of the flight")
    parser.add_argument("--world-seed", type=int, default=7)
    parser.add_argument("--size-km", type=float, default=2)
    parser.add_argument("--out", help="folder for inputs, logs and results; a temporary one without")
    parser.add_argument("--own-receiver", choices=("first", "second"), default="second",
                        help="which GPS instance is real; GPS_INPUT plays the other")
    parser.add_argument("--signed", action="store_true", help="sign the link")
    parser.add_argument("--unfavoured", action="store_true",
                        help="no more weight than any other program has; else that of a service, where the kernel lets us")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--nadir", default=HERE.parent.parent / "build/bin/nadir")
    parser.add_argument("--nadird", default=HERE.parent.parent / "build/bin/nadird")
    parser.add_argument("--nadird-option", action="append", default=[], metavar="WORD", help="one more word for nadird")
    parser.add_argument("--stand-in", metavar="OFFSET_M", type=float, help="no nadird: the truth, so far off, as fixes")
    return parser.parse_args()


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as end:
        end.bind(("127.0.0.1", 0))
        return end.getsockname()[1]


def service(args, inputs, run, link_port, truth_port, api_port):
    """nadird's command line, or the stand-in's."""
    key = ["--key-file", inputs.key] if args.signed else []
    if args.stand_in is not None:
        return [sys.executable, "-B", HERE / "loop" / "stand_in.py", link_port, truth_port, "--offset-m", args.stand_in,
                *key]
    return [args.nadird, "--package", inputs.package, "--airframe", inputs.airframe, "--trust", inputs.root, "--at",
            inputs.created, "--state", run / "state", "--camera", f"folder:{run / 'frames'}", "--autopilot",
            f"udpin:127.0.0.1:{link_port}", "--record", run / "record", "--listen", f"127.0.0.1:{api_port}",
            *(["--signing-key", inputs.key] if args.signed else []), *args.nadird_option]


def fly(args, inputs, run):
    """(summary of the autopilot, watch, begun, what nadird says at the end, camera's report)"""
    link_port, truth_port, other_port, api_port = free_port(), free_port(), free_port(), free_port(socket.SOCK_STREAM)
    for name in ("frames", "state", "record"):
        (run / name).mkdir()
    events = args.event if args.event is not None else SCENARIOS[args.scenario]
    with Programs(run, favoured=not args.unfavoured) as programs:
        camera = programs.start("camera", [
            args.nadir, "simulate", "camera", "--world", inputs.world / "ground.tif", "--dem", inputs.world / "dem.tif",
            "--camera", inputs.camera, "--pose-from", f"udpin:127.0.0.1:{truth_port}", "--out", run / "frames", "--fps",
            args.fps, "--keep", 30, "--delay-s", args.delay_s])
        programs.wait_until_says(camera, "waiting for poses")
        companion = programs.start("service", service(args, inputs, run, link_port, other_port, api_port))
        if args.stand_in is not None:
            programs.wait_until_says(companion, "listening")
        watch = Watch(f"http://127.0.0.1:{api_port}", companion)
        begun = time.monotonic()
        autopilot = programs.start("autopilot", [
            sys.executable, "-B", HERE.parent / "support" / "autopilot.py", "--link", f"udpout:127.0.0.1:{link_port}",
            "--truth", f"udpout:127.0.0.1:{truth_port}", "--truth", f"udpout:127.0.0.1:{other_port}", "--waypoints",
            inputs.waypoints, "--altitude-m", inputs.altitude_m, "--terrain", inputs.terrain, "--duration",
            args.minutes * 60, "--seed", args.seed, "--own-receiver", args.own_receiver, "--log", run / "flight",
            *(["--key-file", inputs.key] if args.signed else []),
            *(word for event in events for word in ("--event", event))])
        if args.stand_in is None:
            watch.start()
        programs.wait_for(autopilot, args.minutes * 60 * 2 + 60)
        if watch.is_alive():
            watch.stop()
        code = companion.end()
        camera.end()
        if code != 0:
            raise SystemExit(f"service ended with {code}:\n{companion.tail()}")
        summary = json.loads((run / "flight" / "summary.json").read_text(encoding="utf-8"))
        return summary, watch, begun, run_summary(companion.text()), camera.tail(7)


def report(args, verdict, watch, begun, camera):
    growth = watch.memory_growth()
    verdict.memory_growth_percent = growth
    found = verdict.shortfalls()
    if args.json:
        print(json.dumps({"figures": dict(verdict.figures()), "shortfalls": found, "summary": verdict.summary,
                          "service": verdict.service, "memory_growth_percent": growth}, indent=1))
        return found
    print("\n".join(timeline(verdict.summary, watch.changes, begun)) + "\n")
    for name, text in verdict.figures():
        print(f"{name:22}{text}")
    if growth is not None:
        print(f"{'memory of nadird':22}{max(mb for _, mb in watch.memory):.0f} MB, {growth:.1f} % growth after a minute")
    print(f"{'load of the machine':22}{', '.join(f'{load:.1f}' for load in os.getloadavg())} (1, 5, 15 minutes)")
    print("\n".join(f"{'camera: ' + line.strip()}" for line in camera.splitlines()))
    print("\n".join(f"FALLS SHORT  {text}" for text in found) if found else "all as it should be")
    return found


def main():
    args = arguments()
    out = pathlib.Path(args.out or tempfile.mkdtemp(prefix="nadir-loop."))
    run = out / "run"
    if run.exists():
        shutil.rmtree(run)
    inputs = Inputs(out / "inputs", args.nadir, args.world_seed, args.size_km, width=args.width, delay_s=args.delay_s,
                    gps_id=0 if args.own_receiver == "second" else 1, with_package=args.stand_in is None)
    run.mkdir()
    try:
        summary, watch, begun, service_summary, camera = fly(args, inputs, run)
        events = args.event if args.event is not None else SCENARIOS[args.scenario]
        first = min((float(event.partition(":")[0]) for event in events), default=0.0)
        verdict = Verdict(summary, run / "flight" / "track.csv", first, service_summary)
        found = report(args, verdict, watch, begun, camera)
    finally:
        if args.out is None:
            shutil.rmtree(out, ignore_errors=True)
    return 1 if args.check and found else 0


if __name__ == "__main__":
    sys.exit(main())
