// The numbers that decide in matching and estimation (libgeo/vision, libgeo/estimation), by module: value, unit, and
// where each comes from. Nothing else in these folders holds one; what remains there is mathematics (0.5, 2π) and
// constants of file formats. docs/parameters.md is made from this file; tests/structure/check_parameters.py holds both
// to it.
//
// Origins, in brackets: [safety N] is segment N of the Monte Carlo in docs/safety.md, [looks] the looks with
// known answers of docs/look-likelihood.md,
// [turns], [consistency], [flights], [ablations] the benches of that name in docs/benchmarks.md, all of November 2026.
// "Chosen": an engineer's estimate, set when the module was written; no measurement of this number is recorded.
// "Numerical": guards degenerate cases and stops iterations.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <numbers>

namespace nadir {

// ---- camera: lens model and camera file

inline constexpr int kFoldProbes = 8;  // along the way to a point, for where the lens' polynomial turns back; chosen
inline constexpr int kFoldBisections = 20;              // refine that share to 1e-7 of the way; numerical
inline constexpr int kUndistortIterations = 50;         // at most; Newton needs a handful, up to the fold
inline constexpr double kUndistortError2 = 1e-24;       // squared, at z = 1: below the 1e-9 that camera.hpp promises
inline constexpr int kInvertibilitySteps = 8;           // grid over the image on which a camera file is checked; chosen
inline constexpr double kInvertibilityError_px = 1e-3;  // there and back again; chosen
// 1-sigma of the telemetry where a camera file states none; chosen.
inline constexpr double kDefaultHeadingSigma_rad = 0.05;
inline constexpr double kDefaultAglSigma = 0.05;  // relative
inline constexpr double kDefaultTiltSigma_rad = 0.05;
inline constexpr double kDefaultImuSigma_mps = 0.3;  // of the change of velocity, per root second; chosen

// ---- rolling shutter

inline constexpr double kMaxReadout_s = 0.2;     // of all lines; slower than any camera; chosen
inline constexpr int kShutterNodes_px = 16;      // between pixels that are computed; chosen
inline constexpr int kShutterIterations = 3;     // for the line that shows a point; numerical
inline constexpr double kShutterMinFall = 0.05;  // of a ray: towards the horizon the ground is far away; chosen
// A frame is undone anew when the way during the readout was another by so much, half a pixel of such cameras; chosen.
inline constexpr double kShutterRedone_m = 0.1;

// ---- rectification

inline constexpr int kRectifyNodeStep_px =
    8;  // between exactly projected nodes: < 0.1 px off (tests/vision/rectification_test)
// z of a unit ray: beyond about 72 degrees off nadir no ground is used; chosen.
inline constexpr double kMinGroundRayDown = 0.3;
inline constexpr double kReducedOversampling = 1.2;  // a frame's pixels per grid cell after reduction; chosen
inline constexpr double kWorthReducing = 0.9;        // a smaller factor is worth resampling for; chosen
inline constexpr int kTerrainIterations = 8;  // of a ray with terrain: near nadir each leaves a tenth of the error
inline constexpr double kTerrainConverged_m = 1e-6;  // numerical
inline constexpr double kFlatGroundRelief_m = 1.5;   // 1-sigma of "flat": ditches, embankments, a gentle rise; chosen

// ---- camera frame: decoding and quality

inline constexpr int kMinDecodedSide_px = 1280;               // matching looks at some 500 px across; chosen with room
inline constexpr double kQualityWidth_px = 320.0;             // sharpness is measured at this width; chosen
inline constexpr int kClippedDark = 2, kClippedBright = 253;  // grey levels up to, and from, which a pixel is clipped
inline constexpr double kContrastWidth_px = 80;  // averages of sixteen pixels of the sharpness: a quarter of its noise
// Grey levels, 1-sigma. At night 12 of 43 frames are anchored, where 5 grey levels let 3 of 25 through, none of them
// wrong: [safety], base seed 31.
inline constexpr double kMinContrast = 1.5;
inline constexpr double kMaxClippedShare = 0.6;  // chosen; likewise
inline constexpr double kMinSharpness = 0.015;   // mean gradient over contrast, per px; chosen; likewise

// ---- oriented channels

inline constexpr double kChannelSigma_px = 1.0;     // smoothing in space; chosen
inline constexpr double kChannelFloor = 0.35;       // of the mean gradient strength; chosen
inline constexpr double kChannelPool_px = 2.0;      // over which the strength is normalised; chosen
inline constexpr double kStrengthEpsilon = 1e-3;    // grey levels per px: no division by zero in a blank image
inline constexpr float kGradientEpsilon = 1e-6F;    // likewise, of one pixel's gradient
inline constexpr float kGradientEpsilon2 = 1e-12F;  // likewise, squared

// ---- correlation

inline constexpr double kMinValidShare = 0.6;  // of a template on valid map; chosen (docs/localization.md)
// Energy per pixel below which ground has no texture and matches nothing. Channels are of the order of 1; numerical.
inline constexpr double kMinVariance = 1e-6;
inline constexpr double kMinTemplateEnergy = 1e-9;    // numerical
inline constexpr float kMinPeakCurvature = 1e-9F;     // flatter: the peak is not interpolated; numerical
inline constexpr std::size_t kMaxTransform_px = 512;  // side; larger windows in parts that stay in caches; chosen
inline constexpr int kMapChannelsMargin_px = 12;  // channels of the map are made with: the next request lies close by

// ---- search in a window of the map

inline constexpr double kSearchGsd_m = 1.0;          // default; a matching plan sets it
inline constexpr double kDistinct_m = 25;            // closer hypotheses are one; chosen
inline constexpr double kDistinct_px = 12;           // likewise, at the coarse scale; chosen
inline constexpr std::size_t kSearchCandidates = 5;  // hypotheses that are confirmed; chosen
inline constexpr double kHeadingStep_rad = 0.052;    // 3 degrees; chosen
inline constexpr double kScaleStep = 0.04;           // relative height; chosen
inline constexpr int kSweepReduction = 2;  // four times fewer pixels, and the confirmation corrects the sweep; chosen
inline constexpr double kWideRadius_px = 190;  // a larger window holds more look-alikes: twice the candidates; chosen
inline constexpr std::size_t kWideCandidates = 2;     // times kSearchCandidates in a wide window; chosen
inline constexpr std::size_t kRefinedCandidates = 2;  // the best ones, between the sweep's steps: best and its rival
inline constexpr int kRefineSlack_px = 2;             // around each of those; chosen
// Peaks beside the best ones that are one place with them by distance: at least so far off, because patches reach no
// farther; so many of each; and of so much of its score in the sweep. Chosen; what they bring: docs/localization.md.
inline constexpr double kNearPeak_px = 8;
inline constexpr std::size_t kNearPeaks = 2;
inline constexpr double kNearPeakScore = 0.75;
inline constexpr double kWorthShrinking = 0.95;       // of the map, likewise as kWorthReducing; chosen

// ---- search in an area

inline constexpr std::size_t kChunksPerPlace = 8;  // neighbouring chunks overlap, and all of them look like the place
// Of a chunk's side: the index is good to a sixth of it, and a frame is not as large as the chunk; chosen.
inline constexpr double kRetrievedReach = 0.35;
// Windows of an area: the frame is prepared once for so many; their spectra take 6 MB each; ./run bench latency.
inline constexpr std::size_t kSweptTogether = 4;
inline constexpr std::size_t kFewCandidates = 2;  // of a window where its one place or its best rival is asked for
inline constexpr double kKnownTurn_rad = 0.12;    // half of the index's step of headings and some more …
inline constexpr double kUnknownTurn_rad = 0.17;  // … where it tries all 24

// ---- matching plan

inline constexpr double kAreaWindow_m = 1600;      // side of the squares in which an area is searched; chosen
inline constexpr double kFineTemplate_px = 400;    // longer side of the fine template; chosen
inline constexpr double kCoarseTemplate_px = 170;  // still enough structure to find a place among thousands; chosen
inline constexpr double kReachMargin = 1.05;       // of the footprint's farthest corner; chosen
inline constexpr double kWindowSlack_m = 30;       // the refined pose may see beyond what the searched ones do …
inline constexpr double kWindowSlackShare = 0.15;  // … so much of a frame's longer side …
inline constexpr double kWindowTiltSigmas = 2;     // … or, where the tilt is open, so many sigmas of it …
inline constexpr double kWindowMaxTilt_rad = 0.5;  // … up to here; chosen

// ---- patch matching

inline constexpr int kPatch_px = 48;                      // side; chosen (docs/localization.md)
inline constexpr int kPatchColumns = 12, kPatchRows = 8;  // over the camera's image; chosen
inline constexpr double kPatchSearch_px = 10;             // a patch may lie this far off; chosen
inline constexpr double kMinPatchScore = 0.2;             // correlation below this is no match; chosen
// A correlation of 1 whose peak falls by `curvature` over a pixel is located to about sqrt(noise / curvature); the
// noise is what the best wrong placements reach; chosen.
inline constexpr double kPatchScoreNoise = 0.04;
inline constexpr double kPatchSigmaFloor_px = 0.3;     // no patch is located better; chosen
inline constexpr double kPatchWeakInformation = 0.01;  // 1/px²: keeps a patch along one straight border invertible
inline constexpr double kPatchMinValid = 0.8;          // share of a patch on valid map; chosen
inline constexpr double kPatchMinCovered = 0.8;        // share of a patch that the frame covers; chosen
inline constexpr double kPatchFrameMargin = 0.04;      // of the image: patches at its very edge stick out; chosen
inline constexpr int kPatchAround_px = 2;              // second pass, around the best of the first
inline constexpr int kChannelReach_px = 8;             // of the channels' smoothing, for the map's margin

// ---- robust Gauss-Newton

inline constexpr double kJacobianStep = 1e-5;            // of central differences: truncation and rounding below 1e-9
inline constexpr double kDivergedStep = 1.0;             // rad or log: a larger step is not a refinement
inline constexpr double kConvergedStep_m = 1e-4;         // of the position; numerical
inline constexpr double kConvergedStep = 1e-6;           // of the other unknowns; numerical
inline constexpr std::size_t kCorrelationRings = 8;      // of distance, in which residuals are correlated; chosen
inline constexpr double kCorrelationReach = 0.4;         // of the extent: pairs farther apart are not used
inline constexpr std::size_t kCorrelationSamples = 300;  // measurements used; more add no information

// ---- camera pose

inline constexpr int kPoseIterations = 25;               // chosen
inline constexpr std::size_t kMinCorrespondences = 4;    // eight equations for eight unknowns with priors; chosen
inline constexpr double kMinSolverRayDown = 0.2;         // of a ray's length: flatter rays see the horizon; chosen
inline constexpr double kPoseBeginScale = 4;             // times the inlier bound: nearly convex; chosen
inline constexpr double kPoseNarrowing = 0.7;            // of the scale, each iteration; chosen
inline constexpr double kPoseInlier_m = 2.0;             // default; the refinement sets it
inline constexpr double kPoseMinSigma_m = 0.5;           // default; the refinement sets it
inline constexpr double kPriorHeadingSigma_rad = 0.2;    // defaults of a pose's prior; callers set them
inline constexpr double kPriorLogAglSigma = 0.1;         // likewise
inline constexpr double kPriorTiltVariance_rad2 = 0.01;  // likewise
inline constexpr double kPriorSlopeSigma = 0.02;         // likewise

// ---- map matcher: refinement of the best hypothesis

struct RefinementRound {
  int columns, rows;  // of patches
  double search_px;
  double inlier_px;  // of the map's pixels
};
// The search is good to some pixels, each round to fewer; chosen.
inline constexpr std::array<RefinementRound, 3> kRefinementRounds{{{8, 6, 12, 7.0}, {12, 8, 8, 3.5}, {12, 8, 6, 3.5}}};
// Of coarse patches, which are tried where those above agree on nothing. Half as many: no more fit side by side;
// [looks].
inline constexpr std::array<RefinementRound, 3> kCoarseRounds{{{8, 6, 8, 5.0}, {8, 6, 6, 3.5}, {8, 6, 6, 3.5}}};
inline constexpr double kCoarsePatchReduction = 2;    // of the resolution, for coarse patches; [looks]
inline constexpr int kCoarsePatch_px = 32;            // side: 1.3 times as large on the ground; [looks]
inline constexpr double kMinCoarsePatchScore = 0.15;  // over more ground wrong places reach lower scores; [looks]
inline constexpr double kRefinementSlack_m = 30;      // of map around the footprint at the best hypothesis; chosen
// At least: the search has just measured the heading; chosen.
inline constexpr double kRefinementHeadingSigma_rad = 0.05;
inline constexpr double kMaxIndependentPatches = 30;  // they overlap: no more fit into a frame side by side
inline constexpr double kHopelessRatio = 0.90;        // no gate accepts more, and rivals only raise it (estimation)
inline constexpr std::size_t kRetrievedPlaces = 10;   // of the place index that are searched (docs/localization.md)
inline constexpr double kMinWindowDistinct = 2.2;  // times kDistinct_m: room for another place to compare with; chosen
inline constexpr std::size_t kCachedMapTiles = 1024;     // 64 MiB in grey, twice that where all have masks
inline constexpr double kAnchorHeadingSigma_rad = 0.05;  // defaults of a prior; the localizer sets them
inline constexpr double kAnchorLogAglSigma = 0.05;
inline constexpr double kAnchorTiltVariance_rad2 = 0.003;

// ---- SIFT features. Lowe 2004 unless stated otherwise.

inline constexpr double kSiftSigma_px = 1.6;          // of the first scale, in pixels of the doubled image
inline constexpr double kSiftInputBlur_px = 0.5;      // of what a camera delivers
inline constexpr double kSiftBlurReach = 3.5;         // of a kernel, in σ: beyond lie 0.05 %; numerical
inline constexpr int kSiftMinOctave_px = 16;          // shorter side of the smallest; beyond it frames have no features
inline constexpr int kSiftBorder_px = 5;              // of an octave, without features; chosen
inline constexpr double kSiftSieve = 0.5;             // of the least contrast, before refinement; chosen
inline constexpr int kSiftRefinements = 5;            // of an extremum, each at a neighbouring pixel; chosen
inline constexpr double kSiftEdgeRatio = 10;          // of principal curvatures; larger ones are edges
inline constexpr int kSiftOrientationBins = 36;       // 10° each
inline constexpr double kSiftOrientationSigma = 1.5;  // of the window, in the feature's scales
inline constexpr double kSiftOrientationReach = 3;    // of the window, in its σ; numerical
inline constexpr double kSiftSecondPeak = 0.8;        // of the highest: another direction
inline constexpr int kSiftCells = 4;                  // a side
inline constexpr int kSiftDirections = 8;             // of a cell's histogram
inline constexpr double kSiftCellWidth = 3;           // in the feature's scales; OpenCV's value
inline constexpr double kSiftLargest = 0.2;           // of the descriptor's length: larger values are cut
inline constexpr double kSiftLength = 512;            // of the descriptor: few values are beyond 255; OpenCV's value
// Abramowitz and Stegun 4.4.49: odd powers of the arcus tangent, good to 1e-5 rad.
inline constexpr std::array<double, 5> kArcusTangent{0.9998660, -0.3302995, 0.1801410, -0.0851330, 0.0208351};

// ---- place descriptor. What is here decides the vectors: a change is a new kPlaceDescriptorName.

inline constexpr double kCellSoftness = 0.6;     // sigma of a cell's weight, in cells (docs/formats/place-index.md)
inline constexpr double kMinCellWeight = 0.011;  // exp(-3² / 2): weights beyond 3 sigma are 0
inline constexpr double kMinCellShare = 0.3;     // of a cell's weight on ground (docs/formats/place-index.md)
inline constexpr double kMinDescriptorEnergy = 1e-9;  // no structure at all; numerical
inline constexpr float kMinVectorLength = 1e-9F;      // after the projection; numerical
inline constexpr double kTextureSigma_px = 1.0;       // smoothing before texture is measured; as kChannelSigma_px
inline constexpr int kTextureMargin_px = 7;           // side of the erosion: reach of that smoothing and the gradient
inline constexpr double kMinPlaceTexture = 0.8;  // rms gradient, grey levels per px: water and snow have less; chosen
inline constexpr int kPlacePatch_px = 96;        // side of a patch: 12 px a cell; chosen
inline constexpr double kAliasingScale = 1.3;    // source pixels per patch pixel from which it is smoothed; chosen
inline constexpr double kAliasingSigma = 0.45;   // of that smoothing, per source pixel; chosen

// ---- place index: query

inline constexpr double kQueryTurn_rad = std::numbers::pi / 18;  // 10 degrees, within a known range; chosen
inline constexpr int kQueryTurns = 24;                           // where nothing is known of the heading; chosen
inline constexpr double kFineTurnRange = 12;      // times kQueryTurn_rad: a wider range is stepped as an unknown one
inline constexpr double kQueryShift = 1.0 / 6;    // of a side: what the descriptor tolerates
inline constexpr std::size_t kHitsPerQuery = 64;  // chunks that each variant of the frame may retrieve; chosen

// ---- place index: builder and check

inline constexpr int kMinPlacePatch_px = 32;          // less shows too little structure; a format limit as well
inline constexpr double kMaxPlacePatch_px = 256.0;    // likewise
inline constexpr double kPatchRounding_px = 0.01;     // a footprint that is a whole number of pixels stays one
inline constexpr double kMinChunkValid = 0.5;         // share of a chunk on ground; chosen
inline constexpr std::size_t kTrainingChunks = 6000;  // for the projection, at most; chosen
inline constexpr std::size_t kTrainingViewsPerChunk = 8, kMinTrainingViews = 500, kMaxTrainingViews = 3000;  // chosen
inline constexpr double kTrainingShift = 0.2;  // ± of a side: a frame lies anywhere between chunks
inline constexpr double kMinTrainingScale = 0.9, kMaxTrainingScale = 1.1;  // a little larger or smaller; chosen
inline constexpr double kTrainingWindow = 2.1;             // sides: a turned and shifted patch lies inside
inline constexpr std::size_t kChunksPerTask = 64;          // neighbouring chunks, which share decoded tiles; chosen
inline constexpr std::size_t kMinCheckedChunks = 32;       // of an index that is checked at full depth …
inline constexpr std::size_t kCheckedChunksDivisor = 100;  // … or one in so many; chosen
inline constexpr double kMinCheckedCosine = 0.999;         // other processors round differently; chosen
inline constexpr double kCheckedLengthError = 0.01;        // of a stored vector; chosen
inline constexpr std::size_t kMaxIndexFindings = 20;       // then the check stops
inline constexpr double kSameOrigin_deg = 1e-7;            // the table's resolution, 1 cm
inline constexpr float kMaxUnitComponent = 1.001F;         // of a unit vector in single precision

// ---- matchability: what another day does to an image

// Amounts such that scores become those of real flights (docs/concepts.md, matchability).
inline constexpr double kWornTurn_rad = 0.026;  // half a step of the search's headings
inline constexpr double kWornScale = 0.02;      // and of its heights
inline constexpr double kWornShift_px = 0.5;    // and of its pixels
struct NoiseLayer {
  double sigma_px;     // of the blur that makes it
  double grey_levels;  // 1-sigma
};
// Sensors at one pixel, crops and shadows at many.
inline constexpr std::array<NoiseLayer, 3> kWornNoise{{{0.0, 6.0}, {1.5, 9.0}, {4.0, 9.0}}};
// The noise is for a map of this texture (grey levels per px); one of more contrast is no easier to match for it. A
// dull map is not given less noise: sensors have theirs.
inline constexpr double kNoiseTexture = 4.5;
inline constexpr int kNoiseSide_px = 1024;          // of the noise field; a larger frame repeats it
inline constexpr double kMinTypicalTexture = 1e-6;  // no division by zero
inline constexpr double kMinEdgeStrength = 1e-9;    // no structure, no entropy; numerical
// A frame of which a place competes more closely, or that correlates less, hardly anchors alone; [looks].
inline constexpr double kGoodRatio = 0.80;
inline constexpr double kLeastScore = 0.16;
inline constexpr double kMaxMatchabilityRatio = 2;  // above 1 another place fits better, by how much does not matter
inline constexpr double kMatchabilityFootprint_m = 120, kMatchabilityRadius_m = 100;  // defaults; the survey sets them

// ==== estimation

// Process noise of the flight filter. Used as FlightFilter::Options.
struct FlightFilterOptions {
  double start_velocity_sigma_mps = 15;  // each axis, when nothing is known: a small fixed wing; chosen
  double acceleration_mps2 = 1.5;  // unmodelled changes of velocity (per root second), heading unknown; chosen …
  double steady_acceleration_mps2 = 1.0;  // … and known: a fixed wing keeps its airspeed through a turn; [consistency]
  double wind_sigma_mps = 5;              // part of the velocity that does not turn with the aircraft; [consistency]:
                                          // blind NEES in 5 m/s of wind 1.1
};

namespace parameters {

// Error model of the telemetry, in shares of the sigma that the camera file states. Shared with the batch solution that
// the smoother is compared with (tests/bench/batch_graph.cpp).
namespace telemetry {

inline constexpr double kUnknownHeadingVariance_rad2 = 4.0;  // about 115 degrees: any heading

// Heading: 0.8² + 0.6² = 1 of the stated variance is correlated in time; 0.5 of σ is white, per frame. 22 Nov 2026,
// from simulated flights whose compass error turns with the course ([safety] "compass deviates").
inline constexpr double kHeadingBiasShare = 0.8;
inline constexpr double kDeviationShare = 0.6;  // coefficients B and C of a compass' deviation
inline constexpr double kWhiteHeadingShare = 0.5;
// Correlation time of the deviation: an autopilot's filter uses more than a compass. Chosen; not measured.
inline constexpr double kDeviationTime_s = 90;

// Innovation share of relative height per frame: barometer noise, changing relief. Chosen; not measured.
inline constexpr double kHeightInnovationShare = 0.25;

// Tilt: the part that changes from frame to frame, by whether the telemetry logs attitude. Chosen; the unlogged part is
// estimated in flight.
inline constexpr double kWhiteTiltShareLogged = 0.7;
inline constexpr double kWhiteTiltShareUnlogged = 0.3;
inline constexpr double kTiltTimeLogged_s = 240;      // correlation time: an AHRS …; chosen; not measured
inline constexpr double kTiltTimeUnlogged_s = 12000;  // … or a mount or gimbal; chosen; not measured
// Share of the tilt's σ that tilts the accelerometer as well: neither a mounting error nor white. [flights] with IMU
// and the 33 s blackout of closed-loop, 22 Nov 2026.
inline constexpr double kLevelShare = 0.3;

}  // namespace telemetry

namespace flight_filter {

inline constexpr double kGravity_mps2 = 9.80665;      // standard gravity (CGPM 1901)
inline constexpr double kTiltScatterPriorFrames = 3;  // weight of the prior of the tilt's scatter; chosen
// Measurements whose variance is beyond this many times the white tilt's are not used for it; chosen; not measured.
inline constexpr double kVaguestTiltVarianceRatio = 16;
inline constexpr double kMissingTilt_rad = 0.35;      // tilt not measured: 20°, a banked turn; [safety NaN attitude]
inline constexpr double kNonlinearHeading_rad = 0.5;  // an update beyond it makes the velocity's linearization void
inline constexpr double kLeastWhiteTilt_rad = 0.004;  // a quarter of a degree; no mount is stiffer; chosen
// Ceiling of the velocity's variance over that of the start: however long blind, no aircraft becomes arbitrarily fast.
inline constexpr double kMaxVelocityVarianceRatio = 4;
inline constexpr double kStoppedClockSpeed_mps =
    20;  // least speed assumed over an unknown interval; [safety time jumps]
inline constexpr double kLongestUsualInterval_s = 5;  // of the interval that stands for an unknown one; chosen
// Share of an interval's change of velocity times the interval: when within it the change came is unknown. Physics
// bounds it by 0.5; chosen with [flights] IMU.
inline constexpr double kUnknownMomentShare = 0.08;
// Gaps. No turn there and back fits into less: rolling in and out twice takes that long (45° at 90°/s each); physics.
inline constexpr double kCourseHeld_s = 2;
inline constexpr double kMaxBank_rad = std::numbers::pi / 4;  // 45°: ArduPlane's default ROLL_LIMIT_DEG
// Gap over correlation time that leaves the position least known; mathematics: argmax (x - 2 tanh(x/2)) / x².
inline constexpr double kLeastKnownBridge = 3.212;

}  // namespace flight_filter

// A MEMS sensor that the autopilot has calibrated: what the filter takes its errors for. Datasheet: TDK InvenSense
// DS-000347, ICM-42688-P, 0.0028 deg/s/√Hz and 70 µg/√Hz (65 for x and y).
namespace inertial {

// A sample holds so long at most. ArduPlane sends 40 a second, of which two may be lost; chosen.
inline constexpr double kMaxGap_s = 0.08;
inline constexpr double kMaxPart_s = 1;   // preintegrated at once; chosen
inline constexpr double kMaxWay_s = 600;  // between two frames: no calibration carries a position longer; chosen
inline constexpr double kRateRange_rad_s = 34.5;  // saturated at ±2000 deg/s = 34.9; datasheet
inline constexpr double kForceRange_mps2 = 155;   // saturated at ±16 g = 156.9; datasheet
inline constexpr double kSmallAngle_rad = 1e-4;   // series instead of sines; numerical
// White noise, of a rate per √Hz. Three times the datasheet's: an engine shakes the sensor, and RAW_IMU counts mrad/s.
inline constexpr double kRateNoise_rad_s = 1.5e-4;
inline constexpr double kForceNoise_mps2 = 0.02;  // likewise; thirty times the datasheet's; chosen
// Biases at the beginning, after the autopilot's calibration: 0.6 deg/s; 20 mg, and what a mount askew by 2° makes of
// gravity; chosen.
inline constexpr double kRateBias_rad_s = 0.01;
inline constexpr double kForceBias_mps2 = 0.4;
// Their random walk per √s: 0.003 deg/s and 1 mg in 100 s, bias instability included; chosen, [blind].
inline constexpr double kRateBiasWalk_rad_s = 5e-6;
inline constexpr double kForceBiasWalk_mps2 = 1e-3;
inline constexpr double kBiasKeptVarianceRatio = 4;  // of a bias, after a stretch without samples; chosen
// Errors of scale and of the axes' angles. Datasheet: scale within 0.5 %, cross-axis sensitivity within 1.25 %; and 1°
// of mount; chosen.
inline constexpr double kRateScale = 0.02;
inline constexpr double kRateScaleRest = 0.0005;  // what they leave: nonlinearity 0.1 %; chosen
inline constexpr double kForceScale = 0.003;
inline constexpr double kManoeuvreTurn_rad = 1.571;  // in which they add up: a quarter of a circle
inline constexpr double kManoeuvreChange_mps = 30;   // … and what that does to the velocity
// Of the camera's attitude at a frame against the sensor's: a soft mount, and the frame's time; chosen.
inline constexpr double kAttitudeNoise_rad = 0.003;
inline constexpr double kFrameTime_s = 0.015;
inline constexpr double kLeastTurnSigma_rad = 0.002;  // of the heading between frames, for odometry's prior; chosen
inline constexpr double kStartHeading_rad = 0.3;  // σ of the heading above which the attitude is not begun; linearity
inline constexpr double kEarthRate_rad_s = 7.292115e-5;  // IERS 2010
// Of a visual motion against the inertial one, three degrees of freedom: 1 in 65 000 of Gaussian ones.
inline constexpr double kMotionGate_chi2 = 25;
inline constexpr int kRefusedInARow = 3;     // visual motions, then it is the inertial sensor that is wrong; chosen
inline constexpr int kMaxSensorRefused = 3;  // in a flight, then it is not used any more; chosen

}  // namespace inertial

namespace pose_measurement {

// σ of a direction that the image does not constrain: practically infinite, yet invertible.
inline constexpr double kVaguePositionHeights = 10;  // of an absolute position, in heights above ground; numerical
inline constexpr double kVagueMotionLengths = 100;   // of a relative motion, in (1 m + its length); numerics
inline constexpr double kWidestPrior = 10;  // over a measurement's variance, that a chance peak is beside it; chosen

}  // namespace pose_measurement

namespace smoother {

inline constexpr double kContradiction_chi2 = 25;       // two degrees of freedom: 1 in 270 000, of many anchors
inline constexpr std::size_t kMaxRejectedAnchors = 40;  // passes over the flight; bounds the time
// Share of an anchor's own covariance that remains where it alone makes the track; numerics.
inline constexpr double kSoleAnchorShare = 0.02;

}  // namespace smoother

namespace two_view_motion {

inline constexpr double kMinDownComponent = 0.2;  // of a unit ray: flatter ones see the horizon; chosen
inline constexpr std::size_t kMinRayPairs = 6;    // eight unknowns, six of them with priors; geometry
// Ray pairs that count as independent at most, whatever their residuals say; [consistency] of simulated odometry.
inline constexpr double kMaxIndependentPairs = 100;
// Residuals larger than pixel noise and relief explain by this factor fit no single motion: rejected. Found by a turn
// that was 180° off, 22 Nov 2026.
inline constexpr double kMaxResidualRatio = 5;
// Beyond this difference from the predicted turn the heading prior is opened: the telemetry contradicts the images.
inline constexpr double kFarTurn_rad = 0.4;  // chosen; below tracking::kContradictedTurn_rad
inline constexpr double kFarTurnSigmas = 4;
inline constexpr double kPixelHeightShare = 0.0015;  // a pixel of the working size on the ground, over the height
inline constexpr double kFirstScalePixels = 30;      // graduated non-convexity begins here; chosen
inline constexpr double kScaleShrink = 0.6;          // of the kernel's scale per iteration; chosen
inline constexpr double kScaleSlack = 1.01;          // within which the scale counts as reached; numerics
inline constexpr double kMedianOverSigma = 1.177;    // mathematics: median of a Rayleigh distribution, √(2 ln 2)
inline constexpr int kMaxIterations = 30;            // chosen
inline constexpr double kInlierSigmas = 3;           // bound of the robust kernel; chosen

// Defaults of the prior; the localizer sets all of them.
inline constexpr double kDefaultHeadingSigma_rad = 0.1;
inline constexpr double kDefaultTiltVariance_rad2 = 1e-3;
inline constexpr double kDefaultLogHeightSigma = 0.03;
inline constexpr double kDefaultReliefSigma_m = 1.5;

}  // namespace two_view_motion

namespace visual_odometry {

inline constexpr int kMaxFeatures =
    1200;  // 900 track two frames fewer of 57 on sparse photos, for 4 ms less; docs/benchmarks.md
inline constexpr int kOctaveLayers = 3;         // SIFT's own default (Lowe 2004)
inline constexpr double kSiftContrast = 0.007;  // weaker than SIFT's 0.04, for half the size; [ablations]
inline constexpr double kMatchRatio = 0.85;     // nearest over second nearest descriptor (Lowe 2004: 0.8); chosen
// SIFT begins by doubling the image. At half the size it costs a third and drifts less; [ablations], 21 Nov 2026.
inline constexpr double kWorkingWidth_px = 450;
inline constexpr int kMinInliers = 12;                  // chosen; not measured
inline constexpr double kHomographyThreshold_px = 3;    // OpenCV's default
inline constexpr int kHomographyIterations = 5000;      // chosen; not measured
inline constexpr double kHomographyConfidence = 0.999;  // chosen; not measured
inline constexpr double kModelErrorShare = 0.01;        // of the motion: lens, shutter, relief; [turns]
inline constexpr double kTurnErrorShare = 0.05;         // of the turn: hills under a banked camera err by 3 %; [turns]
// Features that moved by less show what moves along with the camera. SIFT finds a spot again within some tenths; at
// 22 m/s, 30 frames a second and 400 m above ground the ground moves by 0.8 px. Chosen.
inline constexpr double kStill_px = 0.5;

// Defaults of a front end's input; the localizer sets all of them.
inline constexpr double kDefaultHeadingSigma_rad = 0.05;
inline constexpr double kDefaultTiltSigma_rad = 0.03;
inline constexpr double kDefaultReliefSigma_m = 1.5;
inline constexpr double kDefaultRelativeHeightSigma = 0.02;

}  // namespace visual_odometry

namespace correlated_frames {

// Where features fail, averages of pixels carry less of their noise. At 160 px as many motions are found, at 220 fewer.
inline constexpr double kWidth_px = 120;    // of the ground that a frame shows; [dark]
inline constexpr double kReachShare = 0.5;  // of a footprint's longer side: no longer displacement is searched; chosen
inline constexpr double kMargin_px = 4;     // around what is searched; chosen
// Of what is searched: level frames need 250. Beyond it a camera looks at the horizon, or heights do not fit; chosen.
inline constexpr double kMostSide_px = 1000;
inline constexpr double kDistinct_px = 8;  // places closer than this are one; chosen
inline constexpr double kMaxRatio = 0.8;   // the second best place over the best; of mirrored frames half are above
inline constexpr double kContrast = 40;  // grey levels (standard deviation) that a darker picture is spread to; chosen
inline constexpr double kMiddleGrey = 128;   // of 256
inline constexpr int kBrightnessCells = 16;  // a side of the grid of means that the slow brightness fits; chosen
// Of the ground: patches that moved by less show what moves along. At 22 m/s, 3 frames a second and 200 m above ground
// it moves by 4.6 px. Chosen.
inline constexpr double kStill_px = 2;
// Patches of 32 px in 12 x 8 agree on a motion of mirrored frames 9 times in 187, these once in 795; [flights] at
// night, base seeds 41 to 44.
inline constexpr int kPatch_px = 28, kPatchColumns = 8, kPatchRows = 6;
inline constexpr double kPatchSearch_px = 6;  // a patch may lie this far off; chosen
// So many patches count as one: 3.5 show the same ground, and errors are larger than that explains. With ten 1 % of the
// errors at night are beyond the ellipse of 99.9 %, with 3.5 it would be 2.4 %; [dark], base seed 1.
inline constexpr double kRedundancy = 10;

}  // namespace correlated_frames

namespace tracking {

inline constexpr double kOverlapReachShare = 0.5;  // of a footprint's longer side: a shorter displacement overlaps
inline constexpr double kOverlapSpeedSigmas = 2;   // of the speed, for the same; chosen
inline constexpr double kLeapSpeedSigmas = 4.5;    // a step beyond is no motion of the aircraft; [safety outlier 3754]
inline constexpr double kGusts_mps = 5;            // least σ of the speed for the same; chosen
inline constexpr double kLeapSlackShare =
    0.1;  // of a footprint's longer side: what an unmodelled tilt looks like; chosen
// A motion that fewer pairs of pixels agree on is chance one time in nine, where frames hardly overlap, and 40 to 75 m
// off the prediction then: of 54 such motions six were wrong, five of them beyond this (three degrees of freedom), and
// none of the right ones; [navigability], 92 flights of seeds 201 to 208 and 1 000 701 to 1 000 722.
inline constexpr int kSureInliers = 20;
inline constexpr double kChanceMotion_chi2 = 6.25;
inline constexpr double kChanceShare = 0.11;          // of motions with fewer inliers: six of 54, the same
inline constexpr double kContradictedTurn_rad = 0.5;  // image and telemetry disagree on a turn: 29°; chosen
inline constexpr double kContradictedTurnSigmas = 5;  // … by more than this beyond what is uncertain; chosen
inline constexpr double kResolvedHeading_rad = 0.5;   // below: the heading is known again; chosen
inline constexpr double kWrongCourseFactor = 2;       // σ grows by so many step lengths: there and back; geometry
inline constexpr double kMinTurnSigma_rad = 0.02;     // of the telemetry's change of heading; chosen
inline constexpr double kTurnSigmaShare = 1.5;      // √2 of the white part and the deviation over a turn, rounded up
inline constexpr double kUnknownTurnSigma_rad = 1;  // no heading measured
inline constexpr double kSteadyHeightShare = 0.5;   // of the stated height σ, from one frame to the next; chosen
inline constexpr double kUnmeasuredHeightSigma = 0.3;  // log height, no height measured; chosen
inline constexpr double kSlopeBaselineDivisor = 3;  // footprint over the distance to each side that slope is taken over

}  // namespace tracking

// The second map matcher: descriptors of a network in the place of oriented channels.
namespace learned_matching {

inline constexpr std::int64_t kMaxModelBytes = 64 << 20;  // of a model's file; XFeat has 3 MB; chosen
inline constexpr std::size_t kMaxTensorSides = 8;         // dimensions of a model's input or output; chosen
inline constexpr std::size_t kMaxTensors = 16;            // inputs or outputs of a model; chosen
inline constexpr std::int64_t kMinDescriptorChannels = 4, kMaxDescriptorChannels = 256;  // of a descriptor; chosen
inline constexpr int kDescribedPart_px = 768;    // side of what a network is shown at once: bounds its memory; chosen
inline constexpr int kDescribedMargin_px = 64;   // of a part, described and left out: what XFeat sees around a cell
inline constexpr double kLeastCellShare = 0.9;   // of a cell's pixels that are valid; chosen
inline constexpr float kDescriptorScale = 2.0F;  // unit vectors as channels of the order of 1; numerical
// Of a frame's longer side: as prototypes matched best, 0.45 to 0.5 m a pixel from 100 to 120 m.
inline constexpr double kDescribedFrame_px = 256;
inline constexpr int kPrincipalChannels = 16;       // that are correlated
inline constexpr double kDescribedTurn_rad = 0.16;  // a description serves headings up to so far: 9 degrees; chosen
inline constexpr int kConfirmSlack_cells = 2;       // around a hypothesis of the sweep; chosen
inline constexpr std::size_t kConfirmedPlaces = 3;  // described anew, upright; chosen
inline constexpr int kPatch_cells = 6, kPatchStep_cells = 3;       // of patches; 48 px as those of oriented channels
inline constexpr int kPatchSearch_cells = 2;                       // a patch may lie so far off; chosen
inline constexpr std::array<double, 2> kInlierCells = {1.0, 0.5};  // of a patch's residual, by round; chosen

inline constexpr int kNetworkTrials = 3;  // that are timed; chosen

}  // namespace learned_matching

namespace belief {

// P_D differs from ground to ground and from camera to camera: a beta distribution, of which a flight learns the rest.
// Over the grounds of [looks], clear images: mean 0.79, variance 0.044.
inline constexpr double kDetectionHits = 2.15;
inline constexpr double kDetectionLooks = 2.7;
// Factors on the odds of P_D by the class of the ground, weak as poor; 1467 clear looks of [looks] 1 over ground that
// the map shows. On 1668 unseen ones they gain 0.031 nats a look (± 0.012) over what a flight learns
// (docs/look-likelihood.md).
inline constexpr double kGoodDetectionOdds = 1.6;
inline constexpr double kPoorDetectionOdds = 0.27;
inline constexpr int kDetectionSamples = 5;        // of a hypothesis, a side: their mean; numerical
inline constexpr double kInitialVisibility = 0.8;  // before any look, that the map shows the place; chosen
// Over a footprint of new ground the chance that the map shows the place returns to kInitialVisibility by so much of
// the difference. Chosen: with 0.05 chance peaks under clouds are hazardous more often (docs/safety-case.md).
inline constexpr double kVisibilityChange = 0.02;
inline constexpr double kForeignFrame = 1e-4;       // the frame is of another moment; chosen …
inline constexpr double kForeignBrokenFrame = 0.5;  // … where it does not continue the previous one: one of the two is
inline constexpr double kStartDoubt = 3e-3;         // a position that a person gave is wrong as a whole; chosen
inline constexpr double kHintDoubt = 1e-2;          // a hint is wrong as a whole: a GPS may be spoofed; chosen
inline constexpr double kHintSigmas = 2;            // its radius in σ of one axis: 86 % are inside; chosen
inline constexpr double kTrackHazard_per_s = 1e-8;  // the track becomes wrong as a whole without a sign; chosen
inline constexpr double kIntegrityRisk = 1e-5;      // per look: beyond the protection level; a mission may set it
// Of the protection level, for errors that stay with the ground and chance peaks beside the place. Of 10 008 true places
// (base seed 7000000) with the σ of below none lies beyond 3.3 σ, of a Gaussian 43. Chosen between 1.15 and 1.5; [looks].
inline constexpr double kTailVarianceFactor = 1.2;
inline constexpr double kMaxPlaceDoubt = 1e-3;  // of the weight may be elsewhere when the track moves; [looks]
// A chance peak beside the truth, within the prediction: the filter weighs by it. Chosen: three to one.
inline constexpr double kMaxAssociationDoubt = 0.25;
// Of a place beside the candidate: half of the least window, so that the next look searches it as well. Chosen.
inline constexpr double kHarmless_m = 30;
// Of the hits of a place that contradicts the track; 0.5 and 0.001 are worse: docs/safety-case.md.
inline constexpr double kDisplacedMapShare = 0.01;
inline constexpr double kOverrulingFootprints =
    6;                                        // of ground that is no accident of the matcher; [safety 164, 244, 305]
inline constexpr double kSharp_m = 20;        // one axis: an anchor within such a prediction confirms it
inline constexpr double kChi2_95 = 5.991;     // of χ² with two degrees of freedom
inline constexpr double kChi2_999 = 13.816;   // likewise, 99.9 %
inline constexpr double kSamePlace_chi2 = 1;  // two places are merged; chosen
inline constexpr double kLeastInArea =
    1e-2;  // share of a hypothesis inside the area: with less the area says nothing; chosen
inline constexpr double kVagueWeight = 1e-2;    // of places that the published covariance leaves out; its 95 % ellipse
                                                // hardly knows them, the protection level does
inline constexpr double kAlikeVariance = 4;     // over the track's: a place that is wider is not the track; chosen
inline constexpr double kMostMotion_chi2 = 50;  // that speaks for what a motion contradicts; numerical
inline constexpr double kLeastWeight = 1e-9;    // of a place that is kept; numerical
inline constexpr std::size_t kMaxPlaces = 15;   // beside the track; bounds the time
inline constexpr int kProtectionLevelBisections = 40;  // to 1e-12 of the radius; numerical
inline constexpr double kWorthKeeping = 2.303;         // ln 10: a lost look goes on elsewhere below; chosen
inline constexpr double kUnambiguous = 6.908;  // ln 1000: needs no other look, for products of the frame; [looks]

}  // namespace belief

namespace anchor_measurement {

// What the pose solver does not model (trees, roofs, shutter, the moment of the telemetry), as a factor of its
// variance; from the normalised errors of simulated flights.
inline constexpr double kModelErrorFactor = 4;
inline constexpr double kUnknownTiltModelErrorFactor = 9;  // all of that looks like a tilt; [safety NaN attitude 755]
// Sets of patches that agreed on a wrong pose nearby lay up to 26 px from the truth; [safety night 4734, height 5045].
inline constexpr double kWrongConsensusSigma_px = 10;
// That such a set is the wrong one, and then 26 px off (σ): of the same variance as 10 px, so their square; chosen.
inline constexpr double kWrongConsensusChance = 0.15;
// The larger a set is, the less it can be wrong: all of the σ up to this share of patches that agree [safety 2220], and
// none of it from so much more on. Of 3987 training looks with larger shares four were more than three σ off; [looks].
inline constexpr double kFewPatches = 0.5;
inline constexpr double kFewPatchesRange = 0.15;
// Where another place scores nearly as well, ground resembles itself, and patches may agree a row beside the place,
// nearer than another place may be: of 142 training looks with ratios from 0.85 on and shares of 0.5 to 0.8 twenty were
// more than three σ off, by up to 28 m; of 31 with more none. As much more have to agree there; from 0.7 on the second
// best place may be the true one, and a part of it counts; [looks].
inline constexpr double kAlikePatches = 0.3;
inline constexpr double kUnlikeRatio = 0.7, kAlikeRatio = 0.85;
// The second best place of a search: odds that it is the true one and not the best, e^(a - b (1 - ratio)). Logistic
// regression of 531 training looks with ratios above 0.75 whose patches speak for the best; [looks].
inline constexpr double kRivalLogOdds = -0.8;
inline constexpr double kRivalLogOddsPerRatio = 18;
inline constexpr double kRivalSigma_px = 6;  // one axis, at the coarse GSD: its place is searched, not solved; [looks]
inline constexpr double kSharedErrorFootprints = 1.5;  // anchors within it count as one; [safety heading 73]
inline constexpr double kMinHeightSigma = 0.012;       // log height: roofs, trees, rolling ground; chosen
inline constexpr double kMinTiltVariance_rad2 = 1e-6;  // keeps the prior invertible; numerics
// Apparent tilt and height error from roofs and rolling ground within a footprint, however well both are known; chosen.
inline constexpr double kTiltModelError_rad = 0.015;
inline constexpr double kHeightModelError = 0.015;
// What no model has (lens, relief, the moment of the telemetry) and no number of anchors averages out, over the height;
// 0.8 %, then 1 %, then 1.5 %: [safety 73, 3562, 1318].
inline constexpr double kUnmodelledShare = 0.015;

}  // namespace anchor_measurement

namespace search_window {

inline constexpr double kMinRadius_m = 60;       // half the side of the searched square; chosen
inline constexpr double kMaxRadius_m = 1200;     // beyond: the area is searched; time of a search, docs/benchmarks.md
inline constexpr int kFailuresPerRing = 3;       // frames that fit nowhere widen the window by its least radius; chosen
inline constexpr int kMaxRings = 4;              // chosen
inline constexpr double kReachSigmas = 3;        // half side in σ of the position
inline constexpr double kStartReachSigmas = 5;   // until the first anchor; 3 left out one start in 200, where chance
                                                 // peaks compete with nothing: docs/safety-case.md
inline constexpr double kPart_m = 1600;          // side of an area's part searched for one frame: its time
inline constexpr double kHeadingSigmas = 3;      // searched headings
inline constexpr double kScaleSigmas = 2.5;      // searched heights
inline constexpr double kMinHintReach_m = 100;   // so that other places compete; chosen
inline constexpr double kMinFootprint_px = 128;  // of the map, along a frame's longer side, to be searched for
                                                 // everywhere: a runway in the image cost 84 s, 22 Nov 2026

}  // namespace search_window

namespace localizer {

inline constexpr double kStartSigma_m = 50;         // start position, one axis; default, set by the caller
inline constexpr double kNoFixSigma_m = 500;        // beyond this no position is published; chosen
inline constexpr double kMapSigma_m = 2.8;          // CE90 of 6 m; for maps whose tiles state none
inline constexpr double kAssumedAgl_m = 120;        // height until telemetry has one; chosen
inline constexpr double kMatchAboveSigma_m = 5;     // one axis: the map is searched again; chosen
inline constexpr double kLeastLostSigma_m = 1000;   // no start and no area: chosen
inline constexpr double kCorroborationTime_s = 60;  // an anchor farther in time corroborates little; chosen
inline constexpr double kOutsideHintSigmas = 3;     // a position farther from a hint contradicts it; chosen
inline constexpr double kCe90OverSigma = 2.146;     // mathematics: √(-2 ln(1 - 0.9))

}  // namespace localizer

namespace terrain {

// What elevation models leave out over a frame's footprint. The global ones state 2 m (90 %) between neighbouring
// posts, hence about a metre, one sigma; across 200 to 300 m that is a slope of 0.004.
inline constexpr double kReliefSigma_m = 1.0;
inline constexpr double kMinCell_m = 250;  // of the table of raster positions: a millimetre off
inline constexpr double kMaxCells = 1000;  // a side; bounds the memory

}  // namespace terrain

// A second matcher's opinion on what the first one found.
namespace second_opinion {

inline constexpr double kAgreement_cells = 2.5;  // of 8 px at the second's GSD: two places as far apart are one; chosen
inline constexpr double kConfirmedRadius_m =
    120;  // half side of the window around what a lost look found; as looks that were counted
// Classes of the first's ln ℓ, and of the second's: what is above these is counted by itself; chosen.
inline constexpr std::array<double, 2> kFirstClasses = {0.0, 3.5};
inline constexpr double kStrong = 3.0;
inline constexpr double kMostClaim =
    6.9;  // nats: no look becomes unambiguous (belief::kUnambiguous) by a second matcher
inline constexpr double kMostFrame_ms =
    100;  // processor time to describe a frame; a look takes some twenty times as much; chosen
// An upper bound (95 %) of a count n is n + 3 + 1.645 √n: of 0 it is 3, the rule of three.
inline constexpr double kRuleOfThree = 3.0, kUpperSigmas = 1.645;

}  // namespace second_opinion

// Beyond these telemetry is garbage and becomes unknown.
namespace plausible {

inline constexpr double kMinAgl_m = 1;                 // no aircraft matches the map from lower; chosen
inline constexpr double kMaxAgl_m = 30'000;            // above the ceiling of aircraft; physics
inline constexpr double kMaxAngle_rad = 100;           // several turns, for sources that do not wrap; chosen
inline constexpr double kMaxVelocityChange_mps = 200;  // from flying one way to flying the other
inline constexpr double kMaxAcceleration_mps2 = 60;    // 6 g: beyond the load limit of such aircraft
inline constexpr double kMaxRate_rad_s = 20;           // three turns a second; chosen

}  // namespace plausible

}  // namespace parameters

}  // namespace nadir
