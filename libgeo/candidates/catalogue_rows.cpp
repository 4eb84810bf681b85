#include "candidates/catalogue_rows.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "base/printable.hpp"

namespace nadir::candidate_rows {

Sha256 digest(const CatalogueRow& row, const char* column) {
  const auto parsed = Sha256::from_hex(row.text(column));
  if (parsed) return *parsed;
  throw Error({.what = "the catalogue holds a malformed digest",
               .where = column,
               .expected = "64 hexadecimal digits",
               .found = printable(row.text(column)),
               .fix = "the tables were changed; restore the database from a copy"});
}

BlobPlace blob(const CatalogueRow& row) {
  return {.pack = digest(row, "pack"),
          .start = static_cast<std::uint64_t>(row.integer("start")),
          .bytes = static_cast<std::uint64_t>(row.integer("bytes"))};
}

TileKey key(const CatalogueRow& row) {
  return {static_cast<std::uint8_t>(row.integer("z")), static_cast<std::uint32_t>(row.integer("x")),
          static_cast<std::uint32_t>(row.integer("y"))};
}

UploadRow upload(const CatalogueRow& row) {
  return {.id = row.integer("id"),
          .name = row.text("name"),
          .batch_key = digest(row, "batch_key"),
          .batch = row.text("batch"),
          .body_sha256 = digest(row, "body_sha256"),
          .client = row.text("client"),
          .airframe = row.text("airframe"),
          .flight = row.text("flight"),
          .base_package = digest(row, "base_package"),
          .opened_ms = row.integer("opened_ms"),
          .expires_ms = row.integer("expires_ms"),
          .state = static_cast<UploadState>(row.integer("state")),
          .tiles = row.integer("tiles"),
          .bytes = row.integer("bytes")};
}

TileRow tile(const CatalogueRow& row, bool with_sidecar) {
  TileRow tile{.id = row.integer("id"),
               .upload = row.integer("upload"),
               .key = key(row),
               .place = row.integer("place"),
               .size = static_cast<std::uint64_t>(row.integer("size")),
               .sha256 = digest(row, "sha256"),
               .keyid = row.text("keyid"),
               .sidecar = {}};
  if (with_sidecar) tile.sidecar = row.text("sidecar");
  if (!row.is_null("pack")) tile.blob = blob(row);
  if (row.is_null("verdict")) return tile;
  tile.verdict = static_cast<Verdict>(row.integer("verdict"));
  if (!row.is_null("code")) tile.code = parse_reason_code(row.text("code"));
  tile.detail = row.text("detail");
  return tile;
}

std::string quoted(std::span<const Sha256> digests) {
  std::string list;
  for (const Sha256& digest : digests) list += fmt::format("{}'{}'", list.empty() ? "" : ",", digest.hex());
  return list;
}

std::vector<TileRow> select_tiles(CatalogueDatabase& database, const std::string& from,
                                  const std::string& where_and_order, bool with_sidecars) {
  std::vector<TileRow> tiles;
  database.select(fmt::format("SELECT t.id AS id, t.upload AS upload, t.z AS z, t.x AS x, t.y AS y, t.place AS place, "
                              "t.bytes AS size, t.sha256 AS "
                              "sha256, t.keyid AS keyid, {} b.pack AS pack, b.start AS start, b.bytes AS bytes, "
                              "v.verdict AS verdict, v.code AS code, v.detail AS detail FROM {} "
                              "JOIN {} u ON u.id = t.upload LEFT JOIN {} b ON b.sha256 = t.sha256 "
                              "LEFT JOIN {} v ON v.tile = t.id WHERE {}",
                              with_sidecars ? "t.sidecar AS sidecar," : "", from, database.of("uploads"),
                              database.of("blobs"), database.of("verdicts"), where_and_order),
                  [&](const CatalogueRow& row) { tiles.push_back(tile(row, with_sidecars)); });
  return tiles;
}

void insert_verdicts(CatalogueDatabase& database, std::span<const TileVerdict> verdicts, std::int64_t now_ms) {
  for (const TileVerdict& verdict : verdicts) {
    CatalogueRow row = database.new_row("verdicts");
    row.set("tile", verdict.tile)
        .set("verdict", static_cast<std::int64_t>(verdict.verdict))
        .set("detail", verdict.refusal ? verdict.refusal->detail : verdict.detail)
        .set("judged_at", UtcTime{now_ms / 1000})
        .set("to_vote", std::int64_t{verdict.verdict == Verdict::accepted && !verdict.voted ? 1 : 0});
    if (verdict.refusal) row.set("code", name_of(verdict.refusal->code));
    if (verdict.measures) {
      row.set("contrast_ppm", verdict.measures->contrast_ppm).set("sharpness_ppm", verdict.measures->sharpness_ppm);
      if (verdict.measures->base_shift_mm) row.set("base_shift_mm", *verdict.measures->base_shift_mm);
      if (verdict.measures->correlation_ppm) row.set("correlation_ppm", *verdict.measures->correlation_ppm);
    }
    database.insert("verdicts", row, CatalogueDatabase::Insert::bulk);
  }
  if (!verdicts.empty()) database.finish_bulk("verdicts");
}

}  // namespace nadir::candidate_rows
