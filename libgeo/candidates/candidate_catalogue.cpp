#include "candidates/candidate_catalogue.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "base/printable.hpp"
#include "catalogue/geometry.hpp"

namespace nadir {
namespace {

using Insert = CatalogueDatabase::Insert;

// Without commit() everything is taken back.
class CatalogueTransaction {
 public:
  explicit CatalogueTransaction(CatalogueDatabase& database) : database_(database) { database_.begin(); }
  ~CatalogueTransaction() {
    if (!committed_) database_.roll_back();
  }
  CatalogueTransaction(const CatalogueTransaction&) = delete;
  CatalogueTransaction& operator=(const CatalogueTransaction&) = delete;

  void commit() {
    database_.commit();
    committed_ = true;
  }

 private:
  CatalogueDatabase& database_;
  bool committed_ = false;
};

Sha256 digest_from(const CatalogueRow& row, const char* column) {
  const auto parsed = Sha256::from_hex(row.text(column));
  if (parsed) return *parsed;
  throw Error({.what = "the catalogue holds a malformed digest",
               .where = column,
               .expected = "64 hexadecimal digits",
               .found = printable(row.text(column)),
               .fix = "the tables were changed; restore the database from a copy"});
}

BlobPlace blob_from(const CatalogueRow& row) {
  return {.pack = digest_from(row, "pack"),
          .start = static_cast<std::uint64_t>(row.integer("start")),
          .bytes = static_cast<std::uint64_t>(row.integer("bytes"))};
}

// For IN (…).
std::string quoted(std::span<const Sha256> digests) {
  std::string list;
  for (const Sha256& digest : digests) list += fmt::format("{}'{}'", list.empty() ? "" : ",", digest.hex());
  return list;
}

TileKey key_from(const CatalogueRow& row) {
  return {static_cast<std::uint8_t>(row.integer("z")), static_cast<std::uint32_t>(row.integer("x")),
          static_cast<std::uint32_t>(row.integer("y"))};
}

// Every tile of these addresses, which the caller has sorted.
std::string at_any(const char* table, std::span<const AddressCandidates> addresses) {
  std::string text;
  for (const AddressCandidates& address : addresses) {
    text += fmt::format("{0}({1}.z={2} AND {1}.x={3} AND {1}.y={4})", text.empty() ? "" : " OR ", table, address.key.z,
                        address.key.x, address.key.y);
  }
  return text;
}

AddressCandidates& of(std::vector<AddressCandidates>& addresses, const TileKey& key) {
  return *std::lower_bound(
      addresses.begin(), addresses.end(), key,
      [](const AddressCandidates& address, const TileKey& wanted) { return address.key < wanted; });
}

// The ids of the candidates as an SQL list, to be appended to another.
std::string ids_of(const AddressCandidates& address, bool first) {
  std::string text;
  for (const AcceptedCandidate& candidate : address.candidates)
    text += fmt::format("{}{}", first && text.empty() ? "" : ",", candidate.tile);
  return text;
}

UploadRow upload_from(const CatalogueRow& row) {
  return {.id = row.integer("id"),
          .name = row.text("name"),
          .batch_key = digest_from(row, "batch_key"),
          .batch = row.text("batch"),
          .body_sha256 = digest_from(row, "body_sha256"),
          .client = row.text("client"),
          .airframe = row.text("airframe"),
          .flight = row.text("flight"),
          .base_package = digest_from(row, "base_package"),
          .opened_ms = row.integer("opened_ms"),
          .expires_ms = row.integer("expires_ms"),
          .state = static_cast<UploadState>(row.integer("state")),
          .tiles = row.integer("tiles"),
          .bytes = row.integer("bytes")};
}

TileRow tile_from(const CatalogueRow& row, bool with_sidecar) {
  TileRow tile{.id = row.integer("id"),
               .place = row.integer("place"),
               .size = static_cast<std::uint64_t>(row.integer("size")),
               .sha256 = digest_from(row, "sha256"),
               .keyid = row.text("keyid"),
               .sidecar = {}};
  if (with_sidecar) tile.sidecar = row.text("sidecar");
  if (!row.is_null("pack")) tile.blob = blob_from(row);
  if (row.is_null("verdict")) return tile;
  tile.verdict = static_cast<Verdict>(row.integer("verdict"));
  if (!row.is_null("code")) tile.code = parse_reason_code(row.text("code"));
  tile.detail = row.text("detail");
  return tile;
}

}  // namespace

CatalogueLayout candidate_catalogue_layout() {
  return {.format = "nadir.candidate-catalogue/1",
          .schema = "nadir_candidates",
          .spatialite = candidate_sql::spatialite,
          .postgis = candidate_sql::postgis,
          .spatialite_views = candidate_sql::spatialite_views,
          .postgis_views = candidate_sql::postgis_views,
          .last_view = "promotion_states",
          .maker = "nadir-candidates serve"};
}

CandidateCatalogue::CandidateCatalogue(const CatalogueLocation& location, Access access)
    : database_(location, access, candidate_catalogue_layout()) {}

std::optional<UploadRow> CandidateCatalogue::find_upload(const std::string& where) {
  std::optional<UploadRow> found;
  database_.select(fmt::format("SELECT * FROM {} WHERE {}", database_.of("uploads"), where),
                   [&found](const CatalogueRow& row) { found = upload_from(row); });
  return found;
}

std::optional<UploadRow> CandidateCatalogue::upload_of_batch(const Sha256& batch_key) {
  return find_upload(fmt::format("batch_key = '{}'", batch_key.hex()));
}

std::optional<UploadRow> CandidateCatalogue::upload(std::int64_t id) { return find_upload(fmt::format("id = {}", id)); }

std::optional<UploadRow> CandidateCatalogue::upload_named(const std::string& name) {
  if (name.find_first_not_of("0123456789abcdef") != std::string::npos) return std::nullopt;
  return find_upload(fmt::format("name = '{}'", name));
}

std::vector<UploadRow> CandidateCatalogue::uploads_in(UploadState state) {
  std::vector<UploadRow> uploads;
  database_.select(
      fmt::format("SELECT * FROM {} WHERE state = {} ORDER BY id", database_.of("uploads"), static_cast<int>(state)),
      [&uploads](const CatalogueRow& row) { uploads.push_back(upload_from(row)); });
  return uploads;
}

std::int64_t CandidateCatalogue::open_upload(const UploadRow& upload, const Batch& batch,
                                             std::span<const std::optional<Refusal>> refusals, std::int64_t now_ms) {
  CatalogueTransaction transaction(database_);
  if (const auto known = upload_of_batch(upload.batch_key)) return known->id;
  CatalogueRow row = database_.new_row("uploads");
  row.set("name", upload.name)
      .set("batch_key", upload.batch_key.hex())
      .set("batch", upload.batch)
      .set("body_sha256", upload.body_sha256.hex())
      .set("client", upload.client)
      .set("airframe", upload.airframe)
      .set("flight", upload.flight)
      .set("base_package", upload.base_package.hex())
      .set("opened_ms", upload.opened_ms)
      .set("expires_ms", upload.expires_ms)
      .set("state", static_cast<std::int64_t>(upload.state))
      .set("tiles", upload.tiles)
      .set("bytes", upload.bytes);
  const std::int64_t id = database_.insert("uploads", row, Insert::one);
  for (std::size_t place = 0; place < batch.tiles.size(); ++place) {
    const BatchTile& announced = batch.tiles[place];
    const CandidateSidecar& sidecar = announced.sidecar;
    CatalogueRow tile = database_.new_row("tiles");
    tile.set("upload", id)
        .set("place", static_cast<std::int64_t>(place))
        .set("z", std::int64_t{sidecar.key.z})
        .set("x", std::int64_t{sidecar.key.x})
        .set("y", std::int64_t{sidecar.key.y})
        .set("sha256", sidecar.sha256.hex())
        .set("bytes", static_cast<std::int64_t>(sidecar.size))
        .set("captured_at", UtcTime{sidecar.captured_at.unix_ms / 1000})
        .set("gsd_mm", sidecar.gsd_mm)
        .set("sigma_mm", sidecar.pose.sigma_mm)
        .set("badness_mm", static_cast<std::int64_t>(std::lround(cost_mm(sidecar))))
        .set("trust", name_of(sidecar.trust))
        .set("keyid", announced.signature.keyid)
        .set("signature", to_base64(announced.signature.signature))
        .set("sidecar", announced.sidecar_bytes);
    if (sidecar.key.valid()) tile.shape(polygon_geometry(area_of(sidecar.key)));
    database_.insert("tiles", tile, Insert::bulk);
  }
  database_.finish_bulk("tiles");
  std::vector<TileVerdict> verdicts;
  database_.select(fmt::format("SELECT id, place FROM {} WHERE upload = {}", database_.of("tiles"), id),
                   [&](const CatalogueRow& tile) {
                     const auto& refusal = refusals[static_cast<std::size_t>(tile.integer("place"))];
                     if (!refusal) return;
                     verdicts.push_back({.tile = tile.integer("id"), .verdict = Verdict::rejected, .refusal = refusal});
                   });
  add_verdicts(verdicts, now_ms);
  transaction.commit();
  return id;
}

void CandidateCatalogue::set_state(std::int64_t upload, UploadState state) {
  CatalogueTransaction transaction(database_);
  database_.change(
      fmt::format("UPDATE {} SET state = {} WHERE id = {}", database_.of("uploads"), static_cast<int>(state), upload),
      "changing an upload's state");
  transaction.commit();
}

std::vector<Sha256> CandidateCatalogue::forget_upload(std::int64_t upload) {
  CatalogueTransaction transaction(database_);
  const std::set<Sha256> about = packs_about(upload);
  database_.change(fmt::format("DELETE FROM {} WHERE tile IN (SELECT id FROM {} WHERE upload = {})",
                               database_.of("verdicts"), database_.of("tiles"), upload),
                   "removing an upload");
  database_.erase("tiles", "upload", upload);
  std::vector<Sha256> packs = drop_dead(about);
  database_.erase("packs", "upload", upload);
  database_.erase("uploads", "id", upload);
  transaction.commit();
  return packs;
}

std::vector<TileRow> CandidateCatalogue::select_tiles(const std::string& where_and_order, Detail detail) {
  const bool sidecars = detail == Detail::sidecars;
  std::vector<TileRow> tiles;
  database_.select(fmt::format("SELECT t.id AS id, t.place AS place, t.bytes AS size, t.sha256 AS sha256, "
                               "t.keyid AS keyid, {} b.pack AS pack, b.start AS start, b.bytes AS bytes, v.verdict AS "
                               "verdict, v.code AS code, v.detail AS detail FROM {} t "
                               "LEFT JOIN {} b ON b.sha256 = t.sha256 LEFT JOIN {} v ON v.tile = t.id WHERE {}",
                               sidecars ? "t.sidecar AS sidecar," : "", database_.of("tiles"), database_.of("blobs"),
                               database_.of("verdicts"), where_and_order),
                   [&](const CatalogueRow& row) { tiles.push_back(tile_from(row, sidecars)); });
  return tiles;
}

std::vector<TileRow> CandidateCatalogue::tiles_of(std::int64_t upload, Detail detail) {
  return select_tiles(fmt::format("t.upload = {} ORDER BY t.place", upload), detail);
}

std::vector<TileRow> CandidateCatalogue::tiles_to_judge(std::int64_t upload, std::size_t limit,
                                                        const std::set<std::int64_t>& but) {
  std::string others;
  for (const std::int64_t tile : but) others += fmt::format("{}{}", others.empty() ? " AND t.id NOT IN (" : ",", tile);
  if (!others.empty()) others += ")";
  return select_tiles(fmt::format("t.upload = {} AND v.id IS NULL AND b.id IS NOT NULL{} ORDER BY t.place LIMIT {}",
                                  upload, others, limit),
                      Detail::sidecars);
}

void CandidateCatalogue::add_verdicts(std::span<const TileVerdict> verdicts, std::int64_t now_ms) {
  for (const TileVerdict& verdict : verdicts) {
    CatalogueRow row = database_.new_row("verdicts");
    row.set("tile", verdict.tile)
        .set("verdict", static_cast<std::int64_t>(verdict.verdict))
        .set("detail", verdict.refusal ? verdict.refusal->detail : verdict.detail)
        .set("judged_at", UtcTime{now_ms / 1000})
        .set("to_vote", std::int64_t{verdict.verdict == Verdict::accepted ? 1 : 0});
    if (verdict.refusal) row.set("code", name_of(verdict.refusal->code));
    if (verdict.measures) {
      row.set("contrast_ppm", verdict.measures->contrast_ppm).set("sharpness_ppm", verdict.measures->sharpness_ppm);
      if (verdict.measures->base_shift_mm) row.set("base_shift_mm", *verdict.measures->base_shift_mm);
      if (verdict.measures->correlation_ppm) row.set("correlation_ppm", *verdict.measures->correlation_ppm);
    }
    database_.insert("verdicts", row, Insert::bulk);
  }
  if (!verdicts.empty()) database_.finish_bulk("verdicts");
}

void CandidateCatalogue::add_evaluated(std::vector<Question> questions, std::int64_t now_ms, const Decide& decide) {
  if (questions.empty()) return;
  CatalogueTransaction transaction(database_);
  std::set<Sha256> accepted;
  using FlightTile = std::tuple<std::string, std::string, TileKey>;  // airframe, flight, address
  std::map<FlightTile, std::int64_t> best_mm;
  const auto take = [&](const FlightTile& tile, std::int64_t cost) {
    const auto [at, added] = best_mm.emplace(tile, cost);
    if (!added) at->second = std::min(at->second, cost);
  };
  std::string digests, addresses, ids;
  for (const Question& question : questions) {
    const TileKey& key = question.sidecar.key;
    digests += fmt::format("{}'{}'", digests.empty() ? "" : ",", question.sidecar.sha256.hex());
    addresses += fmt::format("{}(t.z={} AND t.x={} AND t.y={})", addresses.empty() ? "" : " OR ", key.z, key.x, key.y);
    ids += fmt::format("{}{}", ids.empty() ? "" : ",", question.verdict.tile);
  }
  const std::string from =
      fmt::format("FROM {} t JOIN {} v ON v.tile = t.id JOIN {} u ON u.id = t.upload WHERE v.verdict = 0",
                  database_.of("tiles"), database_.of("verdicts"), database_.of("uploads"));
  database_.select(fmt::format("SELECT t.sha256 AS sha256 {} AND t.sha256 IN ({})", from, digests),
                   [&](const CatalogueRow& row) { accepted.insert(digest_from(row, "sha256")); });
  database_.select(
      fmt::format("SELECT t.z AS z, t.x AS x, t.y AS y, t.badness_mm AS badness_mm, u.airframe AS airframe, "
                  "u.flight AS flight {} AND ({})",
                  from, addresses),
      [&](const CatalogueRow& row) {
        const TileKey key{static_cast<std::uint8_t>(row.integer("z")), static_cast<std::uint32_t>(row.integer("x")),
                          static_cast<std::uint32_t>(row.integer("y"))};
        take({row.text("airframe"), row.text("flight"), key}, row.integer("badness_mm"));
      });
  std::set<std::int64_t> decided;  // by another call in the meantime
  database_.select(fmt::format("SELECT tile FROM {} WHERE tile IN ({})", database_.of("verdicts"), ids),
                   [&](const CatalogueRow& row) { decided.insert(row.integer("tile")); });
  std::vector<TileVerdict> verdicts;
  std::vector<Sha256> damaged;
  for (Question& question : questions) {
    if (question.damaged) damaged.push_back(question.sidecar.sha256);
    if (decided.contains(question.verdict.tile)) continue;
    const CandidateSidecar& sidecar = question.sidecar;
    const FlightTile flight_tile{sidecar.airframe, sidecar.flight, sidecar.key};
    Competitors rivals{.same_bytes = accepted.contains(sidecar.sha256)};
    if (const auto best = best_mm.find(flight_tile); best != best_mm.end()) rivals.of_flight_mm = best->second;
    decide(question.verdict, sidecar, rivals);
    if (question.verdict.verdict == Verdict::accepted) {
      accepted.insert(sidecar.sha256);
      take(flight_tile, std::lround(cost_mm(sidecar)));
    }
    verdicts.push_back(std::move(question.verdict));
  }
  add_verdicts(verdicts, now_ms);
  forget_bytes(damaged);
  transaction.commit();
}

Usage CandidateCatalogue::usage_of(const std::string& airframe, std::int64_t since_ms) {
  Usage usage;
  database_.select(
      fmt::format("SELECT airframe, sum(tiles) AS tiles, sum(bytes) AS bytes FROM {} WHERE opened_ms >= {} "
                  "GROUP BY airframe",
                  database_.of("uploads"), since_ms),
      [&](const CatalogueRow& row) {
        if (row.text("airframe") == airframe) usage = {row.integer("tiles"), row.integer("bytes")};
      });
  return usage;
}

std::int64_t CandidateCatalogue::refused_batches_of(const std::string& client, std::int64_t since_ms) {
  std::int64_t batches = 0;
  database_.select(fmt::format("SELECT client, count(*) AS n FROM {} WHERE opened_ms >= {} AND tiles = 0 "
                               "GROUP BY client",
                               database_.of("uploads"), since_ms),
                   [&](const CatalogueRow& row) {
                     if (row.text("client") == client) batches = row.integer("n");
                   });
  return batches;
}

std::int64_t CandidateCatalogue::number(const std::string& sql) {
  std::int64_t answer = 0;
  database_.select(sql, [&answer](const CatalogueRow& row) { answer = row.integer("n"); });
  return answer;
}

void CandidateCatalogue::probe() { number(fmt::format("SELECT count(*) AS n FROM {}", database_.of("catalogue"))); }

CatalogueCounts CandidateCatalogue::counts() {
  const auto count = [this](const char* table, const std::string& where) {
    return number(fmt::format("SELECT count(*) AS n FROM {} WHERE {}", database_.of(table), where));
  };
  CatalogueCounts counts{.uploads = count("uploads", "1 = 1"),
                         .open = count("uploads", "state = 0"),
                         .judging = count("uploads", "state = 1"),
                         .tiles = count("tiles", "1 = 1"),
                         .accepted = count("verdicts", "verdict = 0"),
                         .rejected = count("verdicts", "verdict = 1"),
                         .duplicate = count("verdicts", "verdict = 2"),
                         .to_vote = count("verdicts", "to_vote = 1"),
                         .promoted = count("promotions", "current = 1"),
                         .rejected_by = {}};
  database_.select(
      fmt::format("SELECT code, count(*) AS n FROM {} WHERE verdict = 1 GROUP BY code ORDER BY code",
                  database_.of("verdicts")),
      [&](const CatalogueRow& row) { counts.rejected_by.emplace_back(row.text("code"), row.integer("n")); });
  return counts;
}

// The catalogue's packs and blobs: which bytes are there, and where.

void CandidateCatalogue::add_pack(std::int64_t upload, const Sha256& pack, std::uint64_t bytes,
                                  std::span<const PackedTile> tiles, const std::function<void()>& keep) {
  CatalogueTransaction transaction(database_);
  if (!this->upload(upload))
    throw Error({.what = "the upload of this pack has expired and was removed",
                 .where = "pack " + pack.hex(),
                 .fix = "announce the batch again"});
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
                     "removing packs");
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
      "removing damaged tiles");
}

