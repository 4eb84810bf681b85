#!/usr/bin/env python3
"""systemd itself judges runtime/nadird.service, with the program where it was built.

usage: check_unit.py UNIT PROGRAM
Exit code 77 (skipped) where there is no systemd-analyze.
"""
import pathlib
import shutil
import subprocess
import sys
import tempfile

MAX_EXPOSURE = "17"  # of `systemd-analyze security`, in tenths: at most 1.7 of 10


def complaints(text, folder):
    """systemd's findings on our unit; those on other units of this computer are ignored."""
    unit = pathlib.Path(folder) / "nadird.service"
    unit.write_text(text)
    result = subprocess.run(["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True)
    return [line for line in result.stderr.splitlines() if "nadird" in line]


def main():
    if shutil.which("systemd-analyze") is None:
        print("skipped: no systemd-analyze here")
        return 77
    text = pathlib.Path(sys.argv[1]).read_text()
    assert "ExecStart=/usr/bin/nadird " in text
    text = text.replace("/usr/bin/nadird", sys.argv[2])
    with tempfile.TemporaryDirectory(prefix="nadir-unit.") as folder:
        bad = complaints(text, folder)
        if bad:
            print("\n".join(bad))
            return 1
        # The judge must be able to refuse.
        for right, wrong in (("WatchdogSec=", "WatchdgSec="), ("Type=notify", "Type=shout"), (sys.argv[2], "/no/such")):
            assert right in text, right
            if not complaints(text.replace(right, wrong), folder):
                print(f"systemd accepts {wrong}: it judges nothing")
                return 1
        (pathlib.Path(folder) / "nadird.service").write_text(text)
        judged = subprocess.run(["systemd-analyze", "security", "--offline=yes", "--no-pager", f"--threshold={MAX_EXPOSURE}",
                                 f"{folder}/nadird.service"], capture_output=True, text=True)
        if judged.returncode != 0:
            print(judged.stdout + judged.stderr)
            return 1
    print("unit: fine")
    return 0


if __name__ == "__main__":
    sys.exit(main())
