#!/usr/bin/env python3
"""`nadir simulate loop` as a user calls it: real programs and sockets, in real time."""
import csv
import json
import os
import pathlib
import re
import signal
import socket
import subprocess
import time
import unittest.mock
import urllib.request

import support


class SimulateLoop(support.EndToEnd):
    def world(self):
        def make(folder):
            self.good("simulate", "world", "--seed", 7, "--size-km", 0.8, "--gsd-m", 0.5, "--out", folder / "world")
        return support.made_once("loop-world", make) / "world"

    def args(self, *more):
        usual = {"--world": self.world(), "--nadird": support.NADIRD, "--port": 0}
        return ["simulate", "loop", *(word for pair in usual.items() if pair[0] not in more for word in pair), *more]

    def begin(self, *more):
        """Started, and flying: (process, page's address)."""
        process = subprocess.Popen([support.NADIR, *map(str, self.args(*more))], stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        for line in process.stderr:
            found = re.search(r"nadird's page: (http://\S+)", line)
            if found:
                return process, found.group(1)
        self.fail(f"it ended with {process.wait()}")

    def children(self, process):
        found = []
        for entry in pathlib.Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = entry.read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[1]) == process.pid:
                found.append(int(entry.parent.name))
        return found

    def gone(self, pids, seconds=20):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            if not any(map(self.runs, pids)):
                return True
            time.sleep(0.1)
        return False

    @staticmethod
    def runs(pid):
        try:
            return pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
        except OSError:
            return False

    def flies(self, autopilot, circumstance, *more):
        """Twenty-four seconds, and what it printed."""
        result = self.good(*self.args("--autopilot", autopilot, "--circumstance", circumstance, "--minutes", 0.4, "--json", *more))
        figures = json.loads(result.stdout)
        self.assertEqual([autopilot, circumstance, 24.0], [figures[k] for k in ("autopilot", "circumstance", "flown_s")])
        self.assertGreater(figures["fixes"], 100, f"{figures}\n{result.stderr}")
        self.assertLess(figures["fix_error_m"]["worst"], 40, figures)
        self.assertLess(figures["off_track_m"]["worst"], 90, figures)  # the world is small and its corners are tight
        self.assertGreater(figures["flown_by_fixes_s"], 5, figures)
        self.assertLess(figures["usable_from_s"], 20, figures)
        self.assertIn("GPS " + circumstance.upper(), result.stderr)
        self.assertIn("autopilot now navigating by Nadir", result.stderr)

    def test_a_spoofed_px4_flies_and_is_measured(self):
        out = self.folder / "flight"
        self.flies("px4", "spoofed", "--out", out)
        rows = list(csv.DictReader((out / "track.csv").read_text().splitlines()))
        self.assertEqual(240, len(rows), "ten a second")
        self.assertEqual("nadird", rows[-1]["flown_by"])
        self.assertLess(float(rows[-1]["fix_error_m"]), 40)
        self.good("recorder", "verify", out / "record")
        self.good("recorder", "export", out / "record", "--format", "csv", "--out", self.folder / "tables")
        self.assertNotIn("finding:", (self.folder / "tables/events.csv").read_text(), "it shows no bad example")
        # The recording is enough to fly it again.
        made = re.search(r"^created: *(\S+)", (self.world() / "mission.yaml").read_text(), re.M)[1]
        again = json.loads(self.good("replay", "--recorder", out / "record", "--package", out / "package", "--trust", out / "root.json",
                                     "--at", made, "--out", self.folder / "again", "--json").stdout)["reproduced"]
        self.assertGreater(again["compared"], 20)
        self.assertEqual(again["compared"], again["same"], again)

    def test_a_denied_ardupilot_flies_and_leaves_nothing_without_out(self):
        world = self.world()
        with unittest.mock.patch.dict(os.environ, {"TMPDIR": str(self.folder)}):
            self.flies("ardupilot", "denied", "--world", world)
        self.assertEqual([], list(self.folder.iterdir()))

    def test_the_page_answers_and_ctrl_c_ends_all(self):
        process, page = self.begin("--minutes", 10, "--out", self.folder / "cut")
        with urllib.request.urlopen(page, timeout=10) as answer:
            self.assertIn(b"<html", answer.read().lower())
        children = self.children(process)
        self.assertEqual(2, len(children), children)
        time.sleep(2)
        os.kill(process.pid, signal.SIGSTOP)  # as on a machine that is too slow: the aircraft does not wait
        time.sleep(3)
        os.kill(process.pid, signal.SIGCONT)
        time.sleep(2)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        out, err = process.communicate(timeout=40)
        self.assertEqual(130, process.returncode, err)
        self.assertIn("positions from the truth", out)
        self.assertGreaterEqual(float(re.search(r"up to ([0-9.]+) s behind real time", out).group(1)), 2.5, out)
        self.assertGreaterEqual(int(re.search(r"flown +([0-9]+) s", out).group(1)), 6, out)
        self.assertTrue(self.gone(children, 1), "programs are left")
        self.good("recorder", "verify", self.folder / "cut/record")

    def test_a_killed_loop_takes_its_programs_with_it(self):
        process, _ = self.begin("--minutes", 10, "--out", self.folder / "killed")
        children = self.children(process)
        process.kill()
        process.communicate()
        self.assertTrue(self.gone(children), children)

    def test_a_program_that_ends_in_flight_is_an_error(self):
        process, _ = self.begin("--minutes", 10, "--out", self.folder / "dead")
        service = next(pid for pid in self.children(process) if "nadird" in os.path.basename(os.readlink(f"/proc/{pid}/exe")))
        os.kill(service, signal.SIGKILL)
        _, err = process.communicate(timeout=40)
        self.assertEqual(2, process.returncode, err)
        self.assertIn("nadird has ended", err)
        self.assertIn("137", err)

    def test_wrong_usage_is_found_before_anything_is_made(self):
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            port = taken.getsockname()[1]
            for args, text in ((["--port", port], "port of nadird's page cannot be used"),
                               (["--nadird", self.folder / "nowhere"], "nadird is not there"),
                               (["--out", self.folder], "the folder exists"),
                               (["--minutes", 0], "--minutes"), (["--circumstance", "storm"], "storm"),
                               (["--world", self.folder / "nowhere", "--out", self.folder / "made"], "mission.yaml")):
                result = support.run(*self.args(*args))
                self.assertEqual((2, ""), (result.returncode, result.stdout), (args, result.stderr))
                self.assertIn(text, result.stderr)
        self.assertEqual([], list(self.folder.iterdir()))


if __name__ == "__main__":
    support.main()
