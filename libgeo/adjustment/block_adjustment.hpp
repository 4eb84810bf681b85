// Bundle block adjustment of a flight: all camera poses, the points that several frames show, and what the frames have
// in common (focal length, distortion, boresight), estimated together from everything that was measured. A pure
// computation over numbers: it sees no image, no file and no clock. docs/adjustment.md has figures.
//
// State. Frame i: centre C_i = (east, north, up) [m] in the local plane and attitude R_i = world_from_camera
// (enu_from_camera(), camera.hpp). Point j: X_j [m]. Shared: f (logarithm of the focal length over the nominal one),
// distortion k1 k2 p1 p2 k3, boresight b [rad], s (logarithm of the scale of measured heights). In frame i, point j is
//   p = camera_from_world(X_j) = R_iᵀ (X_j - C_i),   pixel = lens(p; f, k).
// CameraPose states a height above ground: agl = C_up - ground(C), with the ground of a GroundSurface.
//
// Measurements, residual over sigma (residuals.hpp):
//   tie point      (lens(p_ij) - pixel_ij) / σ_px                               pixels
//   anchor         L⁻¹ ((C_east, C_north) - position),  covariance L Lᵀ         where the frame was taken
//   pose anchor    L⁻¹ ((C_east, C_north, log agl, heading, pitch, roll) - measured),  covariance L Lᵀ
//                                                                               a whole match with the map
//   control        ((X_east, X_north) - place) / σ_m                            a person's fix: a point in image and
//   map attitude       Log(R (R_measured Exp(b))ᵀ) / (σ_tilt, σ_tilt, σ_heading)    radians, about east, north, up
//   height         (log(agl) + s - log(agl_measured)) / σ                       relative
//   terrain        (X_up - ground(X)) / σ                                       metres, for each point
//   motion         (C_i - C_i-1 - step) / σ                                     only of frames with few tie points
//   priors of f, k, b and s
//
// The terrain is a weak prior, and has to be. Points that stand closer together than its correlation length err alike
// (a wood, a datum): n points in a cell of that length have their σ multiplied by √n, so that together they say as much
// as one. If every point counted by itself, their own relief would pull at the scale: images determine the shape z of
// the ground up to a scale b, and Σ (b z - ground)² / σ² is least at b = var(ground) / (var(ground) + σ²), below 1
// (errors in variables; Fuller 1987), with a confidence that grows with the number of points. With cells of 250 m there
// are too few of them to outweigh height measurements and anchors. A point beyond four σ (a tower; a false match, which
// two rays cannot tell) is left out of this prior.
//
// The principal point is not adjusted: seen from above it cannot be distinguished from a boresight of pitch and roll.
//
// Method. Minimise the sum of squares by Levenberg and Marquardt's method with points eliminated (Schur complement;
// Triggs, McLauchlan, Hartley and Fitzgibbon 1999, "Bundle Adjustment: A Modern Synthesis"), in Ceres (Agarwal, Mierle
// and others). One thread: the same input gives the same bits. Then covariances from the same linear system
// (selected_inverse.hpp), because ceres::Covariance factors the whole Jacobian, points included, and takes minutes.
//
// Wrong anchors. Of a map with look-alikes some anchors are hundreds of metres off, with a small covariance. Each is
// switchable, by dynamic covariance scaling (Agarwal, Tipaldi, Spinello, Stachniss and Burgard 2013): with χ² of the
// anchor's residual, its residual is scaled by
//   s = min(1, 2Φ / (Φ + χ²)).
// Switchable constraints (Sünderhauf and Protzel 2012) estimate s as a variable with a prior of its own; scaling is
// the closed form of that. It is chosen here because it adds no variables (an anchor stays a term of one frame, and the
// Schur complement keeps its pattern), because it leaves anchors with χ² <= Φ exactly as they were, so that
// covariances stay honest where nothing is wrong, and because a far anchor's pull tends to zero, where Huber's stays
// constant. It is not convex, so Φ starts 4096 times too wide and shrinks from round to round (graduated
// non-convexity; Blake and Zisserman 1987, Yang and others 2020). In the end an anchor beyond 99.9 % is removed, and
// taken back when the others agree with it after all. Tie points have Huber's loss, narrowed likewise, and are rejected
// beyond four sigmas.
//
// Gauge. Images alone leave position, heading and scale open. A block, frames that tie points or motion connect, is
// `anchored` when an anchor, a control point or a frame that is held says where it is. Otherwise it is `floating`: its
// first frame stays where it is, its shape is adjusted, and it has no covariances, because none could be honest.
//
// Windows. adjust(window) moves the frames in the window and the points that they see; other frames that see such
// points are held, and so is the calibration: a window is too small for it. Covariances are then those of the window
// against the held frames, plus the largest covariance among these: an error that they share moves the window too.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "adjustment/adjustment_parameters.hpp"
#include "adjustment/pose_covariance.hpp"
#include "base/progress.hpp"
#include "vision/rectification.hpp"

