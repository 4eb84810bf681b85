#!/usr/bin/env python3
"""The harness of the closed loop, with a stand-in for the service: the loop closes, and the verdict is correct."""
import csv
import json
import pathlib
import shutil
import subprocess
import sys
import unittest

import support
from loop import evidence, kills, proofs, rules, scenes
from loop.inputs import Inputs
from loop.run_summary import run_summary
from loop.verdict import Verdict, timeline
from loop.watch import Watch

HARNESS = pathlib.Path(__file__).resolve().parent / "closed_loop.py"


class Loop(support.EndToEnd):
    def test_closes_with_frames_and_fixes(self):
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
    """nadird itself, in real time, over a signed link. What depends on the load of the machine is not checked."""

    def test_nadird_navigates_an_aircraft_without_gps(self):
        out = self.folder / "flight"
        result = subprocess.run(
            [sys.executable, "-B", HARNESS, "--nadir", support.NADIR, "--nadird", support.NADIRD, "--minutes", "0.6",
             "--event", "12:gps-denied", "--fps", "2", "--width", "640", "--signed", "--json", "--nadird-option=--keep-frames",
             "--nadird-option=--inertial", "--out", out, "--report", out / "live.html"],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=500, check=False)
        self.assertEqual(0, result.returncode, result.stderr)
        summary = json.loads(result.stdout)["summary"]
        self.assertGreater(summary["gps_input"].get("accepted", 0), 100, summary["gps_input"])
        self.assertLess(summary["fix_error_m"]["max"], 50)
        self.assertLess(summary["deviation_m"]["max"], 60)
        self.assertEqual(0, summary["resets_by_gps_input"], summary["resets"])
        self.assertEqual(0, summary["link"]["refused"])
        self.assertNotIn("Nadir: airframe file is not signed", [event.get("text") for event in summary["events"]])
        page = (out / "live.html").read_text(encoding="utf-8")
        for part in ('class="track given"', 'class="curve sigma"', "GPS denied to navigating by our fix", "data:image/jpeg"):
            self.assertIn(part, page)
        self.assertNotIn("{{", page)
        recorded = subprocess.run([support.NADIR, "recorder", "verify", out / "run/record"], capture_output=True,
                                  text=True, timeout=60, check=False)
        self.assertEqual(0, recorded.returncode, recorded.stdout + recorded.stderr)
        self.flies_again(out)
        self.flies_with_px4(out)

    def flies_with_px4(self, out):
        """The same world, PX4's messages and rules."""
        result = subprocess.run(
            [sys.executable, "-B", HARNESS, "--nadir", support.NADIR, "--nadird", support.NADIRD, "--minutes", "0.4",
             "--event", "8:gps-denied", "--fps", "2", "--width", "640", "--signed", "--json", "--autopilot", "px4",
             "--inputs", out / "inputs", "--out", out / "px4"],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=300, check=False)
        self.assertEqual(0, result.returncode, result.stderr)
        summary = json.loads(result.stdout)["summary"]
        self.assertGreater(summary["gps_input"].get("accepted", 0), 100, summary["gps_input"])
        self.assertLess(summary["fix_error_m"]["max"], 50)
        self.assertLess(summary["deviation_m"]["max"], 60)
        self.assertEqual(0, summary["resets_by_gps_input"], summary["resets"])
        received = summary["received"]
        self.assertGreater(received.get("GLOBAL_POSITION_SENSOR", 0), 100, received)
        self.assertGreater(received.get("NAMED_VALUE_FLOAT", 0), 60, received)
        self.assertNotIn("GPS_INPUT", received)
        self.assertIn("Nadir: autopilot now navigating by Nadir", [event.get("text") for event in summary["events"]])

    def replay(self, out, recording, name):
        created = Inputs(out / "inputs", support.NADIR, width=640).created
        return support.run("replay", "--recorder", recording, "--package", out / "inputs/package", "--trust",
                           out / "inputs/root.json", "--at", created, "--out", out / name, "--json", "--quiet")

    def flies_again(self, out):
        """A recording of the flight replays bit for bit: estimates, and the fixes that were sent."""
        again = self.replay(out, out / "run/record", "again")
        self.assertEqual(0, again.returncode, again.stderr)
        reproduced = json.loads(again.stdout)["reproduced"]
        self.assertGreater(reproduced["compared"], 40)
        self.assertEqual(reproduced["compared"], reproduced["same"], reproduced)
        fixes = json.loads(again.stdout)["fixes"]
        self.assertGreater(fixes["compared"], 200)
        self.assertEqual({"compared": fixes["compared"], "identical": fixes["compared"], "not_compared": []}, fixes)
        self.good("recorder", "export", out / "run/record", "--format", "csv", "--out", out / "tables")
        exported = (out / "tables/fixes.csv").read_bytes()
        self.assertEqual(fixes["compared"], exported.count(b"\n") - 1)
        self.assertIn(b",3,vo_extrapolated,", exported)
        self.assertEqual(exported, (out / "again/fixes.csv").read_bytes())
        self.flies_again_until_the_cut(out)

    def flies_again_until_the_cut(self, out):
        """What is left of a recording replays as well, and what cannot be compared is named."""
        cut = out / "cut"
        shutil.copytree(out / "run/record", cut)
        decisions = max(cut.glob("*.flight.mcap"), key=lambda file: file.stat().st_size)
        whole = decisions.read_bytes()
        decisions.write_bytes(whole[: len(whole) // 3])
        again = self.replay(out, cut, "cut_again")
        self.assertIn(again.returncode, (0, 1), again.stderr)
        fixes = json.loads(again.stdout)["fixes"]
        self.assertGreater(fixes["compared"], 30)
        self.assertEqual(fixes["compared"], fixes["identical"], fixes)
        self.assertLess(sum(interval["fixes"] for interval in fixes["not_compared"]), 30, fixes)


class Rules(unittest.TestCase):
    """A nominal flight meets every rule; a faulty one violates the rule concerned."""

    SERVICE = {"frames": 100, "dropped": 2}

    def flight(self, reported=(), rows=None, error=4.0, **summary):
        events = [(60, "scenario", "gps-step=300@70"), (80, "scenario", "camera-cut"), (92, "scenario", "camera-restore"),
                  (100, "scenario", "gps-recover"), *((at, "statustext", text) for at, text in reported)]
        words = {"scenario": "what", "statustext": "text"}
        return {"events": [{"time_s": at, "kind": kind, words[kind]: text} for at, kind, text in sorted(events)],
                "duration_s": 130, "fix_error_m": {"max": error}, "gps_input": {"accepted": 900},
                "gps_input_spacing_max_s": 0.1, "received": {"HEARTBEAT": 130}, **summary}

    REPORTED = ((60.5, rules.SPOOFED), (60.6, rules.MAP_LEADS), (80.7, rules.NO_PICTURES), (93.5, rules.SEES_AGAIN),
            (112, rules.TRUSTED), (112.1, rules.GPS_LEADS))
    CHANGES = ((1.0, "state", "normal", "degraded", "no camera frames: no frame for 0.42 s"),)

    def rows(self, sigma=lambda t: 3.0 if t < 80 else 3.0 + t - 80, first=5, source="gps_input"):
        return [{"time_s": str(t), "given_fix_type": "3" if t >= first else "0", "given_accuracy_m": str(sigma(t)),
                 "source": source} for t in range(131)]

    def missed(self, summary=None, rows=None, service=None, changes=CHANGES, frame_s=0.0):
        judged = rules.judge(summary or self.flight(self.REPORTED), rows or self.rows(), service or self.SERVICE, changes, frame_s)
        self.assertEqual(len(judged) + 1, len(rules.lines_of(judged)))
        return [rule.name for rule in judged if not rule.met]

    def test_are_met_by_a_good_flight(self):
        self.assertEqual([], self.missed())

    def test_a_slow_camera_is_missed_after_two_intervals(self):
        for silent_s, missed in ((0.63, []), (0.91, ["camera loss to dead reckoning"])):
            changes = [(*self.CHANGES[0][:4], f"no frame for {silent_s} s")]
            self.assertEqual(missed, self.missed(changes=changes, frame_s=1 / 3))

    def test_each_is_missed_by_a_flight_that_breaks_it(self):
        without = lambda *texts: self.flight([pair for pair in self.REPORTED if pair[1] not in texts])
        for name, broken in (
                ("cold start to the first fix", {"rows": self.rows(first=40)}),
                ("GPS spoofed to navigating by our fix", {"summary": without(rules.MAP_LEADS)}),
                ("GPS spoofed to navigating by our fix", {"rows": self.rows(source="own")}),
                ("camera loss to dead reckoning", {"changes": [(*self.CHANGES[0][:4], "no frame for 0.91 s")]}),
                ("σ while blind", {"rows": self.rows(sigma=lambda t: 9.0 if t < 85 else 8.0)}),
                ("visual position restored", {"summary": without(rules.SEES_AGAIN)}),
                ("GPS recovery to trusted", {"summary": self.flight([*self.REPORTED[:4], (104, rules.TRUSTED)])}),
                ("no fix follows spoofed GPS", {"summary": self.flight(self.REPORTED, error=280.0)}),
                ("our GPS as the autopilot sees it", {"summary": self.flight(self.REPORTED, gps_input={"unhealthy": 3})}),
                ("status to the ground station", {"summary": self.flight(self.REPORTED, received={})}),
                ("frames dropped", {"service": {"frames": 100, "dropped": 11}})):
            self.assertIn(name, self.missed(**broken), broken)


class Proofs(unittest.TestCase):
    """What ./run bench rules flies: every rule of docs/onboard.md has a flight that proves it in real time."""

    PAGE = pathlib.Path(__file__).resolve().parents[2] / "docs" / "onboard.md"

    def rows(self, heading):
        section = self.PAGE.read_text(encoding="utf-8").split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]
        rows = [line.split("|")[1].strip() for line in section.splitlines() if line.startswith("| ")][1:]
        return [row.strip("`") if row.startswith("`") else row for row in rows]

    def seen(self, reported=(), events=(), done=(), rows=()):
        """A flight with these texts to the operator and every action at 10 s."""
        actions = {event.partition(":")[2].partition("=")[0] for scene in scenes.SCENES.values() for event in scene.events}
        happened = [{"time_s": 10.0 + again, "kind": "scenario", "what": action} for action in actions for again in (0, 1)]
        happened += [{"time_s": at, "kind": "statustext", "text": text} for at, text in reported]
        return proofs.Seen(rules.Happened({"events": sorted(happened, key=lambda event: event["time_s"])},
                                          list(rows) or [{"time_s": "0", "given_fix_type": "0", "given_error_m": "",
                                                          "given_accuracy_m": ""}]), list(events), dict(done))

    def test_every_rule_has_a_proof(self):
        proven = {proof.row for proof in proofs.PROOFS}
        rows = self.rows("Rules") + self.rows("GPS") + self.rows("Why the state changes")
        self.assertEqual(15 + 3 + 30, len(rows))
        self.assertEqual(set(), set(rows) - proven - set(proofs.UNIT_TESTS_ALONE))
        self.assertEqual(set(), proven - set(rows), "a row that the page does not have")
        self.assertEqual(set(), proven & set(proofs.UNIT_TESTS_ALONE))
        self.assertEqual(set(scenes.SCENES), {proof.scene for proof in proofs.PROOFS})

    def test_nothing_is_seen_in_a_flight_without_events(self):
        for flight in (self.seen(), proofs.Seen(rules.Happened({"events": []}, self.seen().happened.rows), [], {})):
            for proof in proofs.PROOFS:
                self.assertIsNone(proof.look(flight), proof)

    def test_late_and_early_notifications_are_detected(self):
        look = {(proof.row, proof.scene): proof.look for proof in proofs.PROOFS}
        again = look["back from `no_fix`", "camera"]
        self.assertAlmostEqual(2.0, again(self.seen(reported=[(13.0, "Nadir: position found again")])))
        self.assertIsNone(again(self.seen(reported=[(11.5, "Nadir: position found again")])), "steady for 1 s")
        leads = look["gps_leads", "spoofing"]
        reported = [(1.0, "Nadir: GPS trusted"), (21.0, "Nadir: GPS trusted"), (21.1, "Nadir: autopilot navigating by GPS")]
        self.assertAlmostEqual(0.1, leads(self.seen(reported=reported)), msg="not from when it was trusted first")
        denied = look["denied", "failsafe"]
        self.assertAlmostEqual(0.7, denied(self.seen(reported=[(5.0, "Nadir: GPS denied"), (10.7, "Nadir: GPS denied")])))
        never = look["spoofed", "camera"]
        dark = (40.0, "Nadir: NO FIX, blind for too long")
        self.assertIsNotNone(never(self.seen(reported=[dark])))
        self.assertIsNone(never(self.seen(reported=[dark, (41.0, "Nadir: GPS SPOOFED")])))
        lost = look["link_lost", "failsafe"]
        self.assertAlmostEqual(5.1, lost(self.seen(events=[(15.1, "state", "no messages from the autopilot: 5.0 s")])))
        self.assertIsNone(lost(self.seen(events=[(13.0, "state", "no messages from the autopilot: 3.0 s")])))

    def test_a_fix_disturbed_by_a_backlog_is_detected(self):
        look = next(proof.look for proof in proofs.PROOFS if proof.row == "camera_silent")
        said = [(10.4, "camera", "the camera delivers stale frames from its buffer; they are dropped")]
        row = lambda error: [{"time_s": "12", "given_fix_type": "3", "given_error_m": error, "given_accuracy_m": "4"}]
        self.assertAlmostEqual(0.4, look(self.seen(events=said, done={"backlog": 10.0}, rows=row("9"))))
        self.assertIsNone(look(self.seen(events=said, done={"backlog": 10.0}, rows=row("90"))))
        self.assertIsNone(look(self.seen(done={"backlog": 10.0}, rows=row("9"))))


class Evidence(unittest.TestCase):
    def row(self, error, accuracy, age=0.1, fix=3):
        return {"given_fix_type": str(fix), "given_error_m": str(error), "given_accuracy_m": str(accuracy),
                "given_age_s": str(age)}

    def test_wrong_means_far_off_with_a_small_sigma(self):
        right = [self.row(40, 3), self.row(200, 100), self.row(300, 3, age=2), self.row(300, 3, fix=0)]
        self.assertEqual([], evidence.wrong_and_sure(right))
        self.assertTrue(evidence.judged_right("x", right).met)
        self.assertFalse(evidence.judged_right("x", [*right, self.row(60, 15)]).met)
        self.assertFalse(evidence.judged_right("x", []).met, "no fix is no evidence")

    def test_states_within_an_interval(self):
        changes = [(100.0, "state", None, "normal", ""), (105.0, "gps", "good", "denied", ""),
                   (110.0, "state", "normal", "degraded", ""), (112.0, "state", "degraded", "normal", "")]
        states = evidence.States(changes, 100.0)
        self.assertEqual(["normal"], states.during(2, 9))
        self.assertEqual(["normal", "degraded"], states.during(5, 11))
        self.assertEqual(["normal"], states.during(13, 20))
        self.assertEqual([], evidence.States([], 0.0).during(0, 1))

    def test_the_first_fix_after_a_kill_is_a_new_one(self):
        row = lambda t, age, fix=3: {**self.row(2, 3, age, fix), "unix_us": str(int(t * 1e6))}
        rows = [row(99.9, 0.1), row(100.1, 0.2), row(100.4, 0.5), row(101, 1.1), row(101.2, 0.05, 0), row(101.4, 0.05)]
        seconds, fix = kills.back_after_s(rows, 100.0)
        self.assertAlmostEqual(1.4, seconds)
        self.assertIs(rows[-1], fix)
        self.assertEqual((None, None), kills.back_after_s(rows[:4], 100.0))


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

    def test_finds_violated_limits(self):
        self.assertEqual([], self.verdict().shortfalls())
        bad = {"median": 11, "p95": 90, "max": 120, "count": 9}
        for changes, word in (({"deviation_m": {**bad, "median": 1}}, "leaves the plan"),
                              ({"deviation_m": {**bad, "max": 12}}, "median"), ({"resets_by_gps_input": 1}, "reset"),
                              ({"fix_error_m": bad}, "off"), ({"fix_error_m": None}, "no fix"),
                              ({"gps_input_spacing_max_s": 0.5}, "paused")):
            found = self.verdict(**changes).shortfalls()
            self.assertEqual(1, len(found), found)
            self.assertIn(word, found[0])

    def test_reads_the_summary_of_nadird(self):
        log = "710 frames, 3 dropped; frame to fix p50 117, p95 392, max 1270 ms; 2300 fixes, longest gap 320 ms\n"
        service = run_summary("something else\n" + log)
        self.assertEqual((710, 3, 392, 320), tuple(service[name] for name in ("frames", "dropped", "p95_ms",
                                                                               "longest_pause_ms")))
        self.assertIsNone(run_summary("it ended before"))
        self.assertIn("392 ms", self.verdict(service=service).shortfalls()[0])
        self.assertEqual([], self.verdict(service={**service, "p95_ms": 100}).shortfalls())
        self.assertIn("dropped", self.verdict(service={**service, "p95_ms": 100, "dropped": 200}).shortfalls()[0])

    def test_counts_from_the_first_fault(self):
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
