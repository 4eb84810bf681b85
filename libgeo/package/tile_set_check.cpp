#include "package/tile_set_check.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "imagery/codecs.hpp"
#include "package/sidecar.hpp"
#include "package/tile_container.hpp"
#include "package/tile_image.hpp"
#include "trust/merkle.hpp"

namespace nadir {
namespace {

constexpr std::size_t kNamedTiles = 20;  // faults of one kind that are named one by one

// Adds findings of one kind up to a limit.
class LimitedFindings {
 public:
  explicit LimitedFindings(Findings& findings) : findings_(findings) {}
  void add(Finding finding) {
    if (++count_ <= kNamedTiles) findings_.add(std::move(finding));
  }
  bool full() const { return count_ >= kNamedTiles; }

 private:
  Findings& findings_;
  std::size_t count_ = 0;
};

TileSetFacts facts_from(const std::vector<Sidecar>& sidecars) {
  MerkleTree tree;
  SidecarDigest digest;
  TileSetFacts facts;
  for (const Sidecar& sidecar : sidecars) {
    tree.add(sidecar.key, sidecar.sha256);
    digest.add(sidecar);
  }
  facts.count = sidecars.size();
  facts.merkle_root = tree.root();
  facts.sidecars_sha256 = digest.finish();
  if (!sidecars.empty()) facts.zoom = {sidecars.front().key.z, sidecars.back().key.z};
  return facts;
}

void compare(const TileSetFacts& expected, const TileSetFacts& found, const std::string& name, Findings& findings) {
  const auto differ = [&](const char* code, const char* what, std::string want, std::string got) {
    findings.add({.code = code,
                  .where = name + ", " + what,
                  .expected = std::move(want),
                  .found = std::move(got),
                  .fix = "the imagery differs from what was signed: get the package again from its producer"});
  };
  if (expected.count != found.count) {
    differ("tiles.count", "tiles with sidecars", std::to_string(expected.count), std::to_string(found.count));
  }
  if (expected.merkle_root != found.merkle_root) {
    differ("tiles.root", "Merkle root of the stored digests", expected.merkle_root.hex(), found.merkle_root.hex());
  }
  if (expected.sidecars_sha256 != found.sidecars_sha256) {
    differ("tiles.root", "digest of the sidecars", expected.sidecars_sha256.hex(), found.sidecars_sha256.hex());
  }
  if (expected.zoom.min != found.zoom.min || expected.zoom.max != found.zoom.max) {
    differ("tiles.count", "zooms", fmt::format("{} to {}", expected.zoom.min, expected.zoom.max),
           fmt::format("{} to {}", found.zoom.min, found.zoom.max));
  }
}

// Walks the tiles beside the sidecars, both in the order of TileKey, and names what only one of them has.
class TileWalk {
 public:
  TileWalk(TileSetCheck& check, std::string name, VerifyDepth depth, Progress& progress)
      : check_(check),
        name_(std::move(name)),
        depth_(depth),
        progress_(progress),
        lone_(check.findings),
        wrong_(check.findings) {}

  void run(const TileContainer& container) {
    const auto rows = container.tiles(depth_ == VerifyDepth::full);
    while (rows->next()) {
      const auto key = rows->key();
      if (!key) {
        wrong_.add({.code = "tile.misaddressed",
                    .where = "tiles, " + rows->address(),
                    .expected = "an address inside the grid of its zoom",
                    .fix = "get the package again from its producer"});
      } else if (last_ && !(*last_ < *key)) {
        wrong_.add({.code = "tile.misaddressed",
                    .where = "tile " + to_text(*key),
                    .expected = "each tile once",
                    .found = "a second tile of this address",
                    .fix = "get the package again from its producer"});
      } else {
        last_ = key;
        visit(*key, *rows);
      }
    }
    while (next_ < check_.sidecars.size()) report_missing_tile(check_.sidecars[next_++].key);
  }

 private:
  void visit(const TileKey& key, TileCursor& row) {
    while (next_ < check_.sidecars.size() && check_.sidecars[next_].key < key) {
      report_missing_tile(check_.sidecars[next_++].key);
    }
    if (next_ == check_.sidecars.size() || check_.sidecars[next_].key != key) {
      lone_.add({.code = "tiles.count",
                 .where = "tile " + to_text(key),
                 .expected = "a sidecar for each tile",
                 .found = "an unsigned tile",
                 .fix = "get the package again from its producer"});
      return;
    }
    const Sidecar& sidecar = check_.sidecars[next_++];
    // Once as many are wrong as are named, another says nothing new: a forged set may have any number of large ones.
    if (depth_ == VerifyDepth::full && !wrong_.full()) check_bytes(row, sidecar);
    progress_.advance();
  }

