#include "adjustment/adjustment_run.hpp"

#include <ceres/crs_matrix.h>
#include <ceres/iteration_callback.h>
#include <ceres/loss_function.h>
#include <ceres/manifold.h>
#include <ceres/normal_prior.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <exception>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

#include "adjustment/marginal_covariance.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

namespace table = parameters::adjustment;

CameraPose pose_from_block(const FrameBlock& block, const GroundSurface& ground) {
  CameraPose pose;
  pose.position = {block.values[0], block.values[1]};
  pose.agl_m = block.values[2] - ground.height_m(pose.position);
  pose.attitude = attitude_from_matrix(block.world_from_camera());
  return pose;
}

// Frames that are connected, directly or through others.
class Connections {
 public:
  explicit Connections(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0U); }
  std::size_t root(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::size_t a, std::size_t b) {
    const std::size_t of_a = root(a), of_b = root(b);
    parent_[std::max(of_a, of_b)] = std::min(of_a, of_b);
  }

 private:
  std::vector<std::size_t> parent_;
};

class CancelCallback final : public ceres::IterationCallback {
 public:
  CancelCallback(Progress& progress, const Cancel& cancel) : progress_(progress), cancel_(cancel) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    try {
      if (summary.iteration > 0) progress_.advance();  // may throw as well
      cancel_.check();
    } catch (...) {  // must not pass through Ceres
      thrown_ = std::current_exception();
      return ceres::SOLVER_ABORT;
    }
    return ceres::SOLVER_CONTINUE;
  }
  void rethrow() const {
    if (thrown_) std::rethrow_exception(thrown_);
  }

 private:
  Progress& progress_;
  const Cancel& cancel_;
  std::exception_ptr thrown_;
};

// One adjustment, of a window or of everything.
class AdjustmentRun {
 public:
  AdjustmentRun(const BlockData& data, BlockState& state, FrameWindow window, Progress& progress, const Cancel& cancel)
      : data_(data),
        state_(state),
        whole_(window.begin == 0 && window.end == data.frames.size()),
        progress_(progress),
        cancel_(cancel),
        free_(data.frames.size(), false),
        kept_(data.anchors.size(), true),
        uses_(data.points.size()),
        used_(data.points.size(), false),
        counts_(data.frames.size(), 0),
        connections_(data.frames.size()),
        anchored_(data.frames.size(), false),
        held_root_(data.frames.size(), false) {
    for (std::size_t j = 0; j < uses_.size(); ++j) {
      uses_[j].assign(data.points[j].observations.size(), ObservationUse::outside_window);
    }
    std::fill(free_.begin() + static_cast<std::ptrdiff_t>(window.begin),
              free_.begin() + static_cast<std::ptrdiff_t>(window.end), true);
  }

  AdjustedBlock run();

 private:
  void place_points();
  void connect();
  bool motion_between(std::size_t i) const;
  std::vector<double> terrain_sigmas() const;
  void build();
  void add_frame_terms();
  void add_calibration();
  void add_motion();
  void add_points();
  bool solve(int iterations, double tolerance, double trust_region);
  bool decide();
  double anchor_chi2(const BlockAnchor& anchor) const;
  bool covariances();
  void add_held_covariances(MarginalCovariances& marginal);
  void report_calibration();
  AdjustedBlock report() const;

  bool adjusted(std::size_t anchor) const { return free_[data_.anchors[anchor].frame]; }
  void add_term(ceres::CostFunction* cost, ceres::LossFunction* loss, std::vector<double*> blocks) {
    frame_terms_.push_back(problem_->AddResidualBlock(cost, loss, blocks));
  }

  const BlockData& data_;
  BlockState& state_;
  bool whole_;
  Progress& progress_;
  const Cancel& cancel_;
  std::vector<bool> free_;
  std::vector<bool> kept_;                         // per anchor
  std::vector<std::vector<ObservationUse>> uses_;  // per point and observation
  std::vector<bool> used_;                         // per point
  std::vector<std::size_t> counts_;                // used observations of each frame

