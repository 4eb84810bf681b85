// The tables that simulated flights draw from.
#include "bench/measured_looks.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "bench/repeated_looks.hpp"
#include "estimation/map_look.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::bench {
namespace {

const std::filesystem::path kLookTables = NADIR_INTEGRITY_DATA;

constexpr int kMany = 1'000'000;
constexpr MeasuredLooks::Beyond kNeverBeyond = {CountedShare{0, kMany}, CountedShare{0, kMany}, CountedShare{0, kMany}};

MeasuredLook row(const char* ground, WindowKind window, double radius_m, double nats) {
  return {ground, "clear", window, radius_m, {LookOutcome::chance, nats, 0, {3, 8, 3}, {nats - 1, 40, 0, 6}}};
}

std::vector<MeasuredLook> rows() {
  std::vector<MeasuredLook> all;
  for (int i = 0; i < 8; ++i) {
    all.push_back(row("painted 9", WindowKind::holds_place, 60, i));
    all.push_back(row("painted 9", WindowKind::elsewhere, 120, 20 + i));
    all.push_back(row("pair 01", WindowKind::other_map, 250, 40 + i));
  }
  return all;
}

TEST(MeasuredLooks, AFlightDrawsFromItsOwnGroundWhereItHasEnough) {
  const MeasuredLooks looks("a run", rows(), kNeverBeyond);
  const LookPools pools = looks.pools("painted 9", "clear");
  Random random(1);
  for (int i = 0; i < 50; ++i) {
    EXPECT_LT(pools.draw(WindowKind::holds_place, 70, random).log_likelihood_ratio, 8);
    EXPECT_LT(pools.draw(WindowKind::elsewhere, 60, random).log_likelihood_ratio, 28)
        << "another radius of this ground";
    EXPECT_GE(pools.draw(WindowKind::other_map, 60, random).log_likelihood_ratio, 40) << "another ground";
  }
  EXPECT_THAT(looks.grounds_with("clear", true), testing::ElementsAre("painted 9"));
  EXPECT_THROW(looks.grounds_with("clear", false), Error);
  EXPECT_THROW(looks.grounds_with("night", true), Error);
}

TEST(MeasuredLooks, WithoutAnyLookInAKindOfWindowThereIsNothingToDrawFrom) {
  std::vector<MeasuredLook> some = rows();
  std::erase_if(some, [](const MeasuredLook& l) { return l.window == WindowKind::other_map; });
  EXPECT_THROW(MeasuredLooks("a run", some, kNeverBeyond), Error);
}

TEST(MeasuredLooks, ComeBackFromAFileAsTheyWere) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "looks.csv";
  const MeasuredLooks looks("24 looks of a run", rows(), kNeverBeyond);
  write_file_atomic(path, looks.text());
  const MeasuredLooks back = MeasuredLooks::read(path);
  EXPECT_EQ(back.text(), looks.text());
  EXPECT_EQ(back.origin(), "24 looks of a run");
}

TEST(MeasuredLooks, WhatIsNoTableIsAnError) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "looks.csv";
  const std::string text = MeasuredLooks("a run", rows(), kNeverBeyond).text();
  EXPECT_THROW(MeasuredLooks::read(path), Error);
  write_file_atomic(path, "index,ground\n");
  EXPECT_THROW(MeasuredLooks::read(path), UsageError);
  write_file_atomic(path, text.substr(0, text.find('\n') + 1) + "other,columns\n");
  EXPECT_THROW(MeasuredLooks::read(path), UsageError);
  write_file_atomic(path, text.substr(0, text.size() - 5));
  EXPECT_THROW(MeasuredLooks::read(path), Error);
  std::string renamed = text;
  renamed.replace(renamed.find(",c,"), 3, ",x,");
  write_file_atomic(path, renamed);
  EXPECT_THROW(MeasuredLooks::read(path), Error);
}

