#include "flight_adjustment/tie_tracks.hpp"

#include <algorithm>

using namespace nadir;

namespace {

std::vector<std::vector<std::pair<std::uint32_t, std::uint32_t>>> plain(const std::vector<TieTrack>& tracks) {
  std::vector<std::vector<std::pair<std::uint32_t, std::uint32_t>>> result;
  for (const TieTrack& track : tracks) {
    auto& one = result.emplace_back();
    for (const TieObservation& o : track) one.emplace_back(o.frame, o.feature);
  }
  return result;
}

}  // namespace

TEST(TieTracks, MatchesInARowAreOnePoint) {
  const std::vector<std::size_t> features{3, 3, 3};
  const std::vector<TiePair> pairs{{0, 1, {{0, 1}, {2, 2}}}, {1, 2, {{1, 0}}}};
  const auto tracks = plain(tie_tracks(features, pairs));
  ASSERT_EQ(tracks.size(), 2U);
  EXPECT_EQ(tracks[0], (std::vector<std::pair<std::uint32_t, std::uint32_t>>{{0, 0}, {1, 1}, {2, 0}}));
  EXPECT_EQ(tracks[1], (std::vector<std::pair<std::uint32_t, std::uint32_t>>{{0, 2}, {1, 2}}));
}

TEST(TieTracks, APointWithTwoFeaturesInAFrameIsDropped) {
  const std::vector<std::size_t> features{2, 1, 1};
  const std::vector<TiePair> pairs{{0, 1, {{0, 0}}}, {1, 2, {{0, 0}}}, {0, 2, {{1, 0}}}};
  EXPECT_TRUE(tie_tracks(features, pairs).empty());
}

TEST(TieTracks, NoPairsNoPoints) {
  EXPECT_TRUE(tie_tracks({}, {}).empty());
  const std::vector<std::size_t> features{5, 0, 7};
  EXPECT_TRUE(tie_tracks(features, {}).empty());
}

// All features of one corner were matched, and one in each other cell.
TEST(TieTracks, ASubsetIsSpreadOverThePictureAndBounded) {
  std::vector<cv::Point2f> points;
  for (int i = 0; i < 300; ++i) points.emplace_back(static_cast<float>(i % 20), static_cast<float>(i / 20));
  for (int c = 0; c < 8; ++c) {
    for (int r = 0; r < 8; ++r) points.emplace_back(static_cast<float>(100 * c + 50), static_cast<float>(100 * r + 50));
  }
  const std::vector<std::vector<cv::Point2f>> frames(2, points);
  std::vector<TieTrack> tracks;
  for (std::uint32_t i = 0; i < points.size(); ++i) tracks.push_back({{0, i}, {1, i}});
  const auto chosen = well_spread(tracks, frames, {800, 800});
  EXPECT_LE(chosen.size(), 70U);
  const auto in_corner =
      std::count_if(chosen.begin(), chosen.end(), [](const TieTrack& t) { return t[0].feature < 300; });
  EXPECT_LE(in_corner, 2);
  EXPECT_GE(chosen.size(), 64U);
}

TEST(TieTracks, LongPointsComeFirst) {
  const std::vector<std::vector<cv::Point2f>> frames(3, {{10, 10}, {11, 11}, {12, 12}});
  const std::vector<TieTrack> tracks{{{0, 0}, {1, 0}}, {{0, 1}, {1, 1}}, {{0, 2}, {1, 2}, {2, 2}}};
  const auto chosen = well_spread(tracks, frames, {800, 800});
  ASSERT_FALSE(chosen.empty());
  EXPECT_EQ(chosen.front().size(), 3U);
}
