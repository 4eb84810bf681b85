#include "service/service_state.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "base/files.hpp"

namespace nadir {
namespace {

TEST(ServiceState, TextsFitIntoOneStatustext) {
  std::set<std::string_view> names;
  for (const ReasonText& reason : all_reasons()) {
    EXPECT_LE(reason.operator_text.size(), 50) << reason.name;
    EXPECT_FALSE(reason.explanation.empty()) << reason.name;
    EXPECT_TRUE(names.insert(reason.name).second) << reason.name;
    EXPECT_EQ(&text_of(reason.reason), &reason);
  }
}

// The page for operators and this code say the same.
TEST(ServiceState, ThePageListsEveryStateAndReason) {
  const std::string page = read_text_file(NADIR_SOURCE "/docs/onboard.md");
  for (int i = 0; i <= static_cast<int>(ServiceState::failsafe); ++i) {
    EXPECT_THAT(page, testing::HasSubstr("`" + std::string(name_of(static_cast<ServiceState>(i))) + "`"));
  }
  for (const ReasonText& reason : all_reasons()) {
    std::string row = "| `" + std::string(reason.name) + "` | " + std::string(reason.explanation) + " | ";
    if (!reason.operator_text.empty()) row += std::string(reason.operator_text) + " |";
    EXPECT_THAT(page, testing::HasSubstr(row));
  }
}

}  // namespace
}  // namespace nadir
