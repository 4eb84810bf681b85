#include "base/whole_number.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>

namespace nadir {
namespace {

TEST(WholeNumber, IsAllOfTheText) {
  EXPECT_EQ(whole_number<int>("0"), 0);
  EXPECT_EQ(whole_number<int>("-17"), -17);
  EXPECT_EQ(whole_number<int>("007"), 7);
  for (const char* text : {"", " 1", "1 ", "1.0", "1e3", "+1", "0x10", "one", "-"}) {
    EXPECT_FALSE(whole_number<int>(text)) << text;
  }
}

TEST(WholeNumber, Fits) {
  EXPECT_EQ(whole_number<std::uint64_t>("18446744073709551615"), std::numeric_limits<std::uint64_t>::max());
  EXPECT_FALSE(whole_number<std::uint64_t>("18446744073709551616"));
  EXPECT_FALSE(whole_number<std::uint64_t>("-1"));
  EXPECT_EQ(whole_number<std::int64_t>("-9223372036854775808"), std::numeric_limits<std::int64_t>::min());
  EXPECT_FALSE(whole_number<std::int64_t>("9223372036854775808"));
  EXPECT_FALSE(whole_number<int>("2147483648"));
}

}  // namespace
}  // namespace nadir
