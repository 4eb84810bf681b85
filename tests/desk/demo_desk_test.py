#!/usr/bin/env python3
"""The end of `./run demo`: the flight at the desk, by the script that the demo calls, against the real program.

usage: demo_desk_test.py NADIR
"""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from desk_support import FRAMES, make_world  # noqa: E402
import support  # noqa: E402


class DemoDesk(support.EndToEnd):
    def setUp(self):
        super().setUp()
        self.demo = self.folder / "demo"
        shutil.copytree(support.made_once("desk world", make_world), self.demo)
        self.at = re.search(r"^created: *(\S+)", (self.demo / "world" / "mission.yaml").read_text(), re.MULTILINE).group(1)

    def command(self, *options):
        return [sys.executable, "-B", str(ROOT / "missions" / "demo_desk.py"), str(self.demo), "--nadir", str(support.NADIR), "--at", self.at, *options]

    def begin(self):
        """The running script, and the desk's address as it prints it."""
        process = subprocess.Popen(self.command(), stdout=subprocess.PIPE, text=True)
        self.addCleanup(process.stdout.close)
        self.addCleanup(lambda: process.poll() is None and process.kill())
        for line in process.stdout:
            if match := re.search(r"open at (http://[\d.:]+)/#(\w+)", line):
                return process, match.group(1), match.group(2)
        self.fail("the script ended without an address")

    @staticmethod
    def get(url):
        with urllib.request.urlopen(url, timeout=60) as answer:
            return json.load(answer)

    def test_the_flight_is_listed_with_its_package_pictures_and_estimates(self):
        process, url, flight = self.begin()
        listed = self.get(url + "/v1/flights")["flights"]
        self.assertEqual([flight], [item["id"] for item in listed])
        self.assertEqual(("completed", "demo", {"accepted": FRAMES, "processed": FRAMES}), tuple(listed[0][name] for name in ("state", "package", "pictures")))
        self.assertTrue(self.get(url + "/v1/packages")["packages"][0]["accepted"])
        refined = self.get(f"{url}/v1/flights/{flight}/estimates?kind=refined")["estimates"]
        self.assertEqual(FRAMES, len(refined))
        with urllib.request.urlopen(f"{url}/v1/flights/{flight}/pictures/0", timeout=60) as picture:
            self.assertEqual(sorted((self.demo / "flight" / "frames").iterdir())[0].read_bytes(), picture.read())
        with urllib.request.urlopen(url + "/", timeout=60) as page:
            self.assertIn(b"<!doctype html>", page.read()[:100].lower())
        process.send_signal(signal.SIGINT)
        self.assertEqual(0, process.wait(60))
        with self.assertRaises(OSError, msg="the desk is closed with the script"):
            self.get(url + "/v1/flights")
        # Once more: the flight is there, and not sent a second time.
        process, url, again = self.begin()
        self.assertEqual(flight, again)
        self.assertEqual(1, len(self.get(url + "/v1/flights")["flights"]))
        process.terminate()
        self.assertEqual(0, process.wait(60))

    def test_without_a_terminal_it_leaves_the_flight_and_no_process(self):
        result = subprocess.run(self.command("--leave"), capture_output=True, text=True, timeout=300)
        self.assertEqual(0, result.returncode, result.stderr)
        self.assertIn(f"{FRAMES} pictures, completed", result.stdout)
        self.assertEqual(1, len(os.listdir(self.demo / "desk" / "flights")))

    def test_a_package_that_is_not_trusted_is_said(self):
        self.good("keys", "create", "--out", self.folder / "other")
        self.good("keys", "create", "--out", self.folder / "root")
        self.good("keys", "root", "--root-key", self.folder / "root.key.pem", "--package-signer", self.folder / "other.pub.pem", "--expires", "2035-01-01",
                  "--out", self.folder / "root.json")
        shutil.copy(self.folder / "root.json", self.demo / "root.json")
        result = subprocess.run(self.command("--leave"), capture_output=True, text=True, timeout=300)
        self.assertEqual(1, result.returncode)
        self.assertIn("error: the desk answers", result.stderr)
        self.assertNotIn("Traceback", result.stderr)


if __name__ == "__main__":
    support.main()
