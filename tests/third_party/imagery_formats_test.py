"""Imagery of a mission in the formats that people have: made by gdal-bin, by the pmtiles package, or byte by byte from the format's
specification; whole, and cut short. Formats that lose nothing give the same package, tile for tile, as the GeoTIFF does.
docs/package.md has the table of what works; what it says does not work is tried here too."""
import json
import math
import pathlib
import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile
import unittest
import zipfile

from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import Writer

from cadrg import Frame
from tile_sets import ACROSS, HALF_WORLD_M, NORTH_ROW, PIXEL_M, TileSets, WEST_COLUMN, corners, gdal

NADIR = sys.argv[1]
FACTS = ["--captured", "2024-10-01", "--gsd-m", "0.9", "--provider", "surveyor", "--licence", "CC-BY-4.0", "--attribution", "© surveyor"]


def mercator_latitude(y_m):
    return math.degrees(2 * math.atan(math.exp(y_m / 6378137)) - math.pi / 2)


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

    def tpkx(self, name, mbtiles):
        """As github.com/Esri/tile-package-spec describes it, from the tiles of GDAL. Returns the package, and the folder of a map cache
        with the same bundles, which GDAL 3.6 reads (its driver ESRIC, which is not ours)."""
        with sqlite3.connect(mbtiles) as database:
            tiles = {(z, (1 << z) - 1 - y, x): data for z, x, y, data in database.execute("SELECT * FROM tiles")}
        database.close()
        bundles = {}
        for (level, row, column), data in tiles.items():
            index, content = bundles.setdefault((level, row // 128 * 128, column // 128 * 128), ([0] * 128 * 128, bytearray()))
            index[row % 128 * 128 + column % 128] = (64 + 8 * 128 * 128 + len(content) + 4) | len(data) << 40
            content += struct.pack("<I", len(data)) + data
        size = 20037508.342787
        resolutions = [156543.03392800014 / 2**level for level in range(20)]
        root = {"version": "1.0.0", "tileBundlesPath": "tile", "minLOD": 0, "maxLOD": 19, "resampling": False, "tileImageInfo": {"format": "PNG"},
                "storageInfo": {"storageFormat": "esriMapCacheStorageModeCompactV2", "packetSize": 128},
                "tileInfo": {"rows": 256, "cols": 256, "dpi": 96, "format": "PNG", "origin": {"x": -size, "y": size},
                             "spatialReference": {"wkid": 102100, "latestWkid": 3857},
                             "lods": [{"level": level, "resolution": r, "scale": r * 3779.5} for level, r in enumerate(resolutions)]}}
        cache = self.folder / (name + ".cache")
        with zipfile.ZipFile(self.folder / name, "w", zipfile.ZIP_STORED) as archive:
            archive.writestr("root.json", json.dumps(root))
            for (level, row, column), (index, content) in bundles.items():
                largest = max(entry >> 40 for entry in index)
                head = struct.pack("<IIIIQQQIIIIIII", 3, 128 * 128, largest, 5, 0, 64 + 8 * 128 * 128 + len(content), 40, 16 + 8 * 128 * 128, 0, 0, 0, 0, 0, 0)[:36]
                head = head.ljust(60, b"\0") + struct.pack("<I", 8 * 128 * 128)
                head = head[:32] + struct.pack("<II", 40, 0) + head[40:]
                bundle = head + struct.pack(f"<{128 * 128}Q", *index) + content
                file = f"L{level:02d}/R{row:04x}C{column:04x}.bundle"
                archive.writestr("tile/" + file, bundle)
                (cache / "_alllayers" / file).parent.mkdir(parents=True, exist_ok=True)
                (cache / "_alllayers" / file).write_bytes(bundle)
        deepest = max(level for level, _, _ in bundles)
        lods = "".join(f"<LODInfo><LevelID>{level}</LevelID><Resolution>{r!r}</Resolution></LODInfo>" for level, r in enumerate(resolutions[:deepest + 1]))
        (cache / "conf.xml").write_text(
            f"<CacheInfo><TileCacheInfo><SpatialReference><WKT>EPSG:3857</WKT></SpatialReference><TileOrigin><X>{-size}</X><Y>{size}</Y></TileOrigin>"
            f"<TileCols>256</TileCols><TileRows>256</TileRows><LODInfos>{lods}</LODInfos></TileCacheInfo><TileImageInfo><CacheTileFormat>PNG</CacheTileFormat>"
            "</TileImageInfo><CacheStorageInfo><StorageFormat>esriMapCacheStorageModeCompactV2</StorageFormat><PacketSize>128</PacketSize></CacheStorageInfo>"
            "</CacheInfo>")
        return self.folder / name, cache / "conf.xml"

    def lossless(self):
        vrt = self.folder / "map.vrt"
        gdal("gdalbuildvrt", "-q", vrt, self.sets.map)
        return {"COG, deflate": self.sets.cog_of(self.sets.map, "deflate.tif", "COMPRESS=DEFLATE"),
                "GeoTIFF in tiles, LZW": self.translated("lzw.tif", "-co", "TILED=YES", "-co", "COMPRESS=LZW"),
                "VRT": vrt,
                "JPEG 2000, reversible": self.translated("map.jp2", "-of", "JP2OpenJPEG", "-co", "QUALITY=100", "-co", "REVERSIBLE=YES"),
                "MBTiles of PNG": self.sets.png,
                "GeoPackage of PNG": self.translated("map.gpkg", "-of", "GPKG", "-co", "TILE_FORMAT=PNG", "-co", "TILING_SCHEME=GoogleMapsCompatible"),
                "PMTiles of PNG": self.pmtiles("map.pmtiles", self.sets.png),
                "Esri tile package of PNG": self.tpkx("map.tpkx", self.sets.png)[0]}

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

    def tiled(self, name, tile_format="GTiff", ending="tif", side=512, source=None, change=lambda item: None, options=()):
        """An item of STAC's tiled assets as its specification has it: tiles cut by GDAL, of 512 pixels in zoom 17's pixels, and the
        document by hand, because no free program writes one. A finer tile matrix is planned and empty."""
        folder = self.folder / name
        across = ACROSS * 256 // side
        column, row, corner = WEST_COLUMN * 256 // side, NORTH_ROW * 256 // side, [-HALF_WORLD_M, HALF_WORLD_M]
        if across == 1:  # one tile is the picture
            column, row, corner = 0, 0, corners()[:2]
        tiles = self.folder / f"tiles-{ending}-{side}-{(source or self.sets.map).stem}{''.join(options)}"
        for y in range(across if not tiles.exists() else 0):
            for x in range(across):
                tile = tiles / f"17/{row + y}/{column + x}.{ending}"
                tile.parent.mkdir(parents=True, exist_ok=True)
                gdal("gdal_translate", "-q", "-of", tile_format, "-srcwin", x * side, y * side, side, side, *options, "--config", "GDAL_PAM_ENABLED", "NO",
                     source or self.sets.map, tile)
        shutil.copytree(tiles, folder / "WebMercatorQuad")

        def matrix(zoom):
            return {"type": "TileMatrixType", "identifier": str(zoom), "scaleDenominator": PIXEL_M * 2**(17 - zoom) / 0.28e-3,
                    "topLeftCorner": corner, "tileWidth": side, "tileHeight": side,
                    "matrixWidth": 2**zoom * 256 // side, "matrixHeight": 2**zoom * 256 // side}
        limits = {"min_tile_col": column, "max_tile_col": column + across - 1, "min_tile_row": row, "max_tile_row": row + across - 1}
        finer = {key: 2 * value for key, value in limits.items()}
        item = {"stac_version": "1.0.0", "stac_extensions": ["tiled-assets", "https://stac-extensions.github.io/tiled-assets/v1.0.0/schema.json"], "type": "Feature",
                "id": name, "geometry": None, "links": [], "assets": {},
                "properties": {"datetime": "2024-10-01T00:00:00Z",
                               "tiles:tile_matrix_links": {"WebMercatorQuad": {"url": "#WebMercatorQuad", "limits": {"17": limits, "18": finer}}},
                               "tiles:tile_matrix_sets": {"WebMercatorQuad": {"type": "TileMatrixSetType", "identifier": "WebMercatorQuad",
                                                                              "supportedCRS": "http://www.opengis.net/def/crs/EPSG/0/3857",
                                                                              "tileMatrix": [matrix(zoom) for zoom in (16, 17, 18)]}}},
                "asset_templates": {"map": {"href": "./{TileMatrixSet}/{TileMatrix}/{TileRow}/{TileCol}." + ending, "type": "image/tiff; application=geotiff"}}}
        change(item)
        (folder / "item.json").write_text(json.dumps(item))
        return folder / "item.json"

    def a_tile_of(self, item):
        """In the middle of the picture, so that the mission needs it."""
        return sorted(item.parent.glob("WebMercatorQuad/17/*/*"))[4]

    def test_tiled_assets(self):
        expected = self.imagery_of(self.build(self.sets.map)[3])["merkle_root"]

        def as_version_2(item):
            tiles = item["properties"]["tiles:tile_matrix_sets"]["WebMercatorQuad"]
            tiles["crs"], tiles["tileMatrices"] = tiles.pop("supportedCRS"), tiles.pop("tileMatrix")
            for one in tiles["tileMatrices"]:
                one["id"], one["pointOfOrigin"] = one.pop("identifier"), one.pop("topLeftCorner")
            item["properties"]["tiles:tile_matrix_set_links"] = item["properties"].pop("tiles:tile_matrix_links")
        with_nodata = self.translated("tiled-nodata.tif", "-a_nodata", "0")
        for name, how in (("tiff", {}), ("png", {"tile_format": "PNG", "ending": "png"}), ("quarter", {"side": 256}), ("second", {"change": as_version_2}),
                          ("blocks", {"side": 1536, "options": ("-co", "TILED=YES")}), ("rows", {"side": 1536, "options": ("-co", "BLOCKYSIZE=100")}),
                          ("nodata", {"source": with_nodata})):
            with self.subTest(name):
                code, _, said, package = self.build(self.tiled("tiled-" + name, **how))
                self.assertEqual(0, code, said)
                self.assertEqual(expected, self.imagery_of(package)["merkle_root"])

    # Degrees, whose scale denominators count metres of the equator; GeoTIFFs call the same system EPSG:4326.
    def test_tiled_assets_in_degrees(self):
        degrees = self.folder / "tiled-degrees.tif"
        west, south, east, north = 8.4925, 47.3945, 8.5035, 47.4025
        step = 5e-6  # a tile has 550 x 400 of them
        gdal("gdalwarp", "-q", "-t_srs", "EPSG:4326", "-te", west, south, east, north, "-tr", step, step, self.sets.map, degrees)
        expected = self.build(degrees)
        self.assertEqual(0, expected[0], expected[2])
        folder = self.folder / "tiled-in-degrees"
        folder.mkdir()
        for y in range(4):
            for x in range(4):
                gdal("gdal_translate", "-q", "-srcwin", 550 * x, 400 * y, 550, 400, degrees, folder / f"{y}_{x}.tif")
        grid = {"identifier": "all", "scaleDenominator": step * math.pi / 180 * 6378137 / 0.28e-3, "topLeftCorner": [west, north],
                "tileWidth": 550, "tileHeight": 400, "matrixWidth": 4, "matrixHeight": 4}
        item = {"type": "Feature", "properties": {"tiles:tile_matrix_sets": {"own": {"supportedCRS": "http://www.opengis.net/def/crs/OGC/1.3/CRS84",
                                                                                     "tileMatrix": [grid]}}},
                "asset_templates": {"map": {"href": "{TileRow}_{TileCol}.tif"}}}
        (folder / "item.json").write_text(json.dumps(item))
        code, _, said, package = self.build(folder / "item.json")
        self.assertEqual(0, code, said)
        self.assertEqual(self.imagery_of(expected[3])["merkle_root"], self.imagery_of(package)["merkle_root"])

    # The document is made by this test: another reader must see the same picture in it. It wants all tiles of all tile matrices.
    def test_tiled_assets_are_some_to_gdal(self):
        def without_18(item):
            item["properties"]["tiles:tile_matrix_links"]["WebMercatorQuad"]["limits"].pop("18")
            sets = item["properties"]["tiles:tile_matrix_sets"]["WebMercatorQuad"]
            sets["tileMatrix"] = [one for one in sets["tileMatrix"] if one["identifier"] == "17"]
        item = self.tiled("tiled-judged", change=without_18)
        checksums = [[band["checksum"] for band in json.loads(subprocess.run(["gdalinfo", "-json", "-checksum", raster], capture_output=True, check=True).stdout)["bands"]]
                     for raster in (item, self.sets.map)]
        self.assertEqual(checksums[1], checksums[0])

    def test_a_collection_leads_to_tiled_assets(self):
        item = self.tiled("tiled-linked")
        collection = self.folder / "tiled-linked/collection.json"
        collection.write_text(json.dumps({"type": "Collection", "license": "CC0-1.0", "links": [{"rel": "item", "href": "./item.json"}]}))
        code, _, said, _ = self.build(collection)
        self.assertEqual(0, code, said)
        # Of several items in one document it would not be clear from where their tiles count.
        listed = self.folder / "tiled-linked/list.json"
        listed.write_text(json.dumps({"type": "FeatureCollection", "features": [json.loads(item.read_text())]}))
        code, _, said, _ = self.build(listed)
        self.assertEqual(2, code, said)
        self.assertIn("a document of its own", said)
        result = subprocess.run([NADIR, "cache", "pin", item], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
        self.assertEqual(2, result.returncode)
        self.assertIn("tiled", result.stderr)

    def test_tiles_that_are_missing_are_a_gap(self):
        for name, how in (("lost-alpha", {}), ("lost-nodata", {"source": self.translated("lost-nodata.tif", "-a_nodata", "0")})):
            with self.subTest(name):
                item = self.tiled("tiled-" + name, **how)
                self.a_tile_of(item).unlink()
                code, result, said, _ = self.build(item)
                self.assertEqual(1, code, said)
                self.assertIn("coverage.gap", [finding["code"] for finding in result["findings"]])

    def test_tiled_assets_that_are_damaged_or_others(self):
        def spoiled(name, spoil=lambda item: None, **how):
            item = self.tiled("tiled-" + name, **how)
            spoil(item)
            return item

        def cut(item):
            tile = self.a_tile_of(item)
            tile.write_bytes(tile.read_bytes()[:tile.stat().st_size // 2])

        def exchange(item):
            tile = self.a_tile_of(item)
            other = tile.with_stem(str(int(tile.stem) + 1))
            kept = tile.read_bytes()
            tile.write_bytes(other.read_bytes()), other.write_bytes(kept)

        def smaller(item):
            tile = self.a_tile_of(item)
            gdal("gdal_translate", "-q", "-of", "GTiff", "-outsize", 256, 256, tile, tile.with_suffix(".small"))
            tile.with_suffix(".small").rename(tile)

        def grey(item):
            tile = self.a_tile_of(item)
            gdal("gdal_translate", "-q", "-of", "GTiff", "-b", 1, tile, tile.with_suffix(".grey"))
            tile.with_suffix(".grey").rename(tile)

        def with_palette(item):
            tile = self.a_tile_of(item)
            described = tile.with_suffix(".vrt")
            gdal("gdal_translate", "-q", "-of", "VRT", tile, described)
            table = "<ColorTable>" + "".join(f'<Entry c1="{i}" c2="{255 - i}" c3="0"/>' for i in range(256)) + "</ColorTable>"
            described.write_text(described.read_text().replace("<ColorInterp>Gray</ColorInterp>", "<ColorInterp>Palette</ColorInterp>" + table))
            gdal("gdal_translate", "-q", "-of", "GTiff", described, tile.with_suffix(".new"))
            tile.with_suffix(".new").rename(tile)

        def vrt(item):
            tile = self.a_tile_of(item)
            tile.write_text('<VRTDataset rasterXSize="512" rasterYSize="512"><VRTRasterBand dataType="Byte" band="1"><SimpleSource><SourceFilename>'
                            "/vsicurl/http://localhost/x.tif</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>")

        def to(value, *path):
            def change(item):
                for key in path[:-1]:
                    item = item[key]
                item[path[-1]] = value
            return change
        sets, links = ("properties", "tiles:tile_matrix_sets", "WebMercatorQuad"), ("properties", "tiles:tile_matrix_links", "WebMercatorQuad")
        href = ("asset_templates", "map", "href")
        for name, mention, item in (
                ("cut", ".tif", spoiled("cut", cut)),
                ("exchanged", "by its own statement", spoiled("exchanged", exchange)),
                ("smaller", "256 x 256", spoiled("smaller", smaller)),
                ("grey", "not like the first tile", spoiled("grey", grey)),
                ("palette", "with a palette", spoiled("palette", with_palette, source=self.translated("tiled-grey.tif", "-b", "1", "-colorinterp", "gray"))),
                ("vrt", ".tif", spoiled("vrt", vrt)),
                ("sides", "as the tile matrix says", spoiled("sides", change=to(256, *sets, "tileMatrix", 1, "tileWidth"))),
                ("latitude", "first axis points east", spoiled("latitude", change=to("http://www.opengis.net/def/crs/EPSG/0/4326", *sets, "supportedCRS"))),
                ("nowhere", "supportedCRS", spoiled("nowhere", change=to("moon", *sets, "supportedCRS"))),
                ("shifted", "by its own statement", spoiled("shifted", change=to([-HALF_WORLD_M + 100, HALF_WORLD_M], *sets, "tileMatrix", 1, "topLeftCorner"))),
                ("remote", "files on this machine", spoiled("remote", change=to("https://example.org/{TileMatrix}/{TileRow}/{TileCol}.tif", *href))),
                ("bands", "no other parameters", spoiled("bands", change=to("{TileMatrix}/{TileRow}/{TileCol}/{eo:bands}.tif", *href))),
                ("untold", "{TileMatrix} in the template", spoiled("untold", change=to("{TileRow}/{TileCol}.tif", *href))),
                ("empty", "tiles where the template says", spoiled("empty", change=to("elsewhere/{TileMatrix}/{TileRow}/{TileCol}.tif", *href))),
                ("endless", "span at most", spoiled("endless", change=to({"url": "#WebMercatorQuad"}, *links))),
                ("buffers", "do not overlap", spoiled("buffers", change=to({"17": {"top": 1}}, *links, "pixel_buffer"))),
                ("setless", "tiles:tile_matrix_sets", spoiled("setless", change=lambda item: item["properties"].pop("tiles:tile_matrix_sets")))):
            with self.subTest(name):
                code, _, said, _ = self.build(item)
                self.assertEqual(2, code, said)
                self.assertIn("tiled-" + name, said)
                self.assertIn(mention, said)

    # What lies beside a tile is not among the files with digests, and counts for nothing.
    def test_what_lies_beside_a_tile_is_not_read(self):
        item = self.tiled("tiled-beside", tile_format="PNG", ending="png")
        expected = self.imagery_of(self.build(item)[3])["merkle_root"]
        tile = self.a_tile_of(item)
        pathlib.Path(f"{tile}.aux.xml").write_text("<PAMDataset><PAMRasterBand band='1'><NoDataValue>77</NoDataValue></PAMRasterBand></PAMDataset>")
        tile.with_suffix(".pgw").write_text("1\n0\n0\n-1\n0\n0\n")
        code, _, said, package = self.build(item)
        self.assertEqual(0, code, said)
        self.assertEqual(expected, self.imagery_of(package)["merkle_root"])

    def zarr_of_gdal(self, name):
        folder = self.folder / name
        gdal("gdal_translate", "-q", "-of", "Zarr", self.sets.map, folder)
        return folder

    def zarr_of_cubes(self, name, order, fill_value=None):
        """Version 2 as its specification has it, without compression: one array of bands, y and x in the given order, in chunks of 500."""
        side, chunk = ACROSS * 256, 500
        rgb = self.folder / "map.raw"
        gdal("gdal_translate", "-q", "-of", "ENVI", "-co", "INTERLEAVE=BIP", self.sets.map, rgb)
        pixels = rgb.read_bytes()
        folder = self.folder / name
        (folder / "map").mkdir(parents=True)
        shape, chunks = {"band": 3, "y": side, "x": side}, {"band": 3, "y": chunk, "x": chunk}
        common = {"zarr_format": 2, "compressor": None, "filters": None, "order": "C"}
        (folder / ".zgroup").write_text('{"zarr_format": 2}')
        (folder / "map/.zarray").write_text(json.dumps({**common, "shape": [shape[d] for d in order], "chunks": [chunks[d] for d in order], "dtype": "|u1",
                                                        "fill_value": fill_value}))
        (folder / "map/.zattrs").write_text(json.dumps({"_ARRAY_DIMENSIONS": list(order), "_CRS": {"url": "http://www.opengis.net/def/crs/EPSG/0/3857"}}))
        west, north, east, _ = corners()
        pixel = (east - west) / side
        for axis, first, step in (("x", west + pixel / 2, pixel), ("y", north - pixel / 2, -pixel)):
            (folder / axis).mkdir()
            (folder / axis / ".zarray").write_text(json.dumps({**common, "shape": [side], "chunks": [side], "dtype": "<f8", "fill_value": None}))
            (folder / axis / ".zattrs").write_text(json.dumps({"_ARRAY_DIMENSIONS": [axis]}))
            (folder / axis / "0").write_bytes(struct.pack(f"<{side}d", *(first + i * step for i in range(side))))
        for top in range(0, side, chunk):
            for left in range(0, side, chunk):
                rows = []
                for y in range(top, top + chunk):
                    row = pixels[3 * (y * side + left):3 * (y * side + min(left + chunk, side))] if y < side else b""
                    rows.append(row.ljust(3 * chunk, b"\0"))
                data = b"".join(rows)
                if order[0] == "band":
                    data = b"".join(data[band::3] for band in range(3))
                index = {"band": 0, "y": top // chunk, "x": left // chunk}
                (folder / "map" / ".".join(str(index[d]) for d in order)).write_bytes(data)
        return folder

    def test_zarr(self):
        expected = self.imagery_of(self.build(self.sets.map)[3])["merkle_root"]
        stores = [self.zarr_of_gdal("gdal.zarr"), self.zarr_of_cubes("byx.zarr", ("band", "y", "x")), self.zarr_of_cubes("yxb.zarr", ("y", "x", "band"))]
        for store in stores:
            with self.subTest(store.name):
                code, _, said, package = self.build(store)
                self.assertEqual(0, code, said)
                self.assertEqual(expected, self.imagery_of(package)["merkle_root"])

    def test_zarr_that_is_damaged(self):
        def spoiled(name, spoil, **how):
            store = self.zarr_of_cubes(name, ("band", "y", "x"), **how)
            spoil(store)
            return store

        def cut(store):
            chunk = store / "map/0.1.1"
            chunk.write_bytes(chunk.read_bytes()[:1000])
        for store, mention in ((spoiled("lost.zarr", lambda store: (store / "map/0.1.1").unlink()), "chunks of a Zarr array are missing"),
                               (spoiled("cut.zarr", cut), "cut.zarr"),
                               (spoiled("nowhere.zarr", lambda store: (store / "map/.zattrs").write_text('{"_ARRAY_DIMENSIONS": ["band", "y", "x"]}')),
                                "coordinate reference system"),
                               (spoiled("nameless.zarr", lambda store: (store / "map/.zattrs").write_text("{}")), "no array with dimensions x and y"),
                               (spoiled("garbled.zarr", lambda store: (store / "map/.zarray").write_text("{")), "garbled.zarr")):
            with self.subTest(store.name):
                code, _, said, _ = self.build(store)
                self.assertEqual(2, code, said)
                self.assertIn(mention, said)
        # With a fill value a chunk that is not there is no ground: a gap.
        code, result, said, _ = self.build(spoiled("gap.zarr", lambda store: (store / "map/0.1.1").unlink(), fill_value=0))
        self.assertEqual(1, code, said)
        self.assertIn("coverage.gap", [f["code"] for f in result["findings"]])

    # Our tile package is made by this test: another reader must see the same picture in its bundles.
    def test_the_tile_package_is_one_to_gdal(self):
        package, cache = self.tpkx("judged.tpkx", self.sets.png)
        west, north, east, south = corners()
        size = str(ACROSS * 256)
        gdal("gdal_translate", "-q", "-b", "1", "-b", "2", "-b", "3", "-projwin", west, north, east, south, "-outsize", size, size, cache, self.folder / "judged.tif")
        pixels = [subprocess.run(["gdalinfo", "-json", "-checksum", raster], capture_output=True, check=True).stdout
                  for raster in (self.folder / "judged.tif", self.sets.map)]
        checksums = [[band["checksum"] for band in json.loads(text)["bands"]][:3] for text in pixels]
        self.assertEqual(checksums[1], checksums[0])

    def test_tile_packages_that_are_damaged_or_others(self):
        package, _ = self.tpkx("sound.tpkx", self.sets.png)

        def changed(name, change_root=lambda root: None, change_file=lambda name, data: data):
            with zipfile.ZipFile(package) as sound, zipfile.ZipFile(self.folder / name, "w") as broken:
                for entry in sound.namelist():
                    data = sound.read(entry)
                    if entry == "root.json":
                        root = json.loads(data)
                        change_root(root)
                        data = json.dumps(root).encode()
                    data = change_file(entry, data)
                    if data is not None:
                        broken.writestr(entry, data)
            return self.folder / name

        def in_level_17(change):
            return lambda name, data: change(data) if name.startswith("tile/L17") else data

        def to_lambert(root):
            root["tileInfo"]["spatialReference"] = {"wkid": 2154, "latestWkid": 2154}
        for name, mention, broken in (
                ("empty.zip", "root.json", changed("empty.zip", change_file=lambda name, data: None if name == "root.json" else data)),
                ("lambert.tpkx", "3857", changed("lambert.tpkx", to_lambert)),
                ("exploded.tpkx", "esriMapCacheStorageModeCompactV2", changed("exploded.tpkx", lambda root: root["storageInfo"].update(storageFormat="esriMapCacheStorageModeExploded"))),
                ("shifted.tpkx", "origin", changed("shifted.tpkx", lambda root: root["tileInfo"]["origin"].update(x=0))),
                ("thirds.tpkx", "zoom of web maps", changed("thirds.tpkx", lambda root: root["tileInfo"]["lods"][3].update(resolution=1000))),
                ("short.tpkx", "index", changed("short.tpkx", change_file=in_level_17(lambda data: data[:1000]))),
                ("beyond.tpkx", "inside the bundle", changed("beyond.tpkx", change_file=in_level_17(lambda data: data[:140_000]))),
                ("garbled.tpkx", "garbled.tpkx", changed("garbled.tpkx", change_file=in_level_17(lambda data: data[:131_136] + bytes(len(data) - 131_136))))):
            with self.subTest(name):
                code, _, said, _ = self.build(broken)
                self.assertEqual(2, code, said)
                self.assertIn(name, said)
                self.assertIn(mention, said)

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

    def frame_in_degrees(self, name, ppm, box):
        return self.translated(name, "-a_srs", "EPSG:4326", "-a_ullr", *map(str, box), source=ppm)

    def degrees(self):
        west, north, east, south = corners()
        return math.degrees(west / 6378137), mercator_latitude(north), math.degrees(east / 6378137), mercator_latitude(south)

    def is_same_picture_whole_and_an_error_cut(self, frame, plain):
        expected = self.build(plain)
        self.assertEqual(0, expected[0], expected[2])
        code, _, said, package = self.build(frame)
        self.assertEqual(0, code, said)
        self.assertEqual(self.imagery_of(expected[3])["merkle_root"], self.imagery_of(package)["merkle_root"])
        cut = frame.with_stem("cut")
        cut.write_bytes(frame.read_bytes()[:frame.stat().st_size * 6 // 10])
        code, _, said, _ = self.build(cut)
        self.assertEqual(2, code, said)
        self.assertIn(cut.name, said)

    def test_cadrg_and_cib(self):
        for name, grey in (("00000000.jn1", False), ("00000000.i42", True)):
            with self.subTest(name):
                frame = Frame(*self.degrees(), grey=grey)
                file, ppm = self.folder / name, self.folder / "frame.ppm"
                file.write_bytes(frame.nitf())
                ppm.write_bytes(frame.ppm())
                self.is_same_picture_whole_and_an_error_cut(file, self.frame_in_degrees(f"{name}.tif", ppm, self.degrees()))

    # By GDAL, as MIL-PRF-32283 has it: NITF 2.1 with JPEG 2000, whose place in the ARC system is in GEOLOB, as pixels of the whole
    # circle and the north-western corner; IGEOLO says the same to thousandths of a degree.
    def test_ecrg(self):
        side = ACROSS * 256
        around = round(360 / ((self.degrees()[2] - self.degrees()[0]) / side)), round(360 / ((self.degrees()[1] - self.degrees()[3]) / side))
        west, north = (round(value, 9) for value in self.degrees()[:2])
        box = west, north, west + 360 / around[0] * side, north - 360 / around[1] * side
        picture = self.folder / "map.ppm"
        gdal("gdal_translate", "-q", "-of", "PNM", self.sets.map, picture)
        plain = self.frame_in_degrees("ecrg.tif", picture, box)
        options = ["-of", "NITF", "-co", "IC=C8", "-co", "ICORDS=D", "-co", "PROFILE=NPJE_NUMERICALLY_LOSSLESS", "-co", "J2KLRA=YES"]
        place = f"{around[0]:09d}{around[1]:09d}{west:+015.9f}{north:+015.9f}"
        self.is_same_picture_whole_and_an_error_cut(self.translated("0001ad01.jk1", *options, "-co", f"TRE=GEOLOB={place}", source=plain), plain)
        # The same frame without it may be metres off.
        code, result, said, _ = self.build(self.translated("coarse.jk1", *options, source=plain))
        self.assertEqual(1, code, said)
        self.assertIn("imagery.coarse_place", [finding["code"] for finding in result["findings"]])

    def test_tables_of_contents_say_what_to_do(self):
        toc = self.folder / "TOC.xml"
        toc.write_text("<Table_of_Contents><file_header file_status='new'><file_name>TOC.xml</file_name></file_header></Table_of_Contents>")
        code, _, said, _ = self.build(toc)
        self.assertEqual(2, code)
        self.assertIn("gdalbuildvrt", said)

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
        mrf = self.translated("map.mrf", "-of", "MRF")
        code, _, said, _ = self.build(mrf)
        self.assertEqual(2, code)
        self.assertIn("GeoTIFF", said)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
