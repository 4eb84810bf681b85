#include "estimation/second_opinion.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "base/error.hpp"
#include "base/files.hpp"
#include "bench/likelihood_fit.hpp"
#include "estimation/localizer_fixture.hpp"
#include "support/onnx_writer.hpp"
#include "support/temporary_folder.hpp"
#include "vision/descriptor_matcher.hpp"
#include "vision/gradient_network.hpp"

namespace nadir {
namespace {

using namespace test;
using testing::HasSubstr;

// Counts as those of real matchers are: an agreement is rare where the first is wrong.
OutcomeCounts counted() {
  OutcomeCounts counts;
  counts.place = {{{30, 30, 30, 8, 2}, {60, 30, 8, 2, 0}, {80, 15, 4, 1, 0}}};
  counts.chance = {{{0, 9, 400, 560, 31}, {1, 9, 300, 650, 40}, {1, 3, 40, 50, 6}}};
  return counts;
}

SecondLikelihoodTable table() {
  SecondLikelihoodTable made;
  made.network_sha256 = "measured";
  made.look = look_likelihood_table();
  made.first = made.second = counted();
  return made;
}

TEST(OutcomeEvidence, AnAgreementSaysWhatItsBoundAllows) {
  const OutcomeCounts counts = counted();
  // Of its class: 60 of 100 places, and 1 of 1000 chance peaks, of which 5.6 are assumed as the upper bound.
  EXPECT_NEAR(outcome_evidence(counts, 1, SecondOutcome::agrees_strongly), std::log(0.6 / (5.645 / 1000)), 1e-3);
  // Never seen by chance: three are assumed.
  EXPECT_NEAR(outcome_evidence(counts, -1, SecondOutcome::agrees_strongly), std::log(0.3 / (3.0 / 1000)), 1e-3);
  OutcomeCounts never = counts;
  // Where no chance peak was as sure, those of the next class count.
  never.chance[2] = {};
  EXPECT_NEAR(outcome_evidence(never, 5, SecondOutcome::agrees_strongly), std::log(0.7 / (5.645 / 1000)), 1e-3);
  EXPECT_LT(outcome_evidence(counts, 1, SecondOutcome::agrees),
            outcome_evidence(counts, 1, SecondOutcome::agrees_strongly));
}

// What shows little to the first shows little to the second: its silence is held against those that are sure of
// themselves.
TEST(OutcomeEvidence, SilenceSaysLittleAgainstAWeakMatch) {
  const OutcomeCounts counts = counted();
  for (const SecondOutcome silent : {SecondOutcome::none, SecondOutcome::differs}) {
    EXPECT_GT(outcome_evidence(counts, -1, silent), outcome_evidence(counts, 1, silent));
  }
}

TEST(OutcomeEvidence, OnlyAnAgreementMakesSurer) {
  OutcomeCounts odd = counted();
  std::swap(odd.place, odd.chance);  // a second matcher that is wrong where the first is right
  for (const OutcomeCounts& counts : {counted(), odd}) {
    for (const double log_first : {-3.0, 2.0, 6.0}) {
      for (const SecondOutcome outcome :
           {SecondOutcome::none, SecondOutcome::differs, SecondOutcome::differs_strongly}) {
        EXPECT_LE(outcome_evidence(counts, log_first, outcome), 0);
      }
      for (const SecondOutcome outcome : {SecondOutcome::agrees, SecondOutcome::agrees_strongly}) {
        EXPECT_GE(outcome_evidence(counts, log_first, outcome), 0);
      }
    }
  }
}

TEST(OutcomeEvidence, WhatWasNeverCountedSaysNothing) {
  for (std::size_t i = 0; i < OutcomeCounts::kOutcomes; ++i) {
    EXPECT_EQ(outcome_evidence({}, 2, static_cast<SecondOutcome>(i)), 0);
  }
}

// A matcher that gives the match that it is set to.
struct Script {
  std::optional<PlanePoint> place;  // nothing: no candidate
  bool on_map = true, throws = false;
  double ratio = 0.5;
  int asked = 0;
};

class Scripted final : public MapMatcher {
 public:
  explicit Scripted(Script& script) : script_(script) {}
  AnchorMatch match(const cv::Mat& /*grey*/, const AnchorPrior& prior) override {
    ++script_.asked;
    if (script_.throws) throw Error({.what = "out of memory"});
    AnchorMatch match;
    match.on_map = script_.on_map;
    match.fine_gsd_m = match.coarse_gsd_m = 0.5;
    if (!script_.place) return match;
    match.search.ratio = script_.ratio;
    match.search.places.push_back({.pose = prior.search.pose, .score = 0.4, .coarse_score = 0.4});
    match.search.places.front().pose.position = *script_.place;
    match.patches = 90;
    SolvedPose& solved = match.solved.emplace();
    solved.pose = match.search.places.front().pose;
    solved.inliers = 40;
    solved.rms_m = 0.5;
    return match;
  }
  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& /*area*/) override {
    return match(grey, prior);
  }