  // Per frame: the first frame that it is connected with; and of that one, whether the block is anchored and whether it
  // has a held frame.
  Connections connections_;
  std::vector<bool> anchored_, held_root_;

  double anchor_bound_ = table::kAnchorBound, pose_bound_ = table::kPoseAnchorBound;
  double huber_width_ = table::kObservationHuber;
  std::unique_ptr<ceres::LossFunction> switchable_{switchable_loss(anchor_bound_)};
  std::unique_ptr<ceres::LossFunction> switchable_pose_{switchable_loss(pose_bound_)};
  std::unique_ptr<ceres::LossFunction> huber_{huber_loss(huber_width_)};
  std::array<double, 3> no_boresight_{};
  double no_scale_ = 0;
  std::unique_ptr<ceres::Problem> problem_;
  std::vector<ceres::ResidualBlockId> frame_terms_, point_terms_;

  AdjustmentOutcome outcome_ = AdjustmentOutcome::converged;
  int iterations_ = 0;
  bool settled_ = false;                                    // the graduated rounds are over
  std::vector<std::size_t> frame_indices_, point_indices_;  // of the covariances
  std::optional<MarginalCovariances> marginal_;
};

// Where points start: where the rays of their observations meet the ground, on average.
void AdjustmentRun::place_points() {
  CameraModel camera = data_.camera;
  camera.fx *= std::exp(state_.calibration.log_focal);
  camera.fy *= std::exp(state_.calibration.log_focal);
  camera.distortion = state_.calibration.distortion;
  std::vector<std::optional<CameraPose>> poses(data_.frames.size());
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    const TiePoint& point = data_.points[j];
    auto& uses = uses_[j];
    const bool seen = std::any_of(point.observations.begin(), point.observations.end(),
                                  [&](const ImageObservation& o) { return free_[o.frame]; });
    if (!seen) continue;
    if (!state_.point_known[j]) {
      Eigen::Vector2d sum = Eigen::Vector2d::Zero();
      double hits = 0;
      for (const ImageObservation& o : point.observations) {
        auto& pose = poses[o.frame];
        if (!pose) pose = pose_from_block(state_.frames[o.frame], data_.ground);
        const auto hit = ground_from_ray(*pose, camera.ray_from_pixel(o.pixel), data_.ground);
        if (!hit || !hit->vector().allFinite()) continue;
        sum += hit->vector();
        ++hits;
      }
      if (hits > 0) {
        const PlanePoint place(sum / hits);
        state_.points[j] = {place.east_m, place.north_m, data_.ground.height_m(place)};
        state_.point_known[j] = true;
      } else if (point.control) {
        const PlanePoint place = point.control->place;
        state_.points[j] = {place.east_m, place.north_m, data_.ground.height_m(place)};
        state_.point_known[j] = true;
      }
    }
    std::size_t usable = 0;
    for (std::size_t k = 0; k < uses.size(); ++k) {
      const FrameBlock& frame = state_.frames[point.observations[k].frame];
      const bool visible =
          state_.point_known[j] && project(data_.lens, state_.calibration, frame, state_.points[j]).has_value();
      uses[k] = visible ? ObservationUse::used : ObservationUse::behind_camera;
      usable += visible ? 1 : 0;
    }
    used_[j] = usable >= (point.control ? 1 : table::kMinRays);
    if (used_[j]) continue;
    for (auto& use : uses) {
      if (use == ObservationUse::used) use = ObservationUse::too_few;
    }
  }
}

bool AdjustmentRun::motion_between(std::size_t i) const {
  return i > 0 && data_.frames[i].continues_flight && (free_[i] || free_[i - 1]) &&
         (counts_[i] < table::kWellTied || counts_[i - 1] < table::kWellTied);
}

