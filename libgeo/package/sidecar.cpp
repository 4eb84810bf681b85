#include "package/sidecar.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"

namespace nadir {
namespace {

// A file without journal: it is written into a staging folder. As the MBTiles writer does it.
constexpr const char* kBeginSidecarFile = R"sql(
PRAGMA page_size = 4096;
PRAGMA journal_mode = OFF;
PRAGMA synchronous = OFF;
PRAGMA locking_mode = EXCLUSIVE;
PRAGMA encoding = 'UTF-8';
BEGIN;
CREATE TABLE metadata (name TEXT, value TEXT);
)sql";

// In the order of TileKey: zoom, column, then XYZ row, which grows as the TMS row falls.
constexpr const char* kSelectSidecars = R"sql(
SELECT zoom_level, tile_column, tile_row, sha256, source, captured_at, gsd_mm, ce90_mm, trust, sector, valid_ppm, mask
FROM nadir_sidecars ORDER BY zoom_level, tile_column, tile_row DESC
)sql";

void append_u32(Bytes& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<std::uint8_t>(value >> shift));
}

void append_i64(Bytes& out, std::int64_t value) {
  const auto bits = static_cast<std::uint64_t>(value);
  append_u32(out, static_cast<std::uint32_t>(bits >> 32));
  append_u32(out, static_cast<std::uint32_t>(bits));
}

void append_sized(Bytes& out, ByteView bytes) {
  append_u32(out, static_cast<std::uint32_t>(bytes.size()));
  out.insert(out.end(), bytes.begin(), bytes.end());
}

}  // namespace

std::string_view name_of(TileTrust trust) {
  switch (trust) {
    case TileTrust::service: return "service";
    case TileTrust::candidate: return "candidate";
    case TileTrust::soft: return "soft";
  }
  return "soft";
}

std::optional<TileTrust> parse_tile_trust(std::string_view name) {
  for (const TileTrust trust : {TileTrust::service, TileTrust::candidate, TileTrust::soft}) {
    if (name == name_of(trust)) return trust;
  }
  return std::nullopt;
}

void SidecarDigest::add(const Sidecar& sidecar) {
  if (last_ && !(*last_ < sidecar.key)) {
    throw Error({.what = "sidecars are not in the order of their tiles", .where = to_text(sidecar.key)});
  }
  last_ = sidecar.key;
  row_.clear();
  row_.push_back(sidecar.key.z);
  append_u32(row_, sidecar.key.x);
  append_u32(row_, sidecar.key.y);
  row_.insert(row_.end(), sidecar.sha256.bytes.begin(), sidecar.sha256.bytes.end());
  append_i64(row_, sidecar.captured_at.unix_s);
  append_i64(row_, sidecar.gsd_mm);
  append_i64(row_, sidecar.ce90_mm);
  append_i64(row_, sidecar.valid_ppm);
  append_sized(row_, as_bytes(sidecar.source));
  append_sized(row_, as_bytes(name_of(sidecar.trust)));
  append_sized(row_, as_bytes(sidecar.sector));
  append_sized(row_, sidecar.mask);
  stream_.update(row_);
}

Sha256 SidecarDigest::finish() {
  last_.reset();
  return stream_.finish();
}

namespace {

constexpr std::size_t kNamedFiles = 20;

std::optional<Sidecar> sidecar_from(const SqliteStatement& row, const TileKey& key) {
  Sidecar sidecar;
  sidecar.key = key;
  const ByteView digest = row.blob(3);
  const auto captured_at = parse_utc(row.text(5));
  const auto trust = parse_tile_trust(row.text(8));
  if (digest.size() != sidecar.sha256.bytes.size() || !captured_at || !trust) return std::nullopt;
  std::copy(digest.begin(), digest.end(), sidecar.sha256.bytes.begin());
  sidecar.source = row.text(4);
  sidecar.captured_at = *captured_at;
  sidecar.gsd_mm = row.integer(6);
  sidecar.ce90_mm = row.integer(7);
  sidecar.trust = *trust;
  sidecar.sector = row.text(9);
  sidecar.valid_ppm = row.integer(10);
  const ByteView mask = row.blob(11);
  sidecar.mask.assign(mask.begin(), mask.end());
  const bool in_range =
      sidecar.gsd_mm > 0 && sidecar.ce90_mm >= 0 && sidecar.valid_ppm >= 0 && sidecar.valid_ppm <= kWholeTile_ppm;
  return in_range ? std::optional(std::move(sidecar)) : std::nullopt;
}

}  // namespace

