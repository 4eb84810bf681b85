#include "trust/bearer_token.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

TEST(BearerToken, IsOneLongLineReadableByItsOwnerOnly) {
  const test::TemporaryFolder folder;
  const auto file = [&](const std::string& text, fs::perms perms) {
    const fs::path path = folder.write("token", text);
    fs::permissions(path, perms);
    return path;
  };
  const fs::perms own = fs::perms::owner_read | fs::perms::owner_write;
  EXPECT_EQ(read_bearer_token(file("0123456789abcdef\n", own)), "0123456789abcdef");
  EXPECT_EQ(read_bearer_token(file("0123456789abcdef", own)), "0123456789abcdef");
  EXPECT_THROW(read_bearer_token(file("0123456789abcdef\n", own | fs::perms::group_read)), Error);
  for (const char* bad : {"", "short", "0123456789 abcdef", "0123456789abcdef\nmore", "0123456789abcde\x7f"}) {
    EXPECT_THROW(read_bearer_token(file(bad, own)), Error) << bad;
  }
  EXPECT_THROW(read_bearer_token(folder / "none"), Error);
}

}  // namespace
}  // namespace nadir