// Which frames belong together, and which of these blocks something ties to the map.
void AdjustmentRun::connect() {
  const std::size_t count = data_.frames.size();
  std::fill(counts_.begin(), counts_.end(), 0);
  connections_ = Connections(count);
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    if (!used_[j]) continue;
    std::optional<std::size_t> first;
    for (std::size_t k = 0; k < uses_[j].size(); ++k) {
      if (uses_[j][k] != ObservationUse::used) continue;
      const std::size_t frame = data_.points[j].observations[k].frame;
      ++counts_[frame];
      if (first) connections_.join(*first, frame);
      first = frame;
    }
  }
  for (std::size_t i = 1; i < count; ++i) {
    if (motion_between(i)) connections_.join(i - 1, i);
  }
  anchored_.assign(count, false);
  held_root_.assign(count, false);
  for (std::size_t a = 0; a < data_.anchors.size(); ++a) {
    if (kept_[a] && adjusted(a)) anchored_[connections_.root(data_.anchors[a].frame)] = true;
  }
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    if (!used_[j] || !data_.points[j].control) continue;
    for (std::size_t k = 0; k < uses_[j].size(); ++k) {
      if (uses_[j][k] != ObservationUse::used) continue;
      anchored_[connections_.root(data_.points[j].observations[k].frame)] = true;
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (free_[i]) continue;
    held_root_[connections_.root(i)] = true;
    if (state_.frame_states[i] == FrameState::anchored) anchored_[connections_.root(i)] = true;
  }
}

std::vector<double> AdjustmentRun::terrain_sigmas() const {
  std::vector<double> sigmas(data_.points.size(), data_.options.terrain_sigma_m);
  const double cell_m = data_.options.terrain_correlation_m;
  struct InCell {
    std::int64_t east, north;
    std::size_t point;
  };
  std::vector<InCell> cells;
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    if (!used_[j]) continue;
    if (settled_) {
      const Eigen::Vector3d& at = state_.points[j];
      const double off_m = std::abs(at.z() - data_.ground.height_m({at.x(), at.y()}));
      if (off_m > table::kTerrainOutlier * data_.options.terrain_sigma_m) {
        sigmas[j] *= table::kTerrainOutlierWidening;
        continue;
      }
    }
    if (cell_m <= 0) continue;
    cells.push_back({std::llround(state_.points[j].x() / cell_m), std::llround(state_.points[j].y() / cell_m), j});
  }
  std::sort(cells.begin(), cells.end(), [](const InCell& a, const InCell& b) {
    return std::tie(a.east, a.north, a.point) < std::tie(b.east, b.north, b.point);
  });
  for (std::size_t begin = 0; begin < cells.size();) {
    std::size_t end = begin;
    while (end < cells.size() && cells[end].east == cells[begin].east && cells[end].north == cells[begin].north) ++end;
    for (std::size_t i = begin; i < end; ++i) sigmas[cells[i].point] *= std::sqrt(static_cast<double>(end - begin));
    begin = end;
  }
  return sigmas;
}

void AdjustmentRun::build() {
  connect();
  ceres::Problem::Options options;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_ = std::make_unique<ceres::Problem>(options);
  frame_terms_.clear();
  point_terms_.clear();
  add_calibration();
  add_frame_terms();
  add_motion();
  add_points();
  for (std::size_t i = 0; i < free_.size(); ++i) {
    double* values = state_.frames[i].values.data();
    if (!free_[i] && problem_->HasParameterBlock(values)) problem_->SetParameterBlockConstant(values);
  }
}

