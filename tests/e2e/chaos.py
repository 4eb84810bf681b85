#!/usr/bin/env python3
"""Faults injected into nadird in the closed loop, in five parts:
  kill       it is killed every 30 s
  faults     disk full, link cut, clocks set, tiles spoilt, camera stalled, ten times the frames
  restarts   killed and started again on a full state disk, a taken port, a wrong clock, a torn file, a swapped package
  intruder   a second sender on the link
  tiles      the tile file corrupted and cut off
Prints a table of what was expected and what was found; the exit code is 1 when something is wrong. docs/closed-loop.md.
"""
import argparse
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from loop import faults, harness, intruder, kills, restarts, torn_tiles
from loop.evidence import table
from loop.inputs import Inputs

PARTS = {"kill": kills.fly, "faults": faults.fly, "restarts": restarts.fly, "intruder": intruder.fly, "tiles": torn_tiles.fly}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS, help="this part alone")
    parser.add_argument("--kill-minutes", type=float, default=10, help="killed every 30 s for so long")
    harness.add_words(parser, width=1280)
    return parser.parse_args()


def main():
    args = arguments()
    findings = []
    with harness.output(args, "chaos") as out:
        inputs = Inputs(harness.inputs_folder(args, out), args.nadir, width=args.width)
        for name in [args.only] if args.only else PARTS:
            findings += PARTS[name](args, inputs, harness.fresh(out / name))
    print(table(findings))
    print(f"load of the machine: {', '.join(f'{load:.1f}' for load in os.getloadavg())} (1, 5, 15 minutes)")
    return 0 if all(finding.met for finding in findings) else 1


if __name__ == "__main__":
    sys.exit(main())
