// What the service asks of candidates before it keeps them, and of votes before it promotes them. Every figure that can
// be set stands here with its default; docs/commands/candidates-serve.md says what each is for.
#pragma once

#include <cstdint>

namespace nadir {

inline constexpr std::int64_t kDay_ms = std::int64_t{24} * 3600 * 1000;
inline constexpr double kCe90OverSigma = 2.146;  // mathematics: √(-2 ln(1 - 0.9)), of one axis' sigma

struct CandidateRules {
  int min_zoom = 12;
  int max_zoom = 22;
  std::uint64_t min_tile_bytes = 200;
  std::uint64_t max_tile_bytes = 256 * 1024;

  std::int64_t max_clock_error_ms = 5 * 60'000;  // what a capture time may lie ahead of our clock
  std::int64_t max_age_ms = std::int64_t{90} * 24 * 3600 * 1000;
  std::int64_t max_sigma_mm = 5'000;
  std::int64_t max_anchor_age_ms = 10'000;
  double max_view_angle_rad = 1.05;  // of a tile's worst corner off nadir, 60°: flatter views are not orthorectified

  std::int64_t min_contrast_ppm = 15'000;      // standard deviation of the grey levels, of 255: 4 levels
  std::int64_t min_sharpness_ppm = 100'000;    // blurred by some 3 pixels has 80 000, sharp ones 260 000 and more
  std::int64_t max_clipped_ppm = 300'000;      // black or blown out
  std::int64_t min_correlation_ppm = 350'000;  // of two aligned images: below it nothing is concluded
  double sigmas = 3;                           // two places may lie apart by so many standard deviations
  std::int64_t floor_mm = 1'500;               // and by this anyway: pixels, terrain

  std::int64_t quota_bytes = std::int64_t{8} << 30;  // that an airframe may announce in quota_window_ms
  std::int64_t quota_window_ms = std::int64_t{24} * 3600 * 1000;
  std::int64_t catalogue_bytes = 4'096;  // that every tile counts besides its own: what the catalogue keeps of it
  std::int64_t refused_batches = 500;    // as a whole, that a client may announce in quota_window_ms

  int flights_to_promote = 2;                             // that must agree
  bool airframes_differ = true;                           // else: other airframes, or other days: one key promotes
  std::int64_t apart_ms = std::int64_t{6} * 3600 * 1000;  // that flights of one airframe lie apart at least
};

}  // namespace nadir