void AdjustmentRun::add_calibration() {
  const CalibrationPrior& prior = data_.options.calibration;
  CalibrationBlock& c = state_.calibration;
  problem_->AddParameterBlock(&c.log_focal, 1);
  problem_->AddParameterBlock(c.distortion.data(), 5);
  problem_->AddParameterBlock(c.boresight_rad.data(), 3);
  problem_->AddParameterBlock(&c.log_height_scale, 1);
  problem_->AddParameterBlock(no_boresight_.data(), 3);
  problem_->AddParameterBlock(&no_scale_, 1);
  problem_->SetParameterBlockConstant(no_boresight_.data());
  problem_->SetParameterBlockConstant(&no_scale_);
  const auto add = [&](double* values, const std::vector<double>& sigmas, const std::vector<double>& means) {
    const auto size = static_cast<Eigen::Index>(sigmas.size());
    Eigen::MatrixXd weights = Eigen::MatrixXd::Zero(size, size);
    std::vector<int> held;
    for (Eigen::Index i = 0; i < size; ++i) {
      const double sigma = sigmas[static_cast<std::size_t>(i)];
      if (sigma > 0) {
        weights(i, i) = 1 / sigma;
      } else {
        held.push_back(static_cast<int>(i));
      }
    }
    if (!whole_ || held.size() == sigmas.size()) {
      problem_->SetParameterBlockConstant(values);
      return;
    }
    if (!held.empty()) problem_->SetManifold(values, new ceres::SubsetManifold(static_cast<int>(size), held));
    add_term(new ceres::NormalPrior(weights, Eigen::Map<const Eigen::VectorXd>(means.data(), size)), nullptr, {values});
  };
  const auto& k = data_.camera.distortion;
  add(&c.log_focal, {prior.focal_relative}, {0});
  add(c.distortion.data(), {prior.radial, prior.radial, prior.tangential, prior.tangential, prior.radial},
      {k.begin(), k.end()});
  add(c.boresight_rad.data(), {prior.boresight_axis_rad(0), prior.boresight_axis_rad(1), prior.boresight_axis_rad(2)},
      {0, 0, 0});
  add(&c.log_height_scale, {prior.height_scale}, {0});
}

void AdjustmentRun::add_frame_terms() {
  std::vector<double> members(free_.size(), 0);  // free frames of each block, by its root
  std::vector<bool> gauge_held = held_root_;
  for (std::size_t i = 0; i < free_.size(); ++i) members[connections_.root(i)] += free_[i] ? 1 : 0;
  for (std::size_t i = 0; i < free_.size(); ++i) {
    if (!free_[i]) continue;
    FrameBlock& frame = state_.frames[i];
    double* values = frame.values.data();
    const std::size_t root = connections_.root(i);
    // Where nothing was measured, the start counts: of all such frames of a block together, as much as once.
    const double share = std::sqrt(members[root]);
    const AdjustmentFrame& input = data_.frames[i];
    if (input.attitude) {
      add_term(attitude_cost(frame, enu_from_camera(input.attitude->attitude), input.attitude->tilt_sigma_rad,
                             input.attitude->heading_sigma_rad),
               nullptr, {values, state_.calibration.boresight_rad.data()});
    } else {
      const double sigma = share * table::kUnmeasuredAttitudeSigma_rad;
      add_term(attitude_cost(frame, enu_from_camera(input.pose.attitude), sigma, sigma), nullptr,
               {values, no_boresight_.data()});
    }
    if (input.height) {
      add_term(height_cost(data_.ground, input.height->agl_m, input.height->relative_sigma), nullptr,
               {values, &state_.calibration.log_height_scale});
    } else {
      add_term(height_cost(data_.ground, input.pose.agl_m, share * table::kUnmeasuredHeightSigma), nullptr,
               {values, &no_scale_});
    }
    if (!anchored_[root] && !gauge_held[root]) {
      const double variance = table::kGaugeSigma_m * table::kGaugeSigma_m;
      add_term(position_cost({values[0], values[1]}, variance * Eigen::Matrix2d::Identity()), nullptr, {values});
      gauge_held[root] = true;
    }
  }
  for (std::size_t a = 0; a < data_.anchors.size(); ++a) {
    const BlockAnchor& anchor = data_.anchors[a];
    if (!kept_[a] || !adjusted(a)) continue;
    FrameBlock& frame = state_.frames[anchor.frame];
    if (anchor.whole) {
      add_term(pose_cost(data_.ground, frame, anchor.whole->pose, anchor.whole->covariance), switchable_pose_.get(),
               {frame.values.data()});
    } else {
      add_term(position_cost(anchor.position, anchor.covariance_m2), switchable_.get(), {frame.values.data()});
    }
  }
}