TEST(MeasuredLooks, ALookIsReducedToWhatAFlightNeeds) {
  Look look;
  look.ground = "naip 2018 2020", look.window = "right", look.picture = "clear", look.radius_m = 150;
  look.patches = 96, look.agl_m = 1000, look.fine_gsd_m = 4, look.camera_sigma_m = 5;
  look.features.inliers = 20;
  look.error_m = 10, look.camera_error_m = 20;
  const MeasuredLook reduced = measured(look);
  EXPECT_EQ(reduced.found.outcome, LookOutcome::place);
  EXPECT_EQ(reduced.radius_m, 60) << "NAIP's distances are 2.5 times as long";
  EXPECT_DOUBLE_EQ(reduced.found.error_m, 8);
  EXPECT_DOUBLE_EQ(reduced.found.sigmas.wrong_consensus_m, 16) << "20 of 96 patches: 10 px of 4 m";
  EXPECT_DOUBLE_EQ(reduced.found.sigmas.solved_m, 2);
  EXPECT_FALSE(reduced.found.has_rival());
  look.features.ratio = 0.99, look.features.inliers = 80, look.features.inlier_share = 0.9, look.features.score = 0.6;
  look.coarse_gsd_m = 5, look.rival_apart_m = 100, look.rival_error_m = 90;
  const LookFinding alike = measured(look).found;
  ASSERT_TRUE(alike.has_rival());
  EXPECT_DOUBLE_EQ(alike.rival.log_likelihood_ratio, alike.log_likelihood_ratio + rival_log_odds(0.99));
  EXPECT_DOUBLE_EQ(alike.rival.apart_m, 40);
  EXPECT_DOUBLE_EQ(alike.rival.error_m, 36);
  EXPECT_DOUBLE_EQ(alike.rival.searched_m, 12) << "6 px of 5 m";
  EXPECT_NEAR(alike.sigmas.wrong_consensus_m, 16 * (0.95 - 80 / 96.0) / 0.15, 1e-9)
      << "80 of 96, where another place is as likely";
  look.features.inliers = 70;
  EXPECT_DOUBLE_EQ(measured(look).found.sigmas.wrong_consensus_m, 16) << "70 of 96";
  look.rival_error_m = 900;
  EXPECT_EQ(measured(look).found.rival.error_m, 0) << "far from the place, in any direction";
  look.features.ratio = 0.3;
  EXPECT_FALSE(measured(look).found.has_rival()) << "nothing looks like the place";
  look.features.ratio = 0.99;
  look.error_m = look.camera_error_m = 800;
  EXPECT_EQ(measured(look).found.outcome, LookOutcome::chance);
  EXPECT_EQ(measured(look).found.error_m, 0) << "anywhere in the window";
  look.error_m = look.camera_error_m = -1;
  EXPECT_EQ(measured(look).found.outcome, LookOutcome::none);
}

// Sixteen pictures of eight looks, in one of which every look claims to be right.
Looks knocked_out_looks() {
  Looks looks;
  for (std::uint64_t i = 0; i < 128; ++i) {
    Look& look = looks[i];
    look.index = i;
    look.ground = "painted 9", look.picture = "clear", look.radius_m = 60, look.fine_gsd_m = 1;
    look.window = i % 8 == 0 ? "right" : i % 2 == 0 ? "elsewhere" : "mirrored";
    look.error_m = look.camera_error_m = 300;
    look.features.inliers = i / 8 == 3 ? 80 : 3, look.features.inlier_share = 0.8, look.features.ratio = 0.9;
    look.features.score = i / 8 == 3 ? 0.6 : 0.1, look.features.residual_px = 1;
  }
  return looks;
}

TEST(MeasuredLooks, OneWeakChancePeakStandsForSomeAndLooksOfOnePictureForLess) {
  const Looks all = knocked_out_looks();
  ASSERT_GT(log_likelihood_ratio(all.at(25).features), 0);
  ASSERT_LT(log_likelihood_ratio(all.at(1).features), -1);
  const MeasuredLooks reduced = MeasuredLooks::reduced("made up", all);
  int count = 0;
  for (const MeasuredLook& look : reduced.all()) count += look.count;
  EXPECT_EQ(count, 128);
  EXPECT_LT(reduced.all().size(), 30U);
  const LookTail& other = reduced.tails()[static_cast<std::size_t>(WindowKind::other_map)];
  EXPECT_EQ(other.beyond.count, 0);
  EXPECT_LT(other.beyond.of, 16) << "64 looks, and what claims is one picture";
  EXPECT_DOUBLE_EQ(other.rate, (CountedShare{0, other.beyond.of}.upper()));
}

TEST(MeasuredLooks, ATailClaimsMoreThanTheStrongest) {
  const MeasuredLooks looks("a run", rows(), {CountedShare{1, 1}, CountedShare{1, 1}, CountedShare{1, 1}});
  const LookPools pools = looks.pools("painted 9", "clear");
  Random random(1);
  double sum = 0;
  for (int i = 0; i < 1000; ++i) {
    const LookFinding found = pools.draw(WindowKind::holds_place, 60, random);
    EXPECT_GE(found.log_likelihood_ratio, 7);
    sum += found.log_likelihood_ratio - 7;
  }
  EXPECT_NEAR(sum / 1000, 1, 0.15) << "exponential";
}

TEST(MeasuredLooks, ARowIsDrawnAsOftenAsItsCountSays) {
  std::vector<MeasuredLook> all = rows();
  for (MeasuredLook& look : all) look.count = look.found.log_likelihood_ratio == 0 ? 93 : 1;
  const MeasuredLooks looks("a run", all, kNeverBeyond);
  const LookPools pools = looks.pools("painted 9", "clear");
  Random random(1);
  int zeros = 0;
  for (int i = 0; i < 1000; ++i) {
    zeros += pools.draw(WindowKind::holds_place, 60, random).log_likelihood_ratio == 0 ? 1 : 0;
  }
  EXPECT_NEAR(zeros, 930, 30);
}

