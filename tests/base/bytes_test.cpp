#include "base/bytes.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

// The vectors of RFC 4648, section 10.
TEST(Base64, MatchesTheVectorsOfTheRfc) {
  const std::pair<const char*, const char*> vectors[] = {{"", ""},
                                                         {"f", "Zg=="},
                                                         {"fo", "Zm8="},
                                                         {"foo", "Zm9v"},
                                                         {"foob", "Zm9vYg=="},
                                                         {"fooba", "Zm9vYmE="},
                                                         {"foobar", "Zm9vYmFy"}};
  for (const auto& [plain, encoded] : vectors) {
    EXPECT_EQ(to_base64(as_bytes(plain)), encoded);
    ASSERT_TRUE(from_base64(encoded)) << encoded;
    EXPECT_EQ(as_text(*from_base64(encoded)), plain);
  }
}

TEST(Base64, AcceptsOneSpellingOnly) {
  for (const char* text :
       {"Zg", "Zg=", "Zh==", "Zm9=", " Zg==", "Zg==\n", "Zg==Zg==", "Z===", "====", "Zm8-", "Zm9v="}) {
    EXPECT_FALSE(from_base64(text)) << text;
  }
}

}  // namespace

}  // namespace nadir
