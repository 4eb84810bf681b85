// What the operator does with an outbox: report, retry, prune, repair.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "trust/keys.hpp"
#include "upload/outbox.hpp"

namespace nadir {

// Parked batches are announced again, and batches that wait may be tried at once. How many batches.
std::int64_t retry_parked(OutboxDatabase& outbox, std::int64_t now_ms);

// Tiles that were rejected or refused for this reason, and whose bytes are still there, are staged again: they need a
// new batch. How many. Those of a batch that still waits for something stay in it until it is done: the service will
// answer about them again.
std::int64_t restage(OutboxDatabase& outbox, std::string_view code, std::int64_t now_ms);

struct PruneSum {
  std::int64_t tiles = 0;
  std::int64_t bytes = 0;
};

// Deletes the bytes of tiles that have had their final verdict since before this time. The tiles themselves are
// remembered, so that they are not staged again. only_count: reports what would go.
PruneSum prune_blobs(OutboxDatabase& outbox, std::int64_t before_ms, bool only_count);

struct StateSum {
  std::int64_t tiles = 0;
  std::int64_t bytes = 0;  // of their images, deleted or not
};

struct BatchReport {
  std::string uuid;
  std::string airframe;
  std::string flight;
  std::string stage;
  std::int64_t tiles = 0;
  std::int64_t open = 0;  // without a final verdict
  int attempts = 0;       // failed
  std::int64_t not_before_ms = 0;
  std::string trouble;
};

struct FailedTile {
  std::string sha256;
  std::string flight;
  std::string state;
  std::string code;
  std::string detail;
};

struct OutboxReport {
  std::map<TileState, StateSum> states;
  std::map<std::string, std::int64_t> reasons;  // code → tiles rejected, refused or damaged
  std::int64_t kept_bytes = 0;                  // of images that are still there
  std::vector<BatchReport> batches;             // those that are not done
};

// Throws Error when the outbox holds what no program of ours writes.
OutboxReport report_outbox(const OutboxDatabase& outbox);

// Rejected, refused and damaged tiles, in the order of staging, at most so many.
std::vector<FailedTile> failed_tiles(const OutboxDatabase& outbox, std::int64_t most);

struct RepairSum {
  std::int64_t batches = 0;  // taken apart
  std::int64_t tiles = 0;    // staged again, for seal_batches()
  Findings findings;         // `outbox.damaged` for each tile that was set aside
};

// Takes apart the parked batches whose document or tiles are not as they were sealed: their sound tiles are staged
// again. Tiles that have their verdict keep it. The key verifies the signature of each document.
RepairSum repair_damaged_batches(OutboxDatabase& outbox, const PublicKey& key, std::int64_t now_ms);

}  // namespace nadir
