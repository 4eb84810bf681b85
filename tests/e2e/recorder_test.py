#!/usr/bin/env python3
"""A replay is recorded, and the recording replays bit for bit."""
import csv
import json
import shutil
import unittest

from support import AT, EndToEnd, main, run


class Recorder(EndToEnd):
    def setUp(self):
        super().setUp()
        self.flown = self.flight()
        self.frames = self.flown / "frames"

    def record(self, name, *more, code=0):
        result = run(*self.replay_args(self.flown, self.folder / f"{name}.out"), "--record", self.folder / name, *more)
        self.assertEqual(code, result.returncode, result.stderr)
        return self.folder / name

    def again(self, recording, *more):
        return run("replay", "--recorder", recording, "--out", self.folder / "again", "--json", *more)

    def test_bit_for_bit_with_the_frames_beside_it(self):
        recording = self.record("r")
        self.assertTrue(json.loads(self.good("recorder", "verify", recording, "--json").stdout)["accepted"])
        info = json.loads(self.good("recorder", "info", recording, "--json").stdout)["sessions"][0]
        self.assertTrue(info["clean_shutdown"])
        self.assertEqual(3, info["records"]["/input"])
        result = self.again(recording, "--frames", self.frames)
        self.assertEqual(0, result.returncode, result.stderr)
        self.assertEqual({"compared": 3, "same": 3}, json.loads(result.stdout)["reproduced"])

    def test_a_recorded_flight_keeps_its_integrity_risk(self):
        self.keys()
        mapped = ["--package", self.build(), "--trust", self.folder / "root.json", "--at", AT]
        recording = self.record("r", "--integrity-risk", "0.01", *mapped, code=1)  # the frames match nowhere on that map
        result = self.again(recording, "--frames", self.frames, *mapped, "--integrity-risk", "0.001")
        self.assertEqual(2, result.returncode)
        self.assertIn("--integrity-risk", result.stderr)
        self.assertFalse((self.folder / "again").exists())
        result = self.again(recording, "--frames", self.frames, *mapped, "--alert-limit-m", "7")
        self.assertEqual(0, result.returncode, result.stderr)
        document = json.loads(result.stdout)
        self.assertEqual({"compared": 3, "same": 3}, document["reproduced"])
        self.assertEqual(7, document["integrity"]["alert_limit_m"])
        levels = [row["hpl_m"] for row in csv.DictReader((self.folder / "again" / "estimates.csv").read_text().splitlines())]
        self.assertTrue(any(levels), "at 1e-5, the default, no radius holds a start that a person gave")

    def test_the_same_replay_gives_the_same_recording_but_for_its_latencies(self):
        for name in ("one", "two"):
            self.record(name)
            self.good("recorder", "export", self.folder / name, "--format", "csv", "--out", self.folder / f"{name}.csv")
        self.assertEqual(*[(self.folder / f"{name}.csv" / "anchors.csv").read_text() for name in ("one", "two")])

    def test_bit_for_bit_with_the_frames_in_it(self):
        recording = self.record("r", "--keep-frames")
        shutil.rmtree(self.flown)
        result = self.again(recording)
        self.assertEqual(0, result.returncode, result.stderr)
        self.assertEqual(3, json.loads(result.stdout)["reproduced"]["same"])
        self.assertFalse((self.folder / "again" / "unpacked").exists())

    def test_other_frames_are_rejected(self):
        recording = self.record("r")
        frame = self.frames / "1.jpg"
        frame.write_bytes(frame.read_bytes() + b"\0")
        result = self.again(recording, "--frames", self.frames)
        self.assertEqual(2, result.returncode)
        self.assertIn("1.jpg", result.stderr)
        frame.unlink()
        self.assertEqual(2, self.again(recording, "--frames", self.frames).returncode)
        result = self.again(recording)
        self.assertEqual(2, result.returncode)
        self.assertIn("--frames", result.stderr)
        self.assertFalse((self.folder / "again").exists())

    def test_a_damaged_recording_is_found_and_recovered(self):
        recording = self.record("r")
        segment = next(recording.glob("*.flight.mcap"))
        whole = segment.read_bytes()
        segment.write_bytes(whole[: len(whole) - 20])
        self.assertEqual(0, run("recorder", "verify", recording).returncode)
        spoilt = bytearray(whole)
        spoilt[len(whole) // 2] ^= 0xFF
        segment.write_bytes(bytes(spoilt))
        self.assertEqual(1, run("recorder", "verify", recording).returncode)
        run("recorder", "recover", recording, "--out", self.folder / "left")
        self.assertEqual(0, run("recorder", "verify", self.folder / "left").returncode)

    def test_killed_while_a_file_was_begun(self):
        recording = self.record("r")
        magic = next(recording.glob("*.flight.mcap")).read_bytes()[:5]
        (recording / "000009.flight.mcap").write_bytes(magic)
        (recording / "000010.flight.mcap").touch()
        result = run("recorder", "verify", recording, "--json")
        self.assertEqual(0, result.returncode, result.stdout)
        self.assertIn("recorder.truncated", result.stdout)
        self.good("recorder", "recover", recording, "--out", self.folder / "left")
        self.assertEqual(0, run("recorder", "verify", self.folder / "left").returncode)
        self.assertEqual(1, run("recorder", "verify", recording / "000010.flight.mcap").returncode)

    def test_no_such_message_is_sent(self):
        for path in (self.folder / "nothing", self.frames, self.flown / "telemetry.csv"):
            for command in ("info", "verify"):
                result = run("recorder", command, path)
                self.assertIn(result.returncode, (0, 1, 2))
                self.assertNotEqual("", result.stdout + result.stderr)
        self.assertEqual(1, run("recorder", "verify", self.flown / "telemetry.csv").returncode)

    def test_options_that_do_not_go_together(self):
        recording = self.record("r")
        self.assertEqual(2, self.again(recording, "--frames", self.frames, "--start", "1,2").returncode)
        self.assertEqual(2, self.again(recording, "--frames", self.frames, "--session", "other").returncode)
        self.assertEqual(2, run("replay", "--out", self.folder / "x").returncode)


if __name__ == "__main__":
    main()