void AdjustmentRun::add_motion() {
  for (std::size_t i = 1; i < free_.size(); ++i) {
    if (!motion_between(i)) continue;
    const Eigen::Vector3d step_m = data_.starts[i].centre_m() - data_.starts[i - 1].centre_m();
    add_term(motion_cost(step_m, hypotenuse(table::kMotionSigma_m, table::kMotionSigmaShare * step_m.norm())), nullptr,
             {state_.frames[i - 1].values.data(), state_.frames[i].values.data()});
  }
}

void AdjustmentRun::add_points() {
  const std::vector<double> terrain = terrain_sigmas();
  CalibrationBlock& c = state_.calibration;
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    if (!used_[j]) continue;
    const TiePoint& point = data_.points[j];
    double* position = state_.points[j].data();
    for (std::size_t k = 0; k < point.observations.size(); ++k) {
      if (uses_[j][k] != ObservationUse::used) continue;
      const ImageObservation& o = point.observations[k];
      FrameBlock& frame = state_.frames[o.frame];
      point_terms_.push_back(problem_->AddResidualBlock(reprojection_cost(data_.lens, frame, o.pixel, o.sigma_px),
                                                        huber_.get(), frame.values.data(), &c.log_focal,
                                                        c.distortion.data(), position));
    }
    point_terms_.push_back(problem_->AddResidualBlock(terrain_cost(data_.ground, terrain[j]), nullptr, position));
    if (point.control) {
      point_terms_.push_back(
          problem_->AddResidualBlock(control_cost(point.control->place, point.control->sigma_m), nullptr, position));
    }
  }
}

// False when it came to no end within the iterations.
bool AdjustmentRun::solve(int iterations, double tolerance, double trust_region) {
  ceres::Solver::Options options;
  auto* ordering = new ceres::ParameterBlockOrdering;
  bool any_point = false;
  std::vector<double*> blocks;
  problem_->GetParameterBlocks(&blocks);
  for (double* block : blocks) ordering->AddElementToGroup(block, 1);
  for (std::size_t j = 0; j < used_.size(); ++j) {
    if (!used_[j]) continue;
    ordering->AddElementToGroup(state_.points[j].data(), 0);
    any_point = true;
  }
  options.linear_solver_ordering.reset(ordering);
  options.linear_solver_type = any_point ? ceres::SPARSE_SCHUR : ceres::SPARSE_NORMAL_CHOLESKY;
  options.num_threads = 1;
  options.max_num_iterations = iterations;
  options.function_tolerance = tolerance;
  options.initial_trust_region_radius = trust_region;
  options.parameter_tolerance = table::kParameterTolerance;
  options.gradient_tolerance = table::kGradientTolerance;
  options.logging_type = ceres::SILENT;
  CancelCallback callback(progress_, cancel_);
  options.callbacks.push_back(&callback);
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem_.get(), &summary);
  callback.rethrow();
  iterations_ += summary.num_successful_steps + summary.num_unsuccessful_steps;
  for (std::size_t i = 0; i < free_.size(); ++i) {
    if (free_[i]) state_.frames[i].recentre();
  }
  return summary.termination_type == ceres::CONVERGENCE;
}

double AdjustmentRun::anchor_chi2(const BlockAnchor& anchor) const {
  if (anchor.whole) {
    const auto off = pose_difference(data_.ground, state_.frames[anchor.frame], anchor.whole->pose);
    return off ? off->dot(anchor.whole->covariance.llt().solve(*off)) : std::numeric_limits<double>::infinity();
  }
  const Eigen::Vector2d off = state_.frames[anchor.frame].centre_m().head<2>() - anchor.position.vector();
  return off.dot(anchor.covariance_m2.llt().solve(off));
}

