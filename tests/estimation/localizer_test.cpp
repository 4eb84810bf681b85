#include "estimation/localizer.hpp"

#include <gtest/gtest.h>
#include <bit>
#include <cmath>
#include <functional>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "estimation/localizer_fixture.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

using namespace test;

TEST(Localizer, FollowsAFlightOverItsMap) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  std::vector<Estimate> online;
  for (const Moment& moment : short_flight()) {
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    expect_sound(report.estimate);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted)
        << name_of(report.anchor.verdict) << " " << report.anchor.ratio << " " << report.anchor.inliers;
    EXPECT_EQ(report.estimate.source, SourceLabel::satellite_anchored);
    EXPECT_EQ(report.estimate.frame, moment.telemetry.frame);
    EXPECT_EQ(report.estimate.time_s, moment.telemetry.time_s);
    EXPECT_EQ(report.estimate.anchor_age_s, 0.0);
    EXPECT_LT(off_m(report.estimate, moment), 3.0) << moment.telemetry.frame;
    EXPECT_LT(off_m(report.estimate, moment), 3 * report.estimate.sigma_m);
    EXPECT_LT(report.estimate.sigma_m, 10);
    EXPECT_FALSE(report.anchor.rectified.empty());
    EXPECT_EQ(report.anchor.rectified.size(), report.anchor.matched_map.size());
    online.push_back(report.estimate);
  }
  const auto refined = localizer.refined();
  ASSERT_EQ(refined.size(), online.size());
  for (std::size_t i = 0; i < refined.size(); ++i) {
    EXPECT_EQ(refined[i].frame, online[i].frame);
    EXPECT_LT(off_m(refined[i], short_flight()[i]), 3.0);
    expect_sound(refined[i]);
  }
}

// What the matcher finds in a window, changed.
LocalizerConfig with_changed_matches(std::function<void(AnchorMatch&)> change) {
  class ChangedMatches final : public MapMatcher {
   public:
    ChangedMatches(const MatcherMap& map, std::function<void(AnchorMatch&)> change)
        : inner_(make_channel_matcher(map)), change_(std::move(change)) {}
    AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
      AnchorMatch found = inner_->match(grey, prior);
      change_(found);
      return found;
    }
    AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
      return inner_->match_anywhere(grey, prior, area);
    }

   private:
    std::unique_ptr<MapMatcher> inner_;
    std::function<void(AnchorMatch&)> change_;
  };
  LocalizerConfig changed = config();
  changed.matcher = [change = std::move(change)](const MatcherMap& map) {
    return std::make_unique<ChangedMatches>(map, change);
  };
  return changed;
}

void as_a_minority(AnchorMatch& found) { found.patches = found.patches * 2 + 1; }  // of which no more agree

// A minority that agrees may be the wrong one: until a sharp prediction says the same, its word counts less.
TEST(Localizer, AMinorityOfPatchesMakesAVagueAnchor) {
  const LocalizerConfig minority = with_changed_matches(as_a_minority);
  Localizer sure(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  Localizer vague(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), minority);
  const Moment &first = short_flight()[0], &second = short_flight()[1];
  const FrameReport one = sure.process(first.image, first.telemetry),
                    same = vague.process(first.image, first.telemetry);
  ASSERT_EQ(same.anchor.verdict, AnchorVerdict::accepted);
  const double ten_px_m = 10 * same.anchor.matching_gsd_m;
  EXPECT_GT(same.estimate.sigma_m, 1.5 * one.estimate.sigma_m);
  EXPECT_LT(same.estimate.sigma_m, std::hypot(ten_px_m, one.estimate.sigma_m));
  EXPECT_LT(off_m(same.estimate, first), 3 * same.estimate.sigma_m);
  const FrameReport next = vague.process(second.image, second.telemetry);
  EXPECT_EQ(next.anchor.verdict, AnchorVerdict::accepted);
  EXPECT_NEAR(next.estimate.sigma_m, sure.process(second.image, second.telemetry).estimate.sigma_m,
              0.5 * next.estimate.sigma_m);
}

// … and one that agrees a row beside the track is rather wrong than the track, and hardly moves it.
TEST(Localizer, AMinorityBesideASharpTrackHardlyMovesIt) {
  constexpr double kRow_px = 20;
  double row_m = 0;
  bool beside = false;
  const LocalizerConfig configured = with_changed_matches([&](AnchorMatch& found) {
    if (!beside || !found.solved) return;
    as_a_minority(found);
    row_m = kRow_px * found.fine_gsd_m;
    found.solved->pose.position.east_m += row_m;
  });
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), configured);
  for (const Moment& moment : short_flight()) {
    beside = &moment == &short_flight().back();
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted) << "chi2 " << report.anchor.chi2;
    if (!beside) continue;
    EXPECT_LT(report.anchor.chi2, 5.991) << "it agrees within 95 %";
    EXPECT_LT(off_m(report.estimate, moment), row_m / 4);
  }
}

