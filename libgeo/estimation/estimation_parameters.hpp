// Every number of the estimator that was tuned, chosen or measured, with its unit and where it comes from. Nothing else
// in this folder holds one; what remains there is mathematics.
//
// Origins, in brackets: [safety N] is segment N of the Monte Carlo in docs/safety.md, [roc] its knock-out test, [turns],
// [consistency], [flights], [ablations] the benches of that name in docs/benchmarks.md, all of November 2026.
// "chosen; not measured" is an engineer's estimate that no bench has varied.
#pragma once

#include <cstddef>

namespace nadir {

// Thresholds of anchor acceptance (estimation/anchor_acceptance.hpp). They come from the knock-out test: search windows
// that do not hold the place, where every acceptance is false by definition.
struct GateLimits {
  // A frame must satisfy two independent criteria: no other place fits as well (ratio), and the patches agree on one
  // pose (inlier share). The weaker the one, the more the other must carry. [roc]: without a prediction 2 of 1194 wrong
  // places still pass alone.
  double clear_ratio = 0.45;         // below: hardly any other place is possible; [roc] 0.3 % of wrong places below 0.40
  double clear_inlier_share = 0.10;  // of the patches tried; [roc]
  double alone_ratio = 0.80;         // below: the frame may anchor on its own …; [roc]
  double alone_inlier_share = 0.20;  // … when so many agree; [roc] 3.2 % of wrong places reach it
  double vote_ratio = 0.90;          // below: only where a healthy prediction agrees; [roc]
  double vote_inlier_share = 0.30;   // [roc] 0.3 % of wrong places reach it
  // Patches that agree by chance are few: then one frame is not enough, unless a sharp prediction corroborates it (its
  // 95 %), or the ratio is clear in a window where many places compete. Patches of a chance consensus also scatter evenly
  // within the solver's bound, as they do about a pose to which half of a changed map pulls; they lie anywhere in the
  // window; and where the tilt is unknown they have two more degrees of freedom. In each of these cases most must agree.
  double sure_inlier_share = 0.40;         // [safety mirrored 286, heading 460]: fewer await votes
  double most_inlier_share = 0.50;         // [safety old map 2220, 2547]
  double max_chance_residual_px = 1.7;     // [roc]: half of the chance consensus lies beyond 1.8 px; [safety 286, 460]
  double expected_chi2 = 5.991;            // 95 % of χ² with two degrees of freedom; [safety outlier 5896] for a start
  double open_tilt_rad = 0.2;              // one sigma of each axis above which tilt counts as unknown; [safety NaN 755]
  double telling_window_m = 200;           // half the side of a window in which many places compete; [roc]
  double sharp_sigma_m = 20;               // a prediction up to this σ (one axis) is sharp; chosen; not measured
  int min_inliers = 8;                     // chosen; not measured
  double min_score = 0.16;                 // correlation of all channels; [roc] 26 % of wrong places reach it
  double min_sharp_score = 0.12;           // where a sharp prediction agrees; chosen for faint real images, Nov 2026
  double min_frame_share = 0.25;           // of the frame that the agreeing patches span; chosen; not measured
  double max_residual_px = 2.5;            // RMS, pixels of the matching GSD; [roc]
  double max_tilt_sigmas = 4;              // solved tilt and height against the prediction; chosen; see [safety 9950]
  double chi2_999 = 13.816;                // 99.9 % of χ² with two degrees of freedom
  double chi2_99 = 9.210;                  // 99 %; against a start, for frames that odometry is linked to; [safety 3574]
  double healthy_sigma_m = 60;             // a prediction worse than this supports nothing; chosen; not measured
  // Lost, thousands of places compete and nothing else supports the best one: it must stand out further, or be confirmed
  // by votes.
  double lost_ratio = 0.70;         // chosen with the cold starts of docs/benchmarks.md
  double lost_inlier_share = 0.20;  // as alone_inlier_share
};

// Process noise of the flight filter. Used as FlightFilter::Options.
struct FlightFilterOptions {
  double start_velocity_sigma_mps = 15;   // each axis, when nothing is known: a small fixed wing; chosen
  double acceleration_mps2 = 1.5;         // unmodelled changes of velocity (per root second), heading unknown; chosen …
  double steady_acceleration_mps2 = 1.0;  // … and known: a fixed wing keeps its airspeed through a turn; [consistency]
  double wind_sigma_mps = 5;              // part of the velocity that does not turn with the aircraft; [consistency]:
                                          // blind NEES in 5 m/s of wind 1.1
};

namespace parameters {

// How telemetry errs, as shares of the sigma that the camera file states. Shared with the batch solution that the
// smoother is compared with (tests/bench/batch_graph.cpp).
namespace telemetry {

inline constexpr double kUnknownHeadingVariance_rad2 = 4.0;  // about 115 degrees: any heading

// Heading: 0.8² + 0.6² = 1 of the stated variance lasts; 0.5 of σ is drawn anew for each frame. 22 Nov 2026, from
// simulated flights whose compass error turns with the course ([safety] "compass deviates").
inline constexpr double kHeadingBiasShare = 0.8;
inline constexpr double kDeviationShare = 0.6;  // coefficients B and C of a compass' deviation
inline constexpr double kWhiteHeadingShare = 0.5;
// Correlation time of the deviation: an autopilot's filter uses more than a compass. Chosen; not measured.
inline constexpr double kDeviationTime_s = 90;

// Innovation share of relative height per frame: barometer noise, relief that passes by. Chosen; not measured.
inline constexpr double kHeightInnovationShare = 0.25;

// Tilt: the part that changes from frame to frame, by whether the telemetry logs attitude. Chosen; the unlogged part is
// estimated in flight.
inline constexpr double kWhiteTiltShareLogged = 0.7;
inline constexpr double kWhiteTiltShareUnlogged = 0.3;
inline constexpr double kTiltTimeLogged_s = 240;      // correlation time: an AHRS …; chosen; not measured
inline constexpr double kTiltTimeUnlogged_s = 12000;  // … or a mount or gimbal; chosen; not measured
// Share of the tilt's σ that tilts the accelerometer as well: neither the mount's nor of the moment. [flights] with IMU
// and the 33 s blackout of closed-loop, 22 Nov 2026.
inline constexpr double kLevelShare = 0.3;

}  // namespace telemetry

namespace flight_filter {

inline constexpr double kGravity_mps2 = 9.80665;       // standard gravity (CGPM 1901)
inline constexpr double kTiltScatterPriorFrames = 3;   // weight of the prior of the tilt's scatter; chosen
// Measurements whose variance is beyond this many times the white tilt's teach nothing of it; chosen; not measured.
inline constexpr double kVaguestTiltVarianceRatio = 16;
inline constexpr double kMissingTilt_rad = 0.35;         // tilt not measured: 20°, a banked turn; [safety NaN attitude]
inline constexpr double kNonlinearHeading_rad = 0.5;     // an update beyond it makes the velocity's linearization void
inline constexpr double kLeastWhiteTilt_rad = 0.004;     // a quarter of a degree: no mount is stiffer; chosen
// Ceiling of the velocity's variance over that of the start: however long blind, no aircraft becomes arbitrarily fast.
inline constexpr double kMaxVelocityVarianceRatio = 4;
inline constexpr double kStoppedClockSpeed_mps = 20;     // least speed assumed over an unknown interval; [safety time jumps]
inline constexpr double kLongestUsualInterval_s = 5;     // of the interval that stands for an unknown one; chosen
// Share of an interval's change of velocity times the interval: when within it the change came is unknown. Physics
// bounds it by 0.5; chosen with [flights] IMU.
inline constexpr double kUnknownMomentShare = 0.08;

}  // namespace flight_filter

namespace pose_measurement {

// A direction that the image says nothing of gets this σ: as good as infinite, yet invertible.
inline constexpr double kVaguePositionHeights = 10;  // of an absolute position, in heights above ground; numerics
inline constexpr double kVagueMotionLengths = 100;   // of a relative motion, in (1 m + its length); numerics

}  // namespace pose_measurement

namespace smoother {

inline constexpr double kContradiction_chi2 = 25;        // two degrees of freedom: 1 in 270 000, of many anchors
inline constexpr std::size_t kMaxRejectedAnchors = 40;   // passes over the flight; bounds the time
// Share of an anchor's own covariance that remains where it alone makes the track; numerics.
inline constexpr double kSoleAnchorShare = 0.02;

}  // namespace smoother

namespace two_view_motion {

inline constexpr double kMinDownComponent = 0.2;  // of a unit ray: flatter ones see the horizon; chosen
inline constexpr std::size_t kMinRayPairs = 6;    // eight unknowns, six of them with priors; geometry
// Ray pairs that count as independent at most, whatever their residuals say; [consistency] of simulated odometry.
inline constexpr double kMaxIndependentPairs = 100;
// Residuals beyond so many times what pixels and relief explain show no single motion: refused. Found by a turn that
// was half a circle off, 22 Nov 2026.
inline constexpr double kMaxResidualRatio = 5;
// Images turned so much farther than predicted are not pulled back: they show that the telemetry contradicts them.
inline constexpr double kFarTurn_rad = 0.4;  // chosen; below tracking::kContradictedTurn_rad
inline constexpr double kFarTurnSigmas = 4;
inline constexpr double kPixelHeightShare = 0.0015;      // a pixel of the working size on the ground, over the height
inline constexpr double kFirstScalePixels = 30;          // graduated non-convexity begins here; chosen
inline constexpr double kScaleShrink = 0.6;              // of the kernel's scale per iteration; chosen
inline constexpr double kScaleSlack = 1.01;              // within which the scale counts as reached; numerics
inline constexpr double kMedianOverSigma = 1.177;        // mathematics: median of a Rayleigh distribution, √(2 ln 2)
inline constexpr int kMaxIterations = 30;                // chosen
inline constexpr double kInlierSigmas = 3;               // bound of the robust kernel; chosen

// Defaults of the prior; the localizer sets all of them.
inline constexpr double kDefaultHeadingSigma_rad = 0.1;
inline constexpr double kDefaultTiltVariance_rad2 = 1e-3;
inline constexpr double kDefaultLogHeightSigma = 0.03;
inline constexpr double kDefaultReliefSigma_m = 1.5;

}  // namespace two_view_motion

namespace visual_odometry {

inline constexpr int kMaxFeatures = 900;              // 1500 cost a third more and lost nothing; [ablations], 22 Nov 2026
inline constexpr int kOctaveLayers = 3;               // SIFT's own default (Lowe 2004)
inline constexpr double kSiftContrast = 0.007;         // weaker than SIFT's 0.04, for half the size; [ablations]
inline constexpr double kMatchRatio = 0.85;           // nearest over second nearest descriptor (Lowe 2004: 0.8); chosen
// SIFT begins by doubling the image. At half the size it costs a third and drifts less; [ablations], 21 Nov 2026.
inline constexpr double kWorkingWidth_px = 450;
inline constexpr int kMinInliers = 12;                // chosen; not measured
inline constexpr double kHomographyThreshold_px = 3;  // OpenCV's default
inline constexpr int kHomographyIterations = 5000;    // chosen; not measured
inline constexpr double kHomographyConfidence = 0.999;  // chosen; not measured
inline constexpr double kModelErrorShare = 0.01;      // of the motion: lens, shutter, relief; [turns]
inline constexpr double kTurnErrorShare = 0.05;       // of the turn: hills under a banked camera err by 3 %; [turns]

// Defaults of a front end's input; the localizer sets all of them.
inline constexpr double kDefaultHeadingSigma_rad = 0.05;
inline constexpr double kDefaultTiltSigma_rad = 0.03;
inline constexpr double kDefaultReliefSigma_m = 1.5;
inline constexpr double kDefaultRelativeHeightSigma = 0.02;

}  // namespace visual_odometry

namespace tracking {

inline constexpr double kOverlapReachShare = 0.5;   // of a footprint's longer side: a shorter displacement overlaps
inline constexpr double kOverlapSpeedSigmas = 2;    // of the speed, for the same; chosen
inline constexpr double kLeapSpeedSigmas = 4.5;     // a step beyond is no motion of the aircraft; [safety outlier 3754]
inline constexpr double kGusts_mps = 5;             // least σ of the speed for the same; chosen
inline constexpr double kLeapSlackShare = 0.1;      // of a footprint's longer side: what a tilt feigns; chosen
inline constexpr double kContradictedTurn_rad = 0.5;  // image and telemetry disagree on a turn: 29°; chosen
inline constexpr double kContradictedTurnSigmas = 5;
inline constexpr double kResolvedHeading_rad = 0.5;  // below: the heading is known again; chosen
inline constexpr double kWrongCourseFactor = 2;     // σ grows by so many step lengths: there and back; geometry
inline constexpr double kMinTurnSigma_rad = 0.02;   // of the telemetry's change of heading; chosen
inline constexpr double kTurnSigmaShare = 1.5;      // √2 of the white part and the deviation over a turn, rounded up
inline constexpr double kUnknownTurnSigma_rad = 1;  // no heading measured
inline constexpr double kSteadyHeightShare = 0.5;   // of the stated height σ, from one frame to the next; chosen
inline constexpr double kUnmeasuredHeightSigma = 0.3;  // log height, no height measured; chosen
inline constexpr double kSlopeBaselineDivisor = 3;  // footprint over the distance to each side that slope is taken over

}  // namespace tracking

namespace anchor_votes {

inline constexpr int kVotes = 3;                // of five attempts; [safety], [roc]
inline constexpr int kVotesAgainstAnchors = 6;  // of eight: odometry does not leap; [safety 164, 244, 305, 393]
inline constexpr double kAgreement_m = 25;      // distance at which two attempts agree; chosen
inline constexpr int kSpareAttempts = 2;        // attempts that may fail in between; chosen
// Attempts kept. From 1000 m above ground a frame shows 2 km, and six votes must lie along most of that: at ten attempts
// a second, 2 m apart, this reaches as far. Soak at three frames a second, 22 Nov 2026.
inline constexpr std::size_t kKeptAttempts = 1024;
inline constexpr double kChanceAgreement = 0.01;  // share of random pairs that may agree in a window; [safety 614]
// By then a frame shows little of the first one's ground; [safety 614].
inline constexpr double kSeparationFootprints = 0.8;

}  // namespace anchor_votes

namespace start_contradictions {

inline constexpr double kSamePlace_m = 25;  // matches this near contradict the start alike; chosen
inline constexpr double kDriftSigmas = 3;   // … and by so much of what the position's σ has grown since
inline constexpr std::size_t kMaxPlaces = 8;  // chance matches lie elsewhere each time; chosen

}  // namespace start_contradictions

namespace anchor_measurement {

// What the pose solver does not model (trees, roofs, shutter, the moment of the telemetry), as a factor of its
// variance; from the normalised errors of simulated flights.
inline constexpr double kModelErrorFactor = 4;
inline constexpr double kUnknownTiltModelErrorFactor = 9;  // all of that looks like a tilt; [safety NaN attitude 755]
// Sets of patches that agreed on a wrong pose nearby lay up to 26 px from the truth; [safety night 4734, height 5045].
inline constexpr double kWrongConsensusSigma_px = 10;
inline constexpr double kSharedErrorFootprints = 1.5;   // anchors within it count as one; [safety heading 73]
inline constexpr double kMinHeightSigma = 0.012;        // log height: roofs, trees, rolling ground; chosen
inline constexpr double kMinTiltVariance_rad2 = 1e-6;   // keeps the prior invertible; numerics
// What roofs and rolling ground within a footprint feign, however well tilt and height are known; chosen.
inline constexpr double kTiltModelError_rad = 0.015;
inline constexpr double kHeightModelError = 0.015;
// What no model has (lens, relief, the moment of the telemetry) and no number of anchors averages out, over the height;
// 0.8 %, then 1 %, then 1.5 %: [safety 73, 3562, 1318].
inline constexpr double kUnmodelledShare = 0.015;

}  // namespace anchor_measurement

namespace search_window {

inline constexpr double kMinRadius_m = 60;    // half the side of the searched square; chosen
inline constexpr double kMaxRadius_m = 1200;  // beyond: the area is searched; time of a search, docs/benchmarks.md
inline constexpr int kFailuresPerRing = 3;    // frames that fit nowhere widen the window by its least radius; chosen
inline constexpr int kMaxRings = 4;           // chosen
inline constexpr double kReachSigmas = 3;     // half side in σ of the position
inline constexpr double kPart_m = 1600;       // side of an area's part searched for one frame: its time
inline constexpr double kHeadingSigmas = 3;   // searched headings
inline constexpr double kScaleSigmas = 2.5;   // searched heights
inline constexpr double kMinHintReach_m = 100;  // so that other places compete; chosen
inline constexpr double kMinFootprint_px = 128;  // of the map, along a frame's longer side, to be searched for everywhere:
                                                 // a runway in the image cost 84 s, 22 Nov 2026

}  // namespace search_window

namespace localizer {

inline constexpr double kStartSigma_m = 50;      // start position, one axis; default, set by the caller
inline constexpr double kNoFixSigma_m = 500;     // beyond this no position is published; chosen
inline constexpr double kMapSigma_m = 2.8;       // CE90 of 6 m; default, set from the package
inline constexpr double kAssumedAgl_m = 120;     // height until telemetry has one; chosen
inline constexpr double kMatchAboveSigma_m = 5;  // one axis: the map is searched again; chosen
inline constexpr double kLeastLostSigma_m = 1000;  // no start and no area: chosen
inline constexpr double kCorroborationTime_s = 60;   // an anchor farther in time corroborates little; chosen
inline constexpr double kSharpPrediction_m = 20;     // one axis: a wider prediction agrees with much; as sharp_sigma_m
inline constexpr double kOutsideHintSigmas = 3;      // a position farther from a hint contradicts it; chosen
inline constexpr double kCe90OverSigma = 2.146;      // mathematics: √(-2 ln(1 - 0.9))

}  // namespace localizer

namespace terrain {

// What elevation models leave out over a frame's footprint. The global ones state 2 m (90 %) between neighbouring posts,
// hence about a metre, one sigma; across 200 to 300 m that is a slope of 0.004.
inline constexpr double kReliefSigma_m = 1.0;
inline constexpr double kMinCell_m = 250;  // of the table of raster positions: a millimetre off
inline constexpr double kMaxCells = 1000;  // a side; bounds the memory

}  // namespace terrain

// Beyond these telemetry is garbage and becomes unknown.
namespace plausible {

inline constexpr double kMinAgl_m = 1;
inline constexpr double kMaxAgl_m = 30'000;
inline constexpr double kMaxAngle_rad = 100;
inline constexpr double kMaxVelocityChange_mps = 200;   // from flying one way to flying the other
inline constexpr double kMaxAcceleration_mps2 = 60;     // 6 g: what carries a camera does not survive it

}  // namespace plausible

}  // namespace parameters
}  // namespace nadir
