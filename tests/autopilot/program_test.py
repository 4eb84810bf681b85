#!/usr/bin/env python3
"""tests/support/autopilot.py as a program: over UDP and a pseudo-terminal, its log, its refusals."""
import csv
import json
import os
import pathlib
import select
import socket
import subprocess
import sys
import tempfile
import tty
import unittest

import support
from simulated_autopilot.terrain import Grid

PROGRAM = pathlib.Path(__file__).resolve().parent.parent / "support" / "autopilot.py"


class Program(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.waypoints = self.folder / "waypoints.csv"
        self.waypoints.write_text("lat_deg,lon_deg\n" + "".join(f"{lat},{lon}\n" for lat, lon in support.CORNERS))

    def run_program(self, *args, link="udpout:127.0.0.1:9", altitude="600"):
        return subprocess.run([sys.executable, "-B", PROGRAM, "--link", link, "--waypoints", self.waypoints,
                               "--altitude-m", altitude, "--speed", "0", *map(str, args)], capture_output=True, text=True,
                              timeout=100, stdin=subprocess.DEVNULL, check=False)

    def test_writes_a_reproducible_log(self):
        for name in ("a", "b"):
            result = self.run_program("--duration", 30, "--event", "10:gps-denied", "--epoch-us", 10 ** 15, "--log",
                                      self.folder / name)
            self.assertEqual((0, ""), (result.returncode, result.stderr))
            self.assertIn("gps-denied", result.stdout)
        for file in ("track.csv", "summary.json"):
            self.assertEqual((self.folder / "a" / file).read_bytes(), (self.folder / "b" / file).read_bytes())
        with open(self.folder / "a" / "track.csv", newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual(300, len(rows))
        summary = json.loads((self.folder / "a" / "summary.json").read_text())
        worst = max(float(row["deviation_m"]) for row in rows)
        self.assertAlmostEqual(summary["deviation_m"]["max"], worst, delta=0.01)
        self.assertEqual(["own", "none"], [event["now"] for event in summary["events"] if event["kind"] == "source"])

    def test_communicates_over_datagrams(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
            end.bind(("127.0.0.1", 0))
            self.run_program("--duration", 1, link=f"udpout:127.0.0.1:{end.getsockname()[1]}")
            end.setblocking(False)
            mav = support.dialect.MAVLink(None)
            self.assertEqual("HEARTBEAT", mav.parse_buffer(end.recv(65536))[0].get_type())

    def test_communicates_over_a_pseudo_terminal(self):
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        try:
            process = subprocess.Popen([sys.executable, "-B", PROGRAM, "--link", f"file:{os.ttyname(theirs)}", "--waypoints",
                                        self.waypoints, "--altitude-m", "600", "--duration", "60", "--quiet"],
                                       stdout=subprocess.DEVNULL)
            try:
                mav = support.dialect.MAVLink(None)
                mav.robust_parsing = True
                received = set()
                while "HEARTBEAT" not in received:
                    self.assertTrue(select.select([ours], [], [], 60)[0], "nothing came")
                    received |= {m.get_type() for m in mav.parse_buffer(os.read(ours, 4096)) or []}
            finally:
                process.terminate()
                self.assertEqual(0, process.wait(60))
        finally:
            os.close(ours)
            os.close(theirs)

    def test_rejects_invalid_missions(self):
        for args, word in ((("--event", "5:nothing"), "nothing"), (("--key-file", self.folder / "none"), "none"),
                           (("--terrain", self.folder / "none.asc"), "none.asc")):
            result = self.run_program("--duration", 1, *args)
            self.assertEqual(2, result.returncode, args)
            self.assertIn(word, result.stderr)
        self.assertEqual(2, self.run_program(link="carrier:pigeon").returncode)
        self.waypoints.write_text("lat_deg,lon_deg\n48,14\n")
        self.assertEqual(2, self.run_program().returncode)

    def test_a_grid_of_heights(self):
        path = self.folder / "dem.asc"
        path.write_text("ncols 3\nnrows 2\nxllcorner 14.0\nyllcorner 48.0\ncellsize 0.5\nNODATA_value -9999\n"
                        "10 20 30\n40 50 60\n")
        grid = Grid(path)
        self.assertEqual(10, grid.height(48.75, 14.25))
        self.assertEqual(60, grid.height(48.25, 15.25))
        self.assertEqual(30, grid.height(48.5, 14.5))
        self.assertEqual(10, grid.height(60, 0))
        path.write_text(path.read_text().replace("60", "-9999"))
        self.assertEqual(30, Grid(path).height(48.25, 15.25))  # the mean of what is known
        path.write_text(path.read_text() + "1\n")
        with self.assertRaises(ValueError):
            Grid(path)


if __name__ == "__main__":
    unittest.main(verbosity=2)
