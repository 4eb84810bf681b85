#include "upload/service_client.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>
#include <string>

#include "base/error.hpp"
#include "upload/transport.hpp"

namespace nadir {
namespace {

using nlohmann::json;

const std::string kA(64, 'a'), kB(64, 'b'), kC(64, 'c');

json announcement() {
  return {{"upload_id", "upload-01"},
          {"missing", {kA}},
          {"known", {kB}},
          {"refused", {{{"sha256", kC}, {"code", "too_old"}, {"detail", "90 days"}}}},
          {"part_max", 65'536},
          {"expires_at", "2030-01-01T00:00:00Z"},
          {"of_a_later_version", 1.5}};
}

json status() {
  return {
      {"upload_id", "upload-01"},
      {"batch", "0f8b4a52-6c1e-4d0b-9a7e-3b5c2d1e0f9a"},
      {"state", "judging"},
      {"tiles",
       {{{"sha256", kA}, {"verdict", "accepted"}, {"code", nullptr}, {"detail", ""}, {"retryable", false}},
        {{"sha256", kB}, {"verdict", "rejected"}, {"code", "blurred"}, {"detail", "\x1b[31m"}, {"retryable", false}},
        {{"sha256", kC}, {"verdict", "pending"}, {"code", nullptr}, {"detail", ""}, {"retryable", false}}}}};
}

TEST(Replies, AreParsed) {
  const AnnouncementReply read = parse_announcement(announcement().dump());
  EXPECT_EQ(read.upload, "upload-01");
  EXPECT_EQ(read.missing.at(0).hex(), kA);
  EXPECT_EQ(read.known.at(0).hex(), kB);
  EXPECT_EQ(read.refused.at(0).code, "too_old");
  EXPECT_EQ(read.part_max, 65'536U);
  const StatusReply judged = parse_upload_status(status().dump());
  EXPECT_TRUE(judged.complete);
  ASSERT_EQ(judged.tiles.size(), 3U);
  EXPECT_EQ(judged.tiles[1].code, "blurred");
  EXPECT_EQ(judged.tiles[1].detail, "?[31m") << "nothing reaches a terminal";
  EXPECT_EQ(judged.tiles[2].kind, VerdictReply::Kind::pending);
}

TEST(Replies, RejectInvalidForms) {
  const std::vector<std::function<void(json&)>> damages{
      [](json& d) { d["upload_id"] = "../../admin"; },
      [](json& d) { d["upload_id"] = "short"; },
      [](json& d) { d.erase("upload_id"); },
      [](json& d) { d["missing"] = "all"; },
      [](json& d) { d["missing"] = {7}; },
      [](json& d) { d["missing"] = {std::string(64, 'A')}; },
      [](json& d) { d["missing"] = std::vector<std::string>(2001, kA); },
      [](json& d) { d["refused"][0]["code"] = "because"; },
      [](json& d) { d["refused"][0].erase("detail"); },
      [](json& d) { d["part_max"] = 0; },
      [](json& d) { d["part_max"] = -1; },
      [](json& d) { d["part_max"] = 1e300; },
      [](json& d) { d["part_max"] = 9'000'000; },
      [](json& d) { d["expires_at"] = "soon"; },
      [](json& d) { d = json::array(); },
      [](json& d) { d = nullptr; }};
  for (std::size_t i = 0; i < damages.size(); ++i) {
    json document = announcement();
    damages[i](document);
    EXPECT_THROW(parse_announcement(document.dump()), Error) << i;
  }
  for (const char* member : {"upload_id", "batch", "state", "tiles"}) {
    json document = status();
    document.erase(member);
    EXPECT_THROW(parse_upload_status(document.dump()), Error) << member;
  }
  json unknown = status();
  unknown["tiles"][0]["verdict"] = "perhaps";
  EXPECT_THROW(parse_upload_status(unknown.dump()), Error);
  unknown = status();
  unknown["tiles"][1]["code"] = nullptr;
  EXPECT_THROW(parse_upload_status(unknown.dump()), Error) << "rejected for no reason";
}

TEST(Replies, RejectTruncationAndNoise) {
  const std::string good = announcement().dump();
  for (std::size_t size = 0; size < good.size(); ++size) {
    EXPECT_THROW(parse_announcement(good.substr(0, size)), Error) << size;
  }
  EXPECT_THROW(parse_announcement("<html></html>"), Error);
  EXPECT_THROW(parse_announcement("\xff\xfe"), Error);
  EXPECT_THROW(parse_announcement(std::string(100'000, '[')), Error);
}

TEST(Replies, ProblemsAreReportedWithoutEscapeSequences) {
  EXPECT_EQ(problem_text(R"({"title":"Conflict","detail":"byte 7","status":409,"type":"x"})"), "Conflict: byte 7");
  EXPECT_EQ(problem_text(R"({"title":"A\u001b[2J","detail":"b"})"), "A?[2J: b");
  EXPECT_EQ(problem_text(""), "without a body");
  EXPECT_EQ(problem_text("<html>"), "with a body that is not a problem document");
}

constexpr std::int64_t kExample_s = 784'111'777;  // date -u -d "1994-11-06 08:49:37" +%s

// The examples of RFC 9110.
TEST(HttpDate, ParsesTheThreeFormats) {
  for (const char* text :
       {"Sun, 06 Nov 1994 08:49:37 GMT", "Sunday, 06-Nov-94 08:49:37 GMT", "Sun Nov  6 08:49:37 1994"}) {
    const auto time = parse_http_date(text);
    ASSERT_TRUE(time) << text;
    EXPECT_EQ(time->unix_s, kExample_s) << text;
  }
  EXPECT_EQ(parse_http_date("Tue Nov 16 08:49:37 2027")->unix_s, 1'826'354'977);
  EXPECT_EQ(parse_http_date("Tuesday, 16-Nov-27 08:49:37 GMT")->unix_s, 1'826'354'977);
  // Two digits are a year of 1970 to 2069.
  EXPECT_EQ(parse_http_date("Thursday, 01-Jan-70 00:00:00 GMT")->unix_s, 0);
  EXPECT_EQ(parse_http_date("Tuesday, 31-Dec-69 23:59:59 GMT")->unix_s, 3'155'759'999);
}

TEST(HttpDate, RejectsOtherFormats) {
  const std::string good = "Sun, 06 Nov 1994 08:49:37 GMT";
  for (std::size_t length = 0; length < good.size(); ++length) EXPECT_FALSE(parse_http_date(good.substr(0, length)));
  for (const std::string good_too : {"Sunday, 06-Nov-94 08:49:37 GMT", "Sun Nov  6 08:49:37 1994"}) {
    for (std::size_t length = 0; length < good_too.size(); ++length) {
      EXPECT_FALSE(parse_http_date(good_too.substr(0, length)));
    }
  }
  // Each form with the pieces of another.
  for (const char* text : {"Sunday, 06 Nov 1994 08:49:37 GMT", "Sun, 06-Nov-94 08:49:37 GMT", "Sun Nov  6 08:49:37 94",
                           "Sun Nov  6 08:49:37 1994 GMT", "Sunday Nov  6 08:49:37 1994", "Sun Nov   6 08:49:37 1994",
                           "Sun, 06 Nov 1994 8:49:37 GMT", "%a, %d %b %Y %T GMT"}) {
    EXPECT_FALSE(parse_http_date(text)) << text;
  }
  for (const char* text :
       {"Sun, 06 Nov 1994 08:49:37 UTC", "sun, 06 nov 1994 08:49:37 gmt", "Sun, 6 Nov 1994 08:49:37 GMT",
        "Sun, 06 Nov 1994 08:49:37 GMT ", " Sun, 06 Nov 1994 08:49:37 GMT", "Sun, 31 Feb 1994 08:49:37 GMT",
        "Sun, 06 Nov 1994 25:49:37 GMT", "Sun, 06 Nov -994 08:49:37 GMT", "Sun, 06 Foo 1994 08:49:37 GMT",
        "1994-11-06T08:49:37Z", "120", "Sun Nov 6 08:49:37 1994", "Sunday, 06-Nov-1994 08:49:37 GMT"}) {
    EXPECT_FALSE(parse_http_date(text)) << text;
  }
}

TEST(ServiceAddress, IsHttpsOrLocalhost) {
  EXPECT_EQ(checked_service_address("https://tiles.example.org"), "https://tiles.example.org");
  EXPECT_EQ(checked_service_address("https://tiles.example.org:8443/nadir//"), "https://tiles.example.org:8443/nadir");
  EXPECT_EQ(checked_service_address("http://localhost:8760/"), "http://localhost:8760");
  EXPECT_NO_THROW(checked_service_address("http://127.0.0.1:8760"));
  EXPECT_NO_THROW(checked_service_address("http://[::1]:8760"));
}

TEST(ServiceAddress, RejectsOtherAddresses) {
  for (const char* text : {"", "/", "tiles.example.org", "http://tiles.example.org", "http://localhost.example.org",
                           "http://127.0.0.1.example.org", "ftp://localhost", "file:///etc/passwd", "https://",
                           "https://me:secret@example.org", "https://example.org/?a=b", "https://example.org/#a",
                           "http://localhost@example.org", "https://exa mple.org", "https://example.org:99999"}) {
    EXPECT_THROW(checked_service_address(text), UsageError) << text;
  }
}

}  // namespace
}  // namespace nadir
