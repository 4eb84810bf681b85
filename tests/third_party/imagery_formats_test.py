"""Imagery of a mission in the formats that people have: made by gdal-bin, by the pmtiles package, or byte by byte from the format's
specification; whole, and cut short. Formats that lose nothing give the same package, tile for tile, as the GeoTIFF does.
docs/package.md has the table of what works; what it says does not work is tried here too."""
import json
import pathlib
import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile
import unittest

from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import Writer

from tile_sets import TileSets, gdal

NADIR = sys.argv[1]
FACTS = ["--captured", "2024-10-01", "--gsd-m", "0.9", "--provider", "surveyor", "--licence", "CC-BY-4.0", "--attribution", "© surveyor"]


class ImageryFormats(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory(prefix="nadir-formats.")
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.sets = TileSets(cls.folder)
        cls.number = 0

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def build(self, raster, ce90_m=3):
        """Exit code, the result as JSON (None for exit code 2), what was said, and the package."""
        self.__class__.number += 1
        out = self.folder / f"package-{self.number}"
        result = subprocess.run([NADIR, "cache", "build", "--mission", self.sets.mission, "--imagery", raster, *FACTS, "--ce90-m", str(ce90_m),
                                 "--tile-format", "png", "--out", out, "--json"], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120)
        self.assertIn(result.returncode, (0, 1, 2), f"{raster}\n{result.stderr}")
        self.assertEqual(result.returncode == 0, out.exists())
        return result.returncode, json.loads(result.stdout) if result.returncode != 2 else None, result.stderr, out

    def imagery_of(self, package):
        manifest = json.loads((package / "manifest.json").read_text())
        return next(artifact["tiles"] for artifact in manifest["artifacts"] if artifact["role"] == "imagery")

    def translated(self, name, *options, source=None):
        gdal("gdal_translate", "-q", *options, source or self.sets.map, self.folder / name)
        for beside in self.folder.glob(name + ".aux.xml"):
            beside.unlink()
        return self.folder / name

    def pmtiles(self, name, mbtiles):
        """By PMTiles' own package, from the tiles of GDAL."""
        with sqlite3.connect(mbtiles) as database:
            rows = database.execute("SELECT zoom_level, tile_column, (1 << zoom_level) - 1 - tile_row, tile_data FROM tiles").fetchall()
        database.close()
        with open(self.folder / name, "wb") as file:
            writer = Writer(file)
            for tile_id, data in sorted((zxy_to_tileid(z, x, y), data) for z, x, y, data in rows):
                writer.write_tile(tile_id, data)
            writer.finalize({"tile_type": TileType.PNG, "tile_compression": Compression.NONE, "min_lon_e7": 0, "min_lat_e7": 0, "max_lon_e7": 0,
                             "max_lat_e7": 0, "center_zoom": 0, "center_lon_e7": 0, "center_lat_e7": 0}, {"name": "map"})
        return self.folder / name

    def lossless(self):
        vrt = self.folder / "map.vrt"
        gdal("gdalbuildvrt", "-q", vrt, self.sets.map)
        return {"COG, deflate": self.sets.cog_of(self.sets.map, "deflate.tif", "COMPRESS=DEFLATE"),
                "GeoTIFF in tiles, LZW": self.translated("lzw.tif", "-co", "TILED=YES", "-co", "COMPRESS=LZW"),
                "VRT": vrt,
                "JPEG 2000, reversible": self.translated("map.jp2", "-of", "JP2OpenJPEG", "-co", "QUALITY=100", "-co", "REVERSIBLE=YES"),
                "MBTiles of PNG": self.sets.png,
                "GeoPackage of PNG": self.translated("map.gpkg", "-of", "GPKG", "-co", "TILE_FORMAT=PNG", "-co", "TILING_SCHEME=GoogleMapsCompatible"),
                "PMTiles of PNG": self.pmtiles("map.pmtiles", self.sets.png)}

    def test_what_loses_nothing_gives_the_same_tiles(self):
        code, _, said, package = self.build(self.sets.map)
        self.assertEqual(0, code, said)
        expected = self.imagery_of(package)
        self.assertEqual([{"source": "surveyor", "licence": "CC-BY-4.0", "attribution": "© surveyor"}], expected["sources"])
        for name, raster in self.lossless().items():
            with self.subTest(name):
                code, _, said, package = self.build(raster)
                self.assertEqual(0, code, said)
                self.assertEqual(expected["merkle_root"], self.imagery_of(package)["merkle_root"])

    def test_what_is_cut_short_is_an_error_and_no_package(self):
        whole = {name: path for name, path in self.lossless().items() if name != "VRT"}
        whole["GeoTIFF"] = self.sets.map
        whole["NITF"] = self.utm("cut.ntf", "-of", "NITF")
        for name, raster in whole.items():
            with self.subTest(name):
                cut = self.folder / ("cut-" + raster.name)
                data = raster.read_bytes()
                cut.write_bytes(data[:len(data) * 6 // 10])
                code, _, said, _ = self.build(cut)
                self.assertEqual(2, code, said)
                self.assertIn(cut.name, said)
        vrt = self.folder / "orphan.vrt"
        lost = shutil.copy(self.sets.map, self.folder / "lost.tif")
        gdal("gdalbuildvrt", "-q", vrt, lost)
        pathlib.Path(lost).unlink()
        code, _, said, _ = self.build(vrt)
        self.assertEqual(2, code, said)

    def utm(self, name, *options):
        """The map in UTM, which NITF can state: the middles of its outermost pixels, in whole metres."""
        warped = self.folder / "utm.tif"
        if not warped.exists():
            gdal("gdalwarp", "-q", "-t_srs", "EPSG:32632", "-r", "near", "-tr", "1", "1", "-te", "461282.5", "5249138.5", "462533.5", "5250386.5",
                 self.sets.map, warped)
        return self.translated(name, *options, source=warped)

    # A NITF file states its corners in whole metres (UTM) or whole seconds: with the place that it states its map is metres off, and
    # nobody can see it. So its CE90 may not be better than that.
    def test_nitf_and_how_precisely_it_states_its_place(self):
        expected = self.build(self.utm("utm-again.tif"))
        self.assertEqual(0, expected[0], expected[2])
        code, _, said, package = self.build(self.utm("utm.ntf", "-of", "NITF"))
        self.assertEqual(0, code, said)
        self.assertEqual(self.imagery_of(expected[3])["merkle_root"], self.imagery_of(package)["merkle_root"])
        degrees = self.folder / "degrees.tif"
        gdal("gdalwarp", "-q", "-t_srs", "EPSG:4326", self.sets.map, degrees)
        coarse = self.translated("degrees.ntf", "-of", "NITF", "-co", "ICORDS=G", source=degrees)
        code, result, said, _ = self.build(coarse)
        self.assertEqual(1, code, said)
        self.assertIn("imagery.coarse_place", [f["code"] for f in result["findings"] if f["severity"] == "refuse"])
        self.assertEqual(0, self.build(coarse, ce90_m=20)[0])

    def test_terrain_as_hgt_dted_and_cog_is_the_same(self):
        side = 1201  # posts of a cell of one degree, from its north-western corner, row by row
        hgt = self.folder / "N47E008.hgt"
        hgt.write_bytes(b"".join(struct.pack(">h", 400 + (3 * row + 2 * column) % 50) for row in range(side) for column in range(side)))
        dted, cog = self.folder / "n47.dt1", self.folder / "dem.tif"
        gdal("gdal_translate", "-q", "-of", "DTED", hgt, dted)
        gdal("gdal_translate", "-q", "-of", "COG", hgt, cog)
        mission = self.folder / "hilly.yaml"
        mission.write_text(self.sets.mission.read_text().replace("{mode: flat}", "{mode: dem}"))
        made = []
        for number, dem in enumerate((hgt, dted, cog)):
            out = self.folder / f"hilly-{number}"
            command = [NADIR, "cache", "build", "--mission", mission, "--imagery", self.sets.map, *FACTS, "--ce90-m", "3", "--dem", dem, "--out", out]
            result = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120)
            self.assertEqual(0, result.returncode, f"{dem}\n{result.stdout}{result.stderr}")
            made.append((out / "terrain" / "dem.tif").read_bytes())
            cut = self.folder / ("cut-" + dem.name) if dem != hgt else self.folder / "N46E008.hgt"
            cut.write_bytes(dem.read_bytes()[:dem.stat().st_size * 3 // 10])  # the mission lies behind that
            command[command.index(dem)] = cut
            command[-1] = self.folder / "no"
            result = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120)
            self.assertNotEqual(0, result.returncode, f"{dem}, cut\n{result.stdout}{result.stderr}")
        self.assertEqual(made[0], made[1])
        self.assertEqual(made[0], made[2])

    def test_what_does_not_work_says_what_to_do(self):
        zarr = self.translated("map.zarr", "-of", "Zarr")
        self.assertEqual(2, self.build(zarr)[0])
        mrf = self.translated("map.mrf", "-of", "MRF")
        code, _, said, _ = self.build(mrf)
        self.assertEqual(2, code)
        self.assertIn("GeoTIFF", said)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