namespace nadir {

// Of a camera, by the autopilot and the nominal mount. Sigmas are of what differs from frame to frame; what is constant
// is boresight.
struct AttitudeMeasurement {
  Attitude attitude;
  double tilt_sigma_rad = 0;     // about the two horizontal axes, each
  double heading_sigma_rad = 0;  // about the vertical
};

// Above ground. Sigma of what differs from frame to frame; what is constant is the height scale.
struct HeightMeasurement {
  double agl_m = 0;
  double relative_sigma = 0;
};

struct AdjustmentFrame {
  CameraPose pose;  // where to start
  std::optional<AttitudeMeasurement> attitude{};
  std::optional<HeightMeasurement> height{};
  bool continues_flight = true;  // flown from the frame before, so that `pose` says by which step; false after a break
};

// Where the map shows that a frame was taken.
struct PositionAnchor {
  std::size_t frame = 0;
  PlanePoint position;
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Identity();
};

// A match of a frame with the map, as a whole: position, height and attitude by the image alone, without any prior
// (pose_measurements.hpp). Seen from above, tilt and position are nearly one unknown. Their joint covariance keeps what
// the position alone would lose: tie points that determine the tilt then determine the position as well.
struct PoseAnchor {
  std::size_t frame = 0;
  CameraPose pose;
  // Of (east m, north m, log height above ground, heading, pitch, roll); practically infinite where the image does not
  // determine something.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
};

struct ImageObservation {
  std::size_t frame = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double sigma_px = parameters::adjustment::kObservationSigma_px;  // each axis
};

// A place that is known on the map, each axis.
struct GroundControl {
  PlanePoint place;
  double sigma_m = parameters::adjustment::kFixSigma_m;
};

struct TiePoint {
  std::vector<ImageObservation> observations;
  std::optional<GroundControl> control{};
};

// 1-sigma of what the calibration may differ by from the camera model; zero holds a parameter.
struct CalibrationPrior {
  double focal_relative = parameters::adjustment::kFocalSigma;
  double radial = parameters::adjustment::kRadialSigma;
  double tangential = parameters::adjustment::kTangentialSigma;
  double boresight_rad = parameters::adjustment::kBoresightSigma_rad;
  std::optional<double> heading_boresight_rad{};  // about the optical axis; nothing: as about the other two
  double height_scale = parameters::adjustment::kHeightScaleSigma;

