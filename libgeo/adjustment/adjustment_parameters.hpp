// The numbers that decide in libgeo/adjustment and libgeo/flight_adjustment: value, unit, and where each comes from.
// Nothing else in these folders holds one. [adjustment] is the bench of that name in docs/benchmarks.md, of November
// 2026. "Chosen": an engineer's estimate. "Numerical": guards degenerate cases and stops iterations.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace nadir::parameters::adjustment {

// ---- measurements, 1-sigma

inline constexpr double kObservationSigma_px = 0.5;   // of a tie point's pixel; SIFT matches scatter by 0.3 to 0.7
inline constexpr double kFixSigma_m = 5.0;            // of the place on the map that a person clicks; desk.md
inline constexpr double kClickSigma_px = 3.0;         // of a person's click in an image; chosen
inline constexpr double kTerrainSigma_m = 10.0;       // of a point above or below the model: buildings, trees; chosen
inline constexpr double kTerrainCorrelation_m = 250;  // points closer than this err alike: datum, wood, town; chosen
inline constexpr double kMotionSigma_m = 2.0;         // of a step between frames, at least; chosen
inline constexpr double kMotionSigmaShare = 0.2;      // … and so much of its length: dead reckoning with wind; chosen
inline constexpr double kUnmeasuredAttitudeSigma_rad = 1.0;  // of the start of an attitude, where none was measured
inline constexpr double kUnmeasuredHeightSigma = 1.0;        // likewise of a height's logarithm

// ---- calibration, 1-sigma before the adjustment

inline constexpr double kFocalSigma = 0.03;          // relative; a lens by its data sheet; chosen
inline constexpr double kRadialSigma = 0.05;         // k1, k2, k3; chosen
inline constexpr double kTangentialSigma = 0.002;    // p1, p2; chosen
inline constexpr double kBoresightSigma_rad = 0.03;  // camera against autopilot, each axis; chosen
inline constexpr double kHeightScaleSigma = 0.02;    // what all heights have in common, relative; chosen

// ---- robustness

// Of the graduated rounds: the bounds of anchors (χ²) and of tie points (sigma) are so many times wider. The first
// rounds are nearly least squares, and find the way from a start that is hundreds of metres off.
inline constexpr std::array<double, 4> kAnchorWidening{4096, 256, 16, 1};
inline constexpr std::array<double, 4> kObservationWidening{64, 16, 4, 1};
inline constexpr double kAnchorBound = 9.21;  // χ² with 2 degrees of freedom, 99 %: below it an anchor counts fully
inline constexpr double kAnchorSwitchOff = 13.8;      // 99.9 %: beyond it an anchor is switched off
inline constexpr double kPoseAnchorBound = 16.8;      // likewise of whole poses, 6 degrees of freedom …
inline constexpr double kPoseAnchorSwitchOff = 22.5;  // … 99.9 %
inline constexpr double kObservationHuber = 3.0;    // sigmas, from where a tie point's residual counts linearly; chosen
inline constexpr double kObservationReject = 16.0;  // χ² with 2 degrees of freedom, 99.97 %; chosen
// A point farther from the terrain model, in sigmas, is a tower or a false match along its rays: the terrain then says
// (nearly) nothing about it, its sigma being so many times larger; chosen.
inline constexpr double kTerrainOutlier = 4.0, kTerrainOutlierWidening = 100;
inline constexpr int kDecisionRounds = 3;     // of switching anchors and rejecting observations; chosen
inline constexpr std::size_t kWellTied = 12;  // observations of a frame that needs no motion model; chosen
inline constexpr std::size_t kMinRays = 2;    // of a point without a known place

// ---- iterations

inline constexpr int kAnnealingIterations = 12;      // of each graduated round; chosen
inline constexpr int kFinalIterations = 25;          // of each round of decisions; chosen
inline constexpr double kAnnealingTolerance = 1e-4;  // relative change of the cost; chosen
inline constexpr double kFinalTolerance = 1e-8;      // likewise
// Trust regions to begin with, Ceres' unit. A small one damps what the block determines only weakly (focal length
// against height, bending) so much that the cost seems to stand still far from the optimum. Only the first round starts
// far off.
inline constexpr double kFarTrustRegion = 1e5, kNearTrustRegion = 1e10;  // [adjustment]
inline constexpr double kParameterTolerance = 1e-10;                     // numerical
inline constexpr double kGradientTolerance = 1e-12;                      // numerical
inline constexpr double kGaugeSigma_m = 0.01;  // holds the first frame of a floating block; numerical

// ---- geometry

