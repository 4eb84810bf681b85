#include "base/time.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

TEST(Time, ParsesRfc3339) {
  EXPECT_EQ(parse_utc("1970-01-01T00:00:00Z")->unix_s, 0);
  EXPECT_EQ(parse_utc("2024-10-30T12:34:56Z")->unix_s, 1730291696);
  EXPECT_EQ(parse_utc("2024-10-30T12:34:56.789Z")->unix_s, 1730291696);
  EXPECT_EQ(parse_utc("2024-10-30T14:34:56+02:00")->unix_s, 1730291696);
  EXPECT_EQ(parse_utc("2024-10-30")->unix_s, 1730246400);
  EXPECT_EQ(parse_utc("1969-12-31T23:59:59Z")->unix_s, -1);
}

TEST(Time, RejectsInvalidTimes) {
  for (const char* text : {"", "2024", "2024-02-30", "2024-13-01", "2023-02-29T00:00:00Z", "2024-10-30T24:00:00Z",
                           "2024-10-30T00:00:00", "2024-10-30T00:00Z", "2024-10-30T00:00:00Zx", "-024-10-30",
                           "2024-10-30T00:00:00.Z", "2024-10-30T00:00:00+2:00"}) {
    EXPECT_FALSE(parse_utc(text)) << text;
  }
}

TEST(Time, RoundTrips) {
  for (const std::int64_t unix_s : {0L, -1L, 1730291696L, 4102444799L, 951782400L}) {
    EXPECT_EQ(parse_utc(to_rfc3339(UtcTime{unix_s}))->unix_s, unix_s);
  }
  EXPECT_EQ(to_rfc3339(UtcTime{951782400}), "2000-02-29T00:00:00Z");
}

TEST(UtcMillis, RoundTripsInOneSpelling) {
  EXPECT_EQ(to_rfc3339(UtcMillis{0}), "1970-01-01T00:00:00.000Z");
  EXPECT_EQ(to_rfc3339(UtcMillis{1'777'636'800'250}), "2026-05-01T12:00:00.250Z");  // date -u -d @1777636800
  EXPECT_EQ(to_rfc3339(UtcMillis{-1}), "1969-12-31T23:59:59.999Z");
  for (const std::int64_t ms : {std::int64_t{0}, std::int64_t{1}, std::int64_t{1'777'636'800'999}}) {
    EXPECT_EQ(parse_utc_millis(to_rfc3339(UtcMillis{ms})), UtcMillis{ms});
  }
}

TEST(UtcMillis, RejectsOtherSpellings) {
  for (const char* text :
       {"", "2026-05-01", "2026-05-01T12:00:00Z", "2026-05-01T12:00:00.25Z", "2026-05-01T12:00:00.2500Z",
        "2026-05-01t12:00:00.250Z", "2026-05-01T12:00:00.250z", "2026-05-01T12:00:00,250Z", "2026-02-30T12:00:00.250Z",
        "2026-05-01T12:00:00.2x0Z", "2026-05-01T12:00:00.250+", "1969-12-31T23:59:59.999Z", " 026-05-01T12:00:00.250Z",
        "2026-05-01T24:00:00.000Z", "2026-05-01T12:00:60.000Z"}) {
    EXPECT_FALSE(parse_utc_millis(text)) << text;
  }
}

}  // namespace

}  // namespace nadir
