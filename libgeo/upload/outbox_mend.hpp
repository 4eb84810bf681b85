// Batches that cannot go on because something of them is damaged: the sound tiles of such a batch go into a new one.
#pragma once

#include <cstdint>

#include "base/error.hpp"
#include "upload/outbox_database.hpp"
#include "trust/keys.hpp"

namespace nadir {

struct MendedSum {
  std::int64_t batches = 0;  // taken apart
  std::int64_t tiles = 0;    // staged again, for seal_batches()
  Findings findings;         // `outbox.damaged` for each tile that was set aside
};

// Of the parked batches those whose document or tiles are not as they were sealed. Tiles that have their verdict keep
// it. The key tells whether a document is still the one that it has signed.
MendedSum take_damaged_apart(OutboxDatabase& outbox, const PublicKey& key, std::int64_t now_ms);

}  // namespace nadir
