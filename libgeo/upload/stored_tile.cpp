#include "upload/stored_tile.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

constexpr std::size_t kSignatureSize = 64;

bool is_digest(ByteView bytes, const Sha256& digest) { return std::ranges::equal(bytes, digest.bytes); }

// Throws Error where the row is not what was staged; says what is wrong with the picture.
std::string read_row(const SqliteStatement& row, BatchTile& tile) {
  tile.sidecar_bytes = std::string(row.text(7));
  if (!is_digest(row.blob(1), sha256(as_bytes(tile.sidecar_bytes))))
    return "its sidecar is not the one that was staged";
  tile.sidecar = parse_candidate(tile.sidecar_bytes, "its sidecar");
  const CandidateSidecar& sidecar = tile.sidecar;
  const bool same = is_digest(row.blob(2), sidecar.sha256) &&
                    row.integer(3) == static_cast<std::int64_t>(sidecar.size) && row.text(4) == sidecar.airframe &&
                    row.text(5) == sidecar.flight && is_digest(row.blob(6), sidecar.base_package);
  if (!same) return "its row says something else than its sidecar";
  const ByteView signature = row.blob(9);
  tile.signature = {std::string(row.text(8)), Bytes(signature.begin(), signature.end())};
  if (!Sha256::from_hex(tile.signature.keyid) || signature.size() != kSignatureSize) return "its signature has no form";
  if (row.is_null(10)) return "its picture is gone";
  if (!is_picture(row.blob(10), row.blob(2))) return "its picture is not the one that was staged";
  return {};
}

}  // namespace

StoredTile read_stored_tile(const SqliteStatement& row) {
  StoredTile stored{.id = row.integer(0), .tile = {}, .damage = {}};
  try {
    stored.damage = read_row(row, stored.tile);
  } catch (const Error& error) {
    stored.damage = error.what();
  }
  return stored;
}

bool is_picture(ByteView bytes, ByteView digest) { return is_digest(digest, sha256(bytes)); }

Finding set_aside(const OutboxDatabase& outbox, const StoredTile& tile, std::int64_t now_ms) {
  auto update = outbox.prepare(
      "UPDATE tile SET state = ?, code = 'damaged', detail = ?, batch = NULL, pack = NULL, changed_ms = ? WHERE id = ?"
      " RETURNING lower(hex(candidate)), flight");
  update.bind(1, name_of(TileState::damaged)).bind(2, tile.damage).bind(3, now_ms).bind(4, tile.id).step();
  return {.code = "outbox.damaged",
          .where = printable(fmt::format("candidate {:.64} of flight {:.64}", update.text(0), update.text(1))),
          .expected = "a tile as it was staged",
          .found = tile.damage,
          .fix = "check the disk; stage the flight again: a sound copy takes this one's place"};
}

}  // namespace nadir
