// What a candidate service, or whoever stands in for it, answers to the uploader.
#include "base/printable.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "upload/service_client.hpp"

namespace nadir::fuzz {
namespace {

// A name that the service gives goes into paths.
void require_plain(const std::string& upload) {
  require(!upload.empty() && upload.find_first_of("/.%?# \r\n") == std::string::npos, "a name that is more than one");
}

}  // namespace

void reply(std::string_view bytes) {
  refusing([&] {
    const AnnouncementReply read = parse_announcement(bytes);
    require_plain(read.upload);
    require(read.part_max >= 4096, "parts of next to nothing");
    for (const RefusedReply& refused : read.refused) {
      require(printable(refused.detail) == refused.detail, "words that a terminal obeys");
    }
  });
  refusing([&] {
    const StatusReply read = parse_upload_status(bytes);
    require_plain(read.upload);
    for (const VerdictReply& tile : read.tiles) {
      require((tile.kind == VerdictReply::Kind::rejected) == !tile.code.empty(), "a reason without need, or none");
      require(printable(tile.detail) == tile.detail, "words that a terminal obeys");
    }
  });
  const std::string words = problem_text(bytes);
  require(!words.empty() && printable(words) == words, "no words, or such that a terminal obeys");
}

void http_date(std::string_view bytes) {
  const auto time = parse_http_date(bytes);
  require(!time || parse_utc(to_rfc3339(*time)) == *time, "a date that is none");
}

}  // namespace nadir::fuzz
