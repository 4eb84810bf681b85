// The numbers that decide in libgeo/navigability: value, unit, and where each comes from. [navigability] is the bench
// of that name in docs/benchmarks.md: fitted to flights over the simulated worlds of seeds 1 to 11, judged on others.
#pragma once

#include <array>
#include <cstddef>

namespace nadir::parameters::navigability {

// ---- looks

inline constexpr int kProbesPerLook = 4;               // of other noise each; a quarter of the scatter of one; chosen
inline constexpr double kHeightStep = 0.05;            // heights that differ by less, relative, share a probe; chosen
inline constexpr double kLeastFootprint_px = 10;       // of a probe, on a side; numerical
inline constexpr std::size_t kTextureSamples = 200;    // places of the route that its typical texture is of; chosen
inline constexpr double kLeastLookScore = 0.02;        // a correlation below it is none; its logarithm stays bounded
inline constexpr double kSmallFootprint_px = 200;      // a frame of fewer pixels of the map is called small; chosen
inline constexpr double kLookOffset = -5.031;          // ln odds of an anchor; [navigability]
inline constexpr double kLookPerRatio = -3.324;        // likewise, for each unit of the ratio
inline constexpr double kLookPerLogFootprint = 1.613;  // … of the logarithm of the footprint in pixels of the map

// ---- legs

inline constexpr double kGoodLook = 0.95, kPoorLook = 0.5;  // probabilities: from here on good, below it poor; chosen
inline constexpr double kFrameOverlap = 0.7;                // of neighbouring frames, where no spacing is given; chosen
inline constexpr double kLeastSpacing_m = 5;                // … and at least so far apart; chosen
inline constexpr double kShortLeg_m = 60;                   // a shorter section does not interrupt a leg; chosen
inline constexpr std::array kHeightTrials{1.5, 2.0, 0.7};   // times the planned height, as remedies; chosen
inline constexpr double kUsefulGain = 0.2;                  // in probability: a remedy is worth naming; chosen
inline constexpr std::size_t kRemedySamples = 5;            // places of a leg where remedies are tried; chosen

// ---- protection level

inline constexpr double kProtectionShare = 0.9;  // of flights that stay below the level; chosen
// Misses of frames 45 m apart correlate by 0.39: as much as independent looks every 45 m (1 + 0.39) / (1 - 0.39).
inline constexpr double kLookCorrelation_m = 100;
inline constexpr double kAnchoredProtection_m = 28;  // after several anchors; [navigability], 90 %
inline constexpr double kProtectionPerMetre = 0.12;  // of distance since the last anchor; [navigability]
inline constexpr double kUnanchoredStart_m = 500;    // before the first look, a flight is as far from an anchor

}  // namespace nadir::parameters::navigability
