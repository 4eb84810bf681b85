// The SQL of the sidecar table. Rows are TMS (row 0 in the south) like those of the table `tiles` beside it.
// Parameters and columns keep one order: z, column, row, sha256, source, captured_at, gsd, ce90, trust, sector,
// valid share, mask.
#pragma once

namespace nadir::sql {

inline constexpr const char* kCreateSidecars = R"sql(
CREATE TABLE nadir_sidecars (
  zoom_level  INTEGER NOT NULL,
  tile_column INTEGER NOT NULL,
  tile_row    INTEGER NOT NULL,
  sha256      BLOB    NOT NULL,
  source      TEXT    NOT NULL,
  captured_at TEXT    NOT NULL,
  gsd_mm      INTEGER NOT NULL,
  ce90_mm     INTEGER NOT NULL,
  trust       TEXT    NOT NULL,
  sector      TEXT    NOT NULL,
  valid_ppm   INTEGER NOT NULL,
  mask        BLOB,
  PRIMARY KEY (zoom_level, tile_column, tile_row DESC)
) WITHOUT ROWID
)sql";

// A file without journal: it is written into a staging folder. As the MBTiles writer does it.
inline constexpr const char* kBeginSidecarFile = R"sql(
PRAGMA page_size = 4096;
PRAGMA journal_mode = OFF;
PRAGMA synchronous = OFF;
PRAGMA locking_mode = EXCLUSIVE;
PRAGMA encoding = 'UTF-8';
BEGIN;
CREATE TABLE metadata (name TEXT, value TEXT);
)sql";

inline constexpr const char* kInsertSidecar = R"sql(
INSERT INTO nadir_sidecars (zoom_level, tile_column, tile_row, sha256, source, captured_at, gsd_mm, ce90_mm, trust,
                            sector, valid_ppm, mask)
VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)
)sql";

// In the order of TileKey: zoom, column, then XYZ row, which grows as the TMS row falls.
inline constexpr const char* kSelectSidecars = R"sql(
SELECT zoom_level, tile_column, tile_row, sha256, source, captured_at, gsd_mm, ce90_mm, trust, sector, valid_ppm, mask
FROM nadir_sidecars ORDER BY zoom_level, tile_column, tile_row DESC
)sql";

inline constexpr const char* kSelectTileKeys = R"sql(
SELECT zoom_level, tile_column, tile_row FROM tiles ORDER BY zoom_level, tile_column, tile_row DESC
)sql";

inline constexpr const char* kSelectTiles = R"sql(
SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles
ORDER BY zoom_level, tile_column, tile_row DESC
)sql";

// The same in two steps: the order is not that of the usual index, and SQLite would write all tiles to a temporary file
// to sort them.
inline constexpr const char* kSelectTileRows = R"sql(
SELECT zoom_level, tile_column, tile_row, rowid FROM tiles ORDER BY zoom_level, tile_column, tile_row DESC
)sql";
inline constexpr const char* kSelectTileOfRow = "SELECT tile_data FROM tiles WHERE rowid = ?";
inline constexpr const char* kTilesHaveRows =
    "SELECT 1 FROM sqlite_schema WHERE name = 'tiles' AND type = 'table' AND sql NOT LIKE '%WITHOUT%ROWID%'";

}  // namespace nadir::sql