 private:
  Script& script_;
};

class Opinion : public testing::Test {
 protected:
  Opinion() { prior_.search.pose.position = {1000, 2000}; }

  AnchorMatch look(SecondMatcherUse use = SecondMatcherUse::always) {
    const auto scripted = [](Script& script) {
      return [&script](const MatcherMap&) { return std::make_unique<Scripted>(script); };
    };
    if (!matcher_) {
      matcher_ = make_second_opinion({.first = scripted(first_),
                                      .second = scripted(second_),
                                      .use = use,
                                      .table = &table_,
                                      .on_failure = [this](const std::string& why) { failures_.push_back(why); }})(
          {camera_, landscape_tiles(), frame_, ground_});
    }
    return matcher_->match({}, prior_);
  }
  double by_itself() {
    AnchorMatch alone = Scripted(first_).match({}, prior_);
    --first_.asked;
    return log_likelihood_ratio(alone, prior_, 4 * prior_.search.radius_m * prior_.search.radius_m);
  }

  const CameraModel camera_ = flight_camera().camera;
  const LocalFrame frame_{kOrigin};
  const FlatGround ground_;
  const SecondLikelihoodTable table_ = table();
  AnchorPrior prior_;
  Script first_{.place = PlanePoint{1010, 2010}, .ratio = 0.93}, second_{.place = PlanePoint{1012, 2008}};
  std::unique_ptr<MapMatcher> matcher_;
  std::vector<std::string> failures_;
};

TEST_F(Opinion, AnAgreementMakesSurer) {
  const AnchorMatch match = look();
  ASSERT_TRUE(match.judged_log_likelihood_ratio);
  EXPECT_GT(*match.judged_log_likelihood_ratio, by_itself() + 1);
  EXPECT_LT(*match.judged_log_likelihood_ratio, parameters::belief::kUnambiguous);
  EXPECT_EQ(match.solved->pose.position.east_m, 1010) << "the first one's place, which is the finer one";
}

TEST_F(Opinion, AContradictionMakesLessSure) {
  second_ = {.place = PlanePoint{960, 2050}, .ratio = 0.97};
  const AnchorMatch match = look();
  EXPECT_EQ(match.solved->pose.position.east_m, 1010);
  EXPECT_LT(*match.judged_log_likelihood_ratio, by_itself());
}

// Of two places the more likely one is the candidate, and says less than it would alone.
TEST_F(Opinion, TheOtherPlaceMayBeTheLikelierOne) {
  first_.ratio = 0.999;
  second_ = {.place = PlanePoint{960, 2050}, .ratio = 0.3};
  const AnchorMatch match = look();
  EXPECT_EQ(match.solved->pose.position.east_m, 960);
  AnchorMatch alone = Scripted(second_).match({}, prior_);
  EXPECT_LT(*match.judged_log_likelihood_ratio, log_likelihood_ratio(alone, prior_, 40'000));
}

// Nor by its own, however sure it is of it.
TEST_F(Opinion, NothingBecomesUnambiguousByTheSecond) {
  for (const PlanePoint place : {PlanePoint{1010, 2010}, PlanePoint{960, 2050}}) {
    first_.ratio = 0.85;
    second_ = {.place = place, .ratio = 0};
    EXPECT_LT(by_itself(), parameters::belief::kUnambiguous);
    const AnchorMatch match = look();
    EXPECT_EQ(match.solved->pose.position.east_m, place.east_m);
    EXPECT_LE(*match.judged_log_likelihood_ratio, parameters::second_opinion::kMostClaim);
  }
}

TEST_F(Opinion, SilenceOfTheFirstLeavesTheSecond) {
  first_.place.reset();
  const AnchorMatch match = look(SecondMatcherUse::automatic);
  ASSERT_TRUE(match.solved && match.judged_log_likelihood_ratio);
  EXPECT_EQ(match.solved->pose.position.east_m, 1012);
}

// Even if it contradicted, the match would settle where the aircraft is.
TEST_F(Opinion, IsNotAskedWhereItsAnswerCannotMatter) {
  double needed = by_itself() - 20;
  std::vector<double> weighed;
  prior_.settles = [&](const AnchorMatch& match, double log_likelihood_ratio) {
    EXPECT_EQ(match.solved->pose.position.east_m, 1010);
    weighed.push_back(log_likelihood_ratio);
    return log_likelihood_ratio >= needed;
  };
  EXPECT_FALSE(look(SecondMatcherUse::automatic).judged_log_likelihood_ratio);
  EXPECT_EQ(second_.asked, 0);
  ASSERT_EQ(weighed.size(), 1U);
  EXPECT_DOUBLE_EQ(weighed.front(), by_itself() + least_evidence(table_.first, by_itself()));
  EXPECT_LT(weighed.front(), by_itself() - 1);

  needed = by_itself();  // as it is, but not where the second contradicts
  EXPECT_TRUE(look().judged_log_likelihood_ratio);
  EXPECT_EQ(second_.asked, 1);
  first_.place.reset();  // there is nothing to settle
  needed = -100;
  EXPECT_TRUE(look().judged_log_likelihood_ratio);
  EXPECT_EQ(second_.asked, 2);
}

TEST_F(Opinion, IsAskedWhereNobodyKnowsWhatWouldSettle) {
  EXPECT_TRUE(look(SecondMatcherUse::automatic).judged_log_likelihood_ratio);
  EXPECT_EQ(second_.asked, 1);
}

TEST_F(Opinion, OffTheMapItIsNotAsked) {
  first_ = {.place = std::nullopt, .on_map = false};
  EXPECT_FALSE(look().on_map);
  EXPECT_EQ(second_.asked, 0);
}

// The flight goes on with what the first one sees, and is notified once.
TEST_F(Opinion, AnErrorOfTheSecondCostsTheFirstNothing) {
  second_.throws = true;
  for (int i = 0; i < 3; ++i) {
    const AnchorMatch match = look();
    EXPECT_FALSE(match.judged_log_likelihood_ratio);
    ASSERT_TRUE(match.solved);
  }
  EXPECT_EQ(second_.asked, 1);
  ASSERT_EQ(failures_.size(), 1U);
  EXPECT_THAT(failures_.front(), HasSubstr("out of memory"));
}

// Real matchers in the localizer. Asked never, it changes no bit.
TEST(SecondOpinionFlight, ChangesNothingUntilItIsAsked) {
  const auto fly = [](const MapMatcherFactory& matcher) {
    LocalizerConfig configured = config();
    configured.matcher = matcher;
    Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), configured);
    std::vector<Estimate> estimates;
    int accepted = 0;
    for (const Moment& flown : short_flight()) {
      const FrameReport report = localizer.process(flown.image, flown.telemetry);
      estimates.push_back(report.estimate);
      accepted += report.anchor.verdict == AnchorVerdict::accepted ? 1 : 0;
    }
    return std::pair(estimates, accepted);
  };
  const auto gradients = [](const MatcherMap& map) {
    return make_descriptor_matcher(map, std::make_shared<GradientNetwork>());
  };
  static const SecondLikelihoodTable kTable = table();
  const auto alone = fly(make_channel_matcher);
  const auto never = fly(make_second_opinion({.second = gradients, .use = SecondMatcherUse::never, .table = &kTable}));
  const auto always =
      fly(make_second_opinion({.second = gradients, .use = SecondMatcherUse::always, .table = &kTable}));
  ASSERT_EQ(alone.first.size(), never.first.size());
  for (std::size_t i = 0; i < alone.first.size(); ++i) {
    EXPECT_EQ(alone.first[i].position->lon_deg, never.first[i].position->lon_deg);
    EXPECT_EQ(alone.first[i].covariance_m2, never.first[i].covariance_m2);
    EXPECT_EQ(alone.first[i].hpl_m, never.first[i].hpl_m);
  }
  EXPECT_GE(always.second, alone.second);
}

// The belief says when: in a flight that is anchored and matches well, it is not asked any more.
TEST(SecondOpinionFlight, AsksOnlyUntilTheFlightIsSettled) {
  class Counted final : public MapMatcher {
   public:
    Counted(const MatcherMap& map, std::vector<bool>& asked)
        : matcher_(make_descriptor_matcher(map, std::make_shared<GradientNetwork>())), asked_(asked) {}
    AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
      asked_.back() = true;
      return matcher_->match(grey, prior);
    }
    AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
      return matcher_->match_anywhere(grey, prior, area);
    }

