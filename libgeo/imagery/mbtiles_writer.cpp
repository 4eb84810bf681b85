#include "imagery/mbtiles_writer.hpp"

#include <fmt/format.h>

#include "base/md5.hpp"

namespace nadir {

MbtilesWriter::MbtilesWriter(const std::filesystem::path& path) : database_(SqliteDatabase::create(path)) {
  database_.execute(
      "PRAGMA page_size = 4096; PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; PRAGMA locking_mode = EXCLUSIVE;"
      "PRAGMA cache_size = -16384; PRAGMA encoding = 'UTF-8';"
      "PRAGMA application_id = 0x4d504258;"  // "MPBX", as the specification asks
      "BEGIN;"
      "CREATE TABLE metadata (name TEXT, value TEXT);"
      "CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB);");
  insert_ = database_.prepare("INSERT INTO tiles VALUES (?, ?, ?, ?)");
}

void MbtilesWriter::add(const TileKey& key, ByteView encoded) {
  insert_->bind(1, std::int64_t{key.z}).bind(2, std::int64_t{key.x}).bind(3, std::int64_t{key.tms_row()});
  insert_->bind(4, encoded).run();
}

void MbtilesWriter::set_metadata(const std::map<std::string, std::string>& metadata) {
  auto insert = database_.prepare("INSERT INTO metadata VALUES (?, ?)");
  for (const auto& [name, value] : metadata) insert.bind(1, name).bind(2, value).run();
}

std::string MbtilesWriter::aggregate_hash() const {
  Md5Stream hash;
  SqliteStatement tiles = database_.prepare(
      "SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles INDEXED BY tile_index "
      "ORDER BY zoom_level, tile_column, tile_row");
  while (tiles.step()) {
    hash.update(as_bytes(fmt::format("{}{}{}", tiles.integer(0), tiles.integer(1), tiles.integer(2))));
    hash.update(tiles.blob(3));
  }
  return hash.finish();
}

void MbtilesWriter::finish() {
  insert_.reset();
  database_.execute("CREATE UNIQUE INDEX tile_index ON tiles (zoom_level, tile_column, tile_row);");
  set_metadata({{"agg_tiles_hash", aggregate_hash()}});
  database_.execute("COMMIT; PRAGMA journal_mode = DELETE;");
  database_.close();
}

}  // namespace nadir
