// The service's answers, read strictly: what does not say what the contract says is no answer, and the uploader asks
// again. Members that we do not know are passed over.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/digest.hpp"
#include "base/time.hpp"

namespace nadir {

struct RefusedReply {
  Sha256 sha256;
  std::string code;  // of the closed list
  std::string detail;
};

struct AnnouncementReply {
  std::string upload;  // the service's name for it
  std::vector<Sha256> missing;
  std::vector<Sha256> known;
  std::vector<RefusedReply> refused;
  std::uint64_t part_max = 0;  // bytes
  UtcTime expires_at;
};

struct VerdictReply {
  enum class Kind { accepted, rejected, duplicate, pending };
  Sha256 sha256;
  Kind kind = Kind::pending;
  std::string code{};  // when rejected
  std::string detail{};
};

struct StatusReply {
  std::string upload;
  std::string batch;
  bool complete = false;  // the service judges, or has judged
  std::vector<VerdictReply> tiles{};
};

// Throw Error for everything else than these documents.
AnnouncementReply parse_announcement(std::string_view body);
StatusReply parse_upload_status(std::string_view body);

// "title: detail" of a problem document, or a few words about what it is instead; safe to show.
std::string problem_text(std::string_view body);

}  // namespace nadir
