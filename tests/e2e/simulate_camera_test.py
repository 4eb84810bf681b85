#!/usr/bin/env python3
"""`nadir simulate camera` as a user calls it: poses of the simulated autopilot in, frames out."""
import json
import os
import re
import signal
import socket
import subprocess
import sys

import support
from loop.ports import free_port

AUTOPILOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support", "autopilot.py")
# Inside the map of support.py, whose ground is at sea level.
CORNERS = [(47.3995, 8.4985), (47.3995, 8.5015), (47.4005, 8.5015), (47.4005, 8.4985)]


class SimulateCamera(support.EndToEnd):
    def setUp(self):
        super().setUp()
        self.port = free_port()
        camera = self.folder / "camera.yaml"
        camera.write_text(support.CAMERA.format(width=320, height=240))
        self.args = ["simulate", "camera", "--world", self.map(), "--camera", camera, "--pose-from",
                     f"udpin:127.0.0.1:{self.port}"]
        waypoints = self.folder / "waypoints.csv"
        waypoints.write_text("lat_deg,lon_deg\n" + "".join(f"{lat},{lon}\n" for lat, lon in CORNERS))
        self.autopilot = [sys.executable, "-B", AUTOPILOT, "--link", f"udpout:127.0.0.1:{free_port()}", "--truth",
                          f"udpout:127.0.0.1:{self.port}", "--waypoints", waypoints, "--altitude-m", "100", "--airspeed", "8",
                          "--wind", "0", "0", "--duration", "100000", "--quiet", "--epoch-us", "1750000000000000"]

    def fly(self):
        """The autopilot, in real time, until the test ends."""
        process = subprocess.Popen([*map(str, self.autopilot)], stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)

    def test_fills_a_folder_with_complete_frames(self):
        self.fly()
        out = self.folder / "frames"
        result = self.good(*self.args, "--out", out, "--max-frames", 6, "--keep", 4, "--fps", 10, "--json")
        report = json.loads(result.stdout)
        self.assertEqual((6, 0), (report["frames"], report["frames_beyond_world"]))
        names = sorted(os.listdir(out))
        self.assertEqual(4, len(names))
        times = [int(re.fullmatch(r"frame_(\d{16})\.jpg", name).group(1)) for name in names]
        self.assertTrue(all(1750000000000000 <= time < 1750000600000000 for time in times), times)
        self.assertTrue(all(later - time >= 49_000 for time, later in zip(times, times[1:])), times)
        for name in names:
            data = (out / name).read_bytes()
            self.assertEqual((b"\xff\xd8", b"\xff\xd9"), (data[:2], data[-2:]))

    def test_streams_to_standard_output(self):
        self.fly()
        process = subprocess.run([support.NADIR, *map(str, self.args), "--out", "-", "--max-frames", "3", "--quiet"],
                                 stdin=subprocess.DEVNULL, capture_output=True, timeout=200, check=False)
        self.assertEqual((0, b""), (process.returncode, process.stderr))
        data, frames = process.stdout, 0
        while data:
            head, _, rest = data.partition(b"\r\n\r\n")
            fields = dict(line.split(b": ") for line in head.split(b"\r\n")[1:])
            self.assertTrue(head.startswith(b"--nadir-frame\r\n"))
            size = int(fields[b"Content-Length"])
            self.assertEqual((b"\xff\xd8", b"\xff\xd9", b"\r\n"), (rest[:2], rest[size - 2:size], rest[size:size + 2]))
            data, frames = rest[size + 2:], frames + 1
        self.assertEqual(3, frames)

    def test_an_interrupt_prints_the_figures(self):
        self.fly()
        process = subprocess.Popen([support.NADIR, *map(str, self.args), "--out", self.folder / "frames"],
                                   stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(process.kill)
        while not (self.folder / "frames").is_dir() or not os.listdir(self.folder / "frames"):
            self.assertIsNone(process.poll())
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=100)
        self.assertEqual(130, process.returncode)
        self.assertIn("CPU time per frame", out)
        self.assertFalse([name for name in os.listdir(self.folder / "frames") if not name.endswith(".jpg")])

    def test_reports_that_no_poses_arrive(self):
        self.fails(2, *self.args, "--out", self.folder / "frames", "--timeout-s", "0.3", mentions=("no pose received", str(self.port)))

    def test_rejects_unsupported_requests(self):
        out = ["--out", self.folder / "frames"]
        self.fails(2, *self.args[:-1], "carrier:pigeon", *out, mentions=("pigeon",))
        self.fails(2, *self.args, "--out", "-", "--json", mentions=("standard output",))
        self.fails(2, *self.args, *out, "--fps", "0", mentions=("--fps",))
        self.fails(2, *self.args, *out, "--dem", self.folder / "none.tif", mentions=("none.tif",))
        taken = self.folder / "taken"
        taken.write_text("")
        self.fails(2, *self.args, "--out", taken, mentions=("taken",))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
            end.bind(("127.0.0.1", self.port))
            self.fails(2, *self.args, *out, mentions=(str(self.port),))


if __name__ == "__main__":
    support.main()