// Switches anchors and observations off or on by the present state; whether any changed.
bool AdjustmentRun::decide() {
  bool changed = false;
  for (std::size_t a = 0; a < kept_.size(); ++a) {
    if (!adjusted(a)) continue;
    const bool keep = anchor_chi2(data_.anchors[a]) <=
                      (data_.anchors[a].whole ? table::kPoseAnchorSwitchOff : table::kAnchorSwitchOff);
    changed |= keep != kept_[a];
    kept_[a] = keep;
  }
  for (std::size_t j = 0; j < used_.size(); ++j) {
    if (!used_[j]) continue;
    const TiePoint& point = data_.points[j];
    std::size_t good = 0;
    for (std::size_t k = 0; k < point.observations.size(); ++k) {
      const ImageObservation& o = point.observations[k];
      const auto pixel = project(data_.lens, state_.calibration, state_.frames[o.frame], state_.points[j]);
      ObservationUse use = ObservationUse::behind_camera;
      if (pixel) {
        const double chi2 = (*pixel - o.pixel).squaredNorm() / (o.sigma_px * o.sigma_px);
        use = chi2 <= table::kObservationReject ? ObservationUse::used : ObservationUse::outlier;
      }
      good += use == ObservationUse::used ? 1 : 0;
      changed |= use != uses_[j][k];
      uses_[j][k] = use;
    }
    if (good >= (point.control ? 1 : table::kMinRays)) continue;
    used_[j] = false;
    changed = true;
    for (auto& use : uses_[j]) {
      if (use == ObservationUse::used) use = ObservationUse::too_few;
    }
  }
  return changed;
}

bool AdjustmentRun::covariances() {
  ceres::Problem::EvaluateOptions options;
  options.num_threads = 1;
  JacobianLayout layout;
  for (std::size_t i = 0; i < free_.size(); ++i) {
    if (!free_[i]) continue;
    frame_indices_.push_back(i);
    options.parameter_blocks.push_back(state_.frames[i].values.data());
  }
  layout.frames = frame_indices_.size();
  CalibrationBlock& c = state_.calibration;
  for (double* block : {&c.log_focal, c.distortion.data(), c.boresight_rad.data(), &c.log_height_scale}) {
    if (problem_->IsParameterBlockConstant(block)) continue;
    options.parameter_blocks.push_back(block);
    layout.shared += static_cast<std::size_t>(problem_->ParameterBlockTangentSize(block));
  }
  for (std::size_t j = 0; j < used_.size(); ++j) {
    if (!used_[j]) continue;
    point_indices_.push_back(j);
    options.parameter_blocks.push_back(state_.points[j].data());
  }
  layout.points = point_indices_.size();
  options.residual_blocks = frame_terms_;
  options.residual_blocks.insert(options.residual_blocks.end(), point_terms_.begin(), point_terms_.end());
  ceres::CRSMatrix jacobian;
  if (!problem_->Evaluate(options, nullptr, nullptr, nullptr, &jacobian)) return false;
  cancel_.check();
  marginal_ = marginal_covariances(jacobian, layout, data_.options.point_covariances, cancel_);
  if (!marginal_) return false;
  add_held_covariances(*marginal_);
  return true;
}

// An error that the held frames share moves the window as well.
void AdjustmentRun::add_held_covariances(MarginalCovariances& marginal) {
  std::vector<std::optional<Eigen::Matrix3d>> largest(free_.size());  // by root
  for (std::size_t i = 0; i < free_.size(); ++i) {
    if (free_[i] || !state_.covariances[i] || counts_[i] == 0) continue;
    const Eigen::Matrix3d held = state_.covariances[i]->topLeftCorner<3, 3>();
    auto& most = largest[connections_.root(i)];
    if (!most || held.trace() > most->trace()) most = held;
  }
  const auto of_frame = [&](std::size_t local) { return largest[connections_.root(frame_indices_[local])]; };
  for (std::size_t i = 0; i < marginal.frames.size(); ++i) {
    if (const auto held = of_frame(i)) marginal.frames[i].topLeftCorner<3, 3>() += *held;
  }
  for (auto& pair : marginal.pairs) {
    if (const auto held = of_frame(pair.a)) pair.covariance.topLeftCorner<3, 3>() += *held;
  }
  for (std::size_t p = 0; p < marginal.points.size(); ++p) {
    const std::size_t frame = data_.points[point_indices_[p]].observations.front().frame;
    if (const auto held = largest[connections_.root(frame)]) marginal.points[p] += *held;
  }
}

