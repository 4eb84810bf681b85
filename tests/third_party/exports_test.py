"""What nadir cache export writes, opened by other people's programs: the pmtiles package of PMTiles' own project, GDAL's drivers of
GeoPackage, MBTiles and TMS. All of them see the package's tiles: the same bytes where a program hands them out, else the same pixels.
And the other way round: a PMTiles file that the pmtiles package wrote is a tile set like any other."""
import json
import pathlib
import sqlite3
import subprocess
import sys
import tempfile
import unittest

from pmtiles.reader import MmapSource, Reader, all_tiles
from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import Writer

from tile_sets import ACROSS, PIXEL_M, TILE, ZOOM, TileSets, corners, gdal

NADIR = sys.argv[1]
AT = "2024-11-05T00:00:00Z"
FACTS = ["--captured", "2024-10-01", "--gsd-m", "0.9", "--ce90-m", "3", "--provider", "surveyor"]


def nadir(*args, code=0):
    result = subprocess.run([NADIR, *map(str, args)], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120)
    assert result.returncode == code, f"{args}: exit code {result.returncode}\n{result.stdout}\n{result.stderr}"
    return result


class Exports(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory(prefix="nadir-exports.")
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.sets = TileSets(cls.folder)
        for name in ("root", "planner"):
            nadir("keys", "create", "--out", cls.folder / name)
        nadir("keys", "root", "--root-key", cls.folder / "root.key.pem", "--package-signer", cls.folder / "planner.pub.pem",
              "--expires", "2035-01-01", "--out", cls.folder / "root.json")
        cls.packages = {image: cls.build(image) for image in ("jpeg", "png", "webp")}

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    @classmethod
    def build(cls, image):
        out = cls.folder / f"package-{image}"
        nadir("cache", "build", "--mission", cls.sets.mission, "--imagery", cls.sets.map, *FACTS, "--tile-format", image, "--key",
              cls.folder / "planner.key.pem", "--at", AT, "--out", out)
        return out

    def export(self, image, form):
        out = self.folder / f"{image}.{form}"
        nadir("cache", "export", self.packages[image], "--format", form, "--trust", self.folder / "root.json", "--at", AT, "--out", out)
        return out

    def tiles(self, image):
        """{(z, x, y): bytes} of the package, by SQLite."""
        with sqlite3.connect(self.packages[image] / "imagery" / "base.mbtiles") as database:
            rows = database.execute("SELECT zoom_level, tile_column, (1 << zoom_level) - 1 - tile_row, tile_data FROM tiles").fetchall()
        database.close()
        self.assertGreater(len(rows), 16)
        return {(z, x, y): data for z, x, y, data in rows}

    def pixels(self, source):
        """Of the picture's inner part, at the finest zoom, red, green and blue."""
        west, north, east, south = corners()
        margin = (east - west) / ACROSS
        west, north, east, south = (edge + PIXEL_M * sign / 3 for edge, sign in zip((west, north, east, south), (1, -1, 1, -1)))  # not on an edge
        raw = self.folder / "pixels.raw"
        gdal("gdal_translate", "-q", "-of", "ENVI", "-b", "1", "-b", "2", "-b", "3", "-projwin", west + margin, north - margin, east - margin,
             south + margin, source, raw)
        data = raw.read_bytes()
        self.assertEqual(3 * ((ACROSS - 2) * TILE) ** 2, len(data), source)
        self.assertGreater(len(set(data)), 50)
        return data

    def test_pmtiles_by_its_own_project(self):
        for image, kind in (("jpeg", TileType.JPEG), ("png", TileType.PNG), ("webp", TileType.WEBP)):
            with self.subTest(image), open(self.export(image, "pmtiles"), "rb") as file:
                source = MmapSource(file)
                header = Reader(source).header()
                tiles = self.tiles(image)
                self.assertEqual({key: data for key, data in all_tiles(source)}, tiles)
                self.assertEqual((kind, Compression.NONE, Compression.GZIP, True),
                                 (header["tile_type"], header["tile_compression"], header["internal_compression"], header["clustered"]))
                self.assertEqual((len(tiles), 16, 17), (header["addressed_tiles_count"], header["min_zoom"], header["max_zoom"]))
                self.assertEqual(len(set(tiles.values())), header["tile_contents_count"])
                west, east = header["min_lon_e7"] / 1e7, header["max_lon_e7"] / 1e7
                self.assertTrue(8.488 < west < 8.4955 and 8.5005 < east < 8.505, (west, east))
                self.assertEqual("surveyor", Reader(source).metadata()["attribution"])

    def test_geopackage_and_mbtiles_by_gdal(self):
        for image in ("jpeg", "png", "webp"):
            expected = self.pixels(self.packages[image] / "imagery" / "base.mbtiles")
            for form, driver in (("gpkg", "GPKG"), ("mbtiles", "MBTiles")):
                with self.subTest(f"{image} as {form}"):
                    out = self.export(image, form)
                    info = json.loads(subprocess.run(["gdalinfo", "-json", str(out)], check=True, capture_output=True, text=True).stdout)
                    self.assertEqual(driver, info["driverShortName"])
                    self.assertIn("3857", info["coordinateSystem"]["wkt"])
                    self.assertEqual(expected, self.pixels(out))

    def test_folders(self):
        tiles = self.tiles("jpeg")
        xyz, planner = self.export("jpeg", "xyz"), self.export("jpeg", "mission-planner")
        self.assertEqual({(f"{z}/{x}/{y}.jpg"): data for (z, x, y), data in tiles.items()},
                         {str(p.relative_to(xyz)): p.read_bytes() for p in xyz.rglob("*.jpg")})
        self.assertEqual({(f"TileDBv3/en/Custom/{z}/{y}/{x}.jpg"): data for (z, x, y), data in tiles.items()},
                         {str(p.relative_to(planner)): p.read_bytes() for p in planner.rglob("*") if p.is_file()})
        described = json.loads((xyz / "tiles.json").read_text())
        self.assertEqual((16, 17, "surveyor"), (described["minzoom"], described["maxzoom"], described["attribution"]))
        service = self.folder / "tms.xml"
        half = 20037508.342789244
        service.write_text(f"""<GDAL_WMS><Service name="TMS"><ServerUrl>file://{xyz}/${{z}}/${{x}}/${{y}}.jpg</ServerUrl></Service><DataWindow>
            <UpperLeftX>-{half}</UpperLeftX><UpperLeftY>{half}</UpperLeftY><LowerRightX>{half}</LowerRightX><LowerRightY>-{half}</LowerRightY>
            <TileLevel>{ZOOM}</TileLevel><TileCountX>1</TileCountX><TileCountY>1</TileCountY><YOrigin>top</YOrigin></DataWindow>
            <Projection>EPSG:3857</Projection><BlockSizeX>{TILE}</BlockSizeX><BlockSizeY>{TILE}</BlockSizeY><BandsCount>3</BandsCount>
            <ZeroBlockOnServerException>true</ZeroBlockOnServerException><ZeroBlockHttpCodes>204,404</ZeroBlockHttpCodes></GDAL_WMS>""")
        self.assertEqual(self.pixels(self.packages["jpeg"] / "imagery" / "base.mbtiles"), self.pixels(service))

    def test_pmtiles_that_others_wrote(self):
        tiles = self.tiles("jpeg")
        path = self.folder / "others.pmtiles"
        with open(path, "wb") as file:
            writer = Writer(file)
            for key in sorted(tiles, key=lambda key: zxy_to_tileid(*key)):
                writer.write_tile(zxy_to_tileid(*key), tiles[key])
            writer.finalize({"tile_type": TileType.JPEG, "tile_compression": Compression.NONE, "min_lon_e7": 84900000, "min_lat_e7": 473900000,
                             "max_lon_e7": 85100000, "max_lat_e7": 474100000, "center_zoom": 16, "center_lon_e7": 0, "center_lat_e7": 0},
                            {"attribution": "surveyor", "vector_layers": []})
        diff = json.loads(nadir("cache", "diff", self.packages["jpeg"] / "imagery" / "base.mbtiles", path, "--json", code=1).stdout)
        self.assertEqual((len(tiles), [], [], []), (diff["unchanged_tiles"], diff["added"], diff["removed"], diff["changed"]))
        valid = json.loads(nadir("cache", "validate", path, "--mission", self.sets.mission, "--json").stdout)
        self.assertEqual([], [f for f in valid["findings"] if f["severity"] == "refuse"])
        inspected = json.loads(nadir("cache", "inspect", path, "--json").stdout)
        self.assertIn("pmtiles", json.dumps(inspected))
        path.write_bytes(path.read_bytes()[:-100])
        self.assertIn("not a PMTiles file", nadir("cache", "validate", path, "--mission", self.sets.mission, code=2).stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