// The tables that the project stores are of looks that judge, weighed by the likelihood ratio that the project has.
TEST(MeasuredLooks, TheStoredOnesAreOfTodaysLikelihood) {
  const MeasuredLooks looks = MeasuredLooks::read(kLookTables / "measured_looks.csv");
  EXPECT_THAT(looks.origin(), testing::HasSubstr(std::string(look_likelihood_table().numbers_sha256.substr(0, 16))))
      << "weigh them again: ./run bench integrity --part table --from LOOKS.csv";
  EXPECT_THAT(looks.origin(), testing::HasSubstr("base seed 8000000"));
  EXPECT_GT(RepeatRates::read(kLookTables / "repeated_looks.csv").again(0.1), 0.1);
}

// ---- Looks in a row

RepeatedLook twice(double nats, double off_m, double again_m) {
  RepeatedLook look;
  look.ground = "painted 9", look.window = "mirrored", look.picture = "clear";
  look.new_ground = 0.25;
  look.first = {true, false, nats, {off_m, 0}, 5};
  look.second = {true, false, nats + 1, {again_m, 0}, 5};
  return look;
}

// σ of both 5 m: the disc ends at 17.3 m, the ring at 26.3 m.
TEST(RepeatedLooks, WhatLiesInTheDiscLessWhatLiesThereByAccidentIsSeenAgain) {
  RepeatedLooks looks;
  for (std::uint64_t i = 0; i < 100; ++i) {
    looks[i] = twice(-2, 100, i < 40 ? 110 : i < 60 ? 120 : 200);
  }
  looks[100] = twice(-2, 100, 100);
  looks[100].second.right = true;  // the place was found: no chance peak any more
  const RepeatRates rates("a run", looks);
  EXPECT_EQ(rates.bin(0.25).chance, 101);
  EXPECT_EQ(rates.bin(0.25).disc, 40);
  EXPECT_EQ(rates.bin(0.25).ring, 20);
  const double by_accident = 5.991 / (13.816 - 5.991) * CountedShare{20, 101}.lower();
  EXPECT_NEAR(rates.again(0.25), (CountedShare{40, 101}.upper()) - by_accident, 1e-12);
  EXPECT_EQ(rates.again(1), 1) << "nothing was counted: nothing is known";
  EXPECT_THAT(rates.table(), testing::HasSubstr("| 0.25 | 101 | 40 | 20 | "));
}

TEST(RepeatedLooks, TheSecondWeightFollowsTheFirst) {
  RepeatedLooks looks;
  for (std::uint64_t i = 0; i < 100; ++i) {
    const double first = static_cast<double>(i % 10) - 5;
    looks[i] = twice(first, 100, 103);
    looks[i].second.log_likelihood_ratio = 0.5 * first - 1 + (i < 50 ? 0.25 : -0.25);
  }
  const RepeatRates rates("a run", looks);
  EXPECT_NEAR(rates.slope(), 0.5, 1e-9);
  Random random(1);
  for (int i = 0; i < 20; ++i) {
    const RepeatRates::Draw draw = rates.draw(6, random);
    EXPECT_NEAR(std::abs(draw.log_likelihood_ratio - 2), 0.25, 1e-9);
    EXPECT_NEAR(draw.moved_m, 3, 1e-9);
  }
}

TEST(RepeatedLooks, WithoutAnyRepeatThereIsNothingToDrawFrom) {
  RepeatedLooks looks;
  looks[0] = twice(-2, 100, 200);
  EXPECT_THROW(RepeatRates("a run", looks), Error);
}

TEST(RepeatedLooks, ALineComesBackAsItWasAndAPartOfOneIsAnError) {
  const std::string text = line(twice(1.25, 100, 110));
  EXPECT_EQ(line(repeated_look_of(text)), text);
  EXPECT_THROW(repeated_look_of(text.substr(0, text.size() / 2)), Error);
}

TEST(RepeatedLooks, TheTableComesBackAsItWasAndAPartOfOneIsAnError) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "repeats.csv";
  RepeatedLooks looks;
  for (std::uint64_t i = 0; i < 10; ++i) looks[i] = twice(static_cast<double>(i) / 4, 100, i < 7 ? 100 : 200);
  const std::string text = RepeatRates("10 pairs of a run", looks).text();
  write_file_atomic(path, text);
  EXPECT_EQ(RepeatRates::read(path).text(), text);
  EXPECT_EQ(RepeatRates::read(path).table(), RepeatRates("", looks).table());
  for (const std::size_t end : {text.size() - 6, text.find("first_nats"), text.find("0.25,") + 7}) {
    write_file_atomic(path, text.substr(0, end));
    EXPECT_THROW(RepeatRates::read(path), Error) << end;
  }
  EXPECT_THROW(RepeatRates::read(kLookTables / "measured_looks.csv"), UsageError);
}

}  // namespace
}  // namespace nadir::bench
