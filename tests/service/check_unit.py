#!/usr/bin/env python3
"""systemd itself judges a service's unit, with the program where it was built.

usage: check_unit.py UNIT PROGRAM EXPOSURE
EXPOSURE: the most that `systemd-analyze security` may find, in tenths: 17 is 1.7 of 10.
Exit code 77 (skipped) where there is no systemd-analyze.
"""
import pathlib
import shutil
import subprocess
import sys
import tempfile


def complaints(text, folder, name):
    """systemd's findings on our unit; those on other units of this computer are ignored."""
    unit = pathlib.Path(folder) / name
    unit.write_text(text)
    result = subprocess.run(["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True)
    return [line for line in result.stderr.splitlines() if unit.stem in line]


def main():
    if shutil.which("systemd-analyze") is None:
        print("skipped: no systemd-analyze here")
        return 77
    unit, program, exposure = pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    text, installed = unit.read_text(), f"/usr/bin/{unit.stem}"
    assert f"ExecStart={installed} " in text
    text = text.replace(installed, program)
    with tempfile.TemporaryDirectory(prefix="nadir-unit.") as folder:
        bad = complaints(text, folder, unit.name)
        if bad:
            print("\n".join(bad))
            return 1
        # The judge must be able to refuse.
        for right, wrong in (("TimeoutStopSec=", "TimeoutStpSec="), ("Type=", "Type=shout"), (program, "/no/such")):
            assert right in text, right
            if not complaints(text.replace(right, wrong), folder, unit.name):
                print(f"systemd accepts {wrong}: it judges nothing")
                return 1
        (pathlib.Path(folder) / unit.name).write_text(text)
        judged = subprocess.run(["systemd-analyze", "security", "--offline=yes", "--no-pager", f"--threshold={exposure}",
                                 f"{folder}/{unit.name}"], capture_output=True, text=True)
        print(judged.stdout.rstrip().splitlines()[-1])
        if judged.returncode != 0:
            print(judged.stdout + judged.stderr)
            return 1
    print("unit: fine")
    return 0


if __name__ == "__main__":
    sys.exit(main())