   private:
    std::unique_ptr<MapMatcher> matcher_;
    std::vector<bool>& asked_;
  };
  static const SecondLikelihoodTable kTable = table();
  std::vector<bool> asked;
  LocalizerConfig configured = config();
  configured.matcher = make_second_opinion(
      {.second = [&](const MatcherMap& map) { return std::make_unique<Counted>(map, asked); }, .table = &kTable});
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), configured);
  for (const Moment& flown : short_flight()) {
    asked.push_back(false);
    const FrameReport report = localizer.process(flown.image, flown.telemetry);
    if (!asked.back()) {
      EXPECT_EQ(report.anchor.verdict, AnchorVerdict::accepted);
      EXPECT_TRUE(report.estimate.hpl_m);
    }
  }
  EXPECT_TRUE(asked.front()) << "the start may be wrong";
  EXPECT_FALSE(asked.back());
}

// The whole path: an ONNX file, the plug-in, ONNX Runtime, the matcher, a place. The network is one convolution.
TEST(OnnxMatcher, FindsAPlaceByAModel) {
  const std::filesystem::path plugins(NETWORK_PLUGINS);
  for (const char* file : {"nadir_network_onnxruntime.so", "libonnxruntime.so.1"}) {
    if (!std::filesystem::exists(plugins / file)) GTEST_SKIP() << "NOT TESTED: no " << file << " (docs/building.md)";
  }
  const TemporaryFolder folder;
  const auto model = folder.path() / "tiny.onnx";
  write_file_atomic(model, onnx_model({.channels = 12}));
  const OpenedNetwork opened = open_network({model, sha256_file(model)}, {plugins});
  const FlatGround ground;
  const LocalFrame frame(kOrigin);
  const CameraModel camera = flight_camera().camera;
  const auto matcher = make_descriptor_matcher({camera, landscape_tiles(), frame, ground}, opened.network);
  const Moment& moment = short_flight()[1];
  AnchorPrior prior;
  prior.search.pose = moment.truth;
  prior.search.pose.position.east_m += 25;
  prior.search.pose.position.north_m -= 18;
  prior.search.radius_m = 60;
  prior.search.heading_range_rad = 0.06;
  prior.search.scale_range = 0.04;
  prior.heading_sigma_rad = 0.02;
  prior.log_agl_sigma = 0.015;
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 1e-4;
  const AnchorMatch match = matcher->match(moment.image, prior);
  ASSERT_TRUE(match.solved);
  EXPECT_LT(distance_m(match.solved->pose.position, moment.truth.position), 5);
}

