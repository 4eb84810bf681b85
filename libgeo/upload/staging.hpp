// Puts candidates into the outbox and into signed batches, and checks what the outbox holds.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "base/error.hpp"
#include "ortho/candidate_store.hpp"
#include "trust/installed_report.hpp"
#include "trust/keys.hpp"
#include "upload/batch.hpp"
#include "upload/outbox.hpp"

namespace nadir {

// Puts candidates in, all in one transaction; those that were staged before (the very same sidecar) are skipped,
// except for those that were set aside as damaged, which they replace. How many are new or repaired.
std::int64_t stage_candidates(OutboxDatabase& outbox, std::span<const Candidate> candidates, std::int64_t now_ms);

// Puts in what an aircraft reported to have installed, in the place of an earlier report of it. False: this report, or
// a later one, is there already.
bool stage_installed(OutboxDatabase& outbox, const SignedInstalledReport& report);

struct SealedSum {
  std::int64_t batches = 0;
  std::int64_t tiles = 0;
  Findings findings;  // `outbox.damaged` for each tile that was set aside
};

// Makes signed batches of all staged tiles: each of one flight of one airframe over one package, as many tiles as a
// batch holds. Tiles that are not as they were staged are set aside, and no batch waits for them.
SealedSum seal_batches(OutboxDatabase& outbox, const PrivateKey& key, std::int64_t now_ms,
                       const std::function<std::array<std::uint8_t, 16>()>& random_bytes);

// A tile as the outbox holds it, checked against its own digests: a byte that was changed on disk is found
// before it is signed or sent. A damaged tile is set aside (DAMAGED); the others proceed.
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

// Whether the bytes have this SHA-256.
bool matches_digest(ByteView bytes, ByteView sha256);

// Within a transition: the tile waits until a sound copy is staged. Returns the finding `outbox.damaged`.
Finding set_aside(const OutboxDatabase& outbox, const StoredTile& tile, std::int64_t now_ms);

}  // namespace nadir
