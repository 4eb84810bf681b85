// Into the outbox, and into signed batches.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>

#include "base/error.hpp"
#include "ortho/candidate_store.hpp"
#include "upload/outbox_database.hpp"
#include "trust/keys.hpp"

namespace nadir {

// Puts candidates in, all in one transaction; those that were staged before (the very same sidecar) are passed over,
// but for those that were set aside as damaged: these take their place. How many are new or mended.
std::int64_t stage_candidates(OutboxDatabase& outbox, std::span<const Candidate> candidates, std::int64_t now_ms);

struct SealedSum {
  std::int64_t batches = 0;
  std::int64_t tiles = 0;
  Findings findings;  // `outbox.damaged` for each tile that was set aside
};

// Makes signed batches of all staged tiles: each of one flight of one airframe over one package, as many tiles as a
// batch holds. Tiles that are not as they were staged are set aside, and no batch waits for them.
SealedSum seal_batches(OutboxDatabase& outbox, const PrivateKey& key, std::int64_t now_ms,
                       const std::function<std::array<std::uint8_t, 16>()>& random_bytes);

}  // namespace nadir
