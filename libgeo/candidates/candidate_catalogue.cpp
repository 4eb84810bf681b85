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

}  // namespace

CatalogueLayout candidate_catalogue_layout() {
  return {.format = "nadir.candidate-catalogue/1",
          .schema = "nadir_candidates",
          .spatialite = candidate_sql::spatialite,
          .postgis = candidate_sql::postgis,
          .spatialite_views = candidate_sql::spatialite_views,
          .postgis_views = candidate_sql::postgis_views,
          .last_view = "promotion_states",
          .maker = "nadir-candidates serve",
          .postgis_shared = candidate_sql::postgis_shared,
          .last_shared = "revoked_keys"};
}

CandidateCatalogue::CandidateCatalogue(const CatalogueLocation& location, Access access)
    : database_(location, access, candidate_catalogue_layout()) {}

std::optional<UploadRow> CandidateCatalogue::find_upload(const std::string& where) {
  std::optional<UploadRow> found;
  database_.select(fmt::format("SELECT * FROM {} WHERE {}", database_.of("uploads"), where),
                   [&found](const CatalogueRow& row) { found = candidate_rows::upload(row); });
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
      [&uploads](const CatalogueRow& row) { uploads.push_back(candidate_rows::upload(row)); });
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
  candidate_rows::insert_verdicts(database_, verdicts, now_ms);
  transaction.commit();
  return id;
}

void CandidateCatalogue::start_judging(std::int64_t upload) {
  CatalogueTransaction transaction(database_);
  set_state(upload, UploadState::judging);
  if (database_.is_server()) {  // the rows that workers lock
    database_.change(fmt::format("INSERT INTO {} (z, x, y) SELECT DISTINCT t.z, t.x, t.y FROM {} t WHERE t.upload = {} "
                                 "ON CONFLICT DO NOTHING",
                                 database_.of("addresses"), database_.of("tiles"), upload),
                     "noting the addresses of an upload");
  }
  transaction.commit();
}

std::optional<std::vector<Sha256>> CandidateCatalogue::finish_judging(std::int64_t upload) {
  const std::string waiting =
      fmt::format("SELECT count(*) AS n FROM {} t LEFT JOIN {} v ON v.tile = t.id WHERE t.upload = {} AND v.id IS NULL",
                  database_.of("tiles"), database_.of("verdicts"), upload);
  if (number(waiting) > 0) return std::nullopt;  // as mostly: without keeping others from writing
  CatalogueTransaction transaction(database_);
  const auto known = this->upload(upload);
  if (!known || known->state != UploadState::judging) return std::nullopt;
  set_state(upload, UploadState::judged);
  std::vector<Sha256> packs = drop_dead(packs_about(upload));
  transaction.commit();
  return packs;
}

// Within a transaction.
void CandidateCatalogue::set_state(std::int64_t upload, UploadState state) {
  database_.change(
      fmt::format("UPDATE {} SET state = {} WHERE id = {}", database_.of("uploads"), static_cast<int>(state), upload),
      "changing an upload's state");
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

std::vector<TileRow> CandidateCatalogue::tiles_of(std::int64_t upload, Detail detail) {
  return candidate_rows::select_tiles(database_, database_.of("tiles") + " t",
                                      fmt::format("t.upload = {} ORDER BY t.place", upload),
                                      detail == Detail::sidecars);
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
  if (!database_.is_server()) return counts;
  database_.select(
      fmt::format(
          "SELECT count(*) AS n, coalesce(max(extract(epoch FROM now() - a.xact_start) * 1000), 0)::bigint AS ms "
          "FROM pg_locks l JOIN pg_stat_activity a ON a.pid = l.pid "
          "WHERE l.relation = to_regclass('{}') AND l.mode = 'RowShareLock'",
          database_.of("addresses")),
      [&](const CatalogueRow& row) { counts.claims = row.integer("n"), counts.oldest_claim_ms = row.integer("ms"); });
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
  database_.select(fmt::format("SELECT sha256, pack FROM {} WHERE sha256 IN ({})", database_.of("blobs"),
                               candidate_rows::quoted(names)),
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

// Its own, and those of others in which tiles of it lie: its verdicts may be the last that they waited for.
std::set<Sha256> CandidateCatalogue::packs_about(std::int64_t upload) {
  std::set<Sha256> packs;
  database_.select(fmt::format("SELECT sha256 AS pack FROM {} WHERE upload = {} UNION "
                               "SELECT b.pack AS pack FROM {} t JOIN {} b ON b.sha256 = t.sha256 WHERE t.upload = {}",
                               database_.of("packs"), upload, database_.of("tiles"), database_.of("blobs"), upload),
                   [&packs](const CatalogueRow& row) { packs.insert(candidate_rows::digest(row, "pack")); });
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
                  database_.of("blobs"), database_.of("tiles"), database_.of("verdicts"), candidate_rows::quoted(all)),
      [&packs](const CatalogueRow& row) { packs.erase(candidate_rows::digest(row, "pack")); });
  std::vector<Sha256> dead(packs.begin(), packs.end());
  if (!dead.empty()) {
    database_.change(
        fmt::format("DELETE FROM {} WHERE pack IN ({})", database_.of("blobs"), candidate_rows::quoted(dead)),
        "removing packs");
  }
  return dead;
}

void CandidateCatalogue::remove_unused(std::span<const Sha256> packs,
                                       const std::function<void(const Sha256&)>& remove) {
  if (packs.empty()) return;
  CatalogueTransaction transaction(database_);  // nothing is changed: it keeps add_pack() waiting
  std::set<std::string> used;
  database_.select(fmt::format("SELECT DISTINCT pack FROM {} WHERE pack IN ({})", database_.of("blobs"),
                               candidate_rows::quoted(packs)),
                   [&used](const CatalogueRow& row) { used.insert(row.text("pack")); });
  for (const Sha256& pack : packs) {
    if (!used.contains(pack.hex())) remove(pack);
  }
  transaction.commit();
}

std::set<Sha256> CandidateCatalogue::packs() {
  std::set<Sha256> packs;
  database_.select(fmt::format("SELECT DISTINCT pack FROM {}", database_.of("blobs")),
                   [&packs](const CatalogueRow& row) {
                     if (const auto pack = Sha256::from_hex(row.text("pack"))) packs.insert(*pack);
                   });
  return packs;
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
                             .key = candidate_rows::key(row),
                             .decided_ms = row.time("decided_at").value_or(UtcTime()).unix_s * 1000,
                             .flights = row.integer("flights"),
                             .evidence = row.text("evidence")},
               .sidecar = parse_candidate(row.text("sidecar"), "the catalogue's sidecar"),
               .blob = candidate_rows::blob(row)});
      });
}

}  // namespace nadir
