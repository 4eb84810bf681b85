#include "base/time.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

TEST(UtcMillis, HasOneSpelling) {
  EXPECT_EQ(to_rfc3339(UtcMillis{0}), "1970-01-01T00:00:00.000Z");
  EXPECT_EQ(to_rfc3339(UtcMillis{1'777'636'800'250}), "2026-05-01T12:00:00.250Z");  // date -u -d @1777636800
  EXPECT_EQ(to_rfc3339(UtcMillis{-1}), "1969-12-31T23:59:59.999Z");
  for (const std::int64_t ms : {std::int64_t{0}, std::int64_t{1}, std::int64_t{1'777'636'800'999}}) {
    EXPECT_EQ(parse_utc_millis(to_rfc3339(UtcMillis{ms})), UtcMillis{ms});
  }
}

TEST(UtcMillis, TakesNoOther) {
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
