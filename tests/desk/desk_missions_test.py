#!/usr/bin/env python3
"""Missions behind the desk's API, with the real program: from a mission file to a signed package that is byte for byte the
command line's; drafts, conflicts, wrong requests; cancelled, and killed while a package is built.

usage: desk_missions_test.py NADIR
"""
import filecmp
import json
import os
import pathlib
import shutil
import subprocess
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from desk_support import Desk, make_world  # noqa: E402
import support  # noqa: E402

STEPS = ["estimate", "build", "index", "matchability", "sign", "verify", "predict"]


class Missions(support.EndToEnd):
    def setUp(self):
        super().setUp()
        self.made = support.made_once("desk world", make_world)
        self.world = self.made / "world"
        self.desk = Desk(self.folder / "desk", self.made, "--imagery", self.world / "map.tif", "--dem", self.world / "dem.tif", "--camera",
                         self.world / "camera.yaml", "--key", self.made / "signer.key.pem", "--vectors", self.world / "vectors.geojson", "--vectors-attribution", "the simulator",
                         "--vectors-licence", "CC0-1.0").start()
        self.addCleanup(self.desk.stop)

    def imported(self, name="mission.yaml", data=None):
        data = (self.world / "mission.yaml").read_bytes() if data is None else data
        status, _, answer = self.desk.call("POST", f"/v1/missions/import?name={name}", data, {"Content-Type": "application/octet-stream"})
        self.assertEqual(201, status, answer)
        return json.loads(answer)["mission"]

    def start(self, mission, steps, expect=201, **sources):
        return self.desk.json("POST", f"/v1/missions/{mission}/jobs",
                              {"steps": steps, "imagery": ["map.tif"], "elevation": "dem.tif", "camera": "camera.yaml", "key": "signer.key.pem"} | sources, expect)

    def finished(self, mission):
        while True:
            job = self.desk.json("GET", f"/v1/missions/{mission}/jobs/latest", expect=200)
            if job["state"] not in ("waiting", "running"):
                return job
            time.sleep(0.05)

    def same_folder(self, one, other):
        files = sorted(str(path.relative_to(one)) for path in one.rglob("*") if path.is_file())
        self.assertEqual(files, sorted(str(path.relative_to(other)) for path in other.rglob("*") if path.is_file()))
        self.assertEqual(([], []), filecmp.cmpfiles(one, other, files, shallow=False)[1:])

    def test_a_token_signs(self):
        """A key that never leaves its token: named when the desk starts, by the command that signs alone, and not by the page."""
        module = pathlib.Path("/usr/lib/softhsm/libsofthsm2.so")
        if not module.exists() or not shutil.which("softhsm2-util"):
            self.skipTest("NOT TESTED: keys in tokens need softhsm2")
        (self.folder / "tokens").mkdir()
        (self.folder / "softhsm2.conf").write_text(f"directories.tokendir = {self.folder}/tokens\nobjectstore.backend = file\nlog.level = ERROR\n")
        (self.folder / "pin").write_text("1234\n")
        (self.folder / "pin").chmod(0o600)
        os.environ["SOFTHSM2_CONF"] = str(self.folder / "softhsm2.conf")
        self.addCleanup(os.environ.pop, "SOFTHSM2_CONF")
        for words in (["--init-token", "--free", "--label", "desk", "--so-pin", "87654321", "--pin", "1234"],
                      ["--import", self.made / "signer.key.pem", "--token", "desk", "--label", "planner", "--id", "01", "--pin", "1234"]):
            subprocess.run(["softhsm2-util", *words], check=True, capture_output=True)
        self.desk.stop()
        uri = "pkcs11:token=desk;object=planner"
        where = f"?module-path={module}&pin-source={self.folder / 'pin'}"
        for wrong, said in ((f"{uri}?pin-value=1234", "a PIN on the command line"), ("pkcs11:token=desk", "neither object="), ("none.key.pem", "no such file")):
            result = support.run("desk", "serve", "--root", self.folder / "desk", "--key", wrong)
            self.assertEqual(2, result.returncode)
            self.assertIn(said, result.stderr)
            self.assertNotIn("1234", result.stderr)
        self.desk.options = (*self.desk.options, "--key", uri + where)
        self.desk.start()
        self.assertEqual(["signer.key.pem", uri], [key["name"] for key in self.desk.json("GET", "/v1/planning", expect=200)["keys"]])
        mission = self.imported()["id"]
        self.start(mission, ["build", "sign", "verify"], key=uri)
        job = self.finished(mission)
        self.assertEqual(["done"] * 3, [step["state"] for step in job["steps"]], job)
        signed = self.desk.root / "packages" / self.desk.json("GET", f"/v1/missions/{mission}", expect=200)["package"]["name"]
        shutil.copytree(signed, self.folder / "by-token")
        result = support.run("cache", "sign", signed, "--key", self.made / "signer.key.pem", "--trust", self.made / "root.json")
        self.assertEqual(0, result.returncode, result.stderr)
        self.same_folder(signed, self.folder / "by-token")

    def test_from_a_file_to_a_package_that_flies(self):
        mission = self.imported()
        self.assertTrue(mission["valid"])
        self.assertGreater(mission["estimate"]["tiles"], 10)
        path = f"/v1/missions/{mission['id']}"
        self.assertEqual([{"name": "vectors.geojson", "problem": None}], self.desk.json("GET", "/v1/planning", expect=200)["vectors"])
        self.start(mission["id"], STEPS, vectors="vectors.geojson")
        job = self.finished(mission["id"])
        self.assertEqual(["done"] * 7, [step["state"] for step in job["steps"]], job)
        now = self.desk.json("GET", path, expect=200)
        name = now["package"]["name"]
        for fact in ("signed", "indexed", "matchability", "of_this_mission"):
            self.assertTrue(now["package"][fact], fact)
        self.assertTrue(now["prediction"]["of_this_mission"])
        self.assertIn(name, [pack["name"] for pack in self.desk.json("GET", "/v1/packages", expect=200)["packages"] if pack["accepted"]])

        # The same by hand, from the same file.
        package, world = self.folder / "by-hand", self.world
        for words in (["cache", "build", "--mission", world / "mission.yaml", "--imagery", world / "map.tif", "--dem", world / "dem.tif", "--vectors", world / "vectors.geojson",
                       "--vectors-attribution", "the simulator", "--vectors-licence", "CC0-1.0", "--out", package],
                      ["cache", "index", package, "--camera", world / "camera.yaml"],
                      ["cache", "matchability", package, "--into-package", "--camera", world / "camera.yaml"],
                      ["cache", "sign", package, "--key", self.made / "signer.key.pem", "--trust", self.made / "root.json"]):
            result = support.run(*words)
            self.assertEqual(0, result.returncode, result.stderr)
        self.same_folder(package, self.desk.root / "packages" / name)

        layers = {layer: self.desk.json("GET", f"{path}/layers/{layer}", expect=200)["features"] for layer in ("tiles", "gaps", "prediction")}
        self.assertEqual([], layers["gaps"])
        vectors = self.desk.json("GET", f"{path}/layers/vectors", expect=200)
        self.assertEqual(("the simulator", "CC0-1.0"), (vectors["attribution"], vectors["licence"]))
        classes = [feature["properties"]["class"] for feature in vectors["features"]]
        self.assertEqual({"road", "water", "wood", "building"}, set(classes))
        self.assertEqual(classes.count("building"), now["package"]["vectors"]["buildings"])
        self.assertEqual(vectors, self.desk.json("GET", f"/v1/packages/{name}/vectors", expect=200))
        self.assertIn(layers["tiles"][0]["properties"]["matchability"], ("good", "weak", "poor", None))
        self.assertGreater(len(layers["prediction"]), 5)
        for tiles in (f"{path}/tiles", "/v1/imagery/map.tif/tiles"):
            ring = layers["tiles"][len(layers["tiles"]) // 2]["properties"]["tile"]
            status, headers, image = self.desk.call("GET", f"{tiles}/{ring}")
            self.assertEqual((200, True), (status, len(image) > 300), headers)
        self.assertEqual(204, self.desk.call("GET", "/v1/imagery/map.tif/tiles/12/0/0")[0])
        profile = self.desk.json("GET", f"{path}/profile?camera=camera.yaml", expect=200)
        self.assertEqual("package", profile["ground"])
        self.assertGreater(len(profile["samples"]), 300)

        # A changed mission is not what the package was made for; a second build needs another sequence, or room.
        document = now["mission"] | {"budget_mb": 400}
        changed = self.desk.json("PUT", path, {"revision": now["revision"], "mission": document}, 200)
        self.assertFalse(changed["package"]["of_this_mission"])
        self.assertEqual("urn:nadir:problem:conflict", self.start(mission["id"], ["build"], 409)["type"])
        self.assertEqual(204, self.desk.call("DELETE", f"{path}/package")[0])
        self.start(mission["id"], ["build"])
        self.assertEqual("done", self.finished(mission["id"])["state"])
        self.assertEqual(204, self.desk.call("GET", f"{path}/layers/vectors")[0], "built without them")
        self.assertIsNone(self.desk.json("GET", path, expect=200)["package"]["vectors"])

    def test_what_the_imagery_does_not_cover(self):
        """Before anything is built: all of it is covered, then half, then nothing; too old and too coarse are reasons of their own."""
        mission = self.imported()
        path = f"/v1/missions/{mission['id']}"
        def coverage(change):
            now = self.desk.json("GET", path, expect=200)
            document = json.loads(json.dumps(mission["mission"]))
            change(document)
            self.assertTrue(self.desk.json("PUT", path, {"revision": now["revision"], "mission": document}, 200)["valid"])
            found = self.desk.json("GET", f"{path}/layers/imagery", expect=200)
            self.assertAlmostEqual(found["missing_m2"], sum(one["properties"]["area_m2"] for one in found["features"]), delta=len(found["features"]) + 1)
            return found, {one["properties"]["reason"] for one in found["features"]}
        def east(document, by):
            for point in document["route"]["points"]:
                point[0] += by
            document["takeoff"]["lon_deg"] += by
            for sector in document["sectors"]:
                for point in sector["polygon"]:
                    point[0] += by
        found, reasons = coverage(lambda document: None)
        self.assertEqual((0, set()), (found["missing_m2"], reasons))
        self.assertGreater(found["needed_m2"], 50_000)
        _, south, east_deg, north = self.desk.json("GET", "/v1/planning", expect=200)["imagery"][0]["bounds"]
        half, reasons = coverage(lambda document: east(document, east_deg - document["takeoff"]["lon_deg"]))
        self.assertEqual({"no imagery"}, reasons)
        self.assertTrue(0.05 * half["needed_m2"] < half["missing_m2"] < 0.95 * half["needed_m2"], half["missing_m2"] / half["needed_m2"])
        for one in half["features"]:
            ring = one["geometry"]["coordinates"][0] if one["geometry"]["type"] == "Polygon" else one["geometry"]["coordinates"][0][0]
            self.assertGreater(max(point[0] for point in ring), east_deg - 1e-4, "gaps lie beyond the eastern edge")
        away, reasons = coverage(lambda document: east(document, 0.1))
        self.assertEqual({"no imagery"}, reasons)
        self.assertAlmostEqual(away["needed_m2"], away["missing_m2"], delta=0.01 * away["needed_m2"])
        for change in (lambda document: document.update(min_resolution_m=0.45), lambda document: document["freshness_days"].update(stable=1, active=1)):
            stale, reasons = coverage(change)
            self.assertEqual({"imagery too old or too coarse"}, reasons)
            self.assertAlmostEqual(stale["needed_m2"], stale["missing_m2"], delta=0.01 * stale["needed_m2"])
        draft = self.desk.json("POST", "/v1/missions", {"name": "empty"}, 201)
        self.assertEqual(404, self.desk.call("GET", f"/v1/missions/{draft['id']}/layers/imagery")[0], "not complete")

    def test_drafts_conflicts_and_wrong_requests(self):
        draft = self.desk.json("POST", "/v1/missions", {"name": "Harbour, east side"}, 201)
        path = f"/v1/missions/{draft['id']}"
        self.assertEqual("Harbour-east-side", draft["mission"]["id"])
        self.assertFalse(draft["valid"])
        document = draft["mission"] | {"takeoff": {"lon_deg": 11.5, "lat_deg": 48.1}}
        document["route"]["points"] = [[11.5, 48.1], [11.6, 95]]
        wrong = self.desk.json("PUT", path, {"revision": 1, "mission": document}, 200)
        self.assertEqual(["route.points[1][1]"], [finding["where"] for finding in wrong["findings"]])
        self.assertIn("not complete", self.start(draft["id"], ["build"], 422)["detail"])
        self.assertEqual("urn:nadir:problem:changed", self.desk.json("PUT", path, {"revision": 1, "mission": document}, 409)["type"])
        document["route"]["points"] = [[11.5, 48.1], [11.51, 48.1]]
        self.assertTrue(self.desk.json("PUT", path, {"revision": 2, "mission": document}, 200)["valid"])
        for body in ({}, {"revision": 3}, {"revision": "3", "mission": {}}, {"revision": 3, "mission": []}):
            self.desk.json("PUT", path, body, 400)
        for change in ({"steps": []}, {"steps": ["fly"]}, {"quality": 0}, {"imagery": [7]}, {"surprise": 1}):
            self.start(draft["id"], **({"steps": ["build"], "expect": 400} | change))
        for change in ({"imagery": ["../planner.key.pem"]}, {"imagery": []}, {"key": "signer.pub.pem"}, {"camera": "/etc/passwd"}, {"vectors": "../vectors.geojson"}):
            self.start(draft["id"], ["build", "sign"], 422, **change)
        # Not the imagery's ground: the command's own findings arrive.
        self.start(draft["id"], ["build", "sign"])
        job = self.finished(draft["id"])
        self.assertEqual(["rejected", "cancelled"], [step["state"] for step in job["steps"]])
        self.assertTrue(job["steps"][0]["findings"], job)
        self.assertIsNone(self.desk.json("GET", path, expect=200)["package"])

        plan = self.desk.call("GET", f"{path}/file?format=plan")[2]
        again = self.imported("mission.plan", plan)
        self.assertEqual(document["route"]["points"], again["mission"]["route"]["points"])
        self.assertEqual(422, self.desk.call("POST", "/v1/missions/import?name=x.kml", b"<kml", {"Content-Type": "application/octet-stream"})[0])
        self.assertEqual(422, self.desk.call("GET", f"{path}/file?format=exe")[0])
        self.assertEqual(204, self.desk.call("DELETE", path)[0])
        self.assertEqual(404, self.desk.call("GET", path)[0])
        self.assertEqual([], [entry for entry in (self.desk.root / "missions").iterdir() if entry.name.startswith(".work-")])

    def test_killed_and_cancelled_while_a_package_is_built(self):
        mission = self.imported()
        for stop in ("kill", "cancel"):
            self.start(mission["id"], ["build", "index"])
            if stop == "cancel":
                self.desk.json("DELETE", f"/v1/missions/{mission['id']}/jobs/latest", expect=200)
                self.assertIn(self.finished(mission["id"])["state"], ("cancelled", "done"))
            else:
                time.sleep(0.15)
                self.desk.kill()
                self.desk.start()
                self.assertIn(self.desk.json("GET", f"/v1/missions/{mission['id']}/jobs/latest", expect=200)["state"], ("failed", "done"))
            time.sleep(0.3)  # the command ends by itself when the desk is gone
            self.desk.call("DELETE", f"/v1/missions/{mission['id']}/package")
        self.start(mission["id"], ["build", "index", "sign", "verify"])
        self.assertEqual("done", self.finished(mission["id"])["state"])
        self.assertEqual("", subprocess.run(["pgrep", "-P", str(self.desk.process.pid)], capture_output=True, text=True).stdout)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]], verbosity=2)
