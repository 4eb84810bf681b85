#!/usr/bin/env python3
"""nadir evaluate: miniatures of the published datasets, written as their formats say, with pictures and maps of the simulator."""
import csv
import datetime
import json
import math
import os
import shutil
import struct
import subprocess
import unittest
import zipfile

from support import EndToEnd, made_once, main, run

WIDTH, HEIGHT, FOCAL = 640, 480, 520.0
CAMERA = {"model": "pinhole", "width": WIDTH, "height": HEIGHT, "fx": FOCAL, "fy": FOCAL, "cx": (WIDTH - 1) / 2, "cy": (HEIGHT - 1) / 2,
          "uncertainty": {"heading_deg": 2.0, "agl_relative": 0.03, "tilt_deg": 1.0}}
FRAMES = 10


def tool(*args, **kwargs):
    return subprocess.run([*map(str, args)], check=True, capture_output=True, text=True, **kwargs).stdout


def rows_of(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def corners(raster):
    info = json.loads(tool("gdalinfo", "-json", raster))["cornerCoordinates"]
    return info["upperLeft"], info["lowerRight"]


def npy(kind, shape, data):
    """An array of NumPy, format 1.0."""
    sides = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': ({sides}), }}"
    head += " " * (-(10 + len(head) + 1) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + data


def doubles(*values):
    return npy("<f8", [len(values)], struct.pack(f"<{len(values)}d", *values))


def pixels(picture, folder):
    """Red, green, blue of each pixel."""
    ppm = folder / "one.ppm"
    tool("gdal_translate", "-q", "-of", "PNM", picture, ppm)
    data = ppm.read_bytes()
    ppm.unlink()
    return data[-3 * WIDTH * HEIGHT:]


def local_plane(places, lat, lon):
    """Metres east and north of (lat, lon) on the plane that the scenes of AnyVisLoc are in here."""
    crs = f"+proj=aeqd +lat_0={lat} +lon_0={lon} +datum=WGS84 +units=m"
    out = tool("gdaltransform", "-s_srs", "EPSG:4326", "-t_srs", crs, input="".join(f"{p[0]} {p[1]}\n" for p in places))
    return crs, [tuple(map(float, line.split()[:2])) for line in out.splitlines()]


class Evaluate(EndToEnd):
    def setUp(self):
        super().setUp()
        self.made = made_once("simulated flight", self.simulate)
        self.camera = self.made / "camera.yaml"
        self.telemetry = rows_of(self.made / "flight" / "telemetry.csv")
        self.truth = rows_of(self.made / "flight" / "truth.csv")
        self.frames = [self.made / "flight" / "frames" / row["frame"] for row in self.telemetry]

    def simulate(self, folder):
        (folder / "camera.yaml").write_text("".join(f"{key}: {json.dumps(value)}\n" for key, value in CAMERA.items()))
        self.good("simulate", "world", "--seed", 7, "--size-km", 0.7, "--gsd-m", 0.4, "--out", folder / "world")
        flown = ["simulate", "flight", "--dem", folder / "world" / "dem.tif", "--mission", folder / "world" / "mission.yaml", "--camera",
                 folder / "camera.yaml", "--max-frames", FRAMES, "--interval-s", 4]
        self.good(*flown, "--world", folder / "world" / "ground.tif", "--noise", "real", "--out", folder / "flight")
        # What a renderer of the map sees from the same poses.
        self.good(*flown, "--world", folder / "world" / "map.tif", "--noise", "none", "--out", folder / "rendered")
        tool("gdalwarp", "-q", "-t_srs", "EPSG:4326", "-r", "bilinear", folder / "world" / "map.tif", folder / "map4326.tif")

    def evaluated(self, *args, code=0):
        result = run("evaluate", *args, "--json")
        self.assertEqual(code, result.returncode, f"{args}\n{result.stdout}\n{result.stderr}")
        return json.loads(result.stdout)

    def is_placed(self, figures, frames=FRAMES):
        self.assertEqual(frames, figures["frames"])
        self.assertEqual(0, figures["wrong"], figures)
        self.assertGreaterEqual(figures["accepted"], 0.4 * frames, figures)
        self.assertGreaterEqual(figures["within_20_m_share"], 0.9, figures)
        self.assertGreaterEqual(figures["within_5_m_share"], 0.8, figures)
        self.assertLess(figures["candidate_median_m"], 4, figures)

    # ---- UAV-VisLoc

    def uav_visloc(self, ranges="satellite_coordinates_range.csv"):
        """Flight 03 has a map without georeference, flight 09 one in two parts that have it, and no angles."""
        folder = self.folder / "UAV-VisLoc"
        (west, north), (east, south) = corners(self.made / "map4326.tif")
        for name in ("03", "09"):
            (folder / name / "drone").mkdir(parents=True)
            begin = datetime.datetime(2018, 10, 23, 10, 50, 41)
            lines = ["num,filename,date,lat,lon,height" + (",Omega,Kappa,Phi1,Phi2" if name == "03" else "")]
            for i, (row, truth, picture) in enumerate(zip(self.telemetry, self.truth, self.frames)):
                file = f"{name}_{i + 1:04}.JPG"
                os.link(picture, folder / name / "drone" / file)
                time = (begin + datetime.timedelta(seconds=float(row["time_s"]))).isoformat()
                height = float(row["agl_m"]) + (400 if name == "09" else 0)
                lines.append(f"{i + 1},{file},{time},{truth['lat_deg']},{truth['lon_deg']},{height:.2f}" +
                             (f",{row['pitch_deg']},{row['roll_deg']},{row['heading_deg']},0" if name == "03" else ""))
            (folder / name / f"{name}.csv").write_text("\n".join(lines) + "\n")
        tool("gdal_translate", "-q", "-co", "PROFILE=BASELINE", self.made / "map4326.tif", folder / "03" / "satellite03.tif")
        (folder / "03" / "satellite03.tif.aux.xml").unlink(missing_ok=True)  # where GDAL would keep the georeference
        middle = (west + east) / 2
        for part, left, right in (("01-01", west, middle), ("01-02", middle, east)):
            tool("gdal_translate", "-q", "-projwin", left, north, right, south, self.made / "map4326.tif", folder / "09" / f"satellite09_{part}.tif")
        (folder / ranges).write_text("mapname,LT_lat_map,LT_lon_map,RB_lat_map,RB_lon_map,region\n"
                                     f"satellite03.tif,{north},{west},{south},{east},Taizhou-1\n")
        return folder

    def test_uav_visloc_frame_by_frame_and_as_a_flight(self):
        folder = self.uav_visloc(ranges="satellite_ coordinates_range.csv")  # as it is distributed
        found = self.evaluated(folder, "--dataset", "uav-visloc", "--camera", self.camera, "--flight", "03", "--recall", "--out",
                               self.folder / "frames.csv")
        self.is_placed(found["all"])
        self.assertEqual(["03"], list(found["flights"]))
        recall = found["recall"]["03"]
        self.assertGreater(recall["chunks"], 100)
        for heading, least in (("heading_known", 0.6), ("heading_unknown", 0.5)):
            self.assertEqual(FRAMES, recall[heading]["queries"])
            self.assertGreaterEqual(recall[heading]["recall_at_20"], least, recall)
            self.assertGreaterEqual(recall[heading]["recall_at_5"], recall[heading]["chance_at_5"], recall)
        self.assertEqual(FRAMES, len(rows_of(self.folder / "frames.csv")))
        flown = self.evaluated(folder, "--dataset", "uav-visloc", "--camera", self.camera, "--flight", "03", "--method", "flight")
        self.is_placed(flown["all"])
        few = [self.evaluated(folder, "--dataset", "uav-visloc", "--camera", self.camera, "--flight", "03", "--max-frames", 3, "--seed", seed)["all"]
               for seed in (5, 5, 6)]
        self.assertEqual(*({key: value for key, value in one.items() if not key.startswith("ms_")} for one in few[:2]))
        self.assertNotEqual(few[0]["candidate_median_m"], few[2]["candidate_median_m"])  # another square is searched

    def test_uav_visloc_map_in_parts_heights_above_the_sea_and_no_angles(self):
        found = self.evaluated(self.uav_visloc(), "--dataset", "uav-visloc", "--camera", self.camera, "--flight", "09", "--ground-m", 400,
                               "--search-m", 60, "--max-frames", 4)
        self.assertEqual(4, found["all"]["frames"])
        self.assertEqual(0, found["all"]["wrong"])
        self.assertGreaterEqual(found["all"]["candidates"], 3)  # all headings are possible, and the tilt is not known
        self.assertLess(found["all"]["candidate_median_m"], 20)

    def test_uav_visloc_says_what_is_wrong_and_where(self):
        folder = self.uav_visloc()
        command = ["evaluate", folder, "--dataset", "uav-visloc", "--flight", "03"]
        self.fails(2, *command, mentions=["--camera", "does not say which camera"])
        command += ["--camera", self.camera]
        table = folder / "03" / "03.csv"
        good = table.read_text()

        def broken(old, new, *mentions, more=()):
            self.assertIn(old, good)
            table.write_text(good.replace(old, new, 1))
            self.fails(2, *command, *more, mentions=mentions)
            table.write_text(good)
        broken("height", "hight", "03.csv", '"height"')
        broken(good, good.splitlines()[0] + "\n", "03.csv", "no pictures")
        broken(self.truth[0]["lat_deg"], "148.8", "03.csv:2, column lat", "148.8")
        broken("03_0004.JPG", "03_4000.JPG", "03.csv:5, column filename", "03_4000.JPG")
        broken("03_0004.JPG", "../03.csv", "03.csv:5, column filename")
        broken(f",{self.telemetry[1]['heading_deg']},", ",north,", "03.csv:3, column Phi1", "north")
        broken("2018-10-23T10:50:45", "yesterday", "03.csv:3, column date", more=["--method", "flight"])
        broken("2018-10-23T10:50:45", "2018-10-23T10:50:41", "03.csv:3, column date", "order of time", more=["--method", "flight"])
        ranges = folder / "satellite_coordinates_range.csv"
        text = ranges.read_text()
        ranges.write_text(text.replace("satellite03", "satellite04"))
        self.fails(2, *command, mentions=["column mapname", "satellite03.tif"])
        ranges.write_text(text.replace(",Taizhou", "0,Taizhou").replace("satellite03.tif,", "satellite03.tif,-"))
        self.fails(2, *command, mentions=["satellite_coordinates_range.csv:2"])
        ranges.unlink()
        self.fails(2, *command, mentions=["no folder of UAV-VisLoc"])
        ranges.write_text(text)
        self.fails(2, "evaluate", folder, "--dataset", "uav-visloc", "--flight", "77", "--camera", self.camera, mentions=["03, 09", "77"])
        small = self.folder / "small.yaml"
        small.write_text(self.camera.read_text().replace('640', '320'))
        self.fails(2, *command[:-1], small, mentions=["320×480", "640×480"])
        (folder / "03" / "satellite03.tif").unlink()
        self.fails(2, *command, mentions=["has no map", "satellite03.tif"])

    # ---- WildNav

    def wildnav(self):
        folder = self.folder / "wildnav"
        (folder / "assets" / "map").mkdir(parents=True)
        (folder / "assets" / "query").mkdir()
        (west, north), (east, south) = corners(self.made / "map4326.tif")
        middle = (west + east) / 2
        lines = ["Filename, Top_left_lat,Top_left_lon,Bottom_right_lat,Bottom_right_long"]
        for i, (left, right) in enumerate(((west, middle), (middle, east))):
            part = self.folder / "part.tif"
            tool("gdal_translate", "-q", "-projwin", left, north, right, south, self.made / "map4326.tif", part)
            (a, top), (b, bottom) = corners(part)
            tool("gdal_translate", "-q", "-of", "PNG", part, folder / "assets" / "map" / f"sat_map_{i:02}.png")
            lines.append(f'"sat_map_{i:02}.png",   {top:.7f},    {a:.7f},   {bottom:.7f},   {b:.7f}')
        for side in (folder / "assets" / "map").glob("*.aux.xml"):
            side.unlink()
        (folder / "assets" / "map" / "map.csv").write_text("\n".join(lines))
        lines = ["Filename,Latitude,Longitude,Altitude,Gimball_Roll,Gimball_Yaw,Gimball_Pitch,Flight_Roll,Flight_Yaw,Flight_Pitch"]
        for i, (row, truth, picture) in enumerate(zip(self.telemetry, self.truth, self.frames)):
            os.link(picture, folder / "assets" / "query" / f"drone_image_{i + 1}.jpg")
            heading = (float(row["heading_deg"]) + 180) % 360 - 180
            lines.append(f"drone_image_{i + 1}.jpg,{truth['lat_deg']},{truth['lon_deg']},{float(row['agl_m']):+.2f},{float(row['roll_deg']):+.2f},"
                         f"{heading:+.2f},{float(row['pitch_deg']) - 90:+.2f},NaN,+1.60,-11.00")
        (folder / "assets" / "query" / "photo_metadata.csv").write_text("\n".join(lines))
        return folder

    def test_wildnav(self):
        folder = self.wildnav()
        self.is_placed(self.evaluated(folder, "--dataset", "wildnav", "--camera", self.camera)["all"])
        self.assertEqual(5, self.evaluated(folder / "assets", "--dataset", "wildnav", "--camera", self.camera, "--max-frames", 5)["all"]["frames"])
        command = ["evaluate", folder, "--dataset", "wildnav", "--camera", self.camera]
        self.fails(2, *command, "--method", "flight", mentions=["WildNav has no times"])
        self.fails(2, *command, "--ground-m", 3, mentions=["--ground-m is not an option of wildnav"])
        photos = folder / "assets" / "query" / "photo_metadata.csv"
        text = photos.read_text()
        photos.write_text(text.replace(f"{float(self.telemetry[0]['agl_m']):+.2f}", "+high", 1))
        self.fails(2, *command, mentions=["photo_metadata.csv:2, column Altitude", "+high"])
        photos.write_text(text)
        maps = folder / "assets" / "map" / "map.csv"
        good = maps.read_text()
        maps.write_text(good.replace("sat_map_01.png", "sat_map_07.png"))
        self.fails(2, *command, mentions=["map.csv:3, column Filename", "sat_map_07.png"])

    # ---- AnyVisLoc

    def anyvisloc(self):
        folder = self.folder / "AnyVisLoc" / "Scene_01"
        folder.mkdir(parents=True)
        places = [(float(row["lon_deg"]), float(row["lat_deg"])) for row in self.truth]
        crs, local = local_plane(places, 48.7864, 14.0226)
        picture, heights = self.folder / "local.tif", self.folder / "heights.tif"
        tool("gdalwarp", "-q", "-t_srs", crs, "-tr", 0.4, 0.4, "-r", "bilinear", self.made / "world" / "map.tif", picture)
        (west, north), (east, south) = corners(picture)
        tool("gdal_translate", "-q", "-of", "PNG", picture, folder / "aerial_map.png")
        (folder / "aerial_map.png.aux.xml").unlink(missing_ok=True)
        tool("gdalwarp", "-q", "-t_srs", crs, "-tr", 2, 2, "-te", west, south, east, north, "-r", "bilinear", self.made / "world" / "dem.tif", heights)
        grid = self.folder / "heights.asc"
        tool("gdal_translate", "-q", "-of", "AAIGrid", "-co", "FORCE_CELLSIZE=YES", heights, grid)
        values = [[float(cell) for cell in line.split()] for line in grid.read_text().splitlines() if line[0] in " -0123456789"]
        values = [row for row in values if len(row) > 2]
        flat = [value for row in values for value in row]
        level = sum(flat) / len(flat)
        (folder / "aerial_dsm.npy").write_bytes(
            npy("<f4", [len(values), len(values[0])], struct.pack(f"<{len(flat)}f", *(value - level for value in flat))))
        mode = {"map_path": "aerial_map.png", "dsm_path": "aerial_dsm.npy", "map_resolution": [0.4, 0.4], "dsm_resolution": [2.0, 2.0],
                "map_origin_local": [0.0, 0.0], "dsm_origin_local": [0.0, 0.0]}
        (folder / "L01_reference.json").write_text(json.dumps({"scene_id": 1, "modes": {"aerial": mode}}))
        for i, (row, truth, at, frame) in enumerate(zip(self.telemetry, self.truth, local, self.frames)):
            with zipfile.ZipFile(folder / f"L01_{i + 1:04}.npz", "w", zipfile.ZIP_DEFLATED) as archive:
                arrays = {"image": npy("|u1", [HEIGHT, WIDTH, 3], pixels(frame, self.folder)), "K": npy("<f8", [3, 3], struct.pack(
                    "<9d", FOCAL, 0, (WIDTH - 1) / 2, 0, FOCAL, (HEIGHT - 1) / 2, 0, 0, 1)), "dist": doubles(0, 0, 0, 0, 0),
                    "xyz": doubles(at[0] - west, north - at[1], float(truth["alt_m"]) - level),
                    "euler_deg": doubles(*(float(row[f"{angle}_deg"]) for angle in ("roll", "pitch", "heading")))}
                for name, data in arrays.items():
                    archive.writestr(f"{name}.npy", data)
        return folder.parent

    def test_anyvisloc(self):
        folder = self.anyvisloc()
        self.is_placed(self.evaluated(folder, "--dataset", "anyvisloc")["all"])
        command = ["evaluate", folder, "--dataset", "anyvisloc"]
        self.fails(2, *command, "--reference", "satellite", mentions=["L01_reference.json /modes", "satellite"])
        self.fails(2, *command, "--camera", self.camera, mentions=["--camera is not an option of anyvisloc"])
        sample = folder / "Scene_01" / "L01_0001.npz"
        good = sample.read_bytes()

        def with_array(name, data):
            shutil.copy(sample, self.folder / "copy.npz")
            with zipfile.ZipFile(self.folder / "copy.npz") as source, zipfile.ZipFile(sample, "w") as target:
                for entry in source.namelist():
                    if entry != f"{name}.npy":
                        target.writestr(entry, source.read(entry))
                if data is not None:
                    target.writestr(f"{name}.npy", data)
        for name, data, mention in (("K", None, "array K"), ("xyz", doubles(1, 2), "array xyz"), ("xyz", doubles(1, 2, math.nan), "array xyz"),
                                    ("dist", npy("|O", [1], b"\x80\x04N."), "pickled"), ("image", b"\x93NUMPY", "array image"),
                                    ("image", npy("|u1", [60000, 60000, 3], b""), "array image"), ("xyz", doubles(10, 10, -900), "below the surface")):
            with_array(name, data)
            self.fails(2, *command, mentions=["L01_0001.npz", mention])
            sample.write_bytes(good)
        # Two cameras in one scene: one map, one index.
        with_array("K", npy("<f8", [3, 3], struct.pack("<9d", FOCAL + 1, 0, 319.5, 0, FOCAL + 1, 239.5, 0, 0, 1)))
        both = self.evaluated(folder, "--dataset", "anyvisloc", "--max-frames", 3, "--recall")
        self.assertEqual((3, 3), (both["all"]["frames"], both["recall"]["Scene_01"]["heading_unknown"]["queries"]))
        self.assertEqual(1, both["all"]["within_20_m_share"])
        sample.write_bytes(good[:len(good) // 2])
        self.fails(2, *command, mentions=["L01_0001.npz"])
        sample.write_bytes(good)
        reference = folder / "Scene_01" / "L01_reference.json"
        text = reference.read_text()
        for old, new, mention in (('"aerial_map.png"', '"../../map.tif"', "map_path"), ("[0.4, 0.4]", "[0.4, -0.4]", "map_resolution"),
                                  ('"dsm_path"', '"dsm"', "dsm_path")):
            reference.write_text(text.replace(old, new, 1))
            self.fails(2, *command, mentions=["L01_reference.json", mention])
        reference.unlink()
        self.fails(2, *command, mentions=["LNN_reference.json"])

    # ---- VPAIR

    def ecef(self, row):
        lon, lat, height = (float(row[name]) for name in ("lon_deg", "lat_deg", "alt_m"))
        lon, lat = math.radians(lon), math.radians(lat)
        n = 6378137 / math.sqrt(1 - 6.69437999014e-3 * math.sin(lat) ** 2)
        return ((n + height) * math.cos(lat) * math.cos(lon), (n + height) * math.cos(lat) * math.sin(lon),
                (n * (1 - 6.69437999014e-3) + height) * math.sin(lat))

    def vpair(self):
        folder = self.folder / "vpair"
        for name in ("queries", "reference_views", "distractors"):
            (folder / name).mkdir(parents=True)
        head = "filepath,x,y,z,undulation,roll,pitch,yaw"
        tables = {"query": [head], "reference_view": [head]}
        for i, (row, truth, picture) in enumerate(zip(self.telemetry, self.truth, self.frames)):
            rest = ",".join(f"{value:.3f}" for value in self.ecef(truth)) + ",46.1," + ",".join(
                f"{math.radians(float(row[f'{angle}_deg'])):.5f}" for angle in ("roll", "pitch", "heading"))
            for name, where, source in (("query", "queries", picture), ("reference_view", "reference_views", self.made / "rendered" / "frames" / picture.name)):
                os.link(source, folder / where / f"{i + 1:05}.jpg")
                tables[name].append(f"{where}/{i + 1:05}.jpg,{rest}")
        for name, lines in tables.items():
            (folder / f"poses_{name}.txt").write_text("\n".join(lines) + "\n")
        for i, place in enumerate(((300, 900), (700, 300), (1100, 1100))):
            tool("gdal_translate", "-q", "-of", "PNG", "-srcwin", *place, 400, 400, self.made / "world" / "map.tif", folder / "distractors" / f"{i}.png")
        return folder

    def test_vpair(self):
        folder = self.vpair()
        found = self.evaluated(folder, "--dataset", "vpair")
        self.assertEqual((FRAMES, FRAMES + 3), (found["queries"], found["references"]))
        self.assertGreaterEqual(found["recall_at_1"], 0.7, found)
        self.assertGreaterEqual(found["recall_at_5"], found["recall_at_1"])
        text = run("evaluate", folder, "--dataset", "vpair", "--max-frames", 5).stdout
        self.assertIn("5 queries among 13 references", text)
        self.fails(2, "evaluate", folder, "--dataset", "vpair", "--camera", self.camera, mentions=["--camera is not an option of vpair"])
        poses = folder / "poses_query.txt"
        good = poses.read_text()
        poses.write_text(good.replace("queries/00003.jpg,4", "queries/00003.jpg,9", 1))
        self.fails(2, "evaluate", folder, "--dataset", "vpair", mentions=["poses_query.txt:4, column x"])
        poses.write_text(good.replace("queries/00003.jpg", "queries/30000.jpg", 1))
        self.fails(2, "evaluate", folder, "--dataset", "vpair", mentions=["poses_query.txt:4, column filepath"])
        poses.write_text(good.rsplit("\n", 2)[0] + "\n")
        self.fails(2, "evaluate", folder, "--dataset", "vpair", mentions=["one reference for each query"])
        # The whole set has one table in degrees instead of the sample's two.
        for path in folder.glob("poses_*.txt"):
            path.unlink()
        self.fails(2, "evaluate", folder, "--dataset", "vpair", mentions=["no folder of VPAIR"])
        lines = ["filename,lat,lon,altitude,roll,pitch,yaw"]
        lines += [f"{i + 1:05}.jpg,{row['lat_deg']},{row['lon_deg']},{row['alt_m']},0,0,0" for i, row in enumerate(self.truth)]
        (folder / "poses.csv").write_text("\n".join(lines) + "\n")
        self.assertEqual(found["recall_at_1"], self.evaluated(folder, "--dataset", "vpair")["recall_at_1"])

    # ---- ALTO

    def alto(self):
        folder = self.folder / "ALTO" / "Val"
        (folder / "query_images").mkdir(parents=True)
        for offset in ("offset_0_None", "offset_40_North"):
            (folder / "reference_images" / offset).mkdir(parents=True)
        places = tool("gdaltransform", "-s_srs", "EPSG:4326", "-t_srs", "EPSG:32633",
                      input="".join(f"{row['lon_deg']} {row['lat_deg']}\n" for row in self.truth)).splitlines()
        queries, references, matches = ["easting,northing,altitude,orient_x,orient_y,orient_z,orient_w,name"], ["easting,northing,name"], [
            "query_ind,query_name,ref_ind,ref_name,distance"]
        for i, (row, place, picture) in enumerate(zip(self.telemetry, places, self.frames)):
            east, north = map(float, place.split()[:2])
            half = float(row["agl_m"]) * HEIGHT / FOCAL / 2
            os.link(picture, folder / "query_images" / f"{i:06}.png")
            queries.append(f"{east:.3f},{north:.3f},500,0,0,0,1,{i:06}.png")
            for offset, up in (("offset_0_None", 0), ("offset_40_North", 40)):
                tool("gdal_translate", "-q", "-of", "PNG", "-projwin", east - half, north + up + half, east + half, north + up - half,
                     self.made / "world" / "map.tif", folder / "reference_images" / offset / f"{i:06}.png")
                references.append(f"{east:.3f},{north + up:.3f},reference_images/{offset}/{i:06}.png")
            matches.append(f"{i},{i:06}.png,{2 * i},reference_images/offset_0_None/{i:06}.png,0.0")
        for name, lines in (("query", queries), ("reference", references), ("gt_matches", matches)):
            (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
        return folder.parent

    def test_alto(self):
        folder = self.alto()
        found = self.evaluated(folder, "--dataset", "alto")
        self.assertEqual((FRAMES, 2 * FRAMES), (found["queries"], found["references"]))
        self.assertGreaterEqual(found["recall_at_5"], 0.7, found)
        self.assertEqual(found["recall_at_5"], self.evaluated(folder / "Val", "--dataset", "alto")["recall_at_5"])
        matches = folder / "Val" / "gt_matches.csv"
        good = matches.read_text()
        matches.write_text(good.replace("offset_0_None/000004.png", "offset_0_None/900004.png", 1))
        self.fails(2, "evaluate", folder, "--dataset", "alto", mentions=["gt_matches.csv:6, column ref_name", "900004.png"])
        matches.write_text("\n".join(good.splitlines()[:-1]) + "\n")
        self.fails(2, "evaluate", folder, "--dataset", "alto", mentions=["column query_name", "000009.png"])
        (folder / "Val" / "query.csv").unlink()
        self.fails(2, "evaluate", folder, "--dataset", "alto", mentions=["no folder of ALTO"])


if __name__ == "__main__":
    main()
