#include "nadir_candidates/service_folder.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr UtcTime kStarted{1'795'000'000};

TEST(ServiceStart, SurvivesItsFile) {
  const test::TemporaryFolder folder;
  EXPECT_FALSE(read_service_start(folder.path()));
  write_service_start(
      folder.path(),
      {.started_at = kStarted, .votes = 3, .airframes_differ = false, .base_packages = 2, .tokens_without_expiry = 1});
  const auto start = read_service_start(folder.path());
  ASSERT_TRUE(start);
  EXPECT_EQ(start->started_at, kStarted);
  EXPECT_EQ(start->votes, 3);
  EXPECT_EQ(start->independent(), "days");
  EXPECT_EQ(start->base_packages, 2);
  EXPECT_EQ(start->tokens_without_expiry, 1);
}

TEST(ServiceStart, WarnsOfEachRiskAndOfNothingElse) {
  ServiceStart start{.started_at = kStarted, .votes = 2, .base_packages = 1};
  EXPECT_THAT(start.warnings(), IsEmpty());
  start.airframes_differ = false;
  EXPECT_THAT(start.warnings(), ::testing::ElementsAre(HasSubstr("--independent days")));
  start.base_packages = 0;
  start.tokens_without_expiry = 1;
  EXPECT_EQ(start.warnings().size(), 3U);
}

TEST(ServiceStart, OfAnotherFormIsAnErrorThatNamesTheFile) {
  const test::TemporaryFolder folder;
  const std::string good = service_start_json({.started_at = kStarted, .votes = 2});
  for (std::size_t size = 0; size + 1 < good.size(); size += 5) {
    folder.write("started.json", good.substr(0, size));
    try {
      read_service_start(folder.path());
      ADD_FAILURE() << size;
    } catch (const Error& error) {
      EXPECT_THAT(error.text().where, HasSubstr("started.json"));
    }
  }
  std::string never = good;
  never.replace(never.find("airframes"), 9, "nobody");
  EXPECT_THROW(parse_service_start(never, "test"), Error);
}

TEST(ServiceLock, IsHeldByOne) {
  const test::TemporaryFolder folder;
  std::optional<ServiceLock> first(folder / "data");
  EXPECT_THROW(ServiceLock(folder / "data"), Error);
  first.reset();
  EXPECT_NO_THROW(ServiceLock(folder / "data"));
}

}  // namespace
}  // namespace nadir
