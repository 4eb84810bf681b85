"""What happens to tile sets: by killed programs, full disks, wrong options, and tools that count rows the other way.

DAMAGES: (name, container, how to make it, codes that `nadir cache validate` must find, all of them)."""
import os
import shutil
import sqlite3

from tile_sets import ACROSS, NORTH_ROW, WEST_COLUMN, ZOOM

MIDDLE = (ZOOM, WEST_COLUMN + ACROSS // 2, (1 << ZOOM) - 1 - (NORTH_ROW + ACROSS // 2))
AT_MIDDLE = "WHERE zoom_level = %d AND tile_column = %d AND tile_row = %d" % MIDDLE


def sql(*statements, of="jpeg", values=()):
    """The set `of`, changed by SQL. The last statement gets the values."""
    def make(sets, path):
        shutil.copy(getattr(sets, of), path)
        with sqlite3.connect(path) as database:
            for statement in statements[:-1]:
                database.execute(statement)
            database.execute(statements[-1], [v(sets) if callable(v) else v for v in values])
        database.close()
    return make


def bytes_of(change, of="jpeg"):
    """The file's bytes, changed."""
    def make(sets, path):
        data = bytearray(getattr(sets, of).read_bytes())
        path.write_bytes(bytes(change(data)))
    return make


def zero(data, share, length=4096):
    at = int(len(data) * share) // 4096 * 4096
    data[at:at + length] = bytes(length)
    return data


def index_root(sets, path):
    """The first page of the index becomes noise: the table is whole, but nothing finds its rows."""
    with sqlite3.connect(sets.jpeg) as database:
        page, = database.execute("SELECT rootpage FROM sqlite_master WHERE type = 'index' ORDER BY rootpage LIMIT 1").fetchone()
        size, = database.execute("PRAGMA page_size").fetchone()
    database.close()
    data = bytearray(sets.jpeg.read_bytes())
    data[(page - 1) * size:page * size] = b"\x5a" * size
    path.write_bytes(data)


def without_index(*then):
    """Copied into a table of its own, as loaders do that make the index last, or never."""
    return sql("ALTER TABLE tiles RENAME TO old", "CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER,"
               " tile_row INTEGER, tile_data BLOB)", "INSERT INTO tiles SELECT zoom_level, tile_column, tile_row,"
               " tile_data FROM old", *then, "DROP TABLE old")


def wal_left(sets, path):
    """The maker was killed in WAL mode: its last tiles are in the log beside the file."""
    shutil.copy(sets.base_only, path)
    work = path.with_suffix(".work")
    shutil.copy(sets.jpeg, work)
    database = sqlite3.connect(work)
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA wal_autocheckpoint = 0")
    database.execute("INSERT INTO metadata VALUES ('description', 'unfinished')")
    database.commit()
    shutil.copy(work, path)
    shutil.copy(f"{work}-wal", f"{path}-wal")
    database.close()


def journal_left(sets, path):
    """The maker was killed within a transaction."""
    shutil.copy(sets.jpeg, path)
    database = sqlite3.connect(path, isolation_level=None)
    database.execute("PRAGMA cache_size = 1")
    database.execute("BEGIN")
    database.execute("UPDATE metadata SET value = value || ' '")
    shutil.copy(f"{path}-journal", f"{path}.kept")
    database.execute("ROLLBACK")
    database.close()
    os.replace(f"{path}.kept", f"{path}-journal")


def killed(sets, path):
    """gdal_translate killed at 73 %: rows are written from the north; bounds were written first, overviews never."""
    shutil.copy(sets.base_only, path)
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM tiles WHERE rowid > (SELECT 0.73 * count(*) FROM tiles)")
    database.close()


def one_tile(make_bytes):
    return sql(f"UPDATE tiles SET tile_data = ? {AT_MIDDLE}", values=[make_bytes])


def from_raster(how):
    return lambda sets, path: sets.mbtiles(path.name, sets.raster(path.stem + ".src.tif", **how))


def cog(*options, scheme=True, **how):
    return lambda sets, path: sets.cog_of(sets.raster(path.stem + ".src.tif", **how), path.name, *options, scheme=scheme)


GAP, METADATA, CORRUPT, ADDRESS = "coverage.gap", "metadata.mismatch", "sqlite.corrupt", "tile.misaddressed"
DAMAGES = [
    ("builder killed at 73 %", "mbtiles", killed, {GAP, METADATA}),
    ("a tile is missing", "mbtiles", sql(f"DELETE FROM tiles {AT_MIDDLE}"), {GAP}),
    ("the overviews are missing", "mbtiles", sql("DELETE FROM tiles WHERE zoom_level < 17"), {GAP}),
    ("rows counted from the north", "mbtiles",
     sql("UPDATE tiles SET tile_row = (1 << zoom_level) - 1 - tile_row"), {GAP, METADATA, ADDRESS}),
    ("columns and rows exchanged", "mbtiles",
     sql("UPDATE tiles SET tile_column = tile_row, tile_row = tile_column"), {GAP, METADATA}),
    ("every zoom one too low", "mbtiles", sql("UPDATE tiles SET zoom_level = zoom_level - 1"), {GAP, ADDRESS}),
    ("cut to half", "mbtiles", bytes_of(lambda d: d[:len(d) // 2]), {GAP, CORRUPT}),
    ("a page of zeros among the tiles", "mbtiles", bytes_of(lambda d: zero(d, 0.5)), {"tile.undecodable"}),
    ("damaged index", "mbtiles", index_root, {GAP, CORRUPT}),
    ("black tile", "mbtiles", one_tile(lambda s: s.tile(black=(0, 256))), {GAP, "tile.blank"}),
    ("black edge where the source ended", "mbtiles", from_raster({"black": (0, 1000)}), {GAP, "tile.blank", "tile.fill"}),
    ("a tile of 512 pixels", "mbtiles", one_tile(lambda s: s.tile(side=512)), {GAP, "tile.size"}),
    ("a tile cut short", "mbtiles", one_tile(lambda s: s.tile()[:3000]), {GAP, "tile.undecodable"}),
    ("an empty tile", "mbtiles", one_tile(b""), {GAP, "tile.undecodable"}),
    ("a tile that is NULL", "mbtiles", without_index(f"UPDATE tiles SET tile_data = NULL {AT_MIDDLE}"),
     {GAP, "tile.undecodable", "tiles.unindexed"}),
    ("a tile that is a text", "mbtiles", one_tile("404 Not Found"), {GAP, "tile.undecodable"}),
    ("PNG tiles said to be JPEG", "mbtiles",
     sql("UPDATE metadata SET value = 'jpg' WHERE name = 'format'", of="png"), {METADATA}),
    ("false bounds", "mbtiles", sql("UPDATE metadata SET value = '-10,-10,10,10' WHERE name = 'bounds'"), {METADATA}),
    ("false zooms", "mbtiles", sql("UPDATE metadata SET value = '19' WHERE name = 'maxzoom'"), {METADATA}),
    ("no metadata", "mbtiles", sql("DROP TABLE metadata"), {METADATA}),
    ("no index", "mbtiles", without_index(), {"tiles.unindexed"}),
    ("a tile twice", "mbtiles", without_index(f"INSERT INTO tiles SELECT * FROM tiles {AT_MIDDLE}"),
     {ADDRESS, "tiles.unindexed"}),
    ("tiles outside of the grid", "mbtiles",
     sql("INSERT INTO tiles (zoom_level, tile_column, tile_row, tile_data) VALUES (3, 8, 0, x'00'), (99, 0, 0, x'00')"),
     {ADDRESS}),
    ("write-ahead log left behind", "mbtiles", wal_left, {"sqlite.journal"}),
    ("rollback journal left behind", "mbtiles", journal_left, {"sqlite.journal"}),
    ("no tiles", "mbtiles", sql("DELETE FROM tiles"), {GAP}),
    ("a view without end", "mbtiles",
     sql("ALTER TABLE tiles RENAME TO old", "CREATE VIEW tiles AS WITH RECURSIVE n(x) AS (SELECT 0 UNION ALL SELECT x + 1"
         " FROM n) SELECT 17 AS zoom_level, x AS tile_column, 5 AS tile_row, x'00' AS tile_data FROM n"), {GAP, CORRUPT, "tiles.unindexed"}),
    ("COG cut to half", "cog", bytes_of(lambda d: d[:len(d) // 2], of="cog"), {GAP, "tile.undecodable"}),
    ("COG without overviews", "cog", cog("COMPRESS=JPEG", "OVERVIEWS=NONE"), {GAP}),
    ("COG half a tile off the grid", "cog", cog("COMPRESS=JPEG", "BLOCKSIZE=256", scheme=False, shift_px=128.5), {"tiff.grid"}),
    ("COG in another coordinate system", "cog", cog("COMPRESS=JPEG", "BLOCKSIZE=256", scheme=False, crs="EPSG:32632"),
     {"tiff.grid"}),
    ("COG with a black edge", "cog", cog(black=(0, 1000)), {GAP, "tile.blank", "tile.fill"}),
]