inline constexpr double kMinDepth_m = 1.0;        // along the optical axis; nearer or behind, nothing is seen
inline constexpr double kSlopeBaseline_m = 5.0;   // to each side, of the terrain's slope; half a post of a 10 m model
inline constexpr double kLensMargin = 1.05;       // times the image's corner, up to where the lens' polynomial is used
inline constexpr double kSmallTurn_rad = 1e-4;    // below it a rotation's series ends after the second term; numerical
inline constexpr double kMaxAgl_m = 30'000;       // of a start; as in the telemetry's checks
inline constexpr double kMaxPlane_m = 1'000'000;  // from the origin: the plane is no map of more; chosen

// ---- objects

inline constexpr double kMarchShare = 0.2;          // of the clearance above ground: a step along the ray; chosen
inline constexpr double kMarchLeast_m = 1.0;        // … at least: a tenth of a model's post
inline constexpr double kMarchMost_m = 50.0;        // … at most
inline constexpr double kMaxRange_m = 20'000;       // along the ray; as for objects of nadird
inline constexpr int kHitBisections = 40;           // from a step to below a micrometre; numerical
inline constexpr std::size_t kMaxSightings = 32;    // of one object: bounds the time; more add nothing
inline constexpr int kObjectIterations = 20;        // Gauss-Newton; a handful suffice
inline constexpr double kObjectConverged_m = 1e-4;  // step; numerical
inline constexpr double kMinParallax_rad = 0.02;    // between rays of which none meets the ground; chosen
inline constexpr double kAgreement = 3.09;         // one-sided normal quantile of 99.9 %: clicks beyond it do not agree
inline constexpr double kChi2Of95 = 5.991;         // χ² with 2 degrees of freedom: the 95 % ellipse
inline constexpr double kRotationStep_rad = 1e-6;  // of numeric derivatives of an attitude; numerical

}  // namespace nadir::parameters::adjustment

// Tie points from pictures.
namespace nadir::parameters::ties {

// Longer side at which pictures are compared: a pixel is 0.1 % of the height above ground, and SIFT costs 0.1 s;
// chosen.
inline constexpr double kWorkingSide_px = 900;
inline constexpr int kDetectedFeatures = 1500;     // the strongest, of which …
inline constexpr std::size_t kKeptFeatures = 600;  // … so many are kept, spread over the picture; bounds the memory
inline constexpr std::size_t kGridColumns = 10, kGridRows = 8;  // of that spread; chosen
inline constexpr std::size_t kNextFrames = 2;      // a frame is compared with so many after it: over an outlier as well
inline constexpr std::size_t kPassGap = 3;         // frames of one pass over the ground follow each other this closely
inline constexpr std::size_t kPassesPerFrame = 4;  // other passes that a frame is compared with; bounds the time
inline constexpr double kOverlapShare = 0.6;       // of a footprint's longer side between two that overlap; chosen
inline constexpr double kStepSigmaShare = 0.05;    // of a step that odometry tracked: its σ; chosen
inline constexpr double kReachSigmas = 3;          // around where a feature is expected
inline constexpr double kLeastReach = 0.05;        // … at least and at most, of the longer side; chosen
inline constexpr double kMostReach = 0.7;
inline constexpr double kRivalReach = 0.2;  // of the width: nothing this near may look nearly as much alike; chosen
inline constexpr double kCell_px = 30;      // of the grid in which features are found; numerical
inline constexpr double kTieRatio = 0.8;    // nearest over second nearest descriptor (Lowe 2004)
inline constexpr std::int32_t kMostDistance2 = 350 * 350;  // of descriptors of length 512: beyond, unlike; chosen
inline constexpr std::size_t kLeastAgreeing = 12;          // matches of a pair on one homography; as odometry's
inline constexpr double kLeastAgreeingShare = 0.3;         // … and of its matches; chosen
inline constexpr double kMostParallax_px = 12;             // of relief that a homography's bound allows for; chosen
inline constexpr std::size_t kSpreadCells = 8;             // a side: cells of a picture that each want a point …
inline constexpr std::size_t kSpreadDepth = 2;             // … and a second one where there is room
inline constexpr std::size_t kObservationsPerFrame = 70;   // desk.md's 200 000 for 3000 frames

}  // namespace nadir::parameters::ties

// A flight into a block.
namespace nadir::parameters::flight_adjustment {

inline constexpr double kMostAnchorLogHeight = 1;      // of a look, over the telemetry's height; beyond: not credible
inline constexpr double kMostAnchorTilt_rad = 1;       // likewise, beyond the telemetry's tilt
inline constexpr double kLeastAnchorVariance = 1e-12;  // numerical
inline constexpr double kLeastCorrelation = 1e-9;      // eigenvalue of an anchor's correlations; numerical
inline constexpr double kLeastFixSigma_m = 0.5;        // nobody clicks better on a map; chosen

}  // namespace nadir::parameters::flight_adjustment
