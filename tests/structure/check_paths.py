#!/usr/bin/env python3
"""Fails when a program names the folder that it was compiled in: then another folder gives other bytes.

usage: check_paths.py FOLDER PROGRAM...
"""
import pathlib
import re
import sys


def named(folder, program):
    """What the program says of the folder, each once."""
    return sorted(set(re.findall(re.escape(folder.encode()) + rb"[\w./+-]*", program.read_bytes())))


def main():
    if len(sys.argv) < 3:
        print(__doc__, file=sys.stderr)
        return 2
    bad = 0
    for program in map(pathlib.Path, sys.argv[2:]):
        for name in named(sys.argv[1], program)[:10]:
            print(f"{program.name} names the folder that it was compiled in: {name.decode()}")
            bad += 1
    if bad == 0:
        print("paths: the programs do not name where they were compiled")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
