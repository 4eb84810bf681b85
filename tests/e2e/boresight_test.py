#!/usr/bin/env python3
"""nadir provision boresight: a simulated flight whose camera is misaligned by known angles."""
import csv
import json
import math
import unittest

from support import NADIRD, EndToEnd, main, run

MOUNT_DEG = (4.0, -2.0, 1.5)  # yaw, pitch, roll
CONFIGURED_DELAY_S, LATE_S = 0.1, 0.06  # the frames are stamped later than the configured delay explains
WIDTH, HEIGHT, FOCAL = 640, 480, 520.0


def rotation(yaw, pitch, roll):
    """North-east-down from body, angles in degrees."""
    (cy, sy), (cp, sp), (cr, sr) = ((math.cos(math.radians(a)), math.sin(math.radians(a))) for a in (yaw, pitch, roll))
    return [[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr]]


def aircraft_under(camera, mount):
    """Whose camera, mounted so, has that attitude: camera times mount's inverse."""
    c, m = rotation(*camera), rotation(*mount)
    r = [[sum(c[i][k] * m[j][k] for k in range(3)) for j in range(3)] for i in range(3)]
    return (math.degrees(math.atan2(r[1][0], r[0][0])), -math.degrees(math.asin(r[2][0])),
            math.degrees(math.atan2(r[2][1], r[2][2])))


class Boresight(EndToEnd):
    def fly(self):
        world, flight = self.folder / "world", self.folder / "flight"
        self.good("simulate", "world", "--seed", 7, "--size-km", 0.7, "--gsd-m", 0.4, "--out", world)
        for name in ("root", "signer"):
            self.good("keys", "create", "--out", self.folder / name)
        self.good("keys", "root", "--root-key", self.folder / "root.key.pem", "--package-signer",
                  self.folder / "signer.pub.pem", "--expires", "2035-01-01", "--out", self.folder / "root.json")
        self.good("cache", "build", "--mission", world / "mission.yaml", "--imagery", world / "map.tif", "--dem",
                  world / "dem.tif", "--key", self.folder / "signer.key.pem", "--out", self.folder / "package")
        camera = {"model": "pinhole", "width": WIDTH, "height": HEIGHT, "fx": FOCAL, "fy": FOCAL, "cx": (WIDTH - 1) / 2,
                  "cy": (HEIGHT - 1) / 2, "uncertainty": {"heading_deg": 1.0, "agl_relative": 0.03, "tilt_deg": 0.5}}
        (self.folder / "camera.yaml").write_text("".join(f"{k}: {json.dumps(v)}\n" for k, v in camera.items()))
        (self.folder / "airframe.json").write_text(json.dumps(
            {"format": "nadir.airframe/1", "airframe": "any", "sequence": 4, "expires": "2035-01-01T00:00:00Z",
             "camera": camera, "capture_delay_s": CONFIGURED_DELAY_S}))
        self.good("simulate", "flight", "--world", world / "ground.tif", "--dem", world / "dem.tif", "--mission",
                  world / "mission.yaml", "--camera", self.folder / "camera.yaml", "--noise", "none", "--max-frames", 60,
                  "--interval-s", 1, "--imu-hz", 100, "--out", flight)
        self.created = next(line.split()[1] for line in (world / "mission.yaml").read_text().splitlines()
                            if line.startswith("created:"))
        self.measured(flight)
        return flight

    @staticmethod
    def measured(flight):
        """The telemetry of an aircraft with a misaligned camera whose frames are stamped late, and its GPS positions."""
        with open(flight / "truth.csv", encoding="utf-8") as file:
            truth = {row["frame"]: row for row in csv.DictReader(file)}
        with open(flight / "telemetry.csv", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        angles, places = ("heading_deg", "pitch_deg", "roll_deg"), ("lat_deg", "lon_deg")
        for row in rows:
            row.update(zip(angles, aircraft_under([float(row[name]) for name in angles], MOUNT_DEG)))
            row.update((name, float(truth[row["frame"]][name])) for name in places)
            row["time_s"] = float(row["time_s"])
        late = []
        for now, after in zip(rows, rows[1:]):
            share = LATE_S / (after["time_s"] - now["time_s"])
            at = {name: now[name] + share * (after[name] - now[name]) for name in ("time_s", *places)}
            for name in angles:  # the shorter way round
                at[name] = now[name] + share * ((after[name] - now[name] + 180) % 360 - 180)
            late.append({**now, **{name: f"{value:.9f}" for name, value in at.items()}})
        with open(flight / "gps.csv", "w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, rows[0].keys())
            writer.writeheader()
            writer.writerows(late)

    def command(self, flight, *more):
        return ["provision", "boresight", "--airframe", self.folder / "airframe.json", "--package", self.folder / "package",
                "--trust", self.folder / "root.json", "--at", self.created, "--frames", flight / "frames", "--telemetry",
                flight / "gps.csv", "--min-frames", 12, *more]

    def test_the_mount_is_found_written_and_signed(self):
        flight, out = self.fly(), self.folder / "falcon"
        result = run(*self.command(flight, "--key", self.folder / "signer.key.pem", "--out", out, "--json"))
        found = json.loads(result.stdout)
        self.assertEqual(0, result.returncode, result.stdout + result.stderr)
        for name, wanted in zip(("yaw", "pitch", "roll"), MOUNT_DEG):
            error = abs(found["mount_deg"][name] - wanted)
            self.assertLess(error, max(0.3, 3 * found["mount_sigma_deg"][name]), found)
            self.assertLess(error, 1.0, found)
        # Two seconds of turning tell the delay better than all positions.
        gyroscopes, delay_s = found["gyroscopes"], found["capture_delay_s"]
        self.assertLess(gyroscopes["delay_sigma_s"], 0.005, found)
        self.assertLess(abs(gyroscopes["delay_s"] - LATE_S), max(0.005, 3 * gyroscopes["delay_sigma_s"]), found)
        self.assertTrue(found["capture_delay_seen"])
        self.assertLess(abs(delay_s - CONFIGURED_DELAY_S - LATE_S), 0.01, found)
        airframe = json.loads((out / "airframe.json").read_text(encoding="utf-8"))
        self.assertAlmostEqual(found["mount_deg"]["yaw"], airframe["mount"]["yaw_deg"], 6)
        self.assertEqual((5, "2035-01-01T00:00:00Z"), (airframe["sequence"], airframe["expires"]))
        ready = self.good("--package", self.folder / "package", "--trust", self.folder / "root.json", "--airframe",
                          out / "airframe.json", "--at", self.created, "--check", "--json", program=NADIRD)
        self.assertEqual([], json.loads(ready.stdout)["findings"])

        self.fails(2, *self.command(flight, "--key", self.folder / "signer.key.pem", "--out", out), mentions=["already exists"])
        nothing = self.folder / "nothing"
        self.fails(1, *self.command(flight, "--to-s", "8", "--key", self.folder / "signer.key.pem", "--out", nothing),
                   mentions=["provision.few_anchors"], leaves_nothing=nothing)
        (flight / "gps.csv").write_text((flight / "telemetry.csv").read_text(encoding="utf-8"), encoding="utf-8")
        self.fails(2, *self.command(flight), mentions=["no frame of this flight has a GPS position"])
        self.fails(2, *self.command(flight, "--recorder", flight), mentions=["exactly one flight"])


if __name__ == "__main__":
    main()
