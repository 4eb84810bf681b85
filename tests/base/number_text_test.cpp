#include "base/number_text.hpp"

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

TEST(WholeNumber, MayBeHexadecimal) {
  EXPECT_EQ(whole_number<unsigned>("1f", 16), 31U);
  EXPECT_EQ(whole_number<unsigned>("FF", 16), 255U);
  for (const char* text : {"0x1f", "1g", "", "-1"}) EXPECT_FALSE(whole_number<unsigned>(text, 16)) << text;
}

TEST(FiniteNumber, IsAllOfTheTextAndFinite) {
  EXPECT_EQ(finite_number("-0.5"), -0.5);
  EXPECT_EQ(finite_number("1e3"), 1000);
  EXPECT_EQ(finite_number("7"), 7);
  EXPECT_EQ(finite_number<float>("0.1"), 0.1F);
  for (const char* text : {"", " 1", "1 ", "1,5", "+1", "nan", "inf", "-inf", "1e999", "0x10", "one", ".", "1.0m"}) {
    EXPECT_FALSE(finite_number(text)) << text;
  }
  EXPECT_FALSE(finite_number<float>("1e39"));
}

}  // namespace
}  // namespace nadir
