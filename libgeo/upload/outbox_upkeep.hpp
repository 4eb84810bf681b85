// What the operator does to an outbox: trying again, and giving room back.
#pragma once

#include <cstdint>
#include <string_view>

#include "upload/outbox_database.hpp"

namespace nadir {

// Parked batches are announced again, and batches that wait may be tried at once. How many batches.
std::int64_t retry_parked(OutboxDatabase& outbox, std::int64_t now_ms);

// Tiles that were rejected or refused for this reason, and whose bytes are still there, are staged again: they need a
// new batch. How many. Those of a batch that still waits for something stay in it until it is done: the service will
// speak of them again.
std::int64_t restage(OutboxDatabase& outbox, std::string_view code, std::int64_t now_ms);

struct PruneSum {
  std::int64_t tiles = 0;
  std::int64_t bytes = 0;
};

// Deletes the bytes of tiles that have had their final verdict since before this time. The tiles themselves are
// remembered, so that they are not staged again. `only_count`: says what would go.
PruneSum prune_blobs(OutboxDatabase& outbox, std::int64_t before_ms, bool only_count);

}  // namespace nadir
