// What the candidate service answers, as values: the contract of schemas/candidates.openapi.yaml without HTTP.
#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "candidates/catalogue_rows.hpp"

namespace nadir {

// Who uploads, as its token says.
struct UploadClient {
  std::string name;
  std::vector<std::string> airframes;  // that it may upload for; empty: all

  bool may(std::string_view airframe) const;
};

// Why the service does not do what it is asked for.
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
    storage_full,
    unavailable
  };
  Kind kind = Kind::malformed;
  std::string detail;
  std::optional<std::uint64_t> offset{};  // with offset_mismatch and pack_busy: where the pack goes on
  std::vector<Sha256> missing{};          // with incomplete
};

// What keeps the service from its work; an empty reason: nothing. fails: it takes no uploads.
struct ServiceTrouble {
  std::string reason;
  bool fails = false;
};

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
