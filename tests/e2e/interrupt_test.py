#!/usr/bin/env python3
"""Ctrl-C ends a command with exit code 130 and leaves no output; rows of a replay can be followed while it runs, and one that
was killed can be resumed."""
import csv
import os
import re
import shutil
import signal
import subprocess
import time

from support import NADIR, EndToEnd, made_once, main, run


class Interrupt(EndToEnd):
    def start(self):
        flight = self.flight(frames=2, width=1024, height=768)
        # The same two frames repeated: quick to create, and too long to finish before the interrupt.
        rows = ["frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg"]
        for i in range(4000):
            name = f"x{i:05}.jpg"
            os.link(flight / "frames" / f"{i % 2}.jpg", flight / "frames" / name)
            rows.append(f"{name},{i}.0,100,90,0,0")
        (flight / "telemetry.csv").write_text("\n".join(rows) + "\n")
        self.out = self.folder / "out"
        return subprocess.Popen([NADIR, *map(str, self.replay_args(flight, self.out))], stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True)

    def wait_for_rows(self, process):
        rows = self.folder / ".out.staging" / "estimates.csv"
        while process.poll() is None:  # no limit here: ctest has one
            if rows.exists() and rows.read_text().count("\n") >= 3:
                return
            time.sleep(0.05)
        self.fail(process.communicate())

    def test_ctrl_c(self):
        process = self.start()
        self.wait_for_rows(process)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate()
        self.assertEqual(130, process.returncode, err)
        self.assertEqual("", out)
        self.assertIn("interrupted", err)
        self.assertEqual(["flight"], sorted(p.name for p in self.folder.iterdir()))

    def test_kill_leaves_nothing_under_the_final_name(self):
        process = self.start()
        self.wait_for_rows(process)
        process.kill()
        process.communicate()
        self.assertFalse(self.out.exists())


