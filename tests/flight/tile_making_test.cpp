// Tiles in flight: made beside it, reported, and never in its way.
#include "flight/tile_making.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <chrono>
#include <condition_variable>
#include <csignal>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "ortho/candidate_store.hpp"
#include "support/manual_clock.hpp"
#include "support/temporary_folder.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

constexpr std::chrono::seconds kTileMakingLimit{120};  // only so that what hangs fails

class TilesInFlight : public ::testing::Test {
 protected:
  TilesInFlight() { key_file_ = create_key_files(folder_ / "tile").private_key; }

  TileMakingSetup setup() const {
    TileMakingSetup setup{folder_ / "candidates", key_file_,
                          CandidateFlight{.airframe = "mini-07",
                                          .flight = "test",
                                          .base_package = {},
                                          .camera = camera_,
                                          .frame = LocalFrame({11.2, 48.1}),
                                          .zoom = 20}};
    setup.flight.limits.max_coarseness = 3;
    setup.flight.limits.max_blur_px = 1e3;  // waves are as soft in the sharpest picture
    return setup;
  }
  TileMaking::Listener listener() {
    return {[this](const TileKey&, CandidateOutcome outcome) {
              const std::scoped_lock lock(mutex_);
              ++outcomes_[outcome];
              changed_.notify_all();
            },
            [this](const std::string& failure) {
              const std::scoped_lock lock(mutex_);
              failures_ += failure.empty() ? 0 : 1;
              changed_.notify_all();
            },
            [this](const FrameTiles&) {
              const std::scoped_lock lock(mutex_);
              ++frames_;
              changed_.notify_all();
            }};
  }
  template <typename Condition>
  void wait_until(Condition condition) {
    std::unique_lock lock(mutex_);
    ASSERT_TRUE(changed_.wait_for(lock, kTileMakingLimit, condition));
  }
  FramePose pose(double east_m) const {
    FramePose pose;
    pose.pose = {{east_m, 0}, 100, {}};
    pose.covariance_m2 = 4 * Eigen::Matrix2d::Identity();
    pose.sigma_m = 2;
    pose.source = SourceLabel::satellite_anchored;
    pose.confirmed = true;
    return pose;
  }
  void see(TileMaking& tiles, std::uint64_t index, double east_m) const {
    Telemetry telemetry;
    telemetry.frame = "frame";
    telemetry.time_s = clock_.monotonic_s() - 2;
    cv::Mat colour;
    cv::cvtColor(test::photograph(test::waves, camera_, pose(east_m).pose), colour, cv::COLOR_GRAY2BGR);
    tiles.on_frame(index, telemetry, encode_image(colour, ImageFormat::jpeg, 92));
  }
  std::size_t stored(bool clean = true) const {
    CandidateReader reader(folder_ / "candidates");
    EXPECT_EQ(reader.clean_shutdown(), clean);
    Findings findings;
    std::size_t count = 0;
    while (const auto candidate = reader.next(findings)) {
      EXPECT_EQ(candidate->sidecar.captured_at.unix_ms, clock_.unix_us() / 1000 - 2000);
      ++count;
    }
    EXPECT_TRUE(findings.empty());
    return count;
  }

  test::TemporaryFolder folder_;
  std::filesystem::path key_file_;
  CameraModel camera_ = test::small_camera().scaled(2);
  ManualClock clock_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<CandidateOutcome, std::size_t> outcomes_;
  int failures_ = 0;
  std::uint64_t frames_ = 0;
};

TEST_F(TilesInFlight, AreMadeFromAnchoredFrames) {
  {
    TileMaking tiles(setup(), clock_, listener());
    for (std::uint64_t i = 0; i < 4; ++i) see(tiles, i, 10.0 * static_cast<double>(i));
    tiles.on_anchor(1, pose(10));
    wait_until([&] { return outcomes_[CandidateOutcome::added] >= 6; });
    tiles.on_anchor(1, pose(10));   // it is gone by now
    tiles.on_anchor(77, pose(10));  // never seen
  }
  EXPECT_EQ(failures_, 0);
  EXPECT_EQ(stored(), outcomes_[CandidateOutcome::added]);
}

