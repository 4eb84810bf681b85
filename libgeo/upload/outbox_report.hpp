// What is in an outbox, for people and programs.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "upload/outbox_database.hpp"

namespace nadir {

struct StateSum {
  std::int64_t tiles = 0;
  std::int64_t bytes = 0;  // of their pictures, deleted or not
};

struct BatchReport {
  std::string uuid;
  std::string airframe;
  std::string flight;
  std::string stage;
  std::int64_t tiles = 0;
  std::int64_t open = 0;  // without a final verdict
  int attempts = 0;       // in vain
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
  std::int64_t kept_bytes = 0;                  // of pictures that are still there
  std::vector<BatchReport> batches;             // those that are not done
};

// Throws Error when the outbox holds what no program of ours writes.
OutboxReport report_outbox(const OutboxDatabase& outbox);

// Rejected, refused and damaged tiles, in the order of staging, at most so many.
std::vector<FailedTile> failed_tiles(const OutboxDatabase& outbox, std::int64_t most);

}  // namespace nadir
