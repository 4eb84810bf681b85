#!/usr/bin/env python3
"""Keys, package, verification, replay, report: the whole pipeline with the programs as a user calls them."""
import calendar
import contextlib
import csv
import json
import pathlib
import re
import sqlite3
import subprocess
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "api"))
from browser import Browser, find_axe, find_chromium  # noqa: E402
from loop.hands import HostClock  # noqa: E402
from support import AT, NADIRD, EndToEnd, main, run  # noqa: E402


class Pipeline(EndToEnd):
    def test_from_imagery_to_a_report(self):
        self.keys()
        package = self.build()
        verified = self.good("cache", "verify", package, "--trust", self.folder / "root.json", "--depth", "full", "--at", AT, "--json")
        self.assertTrue(json.loads(verified.stdout)["accepted"])
        subprocess.run(["gdalinfo", str(package / "imagery" / "base.mbtiles")], check=True, capture_output=True)

        flight = self.flight()
        out = self.folder / "out"
        result = self.matches_nowhere(*self.replay_args(flight, out), "--package", package, "--trust", self.folder / "root.json", "--at", AT)
        diagnosis = json.loads((out / "summary.json").read_text())["diagnosis"]
        self.assertEqual("nowhere", diagnosis["cause"])
        self.assertIn("warning: " + diagnosis["text"], result.stderr)
        self.assertIn("report.html", result.stdout)
        self.assertEqual({"estimates.csv", "refined.csv", "summary.json", "track.geojson", "report.html", "poses.json"},
                         {p.name for p in out.iterdir()})
        for name in ("estimates.csv", "refined.csv"):
            rows = list(csv.DictReader((out / name).read_text().splitlines()))
            self.assertEqual(["0.jpg", "1.jpg", "2.jpg"], [row["frame"] for row in rows])
            for row in rows:
                self.assertIn(row["source"], ("satellite_anchored", "vo_extrapolated", "dead_reckoned", "no_fix"))
                if row["lat_deg"]:
                    self.assertGreater(float(row["sigma_m"]), 0)
        self.assertEqual(3, json.loads((out / "summary.json").read_text())["frames"])
        self.assertEqual("FeatureCollection", json.loads((out / "track.geojson").read_text())["type"])
        self.assertIn("data:image/jpeg;base64,", (out / "report.html").read_text())

        ready = self.good("--package", package, "--trust", self.folder / "root.json", "--airframe", "mini-07", "--state",
                          self.folder / "state.json", "--at", AT, "--check", program=NADIRD)
        self.assertIn("ready", ready.stdout)
        self.assertRegex(ready.stdout, r"ready +yes")

    def test_replays_are_identical(self):
        flight = self.flight()
        texts = []
        for name, more in (("one", []), ("two", ["--odometry", "features"])):
            self.good(*self.replay_args(flight, self.folder / name), *more)
            rows = csv.reader((self.folder / name / "estimates.csv").read_text().splitlines())
            texts.append([row[:10] + row[11:] for row in rows])  # all but the latency
        self.assertEqual(texts[0], texts[1])

    def test_the_command_line_sets_risk_and_alert_limit(self):
        flight = self.flight(frames=2)  # from the third on a diagnosis is sought, which takes ten times as long as all else
        self.keys()
        mapped = ["--package", self.build(), "--trust", self.folder / "root.json", "--at", AT]
        levels, integrity = {}, {}
        for name, more in (("default", []), ("lenient", ["--integrity-risk", "0.01"]),
                           ("near", ["--integrity-risk", "0.01", "--alert-limit-m", "1"])):
            self.matches_nowhere(*self.replay_args(flight, self.folder / name), *mapped, *more)
            rows = list(csv.DictReader((self.folder / name / "estimates.csv").read_text().splitlines()))
            levels[name] = [row["hpl_m"] for row in rows if row["lat_deg"]]
            integrity[name] = json.loads((self.folder / name / "summary.json").read_text())["integrity"]
        # A start that a person gave is wrong more often than 1e-5: no radius holds it at that risk.
        self.assertEqual({""}, set(levels["default"]))
        self.assertTrue(any(levels["lenient"]), levels)
        self.assertEqual(levels["lenient"], levels["near"], "the limit changes no estimate")
        self.assertEqual((100, 1), (integrity["lenient"]["alert_limit_m"], integrity["near"]["alert_limit_m"]))
        self.assertEqual(0, integrity["near"]["usable_share"])
        self.assertEqual(2, integrity["default"]["without_level"])
        for wrong in (["--integrity-risk", "0"], ["--integrity-risk", "0.5"], ["--integrity-risk", "nan"],
                      ["--alert-limit-m", "0"], ["--alert-limit-m", "1e6"]):
            self.fails(2, *self.replay_args(flight, self.folder / "wrong"), *wrong, mentions=[wrong[0]],
                       leaves_nothing=self.folder / "wrong")

    def test_the_mission_of_the_package_sets_risk_and_alert_limit_unless_the_command_line_does(self):
        self.keys()
        package = self.build(change=lambda text: text + "integrity: {risk: 0.01, alert_limit_m: 55}\n")
        flight = self.flight(frames=2)
        found = {}
        for name, more in (("mission", []), ("line", ["--integrity-risk", "1e-5", "--alert-limit-m", "20"])):
            self.matches_nowhere(*self.replay_args(flight, self.folder / name), "--package", package, "--trust", self.folder / "root.json",
                                 "--at", AT, *more)
            rows = list(csv.DictReader((self.folder / name / "estimates.csv").read_text().splitlines()))
            integrity = json.loads((self.folder / name / "summary.json").read_text())["integrity"]
            found[name] = (integrity["alert_limit_m"], [row["hpl_m"] != "" for row in rows if row["lat_deg"]])
        self.assertEqual((55, True), (found["mission"][0], any(found["mission"][1])), found)
        self.assertEqual((20, False), (found["line"][0], any(found["line"][1])), found)

    def test_the_report_draws_the_stanford_diagram(self):
        if not find_chromium():
            self.skipTest("no chromium here")
        flight = self.flight(frames=2)
        self.keys()
        mapped = ["--package", self.build(), "--trust", self.folder / "root.json", "--at", AT]
        truth = self.folder / "truth.csv"
        truth.write_text("frame,lat_deg,lon_deg\n" + "".join(f"{i}.jpg,47.4003,8.4992\n" for i in range(2)))
        for name, more in (("truth", ["--truth", truth]), ("blind", [])):
            self.matches_nowhere(*self.replay_args(flight, self.folder / name), *mapped, "--integrity-risk", "0.01", *more)
            rows = csv.DictReader((self.folder / name / "estimates.csv").read_text().splitlines())
            levels = [row["hpl_m"] for row in rows if row["hpl_m"]]
            self.assertGreater(len(levels), 0)
            dots = len(levels) if more else 0
            browser = Browser(1280, 800)
            self.addCleanup(browser.close)
            report = (self.folder / name / "report.html").as_uri()
            browser.open(report)
            browser.wait_for("document.querySelector('#chart #level') !== null")
            self.assertEqual(dots, browser.evaluate("document.querySelectorAll('#stanford svg > circle').length"))
            self.assertEqual(dots == 0, browser.evaluate("document.getElementById('stanford-card').hidden"))
            self.assertEqual([], browser.complaints())
            self.assertEqual([], [url for url in browser.requested() if url != report and not url.startswith("data:")])
            self.has_no_barriers(browser)
        figures = json.loads((self.folder / "truth" / "summary.json").read_text())["integrity"]
        self.assertEqual(len(levels), figures["scored"])
        self.assertEqual(len(levels), sum(figures[region] for region in ("available", "misleading", "hazardously_misleading", "unavailable", "unavailable_misleading")))

    def test_the_report_of_a_package_draws_its_coverage(self):
        if not find_chromium():
            self.skipTest("no chromium here")
        self.keys()
        package = self.build()
        text = (package / "mission" / "mission.yaml").read_text()
        beyond = self.folder / "beyond.yaml"  # a corridor that is wider than the map
        beyond.write_text(re.sub(r"corridor_half_width_m: *[0-9.]+", "corridor_half_width_m: 900", text))
        self.fails(1, "cache", "validate", package / "imagery" / "base.mbtiles", "--mission", beyond, "--at", AT, "--report", self.folder / "found")
        browser = Browser(1280, 900)
        self.addCleanup(browser.close)
        report = (self.folder / "found" / "report.html").as_uri()
        browser.open(report)
        browser.wait_for("document.querySelector('#map .route') !== null")
        self.assertGreater(browser.evaluate("document.querySelectorAll('#map .gap-area').length"), 0)
        self.assertGreater(browser.evaluate("document.querySelectorAll('#readout dt').length"), 0)
        gaps = "getComputedStyle(document.querySelector('#map .gap-area')).fill"
        self.assertIn("#hatch", browser.evaluate(gaps))
        shown = browser.evaluate("document.querySelectorAll('#map .route').length")
        browser.evaluate("[...document.querySelectorAll('#layers label')].find((label) => label.textContent === 'route').click()")
        self.assertLess(browser.evaluate("document.querySelectorAll('#map .route').length"), shown)
        self.assertEqual([], browser.complaints())
        self.assertEqual([], [url for url in browser.requested() if url != report and not url.startswith("data:")])
        self.has_no_barriers(browser)

    def has_no_barriers(self, browser):
        if find_axe() is None:
            print("NOT TESTED: barriers; this Python has no axe-playwright-python", file=sys.stderr)
            return
        self.assertEqual([], browser.barriers(find_axe()))

    def test_without_a_start_there_is_no_estimate_until_a_match(self):
        self.keys()
        package = self.build()
        args = [a for a in self.replay_args(self.flight(frames=2), self.folder / "out") if a not in ("--start", "8.499,47.4")]
        self.matches_nowhere(*args, "--package", package, "--trust", self.folder / "root.json", "--at", AT)
        rows = list(csv.DictReader((self.folder / "out" / "estimates.csv").read_text().splitlines()))
        self.assertEqual(2, len(rows))
        for row in rows:  # noise frames, which match nowhere
            self.assertEqual(("no_fix", "", ""), (row["source"], row["lat_deg"], row["lon_deg"]))

    def test_json_is_the_summary(self):
        flight = self.flight()
        result = self.good(*self.replay_args(flight, self.folder / "out"), "--json")
        self.assertEqual(json.loads((self.folder / "out" / "summary.json").read_text()), json.loads(result.stdout))

    def test_a_damaged_frame_does_not_stop_the_flight(self):
        flight = self.flight()
        picture = flight / "frames" / "1.jpg"
        picture.write_bytes(picture.read_bytes()[:1500])
        self.good(*self.replay_args(flight, self.folder / "out"))
        rows = list(csv.DictReader((self.folder / "out" / "estimates.csv").read_text().splitlines()))
        self.assertEqual(3, len(rows))
        self.assertNotEqual("satellite_anchored", rows[1]["source"])

    def test_a_rejected_package_is_not_flown(self):
        self.keys()
        package = self.build()
        flight = self.flight()
        out = self.folder / "out"
        trust = ["--package", package, "--trust", self.folder / "root.json"]
        self.fails(1, *self.replay_args(flight, out), *trust, "--at", "2025-06-01", mentions=["package.expired"], leaves_nothing=out)
        self.fails(1, *self.replay_args(flight, out), *trust, "--at", AT, "--airframe", "other", mentions=["airframe.mismatch"],
                   leaves_nothing=out)
        self.fails(1, "--package", package, "--trust", self.folder / "root.json", "--at", AT, "--airframe", "other", "--check",
                   program=NADIRD, mentions=["airframe.mismatch"])

    def test_altered_tiles_are_reported_missing(self):
        self.keys()
        package = self.build()
        file = package / "imagery" / "base.mbtiles"
        bytes_of_file = bytearray(file.read_bytes())
        with contextlib.closing(sqlite3.connect(f"file:{file}?mode=ro&immutable=1", uri=True)) as database:
            tiles = [bytes(row[0]) for row in database.execute("SELECT tile_data FROM tiles")]
        for tile in tiles:  # a byte of each tile's image, where it is stored contiguously
            at = bytes_of_file.find(tile[300:364])
            if at >= 0:
                bytes_of_file[at + 32] ^= 1
        file.write_bytes(bytes_of_file)
        out = self.folder / "out"
        result = run(*self.replay_args(self.flight(frames=2), out), "--package", package, "--trust", self.folder / "root.json", "--at", AT)
        self.assertEqual(1, result.returncode, result.stderr)
        blamed = re.findall(r"where: +tile (\S+)", result.stderr)
        self.assertGreater(len(blamed), 0)
        self.assertEqual(sorted(set(blamed)), sorted(blamed), "each of them once")
        self.assertEqual(2, json.loads((out / "summary.json").read_text())["frames"], "the flight goes on without them")

    def test_the_aircraft_records_what_it_accepted(self):
        self.keys()
        old = self.build("old")
        new = self.build("new", sequence=2, name="m2.yaml")
        check = ["--trust", self.folder / "root.json", "--state", self.folder / "state.json", "--check"]
        self.good("--package", new, *check, "--at", AT, program=NADIRD)
        self.assertFalse((self.folder / "state.json").exists(), "as of another time: for trials")
        clock = HostClock(self.folder)
        if not clock.works:
            self.skipTest("no C compiler for a clock of its own")
        clock.set(calendar.timegm(time.strptime(AT, "%Y-%m-%dT%H:%M:%SZ")) - int(time.time()))
        nadird = [f"{name}={value}" for name, value in clock.environment().items()] + [NADIRD]
        self.good(*nadird, "--package", old, *check, program="env")
        self.good(*nadird, "--package", new, *check, program="env")
        self.fails(1, *nadird, "--package", old, *check, program="env", mentions=["package.rollback"])