TEST_F(TilesInFlight, StayWithinTheirBudget) {
  TileMakingSetup tight = setup();
  tight.budget_bytes = 20'000;  // a few
  {
    TileMaking tiles(tight, clock_, listener());
    see(tiles, 1, 10);
    tiles.on_anchor(1, pose(10));
    wait_until([&] { return outcomes_[CandidateOutcome::no_room] > 0; });
  }
  const std::scoped_lock lock(mutex_);
  EXPECT_EQ(stored(), outcomes_[CandidateOutcome::added]);
  EXPECT_EQ(failures_, 0);
}

// A zoom coarser no frame shows a tile wholly: what is whole is made at the latest when the flight ends.
TEST_F(TilesInFlight, AreAlsoMadeFromSeveralFrames) {
  TileMakingSetup low = setup();
  low.share = 1;  // no rest: the clock may be moved while the maker has not yet read how long it worked
  low.flight.zoom = 18;
  const LonLatBox box = bounds_of(TileKey{18, 139'240, 90'872});
  low.flight.frame = LocalFrame({(box.west_deg + box.east_deg) / 2, (box.south_deg + box.north_deg) / 2});
  {
    TileMaking tiles(low, clock_, listener());
    for (std::uint64_t i = 0; i < 2; ++i) {
      see(tiles, i, i == 0 ? -40 : 40);
      tiles.on_anchor(i, pose(i == 0 ? -40 : 40));
      wait_until([&] { return frames_ == i + 1; });  // a frame takes the place of the one that waits
      clock_.advance(1);
    }
  }
  EXPECT_EQ(outcomes_[CandidateOutcome::added], 1U);
  CandidateReader reader(folder_ / "candidates");
  Findings findings;
  const auto made = reader.next(findings);
  ASSERT_TRUE(made);
  EXPECT_EQ(made->sidecar.parts.size(), 2U);
}

TEST_F(TilesInFlight, AreNotMadeFromUncertainFrames) {
  {
    TileMaking tiles(setup(), clock_, listener());
    see(tiles, 0, 0);
    FramePose unconfirmed = pose(0);
    unconfirmed.confirmed = false;
    tiles.on_anchor(0, unconfirmed);
  }
  EXPECT_EQ(stored(), 0U);
}

// The file may not grow any more, as on a full disk.
TEST_F(TilesInFlight, AFullDiskIsReportedOnceAndAffectsTilesOnly) {
  {
    TileMaking tiles(setup(), clock_, listener());
    see(tiles, 0, 0);
    see(tiles, 1, 0);
    auto* const old_handler = std::signal(SIGXFSZ, SIG_IGN);
    rlimit old{};
    getrlimit(RLIMIT_FSIZE, &old);
    const rlimit limit{1000, old.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
    tiles.on_anchor(0, pose(0));
    wait_until([&] { return failures_ == 1; });
    {
      const std::scoped_lock lock(mutex_);
      EXPECT_EQ(outcomes_[CandidateOutcome::added], 0U);
    }
    setrlimit(RLIMIT_FSIZE, &old);
    std::signal(SIGXFSZ, old_handler);
    tiles.on_anchor(1, pose(0));
    wait_until([&] { return outcomes_[CandidateOutcome::added] >= 6; });
  }
  EXPECT_EQ(failures_, 1);
  EXPECT_EQ(stored(), outcomes_[CandidateOutcome::added]);
}

TEST_F(TilesInFlight, ConfigurationErrorsAreFoundBeforeTakeOff) {
  TileMakingSetup wrong = setup();
  wrong.key = folder_ / "none.pem";
  EXPECT_THROW(TileMaking(wrong, clock_, listener()), Error);
  wrong = setup();
  wrong.folder = folder_.write("file", "text");
  EXPECT_THROW(TileMaking(wrong, clock_, listener()), Error);
  wrong = setup();
  wrong.flight.airframe = "no name";
  EXPECT_THROW(TileMaking(wrong, clock_, listener()), Error);
}

// Pictures that the map never spoke of do not pile up.
TEST_F(TilesInFlight, KeepALimitedNumberOfFrames) {
  TileMaking tiles(setup(), clock_, listener());
  Telemetry telemetry;
  const Bytes large(1 << 20);
  for (std::uint64_t i = 0; i < 200; ++i) tiles.on_frame(i, telemetry, large);
  tiles.on_anchor(3, pose(0));  // long gone
  tiles.on_anchor(199, pose(0));
}

}  // namespace
}  // namespace nadir