// What no model has (lens, relief, the moment of the telemetry) is another over other ground and in a turn: several
// anchors that erred alike do not shut out those that err otherwise.
TEST(Localizer, AnAnchoredTrackAllowsForUnmodelledErrors) {
  double off_by_m = 0;
  const LocalizerConfig configured = with_changed_matches([&](AnchorMatch& found) {
    if (found.solved) found.solved->pose.position.east_m += off_by_m;
  });
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), configured);
  for (const Moment& moment : short_flight()) {
    const bool last = &moment == &short_flight().back();
    if (last) off_by_m = 4 * 0.015 * *moment.telemetry.agl_m;
    const FrameReport report = localizer.process(moment.image, moment.telemetry);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted) << "chi2 " << report.anchor.chi2;
    if (last) {
      EXPECT_GT(report.anchor.chi2, 4) << "it is noticed all the same";
    }
  }
}

TEST(Localizer, BetweenAnchorsItIsPropagatedByOdometry) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), nullptr, place_of(short_flight()[0].truth.position), [] {
    LocalizerConfig c = config();
    c.start_sigma_m = 3;
    return c;
  }());
  double last_sigma = 0;
  for (std::size_t i = 0; i < short_flight().size(); ++i) {
    const FrameReport report = localizer.process(short_flight()[i].image, short_flight()[i].telemetry);
    expect_sound(report.estimate);
    EXPECT_EQ(report.odometry.tracked, i > 0);
    EXPECT_EQ(report.estimate.source, i > 0 ? SourceLabel::vo_extrapolated : SourceLabel::dead_reckoned);
    EXPECT_GE(report.estimate.sigma_m, last_sigma) << "nothing but anchors makes it surer";
    EXPECT_FALSE(report.estimate.anchor_age_s);
    EXPECT_LT(off_m(report.estimate, short_flight()[i]), 3 * report.estimate.sigma_m);
    last_sigma = report.estimate.sigma_m;
  }
  EXPECT_LT(last_sigma, 20);
}

TEST(Localizer, IsDeterministic) {
  std::vector<Estimate> online[2];
  for (auto& run : online) {
    Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
    for (std::size_t i = 0; i < 1; ++i) {
      run.push_back(localizer.process(short_flight()[i].image, short_flight()[i].telemetry).estimate);
    }
  }
  for (std::size_t i = 0; i < 1; ++i) {
    EXPECT_EQ(online[0][i].position, online[1][i].position);
    EXPECT_EQ(online[0][i].sigma_m, online[1][i].sigma_m);
    EXPECT_EQ(online[0][i].covariance_m2, online[1][i].covariance_m2);
    EXPECT_EQ(online[0][i].source, online[1][i].source);
    EXPECT_EQ(online[0][i].anchor_inliers, online[1][i].anchor_inliers);
    EXPECT_EQ(online[0][i].anchor_ratio, online[1][i].anchor_ratio);
  }
}

TEST(Localizer, ColourFramesAreTheSameAsGrey) {
  Localizer grey(flight_camera(), LocalFrame(kOrigin), nullptr, start(), config());
  Localizer colour(flight_camera(), LocalFrame(kOrigin), nullptr, start(), config());
  for (std::size_t i = 0; i < 2; ++i) {
    const Moment& moment = short_flight()[i];
    cv::Mat bgr;
    cv::merge(std::vector<cv::Mat>(3, moment.image), bgr);
    EXPECT_EQ(grey.process(moment.image, moment.telemetry).estimate.position,
              colour.process(bgr, moment.telemetry).estimate.position);
  }
}

