#include "package/tile_set_diff.hpp"

#include <algorithm>

#include "base/error.hpp"
#include "package/sidecar.hpp"
#include "package/tile_container.hpp"

namespace nadir {
namespace {

// One of the two files, its tiles one after the other.
class Side {
 public:
  explicit Side(const std::filesystem::path& path)
      : path_(path), container_(open_tile_container(path)), rows_(container_->tiles(true)) {
    for (Sidecar& sidecar : known_sidecars()) sidecars_.emplace(sidecar.key, std::move(sidecar));
    next();
  }
  Side(const Side&) = delete;
  Side& operator=(const Side&) = delete;

  const std::optional<TileKey>& key() const { return key_; }  // nullopt at the end
  ByteView bytes() const { return rows_->bytes(); }

  void next() {
    const std::optional<TileKey> last = key_;
    key_.reset();
    if (!rows_->next()) return;
    key_ = rows_->key();
    if (!key_) reject(rows_->address(), "an address inside the grid of its zoom");
    if (last && !(*last < *key_)) reject("tile " + to_text(*key_), "each tile once");
  }

  // What is known about the tile, in a form that can be compared; empty without a sidecar.
  Bytes description(const TileKey& key) const {
    const auto found = sidecars_.find(key);
    if (found == sidecars_.end()) return {};
    SidecarDigest digest;
    digest.add(found->second);
    const Sha256 hash = digest.finish();
    return {hash.bytes.begin(), hash.bytes.end()};
  }

  Entries metadata() const { return container_->metadata(); }
  std::uint64_t count() const { return container_->count(); }

 private:
  std::vector<Sidecar> known_sidecars() const {
    if (container_->sidecars() == nullptr) return {};
    SidecarRows rows = read_sidecars(*container_->sidecars());
    if (!rows.findings.empty()) {
      const Finding& first = rows.findings.items().front();
      throw Error({.what = "cannot compare the sidecars",
                   .where = path_.string() + ": " + first.where,
                   .expected = first.expected,
                   .found = first.found,
                   .fix = "`nadir cache validate` reports everything that is wrong with the file"});
    }
    return std::move(rows.sidecars);
  }

  [[noreturn]] void reject(const std::string& where, std::string expected) const {
    throw Error({.what = "cannot compare the tiles",
                 .where = path_.string() + ": " + where,
                 .expected = std::move(expected),
                 .fix = "`nadir cache validate` reports everything that is wrong with the file"});
  }

  std::filesystem::path path_;
  std::unique_ptr<TileContainer> container_;
  std::unique_ptr<TileCursor> rows_;
  std::map<TileKey, Sidecar> sidecars_;
  std::optional<TileKey> key_;
};

}  // namespace

std::vector<EntryChange> diff_entries(const Entries& before, const Entries& after) {
  std::vector<EntryChange> changes;
  for (const auto& [name, value] : before) {
    const auto now = after.find(name);
    if (now == after.end()) {
      changes.push_back({name, value, std::nullopt});
    } else if (now->second != value) {
      changes.push_back({name, value, now->second});
    }
  }
  for (const auto& [name, value] : after) {
    if (!before.contains(name)) changes.push_back({name, std::nullopt, value});
  }
  std::sort(changes.begin(), changes.end(), [](const EntryChange& a, const EntryChange& b) { return a.name < b.name; });
  return changes;
}

TileSetDiff diff_tile_sets(const std::filesystem::path& before, const std::filesystem::path& after,
                           Progress& progress) {
  Side a(before), b(after);
  TileSetDiff diff;
  diff.metadata = diff_entries(a.metadata(), b.metadata());
  progress.begin("comparing tiles", a.count() + b.count(), "tiles");
  while (a.key() || b.key()) {
    const bool in_a = a.key() && (!b.key() || *a.key() <= *b.key());
    const bool in_b = b.key() && (!a.key() || *b.key() <= *a.key());
    if (in_a && in_b) {
      const TileKey& key = *a.key();
      if (!std::ranges::equal(a.bytes(), b.bytes())) {
        diff.changed.push_back({key, sha256(a.bytes()), sha256(b.bytes())});
      } else {
        ++diff.same;
        if (a.description(key) != b.description(key)) diff.redescribed.push_back(key);
      }
    } else if (in_a) {
      diff.removed.push_back({*a.key(), sha256(a.bytes()), std::nullopt});
    } else {
      diff.added.push_back({*b.key(), std::nullopt, sha256(b.bytes())});
    }
    if (in_a) a.next();
    if (in_b) b.next();
    progress.advance((in_a ? 1U : 0U) + (in_b ? 1U : 0U));
  }
  progress.end();
  return diff;
}

}  // namespace nadir