class Resume(EndToEnd):
    """A replay of 24 frames over a landscape, one damaged; killed or interrupted after some rows, then resumed."""

    def setUp(self):
        super().setUp()
        self.world = made_once("landscape of a resumed flight", self.make_world)
        shutil.copytree(self.world / "flight", self.folder / "flight")
        self.frames, self.telemetry = self.folder / "flight" / "frames", self.folder / "flight" / "telemetry.csv"
        damaged = sorted(self.frames.iterdir())[9]
        damaged.write_bytes(damaged.read_bytes()[:1500])

    def make_world(self, folder):
        world, keys = folder / "world", [folder / "root", folder / "signer"]
        calls = [("simulate", "world", "--seed", 7, "--size-km", 0.7, "--gsd-m", 0.5, "--out", world)]
        calls += [("keys", "create", "--out", key) for key in keys]
        calls += [("keys", "root", "--root-key", folder / "root.key.pem", "--package-signer", folder / "signer.pub.pem", "--expires", "2035-01-01",
                   "--out", folder / "root.json"),
                  ("cache", "build", "--mission", world / "mission.yaml", "--imagery", world / "map.tif", "--dem", world / "dem.tif", "--key",
                   folder / "signer.key.pem", "--out", folder / "package"),
                  ("simulate", "flight", "--world", world / "ground.tif", "--dem", world / "dem.tif", "--mission", world / "mission.yaml",
                   "--camera", world / "camera.yaml", "--seed", 11, "--max-frames", 24, "--out", folder / "flight")]
        for call in calls:
            result = run(*call)
            self.assertEqual(0, result.returncode, f"{call}\n{result.stdout}\n{result.stderr}")

    def command(self, out, *more):
        at = re.search(r"^created: *(\S+)", (self.world / "world" / "mission.yaml").read_text(), re.MULTILINE).group(1)
        first = next(csv.DictReader((self.world / "flight" / "truth.csv").read_text().splitlines()))
        return [str(part) for part in (NADIR, "replay", "--frames", self.frames, "--telemetry", self.telemetry, "--camera",
                                       self.folder / "flight" / "camera.yaml", "--start", f"{first['lon_deg']},{first['lat_deg']}", "--out", out,
                                       "--package", self.world / "package", "--trust", self.world / "root.json", "--at", at, *more)]

    def stop_after(self, out, rows, how, *more):
        process = subprocess.Popen(self.command(out, *more), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        file = out.parent / f".{out.name}.staging" / "estimates.csv"
        while process.poll() is None:
            if file.exists() and file.read_text().count("\n") > rows:
                process.send_signal(how)
                break
            time.sleep(0.001)
        process.communicate()
        return process.returncode

    def resumed(self, out, *more):
        return subprocess.run(self.command(out, "--resume", *more), capture_output=True, text=True)

    def results(self, out):
        """All files whose bytes are the flight's: latencies are not."""
        rows = [row[:10] + row[11:] for row in csv.reader((out / "estimates.csv").read_text().splitlines())]
        return rows, (out / "refined.csv").read_text(), (out / "poses.json").read_text(), (out / "track.geojson").read_text()

    def test_a_killed_replay_goes_on_with_the_same_results(self):
        whole = self.folder / "whole"
        self.assertEqual(0, subprocess.run(self.command(whole), capture_output=True).returncode)
        out = self.folder / "out"
        self.assertEqual(-signal.SIGKILL, self.stop_after(out, 2, signal.SIGKILL))
        for rows in (6, 10, 17):
            self.assertEqual(-signal.SIGKILL, self.stop_after(out, rows, signal.SIGKILL, "--resume"))
        staged = (self.folder / ".out.staging" / "estimates.csv").read_text().splitlines()
        result = self.resumed(out)
        self.assertEqual(0, result.returncode, result.stderr)
        self.continued(result)
        self.assertEqual(self.results(whole), self.results(out))
        complete = (out / "estimates.csv").read_text().splitlines()
        self.assertEqual(staged[:15], complete[:15], "latencies of the frames that were not processed again included")
        self.assertEqual({p.name for p in whole.iterdir()}, {p.name for p in out.iterdir()})
        self.assertFalse((self.folder / ".out.staging").exists())

    def continued(self, result):
        lines = [line for line in result.stderr.splitlines(keepends=True) if line.startswith("note: continued after ")]
        self.assertEqual(1, len(lines), result.stderr)
        self.assertGreaterEqual(int(lines[0].split()[3]), 16)
        return lines[0]

    def test_ctrl_c_keeps_what_was_begun_with_resume(self):
        out = self.folder / "out"
        self.assertEqual(130, self.stop_after(out, 4, signal.SIGINT, "--resume"))
        self.assertTrue((self.folder / ".out.staging" / "flight").is_dir())
        self.assertEqual(0, self.resumed(out).returncode)
        self.assertTrue(out.exists())

    def test_other_inputs_are_refused_and_nothing_is_lost(self):
        out = self.folder / "out"
        self.stop_after(out, 4, signal.SIGKILL)
        original = self.telemetry.read_text()
        for change, says in ((["--start", "8.4991,47.4"], "other inputs or options"), (["--integrity-risk", "0.01"], "other inputs or options")):
            args = self.command(out, "--resume", *change)
            if change[0] == "--start":
                at = args.index("--start")
                del args[at:at + 2]
            result = subprocess.run(args, capture_output=True, text=True)
            self.assertEqual(2, result.returncode)
            self.assertIn(says, result.stderr)
        header, first, *rest = original.splitlines()
        column, values = header.split(",").index("agl_m"), first.split(",")
        values[column] = str(float(values[column]) + 1)
        self.telemetry.write_text("\n".join([header, ",".join(values), *rest]) + "\n")
        result = self.resumed(out)
        self.assertEqual(2, result.returncode, result.stderr)
        self.assertIn("--resume", result.stderr)
        self.telemetry.write_text(original)
        self.assertEqual(0, self.resumed(out).returncode)

    def test_without_resume_it_starts_again_and_says_so(self):
        out = self.folder / "out"
        self.stop_after(out, 2, signal.SIGKILL)
        result = subprocess.run(self.command(out), capture_output=True, text=True)
        self.assertEqual(0, result.returncode)
        self.assertIn("--resume would have continued it", result.stderr)
        other = subprocess.run(self.command(self.folder / "other", "--resume"), capture_output=True, text=True)
        self.assertEqual(0, other.returncode)
        self.assertIn("nothing to resume", other.stderr)


if __name__ == "__main__":
    main()