// Thermal and near-infrared cameras show as bright what a map shows as dark: all of it, or here one thing and there
// another. An edge and its reversal are the same to the channels.
TEST(Localizer, ReversedBrightnessMatchesAsWell) {
  const auto reversed = [](const cv::Mat& image) { return cv::Mat(255 - image); };
  // Above the middle grey reversed, below as it was: each edge keeps its direction or turns it.
  const auto folded = [](const cv::Mat& image) {
    cv::Mat result;
    cv::absdiff(image, cv::Scalar::all(128), result);
    return cv::Mat(2 * result);
  };
  Localizer usual(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  Localizer negative(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  Localizer mixed(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  for (const Moment& moment : short_flight()) {
    const FrameReport as_seen = usual.process(moment.image, moment.telemetry);
    const FrameReport other = negative.process(reversed(moment.image), moment.telemetry);
    const FrameReport partly = mixed.process(folded(moment.image), moment.telemetry);
    EXPECT_EQ(other.anchor.verdict, AnchorVerdict::accepted) << moment.telemetry.frame;
    EXPECT_NEAR(other.anchor.score, as_seen.anchor.score, 0.01);
    EXPECT_NEAR(other.anchor.inliers, as_seen.anchor.inliers, 3);
    EXPECT_LT(off_m(other.estimate, moment), off_m(as_seen.estimate, moment) + 0.2);
    EXPECT_EQ(partly.anchor.verdict, AnchorVerdict::accepted) << "folded " << moment.telemetry.frame;
    EXPECT_LT(off_m(partly.estimate, moment), 3) << "folded " << moment.telemetry.frame;
  }
}

TEST(Localizer, WithoutMapAndStartThereIsNoFix) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), nullptr, std::nullopt, config());
  for (std::size_t i = 0; i < 2; ++i) {
    const FrameReport report = localizer.process(short_flight()[i].image, short_flight()[i].telemetry);
    EXPECT_EQ(report.estimate.source, SourceLabel::no_fix);
    EXPECT_FALSE(report.estimate.position);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::not_tried);
  }
  EXPECT_EQ(localizer.refined().size(), 2U);
  for (const Estimate& estimate : localizer.refined()) EXPECT_FALSE(estimate.position);
}

TEST(Localizer, OffTheMapItIsNotAnchored) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), place_of({5000, 5000}), config());
  const FrameReport report = localizer.process(short_flight()[0].image, short_flight()[0].telemetry);
  EXPECT_EQ(report.anchor.verdict, AnchorVerdict::no_map);
  EXPECT_NE(report.estimate.source, SourceLabel::satellite_anchored);
}

// The whole neighbourhood is another one than the map's: nothing may be anchored.
TEST(Localizer, AForeignLandscapeIsNotAnchored) {
  const test::Landscape other(77, 160);
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  for (std::size_t i = 0; i < 3; ++i) {
    const cv::Mat image = test::photograph(other.ground(), flight_camera().camera, short_flight()[i].truth);
    const FrameReport report = localizer.process(image, short_flight()[i].telemetry);
    EXPECT_NE(report.anchor.verdict, AnchorVerdict::accepted) << report.anchor.ratio << " " << report.anchor.inliers;
    expect_sound(report.estimate);
  }
}

TEST(Localizer, UnfitFramesAreBridged) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  const auto& moments = short_flight();
  const double sure = localizer.process(moments[0].image, moments[0].telemetry).estimate.sigma_m;
  for (const cv::Mat& image : {cv::Mat(), cv::Mat(240, 320, CV_8UC1, cv::Scalar(0))}) {
    Telemetry telemetry = moments[1].telemetry;
    telemetry.time_s = image.empty() ? 11 : 11.5;
    const FrameReport report = localizer.process(image, telemetry);
    EXPECT_EQ(report.anchor.verdict, AnchorVerdict::frame_unfit);
    EXPECT_EQ(report.estimate.source, SourceLabel::dead_reckoned);
    EXPECT_GT(report.estimate.sigma_m, sure);
    EXPECT_FALSE(report.odometry.tracked);
    expect_sound(report.estimate);
  }
  const FrameReport after = localizer.process(moments[2].image, moments[2].telemetry);
  EXPECT_EQ(after.anchor.verdict, AnchorVerdict::accepted);
  EXPECT_LT(off_m(after.estimate, moments[2]), 3.0);
  EXPECT_GT(after.estimate.segment, 0) << "tracking was lost in between";
}

TEST(Localizer, ARepeatedFrameStaysPut) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  const Moment& moment = short_flight()[0];
  const Estimate first = localizer.process(moment.image, moment.telemetry).estimate;
  Telemetry again = moment.telemetry;
  for (int i = 0; i < 1; ++i) {
    again.time_s += 1;
    const Estimate estimate = localizer.process(moment.image, again).estimate;
    expect_sound(estimate);
    EXPECT_LT(off_m(estimate, moment), 3.0);
    EXPECT_GT(estimate.sigma_m, 0.6 * first.sigma_m) << "the same frame twice is no second opinion";
  }
}

TEST(Localizer, MapSigmaFollowsFromCe90) {
  // 90 % of a circular normal distribution lie within sqrt(2 ln 10) sigma.
  EXPECT_NEAR(map_sigma_from_ce90(std::sqrt(2 * std::log(10.0))), 1, 1e-3);
}

