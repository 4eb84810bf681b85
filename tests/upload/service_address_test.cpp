#include <gtest/gtest.h>

#include "base/error.hpp"
#include "upload/transport.hpp"

namespace nadir {
namespace {

TEST(ServiceAddress, IsSecureOrHere) {
  EXPECT_EQ(checked_service_address("https://tiles.example.org"), "https://tiles.example.org");
  EXPECT_EQ(checked_service_address("https://tiles.example.org:8443/nadir//"), "https://tiles.example.org:8443/nadir");
  EXPECT_EQ(checked_service_address("http://localhost:8760/"), "http://localhost:8760");
  EXPECT_NO_THROW(checked_service_address("http://127.0.0.1:8760"));
  EXPECT_NO_THROW(checked_service_address("http://[::1]:8760"));
}

TEST(ServiceAddress, RefusesTheRest) {
  for (const char* text : {"", "/", "tiles.example.org", "http://tiles.example.org", "http://localhost.example.org",
                           "http://127.0.0.1.example.org", "ftp://localhost", "file:///etc/passwd", "https://",
                           "https://me:secret@example.org", "https://example.org/?a=b", "https://example.org/#a",
                           "http://localhost@example.org", "https://exa mple.org", "https://example.org:99999"}) {
    EXPECT_THROW(checked_service_address(text), UsageError) << text;
  }
}

}  // namespace
}  // namespace nadir
