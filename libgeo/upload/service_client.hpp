// The calls of the API (schemas/candidates.openapi.yaml), each sent once; the result is a value. Retrying is up to
// the caller.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "base/time.hpp"
#include "upload/transport.hpp"

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
  bool complete = false;  // the service evaluates the tiles, or has done so
  std::vector<VerdictReply> tiles{};
};

// Strict: throw Error for anything but these documents. Unknown members are ignored: a later version may send more.
AnnouncementReply parse_announcement(std::string_view body);
StatusReply parse_upload_status(std::string_view body);

// "title: detail" of a problem document, or a few words about what it is instead; safe to show.
std::string problem_text(std::string_view body);

// A date in an HTTP header (RFC 9110, section 5.6.7): "Sun, 06 Nov 1994 08:49:37 GMT", and the two old
// forms that a recipient must understand: "Sunday, 06-Nov-94 08:49:37 GMT" and "Sun Nov  6 08:49:37 1994".
// nullopt for anything else. Years of two digits lie in 1970 to 2069. The name of the day is not checked.
std::optional<UtcTime> parse_http_date(std::string_view text);

// Why a call failed.
struct TransferError {
  enum class Kind {
    later,        // not reached, overloaded, out of service: to be retried after a while
    invalid,      // an answer outside of the contract: as later, but a limited number of times
    forgotten,    // no such upload (any more)
    credentials,  // the token is not accepted
    elsewhere,    // a redirect: not the service
    conflict,     // another offset, or tiles are missing
    mangled,      // the part's bytes did not arrive as they were sent
    too_large,
    refused  // anything else: retrying will not help
  };
  Kind kind = Kind::later;
  std::string text;                             // for people
  std::optional<std::int64_t> retry_after_s{};  // what the service asks for
  std::optional<std::uint64_t> offset{};        // of a conflict
};

std::string_view name_of(TransferError::Kind kind);  // as the outbox counts failures

template <typename Value>
using Answer = std::variant<Value, TransferError>;

struct Accepted {
  std::optional<std::int64_t> retry_after_s;
};

struct StatusAnswer {
  StatusReply status;
  std::optional<std::int64_t> retry_after_s;
};

class ServiceClient {
 public:
  explicit ServiceClient(HttpTransport& transport) : transport_(transport) {}

  Answer<AnnouncementReply> announce(const std::string& batch_id, std::string_view document);
  Answer<std::uint64_t> offset(const std::string& upload, const Sha256& pack);  // 0 when no byte is there
  // The new offset.
  Answer<std::uint64_t> send_part(const std::string& upload, const Sha256& pack, std::uint64_t pack_size,
                                  std::uint64_t offset, ByteView part);
  Answer<Accepted> complete(const std::string& upload);
  Answer<StatusAnswer> status(const std::string& upload);
  // An aircraft's signed report. True: the service has it now, or had it. False: it knows a later one.
  Answer<bool> report_installed(std::string_view document);

 private:
  HttpTransport& transport_;
};

}  // namespace nadir