  void check_bytes(TileCursor& row, const Sidecar& sidecar) {
    try {
      check_bytes(row.bytes(), sidecar);
    } catch (const TiffError& error) {  // this block alone; a database that is damaged ends the walk
      wrong_.add(tile_set_finding(error, fmt::format("{}, tile {}", name_, to_text(sidecar.key))));
    }
  }

  void check_bytes(ByteView bytes, const Sidecar& sidecar) {
    if (const Sha256 digest = sha256(bytes); digest != sidecar.sha256) {
      wrong_.add({.code = "artifact.hash",
                  .where = fmt::format("{}, tile {}", name_, to_text(sidecar.key)),
                  .expected = sidecar.sha256.hex(),
                  .found = digest.hex(),
                  .fix = "get the package again from its producer"});
    }
    if (auto problem = tile_header_problem(bytes, sidecar.key)) wrong_.add(std::move(*problem));
  }

  void report_missing_tile(const TileKey& key) {
    lone_.add({.code = "tiles.count",
               .where = "tile " + to_text(key),
               .expected = "a tile for each sidecar",
               .found = "no tile",
               .fix = "get the package again from its producer"});
  }

  TileSetCheck& check_;
  std::string name_;
  VerifyDepth depth_;
  Progress& progress_;
  LimitedFindings lone_, wrong_;
  std::size_t next_ = 0;
  std::optional<TileKey> last_;
};

}  // namespace

TileSetCheck check_tile_set(TileSetFiles files, const TileSetFacts& facts, VerifyDepth depth, Progress& progress) {
  TileSetCheck check;
  const std::string file_name = files.tiles.path().filename().string();
  const std::string name = "imagery/" + file_name;
  const TileSetRules rules = TileSetRules::of_package(facts.count);
  try {
    static_cast<void>(open_tile_source(files.tiles.duplicate(), rules));  // stricter: as the aircraft reads it
    const auto container = open_tile_container(std::move(files), rules);
    if (container->sidecars() == nullptr) {
      check.findings.add({.code = "tiles.count",
                          .where = name,
                          .expected = "a sidecar for each tile",
                          .found = "no sidecar table",
                          .fix = "get the package again from its producer"});
      return check;
    }
    SidecarRows rows = read_sidecars(*container->sidecars());
    check.sidecars = std::move(rows.sidecars);
    check.findings.add(rows.findings);
    compare(facts, facts_from(check.sidecars), name, check.findings);
    progress.begin(depth == VerifyDepth::full ? "checking tiles" : "listing tiles", check.sidecars.size(), "tiles");
    TileWalk(check, name, depth, progress).run(*container);
    progress.end();
  } catch (const Error& error) {
    Finding fault = tile_set_finding(error, file_name);
    fault.fix = "get the package again from its producer";
    check.findings.add(std::move(fault));
  }
  return check;
}

TileSetFacts tile_set_facts(const std::filesystem::path& tiles) {
  const auto reader = open_tile_source(tiles);
  const auto container = open_tile_container(tiles);
  const SidecarRows rows = container->sidecars() == nullptr ? SidecarRows{} : read_sidecars(*container->sidecars());
  if (!rows.findings.empty() || rows.sidecars.empty()) {
    throw Error({.what = "cannot sign this tile set: its sidecars are invalid",
                 .where = tiles,
                 .fix = "`nadir cache validate` reports everything that is wrong with the file"});
  }
  TileSetFacts facts = facts_from(rows.sidecars);
  const auto tile = reader->read(rows.sidecars.front().key);
  const auto format = tile ? sniff_image_format(*tile) : std::nullopt;
  if (!format) {
    throw Error({.what = "cannot sign this tile set: a tile is missing or no image",
                 .where = fmt::format("{}, tile {}", tiles.string(), to_text(rows.sidecars.front().key)),
                 .fix = "`nadir cache validate` reports everything that is wrong with the file"});
  }
  facts.format = name_of(*format);
  return facts;
}

}  // namespace nadir