// The poses of frames that the map has confirmed: what tiles are made from.

void expect_near(const FramePose& pose, const Moment& moment) {
  const CameraPose& truth = moment.truth;
  const double off_m = distance_m(pose.pose.position, truth.position);
  EXPECT_LT(off_m, 3);
  EXPECT_LT(off_m, 4 * pose.sigma_m);
  EXPECT_NEAR(pose.pose.agl_m, truth.agl_m, 0.03 * truth.agl_m);
  EXPECT_NEAR(wrap_pi(pose.pose.attitude.heading_rad - truth.attitude.heading_rad), 0, radians(1.5));
  EXPECT_NEAR(pose.pose.attitude.pitch_rad, truth.attitude.pitch_rad, radians(1.5));
  EXPECT_NEAR(pose.pose.attitude.roll_rad, truth.attitude.roll_rad, radians(1.5));
  EXPECT_EQ(pose.source, SourceLabel::satellite_anchored);
  EXPECT_NEAR(pose.sigma_m * pose.sigma_m, 0.5 * pose.covariance_m2.trace(), 1e-9);
}

bool clear(const AnchorReport& anchor) { return anchor.log_likelihood_ratio >= parameters::belief::kUnambiguous; }

TEST(LocalizerPoses, AreThoseOfTheAnchoredFrames) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  for (std::size_t i = 0; i < short_flight().size(); ++i) {
    const FrameReport report = localizer.process(short_flight()[i].image, short_flight()[i].telemetry);
    ASSERT_EQ(report.anchor_pose.has_value(), report.anchor.verdict == AnchorVerdict::accepted);
    ASSERT_TRUE(report.anchor_pose);
    expect_near(*report.anchor_pose, short_flight()[i]);
    EXPECT_EQ(report.anchor_pose->confirmed, i > 0 || clear(report.anchor)) << "the first one is on its own";
    EXPECT_FALSE(report.anchor_pose->refined);
    EXPECT_NEAR(report.anchor_pose->sigma_m, report.estimate.sigma_m, 1e-9);
  }
  const auto refined = localizer.refined_poses();
  const auto estimates = localizer.refined();
  ASSERT_EQ(refined.size(), short_flight().size());
  for (std::size_t i = 0; i < refined.size(); ++i) {
    ASSERT_TRUE(refined[i]);
    expect_near(*refined[i], short_flight()[i]);
    EXPECT_TRUE(refined[i]->confirmed);
    EXPECT_TRUE(refined[i]->refined);
    EXPECT_NEAR(refined[i]->sigma_m, estimates[i].sigma_m, 1e-9);
    const PlanePoint at = LocalFrame(kOrigin).plane_from_lonlat(*estimates[i].position);
    EXPECT_NEAR(refined[i]->pose.position.east_m, at.east_m, 1e-6);
  }
}

TEST(LocalizerPoses, FramesWithoutAnAnchorHaveNone) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  bool last_is_clear = false;
  for (std::size_t i = 0; i < short_flight().size(); ++i) {
    const cv::Mat black(short_flight()[i].image.size(), CV_8UC1, cv::Scalar(0));
    const FrameReport report = localizer.process(i == 2 ? black : short_flight()[i].image, short_flight()[i].telemetry);
    EXPECT_EQ(report.anchor_pose.has_value(), i != 2);
    last_is_clear = clear(report.anchor);
  }
  const auto refined = localizer.refined_poses();
  EXPECT_FALSE(refined[2]);
  ASSERT_TRUE(refined[3]);
  EXPECT_EQ(refined[3]->confirmed, last_is_clear) << "nothing leads to another anchor without a break";
  EXPECT_TRUE(refined[1]->confirmed);
}

TEST(LocalizerPoses, OfALateAnchorIsThatOfItsOwnFrame) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  localizer.process(short_flight()[0].image, short_flight()[0].telemetry);
  auto followed = localizer.track(short_flight()[1].image, short_flight()[1].telemetry);
  ASSERT_TRUE(followed.job);
  EXPECT_FALSE(followed.report.anchor_pose);
  followed.job->run();
  localizer.track(short_flight()[2].image, short_flight()[2].telemetry);
  const FrameReport report = localizer.finish(std::move(followed.job));
  ASSERT_TRUE(report.anchor_pose);
  expect_near(*report.anchor_pose, short_flight()[1]);
}

