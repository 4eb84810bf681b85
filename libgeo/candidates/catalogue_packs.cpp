// The catalogue's packs and blobs: which bytes are there, and where.
#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "base/error.hpp"
#include "candidates/candidate_catalogue.hpp"
#include "candidates/catalogue_transaction.hpp"

namespace nadir {

using Insert = CatalogueDatabase::Insert;

namespace {

// For IN (…).
std::string quoted(std::span<const Sha256> digests) {
  std::string list;
  for (const Sha256& digest : digests) list += fmt::format("{}'{}'", list.empty() ? "" : ",", digest.hex());
  return list;
}

}  // namespace

void CandidateCatalogue::add_pack(std::int64_t upload, const Sha256& pack, std::uint64_t bytes,
                                  std::span<const PackedTile> tiles, const std::function<void()>& keep) {
  CatalogueTransaction transaction(database_);
  if (!this->upload(upload)) throw Error({.what = "the upload of this pack is forgotten", .where = pack.hex()});
  std::vector<Sha256> names;
  for (const PackedTile& tile : tiles) names.push_back(tile.sha256);
  std::map<std::string, std::string> there;  // the packs of tiles that another upload has brought
  database_.select(
      fmt::format("SELECT sha256, pack FROM {} WHERE sha256 IN ({})", database_.of("blobs"), quoted(names)),
      [&there](const CatalogueRow& row) { there.emplace(row.text("sha256"), row.text("pack")); });
  const bool needed = std::ranges::any_of(tiles, [&](const PackedTile& tile) {
    const auto found = there.find(tile.sha256.hex());
    return found == there.end() || found->second == pack.hex();  // a damaged copy of this pack is replaced
  });
  if (needed) keep();
  if (pack_size(upload, pack)) return;
  CatalogueRow row = database_.new_row("packs");
  row.set("upload", upload).set("sha256", pack.hex()).set("bytes", static_cast<std::int64_t>(bytes));
  database_.insert("packs", row, Insert::one);
  for (const PackedTile& tile : tiles) {
    if (!there.emplace(tile.sha256.hex(), pack.hex()).second) continue;
    CatalogueRow blob = database_.new_row("blobs");
    blob.set("sha256", tile.sha256.hex())
        .set("pack", pack.hex())
        .set("start", static_cast<std::int64_t>(tile.start))
        .set("bytes", static_cast<std::int64_t>(tile.bytes));
    database_.insert("blobs", blob, Insert::bulk);
  }
  database_.finish_bulk("blobs");
  transaction.commit();
}

std::optional<std::uint64_t> CandidateCatalogue::pack_size(std::int64_t upload, const Sha256& pack) {
  std::optional<std::uint64_t> size;
  database_.select(fmt::format("SELECT bytes FROM {} WHERE upload = {} AND sha256 = '{}'", database_.of("packs"),
                               upload, pack.hex()),
                   [&size](const CatalogueRow& row) { size = static_cast<std::uint64_t>(row.integer("bytes")); });
  return size;
}

std::vector<Sha256> CandidateCatalogue::forget_dead_packs(std::int64_t upload) {
  CatalogueTransaction transaction(database_);
  std::vector<Sha256> packs = drop_dead(packs_about(upload));
  transaction.commit();
  return packs;
}

// Its own, and those of others in which tiles of it lie: its verdicts may be the last that they waited for.
std::set<Sha256> CandidateCatalogue::packs_about(std::int64_t upload) {
  std::set<Sha256> packs;
  database_.select(fmt::format("SELECT sha256 AS pack FROM {} WHERE upload = {} UNION "
                               "SELECT b.pack AS pack FROM {} t JOIN {} b ON b.sha256 = t.sha256 WHERE t.upload = {}",
                               database_.of("packs"), upload, database_.of("tiles"), database_.of("blobs"), upload),
                   [&packs](const CatalogueRow& row) { packs.insert(digest_from(row, "pack")); });
  return packs;
}

// Within a transaction.
std::vector<Sha256> CandidateCatalogue::drop_dead(std::set<Sha256> packs) {
  if (packs.empty()) return {};
  // A pack lives while a tile with one of its digests is accepted or waits for its verdict.
  const std::vector<Sha256> all(packs.begin(), packs.end());
  database_.select(
      fmt::format("SELECT DISTINCT b.pack AS pack FROM {} b JOIN {} t ON t.sha256 = b.sha256 LEFT JOIN {} v "
                  "ON v.tile = t.id WHERE b.pack IN ({}) AND (v.verdict IS NULL OR v.verdict = 0)",
                  database_.of("blobs"), database_.of("tiles"), database_.of("verdicts"), quoted(all)),
      [&packs](const CatalogueRow& row) { packs.erase(digest_from(row, "pack")); });
  std::vector<Sha256> dead(packs.begin(), packs.end());
  if (!dead.empty()) {
    database_.change(fmt::format("DELETE FROM {} WHERE pack IN ({})", database_.of("blobs"), quoted(dead)),
                     "forgetting packs");
  }
  return dead;
}

void CandidateCatalogue::remove_unused(std::span<const Sha256> packs,
                                       const std::function<void(const Sha256&)>& remove) {
  if (packs.empty()) return;
  CatalogueTransaction transaction(database_);  // nothing is changed: it keeps add_pack() waiting
  std::set<std::string> used;
  database_.select(fmt::format("SELECT DISTINCT pack FROM {} WHERE pack IN ({})", database_.of("blobs"), quoted(packs)),
                   [&used](const CatalogueRow& row) { used.insert(row.text("pack")); });
  for (const Sha256& pack : packs) {
    if (!used.contains(pack.hex())) remove(pack);
  }
  transaction.commit();
}

void CandidateCatalogue::forget_bytes(std::span<const Sha256> tiles) {
  if (tiles.empty()) return;
  const std::string digests = quoted(tiles);
  database_.change(
      fmt::format("DELETE FROM {0} WHERE sha256 IN ({1}) AND sha256 NOT IN (SELECT t.sha256 FROM {2} t LEFT JOIN {3} v "
                  "ON v.tile = t.id WHERE t.sha256 IN ({1}) AND (v.verdict IS NULL OR v.verdict = 0))",
                  database_.of("blobs"), digests, database_.of("tiles"), database_.of("verdicts")),
      "forgetting damaged tiles");
}

std::set<Sha256> CandidateCatalogue::packs() {
  std::set<Sha256> packs;
  database_.select(fmt::format("SELECT DISTINCT pack FROM {}", database_.of("blobs")),
                   [&packs](const CatalogueRow& row) {
                     if (const auto pack = Sha256::from_hex(row.text("pack"))) packs.insert(*pack);
                   });
  return packs;
}

}  // namespace nadir
