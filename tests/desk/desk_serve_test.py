#!/usr/bin/env python3
"""`nadir desk serve` as a user calls it: over a simulated map, killed at random moments, with a token beyond loopback.

usage: desk_serve_test.py NADIR
"""
import csv
import io
import math
import pathlib
import random
import sys
import threading
import time
import zipfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from desk_support import FRAMES, Desk, make_world  # noqa: E402
import support  # noqa: E402

KILLS = 50


class DeskServe(support.EndToEnd):
    def desk(self, *options):
        desk = Desk(self.folder / "desk", support.made_once("desk world", make_world), *options)
        self.addCleanup(lambda: desk.process and desk.process.poll() is None and desk.kill())
        return desk

    def replayed(self, made, at):
        """estimates.csv, refined.csv and adjusted.csv of `nadir replay` over the same frames."""
        flight, out = made / "flight", self.folder / "replay"
        self.good("replay", "--package", made / "package", "--trust", made / "root.json", "--at", at, "--frames", flight / "frames", "--telemetry",
                  flight / "telemetry.csv", "--camera", flight / "camera.yaml", "--adjust", "--out", out)
        return [(out / f"{name}.csv").read_text() for name in ("estimates", "refined", "adjusted")]

    @staticmethod
    def rows(text):
        """By frame, without what differs between two runs of the same: how long each took."""
        return [{name: value for name, value in row.items() if name != "latency_ms"} for row in csv.DictReader(io.StringIO(text))]

    def test_pictures_become_the_track_of_replay(self):
        desk = self.desk().start()
        self.assertEqual("valley", desk.json("GET", "/v1/packages", expect=200)["packages"][0]["name"])
        flight = desk.create(package="valley")
        answers = desk.send(flight, desk.frames())
        self.assertEqual({"accepted"}, {answer["outcome"] for answer in answers.values()})
        desk.settled(flight)
        desk.json("POST", flight + "/complete", expect=202)
        self.assertEqual("completed", desk.settled(flight)["state"])
        for kind, replayed in zip(("online", "refined", "adjusted"), self.replayed(desk.made, desk.at)):
            status, _, exported = desk.call("GET", f"{flight}/export?format=csv&kind={kind}")
            self.assertEqual(200, status)
            self.assertEqual(self.rows(replayed), self.rows(exported.decode()), kind)
        estimates = desk.json("GET", flight + "/estimates", expect=200)["estimates"]
        anchored = [estimate["frame"] for estimate in estimates if estimate["source"] == "satellite_anchored"]
        self.assertGreater(len(anchored), FRAMES // 2)
        look = desk.json("GET", f"{flight}/looks/{anchored[0]}", expect=200)
        self.assertEqual(("accepted", True, True), (look["verdict"], look["seen"], look["map"]))
        for image in (f"looks/{anchored[0]}/seen", f"looks/{anchored[0]}/map", "pictures/0?preview=true"):
            status, headers, data = desk.call("GET", f"{flight}/{image}")
            self.assertEqual((200, "image/jpeg", b"\xff\xd8"), (status, headers["Content-Type"], data[:2]), image)
        self.assertEqual(0, desk.stop())

    def test_a_flight_whose_start_is_wrong_is_placed_as_a_whole_and_taken_back(self):
        desk = self.desk().start()
        truth = list(csv.DictReader(io.StringIO((desk.made / "flight" / "truth.csv").read_text())))
        start = {"lat": float(truth[0]["lat_deg"]) + 0.05, "lon": float(truth[0]["lon_deg"])}  # 5.6 km off
        flight = desk.create(package="valley", start=start)
        desk.send(flight, desk.frames())
        document = desk.settled(flight)  # nobody has completed it: more pictures may come
        diagnosed = [data["diagnosis"] for _, kind, data in desk.events(flight, until=document["last_event"]) if kind == "diagnosis_changed"]
        self.assertEqual((2, None, None), (len(diagnosed), diagnosed[-1], document["diagnosis"]), "it is on the map now")
        self.assertIn("is the start wrong?", diagnosed[0])
        look = desk.json("GET", f"{flight}/looks/{FRAMES - 1}", expect=200)
        self.assertEqual(("placement", "accepted", True, True), (look["of"], look["verdict"], look["seen"], look["map"]))
        for image in ("seen", "map"):
            status, headers, data = desk.call("GET", f"{flight}/looks/{FRAMES - 1}/{image}")
            self.assertEqual((200, "image/jpeg", b"\xff\xd8"), (status, headers["Content-Type"], data[:2]), image)
            self.assertNotIn("immutable", headers["Cache-Control"])
        segments = desk.json("GET", flight + "/segments", expect=200)["segments"]
        self.assertEqual([("merged", 0, FRAMES - 1)], [(s["state"], s["first_frame"], s["last_frame"]) for s in segments])
        merged = [data for _, kind, data in desk.events(flight, until=document["last_event"]) if kind == "segments_merged"]
        self.assertEqual([("map", FRAMES)], [(data["by"], data["frames"]) for data in merged])
        for estimate, true in zip(desk.json("GET", flight + "/estimates?kind=refined", expect=200)["estimates"], truth):
            place = estimate["position"]
            north_m = (place["lat"] - float(true["lat_deg"])) * 111_200
            east_m = (place["lon"] - float(true["lon_deg"])) * 111_200 * 0.66
            self.assertLess(math.hypot(east_m, north_m), 20, estimate)
        desk.json("DELETE", flight + "/segments/0/merge", expect=200)
        desk.kill()
        desk.start()
        desk.send(flight, desk.frames())  # known, all of them; the flight is looked at again
        document = desk.settled(flight)
        self.assertEqual(diagnosed[0], document["diagnosis"], "it holds again")
        self.assertEqual("flight", desk.json("GET", f"{flight}/looks/{FRAMES - 1}", expect=200)["of"])
        again = [data["diagnosis"] for _, kind, data in desk.events(flight, until=document["last_event"]) if kind == "diagnosis_changed"]
        self.assertEqual([*diagnosed, diagnosed[0]], again, "each change once")
        self.assertEqual("floating", desk.json("GET", flight + "/segments", expect=200)["segments"][0]["state"], "for ever")
        refined = desk.json("GET", flight + "/estimates?kind=refined", expect=200)["estimates"]
        self.assertNotIn("satellite_anchored", [estimate["source"] for estimate in refined], "where the start says, with its doubt")
        self.assertEqual(0, desk.stop())

    def test_a_kill_while_a_flight_is_adjusted_leaves_the_wish_to_complete_it(self):
        desk = self.desk().start()
        flight = desk.create(package="valley")
        desk.send(flight, desk.frames())
        desk.settled(flight)
        desk.json("POST", flight + "/complete", expect=202)
        while "refined" not in desk.json("GET", flight, expect=200)["kinds"]:
            time.sleep(0.02)
        desk.kill()
        desk.start()
        document = desk.settled(flight)
        self.assertEqual(("completed", ["online", "refined", "adjusted"], 0), tuple(document[name] for name in ("state", "kinds", "completed_share")))
        self.assertEqual(FRAMES, len(desk.json("GET", flight + "/estimates?kind=adjusted", expect=200)["estimates"]))
        status, headers, archive = desk.call("GET", flight + "/export?format=colmap")
        self.assertEqual((200, "application/zip"), (status, headers["Content-Type"]))
        self.assertEqual(["cameras.txt", "geo.txt", "images.txt", "points3D.txt"], zipfile.ZipFile(io.BytesIO(archive)).namelist())
        self.assertEqual(0, desk.stop())

    def test_a_kill_loses_nothing_that_was_accepted(self):
        generator, desk = random.Random(5), self.desk()
        desk.start()
        flight = desk.create(package="valley")
        accepted, seen, fixes = {}, {}, 0
        waiting = desk.frames()
        for kill in range(KILLS):
            if kill:
                desk.start()
            for row in desk.json("GET", flight + "/estimates", expect=200)["estimates"]:
                self.assertEqual(seen.get(row["frame"], row), row, "an estimate that was seen before the kill is another one now")
                seen[row["frame"]] = row
            # One that was killed while it was answered is stored or not.
            self.assertGreaterEqual(len(desk.json("GET", flight + "/fixes", expect=200)["fixes"]), fixes)
            killer = threading.Timer(generator.uniform(0.02, 0.6), desk.kill)
            killer.start()
            try:
                while True:
                    batch, waiting = waiting[:2], waiting[2:]
                    if not batch:  # the last kills hit frames that are processed, smoothed and adjusted
                        desk.json("POST", flight + "/complete", expect=202)
                        time.sleep(0.02)
                        desk.json("GET", flight, expect=200)
                        continue
                    try:
                        answers = desk.send(flight, batch)
                    except ConnectionError:
                        waiting = batch + waiting  # nobody knows: it is sent again
                        raise
                    self.assertLessEqual({answer["outcome"] for answer in answers.values()}, {"accepted", "known"})
                    accepted.update({name: answer["frame"] for name, answer in answers.items()})
                    if len(accepted) == 4:
                        desk.json("POST", flight + "/fixes", {"lat": 47.4, "lon": 8.5, "radius_m": 400}, 201)
                        fixes += 1
            except ConnectionError:
                pass
            killer.join()
        desk.start()
        while waiting:
            batch, waiting = waiting[:2], waiting[2:]
            accepted.update({name: answer["frame"] for name, answer in desk.send(flight, batch).items()})
        desk.settled(flight)
        desk.json("POST", flight + "/complete", expect=202)
        document = desk.settled(flight)
        self.assertEqual(("completed", FRAMES), (document["state"], document["pictures"]["processed"]))
        self.assertEqual(["online", "refined", "adjusted"], document["kinds"])
        estimates = desk.json("GET", flight + "/estimates", expect=200)["estimates"]
        self.assertEqual(accepted, {row["name"]: row["frame"] for row in estimates})
        events = desk.events(flight, 0, document["last_event"])
        self.assertEqual(list(range(1, document["last_event"] + 1)), [number for number, _, _ in events])
        processed = [data["frame"] for _, kind, data in events if kind == "frame_processed"]
        self.assertEqual(list(range(FRAMES)), processed, "each frame once, in order")
        self.assertEqual(0, desk.stop())

    def test_sources_that_are_not_there_are_named_at_the_start(self):
        for option in ("--imagery", "--dem", "--camera", "--vectors", "--key"):
            self.fails(2, "desk", "serve", "--root", self.folder / "desk", "--listen", "127.0.0.1:0", option, self.folder / "mistyped.tif",
                       mentions=["no such file", option, "mistyped.tif"])

    def test_beyond_loopback_only_with_a_token(self):
        desk = self.desk()
        self.fails(2, "desk", "serve", "--root", desk.root, "--listen", "0.0.0.0:0", mentions=["token"])
        token = self.folder / "token"
        token.touch(0o600)
        token.write_text("a-secret-of-the-desk\n")
        desk.options = ("--token-file", token)
        desk.start("0.0.0.0:0")
        status, headers, _ = desk.call("GET", "/v1/flights")
        self.assertEqual((401, "Bearer"), (status, headers["WWW-Authenticate"]))
        self.assertEqual(200, desk.call("GET", "/v1/flights", headers={"Authorization": "Bearer a-secret-of-the-desk"})[0])
        self.assertEqual(200, desk.call("GET", "/")[0])
        self.fails(2, "desk", "serve", "--root", desk.root, "--listen", "127.0.0.1:0", mentions=["another desk"])
        self.assertEqual(0, desk.stop())


if __name__ == "__main__":
    support.main()
