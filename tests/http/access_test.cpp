#include "http/access.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

TEST(Access, OnlyLoopbacksOwnNamesAreLoopback) {
  for (const char* near : {"localhost", "LOCALHOST:8750", "127.0.0.1", "127.0.0.1:1", "[::1]", "[::1]:8750"}) {
    EXPECT_TRUE(names_loopback(near)) << near;
  }
  for (const char* far :
       {"", "example.org", "localhost.example.org", "127.0.0.1.example.org:80", "::1", "[::1", "[::2]:1"}) {
    EXPECT_FALSE(names_loopback(far)) << far;
  }
}

TEST(Access, TheTokenIsWhatFollowsBearer) {
  const Sha256 token = sha256(as_bytes("0123456789abcdef"));
  EXPECT_EQ(bearer_digest("Bearer 0123456789abcdef"), token);
  EXPECT_EQ(bearer_digest("bEARER 0123456789abcdef"), token);
  for (const char* other : {"Bearer 0123456789abcdeF", "Bearer  0123456789abcdef", "Bearer 0123456789abcdef "}) {
    EXPECT_NE(bearer_digest(other), token) << other;
  }
  for (const char* none : {"", "Bearer", "Basic 0123456789abcdef", "0123456789abcdef"}) {
    EXPECT_EQ(bearer_digest(none), std::nullopt) << none;
  }
}

}  // namespace
}  // namespace nadir
