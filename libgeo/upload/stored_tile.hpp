// A tile as the outbox holds it, held against itself: what was staged has its digests beside it, so that a byte that a
// disk or somebody has changed shows before it is signed or sent. A damaged one is set aside (DAMAGED); the others go
// on.
#pragma once

#include <cstdint>
#include <string>

#include "base/error.hpp"
#include "upload/batch.hpp"
#include "upload/outbox_database.hpp"

namespace nadir {

struct StoredTile {
  std::int64_t id = 0;
  BatchTile tile;      // when it is sound
  std::string damage;  // what is wrong with it; empty: nothing
};

// Reads what each row of this selection holds; the caller adds WHERE and ORDER BY.
inline constexpr std::string_view kSelectStoredTiles =
    "SELECT tile.id, candidate, tile.sha256, size, airframe, flight, base_package, sidecar, keyid, signature, bytes"
    " FROM tile LEFT JOIN blob ON blob.tile = tile.id ";
StoredTile read_stored_tile(const SqliteStatement& row);

// Is this the picture with this digest?
bool is_picture(ByteView bytes, ByteView sha256);

// Within a transition: it goes no way until a sound copy is staged. Returns the finding `outbox.damaged` that tells of
// it.
Finding set_aside(const OutboxDatabase& outbox, const StoredTile& tile, std::int64_t now_ms);

}  // namespace nadir
