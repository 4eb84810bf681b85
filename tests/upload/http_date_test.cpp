#include "upload/service_client.hpp"

#include <gtest/gtest.h>

#include <string>

namespace nadir {
namespace {

constexpr std::int64_t kExample_s = 784'111'777;  // date -u -d "1994-11-06 08:49:37" +%s

// The examples of RFC 9110.
TEST(HttpDate, ReadsItsThreeForms) {
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

TEST(HttpDate, ReadsNothingElse) {
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

}  // namespace
}  // namespace nadir
