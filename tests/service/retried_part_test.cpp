#include "service/retried_part.hpp"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

namespace nadir {
namespace {

TEST(RetriedPart, ReportsAFailureOnceAndItsRecoveryOnce) {
  RetriedPart part("API");
  const auto fail = [] { throw std::runtime_error("the port is taken"); };
  EXPECT_FALSE(part.attempt(0, [] {})) << "as it should be";
  const auto failed = part.attempt(1, fail);
  ASSERT_TRUE(failed);
  EXPECT_EQ(failed->part, "API");
  EXPECT_EQ(failed->failure, "the port is taken");
  EXPECT_FALSE(part.attempt(100, fail)) << "reported already";
  const auto back = part.attempt(200, [] {});
  ASSERT_TRUE(back);
  EXPECT_EQ(back->failure, "");
  EXPECT_DOUBLE_EQ(back->off_s, 199);
  EXPECT_FALSE(part.attempt(201, [] {}));
  EXPECT_TRUE(part.attempt(202, fail)) << "a new failure is news again";
}

TEST(RetriedPart, WaitsTwiceAsLongEachTimeAndNeverLongerThanHalfAMinute) {
  RetriedPart part("recorder");
  std::vector<double> tried_s;
  for (double now_s = 0; now_s < 200; now_s += 0.5) {
    part.attempt(now_s, [&] {
      tried_s.push_back(now_s);
      throw std::runtime_error("full");
    });
  }
  EXPECT_EQ(tried_s, (std::vector<double>{0, 1, 3, 7, 15, 31, 61, 91, 121, 151, 181}));
  part.attempt(211, [] {});
  EXPECT_TRUE(part.works());
  part.note(212, "full");
  EXPECT_TRUE(part.due(213)) << "after a recovery the pause begins anew";
}

TEST(RetriedPart, AnExceptionWithoutATextIsAFailureToo) {
  RetriedPart part("API");
  const auto failed = part.attempt(0, [] { throw std::runtime_error(""); });
  ASSERT_TRUE(failed);
  EXPECT_EQ(failed->failure, "no reason given");
}

}  // namespace
}  // namespace nadir
