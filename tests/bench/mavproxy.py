#!/usr/bin/env python3
"""MAVProxy itself as the ground station of a simulated flight (`nadir simulate loop`): what it shows of nadird, and what it gets for a
position hint. docs/autopilot.md.

usage: mavproxy.py [--mavproxy PROGRAM] [--transcript FILE]

MAVProxy (`pip install MAVProxy`, in an environment of its own) is looked for in NADIR_BENCH_VENV and on PATH; without it: NOT RUN.
It runs without windows, and hints are typed: its `command_int` sends the bytes of its map's "Set Position". Exit code 1: something
that it should have shown is missing."""
import argparse
import pathlib
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time

from measured import BUILD, must, tool

FIGURES = ("NDR_STATE", "NDR_SIGMA", "NDR_HPL", "NDR_ANCHOR")
PATIENCE_S = 90


class Program:
    """A program whose lines are kept as they come."""

    def __init__(self, command):
        self.process = subprocess.Popen([str(word) for word in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.STDOUT, text=True, bufsize=1)
        self.lines = []
        threading.Thread(target=lambda: self.lines.extend(line.rstrip() for line in self.process.stdout), daemon=True).start()

    def type(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def wait_for(self, pattern, after=0, patience_s=PATIENCE_S):
        """What matches in the first such line of those after so many; None when there is none."""
        until = time.monotonic() + patience_s
        while time.monotonic() < until:
            for line in self.lines[after:]:
                if found := re.search(pattern, line):
                    return found[0]
            time.sleep(0.1)
        return None

    def end(self):
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:  # MAVProxy waits for its input
            self.process.kill()
            self.process.wait()


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        return end.getsockname()[1]


def middle_of(world):
    """Of the mission's take-off: a place on the map, in the units of COMMAND_INT."""
    found = re.search(r"takeoff: \[?\{?.*?(-?\d+\.\d+)\D+?(-?\d+\.\d+)", (world / "mission.yaml").read_text())
    return round(float(found[2]) * 1e7), round(float(found[1]) * 1e7)


def show(what, seen):
    print(f"| {what} | {f'`{seen}`' if seen else 'MISSING'} |", flush=True)
    return bool(seen)


def fly(mavproxy, work):
    """(everything was there, MAVProxy's lines)."""
    world, port = work / "world", free_port()
    must([BUILD / "nadir", "simulate", "world", "--seed", 7, "--size-km", 0.8, "--gsd-m", 0.5, "--out", world, "--quiet"])
    lat, lon = middle_of(world)
    flight = Program([BUILD / "nadir", "simulate", "loop", "--world", world, "--nadird", BUILD / "nadird", "--port", 0, "--minutes", 1.5,
                      "--ground-station", f"udpout:127.0.0.1:{port}"])
    # The only one that it hears is nadird, which it does not take for an autopilot: it must be told the aircraft's system id.
    station = Program([mavproxy, f"--master=udpin:127.0.0.1:{port}", "--target-system=1", "--force-connected", f"--state-basedir={work}",
                       "--cmd=watch NAMED_VALUE_FLOAT HEARTBEAT COMMAND_ACK"])
    try:
        if not flight.wait_for("nadird's page", patience_s=300):
            raise SystemExit("the flight did not begin: " + "; ".join(flight.lines[-3:]))
        print("| | MAVProxy showed |\n|---|---|")
        fine = show("heartbeat", station.wait_for(r"HEARTBEAT \{type : 18, .*"))
        for name in FIGURES:
            fine &= show(name, station.wait_for(rf"NAMED_VALUE_FLOAT \{{.*name : {name}, .*"))
        fine &= show("a text", station.wait_for(r"AP: Nadir: .*"))
        for what, accuracy, off, answer in (("a hint on the map", 100, 0, 0), ("one without an accuracy", 0, 0, 2),
                                            ("one off the map", 100, 10**7, 2)):
            time.sleep(3)  # nadird takes one in two seconds
            after = len(station.lines)
            station.type(f"command_int GLOBAL EXTERNAL_POSITION_ESTIMATE 0 0 0 0 {accuracy} 0 {lat + off} {lon} nan")
            fine &= show(what, station.wait_for(rf"COMMAND_ACK \{{command : 43003, result : {answer}, .*", after, 20))
        return fine, station.lines
    finally:
        station.end()
        flight.end()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mavproxy", default=tool("mavproxy.py"))
    parser.add_argument("--transcript", type=pathlib.Path, help="what MAVProxy printed")
    options = parser.parse_args()
    if not options.mavproxy:
        print("NOT RUN: MAVProxy is not installed; to do: python3 -m venv DIR && DIR/bin/pip install MAVProxy, NADIR_BENCH_VENV=DIR")
        return 0
    with tempfile.TemporaryDirectory(prefix="nadir-mavproxy-") as folder:
        fine, lines = fly(options.mavproxy, pathlib.Path(folder))
    if options.transcript:
        options.transcript.write_text("\n".join(lines) + "\n")
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
