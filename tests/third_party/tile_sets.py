"""Tile sets as other people's tools make them, over one mission: GDAL's MBTiles and COG drivers, by the programs of
gdal-bin alone. damages.py spoils them."""
import pathlib
import random
import subprocess

ZOOM, WEST_COLUMN, NORTH_ROW, ACROSS = 17, 68626, 45884, 6  # the square of tiles that the picture fills
TILE = 256
HALF_WORLD_M = 20037508.342789244
PIXEL_M = 2 * HALF_WORLD_M / (TILE << ZOOM)

# Inside the inner 4 x 4 tiles, so that the rim of the picture is nobody's business.
MISSION = """schema: nadir.mission/1
id: others
series: others
sequence: 1
created: 2024-10-30T00:00:00Z
expires: 2024-11-30T00:00:00Z
takeoff: {lon_deg: 8.4980, lat_deg: 47.3985}
terrain: {mode: flat}
zoom: {min: 16, max: 17}
min_resolution_m: 1.0
budget_mb: 50
freshness_days: {stable: 730, active: 400}
airframes: [any]
sectors:
  - {id: field, class: stable, polygon: [[8.4955, 47.3970], [8.5005, 47.3970], [8.5005, 47.4000], [8.4955, 47.4000], [8.4955, 47.3970]]}
route: {corridor_half_width_m: 40, agl_m: 100, points: [[8.4960, 47.3985], [8.5000, 47.3985]]}
"""


def gdal(*args):
    subprocess.run([str(a) for a in args], check=True, stdin=subprocess.DEVNULL, capture_output=True)


def corners(shift_px=0):
    west = -HALF_WORLD_M + (WEST_COLUMN * TILE + shift_px) * PIXEL_M
    north = HALF_WORLD_M - (NORTH_ROW * TILE + shift_px) * PIXEL_M
    side = ACROSS * TILE * PIXEL_M
    return [west, north, west + side, north - side]


def picture(path, side=ACROSS * TILE, black=(0, 0), seed=1):
    """Coloured fields of 8 pixels as PPM; pixels of the columns from black[0] to black[1] are black."""
    generator = random.Random(seed)
    rows = bytearray()
    for _ in range(side // 8):
        row = bytearray(b"".join(bytes(generator.randrange(40, 216) for _ in range(3)) * 8 for _ in range(side // 8)))
        row[3 * black[0]:3 * black[1]] = bytes(3 * (black[1] - black[0]))
        rows += row * 8
    path.write_bytes(b"P6 %d %d 255\n" % (side, side) + rows)
    return path


class TileSets:
    """Made once, in a folder of the caller's."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.mission = self.folder / "mission.yaml"
        self.mission.write_text(MISSION)
        self.map = self.raster("map.tif")
        # As a killed gdal_translate leaves it there are no overviews; gdaladdo comes after.
        self.base_only = self.mbtiles("base-only.mbtiles", self.map, overviews=False)
        self.jpeg = self.mbtiles("gdal-jpeg.mbtiles", self.map)
        self.png = self.mbtiles("gdal-png.mbtiles", self.map, "PNG")
        self.cog = self.cog_of(self.map, "gdal-cog.tif")

    def intact(self):
        return {"GDAL MBTiles, JPEG": self.jpeg, "GDAL MBTiles, PNG": self.png, "GDAL COG, JPEG": self.cog,
                "GDAL COG, deflate": self.cog_of(self.map, "gdal-deflate.tif", "COMPRESS=DEFLATE")}

    def raster(self, name, shift_px=0, crs="EPSG:3857", **how):
        ppm = picture(self.folder / (name + ".ppm"), **how)
        gdal("gdal_translate", "-q", "-a_srs", crs, "-a_ullr", *corners(shift_px), ppm, self.folder / name)
        ppm.unlink()
        return self.folder / name

    def mbtiles(self, name, raster, tile_format="JPEG", overviews=True):
        path = self.folder / name
        gdal("gdal_translate", "-q", "-of", "MBTILES", "-co", f"TILE_FORMAT={tile_format}", raster, path)
        if overviews:
            gdal("gdaladdo", "-q", "-r", "average", path, "2")
        return path

    def cog_of(self, raster, name, *options, scheme=True):
        path = self.folder / name
        options = [*options] or ["COMPRESS=JPEG"]
        if scheme:
            options += ["TILING_SCHEME=GoogleMapsCompatible", "BLOCKSIZE=256", "ADD_ALPHA=NO"]
        gdal("gdal_translate", "-q", "-of", "COG", *[w for o in options for w in ("-co", o)], raster, path)
        return path

    def tile(self, tile_format="JPEG", side=TILE, black=(0, 0)):
        """One tile's bytes."""
        ppm = picture(self.folder / "tile.ppm", side=side, black=black)
        out = self.folder / "tile.bin"
        gdal("gdal_translate", "-q", "-of", tile_format, "--config", "GDAL_PAM_ENABLED", "NO", ppm, out)
        return out.read_bytes()
