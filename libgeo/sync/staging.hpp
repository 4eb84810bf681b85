// Into the outbox, and into signed batches.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>

#include "ortho/candidate_store.hpp"
#include "sync/outbox_database.hpp"
#include "trust/keys.hpp"

namespace nadir {

// Puts candidates in, all in one transaction; those that were staged before (the very same sidecar) are passed over.
// How many are new.
std::int64_t stage_candidates(OutboxDatabase& outbox, std::span<const Candidate> candidates, std::int64_t now_ms);

// Is this very candidate in the outbox?
bool is_staged(const OutboxDatabase& outbox, const std::string& sidecar_bytes);

struct SealedSum {
  std::int64_t batches = 0;
  std::int64_t tiles = 0;
};

// Makes signed batches of all staged tiles: each of one flight of one airframe over one package, as many tiles as a
// batch holds.
SealedSum seal_batches(OutboxDatabase& outbox, const PrivateKey& key, std::int64_t now_ms,
                       const std::function<std::array<std::uint8_t, 16>()>& random_bytes);

}  // namespace nadir
