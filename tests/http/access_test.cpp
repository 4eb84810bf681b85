#include "http/access.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "http/message.hpp"

namespace nadir {
namespace {

TEST(Listen, ParsesAddresses) {
  EXPECT_EQ(parse_listen_address("127.0.0.1:8750").ip, "127.0.0.1");
  EXPECT_EQ(parse_listen_address("[::1]:80").ip, "::1");
  EXPECT_EQ(parse_listen_address("0.0.0.0:65535").port, 65535);
  for (const char* bad :
       {"", ":", "8750", "localhost:8750", "127.0.0.1", "127.0.0.1:", "127.0.0.1:65536", "127.0.0.1:-1",
        "127.0.0.1:80x", "::1:80", "[::1]", "[127.0.0.1]:80", "1.2.3:80", "127.0.0.1:80\n"}) {
    EXPECT_THROW(parse_listen_address(bad), UsageError) << bad;
  }
}

TEST(Listen, RequiresATokenBeyondLoopback) {
  const Sha256 token;
  for (const char* near : {"127.0.0.1:1", "127.9.9.9:1", "[::1]:1"}) {
    EXPECT_NO_THROW(require_token_beyond_loopback(parse_listen_address(near), std::nullopt)) << near;
  }
  for (const char* far : {"0.0.0.0:1", "10.0.0.1:1", "[::]:1", "[::ffff:127.0.0.1]:1"}) {
    EXPECT_THROW(require_token_beyond_loopback(parse_listen_address(far), std::nullopt), UsageError) << far;
    EXPECT_NO_THROW(require_token_beyond_loopback(parse_listen_address(far), token)) << far;
  }
}

TEST(Access, RecognizesOnlyLoopbackNames) {
  for (const char* near : {"localhost", "LOCALHOST:8750", "127.0.0.1", "127.0.0.1:1", "[::1]", "[::1]:8750"}) {
    EXPECT_TRUE(names_loopback(near)) << near;
  }
  for (const char* far :
       {"", "example.org", "localhost.example.org", "127.0.0.1.example.org:80", "::1", "[::1", "[::2]:1"}) {
    EXPECT_FALSE(names_loopback(far)) << far;
  }
}

TEST(Access, ReadsTheTokenAfterBearer) {
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

// What begins like loopback's name is another name.
TEST(Access, ReadsTheWholeHost) {
  for (const char* far : {"[::1]evil.com", "[::1].evil.com:80", "[::1]:80.evil.com", "[::1]:", "[::1]:65536",
                          "[::1]:-1", "localhost:evil.com", "localhost:80evil", "localhost:", "127.0.0.1:80:80",
                          "127.0.0.1 ", "localhost\r", "localhost@evil.com", "127.0.0.1/"}) {
    EXPECT_FALSE(names_loopback(far)) << far;
  }
}

// The detail quotes the request, and goes into logs and terminals.
TEST(HttpErrors, StayOnOneLine) {
  const ApiResponse response = answer({.status = 422,
                                       .type = "invalid",
                                       .detail = "x\nHTTP 200",
                                       .errors = {{"/a\nb",
                                                   "c\xE2\x80\xA9"
                                                   "d"}}});
  EXPECT_NE(response.body.find("x⏎HTTP 200"), std::string::npos) << response.body;
  EXPECT_NE(response.body.find("/a⏎b"), std::string::npos) << response.body;
  EXPECT_NE(response.body.find("c⏎d"), std::string::npos) << response.body;
}

}  // namespace
}  // namespace nadir
