// The contract of schemas/candidates.openapi.yaml without HTTP: who calls, and what the service answers. Results are
// values.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "base/digest.hpp"
#include "candidates/catalogue_rows.hpp"

namespace nadir {

// Who calls, by its token.
struct UploadClient {
  std::string name;                    // whose uploads they are; several tokens may share one
  std::vector<std::string> airframes;  // that it may upload for; empty: all
  std::string token{};                 // its id, for the audit log

  bool may(std::string_view airframe) const {
    return airframes.empty() || std::find(airframes.begin(), airframes.end(), airframe) != airframes.end();
  }
};

// Why the service refuses a call.
struct Denial {
  enum class Kind {
    malformed,
    forbidden,
    not_found,
    key_reused,
    batch_invalid,
    pack_unknown,
    pack_invalid,
    pack_busy,
    offset_mismatch,
    digest_mismatch,
    too_large,
    too_many,
    incomplete,
    report_invalid,
    report_older,
    storage_full,
    unavailable
  };
  Kind kind = Kind::malformed;
  std::string detail;
  std::optional<std::uint64_t> offset{};  // with offset_mismatch and pack_busy: where the pack goes on
  std::vector<Sha256> missing{};          // with incomplete
};

inline Denial disk_full() {
  return {.kind = Denial::Kind::storage_full,
          .detail = "the service's disk is full; what was acknowledged is kept, and its operator must make room"};
}

template <typename Result>
using Answer = std::variant<Result, Denial>;

struct Announcement {
  bool opened = false;  // just now
  std::string upload;
  std::vector<Sha256> missing{}, known{};
  std::vector<std::pair<Sha256, Refusal>> refused{};
  std::int64_t expires_ms = 0;
};

struct PackOffset {
  std::uint64_t offset = 0;
  std::optional<std::uint64_t> length{};  // of a pack that is whole
};

struct Completion {
  std::string upload;
  std::int64_t pending = 0;
};

struct UploadStatus {
  UploadRow upload;
  std::vector<TileRow> tiles;
};

struct PartHeader {
  std::uint64_t offset = 0;
  std::optional<std::uint64_t> length{};
  Sha256 digest;  // of the part
};

}  // namespace nadir
