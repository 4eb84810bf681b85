// The encodings of parameters, with Python's struct as the judge of what a union of bytes is.
#include "mavlink/parameters.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>

namespace nadir {
namespace {

constexpr std::uint8_t kInt8 = 2, kUint32 = 5, kInt32 = 6, kReal32 = 9;

double back(double value, std::uint8_t type, ParameterEncoding encoding) {
  return value_of({.wire_value = wire_value(value, type, encoding), .type = type}, encoding);
}

TEST(ParameterEncodings, ArduPilotConverts) {
  EXPECT_EQ(wire_value(3, kInt32, ParameterEncoding::cast), 3.0F);
  EXPECT_EQ(back(-7, kInt8, ParameterEncoding::cast), -7);
  EXPECT_EQ(parameter_encoding(AutopilotType::ardupilot), ParameterEncoding::cast);
}

TEST(ParameterEncodings, Px4CopiesBytes) {
  // struct.unpack("<f", struct.pack("<i", 1))
  EXPECT_EQ(wire_value(1, kInt32, ParameterEncoding::bytewise), 1.401298464324817e-45F);
  EXPECT_EQ(std::bit_cast<std::uint32_t>(wire_value(-1, kInt32, ParameterEncoding::bytewise)), 0xFFFFFFFFU);
  EXPECT_EQ(wire_value(2.5, kReal32, ParameterEncoding::bytewise), 2.5F);
  EXPECT_EQ(parameter_encoding(AutopilotType::px4), ParameterEncoding::bytewise);
  for (const double value : {0.0, 1.0, 7.0, -1.0, 2147483647.0, -2147483648.0}) {
    EXPECT_EQ(back(value, kInt32, ParameterEncoding::bytewise), value);
  }
  EXPECT_EQ(back(-3, kInt8, ParameterEncoding::bytewise), -3);
  EXPECT_EQ(back(4294967295.0, kUint32, ParameterEncoding::bytewise), 4294967295.0);
}

TEST(ParameterEncodings, IntegersAreRoundedAndClamped) {
  EXPECT_EQ(back(6.6, kInt32, ParameterEncoding::bytewise), 7);
  EXPECT_EQ(back(1e12, kInt32, ParameterEncoding::bytewise), 2147483647.0);
  EXPECT_EQ(back(-1000, kInt8, ParameterEncoding::bytewise), -128);
  EXPECT_EQ(back(std::numeric_limits<double>::quiet_NaN(), kInt32, ParameterEncoding::bytewise), 0);
}

}  // namespace
}  // namespace nadir
