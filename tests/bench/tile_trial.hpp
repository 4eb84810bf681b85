// A short simulated flight whose frames become tiles, and the true place of these tiles: against the world's own
// raster, and by the true pose. Positions in metres.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "safety_flight.hpp"

namespace nadir::bench {

struct TileOff {
  bool refined = false;     // made with the smoothed poses; otherwise with those of the flight
  double geometric_m = 0;   // of its pixels, against the true pose
  double raster_m = 0;      // against the world's raster, by correlation; -1: not recognised
  double pose_error_m = 0;  // of its frame
  double sigma_m = 0;       // stated
};

struct TileTrial {
  std::uint64_t index = 0;
  std::string condition;
  int frames = 0, anchored = 0;
  std::vector<TileOff> tiles;
};

inline constexpr int kTileTrialZoom = 18;  // 0.39 m

std::string tile_trial_header(std::uint64_t seed, int worlds);
std::string line(const TileTrial& trial);
TileTrial tile_trial_of(const std::string& line);

class TileTrials {
 public:
  explicit TileTrials(int worlds);
  TileTrial fly(std::uint64_t base_seed, std::uint64_t index) const;

 private:
  Photographer photographer_;
  Worlds worlds_;
};

}  // namespace nadir::bench
