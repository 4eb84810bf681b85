#!/usr/bin/env python3
"""nadir ortho as a user calls it: a flight over a small world becomes signed tiles, reproducibly; or it states why not."""
import hashlib
import json
import re
import shutil
import sqlite3
import subprocess
import unittest

from support import EndToEnd, made_once, main, run

PAYLOAD = b"application/vnd.nadir.candidate-tile.v1+json"


class Ortho(EndToEnd):
    def setUp(self):
        super().setUp()
        shutil.copytree(made_once("flown", self.make), self.folder, dirs_exist_ok=True)
        first = (self.folder / "flight/truth.csv").read_text().splitlines()[1].split(",")
        self.start = f"--start={first[2]},{first[1]}"

    def make(self, f):
        self.good("simulate", "world", "--seed", 3, "--size-km", 1, "--gsd-m", 0.6, "--out", f / "world")
        for key in ("root", "signer", "tile", "other"):
            self.good("keys", "create", "--out", f / key)
        self.good("keys", "root", "--root-key", f / "root.key.pem", "--package-signer", f / "signer.pub.pem",
                  "--tile-signer", f"mini-07={f}/tile.pub.pem", "--expires", "2035-01-01", "--out", f / "root.json")
        self.good("cache", "build", "--mission", f / "world/mission.yaml", "--imagery", f / "world/map.tif", "--dem",
                  f / "world/dem.tif", "--key", f / "signer.key.pem", "--out", f / "package")
        self.good("simulate", "flight", "--world", f / "world/ground.tif", "--dem", f / "world/dem.tif", "--mission",
                  f / "world/mission.yaml", "--camera", f / "world/camera.yaml", "--frames", 5, "--out", f / "flight")

    def ask(self, out, **changed):
        f = self.folder
        options = {"package": f / "package", "trust": f / "root.json", "at": "2025-09-20", "frames": f / "flight/frames",
                   "telemetry": f / "flight/telemetry.csv", "camera": f / "world/camera.yaml", "key": f / "tile.key.pem",
                   "airframe": "mini-07", "captured": "2025-09-20T10:00:00.500Z", "out": out} | changed
        return ["ortho"] + ([self.start] if self.start else []) + [text for name, value in options.items() if value is not None
                                        for text in (f"--{name}", value)]

    def test_a_flight_becomes_signed_tiles_reproducibly(self):
        f = self.folder
        summary = json.loads(self.good(*self.ask(f / "a", mosaic=f / "a.tif"), "--json").stdout)
        self.assertLess(summary["mosaic"]["fit_m"], 0.5, "the frames fit")
        self.assertEqual(5, summary["frames"])
        self.assertGreaterEqual(summary["tiles"], 1)
        self.good(*self.ask(f / "b", mosaic=f / "b.tif"))
        for one, other in (("a/tiles.mbtiles", "b/tiles.mbtiles"), ("a.tif", "b.tif")):
            self.assertEqual((f / one).read_bytes(), (f / other).read_bytes(), one)
        page = (f / "a.html").read_text()
        self.assertIn("data:image/webp;base64,", page)
        self.assertNotIn("src=\"http", page)

        database = sqlite3.connect(f"file:{f}/a/tiles.mbtiles?mode=ro", uri=True)
        rows = database.execute("SELECT c.sidecar, c.signature, t.tile_data, c.zoom_level, c.tile_column, c.tile_row "
                                "FROM nadir_candidates c JOIN tiles t USING (zoom_level, tile_column, tile_row)").fetchall()
        self.assertEqual(summary["tiles"], len(rows))
        manifest = hashlib.sha256((f / "package/manifest.json").read_bytes()).hexdigest()
        for text, signature, tile, z, x, row in rows:
            sidecar = json.loads(text)
            self.assertEqual(text, json.dumps(sidecar, sort_keys=True, separators=(",", ":")))
            self.assertEqual(hashlib.sha256(tile).hexdigest(), sidecar["sha256"])
            self.assertEqual((z, x, 2**z - 1 - row), (sidecar["z"], sidecar["x"], sidecar["y"]))
            self.assertEqual(manifest, sidecar["base_package"])
            self.assertEqual(1, sidecar["pose"]["refined"])
            self.assertTrue(sidecar["captured_at"].startswith("2025-09-20T10:00:"))
            body = text.encode()
            (f / "message").write_bytes(b"DSSEv1 %d %s %d %s" % (len(PAYLOAD), PAYLOAD, len(body), body))
            (f / "signature").write_bytes(signature)
            check = subprocess.run(["openssl", "pkeyutl", "-verify", "-pubin", "-inkey", f / "tile.pub.pem", "-rawin",
                                    "-in", f / "message", "-sigfile", f / "signature"], capture_output=True, text=True)
            self.assertEqual(0, check.returncode, check.stderr)

    def replay(self, out, *more):
        f = self.folder
        self.good("replay", self.start, "--package", f / "package", "--trust", f / "root.json", "--at", "2025-09-20",
                  "--frames", f / "flight/frames", "--telemetry", f / "flight/telemetry.csv", "--camera",
                  f / "world/camera.yaml", "--out", out, *more)

    def test_the_poses_of_a_replay_give_the_same_tiles(self):
        f = self.folder
        self.good(*self.ask(f / "flown"))
        self.replay(f / "result", "--record", f / "recording", "--keep-frames")
        poses = f / "result/poses.json"
        self.start = None
        self.good(*self.ask(f / "read", estimates=poses, mosaic=f / "balanced.tif"))
        self.good(*self.ask(f / "recorded", estimates=poses, recorder=f / "recording", frames=None, telemetry=None,
                            camera=None, mosaic=f / "exposed.tif"), "--as-exposed")
        flown = (f / "flown/tiles.mbtiles").read_bytes()
        for other in ("read", "recorded"):
            self.assertEqual(flown, (f / other / "tiles.mbtiles").read_bytes(), other)
        self.assertNotEqual((f / "balanced.tif").read_bytes(), (f / "exposed.tif").read_bytes(), "tiles are never balanced, mosaics are")
        tiles = sqlite3.connect(f"file:{f}/read/tiles.mbtiles?mode=ro", uri=True)
        self.assertGreaterEqual(tiles.execute("SELECT count(*) FROM tiles").fetchone()[0], 1)

        # Poses of another flight, map or camera, and damaged ones.
        document = json.loads(poses.read_text())
        for mentions, change in ((["flight", "expected"], {"flight": "0" * 12}), (["map"], {"base_package": "0" * 64}),
                             (["camera"], {"camera": "0" * 64}), (["plane"], {"origin": {"lon_deg": 8.0, "lat_deg": 47.0}}),
                             (["number of frames"], {"frames": 6}), (["schema", "nadir.poses/3"], {"schema": "nadir.poses/1"}),
                             (["/poses/0/agl_m"], {"poses": [document["poses"][0] | {"agl_m": None}]}),
                             (["name of a frame"], {"poses": [document["poses"][0] | {"frame": "other.jpg"}]})):
            (f / "changed.json").write_text(json.dumps(document | change))
            self.fails(2, *self.ask(f / "out", estimates=f / "changed.json"), mentions=mentions + ["changed.json"],
                       leaves_nothing=f / "out")
        (f / "changed.json").write_text(poses.read_text()[:-9])
        self.fails(2, *self.ask(f / "out", estimates=f / "changed.json"), mentions=["changed.json"], leaves_nothing=f / "out")
        self.fails(2, *self.ask(f / "out", estimates=f / "none.json"), mentions=["none.json"], leaves_nothing=f / "out")
        self.fails(2, *self.ask(f / "out", estimates=poses, odometry="flow"), mentions=["--odometry"], leaves_nothing=f / "out")

    def test_adjusted_poses_make_tiles(self):
        f = self.folder
        self.replay(f / "result", "--adjust")
        summary = json.loads((f / "result/summary.json").read_text())
        adjustment = summary["adjustment"]
        self.assertEqual("converged", adjustment["outcome"])
        self.assertLess(adjustment["mean_reprojection_px"], 1)
        self.assertGreater(adjustment["observations"], 50)
        self.assertEqual(5, adjustment["anchored_frames"])
        self.assertEqual(6, len((f / "result/adjusted.csv").read_text().splitlines()))
        self.assertEqual({"cameras.txt", "images.txt", "points3D.txt", "geo.txt"}, {path.name for path in (f / "result/colmap").iterdir()})
        self.replay(f / "plain", "--record", f / "recording", "--keep-frames")
        self.fails(2, "replay", "--recorder", f / "recording", "--package", f / "package", "--trust", f / "root.json", "--at", "2025-09-20",
                   "--adjust", "--out", f / "again", mentions=["--adjust"], leaves_nothing=f / "again")
        plain, adjusted = (json.loads((f / name / "poses.json").read_text())["poses"] for name in ("plain", "result"))
        self.assertEqual([pose["frame"] for pose in plain], [pose["frame"] for pose in adjusted])
        self.assertNotEqual(plain, adjusted)
        self.start = None
        self.good(*self.ask(f / "tiles", estimates=f / "result/poses.json"))
        tiles = sqlite3.connect(f"file:{f}/tiles/tiles.mbtiles?mode=ro", uri=True)
        self.assertGreaterEqual(tiles.execute("SELECT count(*) FROM tiles").fetchone()[0], 1)

    def test_frames_smaller_than_tiles_are_told_a_finer_zoom(self):
        f = self.folder
        coarse = self.good(*self.ask(f / "coarse", zoom=15), "--json")
        summary = json.loads(coarse.stdout)
        self.assertEqual(summary["frames_used"], summary["frames_without_whole_tile"])
        self.assertIn("cover no whole tile", summary["advice"])
        self.assertIn("note: " + summary["advice"], coarse.stderr)
        zoom = re.search(r"try --zoom (\d+)", summary["advice"]).group(1)
        finer = json.loads(self.good(*self.ask(f / "finer", zoom=zoom), "--json").stdout)
        self.assertGreater(finer["tiles"], summary["tiles"])
        self.assertNotIn("advice", finer)

    def test_it_explains_why_there_are_no_tiles(self):
        f = self.folder
        for mentions, changed in ((["tile key", "tile-signer"], {"key": f / "other.key.pem"}),
                              (["--airframe"], {"airframe": None}),
                              (["--captured"], {"captured": None}),
                              (["--captured"], {"captured": "yesterday"}),
                              (["names"], {"flight": "a/b"}),
                              (["none.csv"], {"telemetry": f / "none.csv"})):
            self.fails(2, *self.ask(f / "out", **changed), mentions=mentions, leaves_nothing=f / "out")
        self.fails(2, *self.ask(f / "out", mosaic=f / "no-such-folder/m.tif"), leaves_nothing=f / "out")
        (f / "there").mkdir()
        self.fails(2, *self.ask(f / "there"), mentions=["there"])
        shutil.copytree(f / "package", f / "tampered")
        manifest = f / "tampered/manifest.json"
        manifest.write_bytes(manifest.read_bytes().replace(b"1", b"2", 1))
        refused = run(*self.ask(f / "out", package=f / "tampered"))
        self.assertEqual(1, refused.returncode, refused.stderr)
        self.assertFalse((f / "out").exists())


if __name__ == "__main__":
    main()
