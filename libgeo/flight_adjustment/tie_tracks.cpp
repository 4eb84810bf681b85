#include "flight_adjustment/tie_tracks.hpp"

#include <algorithm>
#include <array>

#include "adjustment/adjustment_parameters.hpp"
#include "base/disjoint_sets.hpp"

namespace nadir {
namespace {

using namespace parameters::ties;

}  // namespace

std::vector<TieTrack> tie_tracks(std::span<const std::size_t> features, std::span<const TiePair> pairs) {
  std::vector<std::uint32_t> first(features.size() + 1, 0);
  for (std::size_t i = 0; i < features.size(); ++i) first[i + 1] = first[i] + static_cast<std::uint32_t>(features[i]);
  DisjointSets<std::uint32_t> sets(first.back());
  for (const TiePair& pair : pairs) {
    for (const FeatureMatch& match : pair.matches) {
      sets.join(first[pair.a] + static_cast<std::uint32_t>(match.first),
                first[pair.b] + static_cast<std::uint32_t>(match.second));
    }
  }
  std::vector<std::uint32_t> track_of(first.back(), UINT32_MAX);
  std::vector<TieTrack> tracks;
  std::vector<bool> torn;
  for (std::uint32_t frame = 0; frame < features.size(); ++frame) {
    for (std::uint32_t i = 0; i < features[frame]; ++i) {
      const std::uint32_t root = sets.root(first[frame] + i);
      if (track_of[root] == UINT32_MAX) {
        track_of[root] = static_cast<std::uint32_t>(tracks.size());
        tracks.emplace_back();
        torn.push_back(false);
      }
      TieTrack& track = tracks[track_of[root]];
      if (!track.empty() && track.back().frame == frame) torn[track_of[root]] = true;
      track.push_back({frame, i});
    }
  }
  std::vector<TieTrack> sound;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    if (!torn[i] && tracks[i].size() >= 2) sound.push_back(std::move(tracks[i]));
  }
  return sound;
}

std::vector<TieTrack> well_spread(std::vector<TieTrack> tracks, std::span<const std::vector<cv::Point2f>> points,
                                  cv::Size size) {
  std::stable_sort(tracks.begin(), tracks.end(),
                   [](const TieTrack& a, const TieTrack& b) { return a.size() > b.size(); });
  struct Frame {
    std::array<std::uint8_t, kSpreadCells * kSpreadCells> in_cell{};
    std::size_t count = 0;
  };
  std::vector<Frame> frames(points.size());
  const auto cell_of = [&](const TieObservation& o) {
    const cv::Point2f& at = points[o.frame][o.feature];
    const auto along = [](float x, int side) {
      const auto cell = static_cast<std::size_t>(std::max(0.F, x) * kSpreadCells / static_cast<float>(side));
      return std::min(kSpreadCells - 1, cell);
    };
    return along(at.y, size.height) * kSpreadCells + along(at.x, size.width);
  };
  std::vector<TieTrack> chosen;
  std::vector<bool> used(tracks.size(), false);
  for (std::size_t depth = 1; depth <= kSpreadDepth; ++depth) {  // points in a cell of the picture
    for (std::size_t t = 0; t < tracks.size(); ++t) {
      if (used[t]) continue;
      std::size_t wanted = 0;
      for (const TieObservation& o : tracks[t]) {
        const Frame& frame = frames[o.frame];
        if (frame.count < kObservationsPerFrame && frame.in_cell[cell_of(o)] < depth) ++wanted;
      }
      if (wanted < 2) continue;
      used[t] = true;
      for (const TieObservation& o : tracks[t]) {
        Frame& frame = frames[o.frame];
        ++frame.count;
        std::uint8_t& in_cell = frame.in_cell[cell_of(o)];
        in_cell = static_cast<std::uint8_t>(std::min(255, in_cell + 1));
      }
    }
  }
  for (std::size_t t = 0; t < tracks.size(); ++t) {
    if (used[t]) chosen.push_back(std::move(tracks[t]));
  }
  return chosen;
}

}  // namespace nadir