TEST(SecondMatcherCheck, SaysWhyAModelIsNotUsed) {
  const TemporaryFolder folder;
  const auto model = folder.path() / "tiny.onnx";
  write_file_atomic(model, onnx_model());
  const auto check = [&](const NetworkFile& file, const SecondLikelihoodTable& measured) {
    return check_second_matcher(
        file, {FAKE_NETWORK_PLUGINS}, [] { return 0.0; }, measured);
  };
  const SecondMatcherCheck missing = check({folder.path() / "none.onnx", std::nullopt}, table());
  EXPECT_FALSE(missing.network);
  ASSERT_EQ(missing.findings.items().size(), 1U);
  EXPECT_EQ(missing.findings.items().front().code, "matcher.unusable");
  EXPECT_FALSE(missing.findings.has_errors()) << "the flight goes on without";
  EXPECT_EQ(check({model, std::nullopt}, table()).findings.items().front().code, "matcher.uncalibrated");
  SecondLikelihoodTable measured = table();
  const std::string digest = sha256_file(model).hex();
  measured.network_sha256 = digest;
  const SecondMatcherCheck good = check({model, std::nullopt}, measured);
  EXPECT_TRUE(good.network);
  EXPECT_TRUE(good.findings.empty());
  EXPECT_THAT(good.found, HasSubstr("tiny.onnx (" + digest.substr(0, 12) + "), Fake Runtime"));
  double now_s = 0;
  const SecondMatcherCheck slow = check_second_matcher(
      {model, std::nullopt}, {FAKE_NETWORK_PLUGINS}, [&] { return now_s += 1; }, measured);
  EXPECT_FALSE(slow.network);
  EXPECT_EQ(slow.findings.items().front().code, "matcher.slow");
}

// The table in force was counted with enough looks to say what it says, and the first one's evidence is kept: whatever
// the second sees, an agreement is an agreement.
TEST(SecondLikelihoodTable, IsOfANetworkThatWasMeasured) {
  const SecondLikelihoodTable& in_force = second_likelihood_table();
  if (in_force.network_sha256.empty()) GTEST_SKIP() << "NOT TESTED: no network is calibrated";
  EXPECT_TRUE(Sha256::from_hex(in_force.network_sha256));
  EXPECT_GT(in_force.look.true_looks, 100);
  EXPECT_EQ(bench::numbers_digest(in_force.look), in_force.look.numbers_sha256) << "edited by hand";
  for (const double log_first : {-1.0, 1.0, 5.0}) {
    EXPECT_GE(outcome_evidence(in_force.first, log_first, SecondOutcome::agrees_strongly), 0);
    EXPECT_LE(outcome_evidence(in_force.first, log_first, SecondOutcome::differs_strongly), 0);
  }
}

}  // namespace
}  // namespace nadir