std::set<Sha256> CandidateCatalogue::packs() {
  std::set<Sha256> packs;
  database_.select(fmt::format("SELECT DISTINCT pack FROM {}", database_.of("blobs")),
                   [&packs](const CatalogueRow& row) {
                     if (const auto pack = Sha256::from_hex(row.text("pack"))) packs.insert(*pack);
                   });
  return packs;
}

// The catalogue's votes and promotions.
std::vector<AddressCandidates> CandidateCatalogue::open_addresses(std::size_t limit, const std::set<TileKey>& but) {
  std::vector<AddressCandidates> addresses;
  std::string others;
  for (const TileKey& key : but) {
    others +=
        fmt::format("{}({},{},{})", others.empty() ? " AND (t.z, t.x, t.y) NOT IN (VALUES " : ",", key.z, key.x, key.y);
  }
  if (!others.empty()) others += ")";
  database_.select(fmt::format("SELECT DISTINCT t.z AS z, t.x AS x, t.y AS y FROM {} v JOIN {} t ON t.id = v.tile "
                               "WHERE v.to_vote = 1{} LIMIT {}",
                               database_.of("verdicts"), database_.of("tiles"), others, limit),
                   [&addresses](const CatalogueRow& row) { addresses.push_back({.key = key_from(row)}); });
  if (addresses.empty()) return addresses;
  std::sort(addresses.begin(), addresses.end(),
            [](const AddressCandidates& a, const AddressCandidates& b) { return a.key < b.key; });
  database_.select(
      fmt::format("SELECT t.id AS id, t.z AS z, t.x AS x, t.y AS y, t.sidecar AS sidecar, b.pack AS pack, "
                  "b.start AS start, b.bytes AS bytes FROM {} t JOIN {} v ON v.tile = t.id JOIN {} b ON "
                  "b.sha256 = t.sha256 WHERE v.verdict = 0 AND ({}) ORDER BY t.id",
                  database_.of("tiles"), database_.of("verdicts"), database_.of("blobs"), at_any("t", addresses)),
      [&addresses](const CatalogueRow& row) {
        of(addresses, key_from(row))
            .candidates.push_back({.tile = row.integer("id"),
                                   .sidecar = parse_candidate(row.text("sidecar"), "the catalogue's sidecar"),
                                   .blob = blob_from(row)});
      });
  database_.select(
      fmt::format("SELECT t.z AS z, t.x AS x, t.y AS y, w.tile AS tile, w.other AS other, w.shift_mm AS "
                  "shift_mm, w.allowed_mm AS allowed_mm, w.correlation_ppm AS correlation_ppm, w.agrees AS "
                  "agrees FROM {} w JOIN {} t ON t.id = w.tile WHERE {} ORDER BY w.id",
                  database_.of("votes"), database_.of("tiles"), at_any("t", addresses)),
      [&addresses](const CatalogueRow& row) {
        of(addresses, key_from(row))
            .votes.push_back({.tile = row.integer("tile"),
                              .other = row.integer("other"),
                              .shift_mm = row.integer("shift_mm"),
                              .allowed_mm = row.integer("allowed_mm"),
                              .correlation_ppm = row.integer("correlation_ppm"),
                              .agrees = row.integer("agrees") == 1});
      });
  database_.select(
      fmt::format("SELECT p.z AS z, p.x AS x, p.y AS y, p.tile AS tile FROM {} p WHERE p.current = 1 AND ({})",
                  database_.of("promotions"), at_any("p", addresses)),
      [&addresses](const CatalogueRow& row) { of(addresses, key_from(row)).promoted = row.integer("tile"); });
  return addresses;
}

