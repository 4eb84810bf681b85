#include "package/validate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/judge.hpp"
#include "package/mbtiles_file_check.hpp"
#include "package/sidecar_table.hpp"
#include "package/tile_container.hpp"
#include "package/tile_mask.hpp"
#include "package/tile_picture.hpp"

namespace nadir {
namespace {

constexpr std::size_t kNamedPerCode = 20;

class Validator {
 public:
  Validator(const std::filesystem::path& path, const Mission& mission, UtcTime at, Progress& progress)
      : path_(path), mission_(mission), at_(at), progress_(progress) {}

  Validation run() {
    try {
      container_ = open_tile_container(path_);
    } catch (const TiffError& error) {
      add(fault_of(error, path_.filename().string()));
      result_.bytes = std::filesystem::file_size(path_);
      return std::move(result_);
    }
    result_.bytes = std::filesystem::file_size(path_);
    result_.findings.add(container_->remarks());
    // A damaged page ends the walk, not the judgement: what is missing behind it counts as missing.
    const SqliteDatabase* database = container_->database();
    if (database != nullptr) {
      result_.findings.add(check_journals(path_));
      guard([&] { result_.findings.add(check_database(*database)); });
    }
    guard([&] { read_known(); });
    guard([&] { walk(); });
    if (database != nullptr) guard([&] { result_.findings.add(check_metadata(*database, seen_)); });
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
      add(fault_of(error, path_.filename().string()));
    }
  }

  void add(Finding finding) {
    if (++counts_[finding.code] <= kNamedPerCode) result_.findings.add(std::move(finding));
  }

  void read_known() {
    const SqliteDatabase* sidecars = container_->sidecars();
    result_.has_sidecars = sidecars != nullptr;
    if (!result_.has_sidecars) return;
    SidecarRows rows = read_sidecars(*sidecars);
    result_.findings.add(rows.findings);
    for (Sidecar& sidecar : rows.sidecars) known_.emplace(sidecar.key, std::move(sidecar));
  }

  void walk() {
    progress_.begin("decoding tiles", container_->count(), "tiles");
    const auto rows = container_->tiles(true);
    while (rows->next()) {
      ++result_.tiles;
      progress_.advance();
      const auto key = rows->key();
      if (!key) {
        add({.code = "tile.misaddressed",
             .where = rows->address(),
             .expected = "an address inside the grid of its zoom"});
      } else if (!tiles_.empty() && !(tiles_.back().key < *key)) {
        add({.code = "tile.misaddressed",
             .where = "tile " + to_text(*key),
             .expected = "each tile once",
             .found = "a second tile of this address"});
      } else {
        inspect(*key, *rows);
      }
    }
    progress_.end();
  }

  void inspect(const TileKey& key, TileCursor& row) {
    ByteView bytes;
    TilePicture picture;
    try {
      bytes = row.bytes();
      const auto mask = row.mask();
      if (mask && !shows_something(*mask)) return void(--result_.tiles);  // a block of fill that says so: no tile
      picture = inspect_tile(bytes, key);
      if (mask) apply(*mask, picture);
    } catch (const Error& error) {  // of a COG: this block alone
      if (container_->kind() != "cog") throw;
      bytes = {};
      picture.problem = fault_of(error, "tile " + to_text(key));
      picture.problem->code = "tile.undecodable";
    }
    // Tools pad their grids: a black tile beside the mission's area harms nobody.
    if (picture.problem && picture.problem->code == "tile.blank" && !needed(key)) {
      picture.problem->severity = Severity::warning;
    }
    const auto known = known_.find(key);
    const bool filled = picture.problem && picture.problem->code == "tile.fill";
    const bool usable = !picture.problem || filled || picture.problem->code == "tile.blank";
    // What a sidecar's mask leaves out may look as it likes.
    if (picture.problem && !(filled && known != known_.end())) add(std::move(*picture.problem));
    seen_.add(key, sniff_image_format(bytes));
    Sidecar tile;
    if (known != known_.end()) {
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

  bool needed(const TileKey& key) {
    if (needed_.empty()) {
      for (int zoom = mission_.zoom.min; zoom <= mission_.zoom.max; ++zoom) {
        const std::vector<TileKey> keys = required_tiles(mission_, zoom);
        needed_.insert(needed_.end(), keys.begin(), keys.end());
      }
    }
    return std::binary_search(needed_.begin(), needed_.end(), key);
  }

  static bool shows_something(ByteView mask) {
    const auto pixels = decode_tile_mask(mask);
    return pixels && std::any_of(pixels->begin(), pixels->end(), [](std::uint8_t pixel) { return pixel == 255; });
  }

  // Of a picture whose container knows which of its pixels show ground.
  static void apply(ByteView mask, TilePicture& picture) {
    const auto pixels = decode_tile_mask(mask);
    if (!pixels) return;
    if (picture.mask.empty()) picture.mask.assign(pixels->size(), 255);
    std::int64_t valid = 0;
    for (std::size_t i = 0; i < pixels->size(); ++i) {
      picture.mask[i] = std::min(picture.mask[i], (*pixels)[i]);
      valid += picture.mask[i] == 255 ? 1 : 0;
    }
    picture.valid_ppm = valid * kWholeTile_ppm / static_cast<std::int64_t>(pixels->size());
  }

  // The classic mistake: rows counted from the north in a format that counts from the south.
  void check_flipped() {
    if (container_->kind() == "cog") return;  // its places are those of the map
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
  std::unique_ptr<TileContainer> container_;
  Validation result_;
  SeenTiles seen_;
  std::vector<TileKey> needed_;  // of all of the mission's zooms, in the order of TileKey; filled when first asked for
  std::map<TileKey, Sidecar> known_;
  std::vector<Sidecar> tiles_;
  std::map<std::string, std::size_t> counts_;
};

}  // namespace

Validation validate_tile_set(const std::filesystem::path& tiles, const Mission& mission, UtcTime at,
                             Progress& progress) {
  return Validator(tiles, mission, at, progress).run();
}

}  // namespace nadir
