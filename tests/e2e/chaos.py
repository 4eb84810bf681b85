#!/usr/bin/env python3
"""What flights do to software, done to nadird in the closed loop: it is killed again and again; disk full, link cut, clocks
set, tiles spoilt, camera stalled, ten times the pictures. Prints a table of what was expected and what was found; the exit
code is 1 when something is off. docs/closed-loop.md.
"""
import argparse
import os
import pathlib
import shutil
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from loop import faults, kills
from loop.evidence import table
from loop.inputs import Inputs

PARTS = {"kill": kills.fly, "faults": faults.fly}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--kill-minutes", type=float, default=10, help="killed every 30 s for so long")
    parser.add_argument("--width", type=int, default=1280, help="of the pictures")
    parser.add_argument("--inputs", help="folder of world, package and the rest, where they are made already")
    parser.add_argument("--out", help="folder for inputs, logs and recordings; a temporary one without")
    parser.add_argument("--nadir", default=HERE.parent.parent / "build/bin/nadir")
    parser.add_argument("--nadird", default=HERE.parent.parent / "build/bin/nadird")
    return parser.parse_args()


def main():
    args = arguments()
    out = pathlib.Path(args.out or tempfile.mkdtemp(prefix="nadir-chaos."))
    findings = []
    try:
        inputs = Inputs(args.inputs or out / "inputs", args.nadir, width=args.width)
        for name in [args.only] if args.only else PARTS:
            run = out / name
            if run.exists():
                shutil.rmtree(run)
            run.mkdir(parents=True)
            findings += PARTS[name](args, inputs, run)
    finally:
        if args.out is None:
            shutil.rmtree(out, ignore_errors=True)
    print(table(findings))
    print(f"load of the machine: {', '.join(f'{load:.1f}' for load in os.getloadavg())} (1, 5, 15 minutes)")
    return 0 if all(finding.met for finding in findings) else 1


if __name__ == "__main__":
    sys.exit(main())