// Of a whole adjustment; a window reports what the last one found.
void AdjustmentRun::report_calibration() {
  const CalibrationBlock& c = state_.calibration;
  CameraSelfCalibration& result = state_.reported;
  result.camera = data_.camera;
  result.camera.fx *= std::exp(c.log_focal);
  result.camera.fy *= std::exp(c.log_focal);
  result.camera.distortion = c.distortion;
  if (!whole_) return;
  // The free parameters stand in this order in the covariance.
  Eigen::Index next = 0;
  const auto calibrated = [&](double value, double prior) {
    CalibratedValue calibrated_value{value, 0};
    if (prior > 0 && marginal_) {
      calibrated_value.sigma = std::sqrt(marginal_->shared(next, next));
      ++next;
    } else if (prior > 0) {
      calibrated_value.sigma = prior;
    }
    return calibrated_value;
  };
  const CalibrationPrior& prior = data_.options.calibration;
  result.log_focal = calibrated(c.log_focal, prior.focal_relative);
  for (std::size_t i = 0; i < 5; ++i) {
    result.distortion[i] = calibrated(c.distortion[i], i == 2 || i == 3 ? prior.tangential : prior.radial);
  }
  for (std::size_t i = 0; i < 3; ++i) {
    result.boresight[i] = calibrated(c.boresight_rad[i], prior.boresight_axis_rad(i));
  }
  result.log_height_scale = calibrated(c.log_height_scale, prior.height_scale);
}

AdjustedBlock AdjustmentRun::report() const {
  AdjustedBlock block;
  block.outcome = outcome_;
  block.iterations = iterations_;
  block.calibration = state_.reported;
  for (std::size_t i = 0; i < free_.size(); ++i) {
    AdjustedFrame frame;
    frame.pose = pose_from_block(state_.frames[i], data_.ground);
    frame.up_m = state_.frames[i].values[2];
    frame.state = free_[i] ? state_.frame_states[i] : FrameState::held;
    if (free_[i]) frame.covariance = state_.covariances[i];
    frame.observations = counts_[i];
    block.floating_frames += frame.state == FrameState::floating ? 1 : 0;
    block.frames.push_back(frame);
  }
  for (std::size_t a = 0; a < kept_.size(); ++a) {
    if (!adjusted(a)) continue;
    const BlockAnchor& anchor = data_.anchors[a];
    const double chi2 = anchor_chi2(anchor);
    const double bound = anchor.whole ? table::kPoseAnchorBound : table::kAnchorBound;
    block.anchors.push_back({a, !kept_[a], switch_value(chi2, bound), chi2,
                             state_.frames[anchor.frame].centre_m().head<2>() - anchor.position.vector()});
  }
  double sum = 0, squares = 0;
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    const TiePoint& point = data_.points[j];
    AdjustedPoint adjusted_point;
    adjusted_point.used = used_[j];
    adjusted_point.position_m = state_.points[j];
    if (used_[j] && point.control) {
      adjusted_point.control_residual_m = state_.points[j].head<2>() - point.control->place.vector();
    }
    for (std::size_t k = 0; k < point.observations.size(); ++k) {
      const ImageObservation& o = point.observations[k];
      AdjustedObservation observation{uses_[j][k]};
      if (state_.point_known[j]) {
        const auto pixel = project(data_.lens, state_.calibration, state_.frames[o.frame], state_.points[j]);
        if (pixel) observation.residual_px = *pixel - o.pixel;
      }
      if (observation.use == ObservationUse::used) {
        ++block.observations;
        sum += observation.residual_px.norm();
        squares += observation.residual_px.squaredNorm();
      }
      block.rejected_observations +=
          observation.use == ObservationUse::outlier || observation.use == ObservationUse::behind_camera ? 1 : 0;
      adjusted_point.observations.push_back(observation);
    }
    block.points.push_back(std::move(adjusted_point));
  }
  if (block.observations > 0) {
    block.mean_reprojection_px = sum / static_cast<double>(block.observations);
    block.rms_reprojection_px = std::sqrt(squares / static_cast<double>(block.observations));
  }
  if (!marginal_) return block;
  for (std::size_t p = 0; p < marginal_->points.size(); ++p) {
    const std::size_t j = point_indices_[p];
    const bool anchored = std::any_of(
        data_.points[j].observations.begin(), data_.points[j].observations.end(), [&](const ImageObservation& o) {
          return free_[o.frame] && counts_[o.frame] > 0 && state_.frame_states[o.frame] == FrameState::anchored;
        });
    if (anchored) block.points[j].covariance_m2 = marginal_->points[p];
  }
  for (const auto& pair : marginal_->pairs) {
    const std::size_t a = frame_indices_[pair.a], b = frame_indices_[pair.b];
    if (state_.frame_states[a] == FrameState::anchored) block.cross_covariances.push_back({a, b, pair.covariance});
  }
  return block;
}

