#include "base/progress.hpp"

#include <gtest/gtest.h>

#include <stop_token>

namespace nadir {
namespace {

TEST(Cancel, ThrowsOnlyWhenRequested) {
  EXPECT_NO_THROW(Cancel().check());
  EXPECT_NO_THROW(Cancel(std::function<bool()>()).check());
  EXPECT_NO_THROW(Cancel([] { return false; }).check());
  EXPECT_THROW(Cancel([] { return true; }).check(), Interrupted);
}

TEST(Cancel, CopiesShareTheRequest) {
  std::stop_source source;
  const Cancel cancel([stop = source.get_token()] { return stop.stop_requested(); });
  const Cancel copy = cancel;
  EXPECT_NO_THROW(copy.check());
  source.request_stop();
  EXPECT_THROW(cancel.check(), Interrupted);
  EXPECT_THROW(copy.check(), Interrupted);
}

}  // namespace

}  // namespace nadir
