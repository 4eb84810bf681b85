// The same flight gives the same bits, however many threads OpenCV may use.
#include <gtest/gtest.h>

#include <bit>
#include <opencv2/core/utility.hpp>

#include "estimation/localizer_fixture.hpp"

namespace nadir {
namespace {

using namespace test;

class Threads {
 public:
  explicit Threads(int count) : before_(cv::getNumThreads()) { cv::setNumThreads(count); }
  ~Threads() { cv::setNumThreads(before_); }
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;

 private:
  int before_;
};

// Every number that is published, as its bits.
std::vector<std::uint64_t> bits_of(const std::vector<Estimate>& estimates) {
  std::vector<std::uint64_t> bits;
  const auto put = [&](double value) { bits.push_back(std::bit_cast<std::uint64_t>(value)); };
  for (const Estimate& e : estimates) {
    put(e.position ? e.position->lon_deg : 999);
    put(e.position ? e.position->lat_deg : 999);
    for (const double value : e.covariance_m2.reshaped()) put(value);
    put(e.sigma_m), put(e.anchor_ratio), put(e.anchor_inliers);
    bits.push_back(static_cast<std::uint64_t>(e.source));
  }
  return bits;
}

struct Flown {
  std::vector<Estimate> online, refined;
};

Flown fly(int threads) {
  const Threads set(threads);
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  Flown flown;
  for (const Moment& moment : short_flight()) {
    flown.online.push_back(localizer.process(moment.image, moment.telemetry).estimate);
  }
  flown.refined = localizer.refined();
  return flown;
}

TEST(LocalizerThreads, OneAndTwoGiveTheSameBits) {
  const Flown one = fly(1), two = fly(2), again = fly(2);
  ASSERT_EQ(one.online.back().source, SourceLabel::satellite_anchored) << "else nothing is compared";
  EXPECT_EQ(bits_of(one.online), bits_of(two.online));
  EXPECT_EQ(bits_of(one.refined), bits_of(two.refined));
  EXPECT_EQ(bits_of(two.online), bits_of(again.online));
}

}  // namespace
}  // namespace nadir
