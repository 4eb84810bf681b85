#include "upload/reason_code.hpp"

#include <gtest/gtest.h>

#include <set>

#include "base/files.hpp"

namespace nadir {
namespace {

TEST(ReasonCode, NamesRoundTrip) {
  std::set<std::string_view> names;
  for (const ReasonCode code : all_reason_codes()) {
    EXPECT_TRUE(names.insert(name_of(code)).second);
    EXPECT_EQ(parse_reason_code(name_of(code)), code);
    EXPECT_FALSE(meaning_of(code).empty());
  }
  EXPECT_EQ(names.size(), 18U);
  for (const char* other : {"", "blurred ", "Blurred", "blurre", "none"}) {
    EXPECT_FALSE(parse_reason_code(other)) << other;
  }
}

// The contract lists the same codes: one text for both sides.
TEST(ReasonCode, MatchesTheListOfTheContract) {
  const std::string contract = read_text_file(std::filesystem::path(NADIR_SCHEMAS) / "candidates.openapi.yaml");
  const std::size_t from = contract.find("enum: [", contract.find("    ReasonCode:\n"));
  ASSERT_NE(from, std::string::npos);
  const std::string text = contract.substr(from + 7, contract.find(']', from) - from - 7);
  std::vector<std::string> listed;
  for (std::size_t at = 0; (at = text.find_first_not_of(", \n", at)) != std::string::npos;) {
    const std::size_t end = std::min(text.find_first_of(", \n", at), text.size());
    listed.push_back(text.substr(at, end - at));
    at = end;
  }
  std::vector<std::string> ours;
  for (const ReasonCode code : all_reason_codes()) ours.emplace_back(name_of(code));
  EXPECT_EQ(listed, ours);
}

}  // namespace
}  // namespace nadir
