// The numbers that decide in libgeo/vision, by module: value, unit, and where each comes from.
//
// "Chosen": set when the module was written; no measurement of this number is recorded. "Numerical": guards degenerate
// cases and stops iterations. Mathematics (0.5, 2π) and constants of
// file formats stand where they are used. Acceptance, filter and odometry: libgeo/estimation.
#pragma once

#include <array>
#include <cstddef>
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
inline constexpr double kMinContrast = 5;        // grey levels, 1-sigma; chosen; tests/vision/camera_frame_test
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
inline constexpr double kMinTemplateEnergy = 1e-9;  // numerical
inline constexpr float kMinPeakCurvature = 1e-9F;   // flatter: the peak is not interpolated; numerical
inline constexpr int kMapChannelsMargin_px = 12;    // channels of the map are made with: the next request lies close by

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
inline constexpr double kWorthShrinking = 0.95;       // of the map, likewise as kWorthReducing; chosen

// ---- search in an area

inline constexpr std::size_t kChunksPerPlace = 8;  // neighbouring chunks overlap, and all of them look like the place
// Of a chunk's side: the index is good to a sixth of it, and a frame is not as large as the chunk; chosen.
inline constexpr double kRetrievedReach = 0.35;
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
inline constexpr int kPatchStep_px = 2;                // first pass: the channels are smooth enough not to hide a peak
inline constexpr int kPatchAround_px = 2;              // second pass, around the best of the first
inline constexpr int kChannelReach_px = 8;             // of the channels' smoothing, for the map's margin

// ---- robust Gauss-Newton

inline constexpr double kJacobianStep = 1e-5;        // of central differences: truncation and rounding below 1e-9
inline constexpr double kDivergedStep = 1.0;         // rad or log: a larger step is not a refinement
inline constexpr double kConvergedStep_m = 1e-4;     // of the position; numerical
inline constexpr double kConvergedStep = 1e-6;       // of the other unknowns; numerical
inline constexpr std::size_t kCorrelationRings = 8;  // of distance, in which residuals are correlated; chosen
inline constexpr double kCorrelationReach = 0.4;     // of the extent: farther apart nothing is learnt about correlation
inline constexpr std::size_t kCorrelationSamples = 300;  // measurements used; more add no information

// ---- camera pose

inline constexpr int kPoseIterations = 25;             // chosen
inline constexpr std::size_t kMinCorrespondences = 4;  // eight equations for eight unknowns with priors; chosen
inline constexpr double kMinSolverRayDown = 0.2;       // of a ray's length: flatter rays see the horizon; chosen
inline constexpr double kPoseBeginScale = 4;           // times the inlier bound: nearly convex; chosen
inline constexpr double kPoseNarrowing = 0.7;          // of the scale, each iteration; chosen
inline constexpr double kPoseInlier_m = 2.0;           // default; the refinement sets it
inline constexpr double kPoseMinSigma_m = 0.5;         // default; the refinement sets it
inline constexpr double kPriorHeadingSigma_rad = 0.2;  // defaults of a pose's prior; callers set them
inline constexpr double kPriorLogAglSigma = 0.1;
inline constexpr double kPriorTiltVariance_rad2 = 0.01;
inline constexpr double kPriorSlopeSigma = 0.02;

// ---- map matcher: refinement of the best hypothesis

struct RefinementRound {
  int columns, rows;  // of patches
  double search_px;
  double inlier_px;  // of the map's pixels
};
// The search is good to some pixels, each round to fewer; chosen.
inline constexpr std::array<RefinementRound, 3> kRefinementRounds{{{8, 6, 12, 7.0}, {12, 8, 8, 3.5}, {12, 8, 6, 3.5}}};
inline constexpr double kRefinementSlack_m = 30;  // of map around the footprint at the best hypothesis; chosen
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
inline constexpr std::size_t kHitsPerQuery = 64;  // chunks that each variant of the frame may name; chosen

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
inline constexpr double kMaxMatchabilityRatio = 2;  // above 1 another place fits better, by how much does not matter
inline constexpr double kMatchabilityFootprint_m = 120, kMatchabilityRadius_m = 100;  // defaults; the survey sets them

}  // namespace nadir
