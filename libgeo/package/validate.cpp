#include "package/validate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/sqlite_database.hpp"
#include "package/judge.hpp"
#include "package/sidecar_sql.hpp"
#include "package/sidecar_table.hpp"
#include "package/tile_mask.hpp"
#include "package/tile_picture.hpp"

namespace nadir {
namespace {

constexpr std::size_t kNamedPerCode = 20;

class Validator {
 public:
  Validator(const std::filesystem::path& path, const Mission& mission, UtcTime at, Progress& progress)
      : path_(path), mission_(mission), at_(at), progress_(progress), database_(SqliteDatabase::open_immutable(path)) {}

  Validation run() {
    result_.bytes = std::filesystem::file_size(path_);
    bool has_tiles = true;
    guard([&] { has_tiles = database_.has_table("tiles"); });
    if (!has_tiles) {
      throw Error({.what = "no MBTiles file: the table \"tiles\" is missing",
                   .where = path_,
                   .expected = "an MBTiles file (a database with metadata and tiles)",
                   .fix = "name a raster tile set in MBTiles 1.3"});
    }
    // A damaged page ends the walk, not the judgement: what is missing behind it counts as missing.
    guard([&] { read_known(); });
    guard([&] { walk(); });
    result_.findings.add(judge_coverage(mission_, tiles_));
    check_flipped();
    result_.findings.add(judge_budget(mission_, result_.bytes));
    if (result_.has_sidecars) {
      result_.findings.add(judge_freshness(mission_, tiles_, at_));
      result_.findings.add(judge_resolution(mission_, tiles_));
    }
    result_.sidecars = std::move(tiles_);
    return std::move(result_);
  }

 private:
  template <typename Work>
  void guard(Work work) {
    try {
      work();
    } catch (const Error& error) {
      add({.code = "sqlite.corrupt",
           .where = path_.filename().string(),
           .expected = "a sound SQLite database",
           .found = error.text().found.empty() ? error.text().what : error.text().found,
           .fix = "make the file again; a copy of a damaged file stays damaged"});
    }
  }

  void add(Finding finding) {
    if (++counts_[finding.code] <= kNamedPerCode) result_.findings.add(std::move(finding));
  }

  void read_known() {
    result_.has_sidecars = has_sidecars(database_);
    if (!result_.has_sidecars) return;
    SidecarRows rows = read_sidecars(database_);
    result_.findings.add(rows.findings);
    for (Sidecar& sidecar : rows.sidecars) known_.emplace(sidecar.key, std::move(sidecar));
  }

  void walk() {
    auto count = database_.prepare("SELECT count(*) FROM tiles");
    progress_.begin("decoding tiles", count.step() ? static_cast<std::uint64_t>(count.integer(0)) : 0, "tiles");
    auto rows = database_.prepare(sql::kSelectTiles);
    while (rows.step()) {
      ++result_.tiles;
      progress_.advance();
      const auto key = row_key(rows);
      if (!key) {
        add({.code = "tile.misaddressed",
             .where = row_address_text(rows),
             .expected = "an address inside the grid of its zoom"});
      } else if (!tiles_.empty() && !(tiles_.back().key < *key)) {
        add({.code = "tile.misaddressed",
             .where = "tile " + to_text(*key),
             .expected = "each tile once",
             .found = "a second tile of this address"});
      } else {
        inspect(*key, rows.blob(3));
      }
    }
    progress_.end();
  }

  void inspect(const TileKey& key, ByteView bytes) {
    TilePicture picture = inspect_tile(bytes, key);
    const bool usable = !picture.problem || picture.problem->code == "tile.blank";
    if (picture.problem) add(std::move(*picture.problem));
    Sidecar tile;
    if (const auto known = known_.find(key); known != known_.end()) {
      tile = known->second;
      if (sha256(bytes) != tile.sha256) {
        add({.code = "artifact.hash",
             .where = "tile " + to_text(key),
             .expected = "the digest in its sidecar",
             .found = "other bytes"});
      }
    } else {
      tile.key = key;
      tile.captured_at = at_;
      tile.valid_ppm = picture.valid_ppm;
      if (!picture.mask.empty()) tile.mask = encode_tile_mask(picture.mask);
    }
    // A tile that cannot be shown stays in the list with nothing valid, so that its place shows as a gap.
    if (!usable) tile.valid_ppm = 0, tile.mask.clear();
    tiles_.push_back(std::move(tile));
  }

  // The classic mistake: rows counted from the north in a format that counts from the south.
  void check_flipped() {
    std::size_t present = 0, mirrored = 0;
    const auto has = [&](const TileKey& key) {
      const auto found = std::lower_bound(tiles_.begin(), tiles_.end(), key,
                                          [](const Sidecar& tile, const TileKey& wanted) { return tile.key < wanted; });
      return found != tiles_.end() && found->key == key;
    };
    for (const TileKey& key : required_tiles(mission_, mission_.zoom.max)) {
      present += has(key) ? 1U : 0U;
      mirrored += has({key.z, key.x, key.tms_row()}) ? 1U : 0U;
    }
    if (present != 0 || mirrored == 0) return;
    add({.code = "tile.misaddressed",
         .where = fmt::format("zoom {}, {} tiles", mission_.zoom.max, mirrored),
         .expected = "rows counted from the south (TMS), as MBTiles has them",
         .found = "rows counted from the north (XYZ): the tiles lie mirrored at the equator",
         .fix = "write tile_row = 2^zoom - 1 - y"});
  }

  const std::filesystem::path& path_;
  const Mission& mission_;
  UtcTime at_;
  Progress& progress_;
  SqliteDatabase database_;
  Validation result_;
  std::map<TileKey, Sidecar> known_;
  std::vector<Sidecar> tiles_;
  std::map<std::string, std::size_t> counts_;
};

}  // namespace

Validation validate_mbtiles(const std::filesystem::path& mbtiles, const Mission& mission, UtcTime at,
                            Progress& progress) {
  return Validator(mbtiles, mission, at, progress).run();
}

}  // namespace nadir
