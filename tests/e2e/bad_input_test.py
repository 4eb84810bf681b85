#!/usr/bin/env python3
"""Bad input to each command: exit code 2, a clear message, no output left behind."""
import subprocess

from support import AT, EndToEnd, main, write_jpeg


class Keys(EndToEnd):
    def test_create(self):
        self.fails(2, "keys", "create", "--out", self.folder / "no" / "such" / "k", leaves_nothing=self.folder / "no")
        self.good("keys", "create", "--out", self.folder / "k")
        before = (self.folder / "k.key.pem").read_bytes()
        self.fails(2, "keys", "create", "--out", self.folder / "k")
        self.assertEqual(before, (self.folder / "k.key.pem").read_bytes())

    def test_root(self):
        self.keys()
        out = self.folder / "new.json"
        args = lambda key, signer: ["keys", "root", "--root-key", key, "--package-signer", signer, "--expires", "2035-01-01", "--out", out]
        key, signer = self.folder / "root.key.pem", self.folder / "signer.pub.pem"
        self.fails(2, *args(self.folder / "none.pem", signer), mentions=["none.pem"], leaves_nothing=out)
        self.fails(2, *args(signer, signer), leaves_nothing=out)
        self.fails(2, *args(key, key), leaves_nothing=out)
        (self.folder / "short.pem").write_text(key.read_text()[:60])
        (self.folder / "short.pem").chmod(0o600)
        self.fails(2, *args(self.folder / "short.pem", signer), mentions=["short.pem"], leaves_nothing=out)
        key.chmod(0o644)
        self.fails(2, *args(key, signer), mentions=["root.key.pem"], leaves_nothing=out)


class Mission(EndToEnd):
    def test_check(self):
        self.fails(2, "mission", "check", self.folder / "none.yaml", mentions=["none.yaml"])
        self.fails(2, "mission", "check", self.folder)
        self.good("mission", "check", self.mission())


class Build(EndToEnd):
    def setUp(self):
        super().setUp()
        self.keys()
        self.out = self.folder / "package"

    def args(self, mission=None, imagery=None):
        return ["cache", "build", "--mission", mission or self.mission(), "--imagery", imagery or self.map(), "--key",
                self.folder / "signer.key.pem", "--out", self.out]

    def test_missing_files(self):
        self.fails(2, *self.args(mission=self.folder / "none.yaml"), mentions=["none.yaml"], leaves_nothing=self.out)
        self.fails(2, *self.args(imagery=self.folder / "none.tif"), mentions=["none.tif"], leaves_nothing=self.out)

    def test_wrong_type(self):
        text = self.folder / "text.tif"
        text.write_text("no raster")
        text.with_suffix(".json").write_text(self.map().with_suffix(".json").read_text())
        self.fails(2, *self.args(imagery=text), mentions=["text.tif"], leaves_nothing=self.out)

    def test_truncated(self):
        short = self.folder / "short.tif"
        short.write_bytes(self.map().read_bytes()[:200_000])
        short.with_suffix(".json").write_text(self.map().with_suffix(".json").read_text())
        self.fails(2, *self.args(imagery=short), leaves_nothing=self.out)

    def test_not_georeferenced(self):
        plain = self.folder / "plain.tif"
        write_jpeg(self.folder / "p.jpg", 64, 64)
        subprocess.run(["gdal_translate", "-q", str(self.folder / "p.jpg"), str(plain)], check=True)
        plain.with_suffix(".json").write_text(self.map().with_suffix(".json").read_text())
        self.fails(2, *self.args(imagery=plain), mentions=["plain.tif"], leaves_nothing=self.out)

    def test_no_metadata(self):
        raster = self.map()
        raster.with_suffix(".json").unlink()
        self.fails(2, *self.args(imagery=raster), leaves_nothing=self.out)

    def test_output_exists(self):
        self.out.mkdir()
        (self.out / "mine").write_text("mine")
        result = self.fails(2, *self.args(), mentions=["package"])
        self.assertEqual("mine", (self.out / "mine").read_text(), result.stderr)

    def test_a_rejected_build_leaves_nothing(self):
        wide = self.mission(change=lambda text: text.replace("8.4985", "8.4900"))
        self.fails(1, *self.args(mission=wide), mentions=["coverage.gap"], leaves_nothing=self.out)
        stale = self.mission(change=lambda text: text.replace("stable: 730, active: 400", "stable: 3, active: 3"))
        self.fails(1, *self.args(mission=stale), mentions=["freshness.stale"], leaves_nothing=self.out)


class Verify(EndToEnd):
    def test_inputs(self):
        self.keys()
        root = self.folder / "root.json"
        empty = self.folder / "empty"
        empty.mkdir()
        self.fails(2, "cache", "verify", self.folder / "none", "--trust", root)
        (self.folder / "half.json").write_text(root.read_text()[:100])
        self.fails(2, "cache", "verify", empty, "--trust", self.folder / "half.json", mentions=["half.json"])
        self.fails(2, "cache", "verify", empty, "--trust", self.folder / "none.json", mentions=["none.json"])

    def test_inspect_and_validate(self):
        text = self.folder / "x.mbtiles"
        text.write_text("no database")
        self.fails(2, "cache", "inspect", self.folder / "none")
        self.fails(2, "cache", "inspect", text, mentions=["x.mbtiles"])
        self.fails(2, "cache", "validate", self.folder / "none.mbtiles", "--mission", self.mission())