AdjustedBlock AdjustmentRun::run() {
  constexpr int kMostIterations = static_cast<int>(table::kAnchorWidening.size()) * table::kAnnealingIterations +
                                  table::kDecisionRounds * table::kFinalIterations;
  const bool any = std::find(free_.begin(), free_.end(), true) != free_.end();
  if (any) {
    progress_.begin("block adjustment", static_cast<std::uint64_t>(kMostIterations), "iterations");
    cancel_.check();
    place_points();
    build();
    for (std::size_t round = 0; round < table::kAnchorWidening.size(); ++round) {
      anchor_bound_ = table::kAnchorBound * table::kAnchorWidening[round];
      pose_bound_ = table::kPoseAnchorBound * table::kAnchorWidening[round];
      huber_width_ = table::kObservationHuber * table::kObservationWidening[round];
      solve(table::kAnnealingIterations, table::kAnnealingTolerance,
            round == 0 ? table::kFarTrustRegion : table::kNearTrustRegion);
    }
    settled_ = true;
    for (int round = 0; round < table::kDecisionRounds; ++round) {
      if (!decide() && round > 0) break;
      build();
      outcome_ = solve(table::kFinalIterations, table::kFinalTolerance, table::kNearTrustRegion)
                     ? AdjustmentOutcome::converged
                     : AdjustmentOutcome::iteration_limit;
    }
    if (data_.options.covariances && !covariances()) outcome_ = AdjustmentOutcome::underdetermined;
    for (std::size_t i = 0; i < free_.size(); ++i) {
      if (!free_[i]) continue;
      state_.frame_states[i] = anchored_[connections_.root(i)] ? FrameState::anchored : FrameState::floating;
      state_.covariances[i].reset();
    }
    for (std::size_t local = 0; marginal_ && local < frame_indices_.size(); ++local) {
      const std::size_t i = frame_indices_[local];
      if (state_.frame_states[i] == FrameState::anchored) state_.covariances[i] = marginal_->frames[local];
    }
  }
  report_calibration();
  AdjustedBlock block = report();
  if (any) progress_.end();
  return block;
}

}  // namespace

AdjustedBlock run_adjustment(const BlockData& data, BlockState& state, FrameWindow window, Progress& progress,
                             const Cancel& cancel) {
  return AdjustmentRun(data, state, window, progress, cancel).run();
}

}  // namespace nadir
