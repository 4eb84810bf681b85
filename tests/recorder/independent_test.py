#!/usr/bin/env python3
"""The recorder's files as other people's readers see them, and what is left of a recorder that was killed.

usage: independent_test.py NADIR RECORD_SAMPLE FLATC SCHEMAS
"""
import collections
import csv
import datetime
import importlib
import json
import pathlib
import random
import subprocess
import sys
import tempfile
import unittest

from mcap.reader import NonSeekingReader, make_reader

NADIR, RECORD_SAMPLE, FLATC, SCHEMAS = sys.argv[1:5]


def run(*args, code=0):
    result = subprocess.run([*map(str, args)], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120)
    assert result.returncode == code, f"{args}: exit code {result.returncode}\n{result.stdout}{result.stderr}"
    return result.stdout


def generated(name):
    """A module that flatc has just written; what another test imported from its own folder is forgotten."""
    for module in [known for known in sys.modules if known.split(".")[0] == "nadir"]:
        del sys.modules[module]
    return importlib.import_module(name)


class Independent(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory(prefix="nadir-recorder.")
        self.addCleanup(self.temporary.cleanup)
        self.folder = pathlib.Path(self.temporary.name)

    def messages(self, file, reader=make_reader):
        with open(file, "rb") as stream:
            return [(schema, channel, message) for schema, channel, message in
                    reader(stream, validate_crcs=True).iter_messages(log_time_order=False)]

    def test_mcap_reads_what_was_recorded(self):
        run(RECORD_SAMPLE, self.folder / "r")
        info = json.loads(run(NADIR, "recorder", "info", self.folder / "r", "--json"))["sessions"][0]
        counts = collections.Counter()
        for file in sorted((self.folder / "r").glob("*.mcap")):
            indexed, streamed = self.messages(file), self.messages(file, NonSeekingReader)
            self.assertEqual(len(indexed), len(streamed))
            with open(file, "rb") as stream:
                summary = make_reader(stream).get_summary()
            self.assertEqual(len(indexed), summary.statistics.message_count)
            self.assertEqual("/session", indexed[0][1].topic)
            counts.update(channel.topic for _, channel, _ in indexed)
        self.assertEqual(info["records"], dict(counts))
        self.assertEqual(100, counts["/estimate"] - 5)
        last = sorted((self.folder / "r").glob("*.flight.mcap"))[-1]
        self.assertEqual("/end", self.messages(last)[-1][1].topic)
        self.assertTrue(json.loads(run(NADIR, "recorder", "verify", self.folder / "r", "--json"))["accepted"])

    def test_flatc_reads_every_payload_by_the_schema_in_the_file(self):
        run(RECORD_SAMPLE, self.folder / "r")
        seen = {}
        for file in sorted((self.folder / "r").glob("*.mcap")):
            for schema, channel, message in self.messages(file):
                self.assertEqual(("flatbuffer", "flatbuffer"), (schema.encoding, channel.message_encoding))
                seen[channel.topic] = (schema, message.data)
        self.assertEqual(14, len(seen))
        documents = {}
        for topic, (schema, data) in seen.items():
            name = topic[1:]
            (self.folder / f"{name}.bfbs").write_bytes(schema.data)
            (self.folder / f"{name}.bin").write_bytes(data)
            run(FLATC, "--json", "--strict-json", "--raw-binary", "-o", self.folder, self.folder / f"{name}.bfbs", "--",
                self.folder / f"{name}.bin")
            documents[topic] = json.loads((self.folder / f"{name}.json").read_text())
        session = documents["/session"]
        self.assertEqual(("a1b2", "NV-7", 42), (session["id"], session["airframe"], session["seed"]))
        self.assertEqual([0.1, -0.05, 0.001, -0.002, 0.01], session["camera"]["distortion"])
        self.assertEqual({"lon_deg": 8.5, "lat_deg": 47.4}, session["origin"])
        self.assertEqual((1e-6, 1.7), (session["localizer"]["integrity_risk"], session["localizer"]["map_sigma_m"]))
        self.assertEqual("normal", documents["/state"]["from"])
        self.assertEqual((17, 70000, 45000), tuple(documents["/tile"][k] for k in ("zoom", "x", "y")))
        self.assertEqual((7, "operator"), (documents["/hint"]["before"], documents["/hint"]["by"]))
        self.assertTrue(documents["/end"]["clean_shutdown"])
        self.assertEqual("dropped_by_disk", documents["/recorder"]["kind"])
        self.assertEqual("ambiguous", documents["/thumbnail"]["verdict"])
        inputs = documents["/fix_input"]
        kinds = {"attitudes": "attitude", "accelerations": "acceleration", "estimates": "estimate"}
        self.assertGreater(len(inputs["order"]), 0)
        for name, kind in kinds.items():
            self.assertEqual(inputs["order"].count(kind), len(inputs.get(name, [])))

    def test_pythons_flatbuffers_reads_the_estimates_that_are_exported(self):
        run(RECORD_SAMPLE, self.folder / "r")
        run(FLATC, "--python", "-o", self.folder / "generated", SCHEMAS + "/common.fbs", SCHEMAS + "/estimate.fbs")
        sys.path.insert(0, str(self.folder / "generated"))
        self.addCleanup(sys.path.pop, 0)
        estimate = generated("nadir.recorder.Estimate").Estimate
        run(NADIR, "recorder", "export", self.folder / "r", "--format", "csv", "--out", self.folder / "csv")
        with open(self.folder / "csv" / "estimates.csv", encoding="utf-8", newline="") as table:
            rows = list(csv.DictReader(table))
        read = [estimate.GetRootAs(message.data, 0) for file in sorted((self.folder / "r").glob("*.flight.mcap"))
                for _, channel, message in self.messages(file) if channel.topic == "/estimate"]
        self.assertEqual(len(rows), len(read))
        sources = ["satellite_anchored", "vo_extrapolated", "dead_reckoned", "no_fix"]
        for row, one in zip(rows, read):
            self.assertEqual(int(row["index"]), one.Index())
            self.assertEqual(row["frame"], one.Frame().decode())
            self.assertEqual(float(row["time_s"]), one.TimeS())
            self.assertEqual(row["source"], sources[one.Source()])
            self.assertEqual(row["lat_deg"] == "", one.Position() is None)
            if one.Position() is not None:
                self.assertAlmostEqual(float(row["lat_deg"]), one.Position().LatDeg(), delta=1e-8)
                self.assertEqual(float(row["sigma_m"]), one.SigmaM())
                self.assertEqual(float(row["hpl_m"]) if row["hpl_m"] else None, one.HplM())
        self.assertEqual({True, False}, {row["hpl_m"] == "" for row in rows})

    def export(self, recording, name):
        run(NADIR, "recorder", "export", recording, "--format", "csv", "--out", self.folder / name)
        tables = {}
        for table in ("estimates", "anchors", "fixes", "events"):
            with open(self.folder / name / f"{table}.csv", encoding="utf-8", newline="") as file:
                tables[table] = list(csv.DictReader(file))
        return tables

    def test_fixes_are_exported_with_utc_and_the_gps_beside_them(self):
        run(RECORD_SAMPLE, self.folder / "r")
        fixes = self.export(self.folder / "r", "csv")["fixes"]
        self.assertEqual(5, len(fixes))
        run(FLATC, "--python", "-o", self.folder / "generated", SCHEMAS + "/common.fbs", SCHEMAS + "/fix.fbs")
        sys.path.insert(0, str(self.folder / "generated"))
        self.addCleanup(sys.path.pop, 0)
        fix = generated("nadir.recorder.Fix").Fix
        read = [fix.GetRootAs(message.data, 0) for file in sorted((self.folder / "r").glob("*.flight.mcap"))
                for _, channel, message in self.messages(file) if channel.topic == "/fix"]
        for row, one in zip(fixes, read, strict=True):
            self.assertEqual(float(row["time_s"]), one.TimeS())
            sent = datetime.datetime.fromisoformat(row["utc"])
            self.assertAlmostEqual(sent.timestamp(), one.UnixUs() / 1e6, delta=6e-4)
            self.assertEqual(int(row["fix_type"]), one.FixType())
            self.assertEqual(row["lat_deg"] == "", one.Position() is None)
            self.assertEqual(row["source"] == "no_fix", one.Position() is None)
            self.assertEqual(float(row["accuracy_m"]), one.AccuracyM())
            self.assertEqual(row["gps_age_s"] == "", one.Gps() is None)
            if one.Gps() is not None and one.Gps().FixType() >= 2:
                self.assertAlmostEqual(float(row["gps_lat_deg"]), one.Gps().Position().LatDeg(), delta=1e-9)
                self.assertEqual(row["gps_distance_m"] == "", one.Position() is None)

    def test_estimates_say_when_in_utc_and_which_of_two_they_are(self):
        run(RECORD_SAMPLE, self.folder / "r")
        tables = self.export(self.folder / "r", "csv")
        seen = set()
        for row in tables["estimates"]:
            self.assertEqual("map_match" if row["index"] in seen else "frame", row["stage"])
            seen.add(row["index"])
            self.assertRegex(row["utc"], r"^2025-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")
        self.assertEqual({"frame", "map_match"}, {row["stage"] for row in tables["estimates"]})
        self.assertIn("120.5", {row["agl_m"] for row in tables["estimates"]})
        for row in tables["events"]:
            self.assertAlmostEqual(datetime.datetime.fromisoformat(row["utc"]).timestamp(), float(row["time_unix_s"]), delta=6e-4)

    def test_a_recording_from_before_fixes_were_recorded_is_read(self):
        run(RECORD_SAMPLE, self.folder / "r", "old")
        tables = self.export(self.folder / "r", "csv")
        self.assertEqual([], tables["fixes"])
        self.assertEqual(105, len(tables["estimates"]))
        self.assertTrue(all(row["utc"].startswith("2025-") for row in tables["estimates"]))
        self.assertTrue(json.loads(run(NADIR, "recorder", "verify", self.folder / "r", "--json"))["accepted"])

    def test_a_killed_recorder_loses_its_last_chunk_at_most(self):
        choice = random.Random(4)
        for attempt in range(8):
            folder = self.folder / str(attempt)
            recorder = subprocess.Popen([RECORD_SAMPLE, str(folder), "forever"], stdout=subprocess.PIPE, text=True)
            on_disk = 0
            for _ in range(choice.randint(1, 300)):
                on_disk = int(recorder.stdout.readline().split()[-1])
            recorder.kill()
            for line in recorder.stdout:  # what it said before it died
                if line.startswith("on disk ") and line.endswith("\n"):
                    on_disk = int(line.split()[-1])
            recorder.wait()
            recorder.stdout.close()
            findings = json.loads(run(NADIR, "recorder", "verify", folder, "--json"))
            self.assertTrue(findings["accepted"], findings)
            self.assertIn("recorder.unclean", {finding["code"] for finding in findings["findings"]})
            run(NADIR, "recorder", "recover", folder, "--out", self.folder / f"{attempt}.recovered")
            numbers = [message.sequence for file in sorted((self.folder / f"{attempt}.recovered").iterdir())
                       for _, channel, message in self.messages(file) if channel.topic == "/estimate"]
            self.assertEqual(list(range(len(numbers))), numbers)
            self.assertGreaterEqual(len(numbers), on_disk)
            # What was in the chunk that was being written, and nothing else, may be there or not.
            self.assertLessEqual(len(numbers), on_disk + 7)

    def test_geojson_kml_and_geopackage_hold_the_same_places(self):
        run(RECORD_SAMPLE, self.folder / "r")
        for kind in ("geojson", "kml", "gpkg"):
            run(NADIR, "recorder", "export", self.folder / "r", "--format", kind, "--out", self.folder / f"f.{kind}")
        features = json.loads((self.folder / "f.geojson").read_text())["features"]
        estimates = [f for f in features if f["properties"]["kind"] == "estimate"]
        self.assertEqual(1, sum(f["properties"]["kind"] == "track" for f in features))
        for kind in ("kml", "gpkg"):
            text = run("ogrinfo", "-ro", "-al", "-geom=SUMMARY", self.folder / f"f.{kind}", "anchors")
            self.assertIn("Feature Count", text)
            text = run("ogrinfo", "-ro", "-so", self.folder / f"f.{kind}", "track")
            self.assertIn("Feature Count: 1", text)
        count = run("ogrinfo", "-ro", "-sql", "SELECT COUNT(*) AS n FROM estimates WHERE geom IS NOT NULL", self.folder / "f.gpkg")
        self.assertIn(f"n (Integer) = {len(estimates)}", count)

    def test_parquet_is_written_or_the_reason_stated(self):
        run(RECORD_SAMPLE, self.folder / "r")
        result = subprocess.run([NADIR, "recorder", "export", str(self.folder / "r"), "--format", "parquet", "--out",
                                 str(self.folder / "f.parquet")], capture_output=True, text=True)
        if result.returncode == 0:
            self.assertEqual(b"PAR1", (self.folder / "f.parquet").read_bytes()[:4])
        else:
            self.assertEqual(2, result.returncode)
            self.assertIn("Arrow", result.stderr)
            self.assertFalse((self.folder / "f.parquet").exists())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