void CandidateCatalogue::close(std::span<const AddressCandidates> addresses, std::span<const Outcome> outcomes) {
  CatalogueTransaction transaction(database_);
  std::string candidates;
  for (const AddressCandidates& address : addresses) candidates += ids_of(address, candidates.empty());
  if (candidates.empty()) return;
  std::set<std::int64_t> gone;  // withdrawn while they were voted on
  database_.select(
      fmt::format("SELECT tile FROM {} WHERE verdict <> 0 AND tile IN ({})", database_.of("verdicts"), candidates),
      [&gone](const CatalogueRow& row) { gone.insert(row.integer("tile")); });
  const auto stands = [&gone](const AddressCandidates& address) {
    return std::none_of(address.candidates.begin(), address.candidates.end(),
                        [&gone](const AcceptedCandidate& candidate) { return gone.contains(candidate.tile); });
  };
  std::string closed;
  bool voted = false;
  for (std::size_t i = 0; i < addresses.size(); ++i) {
    for (const Vote& vote : outcomes[i].new_votes) {
      CatalogueRow row = database_.new_row("votes");
      row.set("tile", vote.tile)
          .set("other", vote.other)
          .set("shift_mm", vote.shift_mm)
          .set("allowed_mm", vote.allowed_mm)
          .set("correlation_ppm", vote.correlation_ppm)
          .set("agrees", std::int64_t{vote.agrees ? 1 : 0});
      database_.insert("votes", row, Insert::bulk);
      voted = true;
    }
    if (stands(addresses[i])) closed += ids_of(addresses[i], closed.empty());
  }
  if (voted) database_.finish_bulk("votes");
  if (!closed.empty()) {
    database_.change(
        fmt::format("UPDATE {} SET to_vote = 0 WHERE to_vote = 1 AND tile IN ({})", database_.of("verdicts"), closed),
        "closing a vote");
  }
  for (std::size_t i = 0; i < addresses.size(); ++i) {
    if (outcomes[i].promotion && stands(addresses[i])) promote(*outcomes[i].promotion);
  }
  transaction.commit();
}

