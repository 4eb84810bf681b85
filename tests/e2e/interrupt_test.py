#!/usr/bin/env python3
"""Ctrl-C ends a command with exit code 130 and leaves no output; rows of a replay can be followed while it runs."""
import os
import signal
import subprocess
import time

from support import NADIR, EndToEnd, main


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


if __name__ == "__main__":
    main()
