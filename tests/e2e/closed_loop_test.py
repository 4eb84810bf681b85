#!/usr/bin/env python3
"""The harness of the closed loop, with a stand-in for the service: the loop closes, and the verdict is right."""
import csv
import json
import pathlib
import subprocess
import sys
import unittest

import support
from loop.inputs import Inputs
from loop.run_summary import run_summary
from loop.verdict import Verdict, timeline
from loop.watch import Watch

HARNESS = pathlib.Path(__file__).resolve().parent / "closed_loop.py"


class Loop(support.EndToEnd):
    def test_closes_with_pictures_and_fixes(self):
        result = subprocess.run(
            [sys.executable, "-B", HARNESS, "--nadir", support.NADIR, "--stand-in", "0", "--minutes", "0.12", "--event",
             "3:gps-denied", "--size-km", "0.8", "--width", "320", "--signed", "--json", "--out", self.folder / "loop"],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=400, check=False)
        self.assertEqual((0, ""), (result.returncode, result.stderr))
        summary = json.loads(result.stdout)["summary"]
        self.assertAlmostEqual(7.2, summary["duration_s"], delta=0.1)
        self.assertGreater(summary["gps_input"]["accepted"], 0)
        self.assertEqual(0, summary["link"]["refused"])
        self.assertTrue(list((self.folder / "loop/run/frames").glob("frame_*.jpg")))


class Flight(support.EndToEnd):
    """nadird itself, in real time, over a signed link. What depends on how busy the machine is, is not judged."""

    def test_nadird_carries_an_aircraft_that_loses_gps(self):
        out = self.folder / "flight"
        result = subprocess.run(
            [sys.executable, "-B", HARNESS, "--nadir", support.NADIR, "--nadird", support.NADIRD, "--minutes", "0.9",
             "--event", "25:gps-denied", "--fps", "2", "--width", "640", "--signed", "--json", "--nadird-option=--keep-pictures",
             "--out", out],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=500, check=False)
        self.assertEqual(0, result.returncode, result.stderr)
        summary = json.loads(result.stdout)["summary"]
        self.assertGreater(summary["gps_input"].get("accepted", 0), 100, summary["gps_input"])
        self.assertLess(summary["fix_error_m"]["max"], 50)
        self.assertLess(summary["deviation_m"]["max"], 60)
        self.assertEqual(0, summary["resets_by_gps_input"])
        self.assertEqual(0, summary["link"]["refused"])
        recorded = subprocess.run([support.NADIR, "recorder", "verify", out / "run/record"], capture_output=True,
                                  text=True, timeout=60, check=False)
        self.assertEqual(0, recorded.returncode, recorded.stdout + recorded.stderr)
        self.flies_again(out)

    def flies_again(self, out):
        """What was recorded in the air gives the same estimates on the ground, to the last bit."""
        created = Inputs(out / "inputs", support.NADIR, width=640).created
        again = self.good("replay", "--recorder", out / "run/record", "--package", out / "inputs/package", "--trust",
                          out / "inputs/root.json", "--at", created, "--out", out / "again", "--json", "--quiet")
        reproduced = json.loads(again.stdout)["reproduced"]
        self.assertGreater(reproduced["compared"], 60)
        self.assertEqual(reproduced["compared"], reproduced["same"], reproduced)


class Judging(support.EndToEnd):
    def verdict(self, rows=(), service=None, **changes):
        path = self.folder / "track.csv"
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerows([("time_s", "source"), *rows])
        figures = {"median": 3, "p95": 5, "max": 9, "count": 100}
        summary = {"duration_s": 10, "plan_m": 1000, "deviation_m": figures, "fix_error_m": figures,
                   "gps_input_spacing_max_s": 0.12, "gps_input_late": 0, "resets": [], "resets_by_gps_input": 0,
                   "gps_input": {"accepted": 3}, "events": []}
        return Verdict({**summary, **changes}, path, 2, service)

    def test_finds_what_falls_short(self):
        self.assertEqual([], self.verdict().shortfalls())
        bad = {"median": 11, "p95": 90, "max": 120, "count": 9}
        for changes, word in (({"deviation_m": {**bad, "median": 1}}, "leaves the plan"),
                              ({"deviation_m": {**bad, "max": 12}}, "median"), ({"resets_by_gps_input": 1}, "reset"),
                              ({"fix_error_m": bad}, "off"), ({"fix_error_m": None}, "no fix"),
                              ({"gps_input_spacing_max_s": 0.5}, "paused")):
            found = self.verdict(**changes).shortfalls()
            self.assertEqual(1, len(found), found)
            self.assertIn(word, found[0])

    def test_reads_what_nadird_says_of_itself(self):
        log = ("710 pictures, 3 dropped; picture to fix p50 117, p95 392, max 1270 ms; 2300 fixes, longest pause 320 ms\n")
        service = run_summary("something else\n" + log)
        self.assertEqual((710, 3, 392, 320), tuple(service[name] for name in ("pictures", "dropped", "p95_ms",
                                                                               "longest_pause_ms")))
        self.assertIsNone(run_summary("it ended before"))
        self.assertIn("392 ms", self.verdict(service=service).shortfalls()[0])
        self.assertEqual([], self.verdict(service={**service, "p95_ms": 100}).shortfalls())
        self.assertIn("dropped", self.verdict(service={**service, "p95_ms": 100, "dropped": 200}).shortfalls()[0])

    def test_counts_from_the_trouble_on(self):
        rows = [(0, "own"), (2, "none"), (4, "gps_input"), (6, "gps_input"), (8, "none")]
        verdict = self.verdict(rows)
        self.assertEqual(2, verdict.promotion_s())
        self.assertEqual(0.5, verdict.share_given())
        self.assertIsNone(self.verdict().promotion_s())

    def test_the_timeline_is_in_order(self):
        events = [{"time_s": 5.0, "kind": "scenario", "what": "gps-denied"}, {"time_s": 1.0, "kind": "parameter", "name": "X"}]
        changes = [(103.0, "state", "boot", "normal", "because"), (100.0, "gps", None, "good", "")]
        lines = timeline({"events": events}, changes, 100.0)
        self.assertEqual(2, len(lines))
        self.assertIn("boot -> normal (because)", lines[0])
        self.assertIn("gps-denied", lines[1])

    def test_memory_is_judged_after_the_first_minute(self):
        watch = Watch("http://127.0.0.1:1")
        watch.memory = [(t, 50 if t < 60 else 100 + (t == 90)) for t in range(100)]
        self.assertAlmostEqual(1, watch.memory_growth())
        watch.memory = watch.memory[:40]
        self.assertIsNone(watch.memory_growth())


if __name__ == "__main__":
    support.main()
