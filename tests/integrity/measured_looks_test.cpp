// The tables that simulated flights draw from.
#include "bench/measured_looks.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "bench/repeated_looks.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::bench {
namespace {

const std::filesystem::path kLookTables = NADIR_INTEGRITY_DATA;

MeasuredLook row(const char* ground, WindowKind window, double radius_m, double nats) {
  return {ground, "clear", window, radius_m, LookOutcome::chance, nats, 0, {3, 8, 3}};
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
  const MeasuredLooks looks("a run", rows());
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
  EXPECT_THROW(MeasuredLooks("a run", some), Error);
}

TEST(MeasuredLooks, ComeBackFromAFileAsTheyWere) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "looks.csv";
  const MeasuredLooks looks("24 looks of a run", rows());
  write_file_atomic(path, looks.text());
  const MeasuredLooks back = MeasuredLooks::read(path);
  EXPECT_EQ(back.text(), looks.text());
  EXPECT_EQ(back.origin(), "24 looks of a run");
}

TEST(MeasuredLooks, WhatIsNoTableIsAnError) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "looks.csv";
  const std::string text = MeasuredLooks("a run", rows()).text();
  EXPECT_THROW(MeasuredLooks::read(path), Error);
  write_file_atomic(path, "index,ground\n");
  EXPECT_THROW(MeasuredLooks::read(path), UsageError);
  write_file_atomic(path, text.substr(0, text.find('\n') + 1) + "other,columns\n");
  EXPECT_THROW(MeasuredLooks::read(path), UsageError);
  write_file_atomic(path, text.substr(0, text.size() - 5));
  EXPECT_THROW(MeasuredLooks::read(path), Error);
  std::string renamed = text;
  renamed.replace(renamed.find("chance"), 6, "change");
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
  EXPECT_EQ(reduced.outcome, LookOutcome::place);
  EXPECT_EQ(reduced.radius_m, 60) << "NAIP's distances are 2.5 times as long";
  EXPECT_DOUBLE_EQ(reduced.error_m, 8);
  EXPECT_DOUBLE_EQ(reduced.sigmas.wrong_consensus_m, 16) << "20 of 96 patches: 10 px of 4 m";
  EXPECT_DOUBLE_EQ(reduced.sigmas.solved_m, 2);
  look.error_m = look.camera_error_m = 800;
  EXPECT_EQ(measured(look).outcome, LookOutcome::chance);
  EXPECT_EQ(measured(look).error_m, 0) << "anywhere in the window";
  look.error_m = look.camera_error_m = -1;
  EXPECT_EQ(measured(look).outcome, LookOutcome::none);
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

TEST(RepeatedLooks, APeakIsSeenAgainWhereTheBeliefCannotTellThePlacesApart) {
  EXPECT_TRUE(twice(1, 100, 110).seen_again());
  EXPECT_FALSE(twice(1, 100, 130).seen_again());
  RepeatedLook lost = twice(1, 100, 100);
  lost.second.candidate = false;
  EXPECT_FALSE(lost.seen_again());
}

TEST(RepeatedLooks, RatesAreCountedByNewGroundAndStrength) {
  RepeatedLooks looks;
  for (std::uint64_t i = 0; i < 10; ++i) {
    looks[i] = twice(-2, 100, i < 3 ? 100 : 200);
    looks[100 + i] = twice(3, 100, i < 6 ? 100 : 200);
  }
  const RepeatRates rates(looks);
  EXPECT_EQ(rates.bin(0.25).weak_again.count, 3);
  EXPECT_EQ(rates.bin(0.25).weak_again.of, 10);
  EXPECT_EQ(rates.strong_again(0.1).count, 6);
  EXPECT_EQ(rates.strong_again(1).of, 0);
  EXPECT_EQ(rates.again(0.25, false), (CountedShare{3, 10}.upper()));
  EXPECT_EQ(rates.again(1, true), 1) << "nothing was counted: nothing is known";
  ASSERT_EQ(rates.changes(true).size(), 6U);
  EXPECT_NEAR(rates.changes(true)[0].nats, 1, 1e-9);
  EXPECT_NEAR(rates.changes(true)[0].moved_m, 0, 1e-9);
}

TEST(RepeatedLooks, WithoutAnyRepeatThereIsNothingToDrawFrom) {
  RepeatedLooks looks;
  looks[0] = twice(-2, 100, 200);
  EXPECT_THROW(RepeatRates{looks}, Error);
}

TEST(RepeatedLooks, ALineComesBackAsItWasAndAPartOfOneIsAnError) {
  const std::string text = line(twice(1.25, 100, 110));
  EXPECT_EQ(line(repeated_look_of(text)), text);
  EXPECT_THROW(repeated_look_of(text.substr(0, text.size() / 2)), Error);
  EXPECT_THROW(read_repeated_looks(kLookTables / "measured_looks.csv"), UsageError);
}

}  // namespace
}  // namespace nadir::bench