  double boresight_axis_rad(std::size_t axis) const {
    return axis == 2 ? heading_boresight_rad.value_or(boresight_rad) : boresight_rad;
  }
};

struct AdjustmentOptions {
  CalibrationPrior calibration;
  double terrain_sigma_m = parameters::adjustment::kTerrainSigma_m;
  double terrain_correlation_m = parameters::adjustment::kTerrainCorrelation_m;  // zero: each point errs by itself
  bool covariances = true;
  bool point_covariances = true;  // only with `covariances`
};

// Frames [begin, end).
struct FrameWindow {
  std::size_t begin = 0, end = 0;
};

enum class AdjustmentOutcome {
  converged,
  iteration_limit,  // poses are improved, but might be still better
  underdetermined,  // some combination of frames is not determined: poses without covariances
};

enum class FrameState { anchored, floating, held };

struct AdjustedFrame {
  CameraPose pose;
  double up_m = 0;  // the centre's height above the plane
  FrameState state = FrameState::floating;
  std::optional<PoseCovariance> covariance{};  // only of anchored frames
  std::size_t observations = 0;                // that were used
};

struct AdjustedAnchor {
  std::size_t anchor = 0;  // in the order of add_anchor()
  bool switched_off = false;
  double switch_value = 1;  // s, 1: counts fully
  double chi2 = 0;          // of the residual by the anchor's own covariance, 2 degrees of freedom, of a whole pose 6
  Eigen::Vector2d residual_m = Eigen::Vector2d::Zero();  // adjusted minus anchor
};

enum class ObservationUse {
  used,
  outlier,         // contradicts the other observations of its point
  behind_camera,   // its point, as far as that is known
  too_few,         // its point has no second observation
  outside_window,  // nothing of it was adjusted
};

struct AdjustedObservation {
  ObservationUse use = ObservationUse::outside_window;
  Eigen::Vector2d residual_px = Eigen::Vector2d::Zero();  // seen at the adjusted state minus observed
};

struct AdjustedPoint {
  bool used = false;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();  // east, north, up
  std::optional<Eigen::Matrix3d> covariance_m2{};
  std::vector<AdjustedObservation> observations;        // in the order of the tie point's
  std::optional<Eigen::Vector2d> control_residual_m{};  // adjusted minus control
};

// A parameter of the calibration; sigma 0: held.
struct CalibratedValue {
  double value = 0, sigma = 0;
};

struct CameraSelfCalibration {
  CameraModel camera;                         // with the adjusted focal length and distortion
  CalibratedValue log_focal;                  // over the nominal one
  std::array<CalibratedValue, 5> distortion;  // k1 k2 p1 p2 k3
  std::array<CalibratedValue, 3> boresight;   // rad: world_from_camera = measured · Exp(boresight)
  CalibratedValue log_height_scale;           // measured height = true height · exp(this)
};

// The covariance between two frames: of their parameters as in AdjustedFrame, `a` in rows.
struct FrameCrossCovariance {
  std::size_t a = 0, b = 0;  // a > b
  PoseCovariance covariance;
};

struct AdjustedBlock {
  AdjustmentOutcome outcome = AdjustmentOutcome::converged;
  std::vector<AdjustedFrame> frames;                    // all that were added
  std::vector<AdjustedAnchor> anchors;                  // of frames that were adjusted
  std::vector<AdjustedPoint> points;                    // all that were added
  std::vector<FrameCrossCovariance> cross_covariances;  // of anchored frames that see a point together; sorted
  CameraSelfCalibration calibration;
  std::size_t observations = 0, rejected_observations = 0;   // used; outliers and those behind a camera
  double mean_reprojection_px = 0, rms_reprojection_px = 0;  // length of the residuals of used observations
  std::size_t floating_frames = 0;
  int iterations = 0;

  // Of the parameters of these frames together, in this order: what place_object() wants. Nothing when a frame floats,
  // is held or repeated, or two of them see no point together.
  std::optional<Eigen::MatrixXd> joint_covariance(const std::vector<std::size_t>& of) const;
};

class BlockAdjustment {
 public:
  // ground: must outlive this. Throws UsageError for a camera without a size or focal length, or negative sigmas.
  BlockAdjustment(const CameraModel& camera, const GroundSurface& ground, const AdjustmentOptions& options = {});
  ~BlockAdjustment();
  BlockAdjustment(BlockAdjustment&&) noexcept;
  BlockAdjustment& operator=(BlockAdjustment&&) noexcept;

  // Each throws UsageError for values that are not finite, sigmas that are not positive, and frames and points that do
  // not exist, and changes nothing then.
  std::size_t add_frame(const AdjustmentFrame& frame);  // returns its index
  std::size_t add_anchor(const PositionAnchor& anchor);
  std::size_t add_anchor(const PoseAnchor& anchor);
  // An observation in a frame that has one of this point already is left out: a point is at one place of a frame.
  std::size_t add_tie_point(const TiePoint& point);
  void add_observation(std::size_t tie_point, const ImageObservation& observation);
  // A person's fix: the same place in a frame and on the map.
  std::size_t add_fix(std::size_t frame, const Eigen::Vector2d& pixel, PlanePoint place,
                      double sigma_m = parameters::adjustment::kFixSigma_m);

  std::size_t frames() const;
  std::size_t observations() const;

  // Adjusts, and keeps the result as the start of the next adjustment. Cancelled, it throws Interrupted, and keeps what
  // it had before. Progress counts iterations.
  AdjustedBlock adjust(Progress& progress, const Cancel& cancel = {});
  AdjustedBlock adjust(FrameWindow window, Progress& progress, const Cancel& cancel = {});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