TEST(LocalizerPoses, WithoutAMapThereAreNone) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), nullptr, start(), config());
  EXPECT_TRUE(localizer.refined_poses().empty());
  localizer.process(short_flight()[0].image, short_flight()[0].telemetry);
  ASSERT_EQ(localizer.refined_poses().size(), 1U);
  EXPECT_FALSE(localizer.refined_poses().front());
}

// The same flight gives the same bits, however many threads OpenCV may use.

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

// The landscape's tiles, each with the placement error that the test gives it.
class PlacedTiles final : public TileSource {
 public:
  ZoomRange zooms() const override { return landscape_tiles().zooms(); }
  std::optional<Bytes> read(const TileKey& key) const override { return landscape_tiles().read(key); }
  std::optional<double> ce90_m(const TileKey& key) const override { return ce90(key); }

  std::function<std::optional<double>(const TileKey&)> ce90;
};

std::vector<double> sigmas_over(const TileSource& tiles, std::optional<double> map_sigma_m) {
  LocalizerConfig given = config();
  given.map_sigma_m = map_sigma_m;
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &tiles, start(), given);
  std::vector<double> sigmas;
  for (const Moment& moment : short_flight()) {
    sigmas.push_back(localizer.process(moment.image, moment.telemetry).estimate.sigma_m);
  }
  for (const Estimate& estimate : localizer.refined()) sigmas.push_back(estimate.sigma_m);
  return sigmas;
}

// One coarse scene somewhere in the package made every position vague.
TEST(LocalizerMapError, IsThatOfTheTilesThatWereMatched) {
  PlacedTiles tiles;
  tiles.ce90 = [](const TileKey& key) -> std::optional<double> {
    const LonLatBox box = bounds_of(key);
    const PlanePoint at =
        LocalFrame(kOrigin).plane_from_lonlat({(box.west_deg + box.east_deg) / 2, (box.south_deg + box.north_deg) / 2});
    return std::hypot(at.east_m, at.north_m) < 600 ? 4.0 : 40.0;
  };
  const std::vector<double> found = sigmas_over(tiles, std::nullopt);
  EXPECT_EQ(found, sigmas_over(tiles, map_sigma_from_ce90(4.0))) << "bit for bit";
  EXPECT_NE(found, sigmas_over(tiles, map_sigma_from_ce90(40.0)));
}

TEST(LocalizerMapError, AnOverrideStaysOne) {
  PlacedTiles tiles;
  tiles.ce90 = [](const TileKey&) { return std::optional(40.0); };
  EXPECT_EQ(sigmas_over(tiles, 1.0), sigmas_over(landscape_tiles(), 1.0));
}

TEST(LocalizerMapError, WithoutAStatementTheDefaultHolds) {
  EXPECT_EQ(sigmas_over(landscape_tiles(), std::nullopt),
            sigmas_over(landscape_tiles(), parameters::localizer::kMapSigma_m));
}

// From a coarse scene to a fine one and back: what is published follows the map under the aircraft, and the track that
// a coarse map left behind does not outvote the fine one.
TEST(LocalizerMapError, FollowsFromSceneToScene) {
  const double coarse_m = map_sigma_from_ce90(20.0);
  PlacedTiles tiles;
  double now = 20.0;
  tiles.ce90 = [&now](const TileKey&) { return std::optional(now); };
  LocalizerConfig given = config();
  given.map_sigma_m.reset();
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &tiles, start(), given);
  const std::vector<Moment>& moments = short_flight();
  const Estimate over_coarse = localizer.process(moments[0].image, moments[0].telemetry).estimate;
  ASSERT_EQ(over_coarse.source, SourceLabel::satellite_anchored);
  EXPECT_GT(over_coarse.sigma_m, coarse_m);
  now = 4.0;
  const Estimate over_fine = localizer.process(moments[1].image, moments[1].telemetry).estimate;
  ASSERT_EQ(over_fine.source, SourceLabel::satellite_anchored);
  EXPECT_LT(over_fine.sigma_m, 0.6 * coarse_m);
  EXPECT_LT(off_m(over_fine, moments[1]), 3.0);
  now = 20.0;
  const Estimate coarse_again = localizer.process(moments[2].image, moments[2].telemetry).estimate;
  ASSERT_EQ(coarse_again.source, SourceLabel::satellite_anchored);
  EXPECT_GT(coarse_again.sigma_m, coarse_m);
  const std::vector<Estimate> refined = localizer.refined();
  ASSERT_EQ(refined.size(), 3U);
  EXPECT_GT(refined[0].sigma_m, coarse_m);
  EXPECT_GT(refined[2].sigma_m, coarse_m);
}

}  // namespace
}  // namespace nadir
