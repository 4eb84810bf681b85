#include "candidates/candidate_catalogue.hpp"

#include <fmt/format.h>

#include <cmath>
#include <map>
#include <tuple>

#include "base/error.hpp"
#include "candidates/candidate_sql.hpp"
#include "candidates/catalogue_transaction.hpp"
#include "catalogue/geometry.hpp"
#include "trust/base64.hpp"

namespace nadir {
namespace {

using Insert = CatalogueDatabase::Insert;

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

Sha256 digest_from(const CatalogueRow& row, const char* column) {
  const auto parsed = Sha256::from_hex(row.text(column));
  if (parsed) return *parsed;
  throw Error({.what = "the catalogue holds a digest that is none",
               .where = column,
               .fix = "somebody has changed the tables; restore the database from a copy"});
}

BlobPlace blob_from(const CatalogueRow& row) {
  return {.pack = digest_from(row, "pack"),
          .start = static_cast<std::uint64_t>(row.integer("start")),
          .bytes = static_cast<std::uint64_t>(row.integer("bytes"))};
}

CatalogueLayout candidate_catalogue_layout() {
  return {.format = "nadir.candidate-catalogue/1",
          .schema = "nadir_candidates",
          .spatialite = candidate_sql::spatialite,
          .postgis = candidate_sql::postgis,
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
                   "forgetting an upload");
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

void CandidateCatalogue::judge(std::vector<Question> questions, std::int64_t now_ms, const Decide& decide) {
  if (questions.empty()) return;
  CatalogueTransaction transaction(database_);
  std::set<Sha256> accepted;
  using Seat = std::tuple<std::string, std::string, TileKey>;  // airframe, flight, address
  std::map<Seat, std::int64_t> best_mm;
  const auto take = [&](const Seat& seat, std::int64_t badness) {
    const auto [at, added] = best_mm.emplace(seat, badness);
    if (!added) at->second = std::min(at->second, badness);
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
  std::set<std::int64_t> judged;  // by somebody else in the meantime
  database_.select(fmt::format("SELECT tile FROM {} WHERE tile IN ({})", database_.of("verdicts"), ids),
                   [&](const CatalogueRow& row) { judged.insert(row.integer("tile")); });
  std::vector<TileVerdict> verdicts;
  std::vector<Sha256> damaged;
  for (Question& question : questions) {
    if (question.damaged) damaged.push_back(question.sidecar.sha256);
    if (judged.contains(question.verdict.tile)) continue;
    const CandidateSidecar& sidecar = question.sidecar;
    const Seat seat{sidecar.airframe, sidecar.flight, sidecar.key};
    Rivals rivals{.same_bytes = accepted.contains(sidecar.sha256)};
    if (const auto best = best_mm.find(seat); best != best_mm.end()) rivals.of_flight_mm = best->second;
    decide(question.verdict, sidecar, rivals);
    if (question.verdict.verdict == Verdict::accepted) {
      accepted.insert(sidecar.sha256);
      take(seat, std::lround(cost_mm(sidecar)));
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

}  // namespace nadir
