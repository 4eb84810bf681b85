// What is known about one tile besides its image: digest, origin, date, resolution, accuracy, valid pixels.
//
// Sidecars are rows of the table nadir_sidecars, either inside the MBTiles file, which stays readable for every other
// program, or in the file beside a COG. Rows are TMS (row 0 in the south) like those of the table `tiles`. A signed
// manifest covers all of them with one digest (SidecarDigest).
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/time.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/sqlite_database.hpp"

namespace nadir {

// service: from the imagery's provider; candidate: made in flight; soft: candidate with weak evidence.
enum class TileTrust { service, candidate, soft };
std::string_view name_of(TileTrust trust);
std::optional<TileTrust> parse_tile_trust(std::string_view name);

inline constexpr std::int64_t kWholeTile_ppm = 1'000'000;

struct Sidecar {
  TileKey key;
  Sha256 sha256;       // of the tile's encoded bytes
  std::string source;  // provider
  UtcTime captured_at;
  std::int64_t gsd_mm = 0;   // the source's ground sample distance
  std::int64_t ce90_mm = 0;  // circular error of its placement, 90 %
  TileTrust trust = TileTrust::service;
  std::string sector;                       // id of the sector that governs the freshness; empty outside of all
  std::int64_t valid_ppm = kWholeTile_ppm;  // share of the pixels that show ground
  Bytes mask;                               // PNG, one channel, 255 where the pixel is valid; empty when all are
};

// One digest over all sidecars of a tile set, in the order of TileKey: signed with the manifest, so that dates,
// accuracies and masks cannot be exchanged without touching a tile. Each row goes in as
//   z:u8 x:u32be y:u32be sha256[32] captured_at:i64be gsd_mm:i64be ce90_mm:i64be valid_ppm:i64be
//   then source, trust, sector and mask, each as length:u32be and bytes.
class SidecarDigest {
 public:
  void add(const Sidecar& sidecar);  // throws Error when not in the order of TileKey
  Sha256 finish();

 private:
  Sha256Stream stream_;
  std::optional<TileKey> last_;
  Bytes row_;
};

// Columns and parameters keep one order.
namespace sql {
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

inline constexpr const char* kInsertSidecar = R"sql(
INSERT INTO nadir_sidecars (zoom_level, tile_column, tile_row, sha256, source, captured_at, gsd_mm, ce90_mm, trust,
                            sector, valid_ppm, mask)
VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)
)sql";
}  // namespace sql

// Must be destroyed before the database is closed: it holds a statement.
class SidecarWriter {
 public:
  explicit SidecarWriter(const SqliteDatabase& database);  // makes the table
  void add(const Sidecar& sidecar);

 private:
  SqliteStatement insert_;
};

// The file beside a COG: a database with metadata and sidecars (in the order of TileKey). Equal rows give equal bytes.
// Throws Error when the file exists.
void write_sidecar_file(const std::filesystem::path& path, const std::vector<Sidecar>& sidecars,
                        const std::map<std::string, std::string>& metadata);

bool has_sidecars(const SqliteDatabase& database);

// All rows in the order of TileKey. Invalid rows are left out and become findings: "tile.misaddressed" for
// an impossible address, "sqlite.corrupt" for values of the wrong form. Throws Error when the database cannot be read.
struct SidecarRows {
  std::vector<Sidecar> sidecars;
  Findings findings;
};
SidecarRows read_sidecars(const SqliteDatabase& database);

// The address in the first three columns of a row, or nullopt when there is no such tile.
std::optional<TileKey> row_key(const SqliteStatement& row);
std::string row_address_text(const SqliteStatement& row);  // for messages about impossible ones

}  // namespace nadir