class Replay(EndToEnd):
    def setUp(self):
        super().setUp()
        self.flown = self.flight()
        self.out = self.folder / "out"

    def refused(self, *more, mentions=()):
        self.fails(2, *self.replay_args(self.flown, self.out), *more, mentions=mentions, leaves_nothing=self.out)

    def telemetry(self, change):
        path = self.flown / "telemetry.csv"
        path.write_text(change(path.read_text()))

    def test_nan(self):
        self.telemetry(lambda text: text.replace("1.jpg,1.0,100", "1.jpg,1.0,nan"))
        self.refused(mentions=["telemetry.csv:3"])

    def test_shuffled(self):
        self.telemetry(lambda text: "\n".join([text.splitlines()[i] for i in (0, 2, 1, 3)]) + "\n")
        self.refused(mentions=["order of time"])

    def test_duplicate(self):
        self.telemetry(lambda text: text + "2.jpg,3.0,100,90,0,0\n")
        self.refused(mentions=["two rows"])

    def test_unknown_frame(self):
        self.telemetry(lambda text: text + "7.jpg,3.0,100,90,0,0\n")
        self.refused(mentions=["7.jpg"])

    def test_truncated_telemetry(self):
        self.telemetry(lambda text: text[:-12])
        self.refused(mentions=["telemetry.csv"])

    def test_missing_column(self):
        self.telemetry(lambda text: text.replace("agl_m", "height"))
        self.refused(mentions=["agl_m"])

    def test_empty_files(self):
        self.telemetry(lambda text: "")
        self.refused(mentions=["telemetry.csv"])
        self.telemetry(lambda text: "frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg\n")
        self.refused(mentions=["telemetry.csv"])

    def test_empty_folder(self):
        for frame in (self.flown / "frames").iterdir():
            frame.unlink()
        self.refused(mentions=["no images"])

    def test_camera_of_another_size(self):
        camera = self.flown / "camera.yaml"
        camera.write_text(camera.read_text().replace("width: 320", "width: 640"))
        self.refused(mentions=["320×240", "640×240"])

    def test_broken_camera(self):
        camera = self.flown / "camera.yaml"
        camera.write_text(camera.read_text().replace("fx: 250.0", "fx: far"))
        self.refused(mentions=["camera.yaml:4"])
        camera.unlink()
        self.refused(mentions=["camera.yaml"])

    def test_files_that_are_not_images(self):
        (self.flown / "frames" / "1.jpg").write_text("not an image")
        self.refused(mentions=["1.jpg"])

    def test_options(self):
        self.refused("--package", self.folder / "p", mentions=["--trust"])
        self.refused("--truth", self.folder / "none.csv", mentions=["none.csv"])
        self.refused("--at", "yesterday", mentions=["--at"])
        self.refused("--odometry", "stars", mentions=["--odometry", "features", "stars"])
        self.refused("--matcher", "channels", mentions=["--package"])
        self.refused("--package", self.folder / "p", "--trust", self.folder / "r", "--matcher", "sift", mentions=["--matcher", "channels", "sift"])
        self.fails(2, *[a for a in self.replay_args(self.flown, self.out) if a not in ("--start", "8.499,47.4")], mentions=["--start"],
                   leaves_nothing=self.out)

    def test_output_exists(self):
        self.out.mkdir()
        self.fails(2, *self.replay_args(self.flown, self.out), mentions=["out"])
        self.assertEqual([], list(self.out.iterdir()))

    def test_a_folder_that_is_not_a_package(self):
        self.keys()
        self.refused("--package", self.folder / "none", "--trust", self.folder / "root.json", "--at", AT)


class Simulate(EndToEnd):
    def test_world(self):
        out = self.folder / "world"
        for args in (["--size-km", "0"], ["--size-km", "-1"], ["--size-km", "x"], ["--gsd-m", "0"]):
            base = {"--seed": "1", "--size-km": "0.5", "--gsd-m": "1"}
            base.update({args[0]: args[1]})
            self.fails(2, "simulate", "world", *[p for pair in base.items() for p in pair], "--out", out, leaves_nothing=out)

    def test_flight(self):
        out = self.folder / "fl"
        flight = self.flight()
        args = lambda world, mission, camera: ["simulate", "flight", "--world", world, "--mission", mission, "--camera", camera, "--out", out]
        mission, camera = self.mission(), flight / "camera.yaml"
        self.fails(2, *args(self.folder / "none.tif", mission, camera), mentions=["none.tif"], leaves_nothing=out)
        self.fails(2, *args(self.map(), self.folder / "none.yaml", camera), mentions=["none.yaml"], leaves_nothing=out)
        self.fails(2, *args(self.map(), mission, self.folder / "none.yaml"), mentions=["none.yaml"], leaves_nothing=out)
        text = self.folder / "text.tif"
        text.write_text("no raster")
        self.fails(2, *args(text, mission, camera), mentions=["text.tif"], leaves_nothing=out)


if __name__ == "__main__":
    main()
