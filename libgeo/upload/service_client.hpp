// The calls of the contract (schemas/candidates.openapi.yaml), each once: what came of it is a value. Whoever calls
// decides about trying again.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "upload/http.hpp"
#include "upload/replies.hpp"

namespace nadir {

// Why a call did not do what it should.
struct Trouble {
  enum class Kind {
    later,        // not reached, overloaded, out of order: the same again after a while
    nonsense,     // an answer that the contract does not know: as later, but not for ever
    forgotten,    // no such upload (any more)
    credentials,  // the token is not accepted
    elsewhere,    // a redirect: not the service
    conflict,     // another offset, or tiles are missing
    mangled,      // the part's bytes did not arrive as they were sent
    too_large,
    refused  // anything else: the same again will not help
  };
  Kind kind = Kind::later;
  std::string text;                             // for people
  std::optional<std::int64_t> retry_after_s{};  // what the service asks for
  std::optional<std::uint64_t> offset{};        // of a conflict
};

std::string_view name_of(Trouble::Kind kind);

template <typename Value>
using Answer = std::variant<Value, Trouble>;

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

 private:
  HttpTransport& transport_;
};

}  // namespace nadir