SidecarWriter::SidecarWriter(const SqliteDatabase& database)
    : insert_((database.execute(sql::kCreateSidecars), database.prepare(sql::kInsertSidecar))) {}

void SidecarWriter::add(const Sidecar& sidecar) {
  const std::string captured_at = to_rfc3339(sidecar.captured_at);
  insert_.bind(1, std::int64_t{sidecar.key.z})
      .bind(2, std::int64_t{sidecar.key.x})
      .bind(3, std::int64_t{sidecar.key.tms_row()})
      .bind(4, ByteView(sidecar.sha256.bytes))
      .bind(5, std::string_view(sidecar.source))
      .bind(6, std::string_view(captured_at))
      .bind(7, sidecar.gsd_mm)
      .bind(8, sidecar.ce90_mm)
      .bind(9, name_of(sidecar.trust))
      .bind(10, std::string_view(sidecar.sector))
      .bind(11, sidecar.valid_ppm);
  if (sidecar.mask.empty()) {
    insert_.bind_null(12);
  } else {
    insert_.bind(12, ByteView(sidecar.mask));
  }
  insert_.run();
}

void write_sidecar_file(const std::filesystem::path& path, const std::vector<Sidecar>& sidecars,
                        const std::map<std::string, std::string>& metadata) {
  SqliteDatabase database = SqliteDatabase::create(path);
  database.execute(kBeginSidecarFile);
  {
    auto insert = database.prepare("INSERT INTO metadata VALUES (?, ?)");
    for (const auto& [name, value] : metadata) {
      insert.bind(1, std::string_view(name)).bind(2, std::string_view(value)).run();
    }
    SidecarWriter table(database);
    for (const Sidecar& sidecar : sidecars) table.add(sidecar);
  }
  database.execute("COMMIT; PRAGMA journal_mode = DELETE;");
  database.close();
}

bool has_sidecars(const SqliteDatabase& database) { return database.has_table("nadir_sidecars"); }

std::optional<TileKey> row_key(const SqliteStatement& row) {
  const std::int64_t z = row.integer(0), x = row.integer(1), tms_row = row.integer(2);
  if (z < 0 || z > kMaxZoom) return std::nullopt;
  const std::int64_t across = std::int64_t{1} << z;
  if (x < 0 || x >= across || tms_row < 0 || tms_row >= across) return std::nullopt;
  return TileKey::from_tms(static_cast<std::uint8_t>(z), static_cast<std::uint32_t>(x),
                           static_cast<std::uint32_t>(tms_row));
}

std::string row_address_text(const SqliteStatement& row) {
  return fmt::format("zoom {}, column {}, row {}", row.integer(0), row.integer(1), row.integer(2));
}

SidecarRows read_sidecars(const SqliteDatabase& database) {
  SidecarRows result;
  const auto report = [&result](const char* code, std::string where, const char* expected) {
    if (result.findings.items().size() >= kNamedFiles) return;
    result.findings.add({.code = code,
                         .where = "nadir_sidecars, " + std::move(where),
                         .expected = expected,
                         .found = "an invalid row",
                         .fix = "build the package again"});
  };
  auto rows = database.prepare(kSelectSidecars);
  while (rows.step()) {
    const auto key = row_key(rows);
    if (!key) {
      report("tile.misaddressed", row_address_text(rows), "an address inside the grid");
    } else if (auto sidecar = sidecar_from(rows, *key); !sidecar) {
      report("sqlite.corrupt", "tile " + to_text(*key), "valid digest, times and numbers");
    } else if (!result.sidecars.empty() && !(result.sidecars.back().key < *key)) {
      report("tile.misaddressed", "tile " + to_text(*key), "one row per tile");
    } else {
      result.sidecars.push_back(std::move(*sidecar));
    }
  }
  return result;
}

}  // namespace nadir
