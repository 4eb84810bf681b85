// The table nadir_sidecars in an MBTiles file, or in the file beside a COG: written by whoever builds a tile set, read
// whole by whoever checks one.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "imagery/sqlite_database.hpp"
#include "package/sidecar.hpp"

namespace nadir {

// Must be gone before the database is closed: it holds a statement.
class SidecarWriter {
 public:
  explicit SidecarWriter(const SqliteDatabase& database);  // makes the table
  void add(const Sidecar& sidecar);

 private:
  SqliteStatement insert_;
};

// A database of its own with metadata and sidecars (in the order of TileKey): what lies beside a COG. The same rows
// give the same bytes. Throws Error when the file exists.
void write_sidecar_file(const std::filesystem::path& path, const std::vector<Sidecar>& sidecars,
                        const std::map<std::string, std::string>& metadata);

bool has_sidecars(const SqliteDatabase& database);

// All rows in the order of TileKey. Rows that are no sidecars are left out and become findings: "tile.misaddressed" for
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