void CandidateCatalogue::promote(const Promotion& promotion) {
  const TileKey& key = promotion.key;
  database_.change(fmt::format("UPDATE {} SET current = 0 WHERE current = 1 AND z = {} AND x = {} AND y = {}",
                               database_.of("promotions"), key.z, key.x, key.y),
                   "replacing a promoted tile");
  CatalogueRow row = database_.new_row("promotions");
  row.set("tile", promotion.tile)
      .set("z", std::int64_t{key.z})
      .set("x", std::int64_t{key.x})
      .set("y", std::int64_t{key.y})
      .set("decided_at", UtcTime{promotion.decided_ms / 1000})
      .set("flights", promotion.flights)
      .set("evidence", promotion.evidence)
      .set("current", std::int64_t{1})
      .shape(polygon_geometry(area_of(key)));
  database_.insert("promotions", row, Insert::one);
}

std::int64_t CandidateCatalogue::withdraw(const std::set<std::string>& keys) {
  std::string list;
  for (const std::string& key : keys) {
    if (Sha256::from_hex(key)) list += fmt::format("{}'{}'", list.empty() ? "" : ",", key);
  }
  if (list.empty()) return 0;
  const std::string tiles = database_.of("tiles"), verdicts = database_.of("verdicts");
  const std::string theirs = fmt::format("FROM {} t JOIN {} v ON v.tile = t.id WHERE v.verdict = 0 AND t.keyid IN ({})",
                                         tiles, verdicts, list);
  CatalogueTransaction transaction(database_);
  const std::int64_t count = number("SELECT count(*) AS n " + theirs);
  if (count == 0) return 0;
  const std::string there = fmt::format("(z, x, y) IN (SELECT t.z, t.x, t.y {})", theirs);
  database_.change(fmt::format("UPDATE {} SET current = 0 WHERE current = 1 AND {}", database_.of("promotions"), there),
                   "revoking promotions");
  database_.change(fmt::format("UPDATE {} SET to_vote = 1 WHERE verdict = 0 AND tile IN (SELECT id FROM {} WHERE {})",
                               verdicts, tiles, there),
                   "requesting new votes");
  database_.change(fmt::format("UPDATE {} SET verdict = {}, code = '{}', detail = '{}', to_vote = 0 WHERE verdict = 0 "
                               "AND tile IN (SELECT id FROM {} WHERE keyid IN ({}))",
                               verdicts, static_cast<int>(Verdict::rejected), name_of(ReasonCode::airframe_revoked),
                               kRevokedLater, tiles, list),
                   "revoking verdicts");
  transaction.commit();
  return count;
}

void CandidateCatalogue::each_promoted(const std::function<void(const PromotedTile&)>& visit) {
  database_.select(
      fmt::format(
          "SELECT p.tile AS tile, p.z AS z, p.x AS x, p.y AS y, p.decided_at AS decided_at, p.flights AS flights, "
          "p.evidence AS evidence, t.sidecar AS sidecar, b.pack AS pack, b.start AS start, b.bytes AS bytes "
          "FROM {} p JOIN {} t ON t.id = p.tile JOIN {} b ON b.sha256 = t.sha256 WHERE p.current = 1 "
          "ORDER BY p.z, p.x, p.y",
          database_.of("promotions"), database_.of("tiles"), database_.of("blobs")),
      [&visit](const CatalogueRow& row) {
        visit({.promotion = {.tile = row.integer("tile"),
                             .key = key_from(row),
                             .decided_ms = row.time("decided_at").value_or(UtcTime()).unix_s * 1000,
                             .flights = row.integer("flights"),
                             .evidence = row.text("evidence")},
               .sidecar = parse_candidate(row.text("sidecar"), "the catalogue's sidecar"),
               .blob = blob_from(row)});
      });
}

}  // namespace nadir