class FirstImpressions(EndToEnd):
    def test_every_command_has_a_page_with_an_example(self):
        listed = [line.split("  ")[1].strip() for line in self.good("--help").stdout.splitlines() if line.startswith("  ")]
        commands = [name.split() for name in listed if not name.startswith(("COMMAND", "--"))]
        self.assertGreaterEqual(len(commands), 9)
        for command in commands:
            page = self.good(*command, "--help")
            self.assertEqual("", page.stderr)
            self.assertIn("Examples:", page.stdout, command)
            self.assertIn("nadir " + " ".join(command), page.stdout)
        self.assertIn("--check", self.good("--help", program=NADIRD).stdout)

    def test_messages_go_to_stderr_and_results_to_stdout(self):
        result = run("replay", "--framse", "x")
        self.assertEqual((2, ""), (result.returncode, result.stdout))
        self.assertIn("--frames", result.stderr)
        self.assertEqual(2, run("--package", "p", "--trust", "t", program=NADIRD).returncode)

    def test_a_full_disk_is_reported(self):
        with open("/dev/full", "w") as full:
            result = subprocess.run([pathlib.Path(run.__globals__["NADIR"]), "--help"], stdout=full, stderr=subprocess.PIPE, text=True)
        self.assertEqual(2, result.returncode)
        self.assertIn("standard output", result.stderr)


if __name__ == "__main__":
    main()
