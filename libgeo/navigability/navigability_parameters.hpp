// The numbers that decide in libgeo/navigability: value, unit, and where each comes from. [navigability] is the bench
// of that name in docs/benchmarks.md: fitted to flights over the simulated worlds of seeds 1 to 11 (levels: 1 to 4),
// judged on others.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace nadir::parameters::navigability {

// ---- looks

inline constexpr int kProbesPerLook = 4;             // of other noise each; a quarter of the scatter of one; chosen
inline constexpr double kHeightStep = 0.05;          // heights that differ by less, relative, share a probe; chosen
inline constexpr double kLeastFootprint_px = 10;     // of a probe, on a side; numerical
inline constexpr std::size_t kTextureSamples = 200;  // places of the route that its typical texture is of; chosen
inline constexpr double kLeastLookScore = 0.02;      // a correlation below it is none; its logarithm stays bounded
// Ground whose probes correlate with itself by less shows nothing: of 123 looks at such ground none anchored;
// [navigability], seeds 101 to 103 and lakes of 201 to 208.
inline constexpr double kBareScore = 0.05;
inline constexpr double kSmallFootprint_px = 200;      // a frame of fewer pixels of the map is called small; chosen
inline constexpr double kLookOffset = -5.031;          // ln odds of an anchor; [navigability]
inline constexpr double kLookPerRatio = -3.324;        // likewise, for each unit of the ratio
inline constexpr double kLookPerLogFootprint = 1.613;  // … of the logarithm of the footprint in pixels of the map

// ---- legs

inline constexpr double kGoodLook = 0.95, kPoorLook = 0.5;  // of flights: from here on good, below it poor; chosen
inline constexpr double kFrameOverlap = 0.7;                // of neighbouring frames, where no spacing is given; chosen
inline constexpr double kLeastSpacing_m = 5;                // … and at least so far apart; chosen
inline constexpr double kShortLeg_m = 60;                   // a shorter section does not interrupt a leg; chosen
inline constexpr std::array kHeightTrials{1.5, 2.0, 0.7};   // times the planned height, as remedies; chosen
inline constexpr double kUsefulGain = 0.2;                  // in probability: a remedy is worth naming; chosen
inline constexpr std::size_t kRemedySamples = 5;            // places of a leg where remedies are tried; chosen

// ---- protection level

inline constexpr double kProtectionShare = 0.9;    // of flights that stay below the level; chosen
inline constexpr std::size_t kDrawnFlights = 200;  // their 0.9 quantile is that of 180 of them, ± 4; chosen
inline constexpr std::uint64_t kForecastSeed = 1;  // of the drawn flights
inline constexpr double kStartError_m = 5;         // of a given start, one axis; chosen: a GPS, or a click on the map
inline constexpr double kUsualSpeed_mps = 20;      // where no speed is given: a small fixed wing; chosen
// Way over which a look's luck is forgotten to 1/e; chosen: misses 45 m apart correlate by 0.39, and 70 m gives much
// the same.
inline constexpr double kLookCorrelation_m = 100;
// A look's candidate is the true place up to so much beyond the log odds of an anchor: weak ones need others. Its ln ℓ,
// and their scatter; 291 looks of the worlds 1 to 4, [navigability].
inline constexpr double kFoundLogit = 1.0;
inline constexpr double kEvidenceOffset = 1.5, kEvidencePerLogit = 2.3, kEvidenceScatter = 1.2;
// Of a look that found nothing: how often it has a chance peak, and its ln ℓ; chosen, as the few of those looks have
// it.
inline constexpr double kChancePeak = 0.5, kChanceEvidence = -0.5, kChanceEvidenceScatter = 1.8;
// ln ℓ from which most patches agree, so that no wrong consensus is allowed for; [navigability].
inline constexpr double kMostPatchesEvidence = 6;
// σ of an accepted position, one axis, over the height above ground: what the image leaves of the tilt; [navigability].
inline constexpr double kSolvedShare = 0.009;
// Overlap of neighbouring frames, in the direction of flight, up to which odometry never tracks and from which it
// always does; [navigability]: of frames that share 0.23 about half.
inline constexpr double kLeastTrackedOverlap = 0.1, kSureTrackedOverlap = 0.4;
// Over so many footprints of good ground every start is confirmed: no warning of its own; chosen, not measured.
inline constexpr double kUsualStartFootprints = 4;

}  // namespace nadir::parameters::navigability
