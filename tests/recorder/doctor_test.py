#!/usr/bin/env python3
"""The result of the MCAP project's own `mcap doctor` for the recorder's files: no error in those that ended cleanly, nor in what
`nadir recorder recover` makes of the others, and no warning but those that we mean. 77, "skipped", where no `mcap` command with a doctor is in PATH.

usage: doctor_test.py NADIR RECORD_SAMPLE
"""
import json
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import unittest

NADIR, RECORD_SAMPLE = sys.argv[1:3]
SKIPPED = 77
# A profile of our own; schemas and channels a second time in the second chunk, for a file whose first one is damaged.
MEANT = ('field "nadir" is not a well-known profile', "Duplicate schema records", "Duplicate channel records")


def run(*args):
    return subprocess.run([*map(str, args)], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120)


def doctor(file):
    """(whether it accepts the file, what it says but for the name of the file and what we mean)"""
    result = run("mcap", "doctor", file)
    lines = (result.stdout + result.stderr).splitlines()
    return result.returncode == 0, [line for line in lines if not line.startswith("Examining")
                                    and not any(words in line for words in MEANT)]


class Doctor(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory(prefix="nadir-doctor.")
        self.addCleanup(self.temporary.cleanup)
        self.folder = pathlib.Path(self.temporary.name)

    def healthy(self, folder):
        files = sorted(folder.glob("*.mcap"))
        self.assertTrue(files)
        for file in files:
            with self.subTest(file.name):
                self.assertEqual((True, []), doctor(file))

    def record(self):
        self.assertEqual(0, run(RECORD_SAMPLE, self.folder / "r").returncode)
        return self.folder / "r"

    def test_accepts_a_clean_recording(self):
        self.healthy(self.record())

    def test_finds_damage(self):
        spoilt = next(self.record().glob("*.flight.mcap"))
        data = bytearray(spoilt.read_bytes())
        data[len(data) // 2] ^= 0xFF
        spoilt.write_bytes(bytes(data))
        self.assertFalse(doctor(spoilt)[0])

    def test_accepts_a_recording_recovered_after_a_kill(self):
        choice = random.Random(5)
        for attempt in range(3):
            killed, recovered = self.folder / str(attempt), self.folder / f"{attempt}.recovered"
            recorder = subprocess.Popen([RECORD_SAMPLE, str(killed), "forever"], stdout=subprocess.PIPE, text=True)
            for _ in range(choice.randint(20, 300)):
                recorder.stdout.readline()
            recorder.kill()
            recorder.wait()
            recorder.stdout.close()
            *whole, cut = sorted(killed.glob("*.mcap"))
            for file in whole:
                self.assertEqual((True, []), doctor(file))
            self.assertFalse(doctor(cut)[0])
            result = run(NADIR, "recorder", "recover", killed, "--out", recovered)
            self.assertEqual(0, result.returncode, result.stderr)
            self.healthy(recovered)

    def test_counts_the_same_number_of_records(self):
        info = json.loads(run(NADIR, "recorder", "info", self.record(), "--json").stdout)["sessions"][0]["records"]
        counted = 0
        for file in (self.folder / "r").glob("*.mcap"):
            line = next(line for line in run("mcap", "info", file).stdout.splitlines() if line.startswith("messages:"))
            counted += int(line.split()[-1])
        self.assertEqual(sum(info.values()), counted)


if __name__ == "__main__":
    if shutil.which("mcap") is None or run("mcap", "doctor", "--help").returncode != 0:
        print("SKIPPED: no `mcap` command with a doctor in PATH (https://mcap.dev/guides/cli)")
        sys.exit(SKIPPED)
    unittest.main(argv=sys.argv[:1])
